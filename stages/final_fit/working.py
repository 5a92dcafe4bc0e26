"""The final fit's working state: a model on the points that the fit works on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64, Int64

from schemas.kinematic import KinematicModel, LinkType
from schemas.sequence import PointSequence
from stages.kernels.alignment.evidence import price_over
from stages.kernels.alignment.registration import Registration
from stages.kernels.kinematics.articulation import Chain, fit_chain
from stages.kernels.kinematics.screw import fit_screw, nearest_point_to_origin
from stages.kernels.motion import se3
from stages.kernels.points.nearest import KDTree, nearest
from stages.kernels.points.sampling import working_points
from stages.projection.stage import part_samples

JOINT_SAMPLES = 60  # points of a part at which hypotheses of its joint are judged
CONTACT = 2.0  # spacings within which sampled surfaces touch


@dataclass(frozen=True)
class Fit:
    """A tree of joints, and the part of every working point. Parts that no point shows have no labels."""

    chain: Chain
    labels: Int64[np.ndarray, "points"]


@dataclass(frozen=True)
class Frames:
    """The clouds that a fit works on, against each other; `index` are the canonical ones among all, `p_all`."""

    registration: Registration
    p_all: Float64[np.ndarray, "all 3"]
    index: Int64[np.ndarray, "points"]
    canonical_frame: int
    reach: float

    @property
    def p(self) -> Float64[np.ndarray, "points 3"]:
        return self.registration.p

    @property
    def noise(self) -> float:
        return self.registration.noise

    def price(self, price: float) -> float:
        """A price of a part or link, which is meant for many frames, as it is for these."""
        return price_over(self.registration.evidence, price)

    def refine(self, fit: Fit, iterations: int) -> Fit:
        """Joints and states fitted to all frames, labels as they are."""
        linearise = lambda Ts: self.registration.linearise(fit.labels, Ts, self.reach)  # noqa: E731
        return Fit(fit_chain(fit.chain, linearise, self.canonical_frame, self.noise, iterations), fit.labels)

    def point_costs(
        self, labels: Int64[np.ndarray, "points"], Ts: Float64[np.ndarray, "frames parts 4 4"]
    ) -> Float64[np.ndarray, "points"]:
        """Every point's cost with its part's motion (Registration.cost)."""
        return self.registration.cost(np.arange(len(labels)), labels, Ts)

    def cost(self, fit: Fit) -> float:
        """All points' costs under the fit's motions."""
        return float(self.point_costs(fit.labels, fit.chain.Ts()).sum())

    def unexplained(self, fit: Fit) -> float:
        """The other way round: the costs of all frames' points at the posed model (Registration.cost_back)."""
        return self.registration.cost_back(fit.labels, fit.chain.Ts())


def working_frames(sequence: PointSequence, canonical_frame: int, points: int, reach: float) -> Frames:
    """At most `points` well spread points of each frame."""
    frames = sequence.frames()
    chosen = [working_points(frame, points) for frame in frames]
    registration = Registration([frame[index] for frame, index in zip(frames, chosen, strict=True)], canonical_frame)
    return Frames(registration, frames[canonical_frame], chosen[canonical_frame], canonical_frame, reach)


def to_chain(model: KinematicModel, frames: Frames, still_root: float) -> Chain:
    """The model's tree with every joint made revolute or prismatic, whichever explains the child's motion better.

    Both are judged by how far they leave the child's points from where they were seen: the choice knows no unit
    (where A.4 compares an angle with a length). A root that moves less than `still_root` spacings is held still.
    """
    order = model.joints_from_root()
    parent, child = model.joint_parent[order], model.joint_child[order]
    samples = part_samples(frames.p_all, model.labels, JOINT_SAMPLES)
    fits = joint_fits(model.Ts_frame_canonical, parent, child, samples[child])
    T_frame_root = model.Ts_frame_canonical[:, model.root].copy()
    p_root = frames.p_all[model.labels == model.root]
    free_root = _travel(T_frame_root, p_root) > still_root * frames.noise
    if not free_root:
        T_frame_root[:] = np.eye(4)
    return Chain(
        root=model.root,
        parent=parent,
        child=child,
        revolute=fits.revolute,
        axis=fits.axis,
        point=fits.point,
        states=fits.states - fits.states[:, [model.canonical_frame]],
        T_frame_root=T_frame_root,
        free_root=free_root,
    )


