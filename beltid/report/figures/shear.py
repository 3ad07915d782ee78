"""Slopes of the build-up against the contact arc: what tells the shear of the ribs."""

from __future__ import annotations

from typing import Final

import numpy as np

from beltid.identify.estimators.statistics import as_set
from beltid.report.drawing import figure, group, legend_below, style
from beltid.report.picture import Picture
from beltid.report.results import Sheet

MICRO: Final = 1e6


def against_arc(shear: Sheet) -> Picture:
    """Travel per difference of the tensions over the arc, a group per initial tension."""
    used = shear["status"] == "ok"
    arcs, measured = shear["arc_deg"][used], 1.0 / shear["slope_N_m"][used]
    errors = 2.0 * shear["slope_se_N_m"][used] * measured**2
    fitted = 1.0 / shear["slope_fitted_N_m"][used]
    tensions = as_set(shear["initial_tension_N"])[used]
    with style():
        fig = figure(height=4.2)
        axes = fig.subplots()
        for i, tension in enumerate(np.unique(tensions)):
            rows = np.flatnonzero(tensions == tension)
            rows = rows[np.argsort(arcs[rows], kind="stable")]
            look = group(i)
            axes.errorbar(
                arcs[rows],
                measured[rows] * MICRO,
                errors[rows] * MICRO,
                **{**look, "linestyle": "none"},
                capsize=2,
                label=f"T₀ = {tension:.3g} N",
            )
            axes.plot(arcs[rows], fitted[rows] * MICRO, **{**look, "marker": None})
        axes.set(xlabel="contact arc [°]", ylabel="travel per difference of the tensions [µm/N]")
        legend_below(fig, [axes], columns=4)
    return Picture(
        "shear",
        "Build-up of the tensions",
        "Travel of the pulley's surface that parts the tensions by one newton while the belt "
        "sticks, with two standard errors; lines: by the shear stiffness found, or by ribs that do "
        "not shear where none could be found.",
        fig,
    )
