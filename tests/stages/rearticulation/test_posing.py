import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.errors import InputError
from schemas.model_file import ModelFile, ModelJoint, ModelPart, Result
from stages.rearticulation.posing import pose_by_states, pose_by_targets

STILL = np.eye(4)


def motion(rotation_vector, translation):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(rotation_vector).as_matrix(), translation
    return T


def about(point, rotation_vector):
    T = motion(rotation_vector, point)
    T[:3, 3] -= T[:3, :3] @ point
    return T


POINTS = {"hinge": np.array([1000.0, 0, 0]), "ball": np.array([1100.0, 50, 0])}


def chain(states, T_frame_root):
    """Millimetres, far from the origin: part 0 - hinge about z - part 1 - ball - part 2; part 0 - slider y - part 3."""
    frames = len(states["hinge"])
    joints = []
    for index, (name, parent, child, kind, axis) in enumerate(
        [
            ("hinge", 0, 1, "revolute", (0, 0, 1)),
            ("ball", 1, 2, "spherical", (0, 0, 1)),
            ("slider", 0, 3, "prismatic", (0, 1, 0)),
        ]
    ):
        sizes = [np.linalg.norm(state) if kind == "spherical" else state for state in states[name]]
        joints.append(
            ModelJoint(
                id=index,
                name=name,
                parent=parent,
                child=child,
                type=kind,
                axis=axis,
                point=tuple(POINTS.get(name, (0, 0, 0))),
                lower=min(sizes),
                upper=max(sizes),
                states=tuple(states[name]),
            )
        )
    rng = np.random.default_rng(0)
    middles = np.array([[950.0, 0, 0], [1050, 20, 0], [1150, 60, 10], [900, 80, 0]])
    p = np.concatenate([middle + rng.uniform(-40, 40, size=(60, 3)) for middle in middles])
    result = Result(
        model=ModelFile(
            units="millimetre",
            frames=frames,
            canonical_frame=0,
            root=0,
            parts=tuple(ModelPart(id=i, name=f"part_{i}", point_count=60) for i in range(4)),
            joints=tuple(joints),
        ),
        canonical_points=p.astype(np.float32),
        labels=np.repeat(np.arange(4), 60),
        T_frame_canonical=np.tile(STILL, (frames, 4, 1, 1)),
    )
    Ts = [true_motions({name: states[name][t] for name in states}, T_frame_root[t]) for t in range(frames)]
    return result.replace(T_frame_canonical=np.stack(Ts))


def true_motions(states, T_root=STILL):
    hinge = T_root @ about(POINTS["hinge"], [0, 0, states["hinge"]])
    return np.stack(
        [
            T_root,
            hinge,
            hinge @ about(POINTS["ball"], states["ball"]),
            T_root @ motion([0, 0, 0], [0, states["slider"], 0]),
        ]
    )


def moved(Ts, p):
    return np.einsum("nij,nj->ni", Ts[:, :3, :3], p) + Ts[:, :3, 3]


@pytest.fixture
def model():
    return chain(
        {"hinge": [0, 0.8, -0.6], "ball": [(0, 0, 0), (0.3, 0.4, 0), (0, 0, 1)], "slider": [0, 30, -20]}, [STILL] * 3
    )


NEW = {"hinge": 2.0, "ball": (0.5, -0.7, 0.9), "slider": 45.0}


def source_of(model, every):
    p = model.canonical_points[::every].astype(np.float64)
    return p, model.labels[::every]


@pytest.mark.parametrize("every", [1, 15])
def test_targets_give_back_states_in_the_models_units(model, every):
    p_source, parts = source_of(model, every)
    posed = pose_by_targets(model, p_source, moved(true_motions(NEW)[parts], p_source))
    for name, state in NEW.items():
        assert posed.pose.states[name] == pytest.approx(state, abs=1e-6)
    np.testing.assert_allclose(posed.Ts_pose_canonical, true_motions(NEW), atol=1e-4)
    assert posed.pose.targets.rms < 1e-6
    assert len(posed.pose.targets.residuals) == len(p_source)
    assert posed.pose.T_pose_root == tuple(map(tuple, np.eye(4).tolist()))
    assert not posed.pose.undetermined


