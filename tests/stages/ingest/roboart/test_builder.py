from __future__ import annotations

import numpy as np
import pytest
import trimesh
import yourdfpy
from scipy.spatial.transform import Rotation

from schemas.config import DepthConfig, RoboartConfig
from schemas.errors import InputError
from stages.ingest.roboart import build_from_urdf, builder
from stages.ingest.roboart.descriptions import robot_description
from stages.ingest.roboart.urdf import read_urdf
from stages.kernels.kinematics.tree import joint_transforms

CONFIG = RoboartConfig(points=600)


@pytest.fixture
def recorded(monkeypatch):
    """The joint positions that the builder chose, which its output tells only relative to frame 0."""
    calls = []
    choose = builder.joint_motion

    def record(*arguments):
        calls.append(choose(*arguments))
        return calls[-1]

    monkeypatch.setattr(builder, "joint_motion", record)
    return calls


def moved(Ts, labels, points):
    return np.einsum("nij,nj->ni", Ts[labels, :3, :3], points) + Ts[labels, :3, 3]


def posed_triangles(path, mesh_dirs, positions):
    """World triangles of each link's visuals, by yourdfpy alone."""
    robot = yourdfpy.URDF.load(
        str(path), filename_handler=lambda fname: fname.replace("package://", f"{mesh_dirs[0]}/")
    )
    robot.update_cfg(positions)
    found = {}
    for node in robot.scene.graph.nodes_geometry:
        T, geometry = robot.scene.graph[node]
        link = robot.scene.graph.transforms.parents[node]
        while link not in robot.link_map:
            link = robot.scene.graph.transforms.parents[link]
        triangles = robot.scene.geometry[geometry].triangles @ T[:3, :3].T + T[:3, 3]
        found.setdefault(link, []).append(triangles)
    return {link: np.concatenate(pieces) for link, pieces in found.items()}


def distances(points, triangles):
    pairs_t = np.repeat(triangles[None], len(points), axis=0).reshape(-1, 3, 3)
    pairs_p = np.repeat(points, len(triangles), axis=0)
    # in millimetres, as trimesh takes a triangle of less than about 1e-6 square units for a point
    nearest = trimesh.triangles.closest_point(1e3 * pairs_t, 1e3 * pairs_p) / 1e3
    return np.linalg.norm(nearest - pairs_p, axis=1).reshape(len(points), -1).min(axis=1)


def assert_on_surface(path, mesh_dirs, positions, parts, points, labels, tolerance=1e-6):
    triangles = posed_triangles(path, mesh_dirs, positions)
    for part, links in enumerate(parts):
        surface = np.concatenate([triangles[link] for link in links if link in triangles])
        assert distances(points[labels == part], surface).max() < tolerance


def links_by_part(robot, moving):
    """The names of the links that no moving joint parts from one another."""
    part = {0: 0}
    for joint in robot.joints:
        part[joint.child] = 1 + moving.index(joint.name) if joint.name in moving else part[joint.parent]
    return [[robot.links[link] for link in part if part[link] == index] for index in range(len(moving) + 1)]


ARM_PARTS = [["base"], ["upper", "button"], ["fore"], ["slide"], ["flag"]]


def test_the_arm_comes_out_as_its_visible_parts_and_joints(arm):
    _, truth, _ = build_from_urdf(arm, (), CONFIG, np.random.default_rng(0))
    assert truth.part_names == ("base", "upper", "fore", "slide", "flag")
    assert truth.parent.tolist() == [-1, 0, 1, 2, 0]
    assert [(j.name, j.parent, j.child, j.type) for j in truth.joints] == [
        ("shoulder", 0, 1, "revolute"),
        ("elbow", 1, 2, "revolute"),
        ("rail", 2, 3, "prismatic"),
        ("echo", 0, 4, "revolute"),
    ]


