"""Remarks on a description for the user: its unit is probably wrong."""

from __future__ import annotations

from schemas.model_file import ModelFile

SMALLEST, LARGEST = 0.005, 20.0  # metres: for other sizes the assumed unit is probably wrong
HEAVIEST = 1e5  # kg
SAY = "say the unit by --units, or by --scale when exporting"


def remarks(model: ModelFile, metres_per_unit: float | None, size: float, mass: float) -> tuple[str, ...]:
    """The remarks on a model, one line each. `metres_per_unit` is the setting; size and mass are in m and kg."""
    if SMALLEST <= size <= LARGEST and mass <= HEAVIEST:
        return ()
    return (f"{_unit(model, metres_per_unit)}: the robot is {size:.3g} m long and {mass:.3g} kg heavy; {SAY}",)


def _unit(model: ModelFile, metres_per_unit: float | None) -> str:
    if metres_per_unit is not None:
        return f"one unit was said to be {metres_per_unit:g} m"
    if model.units == "unknown":
        return "unit unknown: one unit was taken for one metre"
    return f"the unit was said to be the {model.units}"