def test_states_put_the_parts_where_forward_kinematics_does(model):
    posed = pose_by_states(model, NEW, STILL, limits=False)
    np.testing.assert_allclose(posed.Ts_pose_canonical, true_motions(NEW), atol=1e-9)
    p, parts = source_of(model, 1)
    np.testing.assert_allclose(posed.points(model), moved(true_motions(NEW)[parts], p), atol=1e-9)
    base = motion([0.1, 0.2, 0.3], [5, 6, 7])
    np.testing.assert_allclose(
        pose_by_states(model, NEW, base, limits=False).Ts_pose_canonical, true_motions(NEW, base), atol=1e-9
    )


def test_joints_that_are_not_named_stay_as_in_the_canonical_frame(model):
    posed = pose_by_states(model, {"slider": 10}, STILL)
    assert posed.pose.states == {"hinge": 0, "ball": (0, 0, 0), "slider": 10}
    np.testing.assert_array_equal(posed.Ts_pose_canonical[:3], np.tile(STILL, (3, 1, 1)))


@pytest.mark.parametrize(
    ("states", "complaint"),
    [
        ({"elbow": 1.0}, "found the joint 'elbow', expected one of hinge, ball, slider"),
        ({"hinge": 0.81}, "joint hinge: found the state 0.81, expected one within its limits, -0.6 to 0.8"),
        ({"ball": (0.9, 0.9, 0.0)}, "joint ball: found a rotation by 1.27"),
        ({"slider": float("nan")}, "joint slider: found nan, expected finite"),
        ({"slider": 1e16}, "joint slider: found 1e.16, expected finite numbers up to 1e"),
        ({"ball": 1.0}, "joint ball: found 1.0, expected a rotation vector"),
        ({"hinge": (0.0, 0.0, 1.0)}, "expected one number"),
        ({"hinge": (0.5,)}, "expected one number"),
        ({"ball": (0.1, 0.2)}, "expected a rotation vector of three numbers"),
        ({"ball": ()}, "expected a rotation vector of three numbers"),
    ],
)
def test_states_that_a_joint_cannot_have_are_refused(model, states, complaint):
    with pytest.raises(InputError, match=complaint):
        pose_by_states(model, states, STILL)


def test_a_state_of_many_numbers_does_not_fill_the_screen_either(model):
    with pytest.raises(InputError) as caught:
        pose_by_states(model, {"ball": (0.1,) * 100_000}, STILL)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("states", [{"elbow": 1.0}, {"w" * 100_000: 1.0}, {"h" * 100_000: 9.0}, {"h" * 100_000: 1e16}])
def test_no_name_is_so_long_that_it_fills_the_screen(model, states):
    hinge, *others = model.model.joints
    joints = (hinge.model_copy(update={"name": "h" * 100_000}), *others)
    named = model.replace(model=model.model.model_copy(update={"joints": joints}))
    with pytest.raises(InputError) as caught:
        pose_by_states(named, states, STILL)
    assert len(str(caught.value)) < 400


def test_limits_are_kept_by_targets_where_asked_for(model):
    p_source, parts = source_of(model, 1)
    pose = pose_by_targets(model, p_source, moved(true_motions(NEW)[parts], p_source), limits=True).pose
    assert pose.states["hinge"] == 0.8
    assert pose.states["slider"] == 30
    assert np.linalg.norm(pose.states["ball"]) <= 1 + 1e-9
    assert {"hinge", "slider"} <= set(pose.at_limit)
    assert pose.targets.rms > 1
    pose_by_states(model, pose.states, STILL)  # what it found is within the limits


def test_joints_that_no_target_tells_are_named_and_stay_as_in_the_nearest_frame(model):
    p_source, parts = source_of(model, 1)
    told = parts < 2
    target = moved(model.T_frame_canonical[1, parts[told]], p_source[told])
    pose = pose_by_targets(model, p_source[told], target).pose
    assert pose.undetermined == ("ball", "slider")
    assert pose.states["hinge"] == pytest.approx(0.8)
    assert pose.states["slider"] == pytest.approx(30)
    assert pose.states["ball"] == pytest.approx((0.3, 0.4, 0))


@pytest.mark.parametrize("moving", [False, True])
def test_the_base_moves_where_it_moved_in_the_sequence_or_is_said_to(moving):
    roots = [STILL, motion([0, 0.2, 0], [10, 0, 0]) if moving else STILL]
    model = chain({"hinge": [0, 0.5], "ball": [(0, 0, 0), (0.1, 0, 0)], "slider": [0, 10]}, roots)
    base = motion([1.0, -0.5, 2.0], [300, -1000, 50])
    p_source, parts = source_of(model, 5)
    p_target = moved(true_motions(NEW, base)[parts], p_source)
    posed = pose_by_targets(model, p_source, p_target)
    assert (posed.pose.targets.rms < 1e-6) == moving
    freed = posed if moving else pose_by_targets(model, p_source, p_target, free_base=True)
    np.testing.assert_allclose(freed.pose.T_pose_root, base, atol=1e-3)
    assert freed.pose.states["hinge"] == pytest.approx(2.0, abs=1e-6)
    fixed = pose_by_targets(model, p_source, p_target, free_base=False)
    assert fixed.pose.T_pose_root == tuple(map(tuple, np.eye(4).tolist()))
    assert fixed.pose.targets.rms > 10


