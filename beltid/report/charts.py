"""Charts of results: a registered function each, shared by the page and by ``beltid show``.

A chart names the artifacts that it draws, draws into axes and returns its caption. Colours are
those of Okabe and Ito for a few groups and cividis for an ordered quantity; groups also differ in
marker or line, so that grey print tells them apart. Figures are drawn without pyplot: no state, no
display, the same bytes for the same data.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, cast

import numpy as np

from beltid.report.cells import axis
from beltid.report.results import LABELS, BeltResults, Sheet

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
MU: Final = axis("mu")
LINE_FORCE: Final = axis("normal_force_N_m")
SPEED: Final = axis("slip_speed_m_s")
PENETRATION: Final = axis("penetration_m")
TORQUE: Final = axis("torque_N_m")
LOSS: Final = axis("speed_loss_rad_s")
LOGARITHMIC: Final = ", log"
"""Suffix of the label of a logarithmic axis."""
WIDTH: Final = 5.2
"""Width of a figure [in], which still fits a narrow screen."""
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
    "xtick.labelsize": 10.0,
    "ytick.labelsize": 10.0,
    "legend.fontsize": 10.0,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "figure.constrained_layout.use": True,
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
"""Characters per line of a legend entry."""
RESOLUTION: Final = 150
"""Of a PNG, dots per inch."""


class NotDrawn(Exception):
    """The data do not support a chart; the message says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A drawn chart: id within the page, title, caption, and the paper's figure ("" for none)."""

    key: str
    title: str
    caption: str
    figure: Figure
    paper: str = ""


@dataclass(frozen=True, slots=True)
class Chart:
    """A registered chart; see `chart`."""

    key: str
    title: str
    draw: Callable[..., Any]
    names: tuple[str, ...]
    paper: str
    height: float
    panels: tuple[int, int] | None
    columns: int
    once: bool
    each: Callable[..., Any] | None

    def picture(self, *data: Any, **words: str) -> Picture:
        """Draw the chart of some data; `words` complete key and title.

        Raises
        ------
        NotDrawn
            If the data do not support it.
        """
        from matplotlib.figure import Figure

        with style():
            fig = Figure(figsize=(WIDTH, self.height))
            axes: Any = fig
            if self.panels is not None:
                axes = fig.subplots(*self.panels, sharex=True)
            said = self.draw(axes, *data)
            title, caption = said if isinstance(said, tuple) else (self.title.format(**words), said)
            legend_below(fig, fig.axes, self.columns)
        return Picture(self.key.format(**words).rpartition(":")[2], title, caption, fig, self.paper)

    def pictures(self, results: BeltResults) -> Iterator[Picture | str]:
        """Draw the chart of every artifact that it is for; yield in its place why it is not."""
        present = [sheet for name in self.names if (sheet := results.get(name))]
        if not present:
            yield f"{self._named()}: there is no {self.names[0]}.parquet"
        for sheet in present[:1] if self.once else present:
            words = {"name": sheet.name, "of": LABELS.get(sheet.name, sheet.name)}
            items = [(item,) for item in self.each(sheet, results)] if self.each else [()]
            for item in items:
                try:
                    words["item"] = str(*item)
                    yield self.picture(*item, sheet, results, **words)
                except NotDrawn as why:
                    yield f"{self._named(words['of'])}: {why}"

    def _named(self, of: str = "") -> str:
        title = self.title.format(name="", of=of or LABELS.get(self.names[0], ""), item="")
        return f"{title}, {self.paper} of the paper" if self.paper else title


CHARTS: Final[dict[str, Chart]] = {}


