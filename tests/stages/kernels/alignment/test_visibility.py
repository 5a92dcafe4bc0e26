import numpy as np
import pytest

from stages.kernels.alignment.evidence import views_from_outside
from stages.kernels.alignment.registration import Registration
from stages.kernels.alignment.visibility import LEAST, UNSEEN_COST, Exposure, View, sum_of_seen

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


def test_surfaces_are_seen_from_their_outer_side():
    """A camera sees the front of a plate, neither its edge nor its back."""
    view = View.of(plate(0.0), CAMERA, SPACING)
    p = np.array([[0.0, 0.0, 0.0]] * 3)
    outward = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert view.faces(p, outward).tolist() == [True, False, False]
    np.testing.assert_array_equal(view.outward(p[:1], -outward[:1]), outward[:1])
    assert View.of(plate(0.0), np.concatenate([CAMERA, -CAMERA]), SPACING).faces(p, outward).tolist() == [
        True,
        False,
        True,
    ]


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


FINE = 0.02  # spacing of a cupboard of unit size


def cupboard(hole: bool = False) -> np.ndarray:
    """Five sides of a box about the origin, open to -y; with a hole in the side at x = -0.5."""
    along = np.arange(-0.5, 0.5 + FINE / 2, FINE)
    u, v = (axis.ravel() for axis in np.meshgrid(along, along))
    end = np.full_like(u, 0.5)
    left, right = np.stack([-end, u, v], axis=1), np.stack([end, u, v], axis=1)
    if hole:
        left = left[np.abs(left[:, 1:] - [0.1, 0.0]).max(axis=1) > 0.12]
    back = np.stack([u, end, v], axis=1)
    return np.concatenate([left, right, back, np.stack([u, v, -end], axis=1), np.stack([u, v, end], axis=1)])


@pytest.mark.parametrize(
    ("place", "tells"),
    [
        ((0.0, 0.3, 0.0), (LEAST, LEAST)),  # deep inside
        ((-0.5, 0.1, 0.0), (LEAST, 0.2)),  # within a wall
        ((0.0, -0.8, 0.0), (0.8, 1.0)),  # before the opening
        ((0.9, 0.0, 0.0), (1.0, 1.0)),  # beside the cupboard
        ((9.0, 0.0, 0.0), (1.0, 1.0)),  # beyond the grid
    ],
)
def test_how_much_an_empty_place_tells(place, tells):
    told = Exposure.of(cupboard(hole=True), FINE).tells(np.array([place]))
    assert tells[0] - 1e-9 <= told[0] <= tells[1] + 1e-9


def test_an_exposure_counts_what_is_seen_in_each_direction():
    wall = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(-3, 3, 0.5), [0.0], np.arange(-3, 3, 0.5))], axis=1)
    exposure = Exposure.of(wall, 0.25)  # cells of one
    before, within = exposure.at(np.array([[0.1, -2.0, 0.1], [0.1, 0.1, 0.1]]))
    assert before == pytest.approx(17 / 26)  # all but the nine directions towards the wall
    assert within == pytest.approx(18 / 26)  # all but the eight along it


@pytest.fixture
def shelf():
    """A shelf deep in the cupboard."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-0.3, 0.3, FINE), np.arange(0.0, 0.4, FINE)))
    return np.stack([x, y, np.zeros_like(x)], axis=1)


def test_the_grid_stays_small_however_close_most_points_lie():
    exposure = Exposure.of(np.array([[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [1.0, 1.0, 1.0]]), 1e-9)
    assert exposure.exposure.size < 1.2e6
    assert exposure.at(np.array([[0.5, 0.3, 0.1]])) == 1.0


def test_enclosed_places_say_little(shelf):
    """A shelf that one of two scans of a cupboard lacks costs less than one in the open."""
    seen, unseen = np.concatenate([cupboard(), shelf]), cupboard()
    labels, Ts = np.zeros(len(seen), dtype=np.int64), np.tile(np.eye(4), (2, 1, 1, 1))
    registration = Registration([seen, unseen], 0)
    of_shelf = np.arange(len(unseen), len(seen))
    before = registration.cost(of_shelf, labels[of_shelf], Ts).mean()
    registration.views = [Exposure.of(frame, FINE) for frame in (seen, unseen)]
    assert registration.cost(of_shelf, labels[of_shelf], Ts).mean() < 0.4 * before
    moved = Ts.copy()
    moved[1, 0, 1, 3] = -3.0  # into the open
    assert registration.cost(of_shelf, labels[of_shelf], moved).mean() == pytest.approx(registration.truncation)


def test_what_one_scan_encloses_and_another_lacks_was_not_seen(shelf):
    with_shelf, without = np.concatenate([cupboard(), shelf]), cupboard()

    def views(frames):
        labels, Ts = np.zeros(len(frames[0]), dtype=np.int64), np.tile(np.eye(4), (len(frames), 1, 1, 1))
        return views_from_outside(Registration(frames, 0), [(labels, Ts)])

    assert len(views([with_shelf, with_shelf, without]) or []) == 3
    assert views([with_shelf, with_shelf, with_shelf]) is None  # sampled all around
    within = np.concatenate([0.3 * np.eye(3), -0.3 * np.eye(3)])[:, None] + 0.4 * with_shelf
    assert views([np.concatenate([with_shelf, *within]), without]) is None  # so much that is enclosed is shown
