"""The sticking peak: what the tail of the sliding says about where it starts.

The largest measured sample is a biased estimate: of many noisy samples near a flat maximum it picks
the noisiest. The model of the sliding is followed back to the moment at which the record leaves
the build-up and joins it; that moment is known to one sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beltid.identify.friction.campaign import RunLevel
from beltid.identify.friction.prepare import Onset
from beltid.identify.friction.shared import Shared
from beltid.identify.friction.sliding_record import SlidingRecord
from beltid.identify.friction.tail_shapes import tail_basis

JOINED = 3.0
"""Distance from the model, in standard deviations of the noise, within which a sample is on it."""
STANDS_OUT = 3.0
"""Least height of a peak above the plateau, in standard errors of the peak."""


@dataclass(frozen=True, slots=True)
class StickingPeak:
    """Peak of ln(T_tight/T_slack), or why the record does not tell it."""

    z: float
    """ln(T_tight/T_slack) at the peak [-]; nan where the record does not resolve it."""
    z_se: float
    time_s: float
    """Moment of the sticking peak [s]; nan where it is not found."""
    reason: str
    """Why there is no value; empty if there is one."""


def _unresolved(reason: str, time_s: float = float("nan")) -> StickingPeak:
    return StickingPeak(float("nan"), float("nan"), time_s, reason)


def sticking_peak(
    onset: Onset, record: SlidingRecord, level: RunLevel, shared: Shared, max_error: float
) -> StickingPeak:
    """Find the sticking peak from the model of the sliding.

    Parameters
    ----------
    onset : Onset
        The record before the sliding.
    record, level : SlidingRecord, RunLevel
        The sliding and its model.
    shared : Shared
        What the bench knows of the tail.
    max_error : float
        Largest standard error of the peak, relative to it, that still resolves it.
    """
    t = np.append(onset.time_s, record.first_s[0])
    travel = np.append(onset.travel, record.travel[0])
    z = np.append(onset.z, record.z[0])
    # the tail is followed back to the end of the build-up, not beyond
    model = level.y + tail_basis(np.maximum(travel, 0.0)) @ level.tail
    ripple = record.ripple_N / record.tensions_N[0]
    limit = JOINED * record.noise_N * record.sensitivity + ripple
    off = np.flatnonzero(~(np.abs(z[:-1] - model[:-1]) <= limit))
    join = int(off[-1]) + 1 if off.size else 0
    if join > 0 and z[join - 1] > model[join - 1]:
        return _unresolved("the tensions decay faster than the tail of the peak")
    before = max(join - 1, 0)
    moment = 0.5 * float(t[before] + t[join])
    where = [max(float(travel[k]), 0.0) for k in (before, join)]
    peak, error = level.at(0.5 * (where[0] + where[1]), shared, record.level)
    # noise may hide the end of the build-up in the tail: the moment is uncertain by so much more
    climbed = max(peak - float(np.nanmin(z)), limit)
    margin = float(travel[join] - travel[0]) * limit / climbed
    step = max(where[1] - where[0], 0.0)
    ahead = level.at(where[1] + 0.1 * max(step, margin), shared, record.level)[0]
    behind = level.at(where[1], shared, record.level)[0]
    rate = abs(behind - ahead) / max(0.1 * max(step, margin), 1e-12)
    timing = rate * float(np.hypot(step, margin)) / np.sqrt(12.0)
    se = float(np.linalg.norm([error, timing, record.rounding]))
    if peak - level.y < STANDS_OUT * se:
        return _unresolved("no peak stands out of the plateau", moment)
    if se > max_error * peak:
        return _unresolved(
            f"the samples leave the peak uncertain by {100 * se / peak:.2g} %, "
            f"allowed is {100 * max_error:g} %",
            moment,
        )
    return StickingPeak(peak, se, moment, "")
