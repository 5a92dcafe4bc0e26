"""Agglomerative clustering of point trajectories into parts that move rigidly.

A cluster's cost is the sum of squared distances that the best rigid motion in every frame leaves of its
trajectories; two touching clusters merge at the price of what their union adds to it.
All costs follow from per-frame moments, so merging never looks at the points again.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from stages.kernels.motion.rigid_motion import best_rotation


@dataclass(frozen=True)
class Moments:
    """Sums over points x of one reference frame and their positions y in every frame.

    Arrays lead with the clusters: `count` (clusters,), `x` (clusters, 3), `y` (clusters, frames, 3),
    `xy` (clusters, frames, 3, 3) of x y^T, `squares` (clusters, frames) of |x|^2 + |y|^2.
    """

    count: np.ndarray
    x: np.ndarray
    y: np.ndarray
    xy: np.ndarray
    squares: np.ndarray

    def __getitem__(self, index: np.ndarray | int) -> Moments:
        return Moments(self.count[index], self.x[index], self.y[index], self.xy[index], self.squares[index])

    def __add__(self, other: Moments) -> Moments:
        return Moments(
            self.count + other.count,
            self.x + other.x,
            self.y + other.y,
            self.xy + other.xy,
            self.squares + other.squares,
        )


def moments(
    points: Float64[np.ndarray, "points 3"],
    trajectories: Float64[np.ndarray, "frames points 3"],
    labels: Int64[np.ndarray, "points"],
    clusters: int,
) -> Moments:
    """The moments of each label's points."""
    one_hot = np.eye(clusters)[labels]
    y = trajectories.transpose(1, 0, 2)
    return Moments(
        count=one_hot.sum(0),
        x=one_hot.T @ points,
        y=np.einsum("nc,ntj->ctj", one_hot, y, optimize=True),
        xy=np.einsum("nc,ni,ntj->ctij", one_hot, points, y, optimize=True),
        squares=one_hot.T @ ((points**2).sum(-1)[:, None] + (y**2).sum(-1)),
    )


def _covariance(m: Moments) -> Float64[np.ndarray, "clusters frames 3 3"]:
    """Sum of centred x y^T."""
    return m.xy - m.x[..., None, :, None] * m.y[..., :, None, :] / m.count[..., None, None, None]


def rigid_motion(m: Moments) -> Float64[np.ndarray, "clusters frames 4 4"]:
    """The rigid motion of each cluster and frame that best takes x to y (Kabsch)."""
    R = best_rotation(_covariance(m))
    Ts = np.zeros((*R.shape[:-2], 4, 4))
    Ts[..., :3, :3] = R
    centre = (m.x / m.count[..., None])[..., None, :, None]
    Ts[..., :3, 3] = m.y / m.count[..., None, None] - (R @ centre)[..., 0]
    Ts[..., 3, 3] = 1.0
    return Ts


def rigid_square_sum(m: Moments) -> Float64[np.ndarray, "clusters"]:
    """Sum over frames and points of the squared distance left by the best rigid motion of each frame."""
    count = m.count[..., None]
    covariance = _covariance(m)
    spread = m.squares - ((m.x**2).sum(-1)[..., None] + (m.y**2).sum(-1)) / count
    singular = np.linalg.svd(covariance, compute_uv=False)
    singular[..., 2] *= np.where(np.linalg.det(covariance) < 0, -1.0, 1.0)
    return np.maximum(spread - 2 * singular.sum(-1), 0.0).sum(-1)


def merge_rigid_clusters(
    start: Moments, edges: Int64[np.ndarray, "edges 2"], clusters: int, max_increase: float = np.inf
) -> Int64[np.ndarray, "start"]:
    """The cluster of each start cluster after greedy merging along `edges`.

    The pair whose union adds the least sum of squares merges first, until `clusters` are left, or the next merge
    would add more than `max_increase`, or no touching pairs are left. Labels come out as 0..n-1.
    """
    total = len(start.count)
    # merged clusters get new ids behind the start ones
    parts = [start[i] for i in range(total)]
    left = list(rigid_square_sum(start))
    touching: list[set[int]] = [set() for _ in range(total)]
    for a, b in edges:
        if a != b:
            touching[a].add(int(b))
            touching[b].add(int(a))
    parent = list(range(total))
    alive = set(range(total))
    heap: list[tuple[float, int, int]] = []

    def push(a: int, others: list[int]) -> None:
        if not others:
            return
        unions = [parts[a] + parts[b] for b in others]
        stacked = Moments(*(np.stack([getattr(u, f) for u in unions]) for f in ("count", "x", "y", "xy", "squares")))
        for b, cost in zip(others, rigid_square_sum(stacked), strict=True):
            heapq.heappush(heap, (float(cost) - left[a] - left[b], min(a, b), max(a, b)))

    for a in range(total):
        push(a, sorted(b for b in touching[a] if b > a))
    while len(alive) > clusters and heap:
        increase, a, b = heapq.heappop(heap)
        if a not in alive or b not in alive:
            continue
        if increase > max_increase:
            break
        new = len(parts)
        parts.append(parts[a] + parts[b])
        left.append(left[a] + left[b] + increase)
        touching.append((touching[a] | touching[b]) - {a, b})
        parent[a] = parent[b] = new
        parent.append(new)
        alive -= {a, b}
        alive.add(new)
        for c in touching[new]:
            touching[c] -= {a, b}
            touching[c].add(new)
        push(new, sorted(touching[new]))

    def root(i: int) -> int:
        while parent[i] != i:
            i = parent[i]
        return i

    return np.unique([root(i) for i in range(total)], return_inverse=True)[1].astype(np.int64)
