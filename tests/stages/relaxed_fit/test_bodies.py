"""Bodies in states that are far apart."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sklearn.metrics import adjusted_rand_score

from schemas.config import BodiesConfig
from stages.kernels.motion.rigid_motion import move_points
from stages.relaxed_fit.bodies.axes import Axes, axis_of_motion
from stages.relaxed_fit.bodies.start import Bodies
from tests.stages.conftest import box_surface

CONFIG = BodiesConfig(points=1200)
HINGE = np.array([0.3, 0.0, 0.1])


def chest(degrees, drawn):
    """Frames of a chest with a lid on a hinge and a drawer at its front, and the part of each point."""
    frames = []
    for t, (angle, out) in enumerate(zip(degrees, drawn, strict=True)):
        rng = np.random.default_rng(t)
        body = box_surface(rng, 1200, [-0.3, -0.4, -0.3], [0.3, 0.4, 0.1])
        lid = box_surface(rng, 600, [-0.3, -0.4, 0.11], [0.3, 0.4, 0.15]) - HINGE
        drawer = box_surface(rng, 400, [-0.34, -0.2, -0.2], [-0.31, 0.2, 0.0]) - [out, 0.0, 0.0]
        R = Rotation.from_rotvec([0.0, np.radians(angle), 0.0]).as_matrix()
        frames.append(np.concatenate([body, lid @ R.T + HINGE, drawer]))
    return frames, np.repeat([0, 1, 2], [1200, 600, 400])


@pytest.mark.parametrize(
    ("degrees", "drawn"),
    [((90.0, 20.0, 60.0, 0.0, 120.0), (0.1, 0.35, 0.0, 0.2, 0.3)), ((90.0, 30.0), (0.0, 0.3))],
)
def test_a_lid_and_a_drawer_are_found_in_states_far_apart(degrees, drawn):
    frames, labels = chest(degrees, drawn)
    canonical = len(frames) // 2
    bodies = Bodies.of(frames, canonical, CONFIG)
    found = bodies.find()
    assert len(found.Ts) == 3
    start = bodies.start(found, frames[canonical])
    assert adjusted_rand_score(labels, start.labels) > 0.85
    for t in range(len(frames)):
        R = Rotation.from_rotvec([0.0, np.radians(degrees[t] - degrees[canonical]), 0.0]).as_matrix()
        true = frames[canonical].copy()
        true[1200:1800] = (true[1200:1800] - HINGE) @ R.T + HINGE
        true[1800:, 0] -= drawn[t] - drawn[canonical]
        moved = move_points(start.Ts_frame_canonical[t, start.labels], frames[canonical])
        assert np.median(np.linalg.norm(moved - true, axis=1)) < 0.01
    assert bodies.energy(frames[canonical], labels, start.Ts_frame_canonical[:, :1].repeat(3, axis=1)) > found.energy


def test_the_axis_of_a_motion_is_where_it_turns():
    axes = Axes.of([(True, HINGE, np.array([0.0, 1.0, 0.0])), (False, np.zeros(3), np.array([0.0, 0.0, 1.0]))])
    turns, point, direction = axis_of_motion(axes.transforms(0, np.array([0.7]))[0])
    assert turns
    np.testing.assert_allclose(np.cross(point - HINGE, [0, 1, 0]), 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(direction), [0, 1, 0], atol=1e-12)
    assert not axis_of_motion(axes.transforms(1, np.array([3.0]))[0])[0]
    assert axis_of_motion(np.eye(4)) is None