def test_shapes_are_as_the_configuration_asks(arm):
    config = RoboartConfig(frames=4, points=50, novel_states=2)
    frames, truth, _ = build_from_urdf(arm, (), config, np.random.default_rng(0))
    assert [frame.shape for frame in frames] == [(50, 3)] * 4
    assert [labels.shape for labels in truth.labels] == [(50,)] * 4
    assert all(labels.dtype == np.int64 for labels in (*truth.labels, truth.parent))
    assert truth.Ts_frame_first.shape == (4, 5, 4, 4)
    assert truth.Ts_novel_first.shape == (2, 5, 4, 4)
    none = build_from_urdf(arm, (), RoboartConfig(novel_states=0), np.random.default_rng(0))[1]
    assert none.Ts_novel_first.shape == (0, 5, 4, 4)


def test_every_frame_lies_on_the_surface_that_yourdfpy_poses(arm, recorded):
    frames, truth, _ = build_from_urdf(arm, (), CONFIG, np.random.default_rng(3))
    names = [joint.name for joint in read_urdf(arm).joints]
    for positions, points, labels in zip(recorded[0][0], frames, truth.labels, strict=True):
        assert_on_surface(arm, (), dict(zip(names, positions, strict=True)), ARM_PARTS, points, labels)


def test_frame_0_moved_by_the_true_motions_lies_on_every_other_frame_and_unseen_state(arm, recorded):
    frames, truth, _ = build_from_urdf(arm, (), CONFIG, np.random.default_rng(4))
    names = [joint.name for joint in read_urdf(arm).joints]
    swept, unseen = recorded[0]
    for positions, Ts in [
        *zip(swept, truth.Ts_frame_first, strict=True),
        *zip(unseen, truth.Ts_novel_first, strict=True),
    ]:
        points = moved(Ts, truth.labels[0], frames[0])
        assert_on_surface(arm, (), dict(zip(names, positions, strict=True)), ARM_PARTS, points, truth.labels[0])


def assert_screws_reproduce_motions(truth):
    for joint in truth.joints:
        axis, still = np.array(joint.axis), np.zeros(3)
        motion = np.concatenate([still, axis] if joint.type == "prismatic" else [axis, still])
        Ts_joint = joint_transforms(np.array(joint.point), np.outer(joint.states, motion))
        Ts = truth.Ts_frame_first
        assert joint.states[0] == 0
        np.testing.assert_allclose(Ts[:, joint.parent] @ Ts_joint, Ts[:, joint.child], atol=1e-9)


def test_each_joints_screw_carries_the_parents_motion_to_the_childs(arm):
    assert_screws_reproduce_motions(build_from_urdf(arm, (), CONFIG, np.random.default_rng(5))[1])


def test_states_are_drawn_over_the_whole_range_one_frame_independently_of_the_other(arm, recorded):
    config = RoboartConfig(points=32, motion="states", frames=40, novel_states=0)
    frames, truth, _ = build_from_urdf(arm, (), config, np.random.default_rng(0))
    joints = {joint.name: joint for joint in read_urdf(arm).joints}
    position = dict(zip(joints, recorded[0][0].T, strict=True))
    for name, low, high in (("shoulder", 0.3, 2.2), ("elbow", -np.pi / 2, np.pi / 2), ("rail", -0.3, -0.1)):
        assert low <= position[name].min() < low + 0.15 * (high - low)
        assert high - 0.15 * (high - low) < position[name].max() <= high
        steps = np.diff(position[name])
        assert np.mean(np.sign(steps[1:]) != np.sign(steps[:-1])) > 0.4  # of a sweep 0 or 1 of 38
    assert abs(np.corrcoef(position["shoulder"], position["elbow"])[0, 1]) < 0.4
    np.testing.assert_allclose(position["echo"], 0.6 - 0.5 * position["shoulder"])
    assert_screws_reproduce_motions(truth)
    assert len(frames) == 40


