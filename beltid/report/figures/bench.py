"""Charts of the benches: press (Figs. 4, 5), speed loss (Fig. 9), runs over time (Fig. 10).

Also the normal force along the arc (Fig. 11), and a predicted drive.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from beltid.report import charts
from beltid.report.charts import NotDrawn, chart, draw, draw_groups, group
from beltid.report.results import UNKNOWN_TENSION, BeltResults, Sheet, load_name, series_of
from beltid.report.summary import scientific

MILLI: Final = 1e3
BRANCHES: Final = {"loading": ("-", charts.MEASURED), "unloading": ("--", charts.SIMULATED)}
NO_CURVES: Final = (
    "the recording was not read when the report was written; beltid report --config CONFIG reads it"
)
POINTS: Final = 101
TALL: Final = 5.8
PHASES: Final = (
    ("rest", "#e8e8e8", ""),
    ("build-up", "#f6d9b8", "///"),
    ("peak to sliding", "#efe6f5", "\\\\"),
    ("sliding plateau", "#cfe6f5", ""),
)
draw_press = partial(draw, x="penetration_m", y="line_force_N_m")


def curve(stiffness: Sheet, row: int) -> dict[str, np.ndarray]:
    """Return penetration [m] and force [N/m] of a law up to its largest measured penetration."""
    depth = np.linspace(0.0, stiffness["max_penetration_m"][row], POINTS)
    return {"penetration_m": depth, "line_force_N_m": stiffness.law(row).force(depth)}


def _branches(axes: Any, curves: Sheet, rows: Any = True, **look: Any) -> None:
    """Draw branches of the press, each test and cycle a line of its own."""
    for branch, (dash, colour) in BRANCHES.items():
        of = np.flatnonzero(rows & (curves["branch"] == branch))
        names, cycles = curves["test"][of].astype(str), np.asarray(curves["cycle"][of])
        cuts = np.flatnonzero((names[1:] != names[:-1]) | (cycles[1:] != cycles[:-1])) + 1
        for part in np.split(of, cuts) if of.size else ():
            own = {"ls": dash, "color": colour, "label": branch, **look}
            draw_press(axes, curves, rows=part, **own)


@chart("press-law", "The normal contact law (Fig. 5)", "stiffness")
def _pooled(axes: Any, stiffness: Sheet, results: BeltResults) -> str:
    row = stiffness.pooled_row
    if curves := results.get("press_curves"):
        _branches(axes, curves, alpha=0.7, lw=1.0)
    fitted, law = curve(stiffness, row), stiffness.law(row)
    draw_press(axes, fitted, color=charts.INK, lw=2.0, label="fitted law")
    look: Any = {"ls": "none", "color": charts.INK, "ms": 7, "label": "largest penetration"}
    draw_press(axes, fitted, rows=[-1], marker="o", **look)
    unloaded = np.isfinite(stiffness["hysteresis_ratio"][row])
    where = "half-way between loading and unloading" if unloaded else "along the loading"
    return (
        f"f = k₁ δ + k₂ δ² with k₁ = {scientific(law.k_linear_N_m2)} N/m² and "
        f"k₂ = {scientific(law.k_quadratic_N_m3)} N/m³, per metre of belt, {where}."
    )


@chart("press-temperature", "The press at each temperature (Fig. 4)", "stiffness")
def _by_temperature(axes: Any, stiffness: Sheet, results: BeltResults) -> str:
    curves, at = results.get("press_curves"), stiffness["temperature_degC"]
    if curves is None:
        raise NotDrawn(NO_CURVES)
    rows = np.flatnonzero(np.isfinite(at))
    if not rows.size:
        raise NotDrawn("the temperatures of the tests are unknown")
    for row, colour in zip(rows.tolist(), charts.shades(rows.size), strict=True):
        # the curves belong to the law of the nearest temperature
        away = np.abs(curves["temperature_degC"][:, None] - at[rows])
        here = np.abs(curves["temperature_degC"] - at[row]) <= away.min(axis=1)
        _branches(axes, curves, here, color=colour, lw=1.0, label="")
        draw_press(
            axes, curve(stiffness, row), ls=":", color=colour, lw=2.2, label=f"{at[row]:g} °C"
        )
    said = "Solid: loading; dashed: unloading; dotted: the law of the temperature."
    if "unloading" in curves["branch"]:
        return f"{said} The area between loading and unloading is the energy lost in a cycle."
    return f"{said} No test was unloaded: the energy lost in a cycle is unknown."


def by_setting(sheet: Sheet, of: Any = slice(None)) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and rows of every driver speed and belt tension, of some rows of a drive."""
    rows = np.arange(len(sheet["torque_N_m"]))[of]
    series = series_of(sheet["driver_speed_rad_s"][rows], sheet["initial_tension_N"][rows])
    for speed, tension in sorted(series):
        known = "unknown" if tension == UNKNOWN_TENSION else f"= {tension:.4g} N"
        yield f"driver {speed:.4g} rad/s, T₀ {known}", rows[series[speed, tension]]


