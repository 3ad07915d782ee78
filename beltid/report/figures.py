"""The charts: the press (Figs. 4, 5), the rig (Figs. 10 to 12, 16), the surface (Fig. 13).

Also measured against simulated (Fig. 17), the speed-loss bench (Fig. 9), a predicted drive, several
belts, and budgets of uncertainties. Importing this module registers them.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from beltid.errors import percent
from beltid.report import charts
from beltid.report.charts import SPACE, TWO, NotDrawn, chart, draw, draw_groups, group
from beltid.report.results import (
    COMPARED,
    HELD_OUT,
    SIMULATED,
    SURFACES,
    UNKNOWN,
    BeltResults,
    Sheet,
    class_name,
    clusters,
    is_setting,
    load_name,
    series_of,
)
from beltid.report.summary import axis, cell, quantity, sentence

MILLI = 1e3
FORCE, SPEED = "normal_force_N_m", "slip_speed_m_s"
PRESS = ("penetration_m", "line_force_N_m")
BRANCHES = {"loading": ("-", charts.MEASURED), "unloading": ("--", charts.SIMULATED)}
POINTS = 101
PHASES = (
    ("rest", "#e8e8e8", ""),
    ("build-up", "#f6d9b8", "///"),
    ("peak to sliding", "#efe6f5", "\\\\"),
    ("sliding plateau", "#cfe6f5", ""),
)
MOST_SPEEDS = 8  # drawn separately; more are grouped into so many classes
LEVELS = 12
MOST_SOURCES = 8
BASES = {
    "fitted": ("from the data", charts.GROUPS[0], ""),
    "stated": ("stated in the config", charts.GROUPS[2], "..."),
    "assumed": ("assumed (default)", charts.GROUPS[6], "///"),
    "": ("combined", charts.INK, ""),
}
# artifact with a budget -> what its uncertainties are of
OF = {
    "surface_refined": "of µ on the refined surface",
    "surface": "of µ on the published surface",
    "friction": "of µ of a run",
    "stiffness": "of the normal law, k₁",
}
NOT_READ = (
    "the recording was not read when the report was written; beltid report --config CONFIG reads it"
)
NO_RUN = "no run could be used"


def _chosen(sheet: Sheet, rows: Any) -> dict[str, Any]:
    return {name: values[rows] for name, values in sheet.columns.items()}


def _law(axes: Any, stiffness: Sheet, row: int, rows: Any = slice(None), **look: Any) -> None:
    """Draw the law of a row up to its largest measured penetration."""
    depth = np.linspace(0.0, stiffness["max_penetration_m"][row], POINTS)
    law = {"penetration_m": depth, "line_force_N_m": stiffness.law(row).force(depth)}
    draw(axes, law, *PRESS, rows, **look)


def some(data: Any, why_not: str) -> Any:
    """Return what a chart draws; without any, it is not drawn."""
    if not len(data):
        raise NotDrawn(why_not)
    return data


def _branches(axes: Any, curves: Sheet, rows: Any = True, **look: Any) -> None:
    """Draw branches of the press, each test and cycle a line of its own."""
    for branch, (dash, colour) in BRANCHES.items():
        of = np.flatnonzero(rows & (curves["branch"] == branch))
        own = {"ls": dash, "color": colour, "label": branch, **look}
        for part in series_of(curves["test"][of], curves["cycle"][of].astype(object)).values():
            draw(axes, curves, *PRESS, of[part], **own)


@chart("press-law", "The normal contact law (Fig. 5)", "stiffness")
def _pooled(axes: Any, stiffness: Sheet, results: BeltResults) -> str:
    row = stiffness.pooled_row
    if curves := results.get("press_curves"):
        _branches(axes, curves, alpha=0.7, lw=1.0)
    look = {"color": charts.INK, "lw": 2.0}
    _law(axes, stiffness, row, label="fitted law", **look)
    _law(axes, stiffness, row, [-1], label="largest penetration", marker="o", ms=7, ls="", **look)
    law, unloaded = stiffness.law(row), np.isfinite(stiffness["hysteresis_ratio"][row])
    where = "half-way between loading and unloading" if unloaded else "along the loading"
    k_1, k_2 = (cell("k", value) for value in (law.k_linear_N_m2, law.k_quadratic_N_m3))
    return f"f = k₁ δ + k₂ δ² with k₁ = {k_1} N/m² and k₂ = {k_2} N/m³, per metre of belt, {where}."


@chart("press-temperature", "The press at each temperature (Fig. 4)", "stiffness")
def _by_temperature(axes: Any, stiffness: Sheet, results: BeltResults) -> str:
    (curves,), at = some(results.every("press_curves"), NOT_READ), stiffness["temperature_degC"]
    rows = some(np.flatnonzero(np.isfinite(at)), "the temperatures of the tests are unknown")
    # the curves belong to the law of the nearest temperature
    away = np.abs(curves["temperature_degC"] - at[rows, None])
    for k, colour in enumerate(charts.shades(rows.size)):
        _branches(axes, curves, away[k] <= away.min(axis=0), color=colour, lw=1.0, label="")
        _law(axes, stiffness, rows[k], ls=":", color=colour, lw=2.2, label=f"{at[rows[k]]:g} °C")
    lost = (
        "The area between loading and unloading is the energy lost in a cycle."
        if "unloading" in curves["branch"]
        else "No test was unloaded: the energy lost in a cycle is unknown."
    )
    return f"Solid: loading; dashed: unloading; dotted: the law of the temperature. {lost}"


@chart("run", "Tensions and friction over time (Fig. 10)", "friction", panels=TWO)
def _typical(panels: Any, friction: Sheet, results: BeltResults) -> str:
    (curves,), (above, below) = some(results.every("rig_curves"), NOT_READ), panels
    runs = curves["run"].astype(str)
    is_good = np.isin(friction["run"].astype(str), runs) & (friction["status"] == "ok")
    good = some(np.flatnonzero(is_good), NO_RUN)
    run = _chosen(friction, good[np.argmax(friction["arc_deg"][good])])
    rows = runs == str(run["run"])
    for name, colour, dash in (("tight", charts.MEASURED, "-"), ("slack", charts.SIMULATED, "--")):
        look: dict[str, Any] = {"ls": dash, "color": colour, "lw": 1.1, "label": f"{name} span"}
        draw(above, curves, "time_s", f"tension_{name}_N", rows, **look)
    draw(below, curves, "time_s", "mu", rows, color=charts.INK, lw=1.1, label="µ, Eq. (6)")
    above.set_xlabel("")
    peak, plateau = run.get("peak_time_s", np.nan), run["plateau_start_s"]
    # without a peak the build-up lasts until the plateau
    ends = (run["start_time_s"], np.fmin(peak, plateau), plateau, run["plateau_end_s"])
    begin = curves["time_s"][rows].min()
    for (name, colour, hatch), end in zip(PHASES, ends, strict=True):
        if end > begin:
            face = {"facecolor": colour, "edgecolor": "#b9b9b9", "hatch": hatch, "zorder": 0.4}
            above.axvspan(begin, end, lw=0, **face)
            below.axvspan(begin, end, lw=0.6, label=name, **face)
        begin = end
    sliding, se = run["mu_sliding"], run["mu_sliding_se"]
    label = f"sliding {sliding:.4f}" + (f" ± {se:.2g}" if np.isfinite(se) else "")
    below.axhline(sliding, color=charts.MEASURED, ls="--", lw=1.2, label=label)
    if np.isfinite([peak, run["mu_sticking"]]).all():
        label = f"peak before sliding {run['mu_sticking']:.4f}"
        below.plot(peak, run["mu_sticking"], "v", ms=7, color=charts.SIMULATED, label=label)
    if np.isfinite(mu := curves["mu"][rows]).any():  # spikes must not flatten the curve
        low, high = np.fmax(np.nanpercentile(mu, [0.5, 99.5]), (-np.inf, sliding))
        span = max(high - low, 1e-6)
        below.set_ylim(low - 0.1 * span, high + 0.2 * span)
    return (
        f"Run {run['run']}: arc {run['arc_deg']:.4g}°, {load_name(friction)} "
        f"{run['nominal_tension_N']:.4g} N, v = {MILLI * run['slip_speed_m_s']:.4g} mm/s. At rest, "
        "then µ rises to the peak and settles; the sliding plateau is the result. Tensions as "
        "recorded, with the corrections of the config."
    )


@chart("arc", "Normal force along the arc (Fig. 11)", "friction")
def _along_arc(axes: Any, friction: Sheet, results: BeltResults) -> str:
    needed = "it needs stiffness.parquet, a surface and a simulated recording"
    names, runs = ("arc_position_m", FORCE), some(results.profiles, needed)
    for k, run in enumerate(runs):
        speed = f"v = {MILLI * run[SPEED]:.3g} mm/s"
        label = f"arc {run['arc_deg']:g}°, T₀ = {run['initial_tension_N']:.4g} N, {speed}"
        look = group(k, marker=None, ls="-")
        draw(axes, run, *names, **look, label=label)
        draw(axes, {**run, FORCE: run["capstan_force_N_m"]}, *names, **look | {"ls": "--"})
        axes.axhline(run["mean_force_N_m"], color=look["color"], ls=":")
    axes.set_ylim(bottom=0.0)
    worst = max(np.max(run[FORCE]) / run["mean_force_N_m"] for run in runs)
    return (
        "Solid: simulated contact; dashed: Eq. (8); dotted: its mean. The belt's bending stiffness "
        f"makes peaks where it enters and leaves, up to {worst:.2g} times the mean force of the "
        "run. The published surface does not see them; the refined one does."
    )


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
    by_speed, by_arc = clusters(speed, MOST_SPEEDS), clusters(arc, len(charts.MARKERS))
    classes = [(of, rows) for of, by in ((speed, by_speed), (arc, by_arc)) for rows in by]
    joined = all(is_setting(of[rows]) for of, rows in classes)
    pairs = zip(charts.MARKERS, cycle(charts.LINES if joined else ("none",)), strict=False)
    looks: list[Any] = [{"marker": marker, "ls": line, "lw": 0.9, **look} for marker, line in pairs]
    errors: Any = {"err": err, "band": band if joined else ""}
    named = []
    for colour, at_speed in zip(charts.shades(len(by_speed)), by_speed, strict=True):
        for own, at_arc in zip(looks, by_arc, strict=False):
            if (rows := np.intersect1d(at_speed, at_arc)).size:
                draw(axes, data, FORCE, mu, rows, color=colour, **errors, **own)
        named.append((axes.plot([], [], color=colour, lw=4)[0], class_name(speed[at_speed])))
    if named and not axes.figure.legends:
        axes.figure.legend(*zip(*named[::-1], strict=True), title=title, loc="outside right upper")
    for own, rows in zip(looks if arc.any() else (), by_arc, strict=False):
        axes.plot([], [], color=charts.FAINT, label=f"arc {class_name(arc[rows], '°')}", **own)


def _columns(rows: Sequence[Mapping[str, Any]], why_not: str) -> dict[str, np.ndarray]:
    """Return the columns of a further table; it is not drawn if it is empty."""
    return {name: np.array([row[name] for row in rows]) for name in some(rows, why_not)[0]}


@chart("friction", "Measured friction of every run (Fig. 12)", "friction")
def _measured(axes: Any, friction: Sheet, results: BeltResults) -> str:
    error, errors = "mu_sliding_se", "standard errors"
    if np.isfinite(friction["mu_sliding_u"]).any():
        error, errors = "mu_sliding_u", "combined standard uncertainties"
    good = some(np.flatnonzero(friction["status"] == "ok"), NO_RUN)
    over_force(axes, _chosen(friction, good), "mu_sliding", error)
    return (
        f"A point per run, with two {errors}, at the mean normal force of Eq. (8). Shade: sliding "
        "speed; marker: contact arc."
    )


@chart("simulated:{name}", "Simulated friction of every run, {of} surface (Fig. 16)", *SIMULATED)
def _simulated(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    rows = [row for row in sheet.rows("simulated_runs") if row["status"] == "ok"]
    data = _columns(rows, "no simulated run could be used")
    data[SPEED] = sheet.pulley_radius_m * data["pulley_speed_rad_s"]
    over_force(axes, data, "mu")
    return (
        "The same runs on the simulated rig, each reduced by Eqs. (6) and (8) like a measured one."
    )


@chart("cuts", "The friction surface along the force", *SURFACES, once=True)
def _slices(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    over_force(axes, _chosen(sheet, np.isnan(sheet["arc_deg"])), "mu", sheet.mu_error[0])
    return f"A line per speed of the grid, with twice the {sheet.mu_error[1]}."


def sampled(sheet: Sheet, force: int, speed: int) -> tuple[np.ndarray, ...]:
    """Sample forces [N/m], speeds [mm/s] and mu (force, speed), evenly in logarithms.

    A range of one node is widened by 10 % either way.
    """
    surface, fine = sheet.surface, list[np.ndarray]()
    for nodes, count in ((surface.normal_force_N_m, force), (surface.slip_speed_m_s, speed)):
        low, high = nodes[[0, -1]] if nodes.size > 1 else (0.9 * nodes[0], 1.1 * nodes[0] or 1.0)
        fine.append((np.geomspace if low > 0.0 else np.linspace)(low, high, count))
    return fine[0], fine[1] * MILLI, np.asarray(surface.mu(*np.ix_(*fine)))


@chart("map-{name}", "The {of} surface as a map (Fig. 13 (b))", *SURFACES)
def _as_map(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    f, v, mu = sampled(sheet, 81, 61)
    wider = 0.01 * (np.ptp(mu) < 1e-6 * mu.max())  # of a constant
    levels = MaxNLocator(LEVELS).tick_values((1 - wider) * mu.min(), (1 + wider) * mu.max())
    filled = axes.contourf(f, v, mu.T, levels=levels, cmap=charts.ORDERED)
    lines = axes.contour(f, v, mu.T, levels=levels[::2], colors="white", linewidths=0.7)
    axes.clabel(lines, fontsize=10, fmt="%g")
    box = (
        sheet.surface.normal_force_N_m[[0, -1, -1, 0, 0]],
        sheet.surface.slip_speed_m_s[[0, 0, -1, -1, 0]] * MILLI,
    )
    axes.plot(*box, "-", color=charts.INK, lw=1.6, label="range of validity")
    if friction := results.get("friction"):
        good = friction["status"] == "ok"
        runs = friction[FORCE][good], MILLI * np.abs(friction[SPEED][good])
        look = {"mfc": "none", "mec": charts.SIMULATED, "ms": 4, "mew": 1.1}
        axes.plot(*runs, "o", label="measured runs (mean of Eq. 8)", **look)
    axes.use_sticky_edges = False  # leave a margin around the box and points on it
    axes.set(xlabel=axis(FORCE), ylabel=axis(SPEED), xmargin=0.04, ymargin=0.04)
    charts.logarithmic(axes, "y")
    axes.grid(visible=False)
    axes.figure.colorbar(filled, ax=axes, label=axis("mu"))
    inferred = " The box is wider than the circles: local forces in the contact exceed the mean."
    return "Beyond the box the nearest µ is used." + inferred * (sheet.name == "surface_refined")


@chart("surface-space", "The surface in space (Fig. 13 (a))", *SURFACES, once=True, panels=SPACE)
def _in_space(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    f, v, mu = sampled(sheet, 25, 21)
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


@chart("belts-force", "Friction of every belt over the force", along=FORCE, across=SPEED)
@chart("belts-speed", "Friction of every belt over the speed", along=SPEED, across=FORCE)
def _cut(axes: Any, belts: Sequence[BeltResults], along: str, across: str) -> tuple[str, str]:
    """Draw surfaces over force or speed, at the middle of the common range of the other."""
    found = [(belt.belt, best.surface) for belt in belts if (best := belt.get(*SURFACES))]
    surfaces = some(found, "no folder has a surface.parquet")
    low = max(getattr(surface, across)[0] for _, surface in surfaces)
    high = min(getattr(surface, across)[-1] for _, surface in surfaces)
    value = np.sqrt(low * high) if low > 0.0 else 0.5 * high
    for i, (belt, surface) in enumerate(surfaces):
        x = getattr(surface, along)
        x = np.geomspace(x[0], x[-1], POINTS) if x[0] > 0.0 else x
        at = {along: x, across: np.full(x.size, value)}
        at |= {"mu": surface.mu(**at), "mu_se": surface.mu_se_at(**at)}
        look = group(i, label=belt, markevery=max(1, x.size // 8))
        draw(axes, at, along, "mu", band="mu_se", **look)
    said = "The refined surface of each belt (else the published one), with twice its uncertainty."
    _, unit, scale = quantity(across)
    label = f"{scale * value:.4g} {unit}"
    if low > high:
        said += f" {label} lies outside the range of a belt: its nearest value."
    return f"Friction over {quantity(along)[0]}, at {label}", said


@chart("averaged:{name}", "Measured against simulated (Fig. 17)", HELD_OUT, *COMPARED)
def _averaged(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    data = _columns(sheet.rows("averaged"), f"{sheet.name}.parquet has no means over the arcs")
    # the scatter over the arcs of the runs of each mean
    names = ("nominal_tension_N", "pulley_speed_rad_s")
    away = sum(np.abs(np.nan_to_num(sheet[n][:, None] / data[n] - 1.0)) for n in names)
    of = [sheet["mu_measured"][np.argmin(away, axis=1) == k] for k in range(data[FORCE].size)]
    data["se"] = np.array([np.std(x, ddof=1) / x.size**0.5 if x.size > 1 else np.nan for x in of])
    data[SPEED] = np.abs(data["pulley_speed_rad_s"]) * sheet.pulley_radius_m  # in either sense
    said, band = "Squares: measured, with two standard errors; circles: simulated", ""
    if surface := results.get(dict(zip(COMPARED, SURFACES, strict=True)).get(sheet.name, "")):
        band, data["band"] = "band", surface.surface.mu_se_at(data[FORCE], data[SPEED])
        said += f"; band: twice the {surface.mu_error[1]} of the surface"
    over_force(axes, data, "mu_measured", "se", marker="s", ls="none", ms=4, capsize=2)
    over_force(axes, data, "mu_simulated", band=band, marker="o", mfc="none", ms=8, lw=1.4)
    axes.plot([], [], "s", color=charts.FAINT, label="measured")
    axes.plot([], [], "-o", color=charts.FAINT, mfc="none", ms=8, label="simulated")
    return f"Measured against simulated, {sheet.label} (Fig. 17)", f"Means over the arcs. {said}."


@chart("differences", "Differences run by run", *COMPARED, HELD_OUT, once=True, panels=TWO)
def _differences(panels: Any, sheet: Sheet, results: BeltResults) -> str:
    (above, below), compared = panels, results.every(*COMPARED)
    said = "Each run was predicted by a surface refined without its own setting."
    if compared:
        said = (
            "Filled: refined surface; open: published surface, which is biased where the force is "
            "low. A slope or curvature shows an effect that the model lacks; scatter is noise."
        )
    for one in compared or [sheet]:
        arc, published = one["arc_deg"], one.name == "compare"
        colour = charts.MEASURED if published else charts.SIMULATED
        groups = [
            (f"{one.label}, arc {class_name(arc[rows])}°", rows)
            for rows in clusters(arc, len(charts.MARKERS))
        ]
        look = {"ls": "none", "color": colour, "mfc": "none" if published else colour}
        relative = 100.0 * one["difference"] / one["mu_measured"]
        for axes, values in ((above, relative), (below, one["e_over_u"])):
            draw_groups(axes, {FORCE: one[FORCE], "mu": values}, FORCE, "mu", groups, **look)
            axes.axhline(0.0, color=charts.INK, lw=0.8)
        inside = "their uncertainty is unknown"
        if (stated := one.facts.get("validation") or {}).get("n"):
            inside = f"{stated['within_2u']} of {stated['n']} runs within twice their uncertainty"
        said += f" {sentence(one.label)}: {inside}."
    above.set_ylabel("difference of µ [%]")
    below.set_ylabel("over its uncertainty [-]")
    for bound in (-2.0, 2.0):
        below.axhline(bound, color=charts.INK, lw=0.8, ls="--")
    if np.isfinite(below.dataLim.intervalx).all():
        above.set_xlabel("")
    else:
        below.remove()
        above.tick_params(labelbottom=True)
    return said


@chart("budget-{name}", "Uncertainty", *OF)
def _budget(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    rows = some(sheet.rows("budget"), f"{sheet.name}.parquet has no budget")
    rows = [row for row in rows if row["quantity"] == rows[0]["quantity"]]
    rows.sort(key=lambda row: -float(row["contribution_percent"] or 0.0))
    total = [row for row in rows if row["source"] == "combined"][:1]
    shown, worst = [row for row in rows if row not in total][:MOST_SOURCES] + total, ""
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
    axes.grid(axis="y", visible=False)
    axes.set(xmargin=0.16, xlabel="standard uncertainty (k = 1) [%]")
    return (
        f"Uncertainty {OF[sheet.name]}",
        f"Contribution of the largest sources, root mean square over the range of the runs{worst}. "
        "Errors that all runs share do not average out.",
    )


def by_setting(sheet: Sheet, of: Any = slice(None)) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and rows of every driver speed and belt tension, of some rows of a drive."""
    rows = np.arange(len(sheet["torque_N_m"]))[of]
    series = series_of(sheet["driver_speed_rad_s"][rows], sheet["initial_tension_N"][rows])
    for (speed, tension), places in sorted(series.items()):
        known = "unknown" if tension == UNKNOWN else f"= {tension:.4g} N"
        yield f"driver {speed:.4g} rad/s, T₀ {known}", rows[places]


