"""Draw the sliding speed in service over torque (Fig. 9)."""

from __future__ import annotations

from operator import itemgetter

import numpy as np

from beltid.report.cells import MILLI
from beltid.report.conditions import UNKNOWN_TENSION, series_of
from beltid.report.drawing import (
    FAINT,
    SPEED,
    group,
    new_axes,
)
from beltid.report.picture import Picture, absent
from beltid.report.results import BeltResults, Sheet


def pictures(results: BeltResults) -> list[Picture]:
    """Draw the figures of the speed-loss bench."""
    slip = results.get("slip")
    if slip is None:
        why = "There is no slip.parquet: the belt has no recording of the speed-loss bench."
        return [absent("slip", "Sliding speed in service", why, "Fig. 9")]
    return [against_torque(slip)]


def against_torque(slip: Sheet) -> Picture:
    """Draw the largest sliding speed over torque for each setting of the drive (Fig. 9)."""
    series = series_of(slip["driver_speed_rad_s"], slip["initial_tension_N"])
    with new_axes(4.2, columns=2) as (fig, axes):
        for i, ((speed, tension), rows) in enumerate(sorted(series.items(), key=itemgetter(0))):
            rows = rows[np.argsort(slip["torque_N_m"][rows], kind="stable")]
            axes.errorbar(
                slip["torque_N_m"][rows],
                slip["slip_speed_m_s"][rows] * MILLI,
                2.0 * np.nan_to_num(slip["slip_speed_se_m_s"][rows]) * MILLI,
                **group(i),
                capsize=2,
                label=f"driver {speed:.3g} rad/s, T₀ "
                + ("unknown" if tension == UNKNOWN_TENSION else f"= {tension:.3g} N"),
            )
        radius = slip.pulley_radius_m
        speeds = slip.metadata.settings.get("rig", {}).get("pulley_speeds_rad_s", ())
        lines = [MILLI * radius * omega for omega in speeds] if radius else []
        top = axes.get_ylim()[1]
        for k, v in enumerate(v for v in lines if v <= 2.0 * top):
            label = "speeds of the friction rig" if k == 0 else None
            axes.axhline(v, color=FAINT, lw=0.9, ls=(0, (1, 2)), label=label)
        axes.set(xlabel="torque of the driven pulley [N m]", ylabel=SPEED)
    return Picture(
        "slip",
        "Sliding speed in service",
        "Largest sliding speed between belt and pulley, from the speed loss of the two-pulley "
        "drive by Eq. (7), with two standard errors; dotted: the speeds of the friction rig.",
        fig,
        "Fig. 9",
    )
