import numpy as np
import pytest

from schemas.joints import PRISMATIC, REVOLUTE, SPHERICAL
from stages.final_fit.consensus import consensus_joint
from stages.final_fit.working import best_joint

KINDS = [REVOLUTE, PRISMATIC]


def with_astray(case, astray):
    """The true motions, but for the moving part's in some frames: turned over, and somewhere else."""
    Ts = case.chain.Ts.copy()
    for t in astray:
        Ts[t, 1] = Ts[t, 1] @ np.diag([1.0, -1.0, -1.0, 1.0])
        Ts[t, 1, :3, 3] += [1.0, 2.0, 0.5]
    return Ts


def found(case, Ts, kinds=KINDS):
    return consensus_joint(kinds, 0, 1, case.labels, case.frames, Ts)


def test_the_joint_of_most_frames_is_found_and_its_states_in_the_others(two_parts):
    Ts, true = with_astray(two_parts, [4]), two_parts.chain.joint(0)
    joint = found(two_parts, Ts)
    assert joint is not None
    assert joint.kind == true.kind
    assert abs(joint.axis @ true.axis) > 0.9999
    sign = np.sign(joint.axis @ true.axis)
    np.testing.assert_allclose(sign * joint.states[:4], true.states[:4], atol=1e-6)
    assert abs(sign * joint.states[4] - true.states[4]) < np.pi / 36
    spoilt = best_joint(KINDS, 0, 1, two_parts.labels, two_parts.frames, Ts)
    assert abs(sign * spoilt.states[4, 0] - true.states[4, 0]) > 0.2 or abs(spoilt.axis @ true.axis) < 0.99


def test_the_parent_may_move(hinge_case):
    drift = np.tile(np.eye(4), (5, 1, 1))
    drift[:, 1, 3] = [0.4, -0.2, 0.0, 0.1, 0.3]
    moved = hinge_case.moved(drift)
    joint = found(moved, with_astray(moved, [4]))
    assert joint is not None
    true = hinge_case.chain.joint(0)
    sign = np.sign(joint.axis @ true.axis)
    np.testing.assert_allclose(sign * joint.states, true.states, atol=np.pi / 36)


def test_states_lie_about_the_middle_of_the_others(hinge_case):
    """A state is sought within half a turn of the others' middle, so that no range grows by a whole turn."""
    joint = found(hinge_case, with_astray(hinge_case, [4]))
    assert joint is not None
    assert np.ptp(joint.states) < np.pi


@pytest.mark.parametrize("astray", [[], [0, 1, 3, 4]])
def test_none_where_all_frames_agree_or_none_do(hinge_case, astray):
    assert found(hinge_case, with_astray(hinge_case, astray)) is None


def test_none_of_kinds_with_more_freedom(hinge_case):
    assert found(hinge_case, with_astray(hinge_case, [4]), [SPHERICAL]) is None