@chart("slip", "Sliding speed in service (Fig. 9)", "slip")
def _against_torque(axes: Any, slip: Sheet, results: BeltResults) -> str:
    points = (slip, "torque_N_m", SPEED, by_setting(slip))
    draw_groups(axes, *points, err="slip_speed_se_m_s", capsize=2)
    speeds = MILLI * slip.pulley_radius_m * np.array(slip.rig.get("pulley_speeds_rad_s") or ())
    look = {"color": charts.FAINT, "lw": 0.9, "ls": (0, (1, 2))}
    for v in speeds[(speeds > 0.0) & (speeds <= 2.0 * axes.get_ylim()[1])]:
        axes.axhline(v, label="speeds of the friction rig", **look)
    axes.set_xlabel("torque of the driven pulley [N m]")
    return (
        "Largest sliding speed between belt and pulley, from the speed loss of the two-pulley "
        "drive by Eq. (7), with two standard errors."
    )


@chart("drawing", "The drive and its forces", "drive")
def _drawing(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    torque = np.abs(sheet["torque_N_m"])
    steady = np.where(np.isfinite(sheet["speed_loss_rad_s"]), np.nan_to_num(torque), 0.0)
    none = "no point has a steady torque, or the places of the pulleys are unknown"
    laid = some(sheet.rows("laid") if steady.any() else [], none)
    run = sheet["run"][np.argmax(steady)]
    rows = np.flatnonzero(sheet["run"] == run)
    speed = sheet["driver_speed_rad_s"][rows[0]]
    leaving = sheet["tension_out_N" if speed > 0.0 else "tension_in_N"][rows]
    centres = np.array([(pulley["x_m"], pulley["y_m"]) for pulley in laid])
    size, middle = max(pulley["radius_m"] for pulley in laid), centres.mean(axis=0)
    wide, high = np.ptp(centres, axis=0) + 4.0 * size
    axes.figure.set_figheight(min(charts.WIDTH * high / wide, charts.TALL))
    white = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
    centred: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 10}
    look: dict[str, Any] = {"facecolor": charts.GRID, "edgecolor": charts.INK, "lw": 2.0}
    for centre, pulley, row, tension in zip(centres, laid, rows, leaving, strict=True):
        axes.add_patch(Circle(tuple(centre), pulley["radius_m"], **look))
        span = np.stack([pulley["leaves_m"], pulley["arrives_m"]])
        axes.plot(*span.T, color=charts.INK, lw=2.0)
        axes.text(*span.mean(axis=0), f"{tension:.0f} N", bbox=white, **centred)
        outwards = (centre - middle) / np.hypot(*(centre - middle))
        place = centre + (pulley["radius_m"] + 0.6 * size) * outwards
        force = f"{pulley['pulley']}\n{sheet['hub_force_N'][row]:.0f} N"
        axes.text(*place, force, color=charts.SIMULATED, **centred)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xmargin=0.2, ymargin=0.2)
    axes.grid(visible=False)
    return (
        f"Point {run}, {abs(speed):.4g} rad/s, largest torque {np.nanmax(torque[rows]):.3g} N m. "
        "At the spans: belt tension; at the pulleys: force of the belt on the axis."
    )


