"""Posable training shapes: trees of random primitive parts, and boxes with doors and drawers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial.transform import Rotation

from stages.ingest.roboart.articulated import Poses
from stages.ingest.roboart.surface import Surface, move, sample_triangles
from stages.ingest.roboart.urdf import import_extra

Triangles = Float64[np.ndarray, "triangles 3 3"]

FURNITURE_SHARE = 0.25
LIMBS = (1, 6)  # limbs at the trunk
LIMB_PARTS = (1, 5)
MOST_PARTS = 24
REPEATED_SHARE = 0.6  # of limbs that are repeated around the trunk or mirrored
PRISMATIC_SHARE = 0.12
BRANCH_SHARE = 0.2  # of parts that branch off before the end of their limb
TURN_DEGREES = (40.0, 170.0)  # range of a revolute joint
SLIDE = (0.2, 0.7)  # range of a prismatic joint, in lengths of its part
THICKNESS = 0.012  # of boards


@dataclass(frozen=True)
class PosableShape:
    """A surface whose rigid parts move by joint positions (radians or lengths) within `ranges`."""

    surface: Surface
    ranges: Float64[np.ndarray, "joints 2"]
    turning: Bool[np.ndarray, "joints"]
    poses: Callable[[Float64[np.ndarray, "states joints"]], Poses]


@dataclass
class Tree:
    """Parts at rest in one coordinate system, each with the joint that links it to an earlier part."""

    triangles: list[Triangles] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)
    axis: list[Float64[np.ndarray, "3"]] = field(default_factory=list)
    point: list[Float64[np.ndarray, "3"]] = field(default_factory=list)
    turning: list[bool] = field(default_factory=list)
    range: list[tuple[float, float]] = field(default_factory=list)

    def add(
        self,
        triangles: Triangles,
        parent: int = -1,
        axis: np.ndarray | None = None,
        point: np.ndarray | None = None,
        turning: bool = True,
        range_: tuple[float, float] = (0.0, 0.0),
    ) -> int:
        """Add a part below `parent` (-1 for the root, which has no joint), and return its index."""
        self.triangles.append(triangles)
        self.parent.append(parent)
        self.axis.append(np.zeros(3) if axis is None else axis / np.linalg.norm(axis))
        self.point.append(np.zeros(3) if point is None else np.asarray(point, dtype=np.float64))
        self.turning.append(turning)
        self.range.append(range_)
        return len(self.triangles) - 1

    def shape(self) -> PosableShape:
        """The tree as a shape. Joint j moves part j + 1."""
        return PosableShape(
            surface=Surface(
                np.concatenate(self.triangles),
                np.repeat(np.arange(len(self.triangles)), [len(piece) for piece in self.triangles]),
            ),
            ranges=np.array(self.range[1:]).reshape(-1, 2),
            turning=np.array(self.turning[1:], dtype=bool),
            poses=self.poses,
        )

    def poses(self, positions: Float64[np.ndarray, "states joints"]) -> Poses:
        """Each part's motion from rest."""
        Ts = np.tile(np.eye(4), (len(positions), len(self.parent), 1, 1))
        for part in range(1, len(self.parent)):
            moved = np.tile(np.eye(4), (len(positions), 1, 1))
            axis, point, q = self.axis[part], self.point[part], positions[:, part - 1, None]
            if self.turning[part]:
                moved[:, :3, :3] = Rotation.from_rotvec(q * axis).as_matrix()
                moved[:, :3, 3] = point - moved[:, :3, :3] @ point
            else:
                moved[:, :3, 3] = q * axis
            Ts[:, part] = Ts[:, self.parent[part]] @ moved
        return Ts


def random_shape(rng: np.random.Generator) -> PosableShape:
    """Make a random shape: furniture, or a trunk with limbs."""
    return (furniture if rng.random() < FURNITURE_SHARE else creature)(rng).shape()


