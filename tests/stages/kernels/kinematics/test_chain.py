from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from stages.kernels.alignment.registration import NormalEquations, twist_jacobian
from stages.kernels.kinematics.articulation import Chain, _jacobians, _moved, fit_chain
from stages.kernels.motion import se3

FRAMES, CANONICAL, NOISE = 5, 1, 0.02
SHAPES = {  # parent, child, revolute
    "revolute": ([0], [1], [True]),
    "prismatic": ([0], [1], [False]),
    "nested": ([0, 1, 1, 3], [1, 2, 3, 4], [True, False, True, True]),
    "other numbers": ([2, 0], [0, 1], [False, True]),
}


def chain_of(shape, free_root=False, seed=0):
    rng = np.random.default_rng(seed)
    parent, child, revolute = (np.array(column) for column in SHAPES[shape])
    axis = rng.normal(size=(len(child), 3))
    states = rng.normal(scale=0.5, size=(len(child), FRAMES))
    states[:, CANONICAL] = 0
    twists = rng.normal(scale=0.3 * free_root, size=(FRAMES, 6))
    twists[CANONICAL] = 0
    return Chain(
        root=int(np.setdiff1d(parent, child)[0]),
        parent=parent,
        child=child,
        revolute=revolute,
        axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
        point=rng.normal(size=(len(child), 3)),
        states=states,
        T_frame_root=se3.exp(torch.from_numpy(twists)).numpy(),
        free_root=free_root,
    )


def disturbed(chain, size, seed=1):
    rng = np.random.default_rng(seed)
    axis = chain.axis + rng.normal(scale=size, size=chain.axis.shape)
    states = chain.states + rng.normal(scale=size, size=chain.states.shape)
    states[:, CANONICAL] = 0
    point = chain.point + rng.normal(scale=size, size=chain.point.shape)
    return replace(chain, axis=axis / np.linalg.norm(axis, axis=1, keepdims=True), point=point, states=states)


def points_of(chain, scale=1.0):
    return scale * np.random.default_rng(9).normal(size=(chain.parts, 12, 3))


def posed(Ts, p):
    return np.einsum("tkij,knj->tkni", Ts[..., :3, :3], p) + Ts[:, :, None, :3, 3]


def correspondences(p, target, noise=NOISE):
    """Plain least squares from every part's points (parts, points, 3) to where they were seen."""

    def linearise(Ts):
        moved = posed(Ts, p)
        centres = moved.mean(axis=2)
        jacobian = twist_jacobian((moved - centres[:, :, None]) / noise)
        offset = (moved - target) / noise
        hessian = np.einsum("tknia,tknib->tkab", jacobian, jacobian)
        return NormalEquations((offset**2).sum(), hessian, np.einsum("tknia,tkni->tka", jacobian, offset), centres)

    return linearise


@pytest.mark.parametrize("free_root", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_jacobians_are_those_of_finite_differences(shape, free_root):
    chain, step = chain_of(shape, free_root), 1e-6
    p, joints = points_of(chain), len(chain.child)
    there = posed(chain.Ts(), p)
    centres = there.mean(axis=2)
    arms = (there - centres[:, :, None]) / NOISE
    own, shared = _jacobians(chain, centres, NOISE)
    for jacobian, count in ((own, own.shape[-1]), (shared, 6 * joints)):
        for column in range(count):
            step_own, step_shared = np.zeros((FRAMES, own.shape[-1])), np.zeros(6 * joints)
            (step_own if jacobian is own else step_shared)[..., column] = step
            moved = posed(_moved(chain, step_own, step_shared.reshape(joints, 6), NOISE).Ts(), p)
            turn, slide = jacobian[:, :, None, :3, column], jacobian[:, :, None, 3:, column]
            np.testing.assert_allclose((moved - there) / step / NOISE, np.cross(turn, arms) + slide, atol=2e-3)


@pytest.mark.parametrize("free_root", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_disturbed_chain_finds_its_way_back(shape, free_root):
    true = chain_of(shape, free_root)
    p = points_of(true)
    start = replace(disturbed(true, 0.1), T_frame_root=np.tile(np.eye(4), (FRAMES, 1, 1)))
    fitted = fit_chain(start, correspondences(p, posed(true.Ts(), p)), CANONICAL, NOISE, 60)
    np.testing.assert_allclose(fitted.axis, true.axis, atol=1e-3)
    np.testing.assert_allclose(fitted.states, true.states, atol=1e-3)
    np.testing.assert_allclose(fitted.T_frame_root, true.T_frame_root, atol=1e-3)
    offsets = np.cross(fitted.point - true.point, true.axis)[true.revolute]
    np.testing.assert_allclose(offsets, 0, atol=2e-3)
    np.testing.assert_array_equal(fitted.states[:, CANONICAL], 0)
    np.testing.assert_allclose(np.linalg.norm(fitted.axis, axis=1), 1)


@pytest.mark.parametrize("seed", range(6))
def test_a_fit_never_ends_dearer_than_it_began(seed):
    true, start = chain_of("nested", True, seed), chain_of("nested", True, seed + 100)
    p = points_of(true)
    linearise = correspondences(p, posed(true.Ts(), p))
    costs = [linearise(fit_chain(start, linearise, CANONICAL, NOISE, n).Ts()).cost for n in (0, 1, 2, 5, 12)]
    assert costs[0] == linearise(start.Ts()).cost
    assert all(later <= earlier for earlier, later in pairwise(costs))
    assert costs[-1] < costs[0]


def test_the_unit_of_length_does_not_matter():
    answers = []
    for scale in (1.0, 1000.0):
        true = replace(chain_of("nested"), point=scale * chain_of("nested").point)
        lengths = np.where(true.revolute, 1.0, scale)[:, None]
        true, start = (replace(c, states=lengths * c.states) for c in (true, disturbed(true, 0.0)))
        start = replace(start, axis=disturbed(true, 0.1).axis)
        p = points_of(true, scale)
        linearise = correspondences(p, posed(true.Ts(), p), scale * NOISE)
        fitted = fit_chain(start, linearise, CANONICAL, scale * NOISE, 2)
        answers.append((fitted.axis, fitted.states / lengths, fitted.point / scale))
    for first, second in zip(*answers, strict=True):
        np.testing.assert_allclose(first, second, atol=1e-9)


def test_joints_taken_apart_and_put_together_make_the_same_chain():
    chain = chain_of("nested")
    again = chain.with_joints(chain.joints())
    np.testing.assert_array_equal(again.Ts(), chain.Ts())
    assert chain.with_joints([]).Ts().shape == (FRAMES, 1, 4, 4)
    np.testing.assert_array_equal(chain.parents(), [-1, 0, 1, 1, 3])
    expected = [[0, 1, 1, 1, 1], [0, 0, 1, 0, 0], [0, 0, 0, 1, 1], [0, 0, 0, 0, 1]]
    np.testing.assert_array_equal(chain.moves(), np.array(expected, dtype=bool))
