"""Units of recordings and their conversion to the units of the tables.

The unit of a column is part of its name (``tension_tight_N``). This module lists the other units
that a bench may use and how to convert them: ``value_in_table_unit = (value + shift) * factor``.
"""

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

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


_GRAVITY = 9.80665  # standard gravity [m/s²]: a mass stands for its weight
_LBF = 4.4482216152605  # exact by definition of the pound and standard gravity
_TURN = 2.0 * math.pi

CONVERSIONS: dict[str, dict[str, Conversion]] = {
    "degC": {
        "degC": Conversion(1.0),
        "K": Conversion(1.0, -273.15),
        "degF": Conversion(5.0 / 9.0, -32.0),
    }
} | {
    target: {unit: Conversion(factor) for unit, factor in factors.items()}
    for target, factors in {
        "N": {"N": 1.0, "mN": 1e-3, "daN": 10.0, "kN": 1e3, "lbf": _LBF}
        | {"kgf": _GRAVITY, "kg": _GRAVITY, "g": _GRAVITY * 1e-3},
        "mm": {"mm": 1.0, "um": 1e-3, "cm": 10.0, "m": 1e3, "in": 25.4},
        "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0, "d": 86400.0},
        "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": _TURN / 60.0, "rev/s": _TURN},
        "deg": {"deg": 1.0, "rad": 180.0 / math.pi},
        "N m": {"N m": 1.0, "N cm": 1e-2, "N mm": 1e-3, "mN m": 1e-3, "kN m": 1e3}
        | {"lbf in": _LBF * 0.0254, "lbf ft": _LBF * 0.3048},
        "m/s": {"m/s": 1.0, "mm/s": 1e-3, "m/min": 1.0 / 60.0},
        "N/m": {"N/m": 1.0, "N/cm": 1e2, "N/mm": 1e3, "kN/m": 1e3},
        "1": {"1": 1.0},
    }.items()
}

# Other spellings in benches and spreadsheets, after blanks and brackets are removed.
_SPELLINGS: dict[str, str] = {
    word: unit
    for unit, words in {
        "N": "Newton Newtons",
        "kN": "Kilonewton kilonewtons KN",
        "daN": "DaN",
        "lbf": "lb lbs lbF LB Lb",
        "kgf": "kp",
        "kg": "Kg KG kilogram kilograms Kilogramm",
        "g": "gram grams Gramm",
        "um": "μm µm micron microns",
        "in": 'inch inches "',
        "mm": "millimeter",
        "m": "meter",
        "s": "sec Sek second seconds Sekunde Sekunden seconde secondes",
        "ms": "millisecond milliseconds msec",
        "min": "minute minutes",
        "h": "hour hours",
        "d": "day days",
        "us": "μs µs",
        "rpm": "1/min min-1 min^-1 min⁻¹ U/min Upm /min tr/min tours/min r/min rev/min",
        "rad/s": "rad/sec rads^-1 rads-1",
        "rev/s": "s^-1 s-1 rps tr/s U/s 1/s",
        "deg/s": "°/s",
        "degC": "°C C Celsius GradC",
        "degF": "°F F Fahrenheit",
        "K": "Kelvin",
        "deg": "° Grad degree degrees",
        "N m": "Nm",
        "N cm": "Ncm",
        "N mm": "Nmm",
        "mN m": "mNm",
        "kN m": "kNm",
        "lbf in": "lbfin in-lb in-lbs in-lbf inlb inlbs lb-in lbin",
        "lbf ft": "lbfft ft-lb ft-lbs ft-lbf ftlb ftlbs lb-ft lbft",
    }.items()
    for word in words.split()
}

LONGEST = 80  # text that is checked for a unit [characters]

_KNOWN = {unit: unit for table in CONVERSIONS.values() for unit in table if unit != "1"}
_BY_LOWER: dict[str, str] = {
    word.lower(): unit
    for word, unit in (_KNOWN | _SPELLINGS).items()
    if len(word) > 2 and not word.startswith("mN")  # MN m is not mN m
}


def canonical_unit(text: str) -> str:
    """Return the spelling of `CONVERSIONS` for a unit such as ``"[µm]"``, ``"Nm"``, ``"1/min"``."""
    if len(text) > LONGEST:
        return text
    bare = re.sub(r"^[\[(<{]\s*|\s*[\])>}]$", "", text.strip())
    if re.fullmatch(r"[\d.,]+", bare):
        return bare  # "1" is a unit, ".1" is not
    tight = re.sub(r"[\s*·⋅.]+", "", bare)
    if tight in _SPELLINGS:
        return _SPELLINGS[tight]
    if bare in _KNOWN:
        return bare
    # all other units of three or more letters are unique regardless of case
    return _BY_LOWER.get(tight.lower(), tight) if len(tight) > 2 else tight


def is_known_unit(text: str) -> bool:
    """Return whether a text is a unit that converts to the unit of any column."""
    return canonical_unit(text) in _KNOWN


def conversion(unit: str, target: str) -> Conversion | None:
    """Return the conversion from a unit to the unit of a table; None if there is none."""
    return CONVERSIONS.get(target, {}).get(canonical_unit(unit))


@dataclass(frozen=True, slots=True)
class Calibration:
    """Calibration of a raw channel: ``value = factor * raw + offset`` in the table's unit.

    `per` is the raw unit of the factor, "V" or "mV"; "" for any.
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


_PER_VOLT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)\s*/\s*(m?V)")


def calibration(text: str, target: str) -> Calibration | None:
    """Parse a calibration factor such as ``250 N/V`` or ``0.5 kN/mV``; None if it is not one."""
    match = _PER_VOLT.fullmatch(text.strip()) if len(text) <= LONGEST else None
    to_target = conversion(match[2], target) if match else None
    if match is None or to_target is None or to_target.shift:
        return None
    if not 0.0 < abs(float(match[1]) * to_target.factor) < float("inf"):
        return None
    return Calibration(float(match[1]) * to_target.factor, 0.0, match[3])
