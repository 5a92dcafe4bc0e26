from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from schemas.joints import PRISMATIC, REVOLUTE, SCREW, SPHERICAL
from stages.kernels.alignment.registration import NormalEquations, twist_jacobian
from stages.kernels.kinematics.chain import Chain, Joint, _stepped, fit_chain, jacobians
from stages.kernels.kinematics.tree import KinematicTree, joint_transforms
from stages.kernels.motion.rigid_motion import rotations

FRAMES, CANONICAL, SPACING = 5, 1, 0.02
SHAPES = {  # parent, child, kinds
    "revolute": ([0], [1], [REVOLUTE]),
    "prismatic": ([0], [1], [PRISMATIC]),
    "ball": ([0], [1], [SPHERICAL]),
    "screw": ([0], [1], [SCREW]),
    "nested": ([0, 1, 1, 3], [1, 2, 3, 4], [REVOLUTE, PRISMATIC, REVOLUTE, REVOLUTE]),
    "nested balls": ([0, 1, 1, 3], [1, 2, 3, 4], [SPHERICAL, PRISMATIC, REVOLUTE, SPHERICAL]),
    "other numbers": ([2, 0], [0, 1], [PRISMATIC, REVOLUTE]),
}


def chain_of(shape, free_root=False, seed=0):
    rng = np.random.default_rng(seed)
    parent, child, kinds = SHAPES[shape]
    axis = rng.normal(size=(len(child), 3))
    tree = KinematicTree(
        kinds=tuple(kinds),
        parent=np.array(parent),
        child=np.array(child),
        axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
        point=rng.normal(size=(len(child), 3)),
        root=int(np.setdiff1d(parent, child)[0]),
        free_root=free_root,
    )
    scale = np.where(tree.joint < len(child), 0.5, 0.3)
    states = rng.normal(size=(FRAMES, tree.size)) * scale
    states[CANONICAL] = 0
    return Chain(tree, states)


def disturbed(chain, size, seed=1):
    """Axes, points and states of the joints moved; a free root stands still."""
    rng, tree = np.random.default_rng(seed), chain.tree
    axis = tree.axis + rng.normal(scale=size, size=tree.axis.shape)
    states = chain.states + rng.normal(scale=size, size=chain.states.shape)
    states[CANONICAL] = 0
    states[:, tree.joint == len(tree.child)] = 0
    point = tree.point + rng.normal(scale=size, size=tree.point.shape)
    return Chain(replace(tree, axis=axis / np.linalg.norm(axis, axis=1, keepdims=True), point=point), states)


def points_of(chain, scale=1.0):
    return scale * np.random.default_rng(9).normal(size=(chain.parts, 12, 3))


def posed(Ts, p):
    return np.einsum("tkij,knj->tkni", Ts[..., :3, :3], p) + Ts[:, :, None, :3, 3]


def correspondences(p, target, spacing=SPACING):
    """Plain least squares from every part's points (parts, points, 3) to where they were seen."""

    def linearise(Ts):
        moved = posed(Ts, p)
        centres = moved.mean(axis=2)
        jacobian = twist_jacobian((moved - centres[:, :, None]) / spacing)
        offset = (moved - target) / spacing
        hessian = np.einsum("tknia,tknib->tkab", jacobian, jacobian)
        return NormalEquations((offset**2).sum(), hessian, np.einsum("tknia,tkni->tka", jacobian, offset), centres)

    return linearise


