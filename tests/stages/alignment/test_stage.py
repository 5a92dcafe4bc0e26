"""Scans in coordinates of their own, and the way back to them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.alignment import Alignment
from schemas.config import AlignmentConfig
from schemas.kinematic import KinematicModel
from stages.alignment.coordinates import in_common_coordinates, in_own_coordinates
from stages.alignment.stage import compute_alignment
from stages.kernels.motion.rigid_motion import from_parts, inverse, move_points
from tests.stages.conftest import box_surface

CONFIG = AlignmentConfig(points=400)
TURN = Rotation.from_rotvec(np.pi * np.array([0.6, 0.0, 0.8])).as_matrix()  # by half a turn about a slanting axis
PLACE = from_parts(TURN, np.array([0.5, -2.0, 1.0]))


@pytest.fixture(scope="module")
def scans(hinge):
    """A body without symmetry whose lid opens, in two frames, the first of which has coordinates of its own."""
    frames = []
    for t, angle in enumerate((1.0, 0.0)):
        rng = np.random.default_rng(t)
        body = [
            box_surface(rng, 300, [-0.4, -0.3, -0.1], [0.2, 0.3, 0.1]),
            box_surface(rng, 120, [-0.4, -0.3, 0.1], [-0.2, 0.0, 0.5]),
            box_surface(rng, 80, [0.2, 0.1, -0.1], [0.5, 0.2, 0.0]),
        ]
        lid = box_surface(rng, 200, [-0.1, -0.3, 0.12], [0.2, 0.3, 0.16])
        R = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
        frames.append(np.concatenate([*body, (lid - [0.2, 0, 0.12]) @ R.T + [0.2, 0, 0.12]]))
    frames[0] = move_points(PLACE, frames[0])
    return hinge.sequence.replace(
        points=np.concatenate(frames),
        point_counts=np.array([700, 700]),
        dropped_counts=np.zeros(2, dtype=np.int64),
        frame_names=("a", "b"),
    )


def test_a_scan_that_is_turned_over_is_brought_back(scans):
    found = compute_alignment(scans, CONFIG)
    assert found.own_frames
    off = move_points(found.Ts_common_frame[0] @ PLACE, np.eye(3)) - np.eye(3)
    assert np.abs(off).max() < 0.05
    assert found.shares[0] > 0.5
    assert not found.upright
    together = in_common_coordinates(scans, found)
    np.testing.assert_array_equal(together.frames()[1], scans.frames()[1])
    assert np.abs(together.frames()[0]).max() < 1.0


@pytest.mark.parametrize("setting", ["auto", "no"])
def test_frames_that_share_coordinates_stay_as_they_are(hinge, setting):
    found = compute_alignment(hinge.sequence, CONFIG.model_copy(update={"own_frames": setting}))
    assert not found.own_frames
    assert in_common_coordinates(hinge.sequence, found) is hinge.sequence


def test_coordinates_are_searched_where_that_is_asked(scans):
    assert not compute_alignment(scans, CONFIG.model_copy(update={"own_frames": "no"})).own_frames


def test_the_way_back_leads_to_each_frame(hinge):
    """A model of common coordinates takes the canonical frame's own points to every frame's own coordinates."""
    rng = np.random.default_rng(0)
    places = from_parts(Rotation.random(5, rng=rng).as_matrix(), rng.normal(size=(5, 3)))
    alignment = Alignment(own_frames=True, upright=False, Ts_common_frame=places, shares=np.ones(5))
    common = kinematic(hinge)
    own = in_own_coordinates(common, alignment)
    p_common = hinge.sequence.frames()[common.canonical_frame]
    p_own = move_points(inverse(places[common.canonical_frame]), p_common)
    for t in range(5):
        there = move_points(inverse(places[t]), move_points(common.Ts_frame_canonical[t, common.labels], p_common))
        np.testing.assert_allclose(move_points(own.Ts_frame_canonical[t, own.labels], p_own), there, atol=1e-9)
    # the axis is the same line, seen from the canonical frame
    on_axis = move_points(places[common.canonical_frame], own.point + 0.3 * own.axis)
    np.testing.assert_allclose(np.cross(on_axis - common.point, common.axis), 0, atol=1e-9)


def kinematic(scene):
    """The true model of a two-part object."""
    return KinematicModel(
        canonical_frame=2,
        root=0,
        labels=scene.canonical_labels,
        Ts_frame_canonical=scene.Ts_frame_canonical,
        joint_parent=np.array([0]),
        joint_child=np.array([1]),
        joint_types=(scene.kind.name,),
        axis=scene.axis[None],
        point=scene.point[None],
        states=scene.states,
        e_spatial=np.zeros(1),
        e_1dof=np.zeros(1),
        energies={},
    )
