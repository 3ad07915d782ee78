"""Charts of results: a registered function each, shared by the page and by ``beltid show``.

A chart names the artifacts that it draws, draws into axes and returns its caption. Figures are
drawn without pyplot: no state, no display, the same bytes for the same data. Colours are those of
Okabe and Ito for a few groups and cividis for an ordered quantity; groups also differ in marker or
line, so that grey print tells them apart.
"""

import io
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.style import context
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from beltid.report.results import LABELS, BeltResults, Sheet
from beltid.report.summary import axis, quantity

WIDTH = 5.2  # width of a figure [in], which still fits a narrow screen
HEIGHT, TALL = 4.4, 5.8  # of a figure; of one with two axes above each other, or of a drive
NO_DATES: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}
WIDE = 5.0  # smallest ratio of highest to lowest value for a logarithmic axis
LOW_LEGEND = 0.9  # legend height that fits into a figure of the usual height [in]
HALF_WIDTH = 28  # letters of the longest name of a legend in two columns
RESOLUTION = 150  # of a PNG, dots per inch
INK = "#1a1a1a"
FAINT = "#767676"
GRID = "#dddddd"
MEASURED = "#0072b2"
SIMULATED = "#d55e00"
GROUPS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#000000", "#e69f00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)))
ORDERED = "cividis"
ONE: Mapping[str, Any] = {}  # axes of a chart; one above the other; in space
TWO = {"nrows": 2, "sharex": True}
SPACE = {"subplot_kw": {"projection": "3d"}}
SETTINGS: Any = {
    "font.family": ["DejaVu Sans"],
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


def styled(**other: Any) -> Any:
    """Return a context with this style, independent of the user's matplotlib settings."""
    return context({**SETTINGS, **other}, after_reset=True)


def group(index: int, **other: Any) -> dict[str, Any]:
    """Return colour, marker and line of a group; colour and marker are unique up to 49 groups."""
    return {
        "color": GROUPS[index % len(GROUPS)],
        "marker": MARKERS[(index + index // len(GROUPS)) % len(MARKERS)],
        "ls": LINES[index % len(LINES)],
    } | other


def shades(count: int) -> list[np.ndarray]:
    """Return the colours of an ordered quantity with `count` values, dark for the lowest."""
    return list(mpl.colormaps[ORDERED](0.74 * np.linspace(0.0, 1.0, count)))


class NotDrawn(Exception):
    """The data do not support a chart; the message says why."""


class Picture(NamedTuple):
    """A chart: id within the page, title, and caption, or without a figure why it is not drawn."""

    key: str
    title: str
    caption: str
    figure: Any = None  # of matplotlib


class Chart(NamedTuple):
    """A registered chart; see `chart`."""

    key: str
    title: str
    draw: Callable[..., str | tuple[str, str]]
    names: tuple[str, ...]
    once: bool
    panels: Mapping[str, Any]

    def pictures(self, results: Any) -> list[Picture]:
        """Draw the chart of every artifact that it is for."""
        if not self.names:
            return [self._picture("", results)]
        present = results.every(*self.names)[: 1 if self.once else None]
        return [self._picture(of.name, of, results) for of in present] or [
            Picture(self.key, self._titled(self.names[0]), f"there is no {self.names[0]}.parquet")
        ]

    def _picture(self, name: str, *data: Any) -> Picture:
        key, title = self.key.format(name=name).rpartition(":")[2], self._titled(name)
        with styled():
            fig = Figure(figsize=(WIDTH, TALL if self.panels is TWO else HEIGHT))
            try:
                said = self.draw(fig.subplots(**self.panels), *data)
            except NotDrawn as why:
                return Picture(key, title, str(why))
            for each in fig.axes:
                if each.get_xlabel() in (axis("normal_force"), axis("slip_speed")):
                    logarithmic(each, "x")
            legend_below(fig)
        return Picture(key, *((title, said) if isinstance(said, str) else said), fig)

    def _titled(self, name: str) -> str:
        return self.title.format(of=LABELS.get(name, name))


CHARTS: dict[str, Chart] = {}


def chart(
    key: str,
    title: str,
    *names: str,
    once: bool = False,
    panels: Mapping[str, Any] = ONE,
    **options: Any,
) -> Callable[..., Callable[..., Any]]:
    """Register a function as a chart, a picture for each of its artifacts that there is.

    It is called with axes, artifact and results of the belt (without `names`, with axes and the
    results of several belts), and returns its caption, or title and caption. {name} and {of} are
    name and label of the artifact; what follows a colon of the key is the id within the page.

    once: whether it draws the first of its artifacts only; panels: what axes it gets; other
    options are arguments of the function.
    """

    def register(draw: Callable[..., Any]) -> Callable[..., Any]:
        CHARTS[key] = Chart(key, title, partial(draw, **options), names, once, panels)
        return draw

    return register


def pictures_of(sheet: Sheet) -> list[Picture]:
    """Draw all charts of one artifact, the most important first; synthetic data are marked."""
    from beltid.report import figures  # noqa: F401  (registers the charts)

    results = BeltResults(sheet.name, {sheet.name: sheet})
    charts = (chart for chart in CHARTS.values() if sheet.name in chart.names)
    drawn = [picture for chart in charts for picture in chart.pictures(results) if picture.figure]
    for picture in drawn if sheet.origin == "synthetic" else ():
        picture.figure.suptitle("synthetic data", fontsize=10)
    return drawn


def draw(
    axes: Axes,
    data: Any,
    x: str,
    y: str,
    rows: Any = slice(None),
    *,
    err: str = "",
    band: str = "",
    **look: Any,
) -> None:
    """Draw a column over another in the units of charts, sorted, and label the axes.

    Twice the column `err` is drawn as bars, twice the column `band` as a band where it is known.
    """
    places = np.arange(len(data[x]))[rows]
    places = places[np.argsort(data[x][places], kind="stable")]
    over, up = quantity(x)[2] * data[x][places], quantity(y)[2] * data[y][places]
    wide = 2.0 * quantity(y)[2] * data[err or band][places] if err or band else np.zeros(1)
    if err:
        axes.errorbar(over, up, np.nan_to_num(wide), **look)
    else:
        axes.plot(over, up, **look)
    if band and np.isfinite(wide).all():
        axes.fill_between(over, up - wide, up + wide, color=look["color"], alpha=0.2, lw=0)
    axes.set(xlabel=axis(x), ylabel=axis(y))


def draw_groups(
    axes: Axes, data: Any, x: str, y: str, groups: Iterable[tuple[str, Any]], **look: Any
) -> None:
    """Draw a column over another for groups of rows with their names, each in its own look."""
    for k, (name, rows) in enumerate(groups):
        draw(axes, data, x, y, rows, **group(k, label=name, **look))


def logarithmic(axes: Axes, along: str) -> None:
    """Make an axis logarithmic with plain numbers, and say so, if its data span a wide range."""
    low, high = getattr(axes.dataLim, f"interval{along}")
    if not 0.0 < WIDE * low <= high < np.inf:
        return
    getattr(axes, f"set_{along}scale")("log")
    of = getattr(axes, f"{along}axis")
    of.set_label_text(f"{of.get_label_text()}, log")
    of.set_major_locator(LogLocator(subs=(1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)))
    of.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    of.set_minor_formatter(NullFormatter())


def legend_below(fig: Figure) -> None:
    """Add a legend below the axes; a tall one enlarges the figure."""
    handles: dict[str, Any] = {}
    for axes in fig.axes:
        handles.update(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    names = [textwrap.fill(name, 48) for name in handles]
    if names:
        ncols = 1 if max(map(len, names)) > HALF_WIDTH else 2
        legend = fig.legend(list(handles.values()), names, loc="outside lower center", ncols=ncols)
        height = legend.get_window_extent().height / fig.dpi
        fig.set_figheight(fig.get_figheight() + max(height - LOW_LEGEND, 0.0))


def saved(fig: Figure, kind: str, **style: Any) -> bytes:
    """Save a figure as "svg", "png" or "pdf"; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    with styled(**style):
        if engine := fig.get_layout_engine():  # once; matplotlib would arrange it in every pass
            engine.execute(fig)
            fig.set_layout_engine("none")
        fig.savefig(buffer, format=kind, metadata=NO_DATES[kind], dpi=RESOLUTION)
    return buffer.getvalue()


def inline_svg(fig: Figure, key: str) -> str:
    """Convert a figure to SVG for embedding in a page, its text in the reader's fonts.

    Ids within it begin with `key`, so that one page can contain several figures. It has a view box
    but no fixed size, and is hidden from screen readers: the page describes it to them.
    """
    text = saved(fig, "svg", **{"svg.fonttype": "none"}).decode()
    for pattern, put in (
        (r"<metadata>(?s:.*?)</metadata>\s*|<!--(?s:.*?)-->\s*", ""),
        # round coordinates to an invisible hundredth of a point
        (r'\b(?:d|x|y|points)="[^"]*"', lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0])),
        (r'(\bid="|href="#|url\(#)', rf"\g<1>{key}-"),
    ):
        text = re.sub(pattern, put, text)
    head, rest = text[text.index("<svg") :].split(">", 1)
    (view,) = re.findall(r'viewBox="[^"]+"', head)
    return (
        f'<svg {view} xmlns="http://www.w3.org/2000/svg" '
        f'xmlns:xlink="http://www.w3.org/1999/xlink" aria-hidden="true" focusable="false">{rest}'
    )
