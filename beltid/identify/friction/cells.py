"""Errors of the load cells: their zeros from the rest, their gains from runs in both directions.

The difference of the cells of run r at rest (tight less slack) is

    D_r = d_r (zeta + w_r + (gamma + g) T_r) + (h + f_r) T_r + noise.                          (S3)

The zeros differ by zeta in all runs and by w in each, the gains by gamma; d = -1 where the pulley
turns the other way, so that the cells change places. Friction holds shares of the tension in a belt
at rest: h in all runs towards the span that will pull, g towards one side of the bench, f in each.
So the rest shows zeros (newtons, whatever the tension); shares of the tension may be held friction,
and no gain is corrected by them, unless the belt was rocked free (`free_at_rest`). A gain shows
where runs turn in both directions: it changes the sign of its effect on ln(T_tight/T_slack),

    e_r = d_r [q_r (zeta + w_r) + gamma],   q_r = (1/T_tight + 1/T_slack)/2,                   (S4)

friction does not. A common error of both zeros is never visible at rest; it has the size of their
difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.prepare import SlidingRecord
from beltid.identify.friction.run import RunReduction
from beltid.mixed import Mixed, Own, Shared, Size, root

Array = NDArray[np.float64]

ZEROS = ((1e-5, 0.5), (3e-4, 0.125), (1e-3, 0.125), (3e-3, 0.125), (1e-2, 0.125))
"""Sizes of zeta over the median initial tension, with their probabilities."""
HELD = ((1e-5, 0.5), (3e-4, 0.1), (1e-3, 0.1), (3e-3, 0.1), (1e-2, 0.1), (5e-2, 0.1))
"""The same of h."""
OWN_ZERO, OWN_HELD = Size(5e-4, 1.5), Size(5e-4, 1.5)
"""Sizes of w, over the median initial tension, and of f."""
GAINS = ((1.0, 0.6), (3.0, 0.25), (10.0, 0.15))  # the same of gamma, over what is stated
SETTINGS, ARCS, SCATTER = 0.3, 0.03, Size(3e-3, 1.0)
"""How mu of the runs in both directions may change: powers of tension and speed, between the arcs,
from run to run (relative)."""
NOTED = 0.003  # ratio of correction to initial tension above which a note mentions it


@dataclass(frozen=True, slots=True, eq=False)
class CellErrors:
    """Errors of ln(T_tight/T_slack) caused by the cells, shape (R,)."""

    mean: Array  # correction to subtract
    variance: Array  # of its part that is independent between runs
    shared: Array  # standard deviation of its part that all runs share, with its sign
    held: Array  # difference at rest that zeros and gains do not explain, as a share of the tension
    notes: tuple[str, ...]  # note to the user on each run; empty if there is none


def cell_errors(
    runs: Sequence[RunReduction],
    records: Sequence[SlidingRecord],
    level: Array,
    level_se: Array,
    gain_rel: float = 2e-3,
    free_at_rest: bool = False,
) -> CellErrors:
    """Estimate the errors (S4) of runs with their rest and their sliding.

    `level` and `level_se` (R,) are ln(T_tight/T_slack) while sliding and its standard error,
    `gain_rel` the stated standard uncertainty of the gain of a cell; the belt may be `free_at_rest`
    of friction.
    """
    T, D, se = np.array(
        [(r.rest.tension_N, r.rest.imbalance_N, r.rest.imbalance_se_N) for r in records]
    ).T
    d, noise = np.where([run.swapped for run in runs], -1.0, 1.0), np.maximum(se, 1e-5 * T)
    unit = float(np.median(T))
    gains = [(k * max(np.sqrt(2.0) * gain_rel, 1e-6), p) for k, p in GAINS]
    shared = [Shared("zero", d[:, None] * unit, choices=ZEROS)]
    if both_ways := bool(np.ptp(d) > 0.0):
        gain, gain_sd = _gain_by_directions(runs, T, d, level, level_se, gains)
        shared.append(Shared("gain", (d * T)[:, None], Size(gain_sd), mean=gain))
    elif free_at_rest:
        shared.append(Shared("gain", (d * T)[:, None], choices=gains))
    own = [
        Own("noise", Size(1.0), diagonal=noise),
        Own("own zero", OWN_ZERO, diagonal=np.full(D.size, unit)),
    ]
    if not free_at_rest:
        shared.append(Shared("held", T[:, None], choices=HELD))
        if both_ways:
            shared.append(Shared("held aside", (d * T)[:, None], choices=HELD))
        own.append(Own("own held", OWN_HELD, diagonal=T))
    model = Mixed(D, shared, own)
    posterior = model.fit()
    own_zero_N = posterior.sizes["own zero"] * unit
    held = posterior.sizes.get("own held", 0.0) * T
    part = own_zero_N**2 / (np.square(noise) + own_zero_N**2 + held**2)
    zeta = posterior.mean[0] * unit
    zeros = zeta + d * part * posterior.residual[0]
    inverse = 1.0 / np.array([record.tensions_N for record in records])
    q, q_common = 0.5 * inverse.sum(axis=1), 0.5 * (inverse[:, 1] - inverse[:, 0])
    # changes of e by the coefficients: through zeta, and through w, which the residual gives
    slopes, gain = -(q * part)[:, None] * model.X[0], 0.0
    slopes[:, 0] += d * q * unit
    if "gain" in model.places:
        gain = float(posterior.of("gain")[0][0])
        slopes[:, 1] += d
    # the common error of both zeros has the size of their difference
    zero_size = np.hypot(posterior.mean[0], np.sqrt(posterior.covariance[0, 0])) * unit
    columns = np.column_stack([slopes @ root(posterior.covariance), q_common * zero_size])
    mean = d * (q * zeros + gain)
    return CellErrors(
        mean=mean,
        variance=own_zero_N**2 * (q**2 * (1.0 - part) + q_common**2),
        shared=np.where(mean < 0.0, -1.0, 1.0) * np.linalg.norm(columns, axis=1),
        held=(D - d * (zeros + gain * T)) / T,
        notes=tuple(_note(z, t, zeta, own_zero_N, gain) for z, t in zip(zeros, T, strict=True)),
    )


def _gain_by_directions(
    runs: Sequence[RunReduction],
    T: Array,
    d: Array,
    level: Array,
    level_se: Array,
    gains: Sequence[tuple[float, float]],
) -> tuple[float, float]:
    """Return the difference of the gains and its error from ln mu over the settings."""
    arc = np.radians([run.arc_deg for run in runs])
    speed = np.array([run.pulley_speed_rad_s for run in runs])
    log_mu = np.log(np.maximum(level, 1e-6) / arc)
    x, v = (np.log(a) - np.log(a).mean() for a in (T, speed))
    arcs = (np.round(arc, 3)[:, None] == np.unique(np.round(arc, 3))).astype(float)
    model = Mixed(
        log_mu,
        [
            Shared("mean", np.ones((x.size, 1))),
            Shared("powers", np.column_stack([x, v, x**2, v**2, x * v]), Size(SETTINGS)),
            Shared("arcs", arcs, Size(ARCS)),
            Shared("gain", (d / level)[:, None], choices=gains),
        ],
        [
            Own("noise", Size(1.0), diagonal=level_se / level),
            Own("scatter", SCATTER, diagonal=np.ones(x.size)),
        ],
    )
    mean, covariance = model.fit().of("gain")
    return float(mean[0]), float(np.sqrt(covariance[0, 0]))


def _note(zero_N: float, tension_N: float, zeta: float, wander: float, gain: float) -> str:
    """Describe the errors of the cells if they are large."""
    found = []
    if min(abs(zeta) + wander, abs(zero_N)) > NOTED * tension_N:
        own = f" and wander by {wander:.2g} N" if wander > 0.1 * abs(zeta) else ""
        found.append(f"the zero points of the cells differ by {zeta:+.3g} N over all runs{own}")
    if abs(gain) > NOTED:
        found.append(f"the gains of the cells differ by {100 * gain:+.3g} %")
    return f"{'; '.join(found)}: corrected" if found else ""
