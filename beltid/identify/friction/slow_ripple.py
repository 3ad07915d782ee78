"""Ripple once per turn of the pulley, where a run turns it by a part of a turn only.

Such a run cannot tell the ripple from its plateau. What shows is its slope, as a drift, of either
sign from run to run: ``A sin(theta)`` drifts by up to ``A`` per radian and shifts the level by as
much. The drifts of a bench's runs tell how much its standard errors must allow for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beltid.identify.friction.run import RunReduction

FEWEST_DRIFTS = 3
DRIFTING_PART = 0.1
"""Part of the runs that drift from which on it is a property of the bench."""
ENOUGH_TURNS = 2.0
"""Turns of the pulley over the sliding phase that resolve a ripple once per turn."""


def allow_for_slow_ripple(runs: Sequence[RunReduction]) -> tuple[RunReduction, ...]:
    """Widen the standard errors of short runs by what their drifts say about a slow ripple.

    Parameters
    ----------
    runs : sequence of RunReduction
        All runs of a bench, or a single one; those without a drift stay as they are unless many
        others drift.
    """
    slopes = [_drift_per_radian(run) for run in runs if run.ok and run.drift != 0.0]
    aside = sum(run.status.startswith("drifts") for run in runs)
    many = len(slopes) >= FEWEST_DRIFTS and len(slopes) + aside >= DRIFTING_PART * len(runs)
    shared = float(np.sqrt(np.mean(np.square(slopes)))) if many else 0.0
    return tuple(_widened(run, shared) for run in runs)


def _angle(run: RunReduction) -> float:
    """Angle by which the pulley turns [rad]."""
    return run.pulley_speed_rad_s * (run.plateau_end_s - run.start_time_s)


def _drift_per_radian(run: RunReduction) -> float:
    """Change of ln(T_tight/T_slack) with the angle of the pulley [1/rad]."""
    return run.drift * run.mu_sliding * float(np.radians(run.arc_deg)) / _angle(run)


def _widened(run: RunReduction, shared: float) -> RunReduction:
    if not run.ok or _angle(run) > ENOUGH_TURNS * 2.0 * np.pi:
        return run
    own = abs(_drift_per_radian(run)) if run.drift != 0.0 else 0.0
    # the root mean square of the level's shift is that of the slope
    doubt = max(own, shared) / float(np.radians(run.arc_deg))
    if doubt == 0.0:
        return run
    turns = _angle(run) / (2.0 * np.pi)
    note = (
        f"mu drifts in {'many runs' if shared else 'this run'} of less than "
        f"{ENOUGH_TURNS:g} turns of the pulley, this one {turns:.2g}: a ripple once per turn may "
        f"shift it by {100 * doubt / run.mu_sliding:.2g} %, the standard error allows for it"
    )
    return replace(
        run,
        mu_sliding_se=float(np.hypot(run.mu_sliding_se, doubt)),
        mu_sticking_se=float(np.hypot(run.mu_sticking_se, doubt)),
        notes=(*run.notes, note),
    )
