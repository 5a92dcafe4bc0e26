"""Configurations from presets (TOML files, where later ones override earlier ones) and single settings."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from pipeline.configuration.listing import all_settings
from pipeline.store.files import read_whole
from schemas.artifact import Schema
from schemas.config import PipelineConfig
from schemas.errors import Fault, InputError

FOLDER = Path(__file__).parent / "presets"
TRAINING_FOLDER = FOLDER / "train_flow"
# presets that define a source of sequences, and presets of how sequences are made from descriptions
BUILT = ("roboart", "urdf")
CONDITIONS = ("noisy", "partial", "free", "states", "phone", "depth", "shuffled", "turned", "rough")
# roboart-noisy is the data set of the presets roboart and noisy
DATASETS = (
    *BUILT,
    *(f"{source}-{condition}" for source in BUILT for condition in CONDITIONS),
    "sapien",
    "scans",
    "humans",
    "dfaust",
)
BODIES = ("humans", "dfaust")  # on top of the preset bodies
DEEPEST = 10  # nested tables; no setting is as deep, and deeper ones may exhaust the stack
LONGEST_SHOWN = 100  # characters of a value that cannot be used

AnySchema = TypeVar("AnySchema", bound=Schema)
Options = Mapping[str, tuple[str, Any]]  # option of the command line -> (its setting, its value)


def dataset_presets(dataset: str) -> list[str]:
    """The presets that make a data set, from the general to the special. Raises InputError for an unknown one."""
    if dataset not in DATASETS:
        raise InputError(f"--dataset: found {dataset!r}, expected one of {', '.join(DATASETS)}")
    source, _, condition = dataset.partition("-")
    return [source, *(["bodies"] if dataset in BODIES else []), *([condition] if condition else [])]


def load_config(
    presets: Sequence[str], overrides: Iterable[str] = (), options: Options | None = None
) -> PipelineConfig:
    """Load a run's configuration, as `load_settings` does. Raises InputError."""
    return load_settings(PipelineConfig, FOLDER, presets, overrides, options)


def load_settings(
    schema: type[AnySchema],
    folder: Path,
    presets: Sequence[str],
    overrides: Iterable[str] = (),
    options: Options | None = None,
) -> AnySchema:
    """Apply presets, then `stage.field=value` overrides, then options to a schema's defaults.

    A preset is the name of one in `folder`, or the path of a .toml file. `options` maps an option of the command line
    to a setting and its value, as in {"--seed": ("seed", 7)}; the value None changes nothing. Raises InputError for an
    unknown setting or a value out of range, in one line that names the setting or the option.
    """
    values: dict[str, Any] = {}
    origin = "--set"
    for preset in presets:
        origin = f"preset {preset}"
        _merge(values, _read_preset(preset, folder))
        _validated(schema, values, origin)
    for override in overrides:
        origin = f"--set {_short(' '.join(override.split()))}"
        _merge(values, _parse_override(override))
        _validated(schema, values, origin)
    for option, (name, value) in (options or {}).items():
        if value is not None:
            _merge(values, _nested(name, value))
            _validated(schema, values, option, of_option=True)
    return _validated(schema, values, origin)


def preset_names(folder: Path = FOLDER) -> list[str]:
    """The names of the presets in a folder of the program."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def _read_preset(preset: str, folder: Path) -> dict[str, Any]:
    path = Path(preset) if preset.endswith(".toml") else folder / f"{preset}.toml"
    try:
        return tomllib.loads(read_whole(path).decode())
    except OSError as error:
        raise InputError(
            f"preset {preset}: cannot be read ({error.strerror}), expected one of {', '.join(preset_names(folder))} "
            "or the path of a .toml file"
        ) from error
    except (ValueError, RecursionError) as error:  # ValueError: invalid TOML or UTF-8, or too many digits
        raise InputError(f"preset {preset}: not TOML ({error}); correct the file") from error


def _parse_override(override: str) -> dict[str, Any]:
    """Parse `a.b=value` to {"a": {"b": value}}. The value is read as TOML, or else kept as text."""
    name, separator, text = override.partition("=")
    if not separator or not name.strip():
        raise InputError(f"--set {_short(override)}: expected stage.field=value, as in final_fit.part_price=20")
    if name.count(".") > DEEPEST:
        raise InputError(f"--set {_short(override)}: there is no setting so deep, expected stage.field=value")
    try:
        parsed = tomllib.loads(f"value = {text}")
        value = parsed["value"] if len(parsed) == 1 else text
    except (ValueError, RecursionError):  # not TOML, or too many digits or brackets
        value = text.strip()
    return _nested(name.strip(), value)


def _nested(name: str, value: Any) -> dict[str, Any]:
    """Nest a value under a dotted name: `a.b` gives {"a": {"b": value}}."""
    *sections, field = name.split(".")
    nested = {field: value}
    for section in reversed(sections):
        nested = {section: nested}
    return nested


def _merge(values: dict[str, Any], changes: dict[str, Any]) -> None:
    for name, change in changes.items():
        if isinstance(change, dict) and isinstance(values.get(name), dict):
            _merge(values[name], change)
        else:
            values[name] = change


def _validated(schema: type[AnySchema], values: dict[str, Any], origin: str, of_option: bool = False) -> AnySchema:
    """Validate the configuration. An error names a value's origin, and its setting unless the origin is an option."""
    try:
        return schema.model_validate(values)
    except ValidationError as error:
        fault = Fault.first(error)
        if fault.kind == "extra_forbidden":
            name = ".".join([fault.field, *_first_path(fault.value)])
            raise InputError(f"{origin}: there is no setting {_short(repr(name))}; {_nearest(name, schema)}") from error
        where = origin if of_option else f"{origin}: {fault.field}"
        raise InputError(f"{where}: found {_short(repr(fault.value))}; {_lower(fault.said)}") from error


def _first_path(value: Any) -> list[str]:
    """The path of names to the first plain value in nested tables."""
    path: list[str] = []
    while isinstance(value, dict) and value and len(path) < DEEPEST:
        name = next(iter(value))
        path, value = [*path, name], value[name]
    return path


def _nearest(name: str, schema: type[Schema]) -> str:
    known = [setting.name for setting in all_settings(schema())]
    same_field = [setting for setting in known if setting.split(".")[-1] == name.split(".")[-1]]
    close = difflib.get_close_matches(name, known, n=3) or same_field[:3]
    return f"did you mean {' or '.join(close)}?" if close else f"there are {', '.join(schema.model_fields)}"


def _lower(message: str) -> str:
    """Put a schema's message into the form in which it can end one of our lines."""
    return message[:1].lower() + message[1:]


def _short(text: str) -> str:
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
