import json

import pytest
from pydantic import ValidationError

from schemas.joints import REVOLUTE, SPHERICAL
from schemas.model_file import ModelFile, ModelPart


def test_model_json_survives_and_keeps_its_contract(samples):
    model = samples["result"].model
    text = model.model_dump_json()
    assert ModelFile.model_validate_json(text) == model
    content = json.loads(text)
    assert (content["format"], content["version"]) == ("rearticulate/model", 1)
    assert list(content) == [
        "format", "version", "json_sha256", "npz_sha256", "units", "frames", "canonical_frame", "root",
        "verdict", "parts", "joints",
    ]  # fmt: skip
    assert list(content["parts"][0]) == ["id", "name", "point_count"]
    assert list(content["joints"][0]) == [
        "id", "name", "parent", "child", "type", "axis", "point", "lower", "upper", "confidence", "spread",
        "states",
    ]  # fmt: skip


def test_confidence_is_optional_and_between_none_and_all(samples):
    content = json.loads(samples["result"].model.model_dump_json())
    del content["joints"][0]["confidence"]  # as in files of earlier releases
    assert ModelFile.model_validate(content) == samples["result"].model
    content["joints"][0]["confidence"] = {"part": 0.0, "link": 0.25, "type": 1.0}
    assert ModelFile.model_validate(content).joints[0].confidence.link == 0.25
    content["joints"][0]["confidence"]["part"] = 1.5
    with pytest.raises(ValidationError):
        ModelFile.model_validate(content)


@pytest.mark.parametrize(
    "change", [{"version": 3}, {"format": "other"}, {"frames": 0}, {"units": "inch"}, {"extra": 1}]
)
def test_other_formats_are_refused(samples, change):
    content = json.loads(samples["result"].model.model_dump_json())
    with pytest.raises(ValidationError):
        ModelFile.model_validate(content | change)


def test_states_are_numbers_or_rotation_vectors(samples):
    content = json.loads(samples["result"].model.model_dump_json())
    for states in ([0.0, 0.1, 0.2], [[0.0, 0.1, 0.2]] * 3):
        content["joints"][0]["states"] = states
        content["joints"][0]["type"] = "spherical" if isinstance(states[0], list) else "revolute"
        assert json.loads(ModelFile.model_validate(content).model_dump_json())["joints"][0]["states"] == states
    content["joints"][0]["states"] = [[0.0, 0.1]] * 3
    with pytest.raises(ValidationError):
        ModelFile.model_validate(content)


def chain(links):
    """Four parts with these (parent, child) joints."""
    joint = {"type": "revolute", "axis": [0, 0, 1], "point": [0, 0, 0], "lower": 0, "upper": 1, "states": [0, 1]}
    return {
        "units": "metre",
        "frames": 2,
        "canonical_frame": 0,
        "root": 0,
        "parts": [{"id": i, "name": f"part_{i}", "point_count": 1} for i in range(4)],
        "joints": [{"id": i, "name": f"j{i}", "parent": a, "child": b, **joint} for i, (a, b) in enumerate(links)],
    }


def test_joints_come_after_those_that_they_hang_on():
    order = ModelFile.model_validate(chain([(3, 1), (0, 2), (2, 3)])).joints_from_root()
    assert [(joint.parent, joint.child) for joint in order] == [(0, 2), (2, 3), (3, 1)]


@pytest.mark.parametrize(
    "links",
    [
        [(1, 2), (2, 3), (3, 1)],  # a cycle
        [(0, 1), (1, 0), (2, 3)],
        [(0, 1), (0, 2), (1, 2)],  # two parents
        [(0, 1), (0, 2)],  # a part that hangs on nothing
        [(0, 1), (0, 2), (0, 7)],
        [(0, 1), (0, 2), (-1, 3)],
    ],
)
def test_joints_that_are_no_tree_are_refused(links):
    with pytest.raises(ValidationError, match="cycle"):
        ModelFile.model_validate(chain(links))


BALL = {"type": "spherical", "states": [[0, 0, 0], [0, 0.6, 0.8]]}


