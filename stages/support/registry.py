"""Swappable parts of stages: a name from a registry, or a user's own function by its dotted path."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from pydantic import ValidationError

from schemas.errors import InputError, first_fault


def resolve(setting: str, name: str, registry: Mapping[str, Callable[..., Any]]) -> Callable[..., Any]:
    """The function that `name` stands for: a registry entry or `package.module:function`.

    Raises InputError, naming `setting`, for an unknown name, and for a path that cannot be imported, whatever the
    user's module does.
    """
    if name in registry:
        return registry[name]
    module_name, separator, function_name = name.partition(":")
    if not separator:
        raise InputError(
            f"{setting}: found {name!r}, expected one of {', '.join(sorted(registry))} "
            "or a dotted path package.module:function"
        )
    try:
        function = getattr(importlib.import_module(module_name), function_name)
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"{setting}: cannot import {name!r} ({error}); "
            "check the path, and that its folder is the current one or on PYTHONPATH"
        ) from error
    except (Exception, SystemExit) as error:
        raise InputError(f"{setting}: cannot import {name!r} ({error!r}); correct that module") from error
    if not callable(function):
        raise InputError(f"{setting}: {name!r} is a {type(function).__name__}, expected a function")
    return function


@contextmanager
def blaming(setting: str, name: str) -> Iterator[None]:
    """Put the setting before what a schema says of the result of the function that it names, in one line."""
    try:
        yield
    except ValidationError as error:
        raise ValueError(f"{setting} {name!r}: {first_fault(error, error.title)}") from error
