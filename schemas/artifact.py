"""The base of every artifact: a frozen pydantic model whose array fields state dtype, axes and unit.

An artifact is written as plain JSON fields plus arrays. An array field is declared once,

    points: Annotated[Float64[np.ndarray, "points 3"], Unit("normalised")]

Everything else follows from that line: the checks on construction, how the store writes the array, and the
manifest's table of arrays. Construction checks dtype, shape, finiteness and magnitude, and that axes of one name
have one size across the artifact. A field may also state `Within` (the range of its values) and `Rigid`.
"""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Self, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, model_validator

Axes = dict[str, tuple[int, str]]  # axis name -> (its size, an array that has it)


@dataclass(frozen=True)
class Unit:
    """The unit of an array field: "normalised" lengths, "input" lengths, "radian", "index", ..."""

    name: str


@dataclass(frozen=True)
class Within:
    """Least and greatest value of a field. An axis name stands for its greatest index: its size less one."""

    least: float
    most: float | str


@dataclass(frozen=True)
class Rigid:
    """Mark an array field (..., 4, 4) as rigid transforms, [R p; 0 0 0 1]."""

    tolerance: float = 1e-3


GREATEST = 1e15  # bound of any float: squares and products of larger ones overflow or lose all digits


@dataclass(frozen=True)
class ArraySpec:
    """The declaration of one array field."""

    name: str
    dtypes: tuple[str, ...]
    dims: tuple[str, ...]
    unit: str
    optional: bool


def _unwrap_optional(annotation: Any) -> tuple[Any, bool]:
    if get_origin(annotation) in (Union, types.UnionType):
        members = [member for member in get_args(annotation) if member is not type(None)]
        if len(members) == 1:
            return members[0], True
    return annotation, False


class Schema(BaseModel):
    """The base of everything written to disk: a frozen model that refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")


class Artifact(Schema):
    """A schema with array fields. Nested artifacts check themselves."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    array_specs_cache: ClassVar[dict[type, tuple[ArraySpec, ...]]] = {}

    @classmethod
    def array_specs(cls) -> tuple[ArraySpec, ...]:
        """The array fields of this schema, in declaration order."""
        if cls not in cls.array_specs_cache:
            cls.array_specs_cache[cls] = tuple(cls._declared_arrays())
        return cls.array_specs_cache[cls]

    @classmethod
    def _declared_arrays(cls) -> Iterator[ArraySpec]:
        for name, field in cls.model_fields.items():
            annotation, optional = _unwrap_optional(field.annotation)
            if not hasattr(annotation, "dim_str"):
                continue
            units = [entry.name for entry in field.metadata if isinstance(entry, Unit)]
            if len(units) != 1:
                raise TypeError(f"{cls.__name__}.{name}: an array field states exactly one Unit")
            yield ArraySpec(
                name=name,
                dtypes=tuple(annotation.dtypes),
                dims=tuple(annotation.dim_str.split()),
                unit=units[0],
                optional=optional,
            )

    @model_validator(mode="before")
    @classmethod
    def _check_arrays(cls, values: Any) -> Any:
        """Refuse arrays of the wrong dtype or shape, with axes that disagree, and values out of range."""
        if not isinstance(values, dict):
            return values
        sizes = cls._check_shapes(values)
        for name, field in cls.model_fields.items():
            value = values.get(name)
            if isinstance(value, np.ndarray | int | float) and np.size(value):
                for rule in field.metadata:
                    if isinstance(rule, Within):
                        _check_range(value, rule, sizes, f"{cls.__name__}.{name}")
                    elif isinstance(rule, Rigid):
                        _check_rigid(np.asarray(value), rule.tolerance, f"{cls.__name__}.{name}")
        return values

    @classmethod
    def _check_shapes(cls, values: dict[str, Any]) -> Axes:
        """The size of each named axis. Raises ValueError for arrays that differ from their declaration."""
        sizes: Axes = {}
        for spec in cls.array_specs():
            array = values.get(spec.name)
            if array is None:
                continue  # pydantic itself reports a missing required field
            where = f"{cls.__name__}.{spec.name}"
            if not isinstance(array, np.ndarray):
                raise ValueError(f"{where}: found {type(array).__name__}, expected a numpy array")
            if array.dtype.name not in spec.dtypes:
                raise ValueError(f"{where}: found dtype {array.dtype}, expected {' or '.join(spec.dtypes)}")
            if array.ndim != len(spec.dims):
                raise ValueError(f"{where}: found shape {array.shape}, expected ({', '.join(spec.dims)})")
            for size, dim in zip(array.shape, spec.dims, strict=True):
                if dim.isdigit():
                    known, origin = int(dim), where
                else:
                    known, origin = sizes.setdefault(dim, (size, where))
                if size != known:
                    raise ValueError(
                        f"{where}: found shape {array.shape}, expected ({', '.join(spec.dims)}) "
                        f"with {dim} = {known} as in {origin}"
                    )
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                bad = int(array.size - np.isfinite(array).sum())
                raise ValueError(f"{where}: {bad} values are NaN or infinite, expected finite values only")
            if array.dtype.kind == "f" and array.size and (greatest := np.abs(array).max()) > GREATEST:
                raise ValueError(f"{where}: found a number of size {greatest:g}, expected at most {GREATEST:g}")
        return sizes

    def arrays(self) -> dict[str, np.ndarray]:
        """This artifact's own arrays by field name, without absent optional ones."""
        found = {spec.name: getattr(self, spec.name) for spec in self.array_specs()}
        return {name: array for name, array in found.items() if array is not None}

    def replace(self, **changes: Any) -> Self:
        """Return a validated copy with some fields changed."""
        values = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self).model_validate(values | changes)


def _check_range(value: Any, rule: Within, axes: Axes, where: str) -> None:
    lowest, highest = np.min(value), np.max(value)
    if not isinstance(rule.most, str):
        most, why = rule.most, ""
    elif rule.most in axes:
        size, origin = axes[rule.most]
        most, why = size - 1, f", since {rule.most} = {size} in {origin}"
    else:
        return  # pydantic itself reports a missing array
    if not rule.least <= lowest <= highest <= most:
        raise ValueError(f"{where}: found values in {lowest}..{highest}, expected {rule.least:g}..{most:g}{why}")


def _check_rigid(Ts: np.ndarray, tolerance: float, where: str) -> None:
    R, last = Ts[..., :3, :3], Ts[..., 3, :]
    bounded = np.clip(R, -2, 2)  # so that no product overflows
    error = np.abs(bounded @ np.swapaxes(bounded, -1, -2) - np.eye(3)).max(axis=(-2, -1))
    error = np.maximum(error, np.abs(last - [0, 0, 0, 1]).max(axis=-1))
    if np.any(error > tolerance) or np.any(np.linalg.det(bounded) < 0):
        raise ValueError(f"{where}: found others than rigid motions, expected [R p; 0 0 0 1]")
