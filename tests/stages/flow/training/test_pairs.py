import numpy as np
import pytest

from schemas.config import TrainFlowConfig
from stages.flow.training.pairs import draw_positions, make_pair
from stages.flow.training.shapes import random_shape

CONFIG = TrainFlowConfig(points=1024)


@pytest.mark.parametrize("seed", range(3))
def test_matches_are_where_the_true_motion_leads(seed):
    """Where nothing moves, points match what is nearest to them; noise, holes and views leave most with a match."""
    rng = np.random.default_rng(seed)
    shape = random_shape(rng)
    still = CONFIG.model_copy(update={"step_degrees": (1e-6, 2e-6)})
    pair = make_pair(shape, still, rng)
    first, second = pair.first.points + 0.0, pair.second.points
    offset = (second[pair.match_first] - first)[pair.known_first]
    offset -= np.median(offset, axis=0)  # each cloud is about its own mean
    assert np.median(np.linalg.norm(offset, axis=1)) < 0.03
    assert pair.known_first.mean() > 0.3


def test_matches_go_both_ways():
    rng = np.random.default_rng(1)
    pair = make_pair(random_shape(rng), CONFIG, rng)
    there_and_back = pair.match_second[pair.match_first]
    step = np.linalg.norm(pair.first.points[there_and_back] - pair.first.points, axis=1)
    both = pair.known_first & pair.known_second[pair.match_first]
    assert np.median(step[both]) < 0.03


def test_joints_stay_within_their_limits_and_turn_by_no_more_than_asked():
    rng = np.random.default_rng(2)
    shape = random_shape(rng)
    for _ in range(20):
        here, there = draw_positions(shape, CONFIG, rng)
        assert np.all((here >= shape.ranges[:, 0]) & (there >= shape.ranges[:, 0] - 1e-9))
        assert np.all((here <= shape.ranges[:, 1]) & (there <= shape.ranges[:, 1] + 1e-9))
        assert np.all(np.abs(there - here)[shape.turning] <= np.radians(1.2 * CONFIG.step_degrees[1]) + 1e-9)
