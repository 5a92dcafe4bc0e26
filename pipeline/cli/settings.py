"""`reart settings`: what `--set` and presets can change."""

from __future__ import annotations

import json
from typing import Annotated

import typer
from pydantic_core import to_jsonable_python
from rich.markup import escape
from rich.table import Table

from pipeline.cli.options import JsonOption, screen
from pipeline.configuration.listing import all_settings
from schemas.config import PipelineConfig
from schemas.errors import InputError


def settings(
    section: Annotated[
        str, typer.Argument(help="Only settings whose names begin so, as final_fit; then advanced ones too.")
    ] = "",
    advanced: Annotated[bool, typer.Option("--advanced", help="Show all settings, not only the common ones.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List the settings with their defaults and meanings, as `--set NAME=VALUE` and presets take them.

    The common ones alone are shown. Advanced ones are for unusual data.

    Examples:

    - `reart settings`

    - `reart settings final_fit`
    """
    listed = [
        setting
        for setting in all_settings()
        if f"{setting.name}.".startswith(f"{section}." if section else "")
        and (advanced or bool(section) or not setting.advanced)
    ]
    if not listed:
        raise InputError(
            f"section: found {section!r}, expected one of {', '.join(PipelineConfig.model_fields)}, or a section of one"
        )
    if as_json:
        entries = [
            {
                "name": setting.name,
                "default": to_jsonable_python(setting.default),
                "meaning": setting.meaning,
                "tier": "advanced" if setting.advanced else "common",
            }
            for setting in listed
        ]
        print(json.dumps(entries, indent=1))
        return
    table = Table("setting", "default", "meaning")
    for setting in listed:
        table.add_row(setting.name, escape(setting.shown), escape(setting.meaning))
    screen().print(table)
