import itertools

import pytest
import torch

from schemas.config import TrainFlowConfig
from schemas.errors import InputError
from stages.flow.training.learning import Batch
from stages.flow.training.loop import Learner, learn
from stages.flow.training.source import PairSource

CONFIG = TrainFlowConfig(robots=(), validation_robots=(), points=128, steps=3, batch=1, validate_every=2)


@pytest.fixture(scope="module")
def batch():
    return Batch.of([PairSource(CONFIG)[0]])


def test_every_batch_is_a_step_and_some_steps_are_measured(batch):
    seconds = itertools.count()
    lines = list(learn(Learner.start(CONFIG), [batch] * 3, [batch], lambda: next(seconds)))
    assert [(line.kind, line.step) for line in lines] == [
        ("step", 1),
        ("step", 2),
        ("measurement", 2),
        ("step", 3),
        ("measurement", 3),
    ]
    assert [line.seconds for line in lines] == [0, 1, 2, 3, 4]


def test_a_restored_learner_takes_the_same_next_step(batch):
    first, again = Learner.start(CONFIG), Learner.start(CONFIG)
    list(learn(first, [batch], [], lambda: 0.0))
    again.restore({name: value.clone() for name, value in first.state().items()}, "1", "a checkpoint")
    states = []
    for learner in (first, again):
        next(learn(learner, [batch], [], lambda: 0.0))
        states.append(learner.state())
    assert states[0].keys() == states[1].keys()
    assert all(torch.equal(value, states[1][name]) for name, value in states[0].items())


def test_a_state_that_does_not_fit_is_refused_by_its_origins_name(batch):
    learner = Learner.start(CONFIG)
    list(learn(learner, [batch], [], lambda: 0.0))
    with pytest.raises(InputError, match=r"^a checkpoint: found step '9'"):
        Learner.start(CONFIG).restore(learner.state(), "9", "a checkpoint")
