"""Units of recordings and their conversion to the units of the tables.

The unit of a column is part of its name (``tension_tight_N``). This module lists the other units
that a bench may use and how to convert them: ``value_in_table_unit = (value + shift) * factor``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    import numpy as np

T = TypeVar("T", float, "np.ndarray")


@dataclass(frozen=True, slots=True)
class Conversion:
    """Conversion from a unit to the unit of a table: ``(value + shift) * factor``."""

    factor: float
    shift: float = 0.0

    def apply(self, values: T) -> T:
        """Convert a number, or an array of any shape, to the table's unit."""
        return (values + self.shift) * self.factor


_GRAVITY: Final = 9.80665  # standard gravity [m/s²]: a mass stands for its weight
_LBF: Final = 4.4482216152605  # exact by definition of the pound and standard gravity
_TURN: Final = 2.0 * math.pi

CONVERSIONS: Final[dict[str, dict[str, Conversion]]] = {
    "N": {
        "N": Conversion(1.0),
        "mN": Conversion(1e-3),
        "daN": Conversion(10.0),
        "kN": Conversion(1e3),
        "lbf": Conversion(_LBF),
        "kgf": Conversion(_GRAVITY),
        "kg": Conversion(_GRAVITY),
        "g": Conversion(_GRAVITY * 1e-3),
    },
    "mm": {
        "mm": Conversion(1.0),
        "um": Conversion(1e-3),
        "cm": Conversion(10.0),
        "m": Conversion(1e3),
        "in": Conversion(25.4),
    },
    "s": {
        "s": Conversion(1.0),
        "ms": Conversion(1e-3),
        "us": Conversion(1e-6),
        "min": Conversion(60.0),
        "h": Conversion(3600.0),
        "d": Conversion(86400.0),
    },
    "rad/s": {
        "rad/s": Conversion(1.0),
        "deg/s": Conversion(math.pi / 180.0),
        "rpm": Conversion(_TURN / 60.0),
        "rev/s": Conversion(_TURN),
    },
    "degC": {
        "degC": Conversion(1.0),
        "K": Conversion(1.0, -273.15),
        "degF": Conversion(5.0 / 9.0, -32.0),
    },
    "deg": {
        "deg": Conversion(1.0),
        "rad": Conversion(180.0 / math.pi),
    },
    "N m": {
        "N m": Conversion(1.0),
        "N cm": Conversion(1e-2),
        "N mm": Conversion(1e-3),
        "mN m": Conversion(1e-3),
        "kN m": Conversion(1e3),
        "lbf in": Conversion(_LBF * 0.0254),
        "lbf ft": Conversion(_LBF * 0.3048),
    },
    "m/s": {
        "m/s": Conversion(1.0),
        "mm/s": Conversion(1e-3),
        "m/min": Conversion(1.0 / 60.0),
    },
    "N/m": {
        "N/m": Conversion(1.0),
        "N/cm": Conversion(1e2),
        "N/mm": Conversion(1e3),
        "kN/m": Conversion(1e3),
    },
    "1": {"1": Conversion(1.0)},
}

# Other spellings in benches and spreadsheets, after blanks and brackets are removed.
_SPELLINGS: Final[dict[str, str]] = {
    "Newton": "N",
    "Newtons": "N",
    "Kilonewton": "kN",
    "kilonewtons": "kN",
    "KN": "kN",
    "DaN": "daN",
    **dict.fromkeys(("lb", "lbs", "lbF", "LB", "Lb"), "lbf"),
    "kp": "kgf",
    "Kg": "kg",
    "KG": "kg",
    "kilogram": "kg",
    "kilograms": "kg",
    "Kilogramm": "kg",
    "gram": "g",
    "grams": "g",
    "Gramm": "g",
    "μm": "um",
    "µm": "um",
    "micron": "um",
    "microns": "um",
    "inch": "in",
    "inches": "in",
    '"': "in",
    "millimeter": "mm",
    "meter": "m",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "Sekunde": "s",
    "Sekunden": "s",
    "seconde": "s",
    "secondes": "s",
    "millisecond": "ms",
    "milliseconds": "ms",
    "minute": "min",
    "minutes": "min",
    "hour": "h",
    "hours": "h",
    "day": "d",
    "days": "d",
    "μs": "us",
    "µs": "us",
    "msec": "ms",
    "1/min": "rpm",
    "min-1": "rpm",
    "min^-1": "rpm",
    "min⁻¹": "rpm",
    "U/min": "rpm",
    "Upm": "rpm",
    "/min": "rpm",
    "tr/min": "rpm",
    "tours/min": "rpm",
    "r/min": "rpm",
    "rad/sec": "rad/s",
    "rads^-1": "rad/s",
    "rads-1": "rad/s",
    "s^-1": "rev/s",
    "s-1": "rev/s",
    "rps": "rev/s",
    "tr/s": "rev/s",
    "U/s": "rev/s",
    "rev/min": "rpm",
    "1/s": "rev/s",
    "°/s": "deg/s",
    "°C": "degC",
    "C": "degC",
    "°F": "degF",
    "F": "degF",
    "Celsius": "degC",
    "GradC": "degC",
    "Kelvin": "K",
    "Fahrenheit": "degF",
    "°": "deg",
    "Grad": "deg",
    "degree": "deg",
    "degrees": "deg",
    "Nm": "N m",
    "Ncm": "N cm",
    "Nmm": "N mm",
    "mNm": "mN m",
    "kNm": "kN m",
    "lbfin": "lbf in",
    "lbfft": "lbf ft",
    **dict.fromkeys(("ft-lb", "ft-lbs", "ft-lbf", "ftlb", "ftlbs", "lb-ft", "lbft"), "lbf ft"),
    **dict.fromkeys(("in-lb", "in-lbs", "in-lbf", "inlb", "inlbs", "lb-in", "lbin"), "lbf in"),
}