def test_shuffled_frames_are_the_ordered_ones_in_another_order_and_motions_start_from_the_new_frame_0(arm):
    ordered, of_ordered, _ = build_from_urdf(arm, (), CONFIG, np.random.default_rng(1))
    config = RoboartConfig(points=600, shuffled=True)
    shuffled, truth, _ = build_from_urdf(arm, (), config, np.random.default_rng(1))
    order = [next(t for t, frame in enumerate(ordered) if np.array_equal(frame, mixed)) for mixed in shuffled]
    assert sorted(order) == list(range(10)) != order
    for labels, t in zip(truth.labels, order, strict=True):
        np.testing.assert_array_equal(labels, of_ordered.labels[t])
    Ts_ordered = of_ordered.Ts_frame_first
    expected = Ts_ordered[order] @ np.linalg.inv(Ts_ordered[order[0]])
    np.testing.assert_allclose(truth.Ts_frame_first, expected, atol=1e-12)
    assert_screws_reproduce_motions(truth)


def placement(here, there):
    """The rigid motion that takes points to the same points elsewhere."""
    centre, centre_there = here.mean(axis=0), there.mean(axis=0)
    turn = Rotation.align_vectors(there - centre_there, here - centre)[0].as_matrix()
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn, centre_there - turn @ centre
    return T


@pytest.mark.parametrize("coordinates", ["upright", "any"])
def test_frames_with_coordinates_of_their_own_are_the_shared_ones_elsewhere_and_so_is_the_truth(arm, coordinates):
    shared, of_shared, _ = build_from_urdf(arm, (), CONFIG, np.random.default_rng(2))
    config = RoboartConfig(points=600, coordinates=coordinates)
    frames, truth, _ = build_from_urdf(arm, (), config, np.random.default_rng(2))
    Ts_own = np.stack([placement(here, there) for here, there in zip(shared, frames, strict=True)])
    for T, here, there in zip(Ts_own, shared, frames, strict=True):
        np.testing.assert_allclose(here @ T[:3, :3].T + T[:3, 3], there, atol=1e-9)
    expected = Ts_own[:, None] @ of_shared.Ts_frame_first @ np.linalg.inv(Ts_own[0])
    np.testing.assert_allclose(truth.Ts_frame_first, expected, atol=1e-9)
    unseen = Ts_own[0] @ of_shared.Ts_novel_first @ np.linalg.inv(Ts_own[0])
    np.testing.assert_allclose(truth.Ts_novel_first, unseen, atol=1e-9)  # in frame 0's coordinates
    assert_screws_reproduce_motions(truth)
    assert (of_shared.own_coordinates, truth.own_coordinates) == (False, True)
    tilts = np.degrees(np.arccos(np.clip(Ts_own[:, 2, 2], -1, 1)))
    headings = np.degrees(np.arctan2(Ts_own[:, 1, 0], Ts_own[:, 0, 0]))
    if coordinates == "upright":
        assert 0.5 < tilts.max() <= 5
        assert np.ptp(headings) > 180
    else:
        assert np.ptp(tilts) > 60
    diagonal = np.linalg.norm(np.ptp(np.concatenate(shared), axis=0))
    away = np.abs([there.mean(axis=0) - here.mean(axis=0) for here, there in zip(shared, frames, strict=True)])
    assert 0.3 * diagonal < away.max() < 1.5 * diagonal


PERFECT = DepthConfig(cameras=1, width=160, height=120, quantisation_percent=0, flying_share=0)


def test_pixels_of_a_perfect_depth_camera_lie_on_the_posed_surface(arm, recorded):
    config = RoboartConfig(points=300, depth=PERFECT)
    frames, truth, viewpoints = build_from_urdf(arm, (), config, np.random.default_rng(0))
    names = [joint.name for joint in read_urdf(arm).joints]
    assert viewpoints is None
    for index in (0, 9):
        position = dict(zip(names, recorded[0][0][index], strict=True))
        assert_on_surface(arm, (), position, ARM_PARTS, frames[index], truth.labels[index], tolerance=1e-5)


