"""Charts of the benches: the press (Figs. 4, 5), the speed loss (Fig. 9), runs over time (Fig. 10).

Also the normal force along the arc (Fig. 11).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from beltid.report import charts
from beltid.report.cells import axis, scientific
from beltid.report.charts import LINE_FORCE, MILLI, NotDrawn, chart, draw
from beltid.report.results import UNKNOWN_TENSION, BeltResults, Sheet, load_name, series_of

BRANCHES: Final = {"loading": ("-", charts.MEASURED), "unloading": ("--", charts.SIMULATED)}
NO_CURVES: Final = (
    "the recording was not read when the report was written; beltid report --config CONFIG reads it"
)
POINTS: Final = 101
PHASES: Final = (
    ("rest", "#e8e8e8", ""),
    ("build-up", "#f6d9b8", "///"),
    ("peak to sliding", "#efe6f5", "\\\\"),
    ("sliding plateau", "#cfe6f5", ""),
)
OF_RUN: Final = (
    "run",
    "arc_deg",
    "nominal_tension_N",
    "slip_speed_m_s",
    "mu_sliding",
    "mu_sliding_se",
    "mu_sticking",
)
TIMES: Final = ("start_time_s", "peak_time_s", "plateau_start_s", "plateau_end_s")


def curve(stiffness: Sheet, row: int) -> dict[str, np.ndarray]:
    """Return penetration [m] and force [N/m] of a law up to its largest measured penetration."""
    depth = np.linspace(0.0, stiffness["max_penetration_m"][row], POINTS)
    return {"penetration_m": depth, "line_force_N_m": stiffness.law(row).force(depth)}


def _press(axes: Any, data: Any, rows: Any = slice(None), **look: Any) -> None:
    draw(axes, data, "penetration_m", "line_force_N_m", rows, **look)


def _branches(axes: Any, curves: Sheet, rows: Any = True, **look: Any) -> None:
    """Draw branches of the press, each test and cycle a line of its own."""
    for branch, (dash, colour) in BRANCHES.items():
        of = np.flatnonzero(rows & (curves["branch"] == branch))
        names, cycles = curves["test"][of].astype(str), np.asarray(curves["cycle"][of])
        cuts = np.flatnonzero((names[1:] != names[:-1]) | (cycles[1:] != cycles[:-1])) + 1
        for k, part in enumerate(np.split(of, cuts) if of.size else ()):
            _press(axes, curves, part, ls=dash, color=colour, label="" if k else branch, **look)


@chart("press-law", "The normal contact law", "stiffness", paper="Fig. 5")
def _pooled(axes: Any, stiffness: Sheet, results: BeltResults) -> str:
    row = stiffness.pooled_row
    if curves := results.get("press_curves"):
        _branches(axes, curves, alpha=0.7, lw=1.0)
    fitted, law = curve(stiffness, row), stiffness.law(row)
    _press(axes, fitted, color=charts.INK, lw=2.0, label="fitted law")
    look: Any = {"ls": "none", "color": charts.INK, "ms": 7, "label": "largest penetration"}
    _press(axes, fitted, [-1], marker="o", **look)
    unloaded = np.isfinite(stiffness["hysteresis_ratio"][row])
    where = "half-way between loading and unloading" if unloaded else "along the loading"
    return (
        f"f = k₁ δ + k₂ δ² with k₁ = {scientific(law.k_linear_N_m2)} N/m² and "
        f"k₂ = {scientific(law.k_quadratic_N_m3)} N/m³, per metre of belt, {where}."
    )


def having(belts: Sequence[BeltResults], *names: str) -> list[tuple[str, Sheet]]:
    """Return the names of the belts with one of some artifacts, and the first of these."""
    present = [(belt.belt, sheet) for belt in belts if (sheet := belt.get(*names))]
    if not present:
        raise NotDrawn(f"no folder has a {names[0]}.parquet")
    return present


@chart("belts-law", "The normal contact law of every belt")
def _laws(axes: Any, belts: Sequence[BeltResults]) -> str:
    for i, (belt, sheet) in enumerate(having(belts, "stiffness")):
        _press(axes, curve(sheet, sheet.pooled_row), **charts.group(i, label=belt, markevery=20))
    return "Not proportional to the number of ribs: each belt has to be identified by itself."


@chart(
    "press-temperature", "The press at each temperature", "stiffness", paper="Fig. 4", whole=True
)
def _by_temperature(fig: Any, stiffness: Sheet, results: BeltResults) -> str:
    curves, at = results.get("press_curves"), stiffness["temperature_degC"]
    if curves is None:
        raise NotDrawn(NO_CURVES)
    rows = np.flatnonzero(np.isfinite(at))
    panels = rows.tolist() or [stiffness.pooled_row]
    across = min(2, len(panels))
    down = -(-len(panels) // across)
    fig.set_figheight(1.0 + (2.1 if across > 1 else 3.0) * down)
    grid = fig.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    for axes, row in zip(grid.flat, panels, strict=False):
        here: Any = True
        if rows.size:  # the curves belong to the law of the nearest temperature
            away = np.abs(curves["temperature_degC"][:, None] - at[rows])
            here = np.abs(curves["temperature_degC"] - at[row]) <= away.min(axis=1)
        _branches(axes, curves, here)
        _press(axes, curve(stiffness, row), ls=":", color=charts.INK, lw=1.8, label="law")
        axes.set_title(f"{at[row]:g} °C" if rows.size else "all tests")
        axes.label_outer()
        axes.set_ylabel("")
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
        grid[-2, 1].set_xlabel(axis("penetration_m"))
        grid[-2, 1].tick_params(labelbottom=True)
    fig.supylabel(LINE_FORCE, fontsize=10)
    if "unloading" in curves["branch"]:
        return "The area between loading and unloading is the energy lost in a cycle."
    return "No test was unloaded: the energy lost in a cycle is unknown."


def by_setting(sheet: Sheet, of: Any = slice(None)) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and rows of every driver speed and belt tension, of some rows of a drive."""
    rows = np.arange(len(sheet["torque_N_m"]))[of]
    series = series_of(sheet["driver_speed_rad_s"][rows], sheet["initial_tension_N"][rows])
    for speed, tension in sorted(series):
        known = "unknown" if tension == UNKNOWN_TENSION else f"= {tension:.4g} N"
        yield f"driver {speed:.4g} rad/s, T₀ {known}", rows[series[speed, tension]]


