import numpy as np
import pytest
from pydantic import ValidationError


def refusal(model, **changes):
    with pytest.raises(ValidationError) as caught:
        model.replace(**changes)
    return str(caught.value)


def test_a_tree_is_walked_from_its_root(samples):
    model = samples["kinematic"]
    assert model.parents().tolist() == [-1, 0, 1]
    assert model.joints_from_root() == [0, 1]
    turned = model.replace(root=2, joint_parent=np.array([1, 2]), joint_child=np.array([0, 1]))
    assert turned.joints_from_root() == [1, 0]


def test_a_single_part_has_no_joints(samples):
    model = samples["single_part"]
    assert (model.part_count, model.joints_from_root(), model.parents().tolist()) == (1, [], [-1])


def test_a_loop_is_refused(samples):
    model = samples["kinematic"]
    assert "close a loop" in refusal(model, joint_parent=np.array([2, 1]))


def test_a_part_with_two_joints_or_none_is_refused(samples):
    assert "exactly one joint" in refusal(samples["kinematic"], joint_child=np.array([1, 1]))
    assert "exactly one joint" in refusal(samples["kinematic"], root=1)


@pytest.mark.parametrize("labels", [[0, 1, 2, 3], [0, 1, 2, -1], []])
def test_labels_without_a_part_are_refused(samples, labels):
    assert "labels" in refusal(samples["kinematic"], labels=np.array(labels, dtype=np.int64))


@pytest.mark.parametrize("types", [("prismatic", "prismatic"), ("revolute", "revolute")])
def test_a_joint_moves_only_as_its_type_allows(samples, types):
    assert "must be zero" in refusal(samples["kinematic"], joint_types=types)


def test_screws_may_turn_and_slide(samples):
    model = samples["kinematic"].replace(joint_types=("screw", "screw"), states=np.ones((2, 3, 2)))
    assert model.states.all()


def test_confidence_is_told_of_every_joint_between_none_and_all(samples):
    model = samples["kinematic"]
    assert model.confidence is None
    assert model.replace(confidence=np.array([[0.0, 0.5, 1.0]] * 2)).confidence[1, 2] == 1
    assert "joints = 2" in refusal(model, confidence=np.ones((1, 3)))
    assert "(joints, 3)" in refusal(model, confidence=np.ones((2, 2)))
    for value in (-0.1, 1.1):
        assert "0..1" in refusal(model, confidence=np.full((2, 3), value))


def test_every_joint_has_a_type_that_is_known(samples):
    assert "joint_types" in refusal(samples["kinematic"], joint_types=("revolute",))
    assert "joint_types" in refusal(samples["kinematic"], joint_types=("revolute", "spherical"))
