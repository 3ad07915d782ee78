"""Build-up of a friction-rig run: how fast the tension difference rises while the belt sticks.

Before the belt slides, the difference of the tensions of both spans is proportional to the travel x
of the pulley's surface. The slope comes from the samples below 30 % of the difference in sliding.
Runs, load cells and rest phase are treated as in `beltid.identify.friction`, except that long
records are not condensed, because that would thin out the build-up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.statistics import median
from beltid.identify.friction.channels import (
    find_rotation,
    read_channels,
    sliding_phase,
    unswapped,
)
from beltid.identify.friction.prepare import FEWEST_SLIDING
from beltid.identify.friction.rest import Rest, rest_state
from beltid.identify.friction.run import NAN, RunRecord, RunRejected

Array = NDArray[np.float64]

SHARE = 0.3
"""Share of the plateau difference up to which the build-up is evaluated [-]."""
FEWEST = 8
"""Minimum number of build-up samples for a slope."""
LEAST_NOISE = 1.0e-3
"""Deviations from a line below this share of the difference are negligible."""
STEEPENS = 4.0
"""Curvature, in standard errors, above which a build-up counts as growing steeper."""


@dataclass(frozen=True, slots=True)
class BuildUp:
    """Build-up of one run; nan where a value could not be determined."""

    run: str
    arc_deg: float
    """Nominal contact arc [deg]."""
    nominal_tension_N: float
    initial_tension_N: float = NAN
    """Mean of both cells at rest [N]."""
    pulley_speed_rad_s: float = NAN
    slope_N_m: float = NAN
    """Change of T_tight - T_slack per travel of the pulley's surface [N/m]."""
    slope_se_N_m: float = NAN
    """Standard error of the slope from the noise of the samples [N/m]."""
    n_samples: int = 0
    """Number of samples used for the slope."""
    sampling_rate_Hz: float = NAN
    """Sampling rate of those samples [Hz]."""
    needed_rate_Hz: float = NAN
    """Sampling rate that would give enough samples [Hz]."""
    status: str = "ok"
    """"ok", or why the run is not used."""

    @property
    def ok(self) -> bool:
        """True if the slope may be used."""
        return self.status == "ok"


def build_up(record: RunRecord, R: float) -> BuildUp:
    """Measure the build-up slope of one run; the status tells why a run cannot be used.

    Parameters
    ----------
    record : RunRecord
        The samples, at least up to sliding.
    R : float
        Radius of the belt's centreline on the pulley [m].
    """
    result = BuildUp(record.run, record.arc_deg, record.nominal_tension_N)
    try:
        if record.defect:
            raise RunRejected(record.defect)
        channels = read_channels(record)
        rotation = find_rotation(channels.speed)
        rest = rest_state(channels.time_s, channels.tensions, rotation.first, channels.steps)
        channels, swapped = unswapped(channels, rotation)
        phase = sliding_phase(channels, rotation)
        if phase.time_s.size - phase.slide < FEWEST_SLIDING:
            raise RunRejected("too short: the record ends before the plateau shows")
        # from here on, samples start where the pulley begins to turn
        t = phase.time_s[phase.first :]
        x = R * phase.angle[phase.first : phase.slide]
        offset = -rest.imbalance_N if swapped else rest.imbalance_N
        difference = phase.tensions[:, 0] - phase.tensions[:, 1] - offset
        level = SHARE * median(difference[phase.slide :])
        difference = difference[phase.first : phase.slide]
        # count instead of stopping at the first sample above: noise adds as many as it removes
        n = int(np.count_nonzero(difference < level))
        duration = float(t[n] - t[0]) if n else float(t[0] - rest.last_s)
        result = replace(
            result,
            initial_tension_N=rest.tension_N,
            pulley_speed_rad_s=rotation.speed_rad_s,
            n_samples=n,
            sampling_rate_Hz=max(n, 1) / duration,
        )
        if n < FEWEST:
            needed = _round_up(FEWEST / duration)
            result = replace(result, needed_rate_Hz=needed)
            raise RunRejected(
                f"{n} samples before {100 * SHARE:g} % of the plateau difference, must be "
                f">= {FEWEST}: sample at {needed:g} Hz or more, or turn the pulley more slowly"
            )
        # end where a fitted line crosses the level: the raw count depends on noise near the end
        line = np.polynomial.Polynomial.fit(x[:n], difference[:n], 1)
        n = max(int(np.count_nonzero(line(x) < level)), FEWEST)
        slope, slope_se, steepening = _slope(x[:n], difference[:n], rest, channels.steps)
        if not slope > 0.0:
            raise RunRejected(f"the tension difference does not rise: slope {slope:.3g} N/m")
        if steepening > STEEPENS:  # slip would flatten it
            raise RunRejected(
                "the tension difference rises faster and faster: take-up of the bench, or cells lag"
            )
    except RunRejected as reason:
        return replace(result, status=str(reason))
    return replace(result, slope_N_m=slope, slope_se_N_m=slope_se, n_samples=n)


def _round_up(rate: float) -> float:
    """Round a rate up to two digits."""
    step = 10.0 ** (math.floor(math.log10(rate)) - 1)
    return math.ceil(rate / step) * step


def _slope(x: Array, difference: Array, rest: Rest, steps: Array) -> tuple[float, float, float]:
    """Fit a line; return slope, its standard error, and curvature over its standard error.

    The intercept is free because the rotation may start anywhere between two samples. The noise is
    pooled from the scatter about the line and at rest, because few samples give a poor estimate.
    The noise of the curvature is that at rest, if known.
    """
    centred = x - x.mean()
    squares = float(centred @ centred)
    slope = float(centred @ difference) / squares
    residual = difference - difference.mean() - slope * centred
    dof = np.array([x.size - 2.0, max(rest.n_samples - 2.0, 0.0)])
    variances = np.array([float(residual @ residual) / dof[0], 2.0 * rest.noise_N**2])
    variance = float(dof @ variances / dof.sum()) + float(np.square(steps).sum()) / 12.0
    bend = centred**2 - np.mean(centred**2)
    bend -= (float(bend @ centred) / squares) * centred
    noise = variances[1] if dof[1] > 0.0 else variances[0]
    noise += float(np.square(steps).sum()) / 12.0 + (LEAST_NOISE * float(np.ptp(difference))) ** 2
    curvature = float(bend @ difference) / math.sqrt(float(bend @ bend) * noise)
    return slope, math.sqrt(variance / squares), curvature
