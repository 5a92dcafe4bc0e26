import numpy as np
import pytest

from stages.kernels.alignment.registration import Registration
from stages.kernels.alignment.visibility import UNSEEN_COST, View, sum_of_seen

CAMERA = np.array([[0.0, -5.0, 0.0]])  # looks along y
SPACING = 0.1


def plate(y: float, x: tuple[float, float] = (-1.0, 1.0), z: tuple[float, float] = (-1.0, 1.0)) -> np.ndarray:
    """A plate across y, sampled on a grid."""
    grid = np.meshgrid(np.arange(*x, SPACING), [y], np.arange(*z, SPACING))
    return np.stack([axis.ravel() for axis in grid], axis=1)


@pytest.mark.parametrize(
    ("place", "hidden"),
    [
        ((0.0, 1.0, 0.0), True),  # behind the plate
        ((0.0, 0.1, 0.0), False),  # within noise of it
        ((0.0, -1.0, 0.0), False),  # free space before it
        ((2.0, 1.0, 0.0), False),  # beside it nothing was seen
    ],
)
def test_hides(place, hidden):
    view = View.of(plate(0.0), CAMERA, SPACING)
    assert view.hides(np.array([place])).tolist() == [hidden]


def test_what_one_of_the_cameras_sees_is_not_hidden():
    view = View.of(plate(0.0), np.concatenate([CAMERA, -CAMERA]), SPACING)
    assert not view.hides(np.array([[0.0, 1.0, 0.0]])).any()


def test_sum_of_seen():
    costs = np.array([[1.0, 1.0, 9.0], [2.0, 9.0, 9.0], [3.0, 3.0, 9.0]])
    hidden = np.array([[False, False, True], [False, True, True], [False, False, True]])
    total = sum_of_seen(costs, hidden, 0)
    assert total[0] == 6.0
    assert 4.0 + 2.0 < total[1] < 4.0 + UNSEEN_COST  # between what others show and what nothing is known of
    assert total[2] == 3 * UNSEEN_COST
    assert np.array_equal(sum_of_seen(costs.T, hidden.T, 1), total)


@pytest.fixture
def behind_a_wall():
    """A slide that goes behind a wall in the last of three frames; labels, and the true motions of wall and slide."""
    wall, slide = plate(0.0), plate(0.5, x=(1.5, 2.3), z=(-0.3, 0.3))
    Ts = np.tile(np.eye(4), (3, 2, 1, 1))
    Ts[1, 1, 0, 3], Ts[2, 1, 0, 3] = 0.5, -2.0
    frames = [np.concatenate([wall, slide]), np.concatenate([wall, slide + [0.5, 0.0, 0.0]]), wall]
    labels = np.repeat([0, 1], [len(wall), len(slide)])
    return frames, labels, Ts


def test_hidden_points_cost_nothing_more(behind_a_wall):
    frames, labels, Ts = behind_a_wall
    slide = np.flatnonzero(labels == 1)
    cameras = np.tile(CAMERA, (3, 1, 1))
    blind, seeing = Registration(frames, 0), Registration(frames, 0, viewpoints=cameras)
    elsewhere = Ts.copy()
    elsewhere[2, 1] = np.eye(4)  # where the last frame shows empty space

    def cost(registration, motions):
        return registration.cost(slide, labels[slide], motions).mean()

    assert cost(blind, Ts) == pytest.approx(cost(blind, elsewhere))
    assert cost(seeing, Ts) < 0.7 * cost(seeing, elsewhere)


def test_hidden_matches_pull_at_nothing(behind_a_wall):
    frames, labels, Ts = behind_a_wall
    equations = Registration(frames, 0, viewpoints=np.tile(CAMERA, (3, 1, 1))).linearise(labels, Ts, 5.0)
    assert np.abs(equations.hessian[1, 1]).max() > 0
    assert np.abs(equations.hessian[2, 1]).max() == 0


def test_what_the_canonical_frame_hides_is_not_unexplained():
    wall, behind = plate(0.0), plate(0.5, x=(-0.5, 0.3), z=(-0.3, 0.3))
    frames = [wall, np.concatenate([wall, behind])]
    cameras = np.stack([CAMERA, -CAMERA])  # the second frame sees it from the other side
    labels, Ts = np.zeros(len(wall), dtype=np.int64), np.tile(np.eye(4), (2, 1, 1, 1))
    assert Registration(frames, 0).cost_back(labels, Ts) > len(behind)
    assert Registration(frames, 0, viewpoints=cameras).cost_back(labels, Ts) == 0.0
