"""Charts of the benches: the press (Figs. 4, 5), the speed loss (Fig. 9), runs over time (Fig. 10).

Also the normal force along the arc (Fig. 11).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from beltid.report.cells import MICRO, MILLI, axis, scientific
from beltid.report.charts import (
    FAINT,
    GROUPS,
    INK,
    LINE_FORCE,
    LINES,
    MEASURED,
    MU,
    PENETRATION,
    SIMULATED,
    SPEED,
    NotDrawn,
    chart,
    group,
    line,
)
from beltid.report.conditions import UNKNOWN_TENSION, series_of
from beltid.report.results import BeltResults, Sheet

BRANCHES: Final = {"loading": ("-", MEASURED), "unloading": ("--", SIMULATED)}
NO_CURVES: Final = (
    "the recording was not read when the report was written; beltid report --config CONFIG reads it"
)
POINTS: Final = 101
PHASES: Final = (
    ("rest", "#e8e8e8", ""),
    ("build-up", "#f6d9b8", "///"),
    ("peak to sliding", "#ffffff", "..."),
    ("sliding plateau", "#cfe6f5", ""),
)


def curve(stiffness: Sheet, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Return penetration [µm] and force [N/m] of a law up to its largest measured penetration."""
    depth = np.linspace(0.0, stiffness["max_penetration_m"][row], POINTS)
    return MICRO * depth, stiffness.law(row).force(depth)


@chart("press-law", "The normal contact law", "stiffness", paper="Fig. 5")
def pooled(axes: Any, stiffness: Sheet, results: BeltResults) -> str:
    """Draw the pooled law through all branches."""
    row, curves = stiffness.pooled_row, results.get("press_curves")
    if curves is not None:
        for branch, (style, colour) in BRANCHES.items():
            look = {"color": colour, "alpha": 0.7, "lw": 1.0, "label": f"{branch}, all tests"}
            _branch(axes, curves, curves["branch"] == branch, ls=style, **look)
    x, force = curve(stiffness, row)
    axes.plot(x, force, color=INK, lw=2.0, label="fitted law")
    axes.plot(x[-1], force[-1], "o", color=INK, ms=7, label="largest penetration")
    axes.set(xlabel=PENETRATION, ylabel=LINE_FORCE)
    law = stiffness.law(row)
    unloaded = np.isfinite(stiffness["hysteresis_ratio"][row])
    where = "half-way between loading and unloading" if unloaded else "along the loading"
    return (
        f"f = k₁ δ + k₂ δ² with k₁ = {scientific(law.k_linear_N_m2)} N/m² and "
        f"k₂ = {scientific(law.k_quadratic_N_m3)} N/m³, per metre of belt, {where}."
    )


@chart("press-deviation", "Influence of temperature", "stiffness")
def deviation(axes: Any, stiffness: Sheet, results: BeltResults) -> str:
    """Draw the deviation of the law at each temperature from the pooled one."""
    row, at = stiffness.pooled_row, stiffness["temperature_degC"]
    if np.count_nonzero(np.isfinite(at)) < 2:
        raise NotDrawn("all tests are at one temperature, its influence is unknown")
    depth = np.linspace(0.05, 1.0, POINTS) * stiffness["max_penetration_m"][row]
    force = stiffness.law(row).force(depth)
    band = 200.0 * force_se(stiffness, row, depth) / force
    if np.isfinite(band).all():
        look = {"color": FAINT, "alpha": 0.3, "lw": 0, "label": "pooled law ± 2 s.e."}
        axes.fill_between(depth * MICRO, -band, band, **look)
    axes.axhline(0.0, color=INK, lw=0.8)
    for i, k in enumerate(np.flatnonzero(np.isfinite(at))):
        own = depth[depth <= stiffness["max_penetration_m"][k]]
        relative = 100.0 * (stiffness.law(int(k)).force(own) / force[: own.size] - 1.0)
        look = {"color": GROUPS[i % len(GROUPS)], "ls": LINES[i % len(LINES)]}
        axes.plot(own * MICRO, relative, label=f"{at[k]:g} °C", **look)
    axes.set(xlabel=PENETRATION, ylabel="force, difference from the pooled law [%]")
    return "Force at each temperature compared with that of the pooled law, at equal penetration."


