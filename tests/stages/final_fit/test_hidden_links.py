from dataclasses import replace

import numpy as np
import pytest

from schemas.joints import PRISMATIC, REVOLUTE
from stages.final_fit.hidden_links import add_freedom
from stages.final_fit.labelling import relabel
from stages.final_fit.working import Fit, relative_motions
from stages.kernels.alignment.registration import Registration
from stages.kernels.kinematics.chain import Joint
from stages.kernels.kinematics.closed_form import fit_joint
from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.motion.rigid_motion import move_points
from stages.projection.stage import part_samples

BODY, HOUSING, ARM = 0, 1, 2
PRICE = 10.0  # these objects have few points


@pytest.fixture(scope="module")
def unseen(housed):
    """What the relaxed fit makes of it: the housing is a piece of the body. Its tree, and the parts' free motions."""
    labels = np.array([0, 0, 1])[housed.labels]
    Ts = housed.chain.Ts[:, [BODY, ARM]]
    motions = relative_motions(Ts, np.array([0]), np.array([1]))
    fits = fit_joint([REVOLUTE, PRISMATIC], motions, part_samples(housed.frames.p, labels, 60)[[1]])
    return Fit(housed.chain.with_joints([Joint.of(fits.since(2), 0, 1, (0,))]), labels), Ts


def test_the_link_that_the_motion_needs_is_inserted(housed, unseen):
    fit = add_freedom(unseen[0], housed.frames, unseen[1], PRICE, PRICE)
    np.testing.assert_array_equal(fit.labels, unseen[0].labels)
    assert fit.chain.parts == 3
    np.testing.assert_array_equal(fit.chain.tree.parents, [-1, 2, 0])
    cosines = np.abs((fit.chain.tree.axis * housed.chain.tree.axis).sum(axis=1))
    assert cosines.min() > np.cos(np.radians(2))
    np.testing.assert_allclose(fit.chain.Ts[:, 1], housed.chain.Ts[:, ARM], atol=0.01)
    np.testing.assert_array_equal(fit.chain.states[2], 0)


def test_the_link_gets_the_points_around_its_joint(housed, unseen):
    fit = add_freedom(unseen[0], housed.frames, unseen[1], PRICE, PRICE)
    for _ in range(2):
        fit = housed.frames.refine(relabel(housed.frames.refine(fit, 8), housed.frames, 5, 1.5, 0.008), 8)
    found = np.array([BODY, ARM, HOUSING])[fit.labels]
    assert (found[housed.labels == HOUSING] == HOUSING).mean() > 0.9
    assert (found != housed.labels).mean() < 0.05
    cosines = np.abs((fit.chain.tree.axis * housed.chain.tree.axis).sum(axis=1))
    assert cosines.min() > np.cos(np.radians(4))


def test_nothing_is_inserted_where_one_joint_is_enough(two_parts):
    fit = add_freedom(two_parts.fit, two_parts.frames, two_parts.chain.Ts, PRICE, PRICE)
    assert fit.chain.parts == 2
    np.testing.assert_array_equal(fit.chain.tree.parents, [-1, 0])


def test_nothing_is_inserted_where_two_joints_do_not_explain_the_motion_either(hinge_case):
    rng = np.random.default_rng(0)
    Ts = hinge_case.chain.Ts.copy()
    twists = np.concatenate([rng.normal(scale=0.3, size=(5, 3)), rng.normal(scale=0.15, size=(5, 3))], axis=1)
    twists[2] = 0
    Ts[:, 1] = joint_transforms(np.zeros(3), twists)
    T_points = (Ts @ np.linalg.inv(hinge_case.chain.Ts))[:, hinge_case.labels]
    clouds = [move_points(T, p) for T, p in zip(T_points, hinge_case.frames.registration.frames, strict=True)]
    frames = replace(hinge_case.frames, registration=Registration(clouds, 2), p_all=clouds[2])
    single = frames.refine(hinge_case.fit, 8)
    costs = [frames.point_costs(hinge_case.labels, motions).sum() for motions in (single.chain.Ts, Ts)]
    assert costs[0] > 2 * costs[1]  # one joint is not enough either
    assert add_freedom(hinge_case.fit, frames, Ts, PRICE, PRICE).chain.parts == 2


def turning(point):
    """A rotation of the whole object about the z axis through `point`."""
    states = np.array([0.5, -0.3, 0.0, 0.4, -0.6])
    return joint_transforms(np.array(point), states[:, None] * [0, 0, 1, 0, 0, 0])


def test_a_root_that_turns_about_one_axis_hangs_on_a_still_base(hinge_case):
    moved = hinge_case.moved(turning([-0.5, 0.1, 0.0]))
    fit = add_freedom(moved.fit, moved.frames, moved.chain.Ts, PRICE, PRICE)
    chain = fit.chain
    assert (chain.parts, chain.tree.root, chain.tree.free_root) == (3, 2, False)
    np.testing.assert_array_equal(chain.tree.parents, [2, 0, -1])
    assert abs(chain.tree.axis[0, 2]) > np.cos(np.radians(1))
    np.testing.assert_allclose(chain.tree.point[0, :2], [-0.5, 0.1], atol=0.02)
    np.testing.assert_allclose(chain.Ts[:, :2], moved.chain.Ts, atol=0.02)
    np.testing.assert_array_equal(chain.Ts[:, 2], np.tile(np.eye(4), (5, 1, 1)))
    np.testing.assert_array_equal(chain.states[2], 0)


def test_a_root_that_moves_freely_hangs_on_nothing(hinge_case):
    Ts = turning([0.0, 0.0, 0.0])
    Ts[:, :3, 3] += np.array([[0.1, 0, 0], [0, 0.1, 0.1], [0, 0, 0], [0, -0.1, 0.1], [-0.1, 0, 0]])
    moved = hinge_case.moved(Ts)
    chain = add_freedom(moved.fit, moved.frames, moved.chain.Ts, PRICE, PRICE).chain
    assert (chain.parts, chain.tree.root, chain.tree.free_root) == (2, 0, True)
    np.testing.assert_allclose(chain.T_frame_root, Ts, atol=0.03)
