from dataclasses import replace

import numpy as np
import pytest

from schemas.joints import PRISMATIC, REVOLUTE
from schemas.kinematic import CONFIDENCES
from stages.final_fit.confidence import joint_confidence
from stages.final_fit.working import Fit
from stages.kernels.kinematics.chain import Chain, Joint

PRICE = 30.0
PART, LINK, TYPE = (CONFIDENCES.index(name) for name in ("part", "link", "type"))


def confidence(case, fit=None):
    found = joint_confidence(fit or case.fit, case.frames, PRICE)
    assert np.all((found >= 0) & (found <= 1))
    return found


def with_joint(case, index, **changes):
    joints = case.chain.joints()
    joints[index] = replace(joints[index], **changes)
    return Fit(case.chain.with_joints(joints), case.labels)


def test_the_true_joints_are_sure(two_parts, housed):
    assert confidence(two_parts).min() > 0.9
    assert confidence(housed).min() > 0.9  # though the housing's own points look alike however it turns


def test_a_part_that_moves_like_its_parent_is_not_one_of_its_own(housed):
    """The end of the arm, cut off; the arm itself remains as sure as it was."""
    end = (housed.labels == 2) & (housed.frames.p[:, 0] > 0.45)
    arm = housed.chain.joint(1)
    rest = Joint(REVOLUTE, 2, 3, arm.axis, arm.point, 0 * arm.states)
    chain = housed.chain.with_joints([housed.chain.joint(0), arm, rest])
    whole, cut = confidence(housed), confidence(housed, Fit(chain, np.where(end, 3, housed.labels)))
    assert cut[2, PART] < 0.05
    assert cut[2, TYPE] < 0.05  # what does not move turns and slides alike
    assert cut[1, PART] > 0.9 * whole[1, PART]


def test_where_the_smaller_piece_carries_the_rest_neither_of_its_joints_is_sure(housed):
    """The arm's near end hangs on the housing, and all else of the arm on that: only one of three joints is there."""
    start = (housed.labels == 2) & (housed.frames.p[:, 0] < 0.25)
    arm = housed.chain.joint(1)
    rest = Joint(REVOLUTE, 3, 2, arm.axis, arm.point, 0 * arm.states)
    chain = housed.chain.with_joints([housed.chain.joint(0), replace(arm, child=3), rest])
    assert np.all(confidence(housed, Fit(chain, np.where(start, 3, housed.labels)))[1:, PART] < 0.05)


def test_a_joint_of_the_wrong_type_is_not_sure_of_it(hinge_case):
    """A slide in the hinge's place: turning would cost less."""
    states = 0.1 * hinge_case.chain.joint(0).states
    wrong = with_joint(hinge_case, 0, kind=PRISMATIC, states=states)
    assert confidence(hinge_case, wrong)[0, LINK] < 0.2  # nor of one degree of freedom
    assert confidence(hinge_case)[0, TYPE] > 0.9


def test_a_joint_against_the_frames_is_not_sure_of_its_link(housed):
    """The arm turns about a wrong axis; let go, its points move to where they were seen."""
    tilted = np.array([0.3, 0.9, 0.3]) / np.linalg.norm([0.3, 0.9, 0.3])
    right, wrong = confidence(housed), confidence(housed, with_joint(housed, 1, axis=tilted))
    assert wrong[1, LINK] < 0.5 * right[1, LINK]


def test_a_parent_that_another_part_could_be_as_well_is_not_sure(housed):
    """The housing turns too little to tell whether the arm hangs on it or on the body."""
    housing = housed.chain.joint(0)
    still = [replace(housing, states=0 * housing.states), housed.chain.joint(1)]
    fit = Fit(housed.chain.with_joints(still), housed.labels)
    assert confidence(housed, fit)[1, LINK] < 0.5 * confidence(housed)[1, LINK]


def test_numbers_do_not_depend_on_the_unit_or_where_the_object_is(hinge_case, monkeypatch):
    moved = hinge_case.moved(np.tile([[0, -1, 0, 3.0], [1, 0, 0, -2], [0, 0, 1, 1], [0, 0, 0, 1]], (5, 1, 1)))
    R, t = moved.chain.T_frame_root[0, :3, :3], moved.chain.T_frame_root[0, :3, 3]
    tree = hinge_case.chain.tree
    chain = Chain(replace(tree, axis=tree.axis @ R.T, point=tree.point @ R.T + t), hinge_case.chain.states)
    np.testing.assert_allclose(confidence(moved, Fit(chain, moved.labels)), confidence(hinge_case), atol=1e-3)


def test_one_part_has_no_joints_and_a_part_without_points_no_confidence(hinge_case):
    single = hinge_case.chain.with_joints([])
    assert confidence(hinge_case, Fit(single, 0 * hinge_case.labels)).shape == (0, 3)
    unseen = confidence(hinge_case, Fit(hinge_case.chain, 0 * hinge_case.labels))
    assert unseen[0, PART] == unseen[0, TYPE] == 0


@pytest.mark.parametrize("price", [0.0, 1e6])
def test_the_price_is_the_scale_and_without_one_there_is_a_usual_one(hinge_case, price):
    found = joint_confidence(hinge_case.fit, hinge_case.frames, price)[0]
    assert (found[PART] > 0.9) == (found[TYPE] > 0.9) == (price == 0)


def test_where_digits_are_lost_nothing_is_sure(two_parts):
    """Steps of many spacings explain any cost; those of less than one leave what is plain."""
    sure, blurred, lost = (
        joint_confidence(two_parts.fit, two_parts.frames, PRICE, coarseness) for coarseness in (0.0, 0.6, 30.0)
    )
    np.testing.assert_array_equal(sure, confidence(two_parts))
    assert np.all(blurred <= sure)
    assert blurred[0, PART] > 0.9
    assert lost.max() < 0.5
