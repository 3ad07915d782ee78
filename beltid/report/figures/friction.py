"""Draw friction coefficients over normal force and sliding speed, per arc (Figs. 12 and 16)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.report.cells import MILLI
from beltid.report.conditions import class_name, classes_of, is_setting
from beltid.report.drawing import (
    FAINT,
    LINE_FORCE,
    LINES,
    MARKERS,
    MU,
    logarithmic,
    new_axes,
    shades,
)
from beltid.report.picture import Picture, absent
from beltid.report.results import SIMULATED, BeltResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEASURED_TITLE: Final = "Measured friction coefficient of every run"
SIMULATED_TITLE: Final = "Simulated friction coefficient of every run"
MOST_SPEEDS: Final = 8
"""Largest number of speeds drawn separately; more speeds are grouped into so many classes."""


def measured(results: BeltResults) -> list[Picture]:
    """Draw the measured coefficients of all runs (Fig. 12)."""
    friction = results.get("friction")
    if friction is None:
        why = "There is no friction.parquet."
        return [absent("friction", MEASURED_TITLE, why, "Fig. 12")]
    good = friction["status"] == "ok"
    if not good.any():
        return [absent("friction", MEASURED_TITLE, "No run could be used.", "Fig. 12")]
    combined = np.isfinite(friction["mu_sliding_u"]).any()
    column = "mu_sliding_u" if combined else "mu_sliding_se"
    errors = "combined standard uncertainties" if combined else "standard errors"
    names = ("arc_deg", "slip_speed_m_s", "normal_force_N_m", "mu_sliding", column)
    fig = over_force(*(friction[name][good] for name in names))
    return [
        Picture(
            "friction",
            MEASURED_TITLE,
            f"One point per run with two {errors}, at the mean normal force of Eq. (8). Shade: "
            "sliding speed; marker: contact arc. If these repeat, a line joins the runs of one "
            "arc and speed; if there are many, they are grouped into classes.",
            fig,
            "Fig. 12",
        )
    ]


def simulated(results: BeltResults) -> list[Picture]:
    """Draw the simulated coefficients of all runs, for each surface (Fig. 16)."""
    drawn = []
    for name, of in SIMULATED.items():
        sheet = results.get(name)
        rows = (
            [row for row in (sheet.stated("runs") or ()) if row["status"] == "ok"] if sheet else []
        )
        title = f"{SIMULATED_TITLE}, {of} surface"
        if not rows or sheet is None:
            drawn.append(absent(name, title, f"There is no {name}.parquet.", "Fig. 16"))
            continue
        radius = sheet.pulley_radius_m or np.nan
        columns = {
            key: np.array([row[key] for row in rows], dtype=float)
            for key in rows[0]
            if key in ("arc_deg", "pulley_speed_rad_s", "normal_force_N_m", "mu")
        }
        fig = over_force(
            columns["arc_deg"],
            radius * columns["pulley_speed_rad_s"],
            columns["normal_force_N_m"],
            columns["mu"],
            None,
        )
        drawn.append(
            Picture(
                name,
                title,
                f"The same runs on the simulated rig with the {of} surface, each reduced by "
                "Eqs. (6) and (8) like a measured one.",
                fig,
                "Fig. 16",
            )
        )
    return drawn


def over_force(
    arc_deg: np.ndarray,
    slip_speed_m_s: np.ndarray,
    force_N_m: np.ndarray,
    mu: np.ndarray,
    mu_se: np.ndarray | None,
) -> Figure:
    """Draw coefficients over the normal force; shade by speed, marker and line by arc."""
    speed, arc = MILLI * np.abs(slip_speed_m_s), np.nan_to_num(arc_deg)
    by_speed, by_arc = classes_of(speed, MOST_SPEEDS), classes_of(arc, len(MARKERS))
    named = all(is_setting(speed[rows]) for rows in by_speed)
    named &= all(is_setting(arc[rows]) for rows in by_arc)
    with new_axes(4.6) as (fig, axes):
        for colour, at_speed in zip(shades(len(by_speed)), by_speed, strict=True):
            for i, at_arc in enumerate(by_arc):
                rows = np.intersect1d(at_speed, at_arc)
                rows = rows[np.argsort(force_N_m[rows], kind="stable")]
                if rows.size == 0:
                    continue
                axes.errorbar(
                    force_N_m[rows],
                    mu[rows],
                    None if mu_se is None else 2.0 * np.nan_to_num(mu_se[rows]),
                    color=colour,
                    marker=MARKERS[i],
                    linestyle=LINES[i % len(LINES)] if named else "none",
                    lw=0.9,
                    elinewidth=1.0,
                )
        axes.set(xlabel=LINE_FORCE, ylabel=MU)
        logarithmic(axes, "x", force_N_m)
        speeds = [class_name(speed[rows]) for rows in by_speed]
        arcs = [class_name(arc[rows], "°") for rows in by_arc] if arc.any() else []
        _two_legends(fig, speeds, arcs, joined=named)
    return fig


def _two_legends(fig: Figure, speeds: list[str], arcs: list[str], *, joined: bool) -> None:
    from matplotlib.lines import Line2D

    by_speed: list[Any] = [
        Line2D([], [], color=colour, lw=4, label=speed)
        for colour, speed in zip(shades(len(speeds)), speeds, strict=True)
    ]
    by_arc: list[Any] = [
        Line2D(
            [],
            [],
            color=FAINT,
            marker=MARKERS[i],
            ls=LINES[i % len(LINES)] if joined else "none",
            label=arc,
        )
        for i, arc in enumerate(arcs)
    ]
    fig.legend(handles=by_speed[::-1], title="v [mm/s]", loc="outside right upper", frameon=False)
    if by_arc:
        columns = min(len(by_arc), 4 if joined else 3)
        fig.legend(handles=by_arc, loc="outside lower center", ncols=columns, frameon=False)
