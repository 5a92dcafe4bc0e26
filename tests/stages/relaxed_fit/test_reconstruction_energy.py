from itertools import permutations

import numpy as np
import pytest
import torch

from schemas.config import EnergyConfig
from stages.relaxed_fit.reconstruction_energy import ReconstructionEnergy

CONFIG = EnergyConfig(emd_start=0.0, emd_downsampling=1, flow_neighbours=3)


def true_positions(truth, index):
    p = truth.sequence.frames()[2][index]
    Ts = truth.Ts_frame_canonical[:, truth.canonical_labels[index]]
    return np.einsum("tnij,nj->tni", Ts[..., :3, :3], p) + Ts[..., :3, 3]


def naive_chamfer(a, b):
    distances = np.linalg.norm(a[:, None] - b[None], axis=-1)
    return distances.min(1).mean() + distances.min(0).mean()


@pytest.fixture
def energy(hinge):
    return ReconstructionEnergy(hinge.sequence, hinge.true_flow(), 2, CONFIG, points=400, steps=1)


@pytest.fixture
def predicted(hinge, energy):
    noise = np.random.default_rng(0).normal(scale=0.01, size=(5, len(energy.index), 3))
    return true_positions(hinge, energy.index) + noise


def test_chamfer_equals_its_naive_twin(hinge, energy, predicted):
    terms = energy(predicted, 0)
    frames = hinge.sequence.frames()
    expected = np.mean([naive_chamfer(predicted[t], frames[t]) for t in (0, 1, 3, 4)])
    assert float(terms.cd) == pytest.approx(expected, rel=1e-5)


def test_earth_mover_distance_equals_the_best_of_all_permutations(hinge):
    energy = ReconstructionEnergy(hinge.sequence, hinge.true_flow(), 2, CONFIG, points=6, steps=1)
    predicted = true_positions(hinge, energy.index)
    terms = energy(predicted, 0)
    expected = []
    for slot, t in enumerate((0, 1, 3, 4)):
        target = energy._targets[slot]
        squared = {order: ((predicted[t] - target[list(order)]) ** 2).sum() for order in permutations(range(6))}
        best = min(squared, key=squared.get)
        expected.append(np.linalg.norm(predicted[t] - target[list(best)], axis=1).mean())
    assert float(terms.emd) == pytest.approx(np.mean(expected), rel=1e-5)


def test_flow_term_equals_its_naive_twin(hinge, energy, predicted):
    terms = energy(predicted, 0)
    frames, total, count = hinge.sequence.frames(), 0.0, 0.0
    for t, pair in enumerate(hinge.true_flow().pairs()):
        p_source, motion, confidence = frames[t][pair.source_index], pair.flow, pair.confidence
        for x, y in zip(predicted[t], predicted[t + 1], strict=True):
            distance = np.linalg.norm(p_source - x, axis=1)
            near = np.argsort(distance)[:3]
            if distance[near[0]] > energy._flow_reach:
                continue
            weight = 1 / (distance[near] + 1e-8)
            weight /= weight.sum()
            difference = np.linalg.norm(y - x - weight @ motion[near])
            total += (weight @ confidence[near]) * difference
            count += weight @ confidence[near]
    assert float(terms.flow) == pytest.approx(total / count, rel=1e-5)


def test_total_is_the_weighted_sum(energy, predicted):
    terms = energy(predicted, 0)
    assert float(terms.total) == pytest.approx(
        1.0 * float(terms.cd) + 0.3 * float(terms.emd) + 1.0 * float(terms.flow), rel=1e-12
    )


def test_the_truth_has_less_energy_than_stillness_and_gradients_are_finite(hinge, energy):
    true = torch.from_numpy(true_positions(hinge, energy.index)).requires_grad_()
    still = np.tile(energy.p_canonical, (5, 1, 1))
    terms = energy(true, 0)
    assert terms.row()[0] < 0.5 * energy(still, 0).row()[0]
    terms.total.backward()
    assert torch.isfinite(true.grad).all()


def test_arrays_and_tensors_have_the_same_energy(energy, predicted):
    assert energy(predicted, 0).row() == pytest.approx(energy(torch.from_numpy(predicted), 0).row(), rel=1e-12)


def test_emd_joins_in_late(hinge):
    late = ReconstructionEnergy(
        hinge.sequence, hinge.true_flow(), 2, CONFIG.model_copy(update={"emd_start": 0.5}), points=50, steps=10
    )
    predicted = true_positions(hinge, late.index)
    assert float(late(predicted, 4).emd) == 0.0
    assert float(late(predicted, 5).emd) > 0.0


def test_earth_mover_distance_does_not_depend_on_the_order_of_points(hinge):
    frames = hinge.sequence.frames()
    sorted_frames = [frame[np.argsort(frame[:, 0] * (-1) ** t)] for t, frame in enumerate(frames)]
    sequence = hinge.sequence.replace(points=np.concatenate(sorted_frames))
    config = CONFIG.model_copy(update={"emd_downsampling": 4, "lambda_flow": 0.0})
    energy = ReconstructionEnergy(sequence, hinge.true_flow(), 2, config, points=400, steps=1)
    still = np.tile(energy.p_canonical, (5, 1, 1))
    assert float(energy(still, 0).emd) < 0.15


def test_a_pair_without_matches_has_no_flow_term(hinge):
    flow = hinge.true_flow()
    none = flow.replace(
        match_counts=np.zeros(4, dtype=np.int64),
        source_index=flow.source_index[:0],
        target_index=flow.target_index[:0],
        flow=flow.flow[:0],
        confidence=flow.confidence[:0],
    )
    energy = ReconstructionEnergy(hinge.sequence, none, 2, CONFIG, points=100, steps=1)
    still = np.tile(energy.p_canonical, (5, 1, 1))
    assert float(energy(still, 0).flow) == 0.0