@chart("slip", "Sliding speed in service (Fig. 9)", "slip")
def _against_torque(axes: Any, slip: Sheet, results: BeltResults) -> str:
    look = {"err": "slip_speed_se_m_s", "capsize": 2}
    draw_groups(axes, slip, "torque_N_m", "slip_speed_m_s", by_setting(slip), **look)
    speeds = MILLI * slip.pulley_radius_m * np.array(slip.rig.get("pulley_speeds_rad_s") or ())
    for v in speeds[(speeds > 0.0) & (speeds <= 2.0 * axes.get_ylim()[1])]:
        label = "speeds of the friction rig"
        axes.axhline(v, color=charts.FAINT, lw=0.9, ls=(0, (1, 2)), label=label)
    axes.set_xlabel("torque of the driven pulley [N m]")
    return (
        "Largest sliding speed between belt and pulley, from the speed loss of the two-pulley "
        "drive by Eq. (7), with two standard errors."
    )


@chart("run", "Tensions and friction over time (Fig. 10)", "friction", panels=charts.TWO)
def _typical(panels: Any, friction: Sheet, results: BeltResults) -> str:
    curves, (above, below) = results.get("rig_curves"), panels
    if curves is None:
        raise NotDrawn(NO_CURVES)
    stored = np.isin(friction["run"].astype(str), curves["run"].astype(str))
    good = np.flatnonzero(stored & (friction["status"] == "ok"))
    if not good.size:
        raise NotDrawn("no run could be used")
    row = int(good[np.argmax(friction["arc_deg"][good])])
    run = {name: values[row] for name, values in friction.columns.items()}
    above.figure.set_figheight(TALL)
    rows = curves["run"].astype(str) == str(run["run"])
    for name, colour, dash in (("tight", charts.MEASURED, "-"), ("slack", charts.SIMULATED, "--")):
        look: Any = {"ls": dash, "color": colour, "lw": 1.1, "label": f"{name} span"}
        draw(above, curves, "time_s", f"tension_{name}_N", rows, **look)
    draw(below, curves, "time_s", "mu", rows, color=charts.INK, lw=1.1, label="µ, Eq. (6)")
    above.set_xlabel("")
    peak = run.get("peak_time_s", np.nan)
    # without a peak the build-up lasts until the plateau
    turn = peak if np.isfinite(peak) else run["plateau_start_s"]
    ends = (run["start_time_s"], turn, run["plateau_start_s"], run["plateau_end_s"])
    begin = curves["time_s"][rows].min()
    for (name, colour, hatch), end in zip(PHASES, ends, strict=True):
        if end > begin:
            look = {"facecolor": colour, "edgecolor": "#b9b9b9", "hatch": hatch, "zorder": 0.4}
            above.axvspan(begin, end, lw=0, **look)
            below.axvspan(begin, end, lw=0.6, label=name, **look)
        begin = end
    sliding, se = run["mu_sliding"], run["mu_sliding_se"]
    label = f"sliding {sliding:.4f}" + (f" ± {se:.2g}" if np.isfinite(se) else "")
    below.axhline(sliding, color=charts.MEASURED, ls="--", lw=1.2, label=label)
    label = f"peak before sliding {run['mu_sticking']:.4f}"
    if np.isfinite([peak, run["mu_sticking"]]).all():
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


@chart("arc", "Normal force along the arc (Fig. 11)", "friction")
def _along_arc(axes: Any, friction: Sheet, results: BeltResults) -> str:
    if not results.profiles:
        raise NotDrawn("it needs stiffness.parquet, a surface and a simulated recording")
    worst, names = 0.0, ("arc_position_m", "normal_force_N_m")
    for k, run in enumerate(results.profiles):
        speed = f"v = {MILLI * run['slip_speed_m_s']:.3g} mm/s"
        label = f"arc {run['arc_deg']:g}°, T₀ = {run['initial_tension_N']:.4g} N, {speed}"
        look = group(k, marker=None, ls="-")
        draw(axes, run, *names, **look, label=label)
        by_capstan = {**run, "normal_force_N_m": run["capstan_force_N_m"]}
        draw(axes, by_capstan, *names, **look | {"ls": "--"})
        axes.axhline(run["mean_force_N_m"], color=look["color"], ls=":")
        worst = max(worst, float(np.max(run["normal_force_N_m"])) / run["mean_force_N_m"])
    axes.set_ylim(bottom=0.0)
    return (
        "Solid: simulated contact; dashed: Eq. (8); dotted: its mean. The belt's bending stiffness "
        f"makes peaks where it enters and leaves, up to {worst:.2g} times the mean force of the "
        "run. The published surface does not see them; the refined one does."
    )


