import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.flow.network.geometry import CENTRES, FINE, HUBS, INVARIANTS, cloud_geometry


@pytest.fixture(scope="module")
def cloud():
    """A bent tube with a box on one end."""
    rng = np.random.default_rng(0)
    along, around = rng.uniform(0, 1, 2000), rng.uniform(0, 2 * np.pi, 2000)
    tube = np.stack([along, 0.3 * along**2 + 0.05 * np.cos(around), 0.05 * np.sin(around)], axis=1)
    box = np.array([1.0, 0.3, 0.0]) + rng.uniform(-0.1, 0.1, (1000, 3))
    box[np.arange(1000), rng.integers(3, size=1000)] = np.array([1.1, 0.4, 0.1])[rng.integers(3, size=1000)]
    return np.concatenate([tube, box])


def test_what_describes_a_point_does_not_change_when_the_cloud_is_turned_and_moved(cloud):
    R = Rotation.from_rotvec([0.3, -1.2, 0.8]).as_matrix()
    here, there = cloud_geometry(cloud), cloud_geometry(cloud @ R.T + [3.0, -2.0, 1.0])
    np.testing.assert_allclose(there.query_invariants, here.query_invariants, atol=1e-5)
    np.testing.assert_allclose(there.queries, here.queries @ R.T, atol=1e-5)
    assert here.query_invariants.std(axis=0).min() > 0.01


def test_groups_are_the_nearest_points(cloud):
    geometry = cloud_geometry(cloud, all_points=False)
    p = geometry.points.astype(np.float64)
    [coarsest] = [group for group in geometry.groups if group.max() < 256]
    distance = np.linalg.norm(p[:CENTRES, None] - p[None, :256], axis=2)
    furthest_in = np.take_along_axis(distance, coarsest, axis=1).max(axis=1)
    assert np.all((distance < furthest_in[:, None] - 1e-9).sum(axis=1) < coarsest.shape[1])
    np.testing.assert_array_equal(geometry.queries, geometry.points)


@pytest.mark.parametrize("points", [8, 40, 3000])
@pytest.mark.parametrize("kind", ["cloud", "plane", "line", "place"])
def test_any_cloud_of_any_size_is_described(cloud, points, kind):
    axes = {"cloud": (1, 1, 1), "plane": (1, 1, 0), "line": (1, 0, 0), "place": (0, 0, 0)}[kind]
    geometry = cloud_geometry(cloud[:points] * axes)
    assert geometry.points.shape == (FINE, 3)
    assert geometry.query_invariants.shape == (points, INVARIANTS)
    assert np.isfinite(geometry.query_invariants).all()
    for indices, count in ((geometry.to_queries[0], CENTRES), (geometry.to_centres[0], HUBS)):
        assert 0 <= indices.min() <= indices.max() < count
    np.testing.assert_allclose(geometry.to_queries[1].sum(axis=1), 1, rtol=1e-5)