def force_se(stiffness: Sheet, row: int, depth: np.ndarray) -> np.ndarray:
    """Return the standard error of the law's force [N/m] at penetrations [m], by its covariance."""
    covariance = np.array(stiffness["covariance"][row], dtype=float).reshape(2, 2)
    basis = np.stack([depth, depth**2])
    variance = np.einsum("ik,ij,jk->k", basis, covariance, basis)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


@chart(
    "press-temperature",
    "Force and penetration at each temperature",
    "stiffness",
    paper="Fig. 4",
    panels=None,
)
def by_temperature(fig: Any, stiffness: Sheet, results: BeltResults) -> str:
    """Draw both branches at each temperature with the fitted law."""
    curves, at = results.get("press_curves"), stiffness["temperature_degC"]
    if curves is None:
        raise NotDrawn(NO_CURVES)
    panels = np.flatnonzero(np.isfinite(at)).tolist() or [stiffness.pooled_row]
    across = min(2, len(panels))
    down = -(-len(panels) // across)
    fig.set_figheight(1.0 + (2.1 if across > 1 else 3.0) * down)
    grid = fig.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    laws = at[np.isfinite(at)]
    for axes, row in zip(grid.flat, panels, strict=False):
        here = np.ones(curves["branch"].size, dtype=bool)
        if laws.size:  # the curves belong to the law of the nearest temperature
            away = np.abs(curves["temperature_degC"][:, None] - laws)
            here = np.abs(curves["temperature_degC"] - at[row]) <= away.min(axis=1)
        for branch, (style, _) in BRANCHES.items():
            look = {"color": MEASURED, "label": f"{branch}, measured"}
            _branch(axes, curves, here & (curves["branch"] == branch), ls=style, **look)
        axes.plot(*curve(stiffness, row), ":", color=INK, label="law", lw=1.8)
        axes.set_title(f"{at[row]:g} °C" if laws.size else "all tests")
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for column in range(across):
        lowest = grid[(len(panels) - 1 - column) // across, column]
        lowest.set_xlabel(PENETRATION)
        lowest.tick_params(labelbottom=True)
    fig.supylabel(LINE_FORCE, fontsize=10)
    if "unloading" in curves["branch"]:
        return "The area between loading and unloading is the energy lost in a cycle."
    return "No test was unloaded: the energy lost in a cycle is unknown."


def _branch(axes: Any, curves: Sheet, rows: np.ndarray, **look: Any) -> None:
    """Draw branches of the press, separated by gaps."""
    if not rows.any():
        return
    names, cycles = curves["test"][rows].astype(str), np.asarray(curves["cycle"][rows])
    cuts = np.flatnonzero((names[1:] != names[:-1]) | (cycles[1:] != cycles[:-1])) + 1
    x, y = (
        np.insert(values[rows], cuts, np.nan)
        for values in (MICRO * curves["penetration_m"], curves["line_force_N_m"])
    )
    axes.plot(x, y, **look)


@chart("branches", "Branches of the press", "press_curves")
def branches(axes: Any, curves: Sheet, results: BeltResults) -> str:
    """Draw the stored branches alone."""
    for branch, (style, colour) in BRANCHES.items():
        _branch(axes, curves, curves["branch"] == branch, ls=style, color=colour, label=branch)
    axes.set(xlabel=PENETRATION, ylabel=LINE_FORCE)
    return "Loading and unloading of all tests."


@chart("slip", "Sliding speed in service", "slip", paper="Fig. 9", height=4.2, columns=2)
def against_torque(axes: Any, slip: Sheet, results: BeltResults) -> str:
    """Draw the largest sliding speed over torque for each setting of the drive."""
    series = series_of(slip["driver_speed_rad_s"], slip["initial_tension_N"])
    for i, ((speed, tension), rows) in enumerate(sorted(series.items(), key=lambda item: item[0])):
        known = "unknown" if tension == UNKNOWN_TENSION else f"= {tension:.3g} N"
        line(
            axes,
            slip["torque_N_m"][rows],
            MILLI * slip["slip_speed_m_s"][rows],
            MILLI * slip["slip_speed_se_m_s"][rows],
            capsize=2,
            label=f"driver {speed:.3g} rad/s, T₀ {known}",
            **group(i),
        )
    top, radius = axes.get_ylim()[1], slip.pulley_radius_m or 0.0
    speeds = (slip.settings.get("rig") or {}).get("pulley_speeds_rad_s") or ()
    shown = [v for omega in speeds if 0.0 < (v := MILLI * radius * omega) <= 2.0 * top]
    for k, v in enumerate(shown):
        label = None if k else "speeds of the friction rig"
        axes.axhline(v, color=FAINT, lw=0.9, ls=(0, (1, 2)), label=label)
    axes.set(xlabel="torque of the driven pulley [N m]", ylabel=SPEED)
    return (
        "Largest sliding speed between belt and pulley, from the speed loss of the two-pulley "
        "drive by Eq. (7), with two standard errors."
    )


def _stored(friction: Sheet, results: BeltResults) -> list[int]:
    """Return the rows of the runs with a stored curve, in the order in which they are stored."""
    curves = results.get("rig_curves")
    if curves is None:
        return []
    rows = {str(run): row for row, run in enumerate(friction["run"])}
    return [rows[run] for run in dict.fromkeys(curves["run"].astype(str)) if run in rows]


@chart(
    "run",
    "Tensions and friction coefficient over time",
    "friction",
    paper="Fig. 10",
    height=5.6,
    panels=(2, 1),
)
def typical(panels: Any, friction: Sheet, results: BeltResults) -> str:
    """Draw the typical run of the largest arc."""
    good = [row for row in _stored(friction, results) if friction["status"][row] == "ok"]
    if not good:
        raise NotDrawn("no run could be used" if results.get("rig_curves") else NO_CURVES)
    _over_time(
        panels, max(good, key=lambda row: float(friction["arc_deg"][row])), friction, results
    )
    return _of_run(friction, max(good, key=lambda row: float(friction["arc_deg"][row]))) + (
        " At rest, then µ rises to the peak and settles; the sliding plateau is the result. "
        "Tensions as recorded, with the corrections of the config."
    )


def _aside(friction: Sheet, results: BeltResults) -> list[int]:
    stored = [row for row in _stored(friction, results) if friction["status"][row] != "ok"]
    return stored[:MOST_ASIDE]


MOST_ASIDE: Final = 12
"""Largest number of runs set aside that are drawn."""


@chart("aside-{item}", "Runs set aside", "friction", height=5.6, panels=(2, 1), each=_aside)
def set_aside(panels: Any, row: int, friction: Sheet, results: BeltResults) -> tuple[str, str]:
    """Draw a run that was set aside."""
    _over_time(panels, row, friction, results)
    why = f"Set aside: {friction['status'][row]}."
    return f"Run {friction['run'][row]}: set aside", f"{_of_run(friction, row)} {why}"


def _over_time(panels: Any, row: int, friction: Sheet, results: BeltResults) -> None:
    """Draw tensions (above) and friction coefficient (below) of a run, with the phases found."""
    curves, (above, below) = results.sheets["rig_curves"], panels
    samples = np.flatnonzero(curves["run"].astype(str) == str(friction["run"][row]))
    samples = samples[np.argsort(curves["time_s"][samples], kind="stable")]
    t, mu = curves["time_s"][samples], curves["mu"][samples]
    for name, colour, style in (("tight", MEASURED, "-"), ("slack", SIMULATED, "--")):
        tension = curves[f"tension_{name}_N"][samples]
        above.plot(t, tension, style, color=colour, lw=1.1, label=f"{name} span")
    below.plot(t, mu, color=INK, lw=1.1, label="µ, Eq. (6)")
    value = {name: float(friction[name][row]) for name in friction.columns if name in TIMES + MUS}
    start, peak, plateau, end = (value.get(name, np.nan) for name in TIMES)
    # without a peak the build-up lasts until the plateau
    times = [float(t[0]), start, peak if np.isfinite(peak) else plateau, plateau, end]
    for (name, colour, hatch), begin, until in zip(PHASES, times[:-1], times[1:], strict=True):
        if until > begin:
            look = {"facecolor": colour, "edgecolor": "#b9b9b9", "hatch": hatch, "zorder": 0.4}
            above.axvspan(begin, until, lw=0, **look)
            below.axvspan(begin, until, lw=0.6, label=name, **look)
    sliding, se, sticking = (value.get(name, np.nan) for name in MUS)
    if np.isfinite(sliding):
        error = f" ± {se:.2g}" if np.isfinite(se) else ""
        look = {"color": MEASURED, "ls": "--", "lw": 1.2}
        below.axhline(sliding, label=f"sliding {sliding:.4f}{error}", **look)
    if np.isfinite(sticking) and np.isfinite(peak):
        label = f"peak before sliding {sticking:.4f}"
        below.plot(peak, sticking, "v", color=SIMULATED, ms=7, label=label)
    if np.isfinite(mu).any():  # spikes must not flatten the curve
        low, high = np.nanpercentile(mu, [0.5, 99.5])
        high = np.fmax(high, sliding)
        below.set_ylim(low - 0.1 * max(high - low, 1e-6), high + 0.2 * max(high - low, 1e-6))
    above.set_ylabel(axis("tension_N"))
    below.set(xlabel=axis("time_s"), ylabel=MU)


TIMES: Final = ("start_time_s", "peak_time_s", "plateau_start_s", "plateau_end_s")
MUS: Final = ("mu_sliding", "mu_sliding_se", "mu_sticking")


def _of_run(friction: Sheet, row: int) -> str:
    def formatted(name: str, unit: str, per_unit: float = 1.0) -> str:
        value = per_unit * float(friction[name][row])
        return f"{value:.4g}{unit}" if np.isfinite(value) else "unknown"

    return (
        f"Run {friction['run'][row]}: arc {formatted('arc_deg', '°')}, "
        f"T₀ = {formatted('nominal_tension_N', ' N')}, "
        f"v = {formatted('slip_speed_m_s', ' mm/s', MILLI)}."
    )


@chart("runs", "Runs over time", "rig_curves", columns=4)
def every_run(axes: Any, curves: Sheet, results: BeltResults) -> str:
    """Draw the stored runs alone."""
    for k, run in enumerate(dict.fromkeys(curves["run"].tolist())):
        rows = curves["run"] == run
        axes.plot(
            curves["time_s"][rows], curves["mu"][rows], label=str(run), **group(k, marker=None)
        )
    axes.set(xlabel=axis("time_s"), ylabel=MU)
    return "Friction coefficient of the stored runs by Eq. (6)."


@chart("arc", "Normal force along the arc", "friction", paper="Fig. 11", panels=None)
def along_arcs(fig: Any, friction: Sheet, results: BeltResults) -> str:
    """Draw simulated normal force and Eq. (8) for a typical run of each arc."""
    profiles = results.profiles
    if not profiles:
        raise NotDrawn("it needs stiffness.parquet, a surface and a simulated recording")
    fig.set_figheight(1.0 + 1.9 * len(profiles))
    grid = fig.subplots(len(profiles), 1, sharex=True, squeeze=False)
    for axes, run in zip(grid.flat, profiles, strict=True):
        x = run.profile["arc_position_m"] * MILLI
        force, formula = (run.profile[f"{of}_force_N_m"] for of in ("normal", "capstan"))
        axes.plot(x, force, "-", color=SIMULATED, label="simulated contact")
        axes.plot(x, formula, "--", color=MEASURED, label="Eq. (8)")
        axes.axhline(run.mean_force_N_m, color=FAINT, ls=":", label="mean of Eq. (8)")
        axes.set_title(
            f"arc {run.arc_deg:g}°, T₀ = {run.initial_tension_N:.4g} N, "
            f"v = {MILLI * run.slip_speed_m_s:.3g} mm/s",
            loc="left",
        )
        axes.set_ylim(bottom=0.0)
    grid.flat[-1].set_xlabel("position along the arc from the tight side [mm]")
    fig.supylabel(LINE_FORCE, fontsize=10)
    worst = max(float(np.max(p.profile["normal_force_N_m"])) / p.mean_force_N_m for p in profiles)
    return (
        "The belt's bending stiffness makes peaks where it enters and leaves, up to "
        f"{worst:.2g} times the mean force of the run. The published surface does not see them; "
        "the refined one does."
    )
