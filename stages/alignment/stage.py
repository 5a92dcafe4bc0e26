"""The alignment stage: one coordinate system for all frames.

Scan apps give each scan coordinates of its own. Then the largest body that moves rigidly over all frames is registered,
whatever the scans' orientations, and stands still in common coordinates. Later stages work there. The model is brought
back to the frames' own coordinates when the canonical frame is chosen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from schemas.alignment import Alignment
from schemas.config import AlignmentConfig
from schemas.sequence import PointSequence
from stages.alignment.agreement import agreeing
from stages.alignment.whole import shared, whole_motions
from stages.kernels.alignment.fit_cost import fit_costs, refine_motions
from stages.kernels.alignment.oriented_cloud import OrientedCloud
from stages.kernels.motion.rigid_motion import inverse
from stages.kernels.points.sampling import farthest_points, point_spacing, working_points
from stages.support.progress import Progress, silent

NEARBY_REACHES = (4.0, 3.0, 2.5, 2.0, 1.5, 1.5)
LOOKED_AT = 12  # frames that tell whether coordinates are shared
PROBED = 3  # of these, the ones in most doubt are registered
UPRIGHT_DEGREES = 25.0  # by which the vertical of upright scans may differ
CLEARLY_MORE = 0.25  # share by which a registration must beat the frames' own coordinates


def compute_alignment(sequence: PointSequence, config: AlignmentConfig, progress: Progress = silent) -> Alignment:
    """Find out whether frames share coordinates, and register them to the middle frame where they do not.

    Deterministic.
    """
    frames = sequence.frames()
    identity, all_of_it = np.tile(np.eye(4), (len(frames), 1, 1)), np.ones(len(frames))
    if config.own_frames == "no" or (config.own_frames == "auto" and _share_coordinates(frames, config)):
        return Alignment(own_frames=False, upright=False, Ts_common_frame=identity, shares=all_of_it)
    Ts, shares = _registered(Scans(frames, config.points), progress)
    return Alignment(own_frames=True, upright=_upright(Ts), Ts_common_frame=Ts, shares=shares)


def _upright(Ts_common_frame: Float64[np.ndarray, "frames 4 4"]) -> bool:
    """Whether scans were turned about the vertical only, but for some degrees, as apps that know gravity turn them."""
    return bool((Ts_common_frame[:, 2, 2] > np.cos(np.radians(UPRIGHT_DEGREES))).all())


class Scans:
    """Well spread points of each frame, in spacings of the reference frame's thinned points."""

    def __init__(self, frames: Sequence[Float64[np.ndarray, "points 3"]], points: int) -> None:
        self.frames, self.points, self.reference = frames, points, len(frames) // 2
        p_reference = frames[self.reference]
        self.spacing = point_spacing(p_reference[working_points(p_reference, points)])
        self._clouds: dict[int, OrientedCloud] = {}
        self._thin: dict[int, OrientedCloud] = {}

    def cloud(self, t: int) -> OrientedCloud:
        """A frame as a target: twice the points, so that a moved point always finds one nearby."""
        if t not in self._clouds:
            index = working_points(self.frames[t], 2 * self.points)
            self._clouds[t] = OrientedCloud.of(self.frames[t][index] / self.spacing)
        return self._clouds[t]

    def thin(self, t: int) -> OrientedCloud:
        """A frame as a source."""
        if t not in self._thin:
            self._thin[t] = self.cloud(t).take(farthest_points(self.cloud(t).p, self.points))
        return self._thin[t]

    def share_nearby(self, source: int, target: int) -> float:
        """The share of two frames that lie on each other, but for a small motion of the whole."""
        moved = refine_motions(self.cloud(target), self.thin(source), np.eye(4)[None], NEARBY_REACHES)[0]
        return max(shared(self.thin(source), self.cloud(target), T) for T in (np.eye(4), moved))

    def whole_motions(self, t: int) -> tuple[Float64[np.ndarray, "motions 4 4"], Float64[np.ndarray, "motions"]]:
        """Motions of the reference frame onto frame t, and the shares that they explain."""
        reference = self.thin(self.reference)
        return whole_motions(reference, self.cloud(t), float(np.linalg.norm(np.ptp(reference.p, axis=0))))


def _share_coordinates(frames: Sequence[Float64[np.ndarray, "points 3"]], config: AlignmentConfig) -> bool:
    """Whether frames lie on each other as they are; else, whether registering them helps little."""
    scans = Scans(frames, config.probe_points)
    others = np.setdiff1d(np.linspace(0, len(frames) - 1, LOOKED_AT).round().astype(int), [scans.reference])
    shares = {
        t: max(scans.share_nearby(a, t) for a in {scans.reference, t - 1 if t > scans.reference else t + 1})
        for t in others.tolist()
    }
    doubtful = [t for t in sorted(shares, key=shares.__getitem__)[:PROBED] if shares[t] < config.connected]
    gains = [scans.whole_motions(t)[1][0] - shares[t] for t in doubtful]
    return not gains or float(np.median(gains)) <= CLEARLY_MORE


def _registered(
    scans: Scans, progress: Progress
) -> tuple[Float64[np.ndarray, "frames 4 4"], Float64[np.ndarray, "frames"]]:
    """From each frame's coordinates to the reference frame's, by the largest common body; and its shares."""
    count, reference = len(scans.frames), scans.thin(scans.reference)
    others = [t for t in range(count) if t != scans.reference]
    motions, explained, all_shares = [], [], []
    for t in others:
        Ts, shares = scans.whole_motions(t)
        motions.append(Ts)
        all_shares.append(shares)
        explained.append(1.0 - fit_costs(scans.cloud(t), reference, Ts)[0])
        progress(len(motions), len(others))
    T_common_frame, share = np.tile(np.eye(4), (count, 1, 1)), np.ones(count)
    for k, (t, number) in enumerate(zip(others, agreeing(explained, all_shares), strict=True)):
        T_common_frame[t], share[t] = inverse(motions[k][number]), all_shares[k][number]
    T_common_frame[:, :3, 3] *= scans.spacing
    return T_common_frame, share
