"""The bodies of a sequence, and whether they explain it better than other parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float64, Int64

from schemas.config import BodiesConfig
from schemas.flow import Flow
from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.points.nearest import nearest
from stages.kernels.points.sampling import farthest_points, point_spacing, working_points
from stages.relaxed_fit.bodies.scene import Explanation, Scene
from stages.relaxed_fit.bodies.search import explain
from stages.relaxed_fit.start import Start

FARTHEST = 98  # percentile of the flow's lengths that tells how far points move


def are_far_apart(flow: Flow, frames: int, config: BodiesConfig) -> bool:
    """Whether bodies are to be looked for: in few frames always, in some more where points move far."""
    if config.few_frames < frames <= config.most_frames:
        lengths = [np.linalg.norm(pair.flow, axis=1) for pair in flow.pairs() if len(pair.flow)]
        return bool(lengths) and float(np.mean([np.percentile(length, FARTHEST) for length in lengths])) > config.far
    return frames <= config.few_frames


@dataclass(frozen=True)
class Bodies:
    """A canonical cloud and the other frames, in spacings of thinned canonical points, for the search for bodies."""

    scene: Scene
    spacing: float
    others: list[int]

    @classmethod
    def of(cls, frames: Sequence[Float64[np.ndarray, "points 3"]], canonical_frame: int, config: BodiesConfig) -> Self:
        p = frames[canonical_frame]
        spacing = point_spacing(p[working_points(p, config.points)])
        clouds = [OrientedCloud.of(frame[working_points(frame, 2 * config.points)] / spacing) for frame in frames]
        others = [t for t in range(len(frames)) if t != canonical_frame]
        source = clouds[canonical_frame].take(farthest_points(clouds[canonical_frame].p, config.points))
        return cls(Scene.of(source, [clouds[t] for t in others]), spacing, others)

    def find(self) -> Explanation:
        """Bodies, the first of which stands still: so one does in common coordinates."""
        still = np.tile(np.eye(4), (len(self.others), 1, 1))
        diagonal = float(np.linalg.norm(np.ptp(self.scene.source.p, axis=0)))
        return explain(Explanation.by_one_body(self.scene, still), diagonal)

    def start(self, found: Explanation, p: Float64[np.ndarray, "points 3"]) -> Start:
        """Labels of canonical points and motions, normalised."""
        labels = found.labels[nearest(self.scene.source.tree, p / self.spacing)[1]]
        Ts = np.tile(np.eye(4), (len(self.others) + 1, len(found.Ts), 1, 1))
        Ts[self.others] = found.Ts.swapaxes(0, 1)
        Ts[..., :3, 3] *= self.spacing
        return Start(labels, Ts)

    def energy(
        self,
        p: Float64[np.ndarray, "points 3"],
        labels: Int64[np.ndarray, "points"],
        Ts: Float64[np.ndarray, "frames parts 4 4"],
    ) -> float:
        """The energy of any parts of canonical points, as that of bodies."""
        index = nearest(OrientedCloud.of(p / self.spacing).tree, self.scene.source.p)[1]
        motions = Ts[self.others].swapaxes(0, 1).copy()
        motions[..., :3, 3] /= self.spacing
        costs = np.stack([self.scene.costs(of_part) for of_part in motions])
        return Explanation(self.scene, labels[index], motions, costs).energy
