"""Draw the normal force along the arc: Eq. (8) and the simulated contact (Fig. 11)."""

from __future__ import annotations

from typing import Final

import numpy as np

from beltid.report.cells import MILLI
from beltid.report.drawing import (
    FAINT,
    LINE_FORCE,
    MEASURED,
    SIMULATED,
    figure,
    legend_below,
    style,
)
from beltid.report.picture import Picture, absent
from beltid.report.results import ArcProfile, BeltResults

TITLE: Final = "Normal force along the arc"
POSITION: Final = "position along the arc from the tight side [mm]"


def pictures(results: BeltResults) -> list[Picture]:
    """Draw the normal force along each arc."""
    if not results.profiles:
        why = (
            "Needs stiffness.parquet, a surface, and a simulated recording for the data of belt "
            "and rig."
        )
        return [absent("arc", TITLE, why, "Fig. 11")]
    return [along_arcs(results.profiles)]


def along_arcs(profiles: tuple[ArcProfile, ...]) -> Picture:
    """Draw simulated normal force and Eq. (8) for a typical run of each arc (Fig. 11)."""
    with style():
        fig = figure(height=1.0 + 1.9 * len(profiles))
        grid = fig.subplots(len(profiles), 1, sharex=True, squeeze=False)
        for axes, run in zip(grid.flat, profiles, strict=True):
            x = run.profile["arc_position_m"] * MILLI
            axes.plot(
                x,
                run.profile["normal_force_N_m"],
                "-",
                color=SIMULATED,
                label="simulated contact",
            )
            axes.plot(x, run.profile["capstan_force_N_m"], "--", color=MEASURED, label="Eq. (8)")
            axes.axhline(run.mean_force_N_m, color=FAINT, ls=":", lw=1.4, label="mean of Eq. (8)")
            axes.set_title(
                f"arc {run.arc_deg:g}°, T₀ = {run.initial_tension_N:.4g} N, "
                f"v = {MILLI * run.slip_speed_m_s:.3g} mm/s",
                loc="left",
            )
            axes.set_ylim(bottom=0.0)
        grid.flat[-1].set_xlabel(POSITION)
        fig.supylabel(LINE_FORCE, fontsize=10)
        legend_below(fig, list(grid.flat))
    worst = max(float(np.max(p.profile["normal_force_N_m"])) / p.mean_force_N_m for p in profiles)
    return Picture(
        "arc",
        TITLE,
        "Normal force of the simulated belt on the pulley while it slides, and the published "
        "formula. Bending stiffness causes peaks where the belt enters and leaves, up to "
        f"{worst:.2g} times the mean force that the reduction assigns to the run: this is the bias "
        "of the published surface, which the refined one does not have.",
        fig,
        "Fig. 11",
    )
