"""A figure in a terminal: its lines and points in braille, two by four dots in a cell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DOTS: Final = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
BLANK: Final = 0x2800
LEAST: Final = 24
WIDEST: Final = 78
HEIGHT: Final = 14
STEPS: Final = 400
"""Points that a segment is drawn with."""


def drawn(axes: Axes, width: int, height: int = HEIGHT) -> str:
    """The lines of axes as text, with their limits and labels.

    Parameters
    ----------
    axes : Axes
        What to draw.
    width : int
        Columns of the terminal.
    height : int
        Rows of the drawing.

    Returns
    -------
    str
        Lines of text; "" if there is nothing to draw or no room.
    """
    lines = [(x, y, joined) for x, y, joined in _lines(axes) if x.size]
    ticks = [f"{limit:.4g}" for limit in axes.get_ylim()]
    margin = max(len(text) for text in ticks) + 1
    columns = min(width, WIDEST) - margin - 1
    if not lines or columns < LEAST:
        return ""
    dots = np.zeros((4 * height, 2 * columns), dtype=bool)
    for x, y, joined in lines:
        _mark(dots, _scaled(axes, x, "x"), _scaled(axes, y, "y"), joined)
    rows = _cells(dots)
    low, high = (f"{limit:.4g}" for limit in axes.get_xlim())
    left = [ticks[1], *[""] * (height - 2), ticks[0]]
    body = [f"{name:>{margin - 1}} ┤{row}" for name, row in zip(left, rows, strict=True)]
    foot = " " * margin + "└" + "─" * columns
    ends = f"{' ' * (margin + 1)}{low}{high:>{max(1, columns - len(low))}}"
    return "\n".join(
        [axes.get_ylabel(), *body, foot, ends, f"{axes.get_xlabel():>{margin + columns + 1}}"]
    )


def _lines(axes: Axes) -> list[tuple[np.ndarray, np.ndarray, bool]]:
    """Coordinates of the lines, and whether their points are joined."""
    found = []
    for line in axes.get_lines():
        x, y = (np.asarray(v, dtype=float) for v in line.get_data())
        if line.get_transform() != axes.transData:  # such as a level across the whole figure
            continue
        found.append((x, y, line.get_linestyle() not in ("None", "", " ")))
    return found


def _scaled(axes: Axes, values: np.ndarray, which: str) -> np.ndarray:
    """Values from 0 to 1 within the limits of an axis."""
    low, high = axes.get_xlim() if which == "x" else axes.get_ylim()
    scale = axes.get_xscale() if which == "x" else axes.get_yscale()
    if scale == "log":
        with np.errstate(invalid="ignore", divide="ignore"):
            values, low, high = np.log(values), float(np.log(low)), float(np.log(high))
    return (values - low) / (high - low)


def _mark(dots: np.ndarray, x: np.ndarray, y: np.ndarray, joined: bool) -> None:
    if joined and x.size > 1:
        known = np.arange(x.size, dtype=float)
        fine = np.linspace(0.0, x.size - 1.0, max(STEPS, 2 * x.size))
        x, y = np.interp(fine, known, x), np.interp(fine, known, y)
    inside = np.isfinite(x) & np.isfinite(y) & (x >= 0) & (x <= 1) & (y >= 0) & (y <= 1)
    rows, columns = dots.shape
    dots[
        np.round((1.0 - y[inside]) * (rows - 1)).astype(int),
        np.round(x[inside] * (columns - 1)).astype(int),
    ] = True


def _cells(dots: np.ndarray) -> list[str]:
    rows = []
    for top in range(0, dots.shape[0], 4):
        cells = []
        for left in range(0, dots.shape[1], 2):
            code = BLANK
            for i, pair in enumerate(DOTS):
                for j, bit in enumerate(pair):
                    code |= bit * bool(dots[top + i, left + j])
            cells.append(" " if code == BLANK else chr(code))
        rows.append("".join(cells).rstrip())
    return rows