def chart(
    key: str,
    title: str,
    *names: str,
    paper: str = "",
    height: float = HEIGHT,
    panels: tuple[int, int] | None = (1, 1),
    columns: int = 3,
    once: bool = False,
    each: Callable[..., Any] | None = None,
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register a function as a chart.

    It is called with the axes, an item of `each` if given, the artifact and the results of the
    belt; it returns its caption, or title and caption.

    Parameters
    ----------
    key, title : str
        Name in the registry, of which the id within the page is what follows a colon, and title;
        with {name} and {of} for name and label of the artifact, {item} for the item.
    *names : str
        Artifacts that it draws, a picture for each that there is; with `once`, for the first.
    paper : str
        Figure of the paper that shows the same.
    height : float
        Height of the figure [in].
    panels : tuple of int or None
        Rows and columns of axes; None for the empty figure.
    columns : int
        Largest number of columns of the legend below.
    each : callable, optional
        Function of artifact and results that lists items, a picture for each.
    """

    def register(draw: Callable[..., Any]) -> Callable[..., Any]:
        CHARTS[key] = Chart(key, title, draw, names, paper, height, panels, columns, once, each)
        return draw

    return register


def pictures_of(sheet: Sheet) -> list[Picture]:
    """Draw all charts of one artifact, the most important first; synthetic data are marked."""
    from beltid.report import figures  # noqa: F401  (registers the charts)

    sheet = sheet.named()
    results = BeltResults(sheet.name, {sheet.name: sheet})
    ours = [chart for chart in CHARTS.values() if sheet.name in chart.names]
    drawn = [
        picture
        for chart in ours
        for picture in chart.pictures(results)
        if isinstance(picture, Picture)
    ]
    for picture in drawn if sheet.origin == "synthetic" else ():
        title = picture.figure.get_suptitle()
        marked = f"{title} (synthetic data)" if title else "synthetic data"
        picture.figure.suptitle(marked, fontsize=10)
    return drawn


@contextmanager
def style() -> Iterator[None]:
    """Draw and save in this style, independent of the user's matplotlib settings."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(cast(Any, STYLE))
        yield


def line(axes: Axes, x: Any, y: Any, err: Any = None, band: Any = None, **look: Any) -> None:
    """Draw y over x, sorted by x, with twice the error as bars or as a band where it is known."""
    order = np.argsort(x, kind="stable")
    x, y = np.asarray(x)[order], np.asarray(y)[order]
    if err is None:
        axes.plot(x, y, **look)
    else:
        axes.errorbar(x, y, 2.0 * np.nan_to_num(np.asarray(err)[order]), **look)
    if band is not None and np.isfinite(band).all():
        width = 2.0 * np.asarray(band)[order]
        axes.fill_between(x, y - width, y + width, color=look["color"], alpha=0.2, lw=0)


def group(index: int, **other: Any) -> dict[str, Any]:
    """Return colour, marker and line of a group; colour and marker are unique up to 49 groups."""
    return {
        "color": GROUPS[index % len(GROUPS)],
        "marker": MARKERS[(index + index // len(GROUPS)) % len(MARKERS)],
        "linestyle": LINES[index % len(LINES)],
    } | other


def shades(count: int) -> list[tuple[float, ...]]:
    """Return the colours of an ordered quantity with `count` values, dark for the lowest."""
    import matplotlib as mpl

    return [mpl.colormaps[ORDERED](0.74 * i / max(count - 1, 1)) for i in range(count)]


def is_wide(values: np.ndarray) -> bool:
    """Return whether values span a factor of five or more, which asks for a logarithmic axis."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and 0.0 < WIDE * finite.min() <= finite.max())


def log_locator(values: np.ndarray) -> LogLocator:
    """Place log-axis ticks at 1, 2 and 5, or at powers of ten over more than two decades."""
    from matplotlib.ticker import LogLocator

    over_decades = np.nanmax(values) > 100.0 * np.nanmin(values)
    return LogLocator(subs=(1.0,) if over_decades else (1.0, 2.0, 5.0))


def logarithmic(axes: Axes, along: Literal["x", "y"], values: np.ndarray) -> None:
    """Make an axis logarithmic with plain numbers, and say so, if its values span a wide range."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    if not is_wide(values):
        return
    getattr(axes, f"set_{along}scale")("log")
    of = getattr(axes, f"{along}axis")
    of.set_label_text(of.get_label_text() + LOGARITHMIC)
    of.set_major_locator(log_locator(values))
    of.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    of.set_minor_formatter(NullFormatter())


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
        legend = fig.legend(list(handles.values()), names, loc="outside lower center", ncols=ncols)
        extent = legend.get_window_extent()
        if ncols == 1 or extent.width <= fig.bbox.width:
            # a tall legend enlarges the figure instead of shrinking the axes
            fig.set_figheight(fig.get_figheight() + max(extent.height / fig.dpi - LOW_LEGEND, 0.0))
            break
        legend.remove()


def broken(name: str, longest: int) -> str:
    """Wrap a name into lines of at most `longest` characters."""
    return "\n".join(textwrap.wrap(name, longest)) or name


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


def inline_svg(fig: Figure, key: str) -> str:
    """Convert a figure to SVG for embedding in a page.

    Ids within it begin with `key`, so that one page can contain several figures. It has a view box
    but no fixed size, and is hidden from screen readers: the page describes it to them.
    """
    key = re.sub(r"[^A-Za-z0-9_-]", "-", key)  # it may hold a name
    text = saved(fig, "svg", letters=True).decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*|<!--.*?-->\s*", "", text, flags=re.DOTALL)
    # round coordinates to an invisible hundredth of a point
    coordinates = re.compile(r'\b(d|x|y|points)="[^"]*"')
    text = coordinates.sub(lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0]), text)
    text = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{key}-", text)
    head, rest = text.split(">", 1)
    (view,) = re.findall(r'viewBox="([^"]+)"', head)
    return (
        f'<svg viewBox="{view}" xmlns="http://www.w3.org/2000/svg" '
        f'xmlns:xlink="http://www.w3.org/1999/xlink" aria-hidden="true" focusable="false">{rest}'
    )
