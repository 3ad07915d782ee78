"""Each chart shows the numbers of the artifacts, with units on its axes."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from report_belt_data import (
    ARCS,
    SPEEDS,
    changed,
    friction,
    results,
    sheets,
    stating,
    stiffness,
    surface,
    without,
)

import beltid
from beltid.report.charts import (
    CHARTS,
    NotDrawn,
    Picture,
    group,
    inline_svg,
    legend_below,
    pictures_of,
    saved,
)
from beltid.report.figures import bench
from beltid.report.figures import friction as of_friction
from beltid.report.page import Page, belt_page
from beltid.report.results import BeltResults, Sheet, sheet_of

mpl.use("agg")


def drawn(key: str, of: Any = None) -> list[Picture]:
    found = list(CHARTS[key].pictures(results() if of is None else of))
    return [picture for picture in found if isinstance(picture, Picture)]


def axes_of(picture: Picture) -> list[Any]:
    return picture.figure.axes


def line(axes: Any, label: str) -> np.ndarray:
    (found,) = (x for x in axes.get_lines() if x.get_label() == label)
    return np.column_stack(found.get_data())


def with_sheet(name: str, sheet: Sheet, belt: BeltResults | None = None) -> BeltResults:
    belt = belt or results()
    return replace(belt, sheets={**belt.sheets, name: sheet})


def bars(axes: Any) -> np.ndarray:
    """The points of all error bars."""
    return np.concatenate([np.column_stack(c.lines[0].get_data()) for c in axes.containers])


def test_every_figure_is_drawn_and_its_axes_have_units(drawn_page: Page) -> None:
    pictures = [p for section in drawn_page.sections for p in section.pictures]
    assert len(pictures) == 19
    assert len({p.key for p in pictures}) == len(pictures)
    for picture in pictures:
        labels = [text.get_text() for text in picture.figure.texts]
        for axes in axes_of(picture):
            labels += [axes.get_xlabel(), axes.get_ylabel()]
        units = sum("[" in text for text in labels)
        assert units >= 2 or "budget" in picture.key, (picture.key, labels)
        assert len(picture.caption) > 30, picture.key


@pytest.mark.parametrize("name", ["friction", "compare", "surface"])
def test_a_logarithmic_axis_says_so_in_every_figure(name: str) -> None:
    force = sheets()[name]["normal_force_N_m"]
    wide = changed(sheets()[name], normal_force_N_m=(force / force.min()) ** 3)
    every = [a for p in pictures_of(wide) for a in axes_of(p) if a.name != "3d"]
    sides = [
        (getattr(a, f"get_{x}scale")(), getattr(a, f"get_{x}label")()) for a in every for x in "xy"
    ]
    assert any(scale == "log" for scale, _ in sides)
    for scale, label in sides:
        assert label.endswith(", log") == (scale == "log"), label


def test_law_at_a_temperature_is_that_of_its_row() -> None:
    (picture,) = drawn("press-temperature")
    hot = next(axes for axes in axes_of(picture) if axes.get_title() == "60 °C")
    assert line(hot, "law")[-1] == pytest.approx((100.0, 6.6e7 * 1e-4 + 3.1e11 * 1e-8))
    loading = line(hot, "loading, measured")
    assert loading[-1, 1] == pytest.approx(1.05 * (6.5e7 * 1e-4 + 3.05e11 * 1e-8))
    assert loading.shape[0] == 12  # its own test alone


def test_a_press_that_was_never_unloaded_has_no_branch_of_unloading() -> None:
    curves = sheets()["press_curves"]
    rows = curves["branch"] == "loading"
    loading = replace(curves, columns={k: v[rows] for k, v in curves.columns.items()})
    alone = with_sheet("press_curves", loading)
    alone = with_sheet(
        "stiffness", changed(sheets()["stiffness"], hysteresis_ratio=np.full(3, np.nan)), alone
    )
    for key, both in (
        ("press-temperature", "between loading and unloading"),
        ("press-law", "half-way"),
    ):
        assert both in drawn(key)[0].caption
        (picture,) = drawn(key, alone)
        assert both not in picture.caption
        labels = {str(line.get_label()) for line in axes_of(picture)[0].get_lines()}
        assert any("loading" in label for label in labels)
        assert not any("unloading" in label for label in labels)


def test_influence_of_temperature_is_the_difference_of_the_laws() -> None:
    table, deep = stiffness(), 1e-4
    force = table["k_linear_N_m2"] * deep + table["k_quadratic_N_m3"] * deep**2
    at_60 = line(axes_of(drawn("press-deviation")[0])[0], "60 °C")[-1, 1]
    assert at_60 == pytest.approx(100.0 * (force[1] / force[2] - 1.0))
    d = 5e-5
    got = bench.force_se(sheets()["stiffness"], 2, np.array([d]))
    assert got[0] ** 2 == pytest.approx(1e8 * d**2 - 2e11 * d**3 + 1e15 * d**4)
    sheet = sheets()["stiffness"]
    one = replace(sheet, columns={name: values[[0, -1]] for name, values in sheet.columns.items()})
    (why,) = CHARTS["press-deviation"].pictures(with_sheet("stiffness", one))
    assert "is unknown" in why


def test_slip_is_drawn_over_torque_for_every_setting() -> None:
    unknown = changed(sheets()["slip"], initial_tension_N=np.full(6, np.nan))
    for belt, of in ((results(), "= 310 N"), (with_sheet("slip", unknown), "unknown")):
        containers = axes_of(drawn("slip", belt)[0])[0].containers
        labels = [f"driver {speed} rad/s, T₀ {of}" for speed in (22, 76.8)]
        assert [c.get_label() for c in containers] == labels
        x, y = containers[0].lines[0].get_data()
        assert list(x) == [0.0, 4.0, 8.0]
        assert list(y) == pytest.approx([0.0, 4.0, 8.0])  # mm/s


def test_run_over_time_is_the_recorded_one_with_its_phases() -> None:
    (picture,) = drawn("run")
    above, below = axes_of(picture)
    table = friction()
    assert "R08" in picture.caption  # the typical run of the largest arc
    assert line(above, "tight span")[-1, 1] == pytest.approx(table["tension_tight_N"][8])
    assert line(below, "µ, Eq. (6)")[-1, 1] == pytest.approx(table["mu_sliding"][8])
    phases = {p.get_label(): p for p in below.patches}
    plateau = phases["sliding plateau"]
    assert (plateau.get_x(), plateau.get_width()) == pytest.approx((2.0, 2.0))
    assert phases["peak to sliding"].get_hatch()  # seen in the legend, on white
    (aside,) = drawn("aside-{item}")
    assert "never turned" in aside.caption
    assert "R11" in aside.title
    unknown = changed(sheets()["friction"], mu_sliding_se=np.full(12, np.nan))
    (picture,) = drawn("run", with_sheet("friction", unknown))
    assert "sliding 0.9250" in [text.get_text() for text in picture.figure.legends[0].get_texts()]


def test_normal_force_along_the_arc_is_the_profile() -> None:
    (picture,) = drawn("arc")
    assert len(axes_of(picture)) == len(ARCS)
    points = line(axes_of(picture)[0], "simulated contact")
    assert points[:, 1].max() == pytest.approx(9000.0)
    assert points[-1, 0] == pytest.approx(50.0)  # mm
    assert "1.8 times" in picture.caption  # 9000 over the mean of 5000


def test_measured_coefficients_are_the_runs_that_can_be_used() -> None:
    (picture,) = drawn("friction")
    found, table = bars(axes_of(picture)[0]), friction()
    assert len(axes_of(picture)[0].containers) == len(ARCS) * len(SPEEDS)
    expected = np.column_stack([table["normal_force_N_m"], table["mu_sliding"]])[
        table["status"] == "ok"
    ]
    for points in (found, expected):
        points[:] = points[np.lexsort(points.T.round(6))]
    np.testing.assert_allclose(found, expected)


def over_force(*columns: np.ndarray) -> tuple[Any, list[str], list[str]]:
    """Axes, and names of speeds and arcs."""
    fig = Figure()
    axes = fig.subplots()
    of_friction.over_force(axes, *columns)
    names = [text.get_text() for text in fig.legends[0].get_texts()]
    return axes, names, axes.get_legend_handles_labels()[1]


@pytest.mark.parametrize("high", [130.0, 40.0])  # each its own, or neighbours that chain
def test_a_random_design_is_drawn_in_a_few_classes(high: float) -> None:
    rng = np.random.default_rng(5)
    n = 120
    arc, speed = rng.uniform(35.0, high, n), np.exp(rng.uniform(np.log(2e-3), np.log(5e-2), n))
    force, mu = rng.uniform(500.0, 8000.0, n), rng.uniform(0.5, 1.5, n)
    axes, by_speed, by_arc = over_force(arc, speed, force, mu)
    points = np.concatenate([x.get_xdata() for x in axes.get_lines()])
    assert sorted(points) == pytest.approx(sorted(force))  # every run, once
    assert len(by_speed) == 8
    assert by_speed[-1].startswith(f"{1e3 * speed.min():.3g} to ")
    assert by_speed[0].endswith(f" to {1e3 * speed.max():.3g}")
    assert 1 <= len(by_arc) <= 7
    assert float(by_arc[-1].split()[-1].rstrip("°")) == pytest.approx(arc.max(), rel=0.03)
    runs = [x for x in axes.get_lines() if x.get_xdata().size]
    assert {x.get_linestyle() for x in runs} == {"None"}  # nothing to join


def test_no_setting_is_shared_out_to_two_classes() -> None:
    speeds = np.tile(np.geomspace(1e-3, 0.1, 12), 7)
    _, names, _ = over_force(np.full(84, 82.0), speeds, np.repeat(np.arange(7) + 2e3, 12), speeds)
    ends = [end for name in names for end in name.split(" to ")]
    assert len(names) == 8
    assert len(ends) == len(set(ends)) == 12


def test_a_legend_stays_in_the_figure_and_leaves_room_for_the_axes() -> None:
    fig = Figure(layout="constrained")
    axes = fig.subplots()
    for k in range(30):
        label = f"a belt with a name of many more words than it needs to be told apart {k}"
        axes.plot([0.0, 1.0], [k, k], label=label)
    legend_below(fig, [axes])
    saved(fig, "png")
    (legend,) = fig.legends
    extent = legend.get_window_extent()
    assert extent.x0 >= 0.0
    assert extent.x1 <= fig.bbox.width
    names = ["".join(text.get_text().split()) for text in legend.get_texts()]
    assert names[8].endswith("toldapart8")
    assert names[11:] == ["and19more"]
    assert axes.get_window_extent().height > 2.0 * fig.dpi
    looks = [group(k) for k in range(10)]
    assert len({(look["color"], look["marker"]) for look in looks}) == 10


def test_map_holds_the_surface_the_points_and_the_range() -> None:
    picture = next(p for p in drawn("map-{name}") if p.key == "map-surface")
    box = line(axes_of(picture)[0], "range of validity")
    assert (box[:, 0].min(), box[:, 0].max()) == (2000.0, 8000.0)
    assert box[:, 1].max() == pytest.approx(10.5)
    assert line(axes_of(picture)[0], "measured runs (mean of Eq. 8)").shape == (11, 2)
    sheet, table = sheets()["surface"], surface()
    f, v, mu = of_friction.grid_of(sheet.surface, 5, 3)
    assert (f[0], v[-1]) == pytest.approx((2000.0, 0.0105))
    assert (mu[0, 0], mu[-1, -1]) == pytest.approx((table["mu"][0], table["mu"][-1]))
    slow = {name: values[table["slip_speed_m_s"] == 0.0025] for name, values in table.items()}
    one = pictures_of(replace(sheet, columns=slow))
    box = line(axes_of(next(p for p in one if p.key == "map-surface"))[0], "range of validity")
    assert set(box[:, 1]) == {2.5}  # nothing beside it


def test_the_map_hatches_where_the_friction_falls_with_the_speed() -> None:
    sheet = sheets()["surface"]
    low, high = np.unique(sheet["slip_speed_m_s"])
    flipped = np.where(sheet["slip_speed_m_s"] == low, high, low)
    order = np.lexsort([flipped, sheet["normal_force_N_m"]])
    columns = {name: v[order] for name, v in {**sheet.columns, "slip_speed_m_s": flipped}.items()}
    wet = replace(sheet, columns=columns)
    for one, told in ((wet, "falls with the speed, and"), (sheet, "does not fall with the speed")):
        grid = of_friction.grid_of(one.surface, 5, 3)[:2]
        falling = of_friction.falls_with_speed(one.surface, *grid)
        assert falling.all() if one is wet else not falling.any()
        assert told in next(p for p in pictures_of(one) if p.key == "map-surface").caption


def test_measured_against_simulated_are_the_means_over_arcs() -> None:
    # what was left out comes first
    keys = ["crossvalidation", "compare_refined", "compare"]
    assert [p.key for p in drawn("averaged:{name}")] == keys
    axes = axes_of(drawn("averaged:{name}")[2])[0]
    rows = sheets()["compare"].rows("averaged")
    assert sorted(bars(axes)[:, 1]) == pytest.approx(sorted(row["mu_measured"] for row in rows))
    circles = [x for x in axes.get_lines() if x.get_marker() == "o" and x.get_xdata().size]
    simulated = np.concatenate([x.get_ydata() for x in circles])
    assert sorted(simulated) == pytest.approx(sorted(row["mu_simulated"] for row in rows))
    back = [{**row, "pulley_speed_rad_s": -row["pulley_speed_rad_s"]} for row in rows]
    reverse = drawn(
        "averaged:{name}", with_sheet("compare", stating(sheets()["compare"], averaged=back))
    )
    names = axes_of(reverse[2])[0].get_legend_handles_labels()[1]
    assert names == axes.get_legend_handles_labels()[1]


def test_differences_are_relative_and_in_percent() -> None:
    axes = axes_of(drawn("differences")[0])[0]
    assert line(axes, "published, arc 40°")[:, 1] == pytest.approx(-3.0)
    assert line(axes, "refined, arc 82°")[:, 1] == pytest.approx(0.1)
    predicted = stating(sheets()["crossvalidation"], hold_out="arc")
    said = [f"{p.title} {p.caption}" for p in pictures_of(predicted)]
    assert said[0].startswith("Measured against simulated, runs left out and predicted")
    assert not any("published" in text for text in said)


def test_budget_shows_the_sources_from_the_largest_on_and_their_sum() -> None:
    (picture,) = drawn("budget-{name}-{item}")
    axes = axes_of(picture)[0]
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["contact arc", "scatter", "combined"]
    assert sorted(p.get_width() for p in axes.patches) == pytest.approx([0.3, 0.4, 0.5])


def test_combined_uncertainty_takes_the_place_of_the_scatter() -> None:
    sheet = sheets()["surface"]
    assert sheet.surface.mu_se_at(4000.0, 0.0025) == pytest.approx(0.004)
    wider = changed(sheet, mu_u=np.full(8, 0.01))
    assert wider.surface.mu_se_at(4000.0, 0.0025) == pytest.approx(0.01)
    assert wider.uncertainty == "combined standard uncertainty"


def test_belts_are_compared_at_a_force_and_a_speed_that_all_have() -> None:
    two = [results("one"), results("two")]
    over_force, over_speed = (CHARTS[f"belts-{of}"].picture(two) for of in ("force", "speed"))
    for picture in (over_force, over_speed):
        assert {"one", "two"} <= {x.get_label() for x in axes_of(picture)[0].get_lines()}
    assert "4000 N/m" in over_speed.title  # the geometric middle of 2000 and 8000
    assert "outside" not in over_force.caption + over_speed.caption
    sheet = sheets()["surface_refined"]
    fast = changed(sheet, slip_speed_m_s=100.0 * sheet["slip_speed_m_s"])
    apart = [two[0], with_sheet("surface_refined", fast, two[1])]
    assert "lies outside the range of one, two" in CHARTS["belts-force"].picture(apart).caption
    with pytest.raises(NotDrawn):
        CHARTS["belts-law"].picture([without("stiffness")])


def test_a_figure_that_cannot_be_drawn_says_why() -> None:
    few = results()
    few = replace(few, sheets={name: few.sheets[name] for name in ("friction", "compare_refined")})
    absent = [why for section in belt_page(few, "0" * 64).sections for why in section.absent]
    for missing in ("stiffness", "slip", "surface_refined", "simulated_refined"):
        assert any(f"{missing}.parquet" in why for why in absent), missing
    # the runs over time come from the recording, which a report alone does not read
    assert any("beltid report --config" in why for why in absent)


def test_the_same_data_give_the_same_bytes_and_names_within_a_figure_are_its_own() -> None:
    for kind in ("svg", "pdf"):
        one, two = (saved(drawn("slip")[0].figure, kind) for _ in range(2))
        assert one == two, kind
    text = inline_svg(drawn("slip")[0].figure, "mine")
    names = re.findall(r'\bid="([^"]+)"', text)
    assert names
    assert all(name.startswith("mine-") for name in names)
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', text)) <= set(names)
    assert "<?xml" not in text


TRIANGLE: dict[str, Any] = {
    "initial_tension_N": [300],
    "pulleys": [
        {"name": "driver", "x_m": 0.0, "y_m": 0.0, "radius_m": 0.05},
        {"name": "idler", "x_m": 0.15, "y_m": 0.02, "radius_m": 0.03, "side": "back"},
        {"name": "load", "x_m": 0.30, "y_m": 0.10, "radius_m": 0.06},
    ],
    "operating_points": {"driver_speed_rad_s": [60], "torque_N_m": {"load": [4, 8]}},
}


def test_belt_in_the_drawing_is_closed_and_wraps_as_far_as_the_table_says() -> None:
    made = beltid.simulate_drive({"drive": TRIANGLE}, 1.0, beltid.NormalLaw(6.5e7, 3.0256e11))
    of = sheet_of("drive", made.as_artifact())
    pictures = pictures_of(of)
    assert [p.key for p in pictures] == ["drawing", "loss", "arcs", "along-arcs", "slip-limit"]
    assert "largest torque 8" in pictures[0].caption
    points = [np.column_stack(line.get_data()) for line in pictures[0].figure.axes[0].lines]
    # the rim of each pulley, the belt on it, and the span behind it
    rims, arcs, spans = points[0::3], points[1::3], points[2::3]
    wraps = of["wrap_deg"][3:]
    for i, (rim, arc, wrap) in enumerate(zip(rims, arcs, wraps, strict=True)):
        centre = 0.5 * (rim.min(axis=0) + rim.max(axis=0))
        radius = TRIANGLE["pulleys"][i]["radius_m"]
        assert np.hypot(*(arc - centre).T) == pytest.approx(radius, rel=1e-6)
        turned = np.hypot(*np.diff(arc, axis=0).T).sum() / radius  # chords: a little short
        assert np.degrees(turned) == pytest.approx(wrap, rel=2e-3)
        touching = [spans[i - 1][1], spans[i][0]]  # where the belt runs on, and where it leaves
        tips = arc[[0, -1]]
        assert min(np.abs(tips - touching).max(), np.abs(tips[::-1] - touching).max()) < 1e-9
