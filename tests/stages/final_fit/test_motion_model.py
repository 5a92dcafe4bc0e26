import numpy as np
import pytest

from stages.final_fit.motion_model import MotionModel
from stages.kernels.alignment.registration import Registration, turn_about
from stages.kernels.kinematics.tree import joint_transforms

OTHERS = [0, 1, 3, 4]


def disturbed(Ts, size, seed=0):
    noise = np.random.default_rng(seed).normal(scale=size, size=(*Ts.shape[:2], 6))
    noise[2] = 0
    return joint_transforms(np.zeros(3), noise) @ Ts


@pytest.fixture
def registration(hinge):
    return Registration(hinge.sequence.frames(), 2)


@pytest.fixture
def model(registration, hinge):
    Ts = hinge.Ts_frame_canonical
    return MotionModel(registration.linearise(hinge.canonical_labels, Ts, 2.0), Ts, registration.spacing)


def test_its_own_motions_cost_nothing_and_others_the_more_the_farther(model, hinge):
    costs = [model(disturbed(hinge.Ts_frame_canonical, size)).cost for size in (0.0, 0.03, 0.1, 0.3)]
    assert costs[0] == pytest.approx(0, abs=1e-9)
    assert costs == sorted(costs)


def test_gradient_is_half_the_derivative_of_cost_far_from_its_own_motions_too(model, hinge, registration):
    start, step = disturbed(hinge.Ts_frame_canonical, 0.4), 1e-6
    equations = model(start)
    for t, part, column in ((0, 1, 1), (1, 0, 5), (3, 1, 2), (4, 0, 0), (4, 1, 3)):
        costs = []
        for sign in (1, -1):
            twist = np.zeros((1, 6))
            twist[0, column] = sign * step
            Ts = start.copy()
            Ts[t, part] = turn_about(equations.centres[t, [part]], twist, registration.spacing)[0] @ Ts[t, part]
            costs.append(model(Ts).cost)
        assert (costs[0] - costs[1]) / (4 * step) == pytest.approx(equations.gradient[t, part, column], rel=1e-4)


def test_near_its_own_motions_it_costs_what_matching_costs(model, hinge, registration):
    """In the unit of the frames' costs: about, since that one is truncated and matched anew."""
    Ts = hinge.Ts_frame_canonical.copy()
    Ts[OTHERS, 1, 2, 3] += 0.7 * registration.spacing
    matched = [
        registration.cost(np.arange(400), hinge.canonical_labels, motions).sum()
        for motions in (hinge.Ts_frame_canonical, Ts)
    ]
    assert model(Ts).cost == pytest.approx(matched[1] - matched[0], rel=0.5)


def test_parts_that_it_does_not_know_cost_nothing(model, hinge):
    start = disturbed(hinge.Ts_frame_canonical, 0.1)
    known, more = model(start), model(np.concatenate([start, disturbed(start[:, :1], 0.5)], axis=1))
    assert more.cost == pytest.approx(known.cost)
    assert not more.hessian[:, 2].any()
    np.testing.assert_array_equal(more.gradient[:, :2], known.gradient)