def creature(rng: np.random.Generator) -> Tree:
    """Make a trunk and limbs of primitive parts. Some limbs are repeated around the trunk or mirrored."""
    tree = Tree()
    size = rng.uniform(0.1, 0.35, 3)
    trunk = tree.add(_compound(size, rng))
    for _ in range(rng.integers(*LIMBS, endpoint=True)):
        first = len(tree.parent)
        _grow_limb(tree, trunk, rng)
        last = len(tree.parent)
        repeats = _repeats(rng) if rng.random() < REPEATED_SHARE else []
        for T in repeats[: max(0, (MOST_PARTS - last) // (last - first))]:
            _copy(tree, range(first, last), trunk, T)
    return tree


def _grow_limb(tree: Tree, trunk: int, rng: np.random.Generator) -> None:
    parent = trunk
    thickness = rng.uniform(0.03, 0.12)
    for _ in range(rng.integers(*LIMB_PARTS, endpoint=True)):
        on = tree.triangles[parent]
        centre = on.reshape(-1, 3).mean(axis=0)
        candidates = sample_triangles(on, 16, rng)[0]
        if parent != trunk:  # a limb continues at its far end
            reach = np.linalg.norm(candidates - tree.point[parent], axis=1)
            candidates = candidates[np.argsort(reach)[-4:]]
        point = candidates[rng.integers(len(candidates))]
        outwards = point - centre + 0.4 * np.linalg.norm(point - centre) * rng.normal(size=3)
        length = thickness * rng.uniform(0.8, 4.5)
        part = _compound(np.array([thickness, thickness * rng.uniform(0.5, 1.2), length]), rng)
        part = part + [0.0, 0.0, 0.45 * length]
        R = Rotation.align_vectors(outwards[None] / np.linalg.norm(outwards), [[0.0, 0.0, 1.0]])[0]
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R.as_matrix() @ Rotation.from_rotvec([0, 0, rng.uniform(0, 7)]).as_matrix(), point
        axis = T[:3, :3] @ np.eye(3)[rng.choice(3, p=(0.5, 0.25, 0.25))]
        turning = rng.random() >= PRISMATIC_SHARE
        if turning:
            width = np.radians(rng.uniform(*TURN_DEGREES))
        else:
            axis, width = T[:3, 2], length * rng.uniform(*SLIDE)
        least = -width * rng.uniform(0, 1)
        grown = tree.add(move(T, part), parent, axis, point, turning, (least, least + width))
        if rng.random() >= BRANCH_SHARE:
            parent = grown
        thickness *= rng.uniform(0.7, 1.1)


def _repeats(rng: np.random.Generator) -> list[Float64[np.ndarray, "4 4"]]:
    """The transforms of a limb's copies: one mirrored, or one to five turned about the trunk's z axis."""
    T = np.eye(4)
    if rng.random() < 0.6:
        T[0, 0] = -1.0
        return [T]
    count = rng.integers(2, 6, endpoint=True)
    repeats = np.tile(T, (int(count) - 1, 1, 1))
    repeats[:, :3, :3] = Rotation.from_rotvec(
        np.outer(np.arange(1, count) * 2 * np.pi / count, [0.0, 0.0, 1.0])
    ).as_matrix()
    return list(repeats)


def _copy(tree: Tree, parts: range, trunk: int, T: Float64[np.ndarray, "4 4"]) -> None:
    """Add a copy of a limb's parts, transformed by T."""
    shift = len(tree.parent) - parts.start
    for part in parts:
        parent = tree.parent[part]
        tree.add(
            move(T, tree.triangles[part]),
            parent if parent == trunk else parent + shift,
            T[:3, :3] @ tree.axis[part],
            T[:3, :3] @ tree.point[part] + T[:3, 3],
            tree.turning[part],
            tree.range[part],
        )


def _compound(size: Float64[np.ndarray, "3"], rng: np.random.Generator) -> Triangles:
    """One to three overlapping primitives at the origin, of about `size` together."""
    pieces = [_primitive(size, rng)]
    for _ in range(rng.choice(3, p=(0.45, 0.35, 0.2))):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("xyz", rng.choice(4, 3) * np.pi / 2).as_matrix()
        T[:3, 3] = rng.uniform(-0.5, 0.5, 3) * size
        pieces.append(move(T, _primitive(size * rng.uniform(0.25, 0.8, 3), rng)))
    return np.concatenate(pieces)


def _primitive(size: Float64[np.ndarray, "3"], rng: np.random.Generator) -> Triangles:
    """A box, a cylinder, a ball, a capsule or a body of revolution."""
    creation = import_extra("trimesh.creation")
    radius, height = size[:2].mean() / 2, size[2]
    kind = rng.choice(5, p=(0.3, 0.25, 0.1, 0.1, 0.25))
    if kind == 0:
        made = creation.box(size)
    elif kind == 1:
        made = creation.cylinder(radius, height, sections=20)
    elif kind == 2:
        made = creation.icosphere(subdivisions=2)
        made.apply_scale(size / 2)
    elif kind == 3:
        made = creation.capsule(height=height, radius=radius, count=(8, 16))
        made.apply_translation((0, 0, -made.bounds.mean(axis=0)[2]))
    else:
        levels = rng.integers(3, 6)
        outline = np.stack([radius * rng.uniform(0.4, 1.3, levels), np.linspace(-0.5, 0.5, levels) * height], axis=1)
        outline = np.concatenate([[[0, outline[0, 1]]], outline, [[0, outline[-1, 1]]]])
        made = creation.revolve(outline, sections=20)
    return np.asarray(made.triangles, dtype=np.float64)


def furniture(rng: np.random.Generator) -> Tree:
    """A box of boards with doors and drawers in its front, or with only a lid, like a chest or a laptop."""
    tree = Tree()
    width, depth, height = rng.uniform(0.3, 0.8), rng.uniform(0.1, 0.5), rng.uniform(0.15, 0.9)
    carcass = [
        _board((-width / 2, width / 2), (0, depth), (0, THICKNESS)),
        _board((-width / 2, width / 2), (depth - THICKNESS, depth), (0, height)),
        *(_board((x - THICKNESS / 2, x + THICKNESS / 2), (0, depth), (0, height)) for x in (-width / 2, width / 2)),
    ]
    lidded = rng.random() < 0.3
    if not lidded:
        carcass.append(_board((-width / 2, width / 2), (0, depth), (height - THICKNESS, height)))
    root = tree.add(np.concatenate(carcass))
    if lidded:
        lid = _board((-width / 2, width / 2), (0, depth), (height, height + THICKNESS * rng.uniform(1, 4)))
        opened = np.radians(rng.uniform(*TURN_DEGREES))
        tree.add(lid, root, np.array([-1.0, 0, 0]), np.array([0, depth, height]), True, (0.0, opened))
    columns, rows = rng.integers(1, 3, endpoint=True), rng.integers(1, 4, endpoint=True)
    xs, zs = np.linspace(-width / 2, width / 2, columns + 1), np.linspace(0, height, rows + 1)
    for column in range(columns):
        for row in range(rows):
            if not lidded or row + column == 0:
                _front(tree, root, (xs[column], xs[column + 1]), (zs[row], zs[row + 1]), depth, rng)
    return tree


def _front(
    tree: Tree, root: int, x: tuple[float, float], z: tuple[float, float], depth: float, rng: np.random.Generator
) -> None:
    """Add a door or a drawer that closes one cell of the front (y = 0)."""
    gap = 0.003
    panel = _board((x[0] + gap, x[1] - gap), (-THICKNESS, 0), (z[0] + gap, z[1] - gap))
    knob_x = rng.uniform(x[0] + 0.1 * (x[1] - x[0]), x[1] - 0.1 * (x[1] - x[0]))
    knob_z = rng.uniform(*z)
    knob = _board((knob_x - 0.01, knob_x + 0.01), (-0.05, -THICKNESS), (knob_z - 0.03, knob_z + 0.03))
    if rng.random() < 0.5:
        far = depth * rng.uniform(0.5, 0.9)
        sides = [
            _board((x[0] + gap, x[1] - gap), (0, far), (z[0] + gap, z[0] + gap + THICKNESS)),
            *(
                _board((edge, edge + THICKNESS), (0, far), (z[0] + gap, z[0] + 0.7 * (z[1] - z[0])))
                for edge in (x[0] + gap, x[1] - gap - THICKNESS)
            ),
        ]
        out = depth * rng.uniform(0.3, 0.8)
        tree.add(np.concatenate([panel, knob, *sides]), root, np.array([0, -1.0, 0]), np.zeros(3), False, (0.0, out))
        return
    left = rng.random() < 0.5
    hinge = np.array([x[0] if left else x[1], 0.0, 0.0])
    opened = np.radians(rng.uniform(*TURN_DEGREES))
    axis = np.array([0, 0, -1.0 if left else 1.0])
    tree.add(np.concatenate([panel, knob]), root, axis, hinge, True, (0.0, opened))


def _board(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Triangles:
    creation = import_extra("trimesh.creation")
    low, high = np.array([x, y, z]).T
    made = np.asarray(creation.box(high - low).triangles, dtype=np.float64)
    return made + (low + high) / 2
