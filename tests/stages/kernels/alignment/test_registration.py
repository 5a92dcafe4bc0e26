import numpy as np
import pytest

from stages.kernels.alignment.registration import Registration, turn_about, twist_jacobian
from stages.kernels.kinematics.tree import joint_transforms
from stages.kernels.motion.rigid_motion import move_points
from stages.kernels.points.sampling import normals, point_spacing

ALL = np.arange(400)
MOVING = np.flatnonzero(np.arange(400) >= 200)


def true_Ts(truth):
    return truth.Ts_frame_canonical


def disturbed(Ts, size, seed=0):
    noise = np.random.default_rng(seed).normal(scale=size, size=(*Ts.shape[:2], 6))
    noise[2] = 0
    return joint_transforms(np.zeros(3), noise) @ Ts


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
    true = registration.cost(MOVING, zero, true_Ts(hinge)[:, [1]])
    wrong = registration.cost(MOVING, zero, still)
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
        plane = normal @ (p - frames[t][near]) / registration.spacing / 0.4
        expected.append(min(plane**2 + 0.5 * (distances[near] / registration.spacing) ** 2, 9.0))
    cost = registration.cost(np.array([250]), np.array([1]), Ts)
    assert cost[0] == pytest.approx(np.mean(expected))


def test_cost_back_is_the_cost_of_the_frames_at_the_posed_model(registration, hinge):
    labels, frames = hinge.canonical_labels, hinge.sequence.frames()
    Ts = disturbed(true_Ts(hinge), 0.02)
    posed = move_points(Ts[:, labels], frames[2])
    expected = 0.0
    for t in (0, 1, 3, 4):
        offsets = frames[t][:, None] - posed[t]
        nearest = np.linalg.norm(offsets, axis=-1).argmin(axis=1)
        offset = offsets[np.arange(len(nearest)), nearest] / registration.spacing
        plane = np.einsum("ni,ni->n", normals(frames[t]), offset) / 0.4
        expected += np.minimum(plane**2 + 0.5 * (offset**2).sum(axis=1), 9.0).sum() / 4
    assert registration.cost_back(labels, Ts) == pytest.approx(expected)
    assert registration.cost_back(labels, Ts) > registration.cost_back(labels, true_Ts(hinge))


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


def test_touching_points_hold_parts_together():
    cap = np.random.default_rng(0).normal(size=(300, 3))
    cap /= np.linalg.norm(cap, axis=1, keepdims=True)
    labels = (cap[:, 2] > 0).astype(int)
    a = np.flatnonzero((labels == 0) & (cap[:, 2] > -0.2))
    touching = np.stack([a, [np.flatnonzero(labels)[((cap[labels == 1] - cap[i]) ** 2).sum(1).argmin()] for i in a]], 1)
    registration = Registration([cap, cap], 0)
    Ts = np.tile(np.eye(4), (2, 2, 1, 1))
    Ts[1, 1] = joint_transforms(np.zeros(3), np.array([0, 0, 0.4, 0, 0, 0]))  # a ball's half turned on itself
    free = registration.refine_parts(labels, Ts, touching, 15, 50.0, 0.0)
    held = registration.refine_parts(labels, Ts, touching, 15, 50.0, 3.0)

    def gap(Ts):
        T_relative = np.linalg.inv(Ts[1, 0]) @ Ts[1, 1]
        return np.linalg.norm(T_relative[:3, :3] - np.eye(3))

    assert gap(held) < 0.5 * gap(free)


def test_twist_jacobian_is_the_derivative_of_turning():
    arm, step = np.array([0.3, -0.2, 0.5]), 1e-6
    for column, twist in enumerate(np.eye(6)):
        T = turn_about(np.zeros((1, 3)), step * twist[None], 1.0)[0]
        np.testing.assert_allclose((T[:3, :3] @ arm + T[:3, 3] - arm) / step, twist_jacobian(arm)[:, column], atol=1e-5)


