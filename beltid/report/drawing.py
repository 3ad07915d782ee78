"""Define the style of all figures, in the report and in `show`, on screen and on paper.

Colours are those of Okabe and Ito for a few groups and cividis for an ordered quantity. Groups also
differ in marker or line, so that they can be distinguished in grey print. Figures are drawn without
pyplot: no state, no display, the same bytes for the same data.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final, Literal, cast

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator

INK: Final = "#1a1a1a"
FAINT: Final = "#767676"
GRID: Final = "#dddddd"
MEASURED: Final = "#0072b2"
SIMULATED: Final = "#d55e00"
GROUPS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#000000", "#e69f00")
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X")
LINES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)))
ORDERED: Final = "cividis"
MU: Final = "friction coefficient µ [-]"
LINE_FORCE: Final = "normal force per length [N/m]"
SPEED: Final = "sliding speed v [mm/s]"
PENETRATION: Final = "penetration [µm]"
PRESSED: Final = "line force [N/m]"
"""Axis label for the press, where only a normal force acts."""
LOGARITHMIC: Final = ", log"
"""Suffix of the label of a logarithmic axis."""
WIDTH: Final = 5.2
HEIGHT: Final = 3.9
STYLE: Final[dict[str, Any]] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 10.0,
    "axes.titlesize": 10.0,
    "axes.labelsize": 10.0,
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
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 10.0,
    "ytick.labelsize": 10.0,
    "legend.fontsize": 10.0,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": GRID,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "savefig.facecolor": "white",
    "text.parse_math": False,  # names are no formulas
    "svg.fonttype": "path",
    "svg.hashsalt": "beltid",
    "pdf.fonttype": 42,
}
NO_DATES: Final[dict[str, dict[str, Any]]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}
WIDE: Final = 5.0
"""Smallest ratio of highest to lowest value for a logarithmic axis."""
MOST_NAMED: Final = 12
"""Largest number of legend entries."""
LOW_LEGEND: Final = 0.9
"""Legend height that fits into a figure of the usual height [in]."""
LONGEST_NAME: Final = 48
"""Characters per line of a legend entry at the usual width."""
RESOLUTION: Final = 150  # of a PNG, dots per inch


@contextmanager
def style() -> Iterator[None]:
    """Draw and save in this style, independent of the user's matplotlib settings."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(cast(Any, STYLE))
        yield


def figure(height: float = HEIGHT, width: float = WIDTH) -> Figure:
    """Create an empty figure of the usual size [in], which still fits a narrow screen."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height))


@contextmanager
def new_axes(height: float = HEIGHT, columns: int = 3) -> Iterator[tuple[Figure, Axes]]:
    """Create a figure of the usual width with one pair of axes, drawn in the style.

    What is labelled in the block gets a legend below, of at most `columns` columns.
    """
    with style():
        fig = figure(height)
        axes = fig.subplots()
        yield fig, axes
        legend_below(fig, [axes], columns)


def shade(position: float) -> tuple[float, float, float, float]:
    """Return the colour of an ordered quantity, 0 for its lowest and 1 for its highest value."""
    import matplotlib as mpl

    red, green, blue, alpha = mpl.colormaps[ORDERED](0.74 * position)
    return float(red), float(green), float(blue), float(alpha)


def shades(count: int) -> list[tuple[float, float, float, float]]:
    """Return the colours of an ordered quantity with `count` values."""
    return [shade(i / max(count - 1, 1)) for i in range(count)]


def group(index: int) -> dict[str, Any]:
    """Return colour, marker and line of a group; colour and marker are unique up to 49 groups."""
    return {
        "color": GROUPS[index % len(GROUPS)],
        "marker": MARKERS[(index + index // len(GROUPS)) % len(MARKERS)],
        "linestyle": LINES[index % len(LINES)],
    }


def is_wide(values: np.ndarray) -> bool:
    """Return whether values span a factor of five or more, which asks for a logarithmic axis."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and 0.0 < WIDE * finite.min() <= finite.max())


def log_locator(values: np.ndarray) -> LogLocator:
    """Place log-axis ticks at 1, 2 and 5, or at powers of ten over more than two decades."""
    from matplotlib.ticker import LogLocator

    over_decades = np.nanmax(values) > 100.0 * np.nanmin(values)
    return LogLocator(subs=(1.0,) if over_decades else (1.0, 2.0, 5.0))


