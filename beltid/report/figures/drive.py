"""Draw a belt drive: layout, speed loss, arcs, slip limit, and predicted against measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.report.cells import MILLI
from beltid.report.conditions import series_of
from beltid.report.drawing import (
    FAINT,
    GRID,
    INK,
    SIMULATED,
    WIDTH,
    figure,
    group,
    legend_below,
    new_axes,
    style,
)
from beltid.report.picture import Picture
from beltid.report.results import Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TORQUE: Final = "torque [N m]"
LOSS: Final = "speed loss [rad/s]"
TALL: Final = 5.8


def predicted(sheet: Sheet) -> list[Picture]:
    """Draw the figures of a predicted drive; those without data in an older table are left out."""
    return [
        *_drawing(sheet),
        _loss(sheet),
        _arcs(sheet),
        *_along_arcs(sheet),
        *_slip_limit(sheet),
    ]


def _drawing(sheet: Sheet) -> list[Picture]:
    """Draw pulleys and belt, with span and hub forces as numbers at the most loaded point."""
    laid, run = sheet.stated("laid") or (), _most_loaded(sheet)
    if not laid or run is None:
        return []
    rows = np.flatnonzero(sheet["run"] == run)
    size = max(pulley["radius_m"] for pulley in laid)
    forwards = sheet["driver_speed_rad_s"][rows[0]] > 0.0
    leaving = sheet["tension_out_N" if forwards else "tension_in_N"][rows]
    centres = np.array([(pulley["x_m"], pulley["y_m"]) for pulley in laid])
    middle, (wide, high) = centres.mean(axis=0), np.ptp(centres, axis=0) + 4.0 * size
    with new_axes(min(WIDTH * high / wide, TALL)) as (fig, axes):
        for i, (pulley, row) in enumerate(zip(laid, rows, strict=True)):
            _draw_belt(axes, laid[i - 1], pulley, float(sheet["wrap_deg"][row]))
            places = np.array([pulley["leaves_m"], pulley["arrives_m"]])
            white = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
            _write(axes, f"{leaving[i]:.0f} N", places.mean(axis=0), bbox=white)
            outwards = (centres[i] - middle) / np.hypot(*(centres[i] - middle))
            label_at = centres[i] + (pulley["radius_m"] + 0.6 * size) * outwards
            force = sheet["hub_force_N"][row]
            _write(axes, f"{pulley['pulley']}\n{force:.0f} N", label_at, color=SIMULATED)
        axes.set_aspect("equal")
        axes.margins(0.2)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.grid(visible=False)
    torque = float(np.nanmax(np.abs(sheet["torque_N_m"][rows])))
    return [
        Picture(
            "drawing",
            "The drive and its forces",
            f"Point {run}, {abs(sheet['driver_speed_rad_s'][rows[0]]):.4g} rad/s, largest torque "
            f"{torque:.3g} N m. Numbers at the spans: belt tension; at the pulleys: force of the "
            "belt on the axis.",
            fig,
        )
    ]


def _draw_belt(
    axes: Axes, before: Mapping[str, Any], pulley: Mapping[str, Any], wrap: float
) -> None:
    """Draw a pulley, the belt on it and the span that leaves it; `before` is the last pulley."""
    from matplotlib.patches import Circle

    centre, radius = np.array((pulley["x_m"], pulley["y_m"])), pulley["radius_m"]
    leaves = np.array(pulley["leaves_m"])
    first, last = _wrapped(np.array(before["arrives_m"]) - centre, leaves - centre, wrap)
    axes.add_patch(Circle(tuple(centre), radius, facecolor=GRID, edgecolor="none"))
    around, belt = (centre[:, None] + radius * _on_circle(*to) for to in ((0, 360), (first, last)))
    axes.plot(*around, color=FAINT, linewidth=0.8)
    axes.plot(*belt, color=INK, linewidth=2.0)
    axes.plot(*np.stack([leaves, pulley["arrives_m"]], axis=1), color=INK, linewidth=2.0)


def _write(axes: Axes, text: str, at: np.ndarray, **look: Any) -> None:
    axes.annotate(text, tuple(at), ha="center", va="center", fontsize=10, **look)


def _on_circle(first: float, last: float) -> np.ndarray:
    """Return points of the unit circle anticlockwise between two polar angles [deg], (2, n)."""
    turned = (last - first) % 360.0 or 360.0
    angle = np.radians(first + np.linspace(0.0, turned, 73))
    return np.stack([np.cos(angle), np.sin(angle)])


def _wrapped(arrives: np.ndarray, leaves: np.ndarray, wrap: float) -> tuple[float, float]:
    """Return the polar angles between which the belt lies on a pulley [deg], anticlockwise."""
    first, last = (np.degrees(np.arctan2(at[1], at[0])) for at in (arrives, leaves))
    anticlockwise = abs((last - first) % 360.0 - wrap) <= abs((first - last) % 360.0 - wrap)
    return (first, last) if anticlockwise else (last, first)


def _along_arcs(sheet: Sheet) -> list[Picture]:
    """Draw line force and sliding speed along each arc at the most loaded point."""
    arcs = sheet.stated("arcs") or ()
    if not arcs:
        return []
    with style():
        fig = figure(height=TALL)
        force, speed = fig.subplots(2, 1, sharex=True)
        for k, arc in enumerate(arcs):
            look = {**group(k), "marker": None}
            angle = np.array(arc["angle_deg"])
            force.plot(angle, arc["normal_force_N_m"], label=arc["pulley"], **look)
            speed.plot(angle, MILLI * np.array(arc["slip_speed_m_s"]), **look)
        speed.axhline(0.0, color=FAINT, linewidth=0.8)
        force.set_ylabel("normal force [N/m]")
        force.set_ylim(bottom=0.0)
        speed.set(xlabel="angle from the entry of the belt [°]", ylabel="sliding speed v [mm/s]")
        legend_below(fig, [force])
    return [
        Picture(
            "along-arcs",
            "Along the arcs: normal force and sliding",
            f"Point {arcs[0]['run']}. Above 0 the pulley is faster than the belt; at 0 the belt "
            "sticks.",
            fig,
        )
    ]


def _slip_limit(sheet: Sheet) -> list[Picture]:
    """Draw the torque limits of the drive over its tension at rest."""
    rows: Any = sheet.stated("limits_over_tension") or ()
    if len(rows) < 2:
        return []
    tension = np.array([row["initial_tension_N"] for row in rows])
    with new_axes() as (fig, axes):
        for k, (name, column) in enumerate(
            (
                ("adhesion ends", "adhesion_end_torque_N_m"),
                ("gross slip", "slip_limit_torque_N_m"),
            )
        ):
            torque = [np.nan if row[column] is None else row[column] for row in rows]
            axes.plot(tension, torque, label=name, **group(k))
        axes.set(xlabel="belt tension at rest [N]", ylabel=TORQUE)
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
    return [
        Picture(
            "slip-limit",
            "Torque that the drive carries",
            f"At {abs(rows[0]['driver_speed_rad_s']):.4g} rad/s, string level. Between the two "
            "lines pulleys slide as a whole, and the speed loss grows fast.",
            fig,
        )
    ]


def _most_loaded(sheet: Sheet) -> str | None:
    """Return the point with the largest steady torque."""
    torque = np.abs(sheet["torque_N_m"]) * np.isfinite(sheet["speed_loss_rad_s"])
    steady = np.where(np.isfinite(torque), torque, -1.0)
    return str(sheet["run"][int(np.argmax(steady))]) if np.max(steady) > 0.0 else None


def _loss(sheet: Sheet) -> Picture:
    pulley = _slowest(sheet)
    title = f"Predicted speed loss of {pulley} over its torque"
    of = sheet["pulley"] == pulley
    with new_axes(columns=2) as (fig, axes):
        for k, (name, rows) in enumerate(_series(sheet, of)):
            look = group(k)
            torque, loss = sheet["torque_N_m"][rows], sheet["speed_loss_rad_s"][rows]
            width = 2.0 * sheet["speed_loss_u_rad_s"][rows]
            axes.plot(torque, loss, label=name, **look)
            axes.fill_between(torque, loss - width, loss + width, color=look["color"], alpha=0.15)
            below = np.zeros(torque.size)
            for part in ("loss_creep_rad_s", "loss_seating_rad_s"):
                below = below + sheet[part][rows]
                axes.plot(torque, below, color=look["color"], linewidth=0.6)
        axes.set(xlabel=TORQUE, ylabel=LOSS)
    return Picture(
        "loss",
        title,
        "A line per driver speed and belt tension, with a band of two standard uncertainties. Thin "
        "lines below it: creep alone, and creep with seating; the rest is slip of whole pulleys.",
        fig,
    )


def _arcs(sheet: Sheet) -> Picture:
    with new_axes() as (fig, axes):
        torque = np.abs(sheet["torque_N_m"])
        for k, pulley in enumerate(dict.fromkeys(sheet["pulley"].tolist())):
            of = sheet["pulley"] == pulley
            share = sheet["arc_used_deg"][of] / sheet["wrap_deg"][of]
            look = {**group(k), "linestyle": "none"}
            axes.plot(torque[of], 100.0 * share, label=str(pulley), **look)
        axes.axhline(100.0, color=FAINT, linewidth=0.8)
        axes.set(xlabel=TORQUE, ylabel="sliding part of the arc [%]")
    return Picture(
        "arcs",
        "How much of its arc each pulley uses",
        "Below 100 % the belt sticks at the entry, and the loss does not depend on friction.",
        fig,
    )


def compared(sheet: Sheet) -> list[Picture]:
    """Draw measured and predicted speed loss over torque."""
    with new_axes(columns=2) as (fig, axes):
        all_rows = np.ones(len(sheet["run"]), dtype=bool)
        for k, (name, rows) in enumerate(_series(sheet, all_rows)):
            look = group(k)
            torque = sheet["torque_N_m"][rows]
            axes.plot(torque, sheet["loss_predicted_rad_s"][rows], **{**look, "marker": None})
            axes.errorbar(
                torque,
                sheet["loss_measured_rad_s"][rows],
                2.0 * sheet["u_measured_rad_s"][rows],
                label=name,
                **{**look, "linestyle": "none"},
            )
        axes.set(xlabel=TORQUE, ylabel=LOSS)
    return [
        Picture(
            "comparison",
            "Speed loss of the drive, measured and predicted",
            "Points: the bench, with two standard errors. Lines: the prediction from the "
            "identified laws, which were not fitted to this recording.",
            fig,
        )
    ]


def _slowest(sheet: Sheet) -> str:
    """Return the pulley that takes off the largest torque, whose loss matters most."""
    driven = np.abs(np.nan_to_num(sheet["torque_N_m"]))
    driven = np.where(np.nan_to_num(sheet["speed_loss_rad_s"]) != 0.0, driven, -1.0)
    return str(sheet["pulley"][int(np.argmax(driven))])


def _series(sheet: Sheet, of: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and rows of every driver speed and belt tension, sorted by torque."""
    rows = np.flatnonzero(of)
    series = series_of(sheet["driver_speed_rad_s"][rows], sheet["initial_tension_N"][rows])
    for (speed, tension), places in series.items():
        members = rows[places]
        members = members[np.argsort(sheet["torque_N_m"][members], kind="stable")]
        yield f"{speed:.4g} rad/s, {tension:.4g} N", members
