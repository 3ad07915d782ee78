"""The belt drive: speed loss over torque and its parts, arcs used, predicted against measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from beltid.identify.estimators.statistics import as_set
from beltid.report.drawing import FAINT, figure, group, legend_below, style
from beltid.report.picture import Picture
from beltid.report.results import Sheet

TORQUE: Final = "torque [N m]"
LOSS: Final = "speed loss [rad/s]"


def predicted(sheet: Sheet) -> list[Picture]:
    """Figures of a predicted drive: the loss of its most loaded pulley, and the arcs used."""
    return [_loss(sheet), _arcs(sheet)]


def _loss(sheet: Sheet) -> Picture:
    pulley = _slowest(sheet)
    title = f"Predicted speed loss of {pulley} over its torque"
    of = sheet["pulley"] == pulley
    with style():
        fig = figure()
        axes = fig.subplots()
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
        legend_below(fig, [axes], columns=2)
    return Picture(
        "loss",
        title,
        "A line per driver speed and belt tension, with a band of two standard uncertainties. The "
        "thin lines below it: creep alone, and creep with seating; what is left is slip of whole "
        "pulleys.",
        fig,
    )


def _arcs(sheet: Sheet) -> Picture:
    with style():
        fig = figure()
        axes = fig.subplots()
        torque = np.abs(sheet["torque_N_m"])
        for k, pulley in enumerate(dict.fromkeys(sheet["pulley"].tolist())):
            of = sheet["pulley"] == pulley
            share = sheet["arc_used_deg"][of] / sheet["wrap_deg"][of]
            look = {**group(k), "linestyle": "none"}
            axes.plot(torque[of], 100.0 * share, label=str(pulley), **look)
        axes.axhline(100.0, color=FAINT, linewidth=0.8)
        axes.set(xlabel=TORQUE, ylabel="part of the arc that slides [%]")
        legend_below(fig, [axes])
    return Picture(
        "arcs",
        "How much of its arc each pulley uses",
        "Below 100 % the belt sticks where it runs on, and the loss does not depend on friction.",
        fig,
    )


def compared(sheet: Sheet) -> list[Picture]:
    """Measured against predicted speed loss over torque."""
    with style():
        fig = figure()
        axes = fig.subplots()
        everything = np.ones(len(sheet["run"]), dtype=bool)
        for k, (name, rows) in enumerate(_series(sheet, everything)):
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
        legend_below(fig, [axes], columns=2)
    return [
        Picture(
            "comparison",
            "Speed loss of the drive, measured and predicted",
            "Points: the bench, with two standard errors. Lines: the prediction from the "
            "identified laws, to which nothing of this recording was fitted.",
            fig,
        )
    ]


def _slowest(sheet: Sheet) -> str:
    """The pulley that takes the largest torque off; its loss is the one that counts."""
    driven = np.abs(np.nan_to_num(sheet["torque_N_m"]))
    driven = np.where(np.nan_to_num(sheet["speed_loss_rad_s"]) != 0.0, driven, -1.0)
    return str(sheet["pulley"][int(np.argmax(driven))])


def _series(sheet: Sheet, of: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Name and rows of every driver speed and belt tension, in the order of the torque."""
    rows = np.flatnonzero(of)
    speeds = as_set(sheet["driver_speed_rad_s"][rows])
    tensions = as_set(sheet["initial_tension_N"][rows])
    for speed, tension in dict.fromkeys(zip(speeds.tolist(), tensions.tolist(), strict=True)):
        mine = rows[(speeds == speed) & (tensions == tension)]
        mine = mine[np.argsort(sheet["torque_N_m"][mine], kind="stable")]
        yield f"{speed:.4g} rad/s, {tension:.4g} N", mine
