from __future__ import annotations

import hashlib
import io
import json
import zipfile

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.assessment import Assessment, Evidence, Spread, Verdict
from schemas.joints import JOINT_KINDS
from schemas.kinematic import KinematicModel
from schemas.model_file import ModelFile
from schemas.sequence import PointSequence
from stages.kernels.kinematics.chain import Chain, Joint
from stages.result.stage import compute_result, result_files

FRAMES, CANONICAL, POINTS = 6, 2, 40
PARENT, CHILD = np.array([2, 2, 0]), np.array([0, 1, 3])
TYPES = ("revolute", "prismatic", "revolute")


def input_frames() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [(rng.uniform(-60, 140, (POINTS + t, 3)) + [1000, 0, -300]).astype(np.float32) for t in range(FRAMES)]


def sequence() -> PointSequence:
    frames, scale, centre = [frame.astype(np.float64) for frame in input_frames()], 346.41, (1040.0, 40.0, -260.0)
    return PointSequence(
        points=(np.concatenate(frames) - centre) / scale,
        point_counts=np.array([len(frame) for frame in frames]),
        dropped_counts=np.zeros(FRAMES, dtype=np.int64),
        scale=scale,
        centre=centre,
        units="millimetre",
        frame_names=tuple(f"frame_{t}" for t in range(FRAMES)),
    )


