"""The base of the configuration's models and the types of their fields."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator

from schemas.artifact import Schema
from schemas.sequence import LENGTH_SYMBOLS, LengthUnit

_UNIT_NAMES: dict[str, LengthUnit] = {unit: unit for unit in LENGTH_SYMBOLS} | {
    symbol: unit for unit, symbol in LENGTH_SYMBOLS.items() if unit != "unknown"
}

GREATEST_INTEGER = 1_000_000
GREATEST_NUMBER = 1e12
LEAST_NUMBER = 1e-12


COMMON = "common"


def common(default: Any, description: str, **constraints: Any) -> Any:
    """Make a pydantic field for one of the few settings that many users change. All others are advanced."""
    return Field(default, description=description, json_schema_extra={"tier": COMMON}, **constraints)


class Settings(Schema):
    """The base of every configuration. It refuses NaN, infinity and absurdly large numbers."""

    model_config = ConfigDict(allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _check_size(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse absurdly large numbers, so that a slip cannot fill the memory. A field may set its own bound."""
        bounds = cls.model_fields[info.field_name or ""].metadata
        bounded = any(hasattr(bound, "le") or hasattr(bound, "lt") for bound in bounds)
        for number in value if isinstance(value, tuple) else (value,):
            if not isinstance(number, int | float):
                continue
            greatest = GREATEST_INTEGER if isinstance(number, int) else GREATEST_NUMBER
            if not bounded and abs(number) > greatest:
                raise ValueError(f"expected at most {greatest:g}")
            if 0 < abs(number) < LEAST_NUMBER:
                raise ValueError(f"expected at least {LEAST_NUMBER:g}, or 0 where that may be")
        return value


def _ordered(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError("expected the least first, then the greatest")
    return ends


def _different(values: tuple[int, ...]) -> tuple[int, ...]:
    if len(set(values)) != len(values):
        raise ValueError("expected each once")
    return values


def _name_or_path(name: str) -> str:
    """Check the form of a name or path. Whether the function exists is checked when it is looked up."""
    module, separator, function = name.partition(":")
    if not all(part.isidentifier() for part in (*module.split("."), function if separator else "_")):
        raise ValueError("expected a registered name, or package.module:function")
    return name


def _length_unit(name: object) -> object:
    """Translate a name such as mm, meters or Centimetre to its unit. Other values pass, for pydantic to refuse."""
    if not isinstance(name, str):
        return name
    plain = name.strip().lower()
    if plain.endswith(("meter", "meters", "metres")):
        plain = plain.removesuffix("s").replace("meter", "metre")
    return _UNIT_NAMES.get(plain, name)


Seed = Annotated[int, Field(ge=0, lt=2**63)]
Degrees = Annotated[float, Field(gt=0, le=360)]
DegreeRange = Annotated[tuple[Degrees, Degrees], AfterValidator(_ordered)]
DifferentFrames = Annotated[tuple[Annotated[int, Field(ge=0)], ...], AfterValidator(_different)]
SwappablePart = Annotated[str, Field(max_length=500), AfterValidator(_name_or_path)]
NamedUnit = Annotated[LengthUnit, BeforeValidator(_length_unit)]
