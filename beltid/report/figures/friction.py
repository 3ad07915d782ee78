"""Friction coefficients over normal force and sliding speed, per arc (Figs. 12 and 16)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.identify.estimators.statistics import as_set
from beltid.report.drawing import (
    FAINT,
    LINES,
    MARKERS,
    figure,
    logarithmic,
    shades,
    style,
)
from beltid.report.picture import Picture, absent
from beltid.report.results import BeltResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORCE: Final = "normal force per length [N/m]"
MU: Final = "friction coefficient µ [-]"
MEASURED_TITLE: Final = "Measured friction coefficient of every run"
SIMULATED_TITLE: Final = "Simulated friction coefficient of every run"
MILLI: Final = 1e3


def measured(results: BeltResults) -> list[Picture]:
    """Measured coefficients of all runs (Fig. 12)."""
    friction = results.get("friction")
    if friction is None:
        why = "There is no friction.parquet."
        return [absent("friction", MEASURED_TITLE, why, "Fig. 12")]
    good = friction["status"] == "ok"
    if not good.any():
        return [absent("friction", MEASURED_TITLE, "No run could be used.", "Fig. 12")]
    known = np.isfinite(friction["mu_sliding_u"]).any()
    doubt = "mu_sliding_u" if known else "mu_sliding_se"
    doubts = "combined standard uncertainties" if known else "standard errors"
    names = ("arc_deg", "slip_speed_m_s", "normal_force_N_m", "mu_sliding", doubt)
    fig = over_force(*(friction[name][good] for name in names))
    return [
        Picture(
            "friction",
            MEASURED_TITLE,
            f"One point per run with two {doubts}, at the mean normal force of Eq. (8); a "
            "line joins the runs of one arc and speed. Shade: sliding speed; marker and line: "
            "contact arc.",
            fig,
            "Fig. 12",
        )
    ]


def simulated(results: BeltResults) -> list[Picture]:
    """Simulated coefficients of all runs, with either surface (Fig. 16)."""
    found = []
    for name, of in (("simulated", "published"), ("simulated_refined", "refined")):
        sheet = results.get(name)
        rows = (
            [row for row in (sheet.extra.get("runs") or ()) if row["status"] == "ok"]
            if sheet
            else []
        )
        title = f"{SIMULATED_TITLE}, {of} surface"
        if not rows or sheet is None:
            found.append(absent(name, title, f"There is no {name}.parquet.", "Fig. 16"))
            continue
        radius = float(sheet.settings.get("rig.pulley_radius_m") or np.nan)
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
        found.append(
            Picture(
                name,
                title,
                f"The same runs on the simulated rig with the {of} surface, each reduced by "
                "Eqs. (6) and (8) like a measured one.",
                fig,
                "Fig. 16",
            )
        )
    return found


def over_force(
    arc_deg: np.ndarray,
    slip_speed_m_s: np.ndarray,
    force_N_m: np.ndarray,
    mu: np.ndarray,
    mu_se: np.ndarray | None,
) -> Figure:
    """Coefficients over the normal force; shade for the speed, marker and line for the arc."""
    arcs, speeds = as_set(arc_deg), as_set(np.abs(slip_speed_m_s))
    arc_values, speed_values = np.unique(arcs), np.unique(speeds[np.isfinite(speeds)])
    with style():
        fig = figure(height=4.6)
        axes = fig.subplots()
        for colour, speed in zip(shades(speed_values.size), speed_values, strict=True):
            for i, arc in enumerate(arc_values):
                rows = np.flatnonzero((arcs == arc) & (speeds == speed))
                rows = rows[np.argsort(force_N_m[rows], kind="stable")]
                if rows.size == 0:
                    continue
                axes.errorbar(
                    force_N_m[rows],
                    mu[rows],
                    None if mu_se is None else 2.0 * np.nan_to_num(mu_se[rows]),
                    color=colour,
                    marker=MARKERS[i % len(MARKERS)],
                    linestyle=LINES[i % len(LINES)],
                    lw=0.9,
                    elinewidth=1.0,
                )
        logarithmic(axes, "x", force_N_m)
        axes.set(xlabel=FORCE, ylabel=MU)
        _two_legends(fig, arc_values, speed_values)
    return fig


def _two_legends(fig: Figure, arcs: np.ndarray, speeds: np.ndarray) -> None:
    from matplotlib.lines import Line2D

    by_speed: list[Any] = [
        Line2D([], [], color=colour, lw=4, label=f"{MILLI * speed:.3g}")
        for colour, speed in zip(shades(speeds.size), speeds, strict=True)
    ]
    by_arc: list[Any] = [
        Line2D(
            [],
            [],
            color=FAINT,
            marker=MARKERS[i % len(MARKERS)],
            ls=LINES[i % len(LINES)],
            label=f"{arc:.3g}°",
        )
        for i, arc in enumerate(arcs)
    ]
    fig.legend(handles=by_speed[::-1], title="v [mm/s]", loc="outside right upper", frameon=False)
    if arcs.size == 1 and arcs[0] == 0.0:  # of no arc
        return
    fig.legend(
        handles=by_arc,
        title=None,
        loc="outside lower center",
        ncols=max(len(by_arc), 1),
        frameon=False,
    )
