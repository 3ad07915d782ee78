"""Draw a figure in the terminal: lines and points in braille, two by four dots per cell."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from string import ascii_lowercase
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D

from beltid.report.drawing import log_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DOTS: Final = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
BLANK: Final = 0x2800
LEAST: Final = 24
WIDEST: Final = 78
HEIGHT: Final = 14
TICKS: Final = 4
STEPS: Final = 400
"""Smallest number of points along a joined line."""

Colour = tuple[float, float, float, float]


def drawn(axes: Axes, width: int, height: int = HEIGHT) -> str:
    """Draw the lines of axes as text, with limits and labels.

    Parameters
    ----------
    axes : Axes
        Axes to draw.
    width : int
        Columns of the terminal.
    height : int
        Rows of the drawing.

    Returns
    -------
    str
        Lines of text; "" if there is nothing to draw or no room.
    """
    lines = [line for line in _lines(axes) if line.x.size]
    levels = _ticks(axes, "y")
    margin = max((len(text) for _, text in levels), default=0) + 1
    columns = min(width, WIDEST) - margin - 1
    if not lines or columns < LEAST:
        return ""
    dots = np.zeros((4 * height, 2 * columns), dtype=bool)
    title, names = _legend(axes)
    ends: dict[Colour, tuple[float, float]] = {}
    for line in lines:
        x, y = _scaled(axes, line.x, "x"), _scaled(axes, line.y, "y")
        _mark(dots, x, y, line.joined)
        inside = np.flatnonzero((x >= 0) & (x <= 1) & (y >= 0) & (y <= 1))
        if line.colour in names and inside.size:
            last = inside[np.argmax(x[inside])]
            ends.setdefault(line.colour, (float(x[last]), float(y[last])))
    rows = [list(row.ljust(columns)) for row in _cells(dots)]
    key = title + _put_letters(rows, {names[colour]: end for colour, end in ends.items()})
    left = [""] * height
    for at, text in levels:
        left[round((1.0 - at) * (height - 1))] = text
    body = [
        f"{text:>{margin - 1}} ┤{''.join(row).rstrip()}"
        for text, row in zip(left, rows, strict=True)
    ]
    foot = " " * margin + "└" + "─" * columns
    key_lines = textwrap.wrap(key, min(width, WIDEST)) if ends else []
    xlabel = f"{axes.get_xlabel():>{margin + columns + 1}}"
    below = " " * (margin + 1) + _placed(_ticks(axes, "x"), columns)
    return "\n".join([axes.get_ylabel(), *key_lines, *body, foot, below.rstrip(), xlabel])


def _ticks(axes: Axes, which: Literal["x", "y"]) -> list[tuple[float, str]]:
    """Return a few round values of an axis: positions from 0 to 1, and labels."""
    from matplotlib.ticker import MaxNLocator

    low, high = getattr(axes, f"get_{which}lim")()
    low, high = min(low, high), max(low, high)
    if getattr(axes, f"get_{which}scale")() == "log":
        values = log_ticks(np.array([low, high]))
    else:
        values = np.asarray(MaxNLocator(TICKS, steps=[1, 2, 5, 10]).tick_values(low, high))
        values = values[(values >= low) & (values <= high)]
    places = _scaled(axes, values, which)
    return [(float(at), f"{value:.10g}") for at, value in zip(places, values, strict=True)]


def _placed(ticks: Sequence[tuple[float, str]], columns: int) -> str:
    """Place labels below their positions; those that do not fit are left out."""
    line = ""
    for at, text in ticks:
        start = max(0, min(round(at * (columns - 1)) - len(text) // 2, columns - len(text)))
        if start >= len(line) + bool(line):
            line = line.ljust(start) + text
    return line


def _legend(axes: Axes) -> tuple[str, dict[Colour, str]]:
    """Return the title of the legends, and the name for each colour."""
    legends = axes.get_figure(root=True).legends  # type: ignore[union-attr]
    names: dict[Colour, str] = {}
    titles = [title for legend in legends if (title := legend.get_title().get_text())]
    for legend in legends:
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            if isinstance(handle, Line2D):
                names.setdefault(to_rgba(handle.get_color()), text.get_text())
    return f"{titles[0]}:   " if titles and names else "", names


def _put_letters(rows: list[list[str]], ends: dict[str, tuple[float, float]]) -> str:
    """Put a letter at the end of each named line; return the letters with the names."""
    entries = []
    for letter, (name, (x, y)) in zip(ascii_lowercase, ends.items(), strict=False):
        row = rows[round((1.0 - y) * (len(rows) - 1))]
        place = round(x * (len(row) - 1))
        while place > 0 and row[place].isalpha():
            place -= 1
        row[place] = letter
        entries.append(f"{letter} {name}")
    return "   ".join(entries)


@dataclass(frozen=True, slots=True)
class _Line:
    """Coordinates of a line, whether its points are joined, and its colour."""

    x: np.ndarray
    y: np.ndarray
    joined: bool
    colour: Colour


def _lines(axes: Axes) -> list[_Line]:
    lines = []
    for line in axes.get_lines():
        x, y = (np.asarray(v, dtype=float) for v in line.get_data())
        if line.get_transform() != axes.transData:  # such as a level across the whole figure
            continue
        joined = line.get_linestyle() not in ("None", "", " ")
        lines.append(_Line(x, y, joined, to_rgba(line.get_color())))
    return lines


def _scaled(axes: Axes, values: np.ndarray, which: str) -> np.ndarray:
    """Scale values to 0 to 1 within the limits of an axis."""
    low, high = axes.get_xlim() if which == "x" else axes.get_ylim()
    scale = axes.get_xscale() if which == "x" else axes.get_yscale()
    if scale == "log":
        with np.errstate(invalid="ignore", divide="ignore"):
            values, low, high = np.log(values), float(np.log(low)), float(np.log(high))
    return (values - low) / (high - low)


def _mark(dots: np.ndarray, x: np.ndarray, y: np.ndarray, joined: bool) -> None:
    if joined and x.size > 1:
        index = np.arange(x.size, dtype=float)
        fine = np.linspace(0.0, x.size - 1.0, max(STEPS, 2 * x.size))
        x, y = np.interp(fine, index, x), np.interp(fine, index, y)
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
