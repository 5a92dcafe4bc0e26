import numpy as np
import pytest
import torch

from schemas.config import FinalFitConfig, ProjectionConfig
from stages.final_fit import decide_joint_types, fit_final
from stages.kernels.screw import screw_transform
from stages.projection import link_parts

CONFIG = FinalFitConfig.model_validate(
    {"iterations": 60, "points": 300, "energy": {"neighbours_every": 5, "emd_every": 30, "emd_start": 0}}
)


def disturbed(truth, size=0.02, seed=0):
    """The true parts with noisy motions, as a relaxed fit would leave them."""
    rng = np.random.default_rng(seed)
    Ts = truth.Ts_frame_canonical.copy()
    for t in (0, 1, 3, 4):
        Ts[t, 1, :3, 3] += rng.normal(scale=size, size=3)
    return link_parts(truth.sequence.frames()[2], truth.canonical_labels, Ts, 2, ProjectionConfig())


@pytest.mark.parametrize(("name", "kind", "free"), [("hinge", "revolute", 0), ("drawer", "prismatic", 1)])
def test_finds_type_axis_and_states(name, kind, free, request):
    truth = request.getfixturevalue(name)
    start = disturbed(truth)
    model = fit_final(start, truth.sequence, truth.true_flow(), CONFIG, np.random.default_rng(0))
    assert model.joint_types == (kind,)
    assert np.all(model.states[0, :, 1 - free] == 0)
    assert abs(model.axis[0] @ truth.axis) > np.cos(np.radians(3))
    sign = np.sign(model.axis[0] @ truth.axis)
    np.testing.assert_allclose(sign * model.states[0, :, free], truth.states[:, free], atol=0.04)
    if kind == "revolute":
        offset = np.cross(model.point[0] - truth.point, truth.axis)
        assert np.linalg.norm(offset) < 0.02


def test_motions_are_those_of_forward_kinematics(hinge):
    model = fit_final(disturbed(hinge), hinge.sequence, hinge.true_flow(), CONFIG, np.random.default_rng(0))
    Ts = screw_transform(
        *(torch.from_numpy(v[0]) for v in (model.axis, model.point)),
        *torch.from_numpy(model.states[0]).unbind(-1),
    ).numpy()
    np.testing.assert_allclose(model.Ts_frame_canonical[:, 1], Ts, atol=1e-12)
    np.testing.assert_array_equal(model.Ts_frame_canonical[:, 0], np.tile(np.eye(4), (5, 1, 1)))
    np.testing.assert_array_equal(model.states[:, 2], 0)
    assert np.linalg.norm(model.axis[0]) == pytest.approx(1)
    assert model.axis[0] @ model.point[0] == pytest.approx(0, abs=1e-12)


def test_the_fit_lowers_the_energy(hinge):
    start = disturbed(hinge, 0.03)
    short = fit_final(
        start, hinge.sequence, hinge.true_flow(), CONFIG.model_copy(update={"iterations": 1}), np.random.default_rng(0)
    )
    long = fit_final(start, hinge.sequence, hinge.true_flow(), CONFIG, np.random.default_rng(0))
    assert long.energies["E_recons"] < short.energies["E_recons"]


def test_joint_type_does_not_depend_on_the_units(two_part_object):
    truth = two_part_object
    kinds = []
    for scale in (1.0, 1000.0):
        Ts = truth.Ts_frame_canonical.copy()
        Ts[..., :3, 3] *= scale
        p = truth.sequence.frames()[2] * scale
        model = link_parts(p, truth.canonical_labels, Ts, 2, ProjectionConfig())
        kinds.append(decide_joint_types(model, p, 50).joint_types)
    assert kinds[0] == kinds[1]


def test_a_moving_base_is_followed(hinge):
    drift = np.linspace(-0.2, 0.2, 5)
    frames = [p + [0, x, 0] for p, x in zip(hinge.sequence.frames(), drift, strict=True)]
    sequence = hinge.sequence.replace(points=np.concatenate(frames))
    Ts = hinge.Ts_frame_canonical.copy()
    Ts[:, :, 1, 3] += drift[:, None]
    flow = hinge.true_flow()
    flow = flow.replace(flow=flow.flow + [0, 0.1, 0])
    model = link_parts(sequence.frames()[2], hinge.canonical_labels, Ts, 2, ProjectionConfig())
    final = fit_final(model, sequence, flow, CONFIG, np.random.default_rng(0))
    np.testing.assert_allclose(final.Ts_frame_canonical[:, final.root, 1, 3], drift, atol=0.02)


def test_one_part_that_stands_still_needs_no_fit(hinge):
    still = np.tile(np.eye(4), (5, 1, 1, 1))
    model = link_parts(hinge.sequence.frames()[2], np.zeros(400, dtype=int), still, 2, ProjectionConfig())
    final = fit_final(model, hinge.sequence, hinge.true_flow(), CONFIG, np.random.default_rng(0))
    np.testing.assert_array_equal(final.Ts_frame_canonical, still)
    assert final.energies["E_recons"] > 0