@pytest.mark.parametrize("moving", [False, True])
def test_known_viewpoints_are_told_in_the_coordinates_of_each_frame(arm, moving):
    options = {"points": 200, "viewpoints": 3, "known_viewpoints": True, "moving_viewpoints": moving, "frames": 4}
    shared, _, standing = build_from_urdf(arm, (), RoboartConfig(**options), np.random.default_rng(0))
    config = RoboartConfig(**options, coordinates="any")
    frames, _, viewpoints = build_from_urdf(arm, (), config, np.random.default_rng(0))
    assert viewpoints.shape == standing.shape == (4, 3, 3)
    assert np.array_equal(standing[0], standing[3]) != moving
    for t in range(4):
        T = placement(shared[t], frames[t])
        np.testing.assert_allclose(standing[t] @ T[:3, :3].T + T[:3, 3], viewpoints[t], atol=1e-9)


def test_a_depth_camera_stands_where_it_sees_most_of_the_parts(urdf):
    path = urdf.write(
        urdf.link("base", urdf.box("0.1 4 4")),
        urdf.link("lid", urdf.box("0.5 0.5 0.05")),
        urdf.joint("hinge", "revolute", "base", "lid", urdf.moves("0 1 0", -0.3, 0.3), "0.4 0 0"),
    )
    config = RoboartConfig(points=100, frames=3, novel_states=0, known_viewpoints=True, depth=PERFECT)
    sides = [build_from_urdf(path, (), config, np.random.default_rng(seed))[2][0, 0, 0] > 0 for seed in range(5)]
    assert all(sides)


def test_the_base_stands_still(arm):
    truth = build_from_urdf(arm, (), CONFIG, np.random.default_rng(0))[1]
    np.testing.assert_allclose(truth.Ts_frame_first[:, 0], np.tile(np.eye(4), (10, 1, 1)), atol=1e-15)


def test_limits_are_kept_mimic_joints_follow_and_held_joints_rest(arm, recorded):
    names = [joint.name for joint in read_urdf(arm).joints]
    for seed in range(5):
        build_from_urdf(arm, (), CONFIG, np.random.default_rng(seed))
        position = dict(zip(names, np.concatenate(recorded[-1]).T, strict=True))
        assert position["shoulder"].min() >= 0.3
        assert position["shoulder"].max() <= 2.5
        assert position["rail"].min() >= -0.3
        assert position["rail"].max() <= -0.1
        assert position["echo"].min() >= -0.5
        np.testing.assert_allclose(position["echo"], 0.6 - 0.5 * position["shoulder"])
        np.testing.assert_array_equal(position["press"], 0.0)


def as_bytes(built):
    frames, truth, _ = built
    arrays = [*frames, *truth.labels, truth.Ts_frame_first, truth.Ts_novel_first, truth.parent]
    return [array.tobytes() for array in arrays], truth.part_names, truth.joints


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(arm):
    first, again, other = (
        as_bytes(build_from_urdf(arm, (), CONFIG, np.random.default_rng(seed))) for seed in (0, 0, 1)
    )
    assert first == again
    assert not set(first[0][:10]) & set(other[0][:10])


def test_frames_are_sampled_independently(arm):
    frames, truth, _ = build_from_urdf(arm, (), CONFIG, np.random.default_rng(0))
    assert not np.isin(frames[0][truth.labels[0] == 0], frames[1][truth.labels[1] == 0]).all(axis=1).any()


def in_first_base(Ts, points):
    """Points of a frame where the base was in frame 0."""
    return (points - Ts[0, :3, 3]) @ Ts[0, :3, :3]


