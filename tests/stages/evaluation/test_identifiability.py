import numpy as np

from stages.evaluation.identifiability import observable_points
from stages.kernels.kinematics.tree import joint_transforms

FRAMES, POINTS, CANONICAL = 4, 3000, 1


def observable(turning_shape, axis: list[float], angles: np.ndarray) -> np.ndarray:
    """Whether each point is observable, of a slab that stands still and a shape on top of it that turns."""
    Ts = np.tile(np.eye(4), (FRAMES, 2, 1, 1))
    motions = np.outer(angles - angles[CANONICAL], [*axis, 0, 0, 0])
    Ts[:, 1] = joint_transforms(np.array([0.0, 0.0, 0.5]), motions)
    labels = np.repeat([0, 1], POINTS // 2)
    frames = []
    for t in range(FRAMES):
        rng = np.random.default_rng(t)
        slab = rng.uniform([-1, -1, 0], [1, 1, 0], (POINTS // 2, 3))
        shape = turning_shape(rng, POINTS // 2)
        frames.append(np.concatenate([slab, shape @ Ts[t, 1, :3, :3].T + Ts[t, 1, :3, 3]]))
    return observable_points(frames, [labels] * FRAMES, Ts, CANONICAL)


def tube(rng: np.random.Generator, count: int) -> np.ndarray:
    angle = rng.uniform(0, 2 * np.pi, count)
    return np.column_stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), rng.uniform(0.2, 1.0, count)])


ANGLES = np.array([-0.6, 0.0, 0.4, 0.9])


def test_a_tube_that_turns_about_its_own_axis_is_not_observable():
    assert observable(tube, [0.0, 0.0, 1.0], ANGLES)[POINTS // 2 :].mean() < 0.02


def test_the_same_tube_that_tumbles_is_observable_except_near_its_axis():
    tumbling = observable(tube, [1.0, 0.0, 0.0], ANGLES)
    assert tumbling[POINTS // 2 :].mean() > 0.8
    assert tumbling[: POINTS // 2].mean() > 0.8  # the slab would leave its place with the tube's motion


def test_parts_that_never_move_against_each_other_are_not_observable():
    assert not observable(tube, [1.0, 0.0, 0.0], np.zeros(FRAMES)).any()
