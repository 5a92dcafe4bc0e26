"""Made-up hinges, fitted by all stages with a coarse flow: a few seconds in all."""

import numpy as np
import pytest

from pipeline.configuration.presets import load_config

COARSE = [
    "flow.estimator=geometric",
    "flow.geometric.nodes=60",
    "relaxed_fit.alternating.patches=60",
    "canonical_frame.candidates=1",
]


@pytest.fixture
def benchmark(load_benchmark):
    return load_benchmark("hinges")


@pytest.mark.parametrize("body", ["plates", "boxes", "laptop", "scissors", "door", "drawer", "cabinet"])
def test_a_body_is_rigid_parts_moved_by_its_joints(benchmark, body):
    made = benchmark.BODIES[body]
    at = benchmark.states(made, 30, 5, np.random.default_rng(0))
    lows, highs = (np.array([getattr(joint, end) for joint in made.joints]) for end in ("low", "high"))
    assert np.all((lows - 1e-9 <= at.T) & (highs + 1e-9 >= at.T))
    Ts = benchmark.motions(made, at[:, 1])
    np.testing.assert_allclose(np.linalg.det(Ts[:, :3, :3]), 1)
    for joint, T in zip(made.joints, Ts[1:], strict=True):
        if joint.revolute and joint.parent == 0:
            np.testing.assert_allclose(T[:3, :3] @ joint.point + T[:3, 3], joint.point, atol=1e-12)


def test_cases_are_the_same_every_time(benchmark):
    case = benchmark.few_states()[0]
    for first, second in zip(*(benchmark.make(case)[0] for _ in range(2)), strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("body", "step", "counts"),
    [
        ("plates", 60, (300, 300)),  # two far states: a sliver at the hinge is borne out by noise only
        ("scissors", 60, (400, 400)),
        ("plates", 30, (400, 1600, 50)),  # the densest frame is no canonical one
    ],
)
def test_two_parts_are_two_parts(benchmark, body, step, counts):
    case = benchmark.Case(body, step, counts)
    frames, labels = benchmark.make(case)
    outcome = benchmark.measure(case, benchmark.fit(frames, load_config(["scans"], COARSE)), labels, 0.0)
    assert outcome.parts == outcome.true_parts
    assert outcome.ari > 0.75
    assert "WRONG" not in outcome.line()