@chart("slip", "Sliding speed in service", "slip", paper="Fig. 9")
def _against_torque(axes: Any, slip: Sheet, results: BeltResults) -> str:
    for i, (name, rows) in enumerate(by_setting(slip)):
        look = charts.group(i, capsize=2, label=name)
        draw(axes, slip, "torque_N_m", "slip_speed_m_s", rows, err="slip_speed_se_m_s", **look)
    speeds = MILLI * slip.pulley_radius_m * np.array(slip.rig.get("pulley_speeds_rad_s") or ())
    for k, v in enumerate(speeds[(speeds > 0.0) & (speeds <= 2.0 * axes.get_ylim()[1])]):
        label = None if k else "speeds of the friction rig"
        axes.axhline(v, color=charts.FAINT, lw=0.9, ls=(0, (1, 2)), label=label)
    axes.set_xlabel("torque of the driven pulley [N m]")
    return (
        "Largest sliding speed between belt and pulley, from the speed loss of the two-pulley "
        "drive by Eq. (7), with two standard errors."
    )


@chart("run", "Tensions and friction over time", "friction", paper="Fig. 10", whole=True)
def _typical(fig: Any, friction: Sheet, results: BeltResults) -> str:
    curves = results.get("rig_curves")
    if curves is None:
        raise NotDrawn(NO_CURVES)
    stored = np.isin(friction["run"].astype(str), curves["run"].astype(str))
    good = np.flatnonzero(stored & (friction["status"] == "ok"))
    if not good.size:
        raise NotDrawn("no run could be used")
    row = int(good[np.argmax(friction["arc_deg"][good])])
    run = {name: friction[name][row] for name in OF_RUN + TIMES}
    fig.set_figheight(5.6)
    above, below = fig.subplots(2, 1, sharex=True)
    rows = curves["run"].astype(str) == str(run["run"])
    for name, colour, dash in (("tight", charts.MEASURED, "-"), ("slack", charts.SIMULATED, "--")):
        look: Any = {"ls": dash, "color": colour, "lw": 1.1, "label": f"{name} span"}
        draw(above, curves, "time_s", f"tension_{name}_N", rows, **look)
    draw(below, curves, "time_s", "mu", rows, color=charts.INK, lw=1.1, label="µ, Eq. (6)")
    above.set_xlabel("")
    start, peak, plateau, end = (float(run[name]) for name in TIMES)
    # without a peak the build-up lasts until the plateau
    turn = peak if np.isfinite(peak) else plateau
    times = [float(curves["time_s"][rows].min()), start, turn, plateau, end]
    for (name, colour, hatch), begin, until in zip(PHASES, times[:-1], times[1:], strict=True):
        if until > begin:
            look = {"facecolor": colour, "edgecolor": "#b9b9b9", "hatch": hatch, "zorder": 0.4}
            above.axvspan(begin, until, lw=0, **look)
            below.axvspan(begin, until, lw=0.6, label=name, **look)
    sliding, se = float(run["mu_sliding"]), float(run["mu_sliding_se"])
    label = f"sliding {sliding:.4f}" + (f" ± {se:.2g}" if np.isfinite(se) else "")
    below.axhline(sliding, color=charts.MEASURED, ls="--", lw=1.2, label=label)
    if np.isfinite(run["mu_sticking"]) and np.isfinite(peak):
        label = f"peak before sliding {run['mu_sticking']:.4f}"
        below.plot(peak, run["mu_sticking"], "v", color=charts.SIMULATED, ms=7, label=label)
    mu = curves["mu"][rows]
    if np.isfinite(mu).any():  # spikes must not flatten the curve
        low, high = np.nanpercentile(mu, [0.5, 99.5])
        span = max(np.fmax(high, sliding) - low, 1e-6)
        below.set_ylim(low - 0.1 * span, np.fmax(high, sliding) + 0.2 * span)
    return (
        f"Run {run['run']}: arc {run['arc_deg']:.4g}°, {load_name(friction)} "
        f"{run['nominal_tension_N']:.4g} N, v = {MILLI * run['slip_speed_m_s']:.4g} mm/s. At rest, "
        "then µ rises to the peak and settles; the sliding plateau is the result. Tensions as "
        "recorded, with the corrections of the config."
    )


