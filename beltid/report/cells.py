"""Format names and values of results for people: words, units, sensible digits."""

from __future__ import annotations

import math
from collections.abc import Iterable
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
# the one name whose suffix is not a force per length
TORQUE: Final = "torque_N_m"
RANGES: Final = ("range", "valid", "measured")
# residuals of equations, of which only the order of magnitude matters
MAGNITUDES: Final = ("residual", "slip_m", "cone")
MISSING: Final = "-"
MILLI: Final = 1e3
MICRO: Final = 1e6
QUANTITIES: Final = {
    "mu": ("friction coefficient µ", "-"),
    "normal_force_N_m": ("normal force per length", "N/m"),
    "slip_speed_m_s": ("sliding speed v", "mm/s"),
    "penetration_m": ("penetration δ", "µm"),
    "torque_N_m": ("torque", "N m"),
    "speed_loss_rad_s": ("speed loss", "rad/s"),
    "tension_N": ("tension", "N"),
    "initial_tension_N": ("belt tension at rest T₀", "N"),
    "time_s": ("time", "s"),
}
"""Words with symbol, and unit in charts, of the quantities on their axes."""


def name_and_unit(name: str) -> tuple[str, str]:
    """Split a public name into words and unit.

    Examples
    --------
    >>> name_and_unit("normal_force_N_m")
    ('normal force', 'N/m')
    >>> name_and_unit("mu_sliding")
    ('mu sliding', '')
    """
    if name.endswith(TORQUE):
        return name[: -len("_N_m")].replace("_", " "), "N m"
    for ending, unit in UNITS:
        if name.endswith(ending) and len(name) > len(ending):
            return name[: -len(ending)].replace("_", " "), unit
    return name.replace("_", " "), ""


def heading(name: str) -> str:
    """Return the heading of a column: words, and the unit in brackets."""
    words, unit = name_and_unit(name)
    unit = unit.replace(" ", "\u00a0")  # do not wrap within a unit
    return f"{words} [{unit}]" if unit else words


def axis(name: str) -> str:
    """Return the label of an axis: words with the symbol, and the unit in brackets."""
    words, unit = QUANTITIES[name]
    return f"{words} [{unit}]"


def cell(name: str, value: Any) -> str:
    """Format a value with the digits suited to its quantity; ``-`` if missing."""
    if hasattr(value, "item"):
        value = value.item()
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return _number(name, value)
    if isinstance(value, (list, tuple)):
        if len(value) == 2 and any(word in name for word in RANGES):
            return between(*(cell(name, item) for item in value))
        return ", ".join(cell(name, item) for item in value)
    return str(value)


def are_numbers(cells: Iterable[str]) -> bool:
    """Return whether all cells of a column that are not missing are numbers."""
    return all(text[-1:].isdigit() or text == MISSING for text in cells)


def between(low: str, high: str) -> str:
    """Format a range; a single value if the two ends are equal."""
    return low if low == high else f"{low} to {high}"


def no_formula(value: Any) -> Any:
    """Put an apostrophe before a text that a spreadsheet would take for a formula."""
    is_formula = isinstance(value, str) and value.startswith(("=", "+", "-", "@"))
    return f"'{value}" if is_formula and value != MISSING else value


def sentence(text: str) -> str:
    """Capitalize the first letter of a text."""
    return text[:1].upper() + text[1:]


def _number(name: str, value: float) -> str:
    if math.isnan(value):
        return MISSING
    # uncertainties are themselves uncertain: two digits
    if "_se_" in f"{name}_" or "_u_" in name or name in MAGNITUDES:
        return f"{value:.2g}"
    if name.startswith("mu") and math.isfinite(value):
        return f"{value:.4f}"
    if name.endswith("_percent"):
        return f"{value:.2f}"
    if value == 0.0:
        return "0"
    if 1e-3 <= abs(value) < 1e6:
        digits = max(0, 3 - math.floor(math.log10(abs(value))))
        text = f"{value:.{digits}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.5g}"


def fact(name: str, value: Any) -> tuple[str, str]:
    """Return the words of a single result, and its value with unit."""
    words, unit = name_and_unit(name)
    text = cell(name, value)
    return words, f"{text} {unit}" if unit and text != MISSING else text


def scientific(value: float, digits: int = 4) -> str:
    """Format a number with its power of ten in superscripts.

    Examples
    --------
    >>> scientific(6.4999e7)
    '6.500·10⁷'
    """
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}·10{power}"