@dataclass(frozen=True)
class JointFits:
    """The better of a revolute and a prismatic joint for each of several relative motions; `residual` is an RMS."""

    revolute: np.ndarray
    axis: Float64[np.ndarray, "joints 3"]
    point: Float64[np.ndarray, "joints 3"]
    states: Float64[np.ndarray, "joints frames"]
    residual: Float64[np.ndarray, "joints"]


def joint_fits(
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    parent: Int64[np.ndarray, "joints"],
    child: Int64[np.ndarray, "joints"],
    p_child: Float64[np.ndarray, "joints points 3"],
) -> JointFits:
    """One joint of one degree of freedom for each pair of parts, in closed form."""
    T_parent_child = relative_motions(Ts, parent, child)
    p = torch.from_numpy(p_child)
    turn, slide = fit_screw(T_parent_child, p, "revolute"), fit_screw(T_parent_child, p, "prismatic")
    revolute = (turn.residual <= slide.residual).numpy()

    def pick(turning: torch.Tensor, sliding: torch.Tensor) -> np.ndarray:
        chosen = revolute.reshape(-1, *[1] * (turning.ndim - 1))
        return np.where(chosen, turning.numpy(), sliding.numpy())

    return JointFits(
        revolute=revolute,
        axis=pick(turn.axis, slide.axis),
        point=pick(turn.point, slide.point),
        states=pick(turn.states[..., 0], slide.states[..., 1]),
        residual=np.sqrt(pick(turn.residual, slide.residual)),
    )


def relative_motions(
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    parent: Int64[np.ndarray, "joints"],
    child: Int64[np.ndarray, "joints"],
) -> torch.Tensor:
    """T_parent_child (joints, frames, 4, 4) in canonical coordinates."""
    T = torch.from_numpy(Ts).transpose(0, 1)
    return se3.inverse(T[parent]) @ T[child]


def contact_of(
    p_parent: Float64[np.ndarray, "points 3"], p_child: Float64[np.ndarray, "others 3"]
) -> Float64[np.ndarray, "3"]:
    """The middle between the two nearest points of two parts."""
    distance, index = nearest(KDTree(p_parent), p_child)
    closest = distance.argmin()
    return 0.5 * (p_parent[index[closest]] + p_child[closest])


def to_model(model: KinematicModel, fit: Fit, frames: Frames) -> KinematicModel:
    """The fitted tree as a model, every canonical point labelled as the working point nearest to it."""
    chain = fit.chain
    labels = fit.labels[nearest(KDTree(frames.p), frames.p_all)[1]]
    labels[frames.index] = fit.labels
    types: tuple[LinkType, ...] = tuple("revolute" if turns else "prismatic" for turns in chain.revolute)
    joints = len(chain.child)
    return model.replace(
        root=chain.root,
        labels=labels,
        Ts_frame_canonical=chain.Ts(),
        joint_parent=chain.parent,
        joint_child=chain.child,
        joint_types=types,
        axis=chain.axis,
        point=nearest_point_to_origin(torch.from_numpy(chain.axis), torch.from_numpy(chain.point)).numpy(),
        states=chain.joint_states(),
        e_spatial=np.zeros(joints),
        e_1dof=np.zeros(joints),
    )


def _travel(Ts: Float64[np.ndarray, "frames 4 4"], p: Float64[np.ndarray, "points 3"]) -> float:
    """RMS distance, over frames and points, that points move from where they are in the canonical frame."""
    moved = se3.transform(torch.from_numpy(Ts), torch.from_numpy(p)).numpy()
    return float(np.sqrt(((moved - p) ** 2).sum(axis=-1).mean())) if len(p) else 0.0