@chart("drawing", "The drive and its forces", "drive")
def _drawing(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    from matplotlib.patches import Circle

    laid, torque = sheet.rows("laid"), np.abs(sheet["torque_N_m"])
    steady = np.where(np.isfinite(sheet["speed_loss_rad_s"]), np.nan_to_num(torque), 0.0)
    if not laid or not steady.any():
        raise NotDrawn("no point has a steady torque, or the places of the pulleys are unknown")
    run = sheet["run"][np.argmax(steady)]
    rows = np.flatnonzero(sheet["run"] == run)
    forwards = sheet["driver_speed_rad_s"][rows[0]] > 0.0
    leaving = sheet["tension_out_N" if forwards else "tension_in_N"][rows]
    centres = np.array([(pulley["x_m"], pulley["y_m"]) for pulley in laid])
    size, middle = max(pulley["radius_m"] for pulley in laid), centres.mean(axis=0)
    wide, high = np.ptp(centres, axis=0) + 4.0 * size
    axes.figure.set_figheight(min(charts.WIDTH * high / wide, TALL))
    white = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
    centred: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 10}
    for centre, pulley, row, tension in zip(centres, laid, rows, leaving, strict=True):
        look = {"facecolor": charts.GRID, "edgecolor": charts.INK, "lw": 2.0}
        axes.add_patch(Circle(tuple(centre), pulley["radius_m"], **look))
        span = np.stack([pulley["leaves_m"], pulley["arrives_m"]])
        axes.plot(*span.T, color=charts.INK, lw=2.0)
        axes.annotate(f"{tension:.0f} N", tuple(span.mean(axis=0)), bbox=white, **centred)
        outwards = (centre - middle) / np.hypot(*(centre - middle))
        place = centre + (pulley["radius_m"] + 0.6 * size) * outwards
        force = f"{pulley['pulley']}\n{sheet['hub_force_N'][row]:.0f} N"
        axes.annotate(force, tuple(place), color=charts.SIMULATED, **centred)
    axes.set_aspect("equal")
    axes.margins(0.2)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.grid(visible=False)
    return (
        f"Point {run}, {abs(sheet['driver_speed_rad_s'][rows[0]]):.4g} rad/s, largest torque "
        f"{np.nanmax(torque[rows]):.3g} N m. At the spans: belt tension; at the pulleys: force of "
        "the belt on the axis."
    )


@chart("loss", "Predicted speed loss over torque", "drive")
def _loss(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    loses = np.nan_to_num(sheet["speed_loss_rad_s"]) != 0.0
    driven = np.where(loses, np.abs(np.nan_to_num(sheet["torque_N_m"])), -1.0)
    pulley = str(sheet["pulley"][int(np.argmax(driven))])
    groups = list(by_setting(sheet, sheet["pulley"] == pulley))
    draw_groups(axes, sheet, "torque_N_m", "loss_creep_rad_s", groups, marker=None, lw=0.6)
    look = {"band": "speed_loss_u_rad_s"}
    draw_groups(axes, sheet, "torque_N_m", "speed_loss_rad_s", groups, **look)
    return (
        f"Predicted speed loss of {pulley} over its torque",
        "A line per driver speed and belt tension, with two standard uncertainties. Thin lines: "
        "creep alone.",
    )


@chart("comparison", "Speed loss of the drive, measured and predicted", "compare_drive")
def _compared(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    groups = list(by_setting(sheet))
    draw_groups(axes, sheet, "torque_N_m", "loss_predicted_rad_s", groups, marker=None)
    look = {"ls": "none", "err": "u_measured_rad_s"}
    draw_groups(axes, sheet, "torque_N_m", "loss_measured_rad_s", groups, **look)
    return (
        "Points: the bench, with two standard errors. Lines: predicted from the identified laws, "
        "which were not fitted to this recording."
    )