LONGEST: Final = 80
"""Longest text that is checked for a unit [characters]."""

_BY_LOWER: Final[dict[str, str]] = {
    word.lower(): unit
    for words in (
        {unit: unit for table in CONVERSIONS.values() for unit in table},
        _SPELLINGS,
    )
    for word, unit in words.items()
    if len(word) > 2 and not word.startswith("mN")  # MN m is not mN m
}


def canonical_unit(text: str) -> str:
    """Convert a unit to its canonical spelling, without brackets and dots.

    Parameters
    ----------
    text : str
        A unit as a person writes it, such as ``"[µm]"``, ``"Nm"``, ``"1/min"``.

    Returns
    -------
    str
        The spelling used in `CONVERSIONS`, or the text without brackets if it is not known.
    """
    if len(text) > LONGEST:
        return text
    bare = re.sub(r"^[\[(<{]\s*|\s*[\])>}]$", "", text.strip())
    bare = re.sub(r"\s+since\s.*", "", bare)  # times in NetCDF: minutes since 2026-01-01
    if re.fullmatch(r"[\d.,]+", bare):
        return bare  # "1" is a unit, ".1" is not
    tight = re.sub(r"[\s*·⋅.]+", "", bare)
    if tight in _SPELLINGS:
        return _SPELLINGS[tight]
    if _is_known(bare):
        return bare
    # all other units of three or more letters are unique regardless of case
    return _BY_LOWER.get(tight.lower(), tight) if len(tight) > 2 else tight


def _is_known(unit: str) -> bool:
    return unit != "1" and any(unit in table for table in CONVERSIONS.values())


def is_known_unit(text: str) -> bool:
    """Return whether a text is a unit that converts to the unit of any column."""
    return _is_known(canonical_unit(text))


def conversion(unit: str, target: str) -> Conversion | None:
    """Return the conversion from a unit to the unit of a table; None if there is none.

    Parameters
    ----------
    unit : str
        Unit found in a file or a config.
    target : str
        Unit of the table's column, a key of `CONVERSIONS`.
    """
    return CONVERSIONS.get(target, {}).get(canonical_unit(unit))


@dataclass(frozen=True, slots=True)
class Calibration:
    """Calibration of a raw channel: ``value = factor * raw + offset`` in the table's unit.

    Attributes
    ----------
    factor, offset : float
        As stated in the calibration sheet of the sensor.
    per : str
        Raw unit of the factor, "V" or "mV"; "" for any raw unit.
    """

    factor: float
    offset: float = 0.0
    per: str = ""

    def conversion(self, raw_unit: str = "") -> Conversion | None:
        """Return the conversion of numbers in a raw unit; None if the factor has another unit."""
        factor = self.factor
        raw = canonical_unit(raw_unit)
        if self.per and raw and raw != self.per:
            if {raw, self.per} != {"V", "mV"}:
                return None
            factor *= 1e-3 if raw == "mV" else 1e3
        return Conversion(factor, self.offset / factor)


_PER_VOLT: Final = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)\s*/\s*(m?V)")


def calibration(text: str, target: str) -> Calibration | None:
    """Parse a calibration factor such as ``250 N/V`` or ``0.5 kN/mV``; None if it is not one."""
    match = _PER_VOLT.fullmatch(text.strip()) if len(text) <= LONGEST else None
    to_target = conversion(match[2], target) if match else None
    if match is None or to_target is None or to_target.shift:
        return None
    if not 0.0 < abs(float(match[1]) * to_target.factor) < float("inf"):
        return None
    return Calibration(float(match[1]) * to_target.factor, 0.0, match[3])


def allowed_units(target: str) -> tuple[str, ...]:
    """Return the units that can be converted to the unit of a table."""
    return tuple(CONVERSIONS.get(target, {}))
