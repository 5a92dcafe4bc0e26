from dataclasses import replace

import numpy as np
import pytest

from schemas.joints import PRISMATIC, REVOLUTE
from stages.final_fit.joint_types import hinge_at, try_hinges
from stages.final_fit.working import Fit


def as_slide(case):
    """The case with its hinge taken for a slide along the way that the lid's centre goes."""
    joint = case.chain.joint(0)
    p = case.frames.p[case.labels == joint.child]
    centres = np.einsum("tij,j->ti", case.chain.Ts[:, joint.child, :3, :3], p.mean(axis=0))
    way = centres + case.chain.Ts[:, joint.child, :3, 3] - p.mean(axis=0)
    axis = np.linalg.svd(way)[2][0]
    slide = replace(joint, kind=PRISMATIC, axis=axis, states=(way @ axis)[:, None])
    return Fit(case.chain.with_joints([slide]), case.labels)


def test_a_hinge_that_looked_like_a_slide_is_found(hinge_case):
    found = try_hinges(as_slide(hinge_case), hinge_case.frames, 20).chain
    assert found.tree.kinds == (REVOLUTE,)
    assert abs(found.tree.axis[0] @ hinge_case.chain.tree.axis[0]) > np.cos(np.radians(5))


def test_a_drawer_stays_a_slide(drawer_case):
    fit = Fit(drawer_case.chain, drawer_case.labels)
    assert try_hinges(fit, drawer_case.frames, 20).chain.tree.kinds == (PRISMATIC,)


def test_the_hinge_takes_the_centre_where_the_slide_does(drawer_case):
    joint = drawer_case.chain.joint(0)
    arm = 0.3 * np.cross(joint.axis, [1.0, 0.0, 0.0])
    hinge = hinge_at(np.zeros(3), arm, joint)
    assert hinge.axis @ joint.axis == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(np.tan(hinge.states) * np.linalg.norm(arm), joint.states, atol=1e-9)