def test_linearise_is_the_quadratic_model_of_its_cost(registration, hinge):
    """Half the cost's derivative by each part's twist, where matches far apart are not weighed down."""
    labels, start, step = hinge.canonical_labels, disturbed(true_Ts(hinge), 0.02), 1e-7
    equations = registration.linearise(labels, start, 1e6)
    for t, part, column in ((0, 1, 1), (1, 0, 5), (3, 1, 2), (4, 0, 0), (4, 1, 3)):
        costs = []
        for sign in (1, -1):
            twist = np.zeros((1, 6))
            twist[0, column] = sign * step
            Ts = start.copy()
            Ts[t, part] = turn_about(equations.centres[t, [part]], twist, registration.spacing)[0] @ Ts[t, part]
            costs.append(registration.linearise(labels, Ts, 1e6).cost)
        assert (costs[0] - costs[1]) / (4 * step) == pytest.approx(equations.gradient[t, part, column], rel=1e-3)
    np.testing.assert_allclose(equations.hessian, equations.hessian.transpose(0, 1, 3, 2))
    assert np.linalg.eigvalsh(equations.hessian[[0, 1, 3, 4]]).min() > 0


def test_linearise_says_nothing_of_the_canonical_frame_nor_of_parts_without_points(registration, hinge):
    Ts = disturbed(true_Ts(hinge)[:, [0, 1, 1]], 0.02)
    equations = registration.linearise(hinge.canonical_labels, Ts, 2.0)
    assert not equations.hessian[2].any()
    assert not equations.gradient[2].any()
    assert not equations.hessian[:, 2].any()
    p = hinge.sequence.frames()[2][hinge.canonical_labels == 1]
    np.testing.assert_allclose(equations.centres[3, 1], (Ts[3, 1, :3, :3] @ p.T).mean(axis=1) + Ts[3, 1, :3, 3])


def test_linearised_cost_is_least_near_the_truth_and_bounded_far_away(registration, hinge):
    cost = [
        registration.linearise(hinge.canonical_labels, Ts, 2.0).cost
        for Ts in (true_Ts(hinge), disturbed(true_Ts(hinge), 0.02), np.tile(np.eye(4), (5, 2, 1, 1)))
    ]
    assert cost[0] < cost[1] < cost[2]
    away = true_Ts(hinge)
    away = np.where(np.arange(5)[:, None, None, None] == 2, away, away + 1e4 * np.eye(4, k=3))
    assert registration.linearise(hinge.canonical_labels, away, 2.0).cost < 4 * 800 * 2.0**2 * 1.1


def test_frames_as_dense_as_the_canonical_one_share_its_noise(registration):
    assert np.all(registration.spacings == registration.spacing)
    assert registration.evidence == 4.0


def test_a_far_sparser_frame_has_a_noise_of_its_own_and_tells_less(hinge):
    frames = hinge.sequence.frames()
    registration = Registration([*frames[:4], frames[4][::9]], 2)
    np.testing.assert_array_equal(registration.spacings[:4], registration.spacing)
    assert registration.spacings[4] == point_spacing(frames[4][::9])
    assert 3.0 < registration.evidence < 3.4  # about a ninth of a frame


def test_a_far_sparser_frame_pulls_by_what_its_points_tell(hinge):
    """Where all frames are sparse, the cost is that of the same frames in units of their own spacing."""
    frames = hinge.sequence.frames()
    registration = Registration([frames[2], frames[3][::9]], 0)
    labels, Ts = hinge.canonical_labels, hinge.Ts_frame_canonical[[2, 3]]
    own = registration.linearise(labels, Ts, 2.0)
    registration.spacing = registration.spacings[1]
    registration.shares[:] = 1.0
    coarse = registration.linearise(labels, Ts, 2.0)
    assert own.cost == pytest.approx(coarse.cost)
    np.testing.assert_allclose(
        own.gradient[1, :, 3:], coarse.gradient[1, :, 3:] * point_spacing(frames[2]) / registration.spacing
    )