def test_limits_of_a_ball_joint_are_of_the_length_of_its_rotation_vectors():
    content = chain([(0, 1), (1, 2), (2, 3)])
    content["joints"][0] |= BALL
    ball, hinge, _ = ModelFile.model_validate(content).joints
    assert (ball.kind, hinge.kind) == (SPHERICAL, REVOLUTE)
    assert [ball.sizes(state) for state in ball.states] == [(0.0,), (1.0,)]
    assert [hinge.sizes(state) for state in hinge.states] == [(0.0,), (1.0,)]
    assert ball.ranges("m") == hinge.ranges("m") == [(0.0, 1.0, "rad")]
    assert hinge.model_copy(update={"type": "prismatic"}).ranges("m") == [(0.0, 1.0, "m")]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"name": "j1"}, "'j1' twice or empty"),
        ({"name": ""}, "twice or empty"),
        ({"states": [0]}, "joint j0: found 1 states, expected one for each of 2"),
        ({"states": [0, float("nan")]}, "joint j0: states: found NaN"),
        ({"states": [0, [0, 0, 0]]}, "joint j0: states: expected 1 numbers each, since it is revolute"),
        ({"states": [[0], [1]]}, "joint j0: states: expected 1 numbers each"),
        ({"states": [[], []]}, "joint j0: states: expected 1 numbers each"),
        ({"lower": [0]}, "joint j0: limits: expected 1 numbers each, since it is revolute"),
        ({"upper": [0, 1]}, "joint j0: limits: expected 1 numbers each, since it is revolute"),
        ({"type": "spherical"}, "joint j0: states: expected 3 numbers"),
        ({"type": "helical"}, "expected one of revolute, prismatic, spherical"),
        ({"type": "screw"}, "expected one of revolute"),
        (BALL | {"states": [[0, 0, 0], [0, 1]]}, "joint j0: states: expected 3 numbers each, since it is spherical"),
        (BALL | {"states": [[0, 0, 0], [0, 1, float("nan")]]}, "joint j0: states: found NaN"),
        (BALL | {"lower": [0, 0, 0]}, "joint j0: limits: expected 1 numbers each, since it is spherical"),
        (BALL | {"lower": [-1, -1, -1], "upper": [1, 1, 1]}, "joint j0: limits: expected 1 numbers each"),
        (BALL | {"upper": [1]}, "joint j0: limits: expected 1 numbers each"),
        (BALL | {"lower": 2}, "joint j0: found limits 2.0 to 1.0"),
        ({"axis": [0, 0, 2]}, "joint j0: found axis"),
        ({"point": [0, 0, float("inf")]}, "joint j0: found axis"),
        ({"lower": 2}, "joint j0: found limits 2.0 to 1.0"),
        ({"upper": float("nan")}, "joint j0: found limits"),
    ],
)
def test_a_joint_that_contradicts_itself_or_the_model_is_refused(change, complaint):
    content = chain([(0, 1), (1, 2), (2, 3)])
    content["joints"][0] |= change
    with pytest.raises(ValidationError, match=complaint):
        ModelFile.model_validate(content)


@pytest.mark.parametrize("change", [{"root": 4}, {"canonical_frame": 2}, {"parts": []}])
def test_a_model_that_contradicts_itself_is_refused(change):
    with pytest.raises(ValidationError):
        ModelFile.model_validate(chain([(0, 1), (1, 2), (2, 3)]) | change)


@pytest.mark.parametrize(
    ("where", "change", "complaint"),
    [
        ("joints", {"name": "a\nb"}, "expected printable characters"),
        ("parts", {"name": "a\x00"}, "expected printable characters"),
        ("joints", {"point": [1e300, 0, 0]}, "joint j0: found a number of size 1e+300, expected at most 1e+15"),
        ("joints", {"states": [0, -1e200]}, "joint j0: found a number of size 1e+200"),
        ("joints", {"axis": [1e300, 0, 0]}, "expected a unit axis"),
    ],
)
def test_numbers_and_names_that_nothing_can_be_done_with_are_refused(where, change, complaint):
    content = chain([(0, 1), (0, 2), (2, 3)])
    content[where][0].update(change)
    with pytest.raises(ValidationError) as caught:
        ModelFile.model_validate(content)
    assert complaint in str(caught.value)


def test_a_digest_tells_models_apart():
    models = [chain([(0, 1), (0, 2), (2, 3)]) for _ in range(3)]
    models[2]["joints"][0]["upper"] = 2
    same, again, other = (ModelFile.model_validate(model).digest for model in models)
    assert same == again != other


def test_a_digest_does_not_change_with_what_is_known_of_the_models_worth():
    """Poses of models of earlier releases stay theirs."""
    plain = ModelFile.model_validate(chain([(0, 1), (0, 2), (2, 3)]))
    told = chain([(0, 1), (0, 2), (2, 3)]) | {"verdict": {"trust": "good", "reasons": []}}
    told["joints"][0]["spread"] = {"direction": 0.01, "place": 0.2}
    assert ModelFile.model_validate(told).digest == plain.digest


@pytest.mark.parametrize("spread", [{"direction": -0.1}, {"place": float("nan")}, {"axis": 0.1}])
def test_spreads_are_not_negative_and_known_by_name(spread):
    content = chain([(0, 1), (0, 2), (2, 3)])
    content["joints"][0]["spread"] = spread
    with pytest.raises(ValidationError):
        ModelFile.model_validate(content)


def test_a_part_has_no_fewer_points_than_none():
    with pytest.raises(ValidationError, match="greater than or equal to 0"):
        ModelPart(id=0, name="part_0", point_count=-5)
