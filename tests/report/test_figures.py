"""Each figure shows the numbers of the artifacts, with units on its axes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from report_belt_data import (
    ARCS,
    SPEEDS,
    friction,
    results,
    sheets,
    stating,
    stiffness,
    surface,
    without,
)

from beltid.report.belt_page import belt_page
from beltid.report.drawing import figure, group, inline_svg, legend_below, saved
from beltid.report.figures import arc, belts, budget, press, proof, runs, single, slip
from beltid.report.figures import friction as friction_figures
from beltid.report.figures import surface as surface_figures
from beltid.report.html import Page
from beltid.report.picture import Picture


def axes_of(picture: Picture) -> list[Any]:
    assert picture.figure is not None, picture.caption
    return picture.figure.axes


def line(axes: Any, label: str) -> np.ndarray:
    (found,) = (x for x in axes.get_lines() if x.get_label() == label)
    return np.column_stack(found.get_data())


def test_every_figure_is_drawn_and_its_axes_have_units(drawn_page: Page) -> None:
    pictures = [p for section in drawn_page.sections for p in section.pictures]
    assert len(pictures) == 18
    assert len({p.key for p in pictures}) == len(pictures)
    for picture in pictures:
        labels = [text.get_text() for text in picture.figure.texts]  # type: ignore[union-attr]
        for axes in axes_of(picture):
            labels += [axes.get_xlabel(), axes.get_ylabel()]
        shown = [text for text in labels if text]
        assert (
            sum("[" in text for text in shown) >= 2
            or "budget" in picture.key
            or (picture.key == "belts-agreement")
        ), (picture.key, shown)
        assert len(picture.caption) > 40, picture.key


@pytest.mark.parametrize("name", ["friction", "compare", "surface"])
def test_a_logarithmic_axis_says_so_in_every_figure(name: str) -> None:
    sheet = sheets()[name]
    force = sheet["normal_force_N_m"]
    wide = (force / force.min()) ** 3  # over more than a factor of five
    columns = {**sheet.columns, "normal_force_N_m": wide}
    drawn = [
        axes
        for p in single.pictures(replace(sheet, columns=columns))
        for axes in axes_of(p)
        if axes.name != "3d"
    ]
    sides = [
        (getattr(a, f"get_{x}scale")(), getattr(a, f"get_{x}label")()) for a in drawn for x in "xy"
    ]
    assert any(scale == "log" for scale, _ in sides)
    for scale, label in sides:
        assert label.endswith(", log") == (scale == "log"), label


def test_law_at_a_temperature_is_that_of_its_row() -> None:
    picture = press.by_temperature(results().sheets["stiffness"], results().get("press_curves"))
    hot = next(axes for axes in axes_of(picture) if axes.get_title() == "60 °C")
    depth, force = line(hot, "law")[-1]
    assert depth == pytest.approx(100.0)
    assert force == pytest.approx(6.6e7 * 1e-4 + 3.1e11 * 1e-8)
    loading = line(hot, "loading, measured")
    assert loading[-1, 1] == pytest.approx(1.05 * (6.5e7 * 1e-4 + 3.05e11 * 1e-8))
    assert loading.shape[0] == 12  # its own test alone


def test_a_press_that_was_never_unloaded_has_no_branch_of_unloading() -> None:
    curves = sheets()["press_curves"]
    rows = curves["branch"] == "loading"
    loading = replace(curves, columns={k: v[rows] for k, v in curves.columns.items()})
    ratio = np.full(3, np.nan)
    laws = sheets()["stiffness"]
    alone = replace(laws, columns={**laws.columns, "hysteresis_ratio": ratio})
    for drawn, both in ((press.by_temperature, "unloading (dashed)"), (press.pooled, "half-way")):
        assert both in drawn(laws, curves).caption
        picture = drawn(alone, loading)
        assert both not in picture.caption
        labels = {str(line.get_label()) for line in axes_of(picture)[0].get_lines()}
        assert any("loading" in label for label in labels)
        assert not any("unloading" in label for label in labels)


def test_influence_of_temperature_is_the_difference_of_the_laws() -> None:
    axes = axes_of(press.deviation(results().sheets["stiffness"]))[0]
    table = stiffness()
    deep = 1e-4
    force = table["k_linear_N_m2"] * deep + table["k_quadratic_N_m3"] * deep**2
    assert line(axes, "60 °C")[-1, 1] == pytest.approx(100.0 * (force[1] / force[2] - 1.0))


def test_one_temperature_shows_no_influence_of_it() -> None:
    sheet = results().sheets["stiffness"]
    warm = {name: values[[0, -1]] for name, values in sheet.columns.items()}
    picture = press.deviation(replace(sheet, columns=warm))
    assert picture.figure is None
    assert "is unknown" in picture.caption


def test_error_of_the_law_comes_from_its_covariance() -> None:
    depth = np.array([5e-5])
    got = press.force_se(results().sheets["stiffness"], 2, depth)
    d = depth[0]
    assert got[0] ** 2 == pytest.approx(1e8 * d**2 - 2e11 * d**3 + 1e15 * d**4)


def test_slip_is_drawn_over_torque_for_every_setting() -> None:
    (picture,) = slip.pictures(results())
    containers = axes_of(picture)[0].containers
    assert len(containers) == 2
    x, y = containers[0].lines[0].get_data()
    assert list(x) == [0.0, 4.0, 8.0]
    assert list(y) == pytest.approx([0.0, 4.0, 8.0])  # mm/s


def test_belts_side_by_side_show_what_each_measured_and_what_was_simulated() -> None:
    one, other = results("one"), results("other")
    columns = dict(other.get("friction").columns)
    columns["mu_sliding"] = 1.1 * columns["mu_sliding"]
    changed = replace(other.get("friction"), columns=columns)
    other = replace(other, sheets={**other.sheets, "friction": changed})
    first, second = axes_of(belts.measured([one, other]))[0].containers
    f, mu = first[0].get_data()
    friction = one.get("friction")
    rows = [i for i, m in enumerate(friction["mu_sliding"]) if m in mu]
    assert len(rows) == mu.size > 3
    assert set(friction["status"][rows]) == {"ok"}
    assert len(set(friction["pulley_speed_rad_s"][rows])) == 1  # one speed
    assert f == pytest.approx(friction["normal_force_N_m"][rows])
    assert second[0].get_data()[1] == pytest.approx(1.1 * mu)
    lines = axes_of(belts.proof([one, other]))[0].get_lines()
    measured, simulated = lines[0].get_ydata(), lines[1].get_ydata()
    assert simulated == pytest.approx(1.001 * measured)  # the refined comparison of the data
    assert belts.measured([without("friction")]).figure is None
    no_rows = replace(friction, columns={name: v[:0] for name, v in friction.columns.items()})
    empty = replace(one, sheets={**one.sheets, "friction": no_rows})
    assert belts.measured([empty]).figure is None
    assert len(axes_of(belts.measured([one, empty]))[0].containers) == 1
    n = 200  # a random design: each run has a speed of its own, eight classes of them
    many = {name: np.resize(values, n) for name, values in friction.columns.items()}
    many |= {"status": np.array(["ok"] * n), "slip_speed_m_s": np.geomspace(-0.1, -0.001, n)}
    sheet = replace(one.get("friction"), columns=many)
    alone = replace(one, sheets={**one.sheets, "friction": sheet})
    (drawn,) = axes_of(belts.measured([alone]))[0].containers
    assert drawn[0].get_xdata().size == 25


def test_slip_at_an_unknown_tension_is_drawn_as_well() -> None:
    sheet = results().sheets["slip"]
    columns = {**sheet.columns, "initial_tension_N": np.full(6, np.nan)}
    picture = slip.against_torque(type(sheet)("slip", "slip", columns))
    labels = [c.get_label() for c in axes_of(picture)[0].containers]
    assert labels == ["driver 22 rad/s, T₀ unknown", "driver 76.8 rad/s, T₀ unknown"]
    assert all(len(c.lines[0].get_xdata()) == 3 for c in axes_of(picture)[0].containers)


def test_run_over_time_is_the_recorded_one_with_its_phases() -> None:
    (picture,) = runs.pictures(results())
    above, below = axes_of(picture)
    table = friction()
    assert "R08" in picture.caption  # the typical run of the largest arc
    assert line(above, "tight span")[-1, 1] == pytest.approx(table["tension_tight_N"][8])
    assert line(below, "µ, Eq. (6)")[-1, 1] == pytest.approx(table["mu_sliding"][8])
    spans = {p.get_label(): p.get_extents() for p in below.patches}
    assert "sliding plateau" in spans
    plateau = next(p for p in below.patches if p.get_label() == "sliding plateau")
    assert (plateau.get_x(), plateau.get_width()) == pytest.approx((2.0, 2.0))


def test_a_run_set_aside_is_shown_with_its_reason() -> None:
    (picture,) = runs.set_aside(results())
    assert "never turned" in picture.caption
    assert "R11" in picture.title


def test_normal_force_along_the_arc_is_the_profile() -> None:
    (picture,) = arc.pictures(results())
    assert len(axes_of(picture)) == len(ARCS)
    points = line(axes_of(picture)[0], "simulated contact")
    assert points[:, 1].max() == pytest.approx(9000.0)
    assert points[-1, 0] == pytest.approx(50.0)  # mm
    assert "1.8 times" in picture.caption  # 9000 over the mean of 5000


def test_measured_coefficients_are_the_runs_that_can_be_used() -> None:
    (picture,) = friction_figures.measured(results())
    found = np.concatenate(
        [np.column_stack(c.lines[0].get_data()) for c in axes_of(picture)[0].containers]
    )
    table = friction()
    good = table["status"] == "ok"
    assert len(axes_of(picture)[0].containers) == len(ARCS) * len(SPEEDS)
    expected = np.column_stack([table["normal_force_N_m"], table["mu_sliding"]])[good]
    for points in (found, expected):
        points[:] = points[np.lexsort(points.T.round(6))]
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize("runs_at", ["each its own", "close together"])
def test_a_random_design_is_drawn_in_a_few_classes(runs_at: str) -> None:
    rng = np.random.default_rng(5)
    n = 120
    high = 130.0 if runs_at == "each its own" else 40.0  # neighbours that chain into one another
    arc, speed = rng.uniform(35.0, high, n), np.exp(rng.uniform(np.log(2e-3), np.log(5e-2), n))
    force, mu = rng.uniform(500.0, 8000.0, n), rng.uniform(0.5, 1.5, n)
    fig = friction_figures.over_force(arc, speed, force, mu, None)
    (axes,) = fig.axes
    drawn = np.concatenate([np.column_stack(c.lines[0].get_data()) for c in axes.containers])
    assert sorted(drawn[:, 0]) == pytest.approx(sorted(force))  # every run, once
    by_speed, by_arc = ([t.get_text() for t in one.get_texts()] for one in fig.legends)
    assert len(by_speed) == 8
    assert by_speed[-1].startswith(f"{1e3 * speed.min():.3g} to ")
    assert by_speed[0].endswith(f" to {1e3 * speed.max():.3g}")
    assert 1 <= len(by_arc) <= 7
    assert float(by_arc[-1].split()[-1].rstrip("°")) == pytest.approx(arc.max(), rel=0.03)
    assert {line.get_linestyle() for line in axes.get_lines()} <= {"None"}  # nothing to join


def test_no_setting_is_shared_out_to_two_classes() -> None:
    speeds = np.tile(np.geomspace(1e-3, 0.1, 12), 7)
    fig = friction_figures.over_force(
        np.full(84, 82.0), speeds, np.repeat(np.arange(7) + 2e3, 12), speeds, None
    )
    names = [text.get_text() for text in fig.legends[0].get_texts()]
    ends = [end for name in names for end in name.split(" to ")]
    assert len(names) == 8
    assert len(ends) == len(set(ends)) == 12


def test_a_legend_of_long_names_stays_in_the_figure_and_leaves_room_for_the_axes() -> None:
    fig = figure()
    axes = fig.subplots()
    for k in range(9):
        label = f"a belt with a name of many more words than it needs to be told apart {k}"
        axes.plot([0.0, 1.0], [k, k], label=label)
    legend_below(fig, [axes])
    saved(fig, "png")
    (legend,) = fig.legends
    extent = legend.get_window_extent()
    assert extent.x0 >= 0.0
    assert extent.x1 <= fig.bbox.width
    assert "".join(legend.get_texts()[8].get_text().split()).endswith("toldapart8")
    assert axes.get_window_extent().height > 2.0 * fig.dpi


def test_ten_groups_differ_without_their_lines() -> None:
    looks = [group(k) for k in range(10)]
    assert len({(look["color"], look["marker"]) for look in looks}) == 10


def test_a_legend_of_many_lines_names_the_first_ones() -> None:
    fig = figure()
    axes = fig.subplots()
    for k in range(30):
        axes.plot([0.0, 1.0], [k, k], label=f"run {k}")
    legend_below(fig, [axes])
    named = [text.get_text() for text in fig.legends[0].get_texts()]
    assert named == [*(f"run {k}" for k in range(11)), "and 19 more"]


def test_map_holds_the_surface_the_points_and_the_range() -> None:
    sheet = results().sheets["surface"]
    axes = axes_of(surface_figures.as_map(sheet, results().get("friction")))[0]
    box = line(axes, "range of validity")
    assert box[:, 0].min() == 2000.0
    assert box[:, 0].max() == 8000.0
    assert box[:, 1].max() == pytest.approx(10.5)
    assert line(axes, "measured runs (mean of Eq. 8)").shape == (11, 2)
    f, v, mu = surface_figures.grid_of(sheet.surface, 5, 3)
    table = surface()
    assert mu[0, 0] == pytest.approx(table["mu"][0])
    assert mu[-1, -1] == pytest.approx(table["mu"][-1])
    assert f[0] == pytest.approx(2000.0)
    assert v[-1] == pytest.approx(0.0105)
    table = surface()
    slow = {name: values[table["slip_speed_m_s"] == 0.0025] for name, values in table.items()}
    one = surface_figures.as_map(replace(sheet, columns=slow), None)
    assert set(line(axes_of(one)[0], "range of validity")[:, 1]) == {2.5}  # nothing beside it


def test_measured_against_simulated_are_the_means_over_arcs() -> None:
    whole = results()
    axes = axes_of(proof.averaged(whole.sheets["compare"], whole))[0]
    measured = np.concatenate([np.column_stack(c.lines[0].get_data()) for c in axes.containers])
    rows = whole.sheets["compare"].stated("averaged")
    assert sorted(measured[:, 1]) == pytest.approx(sorted(row["mu_measured"] for row in rows))
    drawn = [x for x in axes.get_lines() if x.get_marker() == "o" and x.get_xdata().size]
    simulated = np.concatenate([x.get_ydata() for x in drawn])
    assert sorted(simulated) == pytest.approx(sorted(row["mu_simulated"] for row in rows))
    backwards = [{**row, "pulley_speed_rad_s": -row["pulley_speed_rad_s"]} for row in rows]
    reverse = stating(whole.sheets["compare"], averaged=backwards)
    names = axes_of(proof.averaged(reverse, whole))[0].get_legend_handles_labels()[1]
    assert names == axes.get_legend_handles_labels()[1]


def test_differences_are_relative_and_in_percent() -> None:
    whole = results()
    picture = proof.differences([whole.sheets["compare"], whole.sheets["compare_refined"]])
    axes = axes_of(picture)[0]
    assert line(axes, "published, arc 40°")[:, 1] == pytest.approx(-3.0)
    assert line(axes, "refined, arc 82°")[:, 1] == pytest.approx(0.1)


def test_budget_shows_the_sources_from_the_largest_on_and_their_sum() -> None:
    (picture,) = budget.pictures(results())
    axes = axes_of(picture)[0]
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["contact arc", "scatter", "combined"]
    assert sorted(p.get_width() for p in axes.patches) == pytest.approx([0.3, 0.4, 0.5])


def test_combined_uncertainty_takes_the_place_of_the_scatter() -> None:
    sheet = results().sheets["surface"]
    assert sheet.surface.mu_se_at(4000.0, 0.0025) == pytest.approx(0.004)
    columns = {**sheet.columns, "mu_u": np.full(8, 0.01)}
    wider = type(sheet)("surface", "surface", columns)
    assert wider.surface.mu_se_at(4000.0, 0.0025) == pytest.approx(0.01)
    assert wider.uncertainty == "combined standard uncertainty"


def test_belts_are_compared_at_a_force_and_a_speed_that_all_have() -> None:
    two = [results("one"), results("two")]
    over_force, over_speed = belts.friction(two)
    for picture in (over_force, over_speed):
        lines = {x.get_label(): x for x in axes_of(picture)[0].get_lines()}
        assert {"one", "two"} <= set(lines)
    assert "f = 4000 N/m" in over_speed.title  # the geometric middle of 2000 and 8000
    assert "outside" not in over_force.caption + over_speed.caption
    columns = two[1].best_surface.columns
    fast = replace(
        two[1].best_surface,
        columns={**columns, "slip_speed_m_s": 100.0 * columns["slip_speed_m_s"]},
    )
    apart = [two[0], replace(two[1], sheets={**two[1].sheets, "surface_refined": fast})]
    assert "lies outside the range of one, two" in belts.friction(apart)[0].caption
    widths = sorted(p.get_width() for p in axes_of(belts.agreement(two))[0].patches)
    assert widths == pytest.approx([0.1, 0.1, 3.0, 3.0])


def test_a_figure_that_cannot_be_drawn_says_why() -> None:
    few = results()
    few = replace(few, sheets={name: few.sheets[name] for name in ("friction", "compare_refined")})
    page = belt_page(few, "0" * 64)
    absent = [p for section in page.sections for p in section.pictures if p.figure is None]
    for missing in ("stiffness", "slip", "surface_refined", "compare"):
        assert any(f"{missing}.parquet" in p.caption for p in absent), missing
    # the runs over time come from the recording, which a report alone does not read
    assert any("beltid report --config" in p.caption for p in absent)
    assert any(
        "friction.parquet" in p.caption for p in friction_figures.measured(without("friction"))
    )


def test_the_same_data_give_the_same_bytes() -> None:
    for kind in ("svg", "pdf"):
        one, two = (saved(slip.pictures(results())[0].figure, kind) for _ in range(2))
        assert one == two, kind


def test_names_within_a_figure_are_its_own() -> None:
    picture = slip.pictures(results())[0]
    assert picture.figure is not None
    text = inline_svg(picture.figure, "mine")
    import re

    names = re.findall(r'\bid="([^"]+)"', text)
    assert names
    assert all(name.startswith("mine-") for name in names)
    used = re.findall(r'(?:href="#|url\(#)([^")]+)', text)
    assert set(used) <= set(names)
    assert "<?xml" not in text


def test_the_map_hatches_where_the_friction_falls_with_the_speed() -> None:
    sheet = results().sheets["surface"]
    flipped = {**sheet.columns, "slip_speed_m_s": np.copy(sheet.columns["slip_speed_m_s"])}
    low, high = np.unique(flipped["slip_speed_m_s"])
    flipped["slip_speed_m_s"] = np.where(flipped["slip_speed_m_s"] == low, high, low)
    order = np.lexsort([flipped["slip_speed_m_s"], flipped["normal_force_N_m"]])
    wet = type(sheet)("surface", "surface", {name: v[order] for name, v in flipped.items()})
    rising, falling = (
        surface_figures.falls_with_speed(
            one.surface, *surface_figures.grid_of(one.surface, 5, 3)[:2]
        )
        for one in (sheet, wet)
    )
    assert not rising.any()
    assert falling.all()
    assert "falls with the speed" in surface_figures.as_map(wet, None).caption
    assert "does not fall with the speed anywhere" in surface_figures.as_map(sheet, None).caption
