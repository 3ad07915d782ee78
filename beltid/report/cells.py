"""Names and values of results in words, units and sensible digits; rows of them as a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

# endings of public names -> unit as printed, longest first
UNITS: Final[tuple[tuple[str, str], ...]] = (
    ("_N_m2", "N/m²"),
    ("_N_m3", "N/m³"),
    ("_N_s_m", "N s/m"),
    ("_rad_s", "rad/s"),
    ("_N_m", "N/m"),
    ("_m_s", "m/s"),
    ("_degC", "°C"),
    ("_percent", "%"),
    ("_deg", "°"),
    ("_mm", "mm"),
    ("_Hz", "Hz"),
    ("_N", "N"),
    ("_W", "W"),
    ("_s", "s"),
    ("_m", "m"),
)
QUANTITIES: Final = {
    "mu": ("friction coefficient µ", "-", 1.0),
    "normal_force": ("normal force per length", "N/m", 1.0),
    "line_force": ("normal force per length", "N/m", 1.0),
    "slip_speed": ("sliding speed v", "mm/s", 1e3),
    "penetration": ("penetration δ", "µm", 1e6),
    "torque": ("torque", "N m", 1.0),
    "speed_loss": ("speed loss", "rad/s", 1.0),
    "loss": ("speed loss", "rad/s", 1.0),
    "initial_tension": ("belt tension at rest T₀", "N", 1.0),
    "tension": ("tension", "N", 1.0),
    "arc_position": ("position along the arc from the tight side", "mm", 1e3),
    "time": ("time", "s", 1.0),
}
"""What a column in a chart is, by the beginning of its name: words with symbol, unit, scale."""
RANGES: Final = ("range", "valid", "measured")
MISSING: Final = "-"


def name_and_unit(name: str) -> tuple[str, str]:
    """Split a public name into words and unit."""
    for ending, unit in UNITS:
        if name.endswith(ending):
            words = name.removesuffix(ending).replace("_", " ")
            return words, "N m" if words.endswith("torque") else unit
    return name.replace("_", " "), ""


def heading(name: str) -> str:
    """Return the heading of a column: words, and the unit in brackets."""
    words, unit = name_and_unit(name)
    unit = unit.replace(" ", "\u00a0")  # do not wrap within a unit
    return f"{words} [{unit}]" if unit else words


def quantity(name: str) -> tuple[str, str, float]:
    """Return words with symbol, unit and scale with which a column stands in charts."""
    return next(of for stem, of in QUANTITIES.items() if name.startswith(stem))


def axis(name: str) -> str:
    """Return the label of an axis: words with the symbol, and the unit in brackets."""
    words, unit, _ = quantity(name)
    return f"{words} [{unit}]"


def cell(name: str, value: Any) -> str:
    """Format a value with the digits suited to its quantity; ``-`` if missing."""
    if hasattr(value, "item"):
        value = value.item()
    if value is None or value != value:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return _number(name, value)
    if isinstance(value, (list, tuple)):
        cells = [cell(name, item) for item in value]
        is_range = len(cells) == 2 and any(word in name for word in RANGES)
        return between(*cells) if is_range else ", ".join(cells)
    return str(value)


def fact(name: str, value: Any) -> tuple[str, str]:
    """Return the words of a single result, and its value with unit."""
    (words, unit), text = name_and_unit(name), cell(name, value)
    return words, f"{text} {unit}" if unit and text != MISSING else text


@dataclass(frozen=True, slots=True)
class Table:
    """A formatted table; `numeric` tells which columns contain numbers, or ranges of them."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Sequence[bool]


def table(title: str, rows: Sequence[Mapping[str, Any]], names: Sequence[str] = ()) -> Table | None:
    """Build a table from named columns of rows, by default of all; None without rows."""
    chosen = names or list(dict.fromkeys(name for row in rows for name in row))
    cells = [[cell(name, row.get(name)) for name in chosen] for row in rows]
    ends = [
        [text.lstrip("-")[:1] + text[-1:] for text in column] for column in zip(*cells, strict=True)
    ]
    numeric = [all(both.isdigit() or both == MISSING for both in column) for column in ends]
    return Table(title, [heading(name) for name in chosen], cells, numeric) if rows else None


def between(low: str, high: str) -> str:
    """Format a range; a single value if the two ends are equal."""
    return low if low == high else f"{low} to {high}"


def sentence(text: str) -> str:
    """Capitalize the first letter of a text."""
    return text[:1].upper() + text[1:]


def scientific(value: float) -> str:
    """Format a number with its power of ten in superscripts, such as 6.500·10⁷."""
    mantissa, exponent = f"{value:.3e}".split("e")
    power = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}·10{power}"


def _number(name: str, value: float) -> str:
    # uncertainties are themselves uncertain: two digits
    if "_se_" in f"{name}_" or "_u_" in f"{name}_":
        return f"{value:.2g}"
    if name.startswith("mu") and math.isfinite(value):
        return f"{value:.4f}"
    if name.endswith("_percent"):
        return f"{round(value, 2) + 0.0:.2f}"  # no -0.00
    if value == 0.0:
        return "0"
    if 1e-3 <= abs(value) < 1e6:
        digits = max(0, 3 - math.floor(math.log10(abs(value))))
        text = f"{value:.{digits}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.5g}"