def turn_degrees(Ts):
    cosine = (np.trace(Ts[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def test_a_free_base_carries_the_whole_robot_smoothly(arm, recorded):
    config = RoboartConfig(points=600, free_base=True)
    frames, truth, _ = build_from_urdf(arm, (), config, np.random.default_rng(3))
    names = [joint.name for joint in read_urdf(arm).joints]
    swept, unseen = recorded[0]
    Ts_base = truth.Ts_frame_first[:, 0]
    np.testing.assert_allclose(Ts_base[0], np.eye(4), atol=1e-12)
    turns = turn_degrees(np.linalg.inv(Ts_base[:-1]) @ Ts_base[1:])
    assert turns.min() > 0.1
    assert turns.max() < 3 * turns.mean()
    assert 20 <= turn_degrees(Ts_base)[-1] <= 40
    for index in (4, 9):
        points = in_first_base(truth.Ts_frame_first[index], frames[index])
        position = dict(zip(names, swept[index], strict=True))
        assert_on_surface(arm, (), position, ARM_PARTS, points, truth.labels[index])
    points = in_first_base(truth.Ts_novel_first[0], moved(truth.Ts_novel_first[0], truth.labels[0], frames[0]))
    position = dict(zip(names, unseen[0], strict=True))
    assert_on_surface(arm, (), position, ARM_PARTS, points, truth.labels[0])
    assert_screws_reproduce_motions(truth)


def test_noise_is_independent_and_a_share_of_the_diagonal_and_spares_the_truth(arm):
    clean, truth, _ = build_from_urdf(arm, (), RoboartConfig(points=2000), np.random.default_rng(0))
    noisy, same, _ = build_from_urdf(arm, (), RoboartConfig(points=2000, noise_percent=0.3), np.random.default_rng(0))
    diagonal = np.linalg.norm(np.ptp(clean[0], axis=0))
    noise = np.array(noisy) - np.array(clean)
    np.testing.assert_allclose(noise.std(axis=(0, 1)), 0.003 * diagonal, rtol=0.03)
    assert np.abs(noise.mean(axis=(0, 1))).max() < 1e-4 * diagonal
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.05
    np.testing.assert_array_equal(same.Ts_frame_first, truth.Ts_frame_first)
    np.testing.assert_array_equal(same.labels, truth.labels)


def test_partial_views_keep_count_labels_and_surface_and_lose_the_underside(arm, recorded):
    config = RoboartConfig(points=300, viewpoints=2)
    frames, truth, _ = build_from_urdf(arm, (), config, np.random.default_rng(0))
    whole, _, _ = build_from_urdf(arm, (), RoboartConfig(points=300), np.random.default_rng(0))
    assert [frame.shape for frame in frames] == [(300, 3)] * 10
    names = [joint.name for joint in read_urdf(arm).joints]
    for index in (0, 9):
        position = dict(zip(names, recorded[0][0][index], strict=True))
        assert_on_surface(arm, (), position, ARM_PARTS, frames[index], truth.labels[index])
    floor = min(frame[:, 2].min() for frame in whole)  # the base's box stands on it
    under = [np.mean([(np.abs(p[:, 2] - floor) < 1e-6).mean() for p in each]) for each in (whole, frames)]
    assert under[0] > 0.05
    assert under[1] < 0.01 * under[0]


@pytest.mark.parametrize(
    "options",
    [
        {"viewpoints": 2},
        {"viewpoints": 2, "moving_viewpoints": True},
        {"noise_percent": 0.3},
        {"free_base": True},
        {"motion": "states"},
        {"shuffled": True},
        {"coordinates": "upright"},
        {"depth": DepthConfig(cameras=2, width=80, height=60)},
    ],
)
def test_harder_sequences_are_as_reproducible(arm, options):
    config = RoboartConfig(points=100, frames=3, **options)
    first, again, other = (
        as_bytes(build_from_urdf(arm, (), config, np.random.default_rng(seed))) for seed in (0, 0, 1)
    )
    assert first == again
    assert not set(first[0][:3]) & set(other[0][:3])


def seen_faces(urdf, **options):
    """Which of a box's vertical faces each frame shows, as seen from one viewpoint."""
    path = urdf.write(
        urdf.link("base", urdf.box("1 1 1")),
        urdf.link("lid", urdf.box("0.2 0.2 0.01")),
        urdf.joint("hinge", "revolute", "base", "lid", urdf.moves("0 0 1", -1, 1), "0 0 0.6"),
    )
    config = RoboartConfig(points=200, viewpoints=1, frames=6, **options)
    frames, _, _ = build_from_urdf(path, (), config, np.random.default_rng(0))
    directions = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    return [tuple((p[:, :2] @ directions.T > 0.5 - 1e-6).any(axis=0)) for p in frames]


def test_viewpoints_stand_still_or_are_drawn_anew_for_each_frame(urdf):
    assert len(set(seen_faces(urdf))) == 1
    assert len(set(seen_faces(urdf, moving_viewpoints=True))) > 2


@pytest.mark.parametrize("motion", ["sweep", "states"])
def test_a_motion_that_strikes_another_part_is_avoided(urdf, monkeypatch, motion):
    path = urdf.write(
        urdf.link("base", urdf.box("0.4 0.4 0.4"), urdf.box("0.5 0.3 0.4", "0.6 0.6 0")),
        urdf.link("arm", urdf.box("1.2 0.1 0.1", "0.6 0 0")),
        urdf.joint("hinge", "continuous", "base", "arm", '<axis xyz="0 0 1"/>'),
    )

    config = RoboartConfig(points=600, motion=motion)

    def deepest(seed):
        frames, truth, _ = build_from_urdf(path, (), config, np.random.default_rng(seed))
        points = np.concatenate([p[labels == 1] for p, labels in zip(frames, truth.labels, strict=True)])
        return (np.array([0.25, 0.15, 0.2]) - np.abs(points - [0.6, 0.6, 0])).min(axis=1).max()

    assert max(deepest(seed) for seed in range(8)) < 0.05
    monkeypatch.setattr(builder, "penetration_score", lambda *arguments: lambda Ts: 0.0)
    assert max(deepest(seed) for seed in range(8)) > 0.05


@pytest.mark.parametrize("links", ["a", "ab"])
def test_a_robot_that_cannot_move_is_refused(urdf, links):
    welds = [urdf.joint("weld", "fixed", *links)] if len(links) == 2 else []
    path = urdf.write(*(urdf.link(link, urdf.box("1 1 1")) for link in links), *welds)
    with pytest.raises(InputError, match="no joint that moves a visible part"):
        build_from_urdf(path, (), CONFIG, np.random.default_rng(0))


def test_a_missing_mesh_is_refused_by_name(urdf):
    path = urdf.write(urdf.link("a", urdf.shape('<mesh filename="package://pack/lost.stl"/>')))
    with pytest.raises(InputError, match=r"package://pack/lost\.stl"):
        build_from_urdf(path, (urdf.folder,), CONFIG, np.random.default_rng(0))


@pytest.mark.parametrize(("name", "parts"), [("bolt", 7), ("ur5", 7)])
def test_a_real_robots_frames_lie_on_its_posed_meshes(name, parts, recorded):
    found = robot_description(name)
    path, mesh_dirs = found.urdf_path, found.mesh_dirs
    frames, truth, _ = build_from_urdf(path, mesh_dirs, RoboartConfig(points=60), np.random.default_rng(0))
    robot = read_urdf(path)
    names = [joint.name for joint in robot.joints]
    members = links_by_part(robot, [joint.name for joint in truth.joints])
    assert len(truth.parent) == parts
    assert_screws_reproduce_motions(truth)
    last = dict(zip(names, recorded[0][0][-1], strict=True))
    assert_on_surface(path, mesh_dirs, last, members, frames[-1], truth.labels[-1])
