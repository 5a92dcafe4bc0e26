import numpy as np
import pytest
import torch
from sklearn.metrics import adjusted_rand_score

from schemas.config import RelaxedFitConfig
from schemas.relaxed import RelaxedModel
from stages.flow.trajectories import follow_flow
from stages.relaxed_fit.gumbel import _cosine, _straight_through_labels
from stages.relaxed_fit.stage import compute_relaxed_fit
from stages.relaxed_fit.start import start_from_flow


def config(**gumbel):
    settings = {"max_parts": 4, "iterations": 60, "points": 300, "hidden": 64} | gumbel
    return RelaxedFitConfig.model_validate({"solver": "gumbel", "gumbel": settings, "energy": {"neighbours_every": 5}})


def fit(truth, seed=0, **gumbel):
    return compute_relaxed_fit(truth.sequence, truth.true_flow(), 2, config(**gumbel), np.random.default_rng(seed))


def reconstruction_error(model, truth):
    p = truth.sequence.frames()[2]

    def place(Ts, labels):
        T_points = Ts[:, labels]
        return np.einsum("tnij,nj->tni", T_points[..., :3, :3], p) + T_points[..., :3, 3]

    true = place(truth.Ts_frame_canonical, truth.canonical_labels)
    return np.linalg.norm(place(model.Ts_frame_canonical, model.labels) - true, axis=-1).mean()


def test_explains_a_known_object(two_part_object):
    model = fit(two_part_object)
    assert reconstruction_error(model, two_part_object) < 0.02
    # a part may come in pieces before merging, but no piece may span two bodies
    for part in np.unique(model.labels):
        share = two_part_object.canonical_labels[model.labels == part].mean()
        assert min(share, 1 - share) < 0.1


def test_learns_from_still_parts_as_published(drawer):
    still = fit(drawer, start="identity", iterations=1)
    learned = fit(drawer, start="identity", iterations=400)
    assert reconstruction_error(learned, drawer) < 0.7 * reconstruction_error(still, drawer)


def test_the_canonical_frame_does_not_move_and_labels_are_dense(hinge):
    model = fit(hinge)
    np.testing.assert_array_equal(model.Ts_frame_canonical[2], np.tile(np.eye(4), (model.labels.max() + 1, 1, 1)))
    np.testing.assert_array_equal(np.unique(model.labels), np.arange(model.Ts_frame_canonical.shape[1]))
    R = model.Ts_frame_canonical[..., :3, :3]
    np.testing.assert_allclose(R @ R.swapaxes(-1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-9)


def test_same_seed_same_model_other_seed_other_model(hinge):
    first, second, other = fit(hinge), fit(hinge), fit(hinge, seed=1)
    np.testing.assert_array_equal(first.Ts_frame_canonical, second.Ts_frame_canonical)
    np.testing.assert_array_equal(first.labels, second.labels)
    assert (first.Ts_frame_canonical != other.Ts_frame_canonical).any()


def test_start_from_true_flow_is_nearly_the_answer(two_part_object):
    p = two_part_object.sequence.frames()[2]
    trajectories = follow_flow(p, two_part_object.sequence, two_part_object.true_flow(), 2, 1)
    start = start_from_flow(p, trajectories, 2)
    assert adjusted_rand_score(two_part_object.canonical_labels, start.labels) > 0.9


def test_straight_through_labels_are_one_hot_with_soft_gradients():
    logits = torch.tensor([[5.0, 0, 0], [0, 5, 0]], dtype=torch.float64, requires_grad=True)
    generator = torch.Generator().manual_seed(0)
    labels = _straight_through_labels(logits, 1.0, generator)
    values = labels.detach().numpy()
    np.testing.assert_allclose(values.sum(1), 1)
    np.testing.assert_allclose(values.max(1), 1)
    (labels * torch.arange(3)).sum().backward()
    assert (logits.grad != 0).any()


def test_temperature_falls_from_start_to_end():
    assert _cosine(5, 1, 0) == 5
    assert _cosine(5, 1, 0.5) == pytest.approx(3)
    assert _cosine(5, 1, 1) == pytest.approx(1)


def test_a_users_own_solver_is_called(hinge, tmp_path, monkeypatch):
    (tmp_path / "my_solver.py").write_text(
        "import numpy as np\n"
        "from schemas.relaxed import RelaxedModel\n"
        "def one_part(sequence, flow, canonical_frame, config, rng, progress):\n"
        "    points = int(sequence.point_counts[canonical_frame])\n"
        "    Ts = np.tile(np.eye(4), (sequence.frame_count, 1, 1, 1))\n"
        "    return RelaxedModel(canonical_frame=canonical_frame, labels=np.zeros(points, dtype=np.int64),\n"
        "        Ts_frame_canonical=Ts, energy_history=np.zeros((0, 4)), solver='mine', iterations=0)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    model = compute_relaxed_fit(
        hinge.sequence, hinge.true_flow(), 2, RelaxedFitConfig(solver="my_solver:one_part"), np.random.default_rng(0)
    )
    assert model.solver == "mine"


def of_one_label(parts, energy_history):
    """A model of 400 points that all belong to part 0."""
    return RelaxedModel(
        canonical_frame=2,
        labels=np.zeros(400, dtype=np.int64),
        Ts_frame_canonical=np.tile(np.eye(4), (5, parts, 1, 1)),
        energy_history=energy_history,
        solver="mine",
        iterations=0,
    )


def test_a_solver_that_leaves_a_part_without_points_is_refused():
    with pytest.raises(ValueError, match="every part"):
        of_one_label(2, np.zeros((0, 4)))


def test_a_solvers_energies_have_names():
    with pytest.raises(ValueError, match="found 1 columns, expected one for each of E_recons, E_CD, E_EMD, E_flow"):
        of_one_label(1, np.zeros((3, 1)))
