"""The settings that there are: names, defaults and meanings, in two tiers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pydantic_core import to_jsonable_python

from schemas.artifact import Schema
from schemas.config import PipelineConfig
from schemas.settings import COMMON


@dataclass(frozen=True)
class Setting:
    """One setting: its dotted name as `--set` takes it, its default, its meaning, and whether it is an advanced one."""

    name: str
    default: Any
    meaning: str
    advanced: bool

    @property
    def shown(self) -> str:
        """The default as `--set` takes it."""
        plain = to_jsonable_python(self.default)
        return "none" if plain is None else plain if isinstance(plain, str) else json.dumps(plain)


def all_settings(config: Schema | None = None, prefix: str = "") -> Iterator[Setting]:
    """Every single setting of a configuration, in its order, with the configuration's value as default."""
    config = PipelineConfig() if config is None else config
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if isinstance(value, Schema):
            yield from all_settings(value, f"{prefix}{name}.")
        else:
            extra = field.json_schema_extra
            tier = extra.get("tier") if isinstance(extra, dict) else None
            yield Setting(prefix + name, value, field.description or "", advanced=tier != COMMON)
