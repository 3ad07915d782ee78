"""The unit of a channel: told by the config or the file, and converted to that of our column."""

from __future__ import annotations

from typing import Final

from beltid.bench.channels.readings import Question
from beltid.bench.channels.vocabulary import simplified
from beltid.tables.columns import Column
from beltid.tables.units import (
    Calibration,
    Conversion,
    allowed_units,
    calibration,
    canonical_unit,
    conversion,
)

RAW: Final = ("V", "mV", "mV/V", "A", "mA")
"""Units of signals that mean nothing without a calibration."""
_TURNS: Final = ("drehzahl", "rpm", "rev", "tour")


def unit_conversion(
    column: Column, name: str, unit: str, question: Question, recognised: bool
) -> Conversion | str | None:
    """Conversion of a channel's numbers to a column's unit.

    Parameters
    ----------
    column : Column
        Our column.
    name, unit : str
        As the file writes them.
    question : Question
        What the config states; nothing is noted there.
    recognised : bool
        Whether the name alone says what the channel is: its unit must be told then.

    Returns
    -------
    Conversion, str or None
        A str is what is wrong; None: no unit is told, and the name says it is the column's.
    """
    shown = column.name if name == column.name else f'{column.name} (column "{name}")'
    setting, kind = question.options.units.get(column.name), question.kind
    known = setting if isinstance(setting, Calibration) else None
    if isinstance(setting, str):
        known = calibration(setting, column.unit)
    if known is not None:
        converted = known.conversion(unit)
        return converted or (
            f"{shown} is in {unit}, but the calibration of the config is for {known.per}"
        )
    if isinstance(setting, str):
        return conversion(setting, column.unit)
    plain = canonical_unit(unit)
    line = f"units: {{{kind}: {{{column.name}: "
    if plain in ("", "-"):
        if not recognised:
            return None
        return (
            f"the unit of {name}, read as {column.name}, is not told; "
            f"say it: {line}{column.unit}}}}}"
        )
    if plain in RAW:
        return (
            f"{shown} is in {unit}, its calibration must be told: "
            f"{line}250 {column.unit}/{'mV' if plain == 'mV' else 'V'}}}}}, "
            f"or {{factor: 250, offset: 0}}"
        )
    if column.unit == "rad/s" and plain == "rev/s" and _unclear_turns(unit, name):
        return f"{shown} is in {unit}: turns or radians? say {line}rev/s}}}} or {line}rad/s}}}}"
    if column.unit == "rad/s" and plain in ("m/s", "mm/s"):
        return (
            f"{shown} is in {unit}; divide by the radius R of the pulley: "
            f"{line}{{factor: 1/R, offset: 0}}}}}}, 1/R as a number in 1/m"
        )
    converted = conversion(unit, column.unit)
    if converted is None and plain == "1":
        return None
    return converted or f"{shown} is in {unit}, must be one of " + ", ".join(
        allowed_units(column.unit)
    )


def _unclear_turns(unit: str, name: str) -> bool:
    """Whether 1/s may be turns as well as radians."""
    per_second = unit.strip(" []()").replace(" ", "") in ("1/s", "s-1", "s^-1", "s⁻¹")
    return per_second and not any(word in simplified(name) for word in _TURNS)
