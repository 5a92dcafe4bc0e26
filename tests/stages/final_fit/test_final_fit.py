import numpy as np
import pytest

from schemas.config import FinalFitConfig, ProjectionConfig
from schemas.joints import REVOLUTE
from stages.final_fit import stage
from stages.final_fit.stage import compute_final_fit, suited_to
from stages.kernels.kinematics.tree import joint_transforms
from stages.projection.stage import link_parts

CONFIG = FinalFitConfig(points=300, energy_points=200)


def fit(model, truth, config=CONFIG, sequence=None, seed=0):
    return compute_final_fit(model, sequence or truth.sequence, truth.true_flow(), config, np.random.default_rng(seed))


def parts_of(truth, size=0.0, labels=None, scale=1.0):
    """The true parts with noisy motions, as a relaxed fit would leave them."""
    rng = np.random.default_rng(0)
    Ts = truth.Ts_frame_canonical.copy()
    for t in (0, 1, 3, 4):
        Ts[t, 1, :3, 3] += rng.normal(scale=size, size=3)
    Ts[..., :3, 3] *= scale
    labels = truth.canonical_labels if labels is None else labels
    return link_parts(scale * truth.sequence.frames()[2], labels, Ts, 2, ProjectionConfig())


def test_finds_type_axis_and_states(two_part_object):
    truth = two_part_object
    model = fit(parts_of(truth, 0.02), truth)
    assert model.joint_types == (truth.kind.name,)
    assert abs(model.axis[0] @ truth.axis) > np.cos(np.radians(1))
    sign = np.sign(model.axis[0] @ truth.axis)
    np.testing.assert_allclose(sign * model.states, truth.states, atol=0.015)
    if truth.kind == REVOLUTE:
        offset = np.cross(model.point[0] - truth.point, truth.axis)
        assert np.linalg.norm(offset) < 0.005
    np.testing.assert_array_equal(model.labels, truth.canonical_labels)


def test_motions_are_those_of_forward_kinematics(two_part_object):
    model = fit(parts_of(two_part_object, 0.02), two_part_object)
    Ts = joint_transforms(model.point[0], model.states @ two_part_object.kind.basis(model.axis[0]))
    np.testing.assert_allclose(model.Ts_frame_canonical[:, 1], Ts, atol=1e-12)
    np.testing.assert_array_equal(model.Ts_frame_canonical[:, 0], np.tile(np.eye(4), (5, 1, 1)))
    np.testing.assert_array_equal(model.states[2], 0)
    assert np.linalg.norm(model.axis[0]) == pytest.approx(1)
    assert model.axis[0] @ model.point[0] == pytest.approx(0, abs=1e-12)


def test_the_fit_lowers_the_energy_and_reports_it(hinge):
    start = parts_of(hinge, 0.03)
    still = {"iterations": 0, "last_iterations": 0, "prune_iterations": 0, "hidden_links": False}
    none = CONFIG.model_copy(update=still)
    before, after = fit(start, hinge, none).energies, fit(start, hinge).energies
    assert after.keys() == {"E_project", "E_group", "E_recons", "E_CD", "E_EMD", "E_flow", "E_fit"}
    assert after["E_recons"] < 0.97 * before["E_recons"]
    weights = CONFIG.energy
    total = weights.lambda_cd * after["E_CD"] + weights.lambda_emd * after["E_EMD"]
    assert after["E_recons"] == pytest.approx(total + weights.lambda_flow * after["E_flow"])


def test_the_unit_does_not_matter(two_part_object):
    truth = two_part_object
    large = truth.sequence.replace(points=1000 * truth.sequence.points)
    flow = truth.true_flow()
    flow = flow.replace(flow=1000 * flow.flow)
    one = fit(parts_of(truth, 0.02), truth)
    other = compute_final_fit(parts_of(truth, 0.02, scale=1000.0), large, flow, CONFIG, np.random.default_rng(0))
    assert other.joint_types == one.joint_types
    np.testing.assert_array_equal(other.labels, one.labels)
    length = 1000.0 if one.joint_types == ("prismatic",) else 1.0
    sign = np.sign(one.axis[0] @ other.axis[0])
    np.testing.assert_allclose(sign * other.axis, one.axis, atol=1e-6)
    np.testing.assert_allclose(sign * other.states, length * one.states, atol=1e-6 * length)


def test_a_moving_base_is_followed(hinge):
    drift = np.linspace(-0.2, 0.2, 5)
    frames = [p + [0, x, 0] for p, x in zip(hinge.sequence.frames(), drift, strict=True)]
    sequence = hinge.sequence.replace(points=np.concatenate(frames))
    Ts = hinge.Ts_frame_canonical.copy()
    Ts[:, :, 1, 3] += drift[:, None]
    flow = hinge.true_flow()
    flow = flow.replace(flow=flow.flow + [0, 0.1, 0])
    model = link_parts(sequence.frames()[2], hinge.canonical_labels, Ts, 2, ProjectionConfig())
    final = compute_final_fit(model, sequence, flow, CONFIG, np.random.default_rng(0))
    assert final.part_count == 2
    np.testing.assert_allclose(final.Ts_frame_canonical[:, final.root, 1, 3], drift, atol=0.01)
    np.testing.assert_array_equal(final.Ts_frame_canonical[2], np.tile(np.eye(4), (2, 1, 1)))


