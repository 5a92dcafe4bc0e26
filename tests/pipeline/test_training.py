import json

import pytest
import torch

from pipeline.presets import TRAINING_FOLDER, load_settings
from pipeline.training import CHECKPOINT, CURVE, LOG, WEIGHTS, train
from schemas.config import TrainFlowConfig
from schemas.errors import InputError
from schemas.training import Measurement
from stages.flow.network.weights import load_network

TINY = [
    "robots=[]",
    "validation_robots=[]",
    "points=256",
    "steps=6",
    "batch=1",
    "validate_every=3",
    "validation_pairs=2",
]


def settings(*overrides):
    return load_settings(TrainFlowConfig, TRAINING_FOLDER, ["smoke"], [*TINY, *overrides])


class Interruption(Exception):
    pass


def test_an_interrupted_training_goes_on_to_the_same_weights(tmp_path):
    def interrupt(line):
        if line.step == 4:
            raise Interruption

    for name in ("whole", "halves"):
        (tmp_path / name).mkdir()
    train(settings(), tmp_path / "whole", None)
    with pytest.raises(Interruption):
        train(settings(), tmp_path / "halves", None, interrupt)
    seen = []
    train(settings(), tmp_path / "halves", None, seen.append)
    assert [line.step for line in seen if not isinstance(line, Measurement)] == [4, 5, 6]
    whole, halves = (load_network(tmp_path / name / WEIGHTS).state_dict() for name in ("whole", "halves"))
    for name, value in whole.items():
        torch.testing.assert_close(halves[name], value)
    lines = [json.loads(line) for line in (tmp_path / "halves" / LOG).read_text().splitlines()]
    assert [line["step"] for line in lines if line["kind"] == "step"] == [1, 2, 3, 4, 5, 6]
    assert [line["step"] for line in lines if line["kind"] == "measurement"] == [3, 6]
    assert (tmp_path / "halves" / CURVE).read_bytes().startswith(b"\x89PNG")


def test_a_checkpoint_of_other_settings_is_refused_and_kept(tmp_path):
    train(settings("steps=1"), tmp_path, None)
    before = (tmp_path / CHECKPOINT).read_bytes()
    with pytest.raises(InputError, match=r"checkpoint\.safetensors: found a training with other settings"):
        train(settings("steps=2"), tmp_path, None)
    assert (tmp_path / CHECKPOINT).read_bytes() == before
