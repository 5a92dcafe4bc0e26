import json
import random
import re
import shutil
import signal
from pathlib import Path

import pytest
import torch

from pipeline.configuration.presets import TRAINING_FOLDER, load_settings
from pipeline.training import batches as maker
from pipeline.training.batches import MakerDied, batches
from pipeline.training.folder import CHECKPOINT, CURVE, LOG, WEIGHTS, resume, save, train
from schemas.config import TrainFlowConfig
from schemas.errors import InputError
from schemas.training import Measurement, Step
from stages.flow.network.weights import load_network, read_safetensors, safetensors_bytes
from stages.flow.training.learning import Batch
from stages.flow.training.loop import Learner, descend
from stages.flow.training.source import PairSource

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
    shared_memory = set()

    def look(line):
        shared_memory.update(re.findall("/dev/shm/.*", Path("/proc/self/maps").read_text()))

    train(settings("steps=1"), tmp_path, None, look)
    assert not shared_memory  # it would be left there where all processes are killed at once
    before = (tmp_path / CHECKPOINT).read_bytes()
    with pytest.raises(InputError, match=r"checkpoint\.safetensors: found a training with other settings"):
        train(settings("steps=2"), tmp_path, None)
    assert (tmp_path / CHECKPOINT).read_bytes() == before


@pytest.fixture(scope="module")
def one_step(tmp_path_factory):
    """A folder with the checkpoint and the log of one step."""
    folder = tmp_path_factory.mktemp("one_step")
    learner = Learner.start(settings())
    loss = descend(learner, Batch.of([PairSource(settings())[0]]))
    learner.step = 1
    save(learner, [Step(step=1, loss=loss, learning_rate=1e-3, seconds=1.0)], folder)
    return folder


@pytest.fixture
def folder(one_step, tmp_path):
    shutil.copytree(one_step, tmp_path, dirs_exist_ok=True)
    return tmp_path


def refusal(folder):
    with pytest.raises(InputError) as caught:
        resume(settings(), folder)
    message = str(caught.value)
    assert message.startswith(f"{folder / CHECKPOINT}: ")
    assert f"remove {folder / CHECKPOINT} to begin anew" in message
    return message


def test_a_sound_checkpoint_is_gone_on_with(folder):
    learner, log = resume(settings(), folder)
    assert (learner.step, len(log)) == (1, 1)


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:7],
        lambda content: content[: len(content) // 2],
        lambda content: content[:-1],
        lambda content: content + b"x",
        lambda content: b"\xff" * 8 + content[8:],
        lambda content: content.replace(b"network.head.bias", b"network.head.bios"),
        lambda content: content.replace(b'"step":"1"', b'"step":"2"'),
        lambda content: content.replace(b'"digest"', b'"digets"'),
        lambda content: content.replace(b"training 2", b"training 3"),
    ],
)
def test_a_damaged_checkpoint_is_refused_by_name_and_kept(folder, damage):
    path = folder / CHECKPOINT
    path.write_bytes(damage(path.read_bytes()))
    before = path.read_bytes()
    refusal(folder)
    assert path.read_bytes() == before


def test_a_flipped_byte_anywhere_in_a_checkpoint_is_found(folder):
    rng, path = random.Random(0), folder / CHECKPOINT
    content = path.read_bytes()
    header = content.index(b"}}") + 2  # what follows to the data are spaces
    places = [rng.randrange(header) for _ in range(6)] + [rng.randrange(header + 8, len(content)) for _ in range(6)]
    for place in places:
        changed = bytearray(content)
        changed[place] ^= 1 << rng.randrange(8)
        path.write_bytes(changed)
        with pytest.raises(InputError):
            resume(settings(), folder)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda tensors, notes: tensors.pop("network.head.bias"), "found no head.bias"),
        (lambda tensors, notes: tensors.update({"network.more": torch.zeros(2)}), "found more"),
        (lambda tensors, notes: tensors["network.head.bias"].fill_(torch.nan), "head.bias: found NaN"),
        (lambda tensors, notes: tensors.update({"network.head.bias": torch.zeros(3)}), "head.bias: found shape"),
        (lambda tensors, notes: tensors.pop("optimizer.0.exp_avg"), "found no momenta of some parameters"),
        (lambda tensors, notes: tensors["optimizer.0.exp_avg"].fill_(torch.inf), "optimizer.0.exp_avg: found what"),
        (lambda tensors, notes: tensors.update({"optimizer.0.exp_avg": torch.zeros(3)}), "optimizer.0.exp_avg: found"),
        (lambda tensors, notes: tensors.update({"optimizer.9999.step": torch.zeros(())}), "optimizer.9999.step: found"),
        (lambda tensors, notes: tensors.update({"optimizer.x.step": torch.zeros(())}), "optimizer.x.step: found"),
        (lambda tensors, notes: notes.update({"step": "7"}), "found step '7', expected one of 1..6"),
        (lambda tensors, notes: notes.update({"step": "-1"}), "found step '-1'"),
        (lambda tensors, notes: notes.pop("config"), "config or step"),
    ],
)
def test_a_checkpoint_that_does_not_fit_the_network_is_refused(folder, change, complaint):
    path = folder / CHECKPOINT
    tensors, notes = read_safetensors(path, "rearticulate flow training 2")
    change(tensors, notes)
    path.write_bytes(safetensors_bytes(tensors, notes))
    assert complaint in refusal(folder)


def test_a_folder_in_a_checkpoints_place_is_refused(tmp_path):
    (tmp_path / CHECKPOINT).mkdir()
    refusal(tmp_path)


@pytest.mark.parametrize("content", [None, b"", b"nonsense\n\xff\n{}\n"])
def test_no_training_is_lost_for_its_log(folder, content):
    (folder / LOG).unlink()
    if content is not None:
        (folder / LOG).write_bytes(content)
    learner, log = resume(settings(), folder)
    assert (learner.step, log) == (1, [])


def test_a_network_that_gets_lost_is_refused_and_the_checkpoint_kept(folder, monkeypatch):
    before = (folder / CHECKPOINT).read_bytes()
    monkeypatch.setattr("pipeline.training.folder.batches", lambda *args: iter([None]))
    monkeypatch.setattr("stages.flow.training.loop.descend", lambda learner, batch: float("nan"))
    with pytest.raises(InputError, match=r"^step 2: found a loss of nan, .*lower learning_rate"):
        train(settings(), folder, None)
    assert (folder / CHECKPOINT).read_bytes() == before


class ThisProcess:
    """Stands in for multiprocessing's context: the maker's end is already closed, as after a kill."""

    exitcode = -signal.SIGKILL

    def Pipe(self, duplex):
        return maker.multiprocessing.Pipe(duplex)

    def Process(self, **kwargs):
        return self

    def start(self):
        pass

    kill = join = start


def test_a_killed_maker_of_pairs_is_told(monkeypatch):
    monkeypatch.setattr(maker.multiprocessing, "get_context", lambda method: ThisProcess())
    with pytest.raises(MakerDied, match="killed by SIGKILL"):
        next(batches(PairSource(settings()), settings(), 0))
