import numpy as np
import pytest

from schemas.model_file import ModelFile, ModelJoint, ModelPart, Result
from stages.report import residuals
from stages.report.residuals import part_residuals, sampling_floor


@pytest.fixture
def two_squares():
    """Two squares of points, of which the second one rises by 0.1 a frame; 2 x 2 x 1 in the canonical frame 0."""
    rng = np.random.default_rng(0)
    square = np.column_stack([rng.uniform(-1, 1, (500, 2)), np.zeros(500)])
    p = np.concatenate([square, square + [0, 0, 1]])
    T = np.tile(np.eye(4), (3, 2, 1, 1))
    T[:, 1, 2, 3] = [0, 0.1, 0.2]
    parts = tuple(ModelPart(id=i, name=f"part_{i}", point_count=500) for i in range(2))
    lift = {"axis": (0, 0, 1), "point": (0, 0, 0), "lower": 0, "upper": 0.2, "states": (0, 0.1, 0.2)}
    joint = ModelJoint(id=0, name="joint_0", parent=0, child=1, type="prismatic", **lift)
    model = ModelFile(units="metre", frames=3, canonical_frame=0, root=0, parts=parts, joints=(joint,))
    result = Result(
        model=model, canonical_points=p.astype(np.float32), labels=np.repeat([0, 1], 500), T_frame_canonical=T
    )
    frames = [np.concatenate([square, square + [0, 0, 1 + 0.1 * t]]) for t in range(3)]
    return result, frames


def test_what_fits_leaves_nothing(two_squares):
    result, frames = two_squares
    np.testing.assert_allclose(part_residuals(result, frames), 0, atol=1e-4)


def test_a_part_in_the_wrong_place_is_told_in_percent_of_the_diagonal(two_squares):
    result, frames = two_squares
    frames[2] = frames[2] - [0, 0, 0.03] * (frames[2][:, 2:] > 0.5)
    found = part_residuals(result, frames)
    assert found[2, 1] == pytest.approx(100 * 0.03 / 3.0, rel=0.02)
    assert found[2, 0] == pytest.approx(0, abs=1e-4)


def test_points_that_the_model_lacks_count_for_the_part_next_to_them(two_squares):
    result, frames = two_squares
    frames[1] = np.concatenate([frames[1], [[0, 0, 2.1]]])
    found = part_residuals(result, frames)
    assert found[1, 1] == pytest.approx(100 * np.sqrt(1 / 1001) / 3.0, rel=0.01)
    assert found[1, 0] == pytest.approx(0, abs=1e-4)


def test_a_choice_of_very_many_points_tells_nearly_the_same(two_squares, monkeypatch):
    result, frames = two_squares
    frames[2] = frames[2] + np.random.default_rng(1).normal(scale=0.02, size=frames[2].shape)
    whole = part_residuals(result, frames)
    monkeypatch.setattr(residuals, "MOST_QUERIES", 300)
    np.testing.assert_allclose(part_residuals(result, frames), whole, rtol=0.2, atol=1e-4)


def test_sampling_alone_leaves_as_much_as_is_said(two_squares):
    result, frames = two_squares
    rng = np.random.default_rng(2)
    square = np.column_stack([rng.uniform(-1, 1, (500, 2)), np.zeros(500)])
    frames[1] = np.concatenate([square, square + [0, 0, 1.1]])
    floor = sampling_floor(result)
    assert part_residuals(result, frames)[1] == pytest.approx([floor, floor], rel=0.2)


def test_a_part_without_points_and_a_cloud_of_one_place_have_no_residual(samples):
    result = samples["result"].replace(labels=np.zeros(4, dtype=np.int64))
    frames = [np.ones((3, 3))] * 3
    np.testing.assert_array_equal(part_residuals(result, frames), np.zeros((3, 2)))
    assert sampling_floor(result) == 0
