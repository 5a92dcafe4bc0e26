"""The protocol between the command line and its engine process: one request, then a stream of events."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from schemas.artifact import Schema
from schemas.config import PipelineConfig

MESSAGE_LIMIT = 500  # characters of up to six bytes, so that an event's line stays below PIPE_BUF


class Request(Schema):
    """A request to compute every final artifact of these sequences."""

    dataset: str
    workdir: Path
    config: PipelineConfig
    data: Path | None = Field(default=None, description="a folder of sequences, where the source reads files")
    frames: Path | None = Field(default=None, description="one sequence's frames, instead of a whole dataset")
    truth: Path | None = Field(default=None, description="the ground truth of `frames`")
    sequences: tuple[str, ...] | None = Field(default=None, description="only these")
    workers: int = Field(default=1, ge=1)
    rerun: str | None = Field(default=None, description="compute this stage and all after it anew")


class Event(Schema):
    """An event of one task, or of the whole run if `sequence` is empty."""

    kind: Literal["refused", "planned", "started", "progress", "warning", "finished", "failed"]
    sequence: str = ""
    task: str = ""
    artifact: str = ""
    complete: bool = False
    origin: dict[str, str] = Field(default={}, description="what a planned sequence shows, from `plan.origin_of`")
    done: int = 0
    total: int = 0
    energy: float | None = None
    seconds: float = 0.0
    message: str = ""
    bad_input: bool = False

    @field_validator("message")
    @classmethod
    def _sendable(cls, message: str) -> str:
        """Shorten a message to fit a line, and escape bytes in file names that are not text."""
        return message.encode("utf-8", "backslashreplace").decode()[:MESSAGE_LIMIT]


Listener = Callable[[Event], None]


def ignore(event: Event) -> None:
    """A listener that drops every event."""


def write_to_pipe(handle: int) -> Listener:
    """Make a listener that writes JSON lines to a pipe.

    An `os.write` below PIPE_BUF (4096 bytes) is atomic, so workers share the pipe without a lock, which a killed worker
    might never release. The process ends if the pipe has no reader any more.
    """

    def notify(event: Event) -> None:
        try:
            os.write(handle, event.model_dump_json().encode() + b"\n")
        except BrokenPipeError:
            os._exit(1)

    return notify
