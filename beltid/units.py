"""Units that recordings may come in, and their conversion to the units of the tables.

The unit of a column is part of its name (``tension_tight_N``); this table says what else a bench
may write and how to convert it: ``value_in_table_unit = (value + shift) * factor``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Conversion:
    """Conversion of one unit to a table's unit: ``(value + shift) * factor``."""

    factor: float
    shift: float = 0.0


_LBF: Final = 4.4482216152605  # exact by definition of the pound and standard gravity
_TURN: Final = 2.0 * math.pi

CONVERSIONS: Final[dict[str, dict[str, Conversion]]] = {
    "N": {
        "N": Conversion(1.0),
        "mN": Conversion(1e-3),
        "daN": Conversion(10.0),
        "kN": Conversion(1e3),
        "lbf": Conversion(_LBF),
        "kgf": Conversion(9.80665),
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
}

# Other spellings that benches and spreadsheets use, after blanks and brackets are gone.
_SPELLINGS: Final[dict[str, str]] = {
    "μm": "um",
    "µm": "um",
    "micron": "um",
    "inch": "in",
    "sec": "s",
    "μs": "us",
    "µs": "us",
    "msec": "ms",
    "1/min": "rpm",
    "min-1": "rpm",
    "min^-1": "rpm",
    "U/min": "rpm",
    "rev/min": "rpm",
    "1/s": "rev/s",
    "°/s": "deg/s",
    "°C": "degC",
    "C": "degC",
    "°F": "degF",
    "F": "degF",
    "°": "deg",
    "Nm": "N m",
    "Ncm": "N cm",
    "Nmm": "N mm",
    "mNm": "mN m",
    "kNm": "kN m",
    "lbfin": "lbf in",
    "lbfft": "lbf ft",
}


def canonical_unit(text: str) -> str:
    """Canonical spelling of a unit: without brackets, dots and other spellings.

    Parameters
    ----------
    text : str
        A unit as a person writes it, such as ``"[µm]"``, ``"Nm"``, ``"1/min"``.

    Returns
    -------
    str
        The spelling used in `CONVERSIONS`, or the text without brackets if it is not known.
    """
    bare = re.sub(r"^[\[(<{]\s*|\s*[\])>}]$", "", text.strip())
    tight = re.sub(r"[\s*·⋅.]+", "", bare)
    return _SPELLINGS.get(tight, bare if _is_known(bare) else tight)


def _is_known(unit: str) -> bool:
    return any(unit in table for table in CONVERSIONS.values())


def conversion(unit: str, target: str) -> Conversion | None:
    """Conversion from a unit to the unit of a table, or None where there is none.

    Parameters
    ----------
    unit : str
        Unit found in a file or a config.
    target : str
        Unit of the table's column, a key of `CONVERSIONS`.
    """
    return CONVERSIONS.get(target, {}).get(canonical_unit(unit))


def allowed_units(target: str) -> tuple[str, ...]:
    """Units that can be converted to the unit of a table."""
    return tuple(CONVERSIONS.get(target, {}))
