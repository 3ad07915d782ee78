"""Charts of a belt drive: layout, speed loss, arcs, slip limit, predicted against measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from beltid.report import charts
from beltid.report.cells import axis, quantity
from beltid.report.charts import NotDrawn, chart, draw
from beltid.report.figures.bench import by_setting
from beltid.report.results import BeltResults, Sheet

TALL: Final = 5.8


@chart("drawing", "The drive and its forces", "drive")
def _drawing(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    laid, torque = sheet.rows("laid"), np.abs(sheet["torque_N_m"])
    steady = np.where(np.isfinite(sheet["speed_loss_rad_s"]), np.nan_to_num(torque), 0.0)
    if not laid or not steady.any():
        raise NotDrawn("no point has a steady torque, or the places of the pulleys are unknown")
    run = sheet["run"][np.argmax(steady)]
    rows = np.flatnonzero(sheet["run"] == run)
    size = max(pulley["radius_m"] for pulley in laid)
    forwards = sheet["driver_speed_rad_s"][rows[0]] > 0.0
    leaving = sheet["tension_out_N" if forwards else "tension_in_N"][rows]
    centres = np.array([(pulley["x_m"], pulley["y_m"]) for pulley in laid])
    middle, (wide, high) = centres.mean(axis=0), np.ptp(centres, axis=0) + 4.0 * size
    axes.figure.set_figheight(min(charts.WIDTH * high / wide, TALL))
    centred: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 10}
    for i, (pulley, row) in enumerate(zip(laid, rows, strict=True)):
        _draw_belt(axes, laid[i - 1], pulley, float(sheet["wrap_deg"][row]))
        place = np.mean([pulley["leaves_m"], pulley["arrives_m"]], axis=0)
        white = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
        axes.annotate(f"{leaving[i]:.0f} N", tuple(place), bbox=white, **centred)
        outwards = (centres[i] - middle) / np.hypot(*(centres[i] - middle))
        place = centres[i] + (pulley["radius_m"] + 0.6 * size) * outwards
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


def _draw_belt(
    axes: Any, before: Mapping[str, Any], pulley: Mapping[str, Any], wrap: float
) -> None:
    """Draw a pulley, the belt on it and the span that leaves it; `before` is the last pulley."""
    from matplotlib.patches import Circle

    centre, radius = np.array((pulley["x_m"], pulley["y_m"])), pulley["radius_m"]
    ends = (before["arrives_m"] - centre, pulley["leaves_m"] - centre)
    first, last = (np.degrees(np.arctan2(at[1], at[0])) for at in ends)
    if abs((last - first) % 360.0 - wrap) > abs((first - last) % 360.0 - wrap):  # clockwise
        first, last = last, first
    angle = np.radians(first + np.linspace(0.0, (last - first) % 360.0 or 360.0, 73))
    belt = centre[:, None] + radius * np.stack([np.cos(angle), np.sin(angle)])
    span = np.stack([pulley["leaves_m"], pulley["arrives_m"]], axis=1)
    axes.add_patch(Circle(tuple(centre), radius, facecolor=charts.GRID, edgecolor=charts.FAINT))
    for line in (belt, span):
        axes.plot(*line, color=charts.INK, linewidth=2.0)


@chart("loss", "Predicted speed loss over torque", "drive")
def _loss(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    loses = np.nan_to_num(sheet["speed_loss_rad_s"]) != 0.0
    driven = np.where(loses, np.abs(np.nan_to_num(sheet["torque_N_m"])), -1.0)
    pulley = str(sheet["pulley"][int(np.argmax(driven))])
    seating = sheet["loss_creep_rad_s"] + sheet["loss_seating_rad_s"]
    data = {**sheet.columns, "loss_creep_and_seating_rad_s": seating}
    data["u"] = sheet["speed_loss_u_rad_s"]
    for k, (name, rows) in enumerate(by_setting(sheet, sheet["pulley"] == pulley)):
        look = charts.group(k, label=name)
        for part in ("creep", "creep_and_seating"):
            of_part = f"loss_{part}_rad_s"
            draw(axes, data, "torque_N_m", of_part, rows, color=look["color"], lw=0.6)
        draw(axes, data, "torque_N_m", "speed_loss_rad_s", rows, band="u", **look)
    return (
        f"Predicted speed loss of {pulley} over its torque",
        "A line per driver speed and belt tension, with two standard uncertainties. Thin lines: "
        "creep alone, and creep with seating; the rest is slip of whole pulleys.",
    )


@chart("along-arcs", "Normal force and sliding along the arcs", "drive", whole=True)
def _along_arcs(fig: Any, sheet: Sheet, results: BeltResults) -> str:
    rows = sheet.rows("arcs")
    if not rows:
        raise NotDrawn("drive.parquet has no arcs")
    fig.set_figheight(TALL)
    panels = fig.subplots(2, 1, sharex=True)
    for k, arc in enumerate(rows):
        for axes, name in zip(panels, ("normal_force_N_m", "slip_speed_m_s"), strict=True):
            y = quantity(name)[2] * np.array(arc[name])
            axes.plot(arc["angle_deg"], y, **charts.group(k, marker=None, label=arc["pulley"]))
            axes.set_ylabel(axis(name))
    panels[0].set_ylim(bottom=0.0)
    panels[1].axhline(0.0, color=charts.FAINT, linewidth=0.8)
    panels[1].set_xlabel("angle from the entry of the belt [°]")
    return (
        f"Point {rows[0]['run']}. Above 0 the pulley is faster than the belt; at 0 the belt sticks."
    )


@chart("comparison", "Speed loss of the drive, measured and predicted", "compare_drive")
def _compared(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    for k, (name, rows) in enumerate(by_setting(sheet)):
        look = charts.group(k, marker=None)
        draw(axes, sheet, "torque_N_m", "loss_predicted_rad_s", rows, **look)
        look = charts.group(k, ls="none", label=name)
        draw(axes, sheet, "torque_N_m", "loss_measured_rad_s", rows, err="u_measured_rad_s", **look)
    return (
        "Points: the bench, with two standard errors. Lines: predicted from the identified laws, "
        "which were not fitted to this recording."
    )