@chart("arc", "Normal force along the arc", "friction", paper="Fig. 11", whole=True)
def _along_arcs(fig: Any, friction: Sheet, results: BeltResults) -> str:
    profiles = results.profiles
    if not profiles:
        raise NotDrawn("it needs stiffness.parquet, a surface and a simulated recording")
    fig.set_figheight(1.0 + 1.9 * len(profiles))
    grid = fig.subplots(len(profiles), 1, sharex=True, squeeze=False)
    for axes, run in zip(grid.flat, profiles, strict=True):
        x, force, by_capstan = (
            run.profile[name]
            for name in ("arc_position_m", "normal_force_N_m", "capstan_force_N_m")
        )
        axes.plot(MILLI * x, force, "-", color=charts.SIMULATED, label="simulated contact")
        axes.plot(MILLI * x, by_capstan, "--", color=charts.MEASURED, label="Eq. (8)")
        axes.axhline(run.mean_force_N_m, color=charts.FAINT, ls=":", label="mean of Eq. (8)")
        speed = f"v = {MILLI * run.slip_speed_m_s:.3g} mm/s"
        title = f"arc {run.arc_deg:g}°, T₀ = {run.initial_tension_N:.4g} N, {speed}"
        axes.set_title(title, loc="left")
        axes.set_ylim(bottom=0.0)
    grid.flat[-1].set_xlabel(axis("arc_position_m"))
    fig.supylabel(LINE_FORCE, fontsize=10)
    worst = max(float(np.max(p.profile["normal_force_N_m"])) / p.mean_force_N_m for p in profiles)
    return (
        "The belt's bending stiffness makes peaks where it enters and leaves, up to "
        f"{worst:.2g} times the mean force of the run. The published surface does not see them; "
        "the refined one does."
    )
