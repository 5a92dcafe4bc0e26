import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from stages.evaluation.roc import area_under_roc


def test_it_agrees_with_another_implementation_ties_included():
    rng = np.random.default_rng(0)
    positive = rng.uniform(size=60) < 0.7
    score = np.round(rng.uniform(size=60) + 0.3 * positive, 1)
    assert area_under_roc(score, positive) == pytest.approx(roc_auc_score(positive, score))


@pytest.mark.parametrize("positive", [[True, True], [False, False], []])
def test_one_class_alone_has_none(positive):
    assert area_under_roc(np.linspace(0, 1, len(positive)), np.array(positive, dtype=bool)) is None
