"""Plateaus averaged over the shapes of the tail, with what all runs of a bench tell about them.

Whether the tail of a sticking peak has a slower part is a property of belt and pulley. The noise of
one run hides it, the runs of a bench together show it: their share of such tails is the
prior knowledge with which each run is then read (`sliding_tails`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beltid.identify.friction.run import RunReduction
from beltid.identify.friction.sliding_tails import share_of_double
from beltid.laws.capstan import friction_coefficient, mean_normal_force

RISING = 0.2
"""Part of the drifts with which mu rises from which on none of them is taken for a tail."""
NOTED = 2.0
"""Ratio of the standard error to that with a single exponential from which on it is told why."""


def average_over_tails(runs: Sequence[RunReduction]) -> tuple[RunReduction, ...]:
    """Replace the level of each plateau by its average over the shapes of the tail.

    A drift may be the slow part of a tail, unless the runs of the bench drift in either direction:
    a tail only falls.

    Parameters
    ----------
    runs : sequence of RunReduction
        All runs of a bench, or a single one; those that were set aside stay as they are.
    """
    good = [run for run in runs if run.ok and run.tails is not None]
    share = share_of_double([run.tails for run in good if run.tails is not None])
    drifts = np.array([run.drift for run in good if run.drift != 0.0])
    wavers = bool(drifts.size and np.mean(drifts > 0.0) >= RISING)
    return tuple(_averaged(run, share, wavers) for run in runs)


def _averaged(run: RunReduction, share: float, wavers: bool) -> RunReduction:
    tails = run.tails
    if not run.ok or tails is None:
        return run
    drifting = 1.0 if wavers else tails.probability_of_fit
    mean, sd = tails.level(share, drifting)
    tight, slack = run.tension_tight_N, run.tension_slack_N
    # the ends of the belt are held: what one span gains the other loses
    shift = (np.exp(mean) * slack - tight) / (1.0 + np.exp(mean))
    tight, slack = tight + float(shift), slack - float(shift)
    beta = float(np.radians(run.arc_deg))
    mu = float(friction_coefficient(tight, slack, beta))
    notes, drift = run.notes, run.drift
    if drifting < 0.5:
        drift = 0.0
    elif drift != 0.0:
        notes += (f"mu drifts by {100 * drift:+.2g} % over the sliding phase",)
    if sd > NOTED * tails.single.se and tails.probability_of_double(share) > 0.5:
        notes += (
            f"the tail of the sticking peak seems to have a slower part: mu is changed by "
            f"{100 * (mu / run.mu_sliding - 1.0):+.2g} %, the standard error allows for it",
        )
    return replace(
        run,
        tension_tight_N=tight,
        tension_slack_N=slack,
        mu_sliding=mu,
        mu_sliding_se=float(np.hypot(sd, run.cells_log_ratio_se) / beta),
        normal_force_N_m=float(
            mean_normal_force(tight, slack, run.slip_speed_m_s / run.pulley_speed_rad_s)
        ),
        drift=drift,
        notes=notes,
    )
