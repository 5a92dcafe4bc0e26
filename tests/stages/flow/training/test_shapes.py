import numpy as np
import pytest

from stages.flow.training.shapes import creature, furniture, random_shape


@pytest.mark.parametrize("make", [creature, furniture])
@pytest.mark.parametrize("seed", range(4))
def test_joints_move_their_own_part_and_what_hangs_on_it_rigidly(make, seed):
    tree = make(np.random.default_rng(seed))
    shape = tree.shape()
    assert shape.surface.part.max() + 1 == len(tree.parent) == len(shape.ranges) + 1
    np.testing.assert_array_equal(
        shape.poses(np.zeros((1, len(shape.ranges))))[0], np.tile(np.eye(4), (len(tree.parent), 1, 1))
    )
    joint = len(shape.ranges) // 2
    positions = np.zeros((1, len(shape.ranges)))
    positions[0, joint] = 0.3
    Ts = shape.poses(positions)[0]
    hanging = {joint + 1}
    for part in range(joint + 2, len(tree.parent)):
        if tree.parent[part] in hanging:
            hanging.add(part)
    for part, T in enumerate(Ts):
        assert np.allclose(T, np.eye(4)) == (part not in hanging)
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    # the joint's own axis, or what is on it, stays on its line
    point = tree.point[joint + 1]
    moved = Ts[joint + 1] @ [*point, 1.0]
    assert np.linalg.norm(moved[:3] - point) == pytest.approx(0.0 if shape.turning[joint] else 0.3, abs=1e-9)


def test_the_same_seed_gives_the_same_shape_and_another_one_another():
    first, again, other = (random_shape(np.random.default_rng(seed)).surface.triangles for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)
