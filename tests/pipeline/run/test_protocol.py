import math
import os

import pytest

from pipeline.run.protocol import Event, Request, write_to_pipe
from schemas.config import PipelineConfig

PIPE_BUF = 4096


@pytest.fixture
def pipe():
    reading, writing = os.pipe()
    yield reading, writing
    os.close(reading)
    os.close(writing)


def test_an_event_arrives_as_it_was_sent(pipe):
    event = Event(kind="progress", sequence="box", task="flow", done=3, total=7, energy=math.inf, message='a "b"\nü')
    write_to_pipe(pipe[1])(event)
    assert Event.model_validate_json(os.read(pipe[0], PIPE_BUF)) == event


@pytest.mark.parametrize("letter", ["x", "\n", '"', "€", "𝄞", "\x00"])
def test_the_longest_event_is_written_in_one_piece(pipe, letter, monkeypatch):
    written = []
    monkeypatch.setattr(os, "write", lambda handle, data: written.append(data))
    name = "s" * 255
    write_to_pipe(pipe[1])(Event(kind="failed", sequence=name, task=name, artifact=name, message=letter * 10_000))
    assert len(written) == 1
    assert len(written[0]) <= PIPE_BUF
    assert written[0].count(b"\n") == 1
    assert Event.model_validate_json(written[0]).message.startswith(letter * 100)


def test_a_request_survives_the_way_to_the_engine(tmp_path):
    request = Request(dataset="scans", workdir=tmp_path, config=PipelineConfig(seed=5), sequences=("a",), workers=2)
    assert Request.model_validate_json(request.model_dump_json()) == request