def model() -> KinematicModel:
    rng = np.random.default_rng(1)
    axis = rng.normal(size=(3, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    point = rng.uniform(-0.3, 0.3, (3, 3))
    point -= axis * (axis * point).sum(1, keepdims=True)
    states = rng.uniform(-1, 1, (3, FRAMES)).T
    states[CANONICAL] = 0
    T_frame_root = np.tile(np.eye(4), (FRAMES, 1, 1))
    T_frame_root[:, :3, :3] = Rotation.from_rotvec(np.linspace(-0.4, 0.6, FRAMES)[:, None] * [0, 1, 0]).as_matrix()
    T_frame_root[:, :3, 3] = np.linspace(-0.4, 0.6, FRAMES)[:, None] * [0.1, 0, 0.2]
    joints = [Joint(JOINT_KINDS[TYPES[j]], PARENT[j], CHILD[j], axis[j], point[j], states[:, [j]]) for j in range(3)]
    Ts = Chain.of(joints, 2, T_frame_root, free_root=True).Ts
    return KinematicModel(
        canonical_frame=CANONICAL,
        root=2,
        labels=np.arange(POINTS + CANONICAL) % 4,
        Ts_frame_canonical=Ts,
        joint_parent=PARENT,
        joint_child=CHILD,
        joint_types=TYPES,
        axis=axis,
        point=point,
        states=states,
        e_spatial=np.zeros(3),
        e_1dof=np.zeros(3),
        energies={},
    )


def loaded(files: dict[str, bytes]) -> tuple[dict, dict[str, np.ndarray]]:
    with np.load(io.BytesIO(files["model.npz"])) as arrays:
        return json.loads(files["model.json"]), dict(arrays)


def unsealed(model: ModelFile) -> ModelFile:
    return model.model_copy(update={"json_sha256": None, "npz_sha256": None})


def test_forward_kinematics_of_model_json_moves_the_points_as_model_npz_says() -> None:
    description, arrays = loaded(result_files(compute_result(model(), sequence())))
    p, labels, Ts = arrays["canonical_points"].astype(np.float64), arrays["labels"], arrays["T_frame_canonical"]
    joint_of = {joint["child"]: joint for joint in description["joints"]}
    for t in range(description["frames"]):
        moved = p.copy()
        for i, label in enumerate(labels):
            part = int(label)
            while part != description["root"]:
                joint = joint_of[part]
                axis, point, state = np.array(joint["axis"]), np.array(joint["point"]), joint["states"][t]
                if joint["type"] == "revolute":
                    moved[i] = point + Rotation.from_rotvec(state * axis).apply(moved[i] - point)
                else:
                    moved[i] += state * axis
                part = joint["parent"]
            T_frame_root = Ts[t, description["root"]]
            moved[i] = T_frame_root[:3, :3] @ moved[i] + T_frame_root[:3, 3]
        expected = np.einsum("nij,nj->ni", Ts[t, labels, :3, :3], p) + Ts[t, labels][:, :3, 3]
        np.testing.assert_allclose(moved, expected, atol=1e-8)


def test_transforms_in_input_units_move_points_as_the_normalised_ones_do() -> None:
    fitted, observed = model(), sequence()
    p_normalised = observed.frames()[CANONICAL]
    Ts = compute_result(fitted, observed).T_frame_canonical
    for t in range(FRAMES):
        T_normalised, T_input = fitted.Ts_frame_canonical[t, 1], Ts[t, 1]
        expected = observed.to_input(p_normalised @ T_normalised[:3, :3].T + T_normalised[:3, 3])
        found = observed.to_input(p_normalised) @ T_input[:3, :3].T + T_input[:3, 3]
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_canonical_points_are_the_input_points_bit_for_bit() -> None:
    _, arrays = loaded(result_files(compute_result(model(), sequence())))
    assert arrays["canonical_points"].dtype == np.float32
    np.testing.assert_array_equal(arrays["canonical_points"], input_frames()[CANONICAL])
    np.testing.assert_array_equal(arrays["labels"], model().labels)


def test_what_is_known_of_a_models_worth_is_in_the_inputs_units() -> None:
    spreads = (Spread(direction=0.02, place=0.01), Spread(direction=0.03), Spread(direction=0.04, place=0.5))
    evidence = Evidence(excess=np.ones(FRAMES), unexplained=np.zeros(FRAMES), firmness=np.ones(4), open_share=0.0)
    verdict = Verdict(trust="doubtful", reasons=("the weightiest", "another"))
    assessment = Assessment(spreads=spreads, evidence=evidence, verdict=verdict)
    description, _ = loaded(result_files(compute_result(model(), sequence(), assessment)))
    assert description["verdict"] == {"trust": "doubtful", "reasons": ["the weightiest", "another"]}
    assert [joint["spread"] for joint in description["joints"]] == [
        {"direction": 0.02, "place": pytest.approx(3.4641)},
        {"direction": 0.03},
        {"direction": 0.04, "place": pytest.approx(173.205)},
    ]


def test_the_header_and_parts_tell_what_the_model_is() -> None:
    files = result_files(compute_result(model(), sequence()))
    description, _ = loaded(files)
    header = {key: value for key, value in description.items() if key not in ("parts", "joints")}
    assert header == {
        "format": "rearticulate/model",
        "version": 1,
        "json_sha256": header["json_sha256"],
        "npz_sha256": hashlib.sha256(files["model.npz"]).hexdigest(),
        "units": "millimetre",
        "frames": FRAMES,
        "canonical_frame": CANONICAL,
        "root": 2,
    }
    blank = files["model.json"].replace(header["json_sha256"].encode(), b"0" * 64)
    assert hashlib.sha256(blank).hexdigest() == header["json_sha256"]
    assert description["parts"] == [
        {"id": part, "name": f"part_{part}", "point_count": count} for part, count in enumerate((11, 11, 10, 10))
    ]


def test_joints_have_limits_from_the_observed_states_in_input_units() -> None:
    fitted, observed = model(), sequence()
    description, _ = loaded(result_files(compute_result(fitted, observed)))
    assert [joint["name"] for joint in description["joints"]] == ["joint_2_0", "joint_2_1", "joint_0_3"]
    for joint, (kind, unit) in enumerate([("revolute", 1.0), ("prismatic", observed.scale), ("revolute", 1.0)]):
        found = description["joints"][joint]
        assert set(found) == {"id", "name", "parent", "child", "type", "axis", "point", "lower", "upper", "states"}
        assert (found["id"], found["parent"], found["child"]) == (joint, PARENT[joint], CHILD[joint])
        assert found["type"] == kind
        assert found["states"] == (fitted.states[:, joint] * unit).tolist()
        assert (found["lower"], found["upper"]) == (min(found["states"]), max(found["states"]))
        assert found["axis"] == fitted.axis[joint].tolist()
        offset = observed.to_input(fitted.point[joint]) - found["point"]
        np.testing.assert_allclose(np.cross(found["axis"], offset), 0, atol=1e-9)  # the same axis


def test_joints_tell_their_confidence_where_the_fit_does() -> None:
    confidence = np.arange(9).reshape(3, 3) / 10
    result = compute_result(model().replace(confidence=confidence), sequence())
    description, _ = loaded(result_files(result))
    assert description["joints"][1]["confidence"] == {"part": 0.3, "link": 0.4, "type": 0.5}
    assert unsealed(ModelFile.model_validate(description)) == result.model


def test_model_json_reads_back_to_the_same_model() -> None:
    result = compute_result(model(), sequence())
    read = ModelFile.model_validate_json(result_files(result)["model.json"])
    assert unsealed(read) == result.model
    assert read.digest == result.model.digest  # which poses of it name


def test_files_are_the_same_bytes_whenever_written() -> None:
    files = result_files(compute_result(model(), sequence()))
    assert files == result_files(compute_result(model(), sequence()))
    with zipfile.ZipFile(io.BytesIO(files["model.npz"])) as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert archive.namelist() == ["canonical_points.npy", "labels.npy", "T_frame_canonical.npy"]


def test_screw_joints_are_refused() -> None:
    states = np.insert(model().states, 1, 0.0, axis=1)
    undecided = model().replace(joint_types=("revolute", "screw", "revolute"), states=states)
    with pytest.raises(ValueError, match=r"joints \[1\] are screws"):
        compute_result(undecided, sequence())


def test_a_ball_joint_has_rotation_vectors_and_limits_of_their_length() -> None:
    turns = np.random.default_rng(2).normal(scale=0.5, size=(FRAMES, 3))
    turns[CANONICAL] = 0
    states = np.concatenate([model().states[:, :1], turns, model().states[:, 2:]], axis=1)
    fitted = model().replace(joint_types=("revolute", "spherical", "revolute"), states=states)
    ball = compute_result(fitted, sequence()).model.joints[1]
    assert (ball.type, ball.states) == ("spherical", tuple(map(tuple, turns.tolist())))
    assert (ball.lower, ball.upper) == (0.0, pytest.approx(np.linalg.norm(turns, axis=1).max()))
    np.testing.assert_allclose(ball.point, sequence().to_input(fitted.point[1]))  # and not moved along the axis
