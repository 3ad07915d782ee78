"""Charts of friction: runs (Figs. 12, 16), surface (Fig. 13), measured against simulated (Fig. 17).

Also the belts over each other, the differences run by run and the budgets of uncertainties.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import cycle
from textwrap import fill
from typing import Any, Final

import numpy as np

from beltid.errors import percent
from beltid.report import charts
from beltid.report.charts import NotDrawn, chart, draw
from beltid.report.figures.bench import MILLI, POINTS, TALL
from beltid.report.results import (
    COMPARED,
    HELD_OUT,
    LABELS,
    SIMULATED,
    SURFACES,
    BeltResults,
    Sheet,
    class_name,
    is_setting,
    settings_of,
)
from beltid.report.summary import axis, quantity, sentence

MOST_SPEEDS: Final = 8
"""Largest number of speeds drawn separately; more speeds are grouped into so many classes."""
LEVELS: Final = 12
FORCE, SPEED = "normal_force_N_m", "slip_speed_m_s"
MOST_SOURCES: Final = 8
BASES: Final = {
    "fitted": ("from the data", charts.GROUPS[0], ""),
    "stated": ("stated in the config", charts.GROUPS[2], "..."),
    "assumed": ("assumed (default)", charts.GROUPS[6], "///"),
    "": ("combined", charts.INK, ""),
}
OF: Final = {
    "surface_refined": "of µ on the refined surface",
    "surface": "of µ on the published surface",
    "friction": "of µ of a run",
    "stiffness": "of the normal law, k₁",
}
"""Artifact with a budget -> what its uncertainties are of."""


def over_force(
    axes: Any, data: Mapping[str, Any], mu: str, err: str = "", band: str = "", **look: Any
) -> None:
    """Draw coefficients over the normal force; shade by speed, marker and line by arc.

    Runs of one arc and speed are joined if arcs and speeds repeat. `data` has the columns `mu`,
    `err` or `band`, normal_force_N_m, slip_speed_m_s (else pulley_speed_rad_s) and, of runs,
    arc_deg.
    """
    title, speed = "v [mm/s]", MILLI * np.abs(data[SPEED])
    if not np.isfinite(speed).any():
        title, speed = "ω [rad/s]", np.abs(data["pulley_speed_rad_s"])
    arc = np.nan_to_num(data.get("arc_deg", np.zeros(speed.size)))
    by_speed, by_arc = settings_of(speed, MOST_SPEEDS), settings_of(arc, len(charts.MARKERS))
    joined = all(is_setting(speed[rows]) for rows in by_speed)
    joined &= all(is_setting(arc[rows]) for rows in by_arc)
    pairs = zip(charts.MARKERS, cycle(charts.LINES if joined else ("none",)), strict=False)
    looks: list[Any] = [{"marker": marker, "ls": line, "lw": 0.9, **look} for marker, line in pairs]
    errors: Any = {"err": err, "band": band if joined else ""}
    named = []
    for colour, at_speed in zip(charts.shades(len(by_speed)), by_speed, strict=True):
        for own, at_arc in zip(looks, by_arc, strict=False):
            rows = np.intersect1d(at_speed, at_arc)
            if rows.size:
                draw(axes, data, FORCE, mu, rows, color=colour, **errors, **own)
        named.append((axes.plot([], [], color=colour, lw=4)[0], class_name(speed[at_speed])))
    if named and not axes.figure.legends:
        speeds, names = zip(*named[::-1], strict=True)
        axes.figure.legend(speeds, names, title=title, loc="outside right upper")
    for own, rows in zip(looks if arc.any() else (), by_arc, strict=False):
        axes.plot([], [], color=charts.FAINT, label=f"arc {class_name(arc[rows], '°')}", **own)


def _chosen(sheet: Sheet, rows: np.ndarray) -> dict[str, np.ndarray]:
    return {name: values[rows] for name, values in sheet.columns.items()}


@chart("friction", "Measured friction of every run (Fig. 12)", "friction")
def _measured(axes: Any, friction: Sheet, results: BeltResults) -> str:
    good = friction["status"] == "ok"
    if not good.any():
        raise NotDrawn("no run could be used")
    combined = np.isfinite(friction["mu_sliding_u"]).any()
    error = "mu_sliding_u" if combined else "mu_sliding_se"
    over_force(axes, _chosen(friction, good), "mu_sliding", error)
    errors = "combined standard uncertainties" if combined else "standard errors"
    return (
        f"A point per run, with two {errors}, at the mean normal force of Eq. (8). Shade: sliding "
        "speed; marker: contact arc."
    )


@chart("simulated:{name}", "Simulated friction of every run, {of} surface (Fig. 16)", *SIMULATED)
def _simulated(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    rows = [row for row in sheet.rows("simulated_runs") if row["status"] == "ok"]
    if not rows:
        raise NotDrawn("no simulated run could be used")
    data = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    data[SPEED] = sheet.pulley_radius_m * data["pulley_speed_rad_s"]
    over_force(axes, data, "mu")
    return (
        "The same runs on the simulated rig, each reduced by Eqs. (6) and (8) like a measured one."
    )


@chart("cuts", "The friction surface along the force", *SURFACES, once=True)
def _slices(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    averaged = _chosen(sheet, np.isnan(sheet["arc_deg"]))
    over_force(axes, averaged, "mu", "mu_u" if "mu_u" in averaged else "mu_se")
    return f"A line per speed of the grid, with twice the {sheet.uncertainty}."


def sampled(sheet: Sheet, force: int, speed: int) -> tuple[np.ndarray, ...]:
    """Sample forces [N/m], speeds [mm/s] and mu (force, speed), evenly in logarithms.

    A range of one node is widened by 10 % either way.
    """
    nodes = ((sheet.surface.normal_force_N_m, force), (sheet.surface.slip_speed_m_s, speed))
    fine = []
    for of, count in nodes:
        low, high = (of[0], of[-1]) if of[0] < of[-1] else (0.9 * of[0], 1.1 * of[0] or 1.0)
        fine.append((np.geomspace if low > 0.0 else np.linspace)(low, high, count))
    f, v = fine
    return f, v * MILLI, np.asarray(sheet.surface.mu(f[:, None], v[None, :]))


@chart("map-{name}", "The {of} surface as a map (Fig. 13 (b))", *SURFACES)
def _as_map(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    from matplotlib.ticker import MaxNLocator

    surface = sheet.surface
    f, v, mu = sampled(sheet, 81, 61)
    low, high = float(mu.min()), float(mu.max())
    if high - low < 1e-6 * high:
        low, high = 0.99 * low, 1.01 * high
    levels = MaxNLocator(LEVELS).tick_values(low, high)
    filled = axes.contourf(f, v, mu.T, levels=levels, cmap=charts.ORDERED)
    lines = axes.contour(f, v, mu.T, levels=levels[::2], colors="white", linewidths=0.7)
    axes.clabel(lines, fontsize=10, fmt="%g")
    box_f = surface.normal_force_N_m[[0, -1, -1, 0, 0]]
    box_v = surface.slip_speed_m_s[[0, 0, -1, -1, 0]] * MILLI
    axes.plot(box_f, box_v, "-", color=charts.INK, lw=1.6, label="range of validity")
    if friction := results.get("friction"):
        good = friction["status"] == "ok"
        runs = friction[FORCE][good], MILLI * np.abs(friction[SPEED][good])
        look = {"mfc": "none", "mec": charts.SIMULATED, "ms": 4, "mew": 1.1}
        axes.plot(*runs, "o", label="measured runs (mean of Eq. 8)", **look)
    axes.set(xlabel=axis(FORCE), ylabel=axis(SPEED))
    charts.logarithmic(axes, "y")
    axes.use_sticky_edges = False  # leave a margin around the box and points on it
    axes.margins(0.04)
    axes.grid(False)
    axes.figure.colorbar(filled, ax=axes, label=axis("mu"))
    wider = " The box is wider than the circles: local forces in the contact exceed the mean."
    return "Beyond the box the nearest µ is used." + wider * (sheet.name == "surface_refined")


@chart(
    "surface-space", "The surface in space (Fig. 13 (a))", *SURFACES, once=True, panels=charts.SPACE
)
def _in_space(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    f, v, mu = sampled(sheet, 25, 21)
    axes.figure.set_layout_engine("none")
    axes.set_position((0.09, 0.02, 0.85, 1.0))
    look = {"lw": 0.25, "edgecolor": "#00000055", "rcount": 25, "ccount": 21}
    axes.plot_surface(*np.meshgrid(f, v, indexing="ij"), mu, cmap=charts.ORDERED, **look)
    axes.set_xlabel(axis(FORCE), labelpad=9)
    axes.set_ylabel(axis(SPEED), labelpad=9)
    axes.locator_params(axis="x", nbins=4)
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel("µ [-]", labelpad=8, rotation=90)
    axes.view_init(elev=25, azim=-130)
    axes.set_box_aspect((1.2, 1.0, 0.75), zoom=0.92)
    return "The surface over its range of validity."


def _cut(axes: Any, belts: Sequence[BeltResults], along: str, across: str) -> tuple[str, str]:
    """Draw surfaces over force or speed, at the middle of the common range of the other."""
    surfaces = [(belt.belt, best.surface) for belt in belts if (best := belt.best_surface)]
    if not surfaces:
        raise NotDrawn("no folder has a surface.parquet")
    ends = np.array([getattr(surface, across)[[0, -1]] for _, surface in surfaces])
    low, high = ends[:, 0].max(), ends[:, 1].min()
    value = np.sqrt(low * high) if low > 0.0 else 0.5 * high
    for i, (belt, surface) in enumerate(surfaces):
        x = getattr(surface, along)
        x = np.geomspace(x[0], x[-1], POINTS) if x[0] > 0.0 else x
        at = {along: x, across: np.full(x.size, value)}
        at |= {"mu": surface.mu(**at), "mu_se": surface.mu_se_at(**at)}
        look = charts.group(i, label=belt, markevery=max(1, x.size // 8))
        draw(axes, at, along, "mu", band="mu_se", **look)
    said = "The refined surface of each belt (else the published one), with twice its uncertainty."
    _, unit, scale = quantity(across)
    label = f"{scale * value:.4g} {unit}"
    if low > high:
        said += f" {label} lies outside the range of a belt: its nearest value."
    return f"Friction over {quantity(along)[0]}, at {label}", said


for _key, _along, _across in (("force", FORCE, SPEED), ("speed", SPEED, FORCE)):
    _draw = partial(_cut, along=_along, across=_across)
    chart(f"belts-{_key}", f"Friction of every belt over the {_key}")(_draw)


@chart("averaged:{name}", "Measured against simulated (Fig. 17)", HELD_OUT, *COMPARED)
def _averaged(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    rows = sheet.rows("averaged")
    if not rows:
        raise NotDrawn(f"{sheet.name}.parquet has no means over the arcs")
    data = {k: np.array([row[k] for row in rows]) for k in rows[0] if k != "condition"}
    data["se"] = _scatter(sheet, data)
    data[SPEED] = np.abs(data["pulley_speed_rad_s"]) * sheet.pulley_radius_m  # in either sense
    said = "Means over the arcs. Squares: measured, with two standard errors; circles: simulated"
    surface, band = results.get(dict(zip(COMPARED, SURFACES, strict=True)).get(sheet.name, "")), ""
    if surface is not None:
        band, data["band"] = "band", surface.surface.mu_se_at(data[FORCE], data[SPEED])
        said += f"; band: twice the {surface.uncertainty} of the surface"
    over_force(axes, data, "mu_measured", "se", marker="s", ls="none", ms=4, capsize=2)
    over_force(axes, data, "mu_simulated", band=band, marker="o", mfc="none", ms=8, lw=1.4)
    axes.plot([], [], "s", color=charts.FAINT, label="measured")
    axes.plot([], [], "-o", color=charts.FAINT, mfc="none", ms=8, label="simulated")
    return f"Measured against simulated, {sheet.label} (Fig. 17)", f"{said}."


def _scatter(sheet: Sheet, means: Mapping[str, np.ndarray]) -> np.ndarray:
    """Compute the standard error of each mean over arcs from their scatter; nan for one arc."""
    away = np.zeros(())
    for name in ("nominal_tension_N", "pulley_speed_rad_s"):
        away = away + np.abs(np.nan_to_num(sheet[name][:, None] / means[name] - 1.0))
    of = [sheet["mu_measured"][away.argmin(axis=1) == k] for k in range(means[FORCE].size)]
    return np.array([np.std(mu, ddof=1) / mu.size**0.5 if mu.size > 1 else np.nan for mu in of])


def _shown(sheet: Sheet, results: BeltResults) -> list[Sheet]:
    """Return the comparisons that share a chart: with both surfaces, or that of runs left out."""
    if sheet.name == HELD_OUT:
        return [sheet]
    return [other for name in COMPARED if (other := results.get(name))]


@chart(
    "differences",
    "Simulated less measured, run by run",
    *COMPARED,
    HELD_OUT,
    once=True,
    panels=charts.TWO,
)
def _differences(panels: Any, sheet: Sheet, results: BeltResults) -> str:
    panels[0].figure.set_figheight(TALL)
    said = [
        "Filled: refined surface; open: published surface, which is biased where the force is low. "
        "A slope or curvature shows an effect that the model lacks; scatter is noise."
    ]
    if sheet.name == HELD_OUT:
        said = ["Each run was predicted by a surface refined without its own setting."]
    for one in _shown(sheet, results):
        _run_by_run(panels[0], one, 100.0 * one["difference"] / one["mu_measured"])
        _run_by_run(panels[1], one, one["e_over_u"])
        stated = one.facts.get("validation") or {}
        inside = "their uncertainty is unknown"
        if stated.get("n"):
            inside = f"{stated['within_2u']} of {stated['n']} runs within twice their uncertainty"
        said.append(f"{sentence(one.label)}: {inside}.")
    panels[0].set_ylabel("difference of µ [%]")
    if not np.isfinite(panels[1].dataLim.intervalx).all():
        panels[1].remove()
        panels[0].tick_params(labelbottom=True)
        return " ".join(said)
    panels[0].set_xlabel("")
    panels[1].set_ylabel("over its uncertainty [-]")
    for bound in (-2.0, 2.0):
        panels[1].axhline(bound, color=charts.INK, lw=0.8, ls="--")
    return " ".join(said)


def _run_by_run(axes: Any, sheet: Sheet, values: np.ndarray) -> None:
    """Draw a value of every run over its normal force: marker by arc, colour by surface."""
    data, arc = {FORCE: sheet[FORCE], "mu": values}, sheet["arc_deg"]
    colour = charts.MEASURED if sheet.name == "compare" else charts.SIMULATED
    filled = "none" if sheet.name == "compare" else colour
    look: Any = {"ls": "none", "color": colour, "mfc": filled}
    for marker, rows in zip(charts.MARKERS, settings_of(arc, len(charts.MARKERS)), strict=False):
        name = f"{LABELS.get(sheet.name, 'predicted')}, arc {class_name(arc[rows])}°"
        draw(axes, data, FORCE, "mu", rows, marker=marker, label=name, **look)
    axes.axhline(0.0, color=charts.INK, lw=0.8)


@chart("budget-{name}", "Uncertainty", *OF)
def _budget(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    rows = sheet.rows("budget")
    if not rows:
        raise NotDrawn(f"{sheet.name}.parquet has no budget")
    rows = [row for row in rows if row["quantity"] == rows[0]["quantity"]]
    rows.sort(key=lambda row: -float(row["contribution_percent"] or 0.0))
    total = [row for row in rows if row["source"] == "combined"][:1]
    single = [row for row in rows if row["source"] != "combined"]
    shown, worst = single[:MOST_SOURCES] + total, ""
    axes.figure.set_figheight(1.3 + 0.32 * max(len(shown), 2))
    for k, row in enumerate(shown):
        size = float(row["contribution_percent"] or 0.0)
        words, colour, hatch = BASES["" if row in total else row["basis"]]
        look = {"color": colour, "hatch": hatch, "edgecolor": charts.INK, "lw": 0.6}
        bar = axes.barh(k, size, 0.7, label=words, **look)
        if row in total:
            axes.bar_label(bar, [percent(size)], padding=3)
            worst = f", {percent(row['largest_percent'])} at worst" * bool(row["largest_percent"])
    axes.set_yticks(range(len(shown)), [fill(str(row["source"]), 28) for row in shown])
    axes.invert_yaxis()
    axes.margins(x=0.16)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("standard uncertainty (k = 1) [%]")
    return (
        f"Uncertainty {OF[sheet.name]}",
        f"Contribution of the largest sources, root mean square over the range of the runs{worst}. "
        "Errors that all runs share do not average out.",
    )