def log_ticks(values: np.ndarray) -> np.ndarray:
    """Return the ticks of `log_locator` within the range of the values."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    ticks = np.asarray(log_locator(values).tick_values(low, high))
    return ticks[(ticks >= low) & (ticks <= high)]


def logarithmic(axes: Axes, along: Literal["x", "y"], values: np.ndarray) -> None:
    """Make an axis logarithmic with plain numbers if its values span a wide range.

    Appends `LOGARITHMIC` to an existing label.

    Parameters
    ----------
    axes : Axes
        The axes.
    along : {"x", "y"}
        Which axis.
    values : ndarray
        Values on that axis.
    """
    from matplotlib.ticker import FuncFormatter, NullFormatter

    if not is_wide(values):
        return
    getattr(axes, f"set_{along}scale")("log")
    axis = getattr(axes, f"{along}axis")
    if label := axis.get_label_text():
        axis.set_label_text(label + LOGARITHMIC)
    axis.set_major_locator(log_locator(values))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def legend_below(fig: Figure, every: Sequence[Axes], columns: int = 3) -> None:
    """Add a legend below the axes, clear of the data; it lists at most `MOST_NAMED` entries."""
    from matplotlib.lines import Line2D

    handles: dict[str, Any] = {}
    for axes in every:
        handles.update(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    if len(handles) > MOST_NAMED:
        hidden = len(handles) - MOST_NAMED + 1
        handles = dict(list(handles.items())[: MOST_NAMED - 1])
        handles[f"and {hidden} more"] = Line2D([], [], linestyle="none")
    names = [broken(name, LONGEST_NAME) for name in handles]
    for ncols in range(columns, 0, -1) if handles else ():
        legend = fig.legend(
            list(handles.values()), names, loc="outside lower center", ncols=ncols, frameon=False
        )
        extent = legend.get_window_extent()
        if ncols == 1 or extent.width <= fig.bbox.width:
            # a tall legend enlarges the figure instead of shrinking the axes
            fig.set_figheight(fig.get_figheight() + max(extent.height / fig.dpi - LOW_LEGEND, 0.0))
            break
        legend.remove()


def broken(name: str, longest: int) -> str:
    """Wrap a name into lines of at most `longest` characters."""
    return "\n".join(textwrap.wrap(name, longest)) or name


def mark_synthetic(fig: Figure) -> None:
    """Mark an exported figure as showing synthetic data, in its title."""
    title = fig.get_suptitle()
    fig.suptitle(f"{title} (synthetic data)" if title else "synthetic data", fontsize=10)


def saved(fig: Figure, kind: str, *, letters: bool = False) -> bytes:
    """Save a figure as "svg", "png" or "pdf"; the same figure gives the same bytes.

    `letters` keeps the text of an SVG as text in the reader's fonts; otherwise it is outlined.
    """
    import matplotlib as mpl

    buffer = io.BytesIO()
    with style():
        mpl.rcParams["svg.fonttype"] = "none" if letters else "path"
        engine = fig.get_layout_engine()
        if engine is not None:  # arrange once; matplotlib would repeat it in every pass
            engine.execute(fig)
            fig.set_layout_engine("none")
        fig.savefig(buffer, format=kind, metadata=NO_DATES[kind], dpi=RESOLUTION)
    return buffer.getvalue()


def _short_numbers(attribute: re.Match[str]) -> str:
    """Round coordinates to an invisible hundredth of a point."""
    return re.sub(r"(\.\d\d)\d+", r"\1", attribute[0])


def inline_svg(fig: Figure, key: str) -> str:
    """Convert a figure to SVG for embedding in a page.

    Ids within it begin with `key`, so that one page can contain several figures. It has a view box
    but no fixed size, and is hidden from screen readers: the page describes it to them.
    """
    key = re.sub(r"[^A-Za-z0-9_-]", "-", key)  # it may hold a name
    text = saved(fig, "svg", letters=True).decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    text = re.sub(r'\b(d|x|y|points)="[^"]*"', _short_numbers, text)
    text = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{key}-", text)
    head, rest = text.split(">", 1)
    view = re.search(r'viewBox="([^"]+)"', head)
    assert view is not None
    return (
        f'<svg viewBox="{view[1]}" xmlns="http://www.w3.org/2000/svg" '
        f'xmlns:xlink="http://www.w3.org/1999/xlink" aria-hidden="true" focusable="false">{rest}'
    )
