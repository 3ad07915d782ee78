"""The look of charts: colours, markers, lines, and matplotlib's settings.

Colours are those of Okabe and Ito for a few groups and cividis for an ordered quantity; groups also
differ in marker or line, so that grey print tells them apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

INK: Final = "#1a1a1a"
FAINT: Final = "#767676"
GRID: Final = "#dddddd"
MEASURED: Final = "#0072b2"
SIMULATED: Final = "#d55e00"
GROUPS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#000000", "#e69f00")
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X")
LINES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)))
ORDERED: Final = "cividis"
SETTINGS: Final[Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 10.0,
    "axes.titlesize": 10.0,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.useoffset": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "figure.constrained_layout.use": True,
    "text.parse_math": False,  # names are no formulas
    "svg.fonttype": "path",
    "svg.hashsalt": "beltid",
    "pdf.fonttype": 42,
}


@contextmanager
def applied() -> Iterator[None]:
    """Draw and save in this style, independent of the user's matplotlib settings."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(SETTINGS)
        yield


def group(index: int, **other: Any) -> dict[str, Any]:
    """Return colour, marker and line of a group; colour and marker are unique up to 49 groups."""
    return {
        "color": GROUPS[index % len(GROUPS)],
        "marker": MARKERS[(index + index // len(GROUPS)) % len(MARKERS)],
        "ls": LINES[index % len(LINES)],
    } | other


def shades(count: int) -> list[tuple[float, ...]]:
    """Return the colours of an ordered quantity with `count` values, dark for the lowest."""
    import matplotlib as mpl

    return [mpl.colormaps[ORDERED](0.74 * i / max(count - 1, 1)) for i in range(count)]