@chart("loss", "Predicted speed loss over torque", "drive")
def _loss(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    loses = np.nan_to_num(sheet["speed_loss_rad_s"]) != 0.0
    driven = np.where(loses, np.abs(np.nan_to_num(sheet["torque_N_m"])), -1.0)
    pulley = str(sheet["pulley"][int(np.argmax(driven))])
    groups = list(by_setting(sheet, sheet["pulley"] == pulley))
    draw_groups(axes, sheet, "torque_N_m", "loss_creep_rad_s", groups, marker=None, lw=0.6)
    draw_groups(axes, sheet, "torque_N_m", "speed_loss_rad_s", groups, band="speed_loss_u_rad_s")
    return (
        f"Predicted speed loss of {pulley} over its torque",
        "A line per driver speed and belt tension, with two standard uncertainties. Thin lines: "
        "creep alone.",
    )


@chart("comparison", "Speed loss of the drive, measured and predicted", "compare_drive")
def _compared(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    groups = list(by_setting(sheet))
    points: dict[str, Any] = {"ls": "none", "err": "u_measured_rad_s"}
    draw_groups(axes, sheet, "torque_N_m", "loss_predicted_rad_s", groups, marker=None)
    draw_groups(axes, sheet, "torque_N_m", "loss_measured_rad_s", groups, **points)
    return (
        "Points: the bench, with two standard errors. Lines: predicted from the identified laws, "
        "which were not fitted to this recording."
    )