def test_a_base_that_too_few_targets_tell_is_named(model):
    p_source = model.canonical_points[:2].astype(np.float64)
    pose = pose_by_targets(model, p_source, p_source + [1, 0, 0], free_base=True).pose
    assert pose.base_undetermined
    assert set(pose.undetermined) == {"hinge", "ball", "slider"}


def test_a_source_point_off_the_object_is_named_by_its_row(model):
    p_source, _ = source_of(model, 10)
    p_source[7] += [0, 0, 200]
    with pytest.raises(InputError, match=r"row 8: found the source point .* off the object, expected one within"):
        pose_by_targets(model, p_source, p_source)
    p_source[9] += [0, 0, 200]
    with pytest.raises(InputError, match="and 1 other row"):
        pose_by_targets(model, p_source, p_source)


def test_an_angle_beyond_a_half_turn_is_the_one_nearest_to_the_observed_range():
    states = {"hinge": [0, 2.5, 5.0], "ball": [(0.0, 0.0, 0.0)] * 3, "slider": [0, 0, 0]}
    model = chain(states, [STILL] * 3)
    p_source, parts = source_of(model, 1)
    for hinge in (5.3, 4.0, -0.4):
        target = moved(true_motions(NEW | {"hinge": hinge})[parts], p_source)
        assert pose_by_targets(model, p_source, target).pose.states["hinge"] == pytest.approx(hinge)


def test_a_single_part_can_be_posed_by_its_base_only(model):
    lone = model.model.model_copy(update={"joints": (), "parts": model.model.parts[:1]})
    single = Result(
        model=lone,
        canonical_points=model.canonical_points[:60],
        labels=model.labels[:60],
        T_frame_canonical=model.T_frame_canonical[:, :1],
    )
    p_source, base = single.canonical_points.astype(np.float64), motion([0, 0, 1], [1, 2, 3])
    pose = pose_by_targets(single, p_source, moved(base[None], p_source), free_base=True).pose
    np.testing.assert_allclose(pose.T_pose_root, base, atol=1e-4)
    with pytest.raises(InputError, match="none at all"):
        pose_by_states(single, {"hinge": 0.0}, STILL)


def test_a_target_out_of_all_reach_is_named_by_its_row(model):
    p_source, _ = source_of(model, 10)
    p_target = p_source.copy()
    p_target[3] *= 1e6
    p_target[5] = 1e300
    with pytest.raises(InputError, match=r"row 4: found the target .* \(and 1 other rows\), expected one within"):
        pose_by_targets(model, p_source, p_target)


def test_far_away_states_and_targets_pose_as_near_the_origin(near_and_far, away):
    (_, near), (_, far) = near_and_far
    [joint] = near.model.joints
    states, root = {joint.name: joint.states[-1]}, STILL
    p_near, p_far = (pose_by_states(result, states, root).points(result) for result in (near, far))
    np.testing.assert_allclose(p_far - away, p_near, rtol=0, atol=1e-7)  # which 32 bits hold of the near points
    moved_far = far.T_frame_canonical[-1, far.labels]
    target = moved(moved_far, far.canonical_points)
    found = pose_by_targets(far, far.canonical_points[::5], target[::5])
    assert found.pose.states[joint.name] == pytest.approx(joint.states[-1], abs=1e-6)
    np.testing.assert_allclose(found.points(far), target, rtol=0, atol=1e-7)
    again = pose_by_states(far, found.pose.states, np.array(found.pose.T_pose_root), limits=False)
    np.testing.assert_allclose(again.points(far), target, rtol=0, atol=1e-7)


def test_a_point_far_away_is_told_with_all_its_digits(near_and_far):
    far = near_and_far[1][1]
    p = far.canonical_points[:1] + [0, 0.5, 0]
    with pytest.raises(InputError, match=r"source point \(694386\.\d+, 5155487\.\d+, "):
        pose_by_targets(far, p, p)
