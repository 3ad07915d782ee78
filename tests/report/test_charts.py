"""Each chart shows the numbers of the artifacts, with units on its axes."""

import re
from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from report_belt_data import (
    ARCS,
    FRICTION,
    MU,
    RADIUS,
    SPEEDS,
    STATUS,
    TENSION,
    results,
    sheets,
    stating,
    surface,
)

from beltid.report.charts import CHARTS, inline_svg, saved
from beltid.report.figures import sampled
from beltid.report.results import BeltResults

mpl.use("agg")


def drawn(key: str, of: BeltResults | None = None, name: str = "") -> list[Any]:
    """Axes of a chart, of the first artifact that it draws or of a named one."""
    found = [p for p in CHARTS[key].pictures(of or results()) if p.figure]
    return next(p.figure for p in found if name in ("", p.key)).axes


def line(axes: Any, label: str) -> np.ndarray:
    (found,) = (x for x in axes.get_lines() if x.get_label() == label)
    return np.column_stack(found.get_data())


def bars(axes: Any) -> np.ndarray:
    """The points of all error bars."""
    return np.concatenate([np.column_stack(c.lines[0].get_data()) for c in axes.containers])


def in_order(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.T.round(6))]


def test_every_figure_is_drawn_and_its_axes_have_units() -> None:
    found = [p for chart in CHARTS.values() if chart.names for p in chart.pictures(results())]
    pictures = [picture for picture in found if picture.figure]
    assert len(pictures) == 17
    assert len({p.key for p in pictures}) == len(pictures)
    assert any("budget" in picture.caption for picture in found if not picture.figure)
    for picture in pictures:
        labels = [text.get_text() for text in picture.figure.texts]
        for axes in picture.figure.axes:
            labels += [axes.get_xlabel(), axes.get_ylabel()]
        assert sum("[" in text for text in labels) >= 2 - ("budget" in picture.key), picture.key


def test_the_press_is_drawn_with_the_law_of_its_temperature() -> None:
    (axes,) = drawn("press-temperature")
    assert line(axes, "60 °C")[-1] == pytest.approx((100.0, 6.6e7 * 1e-4 + 3.1e11 * 1e-8))
    loading, unloading, law = axes.get_lines()[3:]  # its own test alone, in its own colour
    assert loading.get_xdata().size == unloading.get_xdata().size == 12
    assert loading.get_ydata()[-1] == pytest.approx(1.05 * (6.5e7 * 1e-4 + 3.05e11 * 1e-8))
    assert len({tuple(one.get_color()) for one in (loading, unloading, law)}) == 1


def test_run_over_time_is_the_recorded_one_with_its_phases() -> None:
    above, below = drawn("run")  # of R08, of the largest arc
    assert line(above, "tight span")[-1, 1] == pytest.approx(FRICTION["tension_tight_N"][8])
    assert line(below, "µ, Eq. (6)")[-1, 1] == pytest.approx(MU[8])
    phases = {p.get_label(): p for p in below.patches}
    plateau = phases["sliding plateau"]
    assert (plateau.get_x(), plateau.get_width()) == pytest.approx((2.0, 2.0))
    looks = {(p.get_facecolor(), p.get_hatch()) for p in phases.values()}
    assert len(looks) == len(phases) == 4
    assert (1.0, 1.0, 1.0, 1.0) not in {look for look, _ in looks}  # a swatch on white


def test_measured_coefficients_are_the_runs_that_can_be_used() -> None:
    (axes, *_) = drawn("friction")
    assert len(axes.containers) == len(ARCS) * len(SPEEDS)
    expected = np.column_stack([TENSION / RADIUS, MU])[STATUS == "ok"]
    np.testing.assert_allclose(in_order(bars(axes)), in_order(expected))


def test_map_holds_the_surface_the_points_and_the_range() -> None:
    axes = drawn("map-{name}", name="map-surface")[0]
    box = line(axes, "range of validity")
    assert (box[:, 0].min(), box[:, 0].max()) == (2000.0, 8000.0)
    assert box[:, 1].max() == pytest.approx(10.5)
    assert line(axes, "measured runs (mean of Eq. 8)").shape == (11, 2)
    sheet, table = sheets()["surface"], surface()
    f, v, mu = sampled(sheet, 5, 3)
    assert (f[0], v[-1]) == pytest.approx((2000.0, 10.5))
    assert (mu[0, 0], mu[-1, -1]) == pytest.approx((table["mu"][0], table["mu"][-1]))
    slow = {name: values[table["slip_speed_m_s"] == 0.0025] for name, values in table.items()}
    one = results(surface=replace(sheet, columns=slow))
    box = line(drawn("map-{name}", one, "map-surface")[0], "range of validity")
    assert set(box[:, 1]) == {2.5}  # nothing beside it


def test_measured_against_simulated_are_the_means_over_arcs() -> None:
    belt, sheet = results(), sheets()["compare"]
    keys = [p.key for p in CHARTS["averaged:{name}"].pictures(belt) if p.figure]
    assert keys == ["crossvalidation", "compare_refined", "compare"]
    axes = drawn("averaged:{name}", belt, "compare")[0]
    rows = sheet.rows("averaged")
    for marker, name in (("s", "mu_measured"), ("o", "mu_simulated")):
        drawn_as = [x.get_ydata() for x in axes.get_lines() if x.get_marker() == marker]
        means = sorted(row[name] for row in rows)
        assert sorted(np.concatenate(drawn_as).tolist()) == pytest.approx(means)
    back = [{**row, "pulley_speed_rad_s": -row["pulley_speed_rad_s"]} for row in rows]
    reverse = drawn("averaged:{name}", results(compare=stating(sheet, averaged=back)), "compare")
    assert reverse[0].get_legend_handles_labels()[1] == axes.get_legend_handles_labels()[1]


def test_budget_shows_the_sources_from_the_largest_on_and_their_sum() -> None:
    axes = drawn("budget-{name}")[0]
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["contact arc", "scatter", "combined"]
    assert sorted(p.get_width() for p in axes.patches) == pytest.approx([0.3, 0.4, 0.5])


def test_belts_are_compared_at_a_force_and_a_speed_that_all_have() -> None:
    (over_speed,) = CHARTS["belts-speed"].pictures([results("one"), results("two")])
    assert over_speed.figure is not None
    assert {"one", "two"} <= {x.get_label() for x in over_speed.figure.axes[0].get_lines()}
    assert "4000 N/m" in over_speed.title  # the geometric middle of 2000 and 8000
    at = line(over_speed.figure.axes[0], "one")
    assert at[0] == pytest.approx((2.5, 1.05 * (1.2 - 0.2 + 0.025)))
    (why,) = CHARTS["belts-force"].pictures([results(surface=None, surface_refined=None)])
    assert (why.figure, why.caption) == (None, "no folder has a surface.parquet")


def test_the_same_data_give_the_same_bytes_and_names_within_a_figure_are_its_own() -> None:
    def figure() -> Figure:
        return drawn("slip")[0].figure

    for kind in ("svg", "pdf"):
        assert saved(figure(), kind) == saved(figure(), kind), kind
    text = inline_svg(figure(), "mine")
    names = re.findall(r'\bid="([^"]+)"', text)
    assert names
    assert all(name.startswith("mine-") for name in names)
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', text)) <= set(names)
    assert "<?xml" not in text
