import numpy as np
import pytest
import torch

from stages.kernels import se3
from stages.kernels.registration import Registration, turn_about, twist_jacobian

ALL = np.arange(400)
MOVING = np.flatnonzero(np.arange(400) >= 200)


def true_Ts(truth):
    return truth.Ts_frame_canonical


def disturbed(Ts, size, seed=0):
    noise = np.random.default_rng(seed).normal(scale=size, size=(*Ts.shape[:2], 6))
    noise[2] = 0
    return se3.exp(torch.from_numpy(noise)).numpy() @ Ts


def misplacement(Ts, truth):
    p = truth.sequence.frames()[2]

    def place(motions):
        T_points = motions[:, truth.canonical_labels]
        return np.einsum("tnij,nj->tni", T_points[..., :3, :3], p) + T_points[..., :3, 3]

    return np.linalg.norm(place(Ts) - place(true_Ts(truth)), axis=-1).mean()


@pytest.fixture
def registration(hinge):
    return Registration(hinge.sequence.frames(), 2)


def test_the_truth_costs_less_than_stillness_and_costs_are_truncated(registration, hinge):
    zero = np.zeros(len(MOVING), dtype=int)
    still = np.tile(np.eye(4), (5, 1, 1, 1))
    true = registration.cost(MOVING, zero, true_Ts(hinge)[:, [1]], 9.0)
    wrong = registration.cost(MOVING, zero, still, 9.0)
    assert true.mean() < 0.5 * wrong.mean()
    assert wrong.max() <= 9.0


def test_cost_equals_its_naive_twin(registration, hinge):
    frames, Ts = hinge.sequence.frames(), true_Ts(hinge)
    expected = []
    for t in (0, 1, 3, 4):
        p = Ts[t, 1, :3, :3] @ frames[2][250] + Ts[t, 1, :3, 3]
        distances = np.linalg.norm(frames[t] - p, axis=1)
        near = distances.argmin()
        normal = registration._normals[t][near]
        plane = normal @ (p - frames[t][near]) / registration.noise / 0.4
        expected.append(min(plane**2 + 0.5 * (distances[near] / registration.noise) ** 2, 9.0))
    cost = registration.cost(np.array([250]), np.array([1]), Ts, 9.0)
    assert cost[0] == pytest.approx(np.mean(expected))


def test_groups_find_their_way_back(registration, hinge):
    start = disturbed(true_Ts(hinge), 0.03)
    refined = registration.refine_groups(ALL, hinge.canonical_labels, start, 12, 5.0)
    assert misplacement(refined, hinge) < 0.35 * misplacement(start, hinge)
    np.testing.assert_array_equal(refined[2], start[2])


def test_parts_find_their_way_back_together(registration, hinge):
    start = disturbed(true_Ts(hinge), 0.03)
    none = np.empty((0, 2), dtype=int)
    refined = registration.refine_parts(hinge.canonical_labels, start, none, 12, 5.0, 1.0)
    assert misplacement(refined, hinge) < 0.35 * misplacement(start, hinge)


def test_contacts_hold_parts_together():
    cap = np.random.default_rng(0).normal(size=(300, 3))
    cap /= np.linalg.norm(cap, axis=1, keepdims=True)
    labels = (cap[:, 2] > 0).astype(int)
    a = np.flatnonzero((labels == 0) & (cap[:, 2] > -0.2))
    contacts = np.stack([a, [np.flatnonzero(labels)[((cap[labels == 1] - cap[i]) ** 2).sum(1).argmin()] for i in a]], 1)
    registration = Registration([cap, cap], 0)
    Ts = np.tile(np.eye(4), (2, 2, 1, 1))
    Ts[1, 1] = se3.exp(
        torch.tensor([0, 0, 0.4, 0, 0, 0], dtype=torch.float64)
    ).numpy()  # a ball's half turned on itself
    free = registration.refine_parts(labels, Ts, contacts, 15, 50.0, 0.0)
    held = registration.refine_parts(labels, Ts, contacts, 15, 50.0, 3.0)

    def gap(Ts):
        T_relative = np.linalg.inv(Ts[1, 0]) @ Ts[1, 1]
        return np.linalg.norm(T_relative[:3, :3] - np.eye(3))

    assert gap(held) < 0.5 * gap(free)


def test_twist_jacobian_is_the_derivative_of_turning():
    arm, step = np.array([0.3, -0.2, 0.5]), 1e-6
    for column, twist in enumerate(np.eye(6)):
        T = turn_about(np.zeros((1, 3)), step * twist[None], 1.0)[0]
        np.testing.assert_allclose((T[:3, :3] @ arm + T[:3, 3] - arm) / step, twist_jacobian(arm)[:, column], atol=1e-5)
