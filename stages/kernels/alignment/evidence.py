"""What all frames say of the motion that a point is held to have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.alignment.registration import Registration
from stages.kernels.alignment.visibility import WALL, Exposure, sum_of_seen
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.nearest import nearest

NEAREST = 3  # points of a frame that stand for its surface near a moved point
NEAR = 0.7  # radius, in spacings, within which they count
FUSED_PLANE_SPREAD = 0.2  # of distances from the plane that all frames share, in spacings, where the motion is right
USUAL_FRAMES = 9  # besides the canonical one
ENCLOSED_SHOWN = 0.24  # where more of the points are enclosed, what is enclosed was sampled too
ENCLOSED_EMPTY = 0.02  # where fewer of the enclosed places of parts are empty, likewise
EMPTY = 3.0  # spacings from a place within which no point lies
CHUNK = 600_000  # places of entries in frames looked at together, for memory's sake
Model = tuple[Int64[np.ndarray, "points"], Float64[np.ndarray, "frames parts 4 4"]]  # labels, and motions of the parts


def price_over(evidence: float, price: float) -> float:
    """A price of parts or links, which is meant for `USUAL_FRAMES`, where fewer frames tell (Registration.evidence).

    Costs are means over the frames. A part that is not there still gains from their noise, as its points and its axis
    are chosen for that: in sum over the frames about as much however many they are, so in the mean the more, the fewer
    they are. More frames than usual do not lower a price.
    """
    return price * max(1.0, USUAL_FRAMES / evidence)


def views_from_outside(registration: Registration, models: Sequence[Model]) -> list[Exposure] | None:
    """What was seen of each frame if it was seen from outside only; None where models tell that it was not so.

    Frames that were show few points of what they enclose, and places that parts have there by their motions are often
    empty.
    """
    frames, spacings = registration.frames, registration.spacings
    views = [Exposure.of(frame, spacing) for frame, spacing in zip(frames, spacings, strict=True)]
    shown = np.mean([(view.at(frame) < WALL).mean() for view, frame in zip(views, frames, strict=True)])
    enclosed = empty = 0
    for labels, Ts in models:
        for t in registration.others:
            p = move_points(Ts[t, labels], registration.p)
            p = p[views[t].at(p) < WALL]
            enclosed += len(p)
            empty += int(np.count_nonzero(nearest(registration.trees[t], p)[0] > EMPTY * registration.spacings[t]))
    return views if shown < ENCLOSED_SHOWN and empty > ENCLOSED_EMPTY * enclosed else None


def motion_cost(
    registration: Registration,
    p: Float64[np.ndarray, "points 3"],
    point: Int64[np.ndarray, "entries"],
    part: Int64[np.ndarray, "entries"],
    Ts: Float64[np.ndarray, "frames parts 4 4"],
) -> Float64[np.ndarray, "entries"]:
    """How badly a point's motion with a part is borne out, averaged over frames.

    Each frame's surface near the moved point is carried back by the part's motion. Where the motion is right, all
    frames' patches lie on one plane through the point; its scatter is far below a single frame's sampling noise.
    The cost in a frame is the squared distance of the nearest point from that plane in units of its spread, plus half
    its squared distance from the moved point in spacings, truncated. Frames that hide the moved point are taken to cost
    what the others let one expect.
    """
    step = max(1, CHUNK // len(registration.others))
    chunks = [slice(start, start + step) for start in range(0, len(point), step)]
    costs = [_cost(registration, p[point[chunk]], part[chunk], Ts) for chunk in chunks]
    return np.concatenate(costs) if costs else np.zeros(0)


def gross_cost(
    registration: Registration,
    p: Float64[np.ndarray, "points 3"],
    point: Int64[np.ndarray, "entries"],
    part: Int64[np.ndarray, "entries"],
    Ts: Float64[np.ndarray, "frames parts 4 4"],
    frames: Sequence[int],
) -> Float64[np.ndarray, "entries"]:
    """The share of `motion_cost` that is due to distances from moved points alone, averaged over some of the frames.

    What is far from every surface in a few frames needs no closer look.
    """
    costs, hidden = np.empty((len(frames), len(point))), np.zeros((len(frames), len(point)), dtype=bool)
    for slot, t in enumerate(frames):
        moved = move_points(Ts[t, part], p[point])
        distance = nearest(registration.trees[t], moved)[0] / registration.spacings[t]
        tells = registration.tells(t, moved, distance)
        costs[slot] = np.minimum(0.5 * distance**2, registration.truncation * tells)
        hidden[slot] = tells == 0
    return sum_of_seen(costs, hidden, 0) / len(frames)


def _cost(
    registration: Registration,
    p: Float64[np.ndarray, "entries 3"],
    part: Int64[np.ndarray, "entries"],
    Ts: Float64[np.ndarray, "frames parts 4 4"],
) -> Float64[np.ndarray, "entries"]:
    carried, distance, tells = _carried_back(registration, p, part, Ts)
    cloud = carried.reshape(len(p), -1, 3)
    weights = np.exp(-0.5 * (cloud**2).sum(axis=-1) / NEAR**2) + 1e-6
    weights /= weights.sum(axis=1, keepdims=True)
    mean = np.einsum("nk,nki->ni", weights, cloud)
    offsets = cloud - mean[:, None]
    normal = np.linalg.eigh(np.matmul((weights[..., None] * offsets).transpose(0, 2, 1), offsets))[1][:, :, 0]
    plane = np.einsum("ni,nti->nt", normal, carried[:, :, 0] - mean[:, None]) / FUSED_PLANE_SPREAD
    own = np.einsum("ni,ni->n", normal, mean) / FUSED_PLANE_SPREAD
    most = registration.truncation
    costs = np.minimum(plane**2 + 0.5 * distance**2, most * tells)
    total = sum_of_seen(costs, tells == 0, 1) + np.minimum(own**2, most)
    return total / len(registration.others)


def _carried_back(
    registration: Registration,
    p: Float64[np.ndarray, "entries 3"],
    part: Int64[np.ndarray, "entries"],
    Ts: Float64[np.ndarray, "frames parts 4 4"],
) -> tuple[
    Float64[np.ndarray, "entries frames nearest 3"],
    Float64[np.ndarray, "entries frames"],
    Float64[np.ndarray, "entries frames"],
]:
    """Offsets to the nearest points, carried back to each point, and the least distance; in each frame's spacings.

    Then how much it says where that is far (Registration.tells).
    """
    count = min(NEAREST, *(len(registration.frames[t]) for t in registration.others))
    carried = np.empty((len(p), len(registration.others), count, 3))
    distance, tells = np.empty((2, len(p), len(registration.others)))
    for slot, t in enumerate(registration.others):
        T = Ts[t, part]
        moved = move_points(T, p)
        distances, index = registration.trees[t].query(moved, k=count)
        offset = registration.frames[t][index.reshape(len(p), count)] - moved[:, None]
        carried[:, slot] = np.matmul(offset, T[:, :3, :3]) / registration.spacings[t]
        distance[:, slot] = distances.reshape(len(p), count)[:, 0] / registration.spacings[t]
        tells[:, slot] = registration.tells(t, moved, distance[:, slot])
    return carried, distance, tells