@pytest.mark.parametrize("free_root", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_jacobians_are_those_of_finite_differences(shape, free_root):
    chain, step = chain_of(shape, free_root), 1e-6
    p, joints = points_of(chain), len(chain.tree.child)
    there = posed(chain.Ts, p)
    centres = there.mean(axis=2)
    arms = (there - centres[:, :, None]) / SPACING
    own, shared = jacobians(chain, centres, SPACING)
    assert own.shape[-1] == chain.tree.size
    assert shared.shape[-1] == 6 * joints
    for jacobian in (own, shared):
        for column in range(jacobian.shape[-1]):
            step_own, step_shared = np.zeros((FRAMES, own.shape[-1])), np.zeros(6 * joints)
            (step_own if jacobian is own else step_shared)[..., column] = step
            if jacobian is shared and column % 6 < 3 and not chain.tree.kinds[column // 6].has_axis:
                assert not jacobian[..., column].any()  # what has no direction is not turned
                continue
            moved = posed(_stepped(chain, step_own, step_shared.reshape(joints, 6), SPACING).Ts, p)
            turn, slide = jacobian[:, :, None, :3, column], jacobian[:, :, None, 3:, column]
            np.testing.assert_allclose((moved - there) / step / SPACING, np.cross(turn, arms) + slide, atol=2e-3)


@pytest.mark.parametrize("free_root", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_disturbed_chain_finds_its_way_back(shape, free_root):
    true = chain_of(shape, free_root)
    p = points_of(true)
    fitted = fit_chain(disturbed(true, 0.1), correspondences(p, posed(true.Ts, p)), CANONICAL, SPACING, 60)
    has_axis = np.array([kind.has_axis for kind in true.tree.kinds])
    turns = np.array([kind.turns != "none" for kind in true.tree.kinds])
    np.testing.assert_allclose(fitted.tree.axis[has_axis], true.tree.axis[has_axis], atol=1e-3)
    np.testing.assert_allclose(fitted.joint_states, true.joint_states, atol=1e-3)
    np.testing.assert_allclose(fitted.T_frame_root, true.T_frame_root, atol=1e-3)
    offsets = fitted.tree.point - true.tree.point
    np.testing.assert_allclose(np.cross(offsets, true.tree.axis)[turns & has_axis], 0, atol=2e-3)
    np.testing.assert_allclose(offsets[~has_axis], 0, atol=2e-3)
    np.testing.assert_array_equal(fitted.states[CANONICAL], 0)
    np.testing.assert_allclose(np.linalg.norm(fitted.tree.axis, axis=1), 1)


@pytest.mark.parametrize("shape", ["nested", "nested balls"])
@pytest.mark.parametrize("seed", range(6))
def test_a_fit_never_ends_dearer_than_it_began(seed, shape):
    true, start = chain_of(shape, True, seed), chain_of(shape, True, seed + 100)
    p = points_of(true)
    linearise = correspondences(p, posed(true.Ts, p))
    costs = [linearise(fit_chain(start, linearise, CANONICAL, SPACING, n).Ts).cost for n in (0, 1, 2, 5, 12)]
    assert costs[0] == linearise(start.Ts).cost
    assert all(later <= earlier for earlier, later in pairwise(costs))
    assert costs[-1] < costs[0]


@pytest.mark.parametrize("shape", ["nested", "nested balls"])
def test_the_unit_of_length_does_not_matter(shape):
    answers = []
    for scale in (1.0, 1000.0):
        one = chain_of(shape)
        lengths = one.tree.units(scale)
        true = Chain(replace(one.tree, point=scale * one.tree.point), lengths * one.states)
        start = Chain(replace(true.tree, axis=disturbed(true, 0.1).tree.axis), lengths * disturbed(one, 0.1).states)
        p = points_of(true, scale)
        linearise = correspondences(p, posed(true.Ts, p), scale * SPACING)
        fitted = fit_chain(start, linearise, CANONICAL, scale * SPACING, 2)
        answers.append((fitted.tree.axis, fitted.states / lengths, fitted.tree.point / scale))
    for first, second in zip(*answers, strict=True):
        np.testing.assert_allclose(first, second, atol=1e-9)


@pytest.mark.parametrize("free_root", [False, True])
def test_joints_taken_apart_and_put_together_make_the_same_chain(free_root):
    chain = chain_of("nested balls", free_root)
    again = chain.with_joints(chain.joints())
    np.testing.assert_allclose(again.Ts, chain.Ts, atol=1e-12 * free_root)  # to the last bit where the root is still
    np.testing.assert_array_equal(again.joint_states, chain.joint_states)
    assert chain.with_joints([]).Ts.shape == (FRAMES, 1, 4, 4)
    np.testing.assert_allclose(chain.with_joints([]).Ts[:, 0], chain.T_frame_root, atol=1e-12)
    np.testing.assert_array_equal(chain.tree.parents, [-1, 0, 1, 1, 3])
    expected = [[0, 1, 1, 1, 1], [0, 0, 1, 0, 0], [0, 0, 0, 1, 1], [0, 0, 0, 0, 1]]
    np.testing.assert_array_equal(chain.tree.moves, np.array(expected, dtype=bool))


def test_each_joint_has_its_own_states_and_a_root_that_is_not_free_stands_still():
    states = [np.arange(15.0).reshape(FRAMES, 3) / 10, np.arange(5.0)[:, None]]
    joints = [
        Joint(kind, k, k + 1, np.eye(3)[k], np.eye(3)[k], states[k]) for k, kind in enumerate((SPHERICAL, REVOLUTE))
    ]
    T_frame_root = joint_transforms(np.zeros(3), np.random.default_rng(0).normal(size=(FRAMES, 6)))
    still, free = (Chain.of(joints, 0, T_frame_root, free_root) for free_root in (False, True))
    for chain in (still, free):
        assert [joint.kind for joint in chain.joints()] == [SPHERICAL, REVOLUTE]
        for k in (0, 1):
            np.testing.assert_array_equal(chain.states_of(k), states[k])
            np.testing.assert_array_equal(chain.joint(k).states, states[k])
        np.testing.assert_array_equal(chain.joint_states, np.concatenate(states, axis=1))
    np.testing.assert_array_equal(still.T_frame_root, np.tile(np.eye(4), (FRAMES, 1, 1)))
    np.testing.assert_allclose(free.T_frame_root, T_frame_root, atol=1e-12)
    np.testing.assert_allclose(free.Ts, T_frame_root[:, None] @ still.Ts, atol=1e-12)
    np.testing.assert_allclose(still.Ts[:, 1, :3, :3], rotations(states[0]), atol=1e-12)
