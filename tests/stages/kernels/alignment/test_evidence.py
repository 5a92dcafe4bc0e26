import numpy as np
import pytest

from stages.kernels.alignment import evidence
from stages.kernels.alignment.evidence import gross_cost, motion_cost, price_over
from stages.kernels.alignment.registration import TRUNCATION, Registration
from stages.kernels.kinematics.tree import joint_transforms

EVERY = np.arange(400)


def cost(truth, part, scale=1.0, Ts=None):
    """Every point's cost with part `part` (400,)."""
    registration = Registration([scale * p for p in truth.sequence.frames()], 2)
    Ts = (truth.Ts_frame_canonical if Ts is None else Ts).copy()
    Ts[..., :3, 3] *= scale
    return motion_cost(registration, registration.p, EVERY, np.broadcast_to(part, 400), Ts)


def test_the_true_motion_costs_most_points_less_than_another(two_part_object):
    truth = two_part_object
    own, other = cost(truth, truth.canonical_labels), cost(truth, 1 - truth.canonical_labels)
    assert (own < other).mean() > 0.95
    assert np.median(own) < 0.3 * np.median(other)


def test_cost_grows_with_the_error_of_the_motion(hinge):
    means = []
    for size in (0.0, 0.01, 0.02, 0.04):
        Ts = hinge.Ts_frame_canonical.copy()
        Ts[[0, 3], 1, 2, 3] += size
        Ts[[1, 4], 1, 2, 3] -= size
        means.append(cost(hinge, hinge.canonical_labels, Ts=Ts)[200:].mean())
    assert means == sorted(means)


def test_many_frames_see_offsets_far_below_the_spacing():
    """On a plane sampled anew in every frame, a third of a spacing across it shows, which the points' own distances
    hide."""
    rng = np.random.default_rng(0)
    frames = [np.column_stack([rng.uniform(size=(900, 2)), np.zeros(900)]) for _ in range(5)]
    registration = Registration(frames, 2)
    Ts = np.tile(np.eye(4), (5, 2, 1, 1))
    Ts[[0, 3], 1, 2, 3] = registration.spacing / 3
    inner = np.flatnonzero((np.abs(registration.p[:, :2] - 0.5) < 0.4).all(axis=1))
    together = [motion_cost(registration, registration.p, inner, np.full(len(inner), k), Ts) for k in (0, 1)]
    single = [registration.cost(inner, np.full(len(inner), k), Ts) for k in (0, 1)]
    assert (together[1] > together[0]).mean() > 0.95
    assert np.mean(together[1] - together[0]) > np.mean(single[1] - single[0])


def test_costs_are_truncated(hinge):
    Ts = hinge.Ts_frame_canonical.copy()
    Ts[[0, 1, 3, 4], 0, 2, 3] += 50.0
    costs = cost(hinge, 0, Ts=Ts)
    assert costs.min() >= TRUNCATION
    assert costs.max() <= TRUNCATION * (1 + 1 / 4)


def test_it_does_not_matter_how_the_whole_thing_lies_in_a_frame(hinge):
    frames, Ts = hinge.sequence.frames(), hinge.Ts_frame_canonical.copy()
    T_moved = joint_transforms(np.zeros(3), np.random.default_rng(0).normal(size=(5, 6)))
    T_moved[2] = np.eye(4)
    moved = [p @ T[:3, :3].T + T[:3, 3] for p, T in zip(frames, T_moved, strict=True)]
    registration = Registration(moved, 2)
    costs = motion_cost(registration, registration.p, EVERY, hinge.canonical_labels, T_moved[:, None] @ Ts)
    np.testing.assert_allclose(costs, cost(hinge, hinge.canonical_labels), rtol=1e-6)


def test_the_unit_of_length_does_not_matter(hinge):
    np.testing.assert_allclose(cost(hinge, 1, scale=1000.0), cost(hinge, 1), rtol=1e-6)


@pytest.mark.parametrize("chunk", [1, 7, 400])
def test_entries_do_not_depend_on_what_is_looked_at_with_them(hinge, chunk, monkeypatch):
    registration = Registration(hinge.sequence.frames(), 2)
    point, part = np.array([250, 3, 250, 399, 0, 17, 8, 250]), np.array([1, 0, 0, 1, 1, 0, 1, 1])
    arguments = (registration, registration.p, point, part, hinge.Ts_frame_canonical)
    whole = motion_cost(*arguments)
    monkeypatch.setattr(evidence, "CHUNK", chunk)
    np.testing.assert_allclose(motion_cost(*arguments), whole, rtol=1e-12)
    assert whole[0] == whole[7]
    assert whole[0] < whole[2]


def test_no_entries_cost_nothing(hinge):
    none = np.empty(0, dtype=np.int64)
    registration = Registration(hinge.sequence.frames(), 2)
    assert motion_cost(registration, registration.p, none, none, hinge.Ts_frame_canonical).shape == (0,)


def test_frames_of_a_point_or_two_are_seen_too():
    frames = [np.random.default_rng(t).uniform(size=(n, 3)) for t, n in enumerate((40, 2, 40))]
    registration = Registration(frames, 0)
    Ts = np.tile(np.eye(4), (3, 1, 1, 1))
    costs = motion_cost(registration, registration.p, np.arange(40), np.zeros(40, dtype=np.int64), Ts)
    assert np.isfinite(costs).all()


def test_gross_cost_is_part_of_what_a_motion_costs_and_tells_a_motion_that_is_far_off(hinge):
    registration = Registration(hinge.sequence.frames(), 2)
    Ts = hinge.Ts_frame_canonical.copy()
    true = gross_cost(registration, registration.p, EVERY, hinge.canonical_labels, Ts, registration.others)
    assert np.all(true <= motion_cost(registration, registration.p, EVERY, hinge.canonical_labels, Ts) + 1e-9)
    Ts[[0, 4], :, 2, 3] += 50.0
    seen = [gross_cost(registration, registration.p, EVERY, hinge.canonical_labels, Ts, some) for some in ([0, 4], [1])]
    assert np.all(seen[0] == TRUNCATION)
    assert seen[1].mean() < 1.0


@pytest.mark.parametrize(("evidence", "expected"), [(100, 30), (9, 30), (3, 90), (1, 270), (0.5, 540)])
def test_a_price_rises_where_few_frames_tell(evidence, expected):
    assert price_over(evidence, 30.0) == expected


def test_a_far_sparser_frame_bears_out_the_true_motion_too(hinge):
    """Its points are far from most moved points, but no farther than its own spacing."""
    frames = hinge.sequence.frames()
    sparse = [*frames[:3], frames[3][::12], frames[4]]
    Ts, everything = hinge.Ts_frame_canonical, np.arange(len(frames[2]))
    one = [2, 3]  # the canonical frame against the sparse one
    registration = Registration([sparse[t] for t in one], 0)
    true = motion_cost(registration, registration.p, everything, hinge.canonical_labels, Ts[one])
    other = motion_cost(registration, registration.p, everything, 1 - hinge.canonical_labels, Ts[one])
    assert np.median(true) < 6 < np.median(other)  # in spacings of the canonical frame 12 and 16
