"""Draw the next runs of the friction rig, and the uncertainty before and after them."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from beltid.report.cells import MILLI
from beltid.report.drawing import (
    GROUPS,
    INK,
    MARKERS,
    figure,
    legend_below,
    logarithmic,
    mark_synthetic,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from beltid.plan.advice import Plan
    from beltid.plan.target import Target
    from beltid.uncertainty.measured import Measured

LEAST_AREA, LARGEST_AREA = 18.0, 150.0  # of a marker, points²


def runs_and_uncertainty(
    candidates: Measured, target: Target, plan: Plan, synthetic: bool
) -> Figure:
    """Draw the uncertainty over force and speed before and after the runs, and the runs.

    The area of a marker is the gain of its run; a number is its count of repetitions.
    """
    force, speed = candidates.normal_force, candidates.slip_speed * MILLI
    with style():
        fig = figure(height=4.4, width=9.6)
        every = fig.subplots(1, 2, sharex=True, sharey=True)
        every[0].set_ylabel("sliding speed [mm/s]")
        parts = (("before", plan.before_at, plan.before), ("after", plan.after_at, plan.after))
        values = 100.0 * np.concatenate([plan.before_at, plan.after_at])
        for axes, (word, at, mean) in zip(every, parts, strict=True):
            field = axes.scatter(
                target.normal_force,
                target.slip_speed * MILLI,
                c=100.0 * at,
                cmap="cividis_r",
                vmin=values.min(),  # one colour scale, to show the reduction
                vmax=values.max(),
                marker="s",
                s=30,
                linewidths=0,
                alpha=0.55,
            )
            axes.plot(force, speed, ".", color=INK, ms=2, label="candidate settings")
            axes.set(xlabel="mean normal force [N/m]", title=f"{word} the runs: {100 * mean:.2g} %")
            logarithmic(axes, "x", np.append(force, target.normal_force))
            logarithmic(axes, "y", np.append(speed, target.slip_speed * MILLI))
        fig.colorbar(field, ax=every, label="standard uncertainty of µ [%]")
        _draw_runs(every[1], candidates, plan)
        fig.suptitle("The next runs", fontsize=10)
        if synthetic:
            mark_synthetic(fig)
        legend_below(fig, list(every), columns=5)
    return fig


def _draw_runs(axes: Axes, candidates: Measured, plan: Plan) -> None:
    """Draw a marker for every planned setting: area by gain, a number for repetitions."""
    force, speed = candidates.normal_force, candidates.slip_speed * MILLI
    chosen = Counter(plan.chosen)
    # a required run, a repetition or a further arc, can have a negative gain
    gains = {run: max(gain, 0.0) for run, gain in zip(plan.chosen, plan.gains, strict=True)}
    most = max(gains.values(), default=1.0) or 1.0
    for k, arc in enumerate(np.unique(candidates.arc)):
        on_arc = [i for i in sorted(chosen) if candidates.arc[i] == arc]
        if not on_arc:
            continue
        axes.scatter(
            force[on_arc],
            speed[on_arc],
            s=[LEAST_AREA + (LARGEST_AREA - LEAST_AREA) * gains[i] / most for i in on_arc],
            marker=MARKERS[k % len(MARKERS)],
            facecolors="none",
            edgecolors=GROUPS[k % len(GROUPS)],
            linewidths=1.6,
            label=f"runs at {np.degrees(candidates.beta[on_arc[0]]):.4g}°",
        )
        for i in on_arc:
            if chosen[i] > 1:
                axes.annotate(
                    f"{chosen[i]}×",
                    (force[i], speed[i]),
                    xytext=(6, 6),
                    textcoords="offset points",
                    fontsize=9,
                )
