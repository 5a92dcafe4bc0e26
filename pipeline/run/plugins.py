"""A user's own parts of stages: functions, named `package.module:function`, and weights."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import sys
from importlib.machinery import PathFinder
from multiprocessing.connection import Connection
from pathlib import Path

from pipeline.run.processes import die_with_forking_parent
from schemas.config import PipelineConfig
from schemas.errors import InputError
from schemas.seal import file_sha256


def own_code(name: str) -> dict[str, str]:
    """The digest of the file of a user's own function, by the function's name; empty for one of ours.

    The file is found as an import would find it, with the current folder last, but nothing is imported.
    """
    module, separator, _ = name.partition(":")
    file = _source_file(module.split(".")) if separator else None
    return {} if file is None else {name: _digest(file)}


def own_weights(path: Path | None) -> dict[str, str]:
    """The digest of a file of weights, by its path; empty if there is no file."""
    return {} if path is None or not os.path.isfile(path) else {str(path): _digest(path)}


def _digest(path: Path) -> str:
    """SHA-256 (hex) of a file. Raises InputError if it cannot be read."""
    try:
        return file_sha256(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error


def check_plugins(config: PipelineConfig) -> None:
    """Raise InputError if a swappable part cannot be used, before hours of computing.

    A child process looks the part up, because importing the user's module may do anything and the engine must remain
    able to fork. Our own default parts need no check.
    """
    if _swappable(config) == _swappable(PipelineConfig()):
        return
    receiver, sender = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.Process(target=_resolve, args=(config, sender))
    child.start()
    sender.close()
    try:
        problem = receiver.recv()
    except EOFError:
        problem = None  # the module crashed its process; the stage reports that, with a log
    child.join()
    if problem:
        raise InputError(problem)


def _swappable(config: PipelineConfig) -> tuple[str | Path | None, ...]:
    return config.flow.estimator, config.flow.network.weights, config.relaxed_fit.solver


def _resolve(config: PipelineConfig, answer: Connection) -> None:
    from stages.support.registry import resolve

    die_with_forking_parent()
    parts = (
        ("flow.estimator", config.flow.estimator, "stages.flow.stage", "ESTIMATORS"),
        ("relaxed_fit.solver", config.relaxed_fit.solver, "stages.relaxed_fit.stage", "SOLVERS"),
    )
    problem = None
    try:
        for setting, name, module, registry in parts:
            resolve(setting, name, getattr(importlib.import_module(module), registry))
        if (weights := config.flow.network.weights) is not None:
            importlib.import_module("stages.flow.network.weights").load_network(weights)
    except InputError as error:
        problem = str(error)
    answer.send(problem)


def _source_file(module: list[str]) -> Path | None:
    search: list[str] = [*sys.path, os.getcwd()]
    file = None
    for depth in range(1, len(module) + 1):
        spec = PathFinder.find_spec(".".join(module[:depth]), search)
        if spec is None:
            return None
        file, search = spec.origin, list(spec.submodule_search_locations or ())
    return Path(file) if file and Path(file).is_file() else None
