from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from schemas.config import TrainFlowConfig
from stages.flow.training.learning import Batch, matching_loss, score, turned
from stages.flow.training.pairs import make_pair
from stages.flow.training.shapes import random_shape


class ReadsPlaces(nn.Module):
    """A network whose features tell places apart as well as can be: dot products fall with distance."""

    def __init__(self, sharpness):
        super().__init__()
        self.sharpness = sharpness

    def forward(self, clouds):
        p = clouds.queries
        ones, squares = torch.ones_like(p[..., :1]), p.square().sum(-1, keepdim=True)
        half = len(p) // 2
        # f_first . f_second = -sharpness |p - q|^2
        first = torch.cat([2 * p, -ones, -squares], dim=-1)[:half]
        second = torch.cat([p, squares, ones], dim=-1)[half:]
        return self.sharpness * torch.cat([first, second])


@pytest.fixture
def still_batch():
    """Twice the same cloud."""
    rng = np.random.default_rng(0)
    pair = make_pair(random_shape(rng), TrainFlowConfig(points=600), rng)
    index = np.arange(len(pair.match_first))
    same = replace(pair, second=pair.first, match_first=index, match_second=index)
    return Batch.of([replace(same, known_first=index >= 0, known_second=index >= 0)])


def test_a_perfect_network_scores_all_and_a_blind_one_nothing(still_batch):
    perfect, blind = (score(ReadsPlaces(sharpness), [still_batch]) for sharpness in (1e5, 0.0))
    assert perfect.right == pytest.approx(1)
    assert perfect.mutual_right == pytest.approx(1)
    assert blind.right < 0.2
    assert blind.loss == pytest.approx(np.log(still_batch.match.shape[1]), rel=1e-5)
    assert matching_loss(ReadsPlaces(1e5), still_batch) < matching_loss(ReadsPlaces(1.0), still_batch)


def test_turning_keeps_shapes_and_turns_one_cloud_of_a_pair_by_no_more_than_asked(still_batch):
    out = turned(still_batch, 20.0, np.random.default_rng(0))
    first, second = out.clouds.queries
    before = still_batch.clouds.queries[0]
    torch.testing.assert_close(torch.cdist(first, first), torch.cdist(before, before), atol=1e-3, rtol=0)
    turn = torch.linalg.lstsq(first, second).solution
    assert 0 < np.degrees(np.arccos((np.trace(turn.numpy()) - 1) / 2)) <= 20.01
    torch.testing.assert_close(out.clouds.invariants, still_batch.clouds.invariants)
