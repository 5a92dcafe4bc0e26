import numpy as np
import pytest
from pydantic import ValidationError

from schemas.joints import REVOLUTE, SCREW, SPHERICAL


def refusal(model, **changes):
    with pytest.raises(ValidationError) as caught:
        model.replace(**changes)
    return str(caught.value)


def test_a_tree_is_walked_from_its_root(samples):
    model = samples["kinematic"]
    assert model.parents().tolist() == [-1, 0, 1]
    turned = model.replace(root=2, joint_parent=np.array([1, 2]), joint_child=np.array([0, 1]))
    assert turned.parents().tolist() == [1, 2, -1]


def test_a_single_part_has_no_joints(samples):
    model = samples["single_part"]
    assert (model.part_count, model.kinds, model.parents().tolist()) == (1, (), [-1])


def test_a_loop_is_refused(samples):
    model = samples["kinematic"]
    assert "close a loop" in refusal(model, joint_parent=np.array([2, 1]))


def test_a_part_with_two_joints_or_none_is_refused(samples):
    assert "exactly one joint" in refusal(samples["kinematic"], joint_child=np.array([1, 1]))
    assert "exactly one joint" in refusal(samples["kinematic"], root=1)


@pytest.mark.parametrize("labels", [[0, 1, 2, 3], [0, 1, 2, -1], []])
def test_labels_without_a_part_are_refused(samples, labels):
    assert "labels" in refusal(samples["kinematic"], labels=np.array(labels, dtype=np.int64))


@pytest.mark.parametrize(
    ("types", "expected"), [(("revolute", "screw"), 3), (("spherical", "prismatic"), 4), (("screw", "screw"), 4)]
)
def test_a_joint_moves_only_as_its_type_allows(samples, types, expected):
    """A state has as many numbers as the kinds of all joints say, no more and no less."""
    model = samples["kinematic"]
    assert f"found 2 columns, expected {expected}" in refusal(model, joint_types=types)
    assert "columns" in refusal(model, joint_types=types, states=np.zeros((3, expected + 1)))
    assert model.replace(joint_types=types, states=np.zeros((3, expected))).states.shape == (3, expected)


def test_screws_may_turn_and_slide(samples):
    model = samples["kinematic"].replace(joint_types=("screw", "screw"), states=np.ones((3, 4)))
    assert model.kinds == (SCREW, SCREW)
    assert model.states.all()


def test_each_joint_has_the_columns_of_its_own_states(samples):
    states = np.arange(18.0).reshape(3, 6)
    model = samples["kinematic"].replace(
        root=0,
        labels=np.array([0, 1, 2, 3]),
        Ts_frame_canonical=np.tile(np.eye(4), (3, 4, 1, 1)),
        joint_parent=np.array([0, 1, 1]),
        joint_child=np.array([1, 2, 3]),
        joint_types=("spherical", "revolute", "screw"),
        axis=np.tile([0.0, 0.0, 1.0], (3, 1)),
        point=np.zeros((3, 3)),
        states=states,
        e_spatial=np.zeros(3),
        e_1dof=np.zeros(3),
    )
    assert model.kinds == (SPHERICAL, REVOLUTE, SCREW)
    for joint, own in enumerate((slice(0, 3), slice(3, 4), slice(4, 6))):
        np.testing.assert_array_equal(model.states_of(joint), states[:, own])


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
    assert "joint_types" in refusal(samples["kinematic"], joint_types=("revolute", "helical"))
    assert "joint_types" in refusal(samples["kinematic"], joint_types=("revolute", "free"))
