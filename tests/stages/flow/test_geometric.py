import numpy as np
import pytest

from schemas.config import FlowConfig
from schemas.errors import InputError
from stages.flow.pair import mutual_matches
from stages.flow.stage import compute_flow

CONFIG = FlowConfig.model_validate(
    {"estimator": "geometric", "geometric": {"points": 400, "nodes": 80, "iterations": 6}}
)
RNG = np.random.default_rng(0)


def error_of(flow, two_parts):
    """Mean distance between estimated and true flow at the matched points."""
    truth = two_parts.true_flow()
    errors = []
    for pair, true in zip(flow.pairs(), truth.pairs(), strict=True):
        errors.append(np.linalg.norm(pair.flow - true.flow[pair.source_index], axis=1))
    return np.concatenate(errors).mean()


def test_recovers_the_motion_of_a_known_object(two_part_object):
    flow = compute_flow(two_part_object.sequence, CONFIG, RNG)
    true_motion = np.linalg.norm(two_part_object.true_flow().flow, axis=1).mean()
    assert error_of(flow, two_part_object) < 0.3 * true_motion
    assert (flow.match_counts > 0.3 * two_part_object.sequence.point_counts[:-1]).all()


def test_matches_are_one_to_one_and_confidence_is_a_share(hinge):
    flow = compute_flow(hinge.sequence, CONFIG, RNG)
    for pair in flow.pairs():
        assert len(np.unique(pair.source_index)) == len(pair.source_index)
        assert len(np.unique(pair.target_index)) == len(pair.target_index)
        assert ((pair.confidence > 0) & (pair.confidence <= 1)).all()


def test_mutual_matches_keep_only_mutual_and_near_pairs():
    source = np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0]])
    warped = source + [0, 0.1, 0]
    target = np.array([[0.0, 0.1, 0], [0.9, 0.1, 0], [1.05, 0.1, 0]])
    pair = mutual_matches(source, warped, target, spacing=0.1, max_distance=1.0)
    np.testing.assert_array_equal(pair.source_index, [0, 1])
    np.testing.assert_array_equal(pair.target_index, [0, 2])
    np.testing.assert_allclose(pair.flow, [[0, 0.1, 0]] * 2)
    assert pair.confidence[0] > pair.confidence[1]


def test_a_users_own_estimator_is_called_by_its_dotted_path(hinge, tmp_path, monkeypatch):
    (tmp_path / "my_flow.py").write_text(
        "import numpy as np\n"
        "from stages.flow.pair import PairFlow\n"
        "def still(frames, config, rng, progress):\n"
        "    i = np.arange(3)\n"
        "    return [PairFlow(i, i, np.zeros((3, 3)), np.ones(3)) for _ in frames[1:]]\n"
        "def too_few(frames, config, rng, progress):\n"
        "    return []\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    flow = compute_flow(hinge.sequence, FlowConfig(estimator="my_flow:still"), RNG)
    np.testing.assert_array_equal(flow.match_counts, [3] * 4)
    with pytest.raises(ValueError, match="expected 4"):
        compute_flow(hinge.sequence, FlowConfig(estimator="my_flow:too_few"), RNG)


@pytest.mark.parametrize("name", ["geometrical", "no_such_module:function", "stages.flow.pair:nothing"])
def test_an_unknown_estimator_is_refused_by_name(hinge, name):
    with pytest.raises(InputError, match=r"flow\.estimator.*" + name.split(":")[0]):
        compute_flow(hinge.sequence, FlowConfig(estimator=name), RNG)


def test_the_estimator_none_matches_nothing(hinge):
    flow = compute_flow(hinge.sequence, FlowConfig(estimator="none"), RNG)
    np.testing.assert_array_equal(flow.match_counts, np.zeros(4))
    assert len(flow.flow) == 0