def test_one_part_that_stands_still_needs_no_fit(hinge):
    still = np.tile(np.eye(4), (5, 1, 1, 1))
    model = link_parts(hinge.sequence.frames()[2], np.zeros(400, dtype=int), still, 2, ProjectionConfig())
    final = fit(model, hinge)
    np.testing.assert_array_equal(final.Ts_frame_canonical, still)
    assert final.energies["E_recons"] > 0


def test_labels_are_repaired_unless_switched_off(hinge):
    labels = hinge.canonical_labels.copy()
    flipped = np.random.default_rng(0).choice(400, size=30, replace=False)
    labels[flipped] = 1 - labels[flipped]
    start = parts_of(hinge, labels=labels)
    assert (fit(start, hinge).labels != hinge.canonical_labels).sum() <= 4
    off = CONFIG.model_copy(update={"relabel": False, "points": 400})
    np.testing.assert_array_equal(fit(start, hinge, off).labels, labels)


def test_all_points_have_labels_when_the_fit_works_on_fewer(hinge):
    few = fit(parts_of(hinge, 0.01), hinge, CONFIG.model_copy(update={"points": 120}))
    np.testing.assert_array_equal(few.labels, hinge.canonical_labels)


def test_is_deterministic_and_tells_its_progress(hinge):
    start, steps = parts_of(hinge, 0.02), []
    tell = lambda done, total, *_: steps.append((done, total))  # noqa: E731
    first = compute_final_fit(start, hinge.sequence, hinge.true_flow(), CONFIG, np.random.default_rng(0), tell)
    second = fit(start, hinge, seed=1)
    np.testing.assert_array_equal(first.Ts_frame_canonical, second.Ts_frame_canonical)
    assert steps == [(k, 4) for k in (1, 2, 3, 4)]


def test_coordinates_that_have_lost_their_digits_lower_the_confidence(hinge):
    """The same points taken for a thing of half a metre in geo-referenced coordinates of single precision."""
    sure = fit(parts_of(hinge, 0.02), hinge).confidence
    there = hinge.sequence.replace(scale=0.5, centre=(694386.25, 5155487.5, 381.0))
    coarse = there.to_input(there.points).astype(np.float32).astype(np.float64)
    lost = there.replace(points=(coarse - there.centre) / there.scale)
    labels = hinge.canonical_labels
    model = link_parts(lost.frames()[2], labels, hinge.Ts_frame_canonical, 2, ProjectionConfig())
    assert sure.min() > 0.9
    assert fit(model, hinge, sequence=lost).confidence.max() < 0.5


def test_prices_are_higher_where_few_frames_tell(hinge, monkeypatch):
    """The same parts, of five frames and of two: what two tell is paid as much for each part as nine would."""
    prices = []
    monkeypatch.setattr(stage, "prune", lambda fit, frames, price, iterations: prices.append(price) or fit)
    two = [2, 3]
    sequence = hinge.sequence.replace(
        points=np.concatenate([hinge.sequence.frames()[t] for t in two]),
        point_counts=hinge.sequence.point_counts[two],
        dropped_counts=hinge.sequence.dropped_counts[two],
        frame_names=("a", "b"),
    )
    flow = hinge.true_flow()
    first = int(flow.match_counts[:2].sum())
    part = slice(first, first + int(flow.match_counts[2]))
    flow = flow.replace(
        pair_frames=np.array([[0, 1]]),
        pair_costs=flow.pair_costs[2:3],
        match_counts=flow.match_counts[2:3],
        source_index=flow.source_index[part],
        target_index=flow.target_index[part],
        flow=flow.flow[part],
        confidence=flow.confidence[part],
    )
    Ts = hinge.Ts_frame_canonical[two]
    model = link_parts(sequence.frames()[0], hinge.canonical_labels, Ts, 0, ProjectionConfig())
    fitted = compute_final_fit(model, sequence, flow, CONFIG, np.random.default_rng(0))
    fit(parts_of(hinge), hinge)
    assert sorted(set(prices)) == [9 / 4 * CONFIG.part_price, 9 * CONFIG.part_price]
    assert fitted.part_count == 2


@pytest.mark.parametrize("own_frames", [False, True])
@pytest.mark.parametrize("cameras_known", [False, True])
@pytest.mark.parametrize("frames", [5, 10])
def test_hidden_links_are_not_looked_for_where_too_little_is_seen(hinge, frames, cameras_known, own_frames):
    sequence = hinge.sequence.replace(
        points=np.zeros((frames, 3)),
        point_counts=np.ones(frames, dtype=np.int64),
        dropped_counts=np.zeros(frames, dtype=np.int64),
        frame_names=("",) * frames,
        viewpoints=np.zeros((frames, 1, 3)) if cameras_known else None,
    )
    config = suited_to(FinalFitConfig(), sequence, own_frames)
    assert config.hidden_links == (not cameras_known and not (own_frames and frames == 5))
    assert config.still_root == (0.0 if own_frames else FinalFitConfig().still_root)
    assert not suited_to(FinalFitConfig(hidden_links=False), sequence, own_frames).hidden_links
