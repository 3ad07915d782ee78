"""Draw tensions and friction coefficient of runs over time, with the detected phases (Fig. 10)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from beltid.report.drawing import (
    INK,
    MEASURED,
    MU,
    SIMULATED,
    figure,
    legend_below,
    style,
)
from beltid.report.picture import Picture, absent
from beltid.report.results import BeltResults, Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLE: Final = "Tensions and friction coefficient over time"
PHASES: Final = (
    ("rest", "#e8e8e8", ""),
    ("build-up", "#f6d9b8", "///"),
    ("peak to sliding", "#ffffff", ""),
    ("sliding plateau", "#cfe6f5", ""),
)
NO_CURVES: Final = (
    "The runs over time are not in this folder: they are stored there if the recording of the rig "
    "is available when the report is written (beltid run, or beltid report --config)."
)


def pictures(results: BeltResults) -> list[Picture]:
    """Draw the typical run of the largest arc."""
    friction, curves = results.get("friction"), results.get("rig_curves")
    if friction is None or curves is None:
        why = "There is no friction.parquet." if friction is None else NO_CURVES
        return [absent("run", TITLE, why, "Fig. 10")]
    rows = {str(run): row for row, run in enumerate(friction["run"])}
    stored = [rows[run] for run in dict.fromkeys(curves["run"].astype(str)) if run in rows]
    good = [row for row in stored if friction["status"][row] == "ok"]
    if not good:
        return [absent("run", TITLE, "No run could be used.", "Fig. 10")]
    typical = max(good, key=lambda row: float(friction["arc_deg"][row]))
    return [over_time(friction, curves, typical)]


def set_aside(results: BeltResults) -> list[Picture]:
    """Draw the runs that were set aside and have a stored curve."""
    friction, curves = results.get("friction"), results.get("rig_curves")
    if friction is None or curves is None:
        return []
    stored = set(curves["run"].astype(str))
    rows = [
        row
        for row, run in enumerate(friction["run"])
        if str(run) in stored and friction["status"][row] != "ok"
    ]
    return [over_time(friction, curves, row) for row in rows]


def over_time(friction: Sheet, curves: Sheet, row: int) -> Picture:
    """Draw tensions (above) and friction coefficient (below) of a run, with phases (Fig. 10)."""
    run = str(friction["run"][row])
    samples = np.flatnonzero(curves["run"].astype(str) == run)
    samples = samples[np.argsort(curves["time_s"][samples], kind="stable")]
    t = curves["time_s"][samples]
    good = friction["status"][row] == "ok"
    with style():
        fig = figure(height=5.6)
        above, below = fig.subplots(2, 1, sharex=True)
        for name, colour, line in (("tight", MEASURED, "-"), ("slack", SIMULATED, "--")):
            tension = curves[f"tension_{name}_N"][samples]
            above.plot(t, tension, line, color=colour, lw=1.1, label=f"{name} span")
        below.plot(t, curves["mu"][samples], color=INK, lw=1.1, label="µ, Eq. (6)")
        _phases(above, friction, row, t, labelled=False)
        _phases(below, friction, row, t, labelled=True)
        _results(below, friction, row)
        above.set_ylabel("tension [N]")
        below.set(xlabel="time [s]", ylabel=MU)
        _bounded(below, curves["mu"][samples], float(friction["mu_sliding"][row]))
        legend_below(fig, [above, below])
    return Picture(
        f"run-{row}",
        TITLE if good else f"Run {run}: set aside",
        _caption(friction, row, good),
        fig,
        "Fig. 10" if good else "",
    )


def _phases(axes: Axes, friction: Sheet, row: int, t: np.ndarray, *, labelled: bool) -> None:
    """Shade the detected phases."""
    times = [
        float(t[0]) if t.size else np.nan,
        *(float(friction[name][row]) for name in ("start_time_s", "peak_time_s")),
        float(friction["plateau_start_s"][row]),
        float(friction["plateau_end_s"][row]),
    ]
    if not np.isfinite(times[2]):  # no peak detected: the build-up lasts until the plateau
        times[2] = times[3]
    for (name, colour, hatch), begin, end in zip(PHASES, times[:-1], times[1:], strict=True):
        if np.isfinite(begin) and np.isfinite(end) and end > begin:
            axes.axvspan(
                begin,
                end,
                facecolor=colour,
                edgecolor="#d9b48a",
                hatch=hatch,
                lw=0,
                zorder=0.4,
                label=name if labelled else None,
            )


def _results(axes: Axes, friction: Sheet, row: int) -> None:
    mu, se = float(friction["mu_sliding"][row]), float(friction["mu_sliding_se"][row])
    if np.isfinite(mu):
        error = f" ± {se:.2g}" if np.isfinite(se) else ""
        axes.axhline(mu, color=MEASURED, ls="--", lw=1.2, label=f"sliding {mu:.4f}{error}")
    peak, at = float(friction["mu_sticking"][row]), float(friction["peak_time_s"][row])
    if np.isfinite(peak) and np.isfinite(at):
        axes.plot(at, peak, "v", color=SIMULATED, ms=7, label=f"sticking peak {peak:.4f}")


def _bounded(axes: Axes, mu: np.ndarray, sliding: float) -> None:
    """Keep spikes from flattening the curve."""
    finite = mu[np.isfinite(mu)]
    if finite.size:
        low, high = np.percentile(finite, [0.5, 99.5])
        high = max(high, sliding) if np.isfinite(sliding) else high
        room = 0.1 * max(high - low, 1e-6)
        axes.set_ylim(low - room, high + 2.0 * room)


def _caption(friction: Sheet, row: int, good: bool) -> str:
    def formatted(name: str, unit: str, per_unit: float = 1.0) -> str:
        value = per_unit * float(friction[name][row])
        return f"{value:.4g} {unit}" if np.isfinite(value) else "unknown"

    settings = (
        f"Run {friction['run'][row]}: arc {formatted('arc_deg', '°')}, "
        f"T₀ = {formatted('nominal_tension_N', 'N')} nominal, "
        f"v = {formatted('slip_speed_m_s', 'mm/s', 1e3)}."
    )
    if not good:
        return f"{settings} Set aside: {friction['status'][row]}."
    return (
        f"{settings} The belt is at rest, then µ rises to the sticking peak and settles; the "
        "sliding plateau (shaded) is the reference. Tensions are drawn as recorded, with the load "
        "cell corrections of the config; the dashed result also corrects for a remaining "
        "difference of the cells, spikes and ripple."
    )
