"""The build-up of a run of the friction rig: how fast the tensions part while everything sticks.

Before the belt slides, a travel x of the pulley's surface parts the tensions of both spans in
proportion to it. The slope is taken from the samples below 30 % of the difference that the sliding
belt has. The runs are those of `beltid.identify.friction`, with the same cells and the same rest;
only the condensing of long records is left out, for it would thin the build-up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.statistics import median
from beltid.identify.friction.channels import (
    Channels,
    find_rotation,
    read_channels,
    sliding_phase,
    unswapped,
)
from beltid.identify.friction.rest import MIN_SAMPLES, Rest, rest_state
from beltid.identify.friction.run import NAN, FrictionSettings, RunRecord, RunRejected

Array = NDArray[np.float64]

SHARE = 0.3
"""Share of the plateau difference up to which the build-up is used [-]."""
FEWEST = 8
"""Fewest samples of the build-up that make a slope."""
LEAST_NOISE = 1.0e-3
"""Deviations from a line below this share of the difference are none."""
STEEPENS = 4.0
"""Standard errors of its curvature beyond which a build-up grows steeper."""


@dataclass(frozen=True, slots=True)
class BuildUp:
    """The build-up of one run. What could not be determined is nan."""

    run: str
    arc_deg: float
    """Contact arc, nominal [deg]."""
    nominal_tension_N: float
    initial_tension_N: float = NAN
    """Mean of both cells at rest [N]."""
    pulley_speed_rad_s: float = NAN
    slope_N_m: float = NAN
    """Change of T_tight - T_slack over the travel of the pulley's surface [N/m]."""
    slope_se_N_m: float = NAN
    """Its standard error from the noise of the samples."""
    n_samples: int = 0
    """Samples that the slope is from."""
    sampling_rate_Hz: float = NAN
    """Of those samples."""
    needed_rate_Hz: float = NAN
    """Sampling rate at which there would be enough of them."""
    status: str = "ok"
    """"ok", or why the run is not used."""

    @property
    def ok(self) -> bool:
        """Whether the slope may be used."""
        return self.status == "ok"


def build_up(record: RunRecord, R: float, settings: FrictionSettings) -> BuildUp:
    """Slope of the build-up of one run; a run that cannot be used says why in its status.

    Parameters
    ----------
    record : RunRecord
        The samples, at least until the belt slides.
    R : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings
        What is known of the load cells, spikes, gaps, the fewest samples at rest.
    """
    found = BuildUp(record.run, record.arc_deg, record.nominal_tension_N)
    try:
        if record.defect:
            raise RunRejected(record.defect)
        channels = read_channels(record, settings)
        rotation = find_rotation(channels.speed)
        rest = rest_state(
            channels.time_s,
            channels.tight,
            channels.slack,
            rotation.first,
            MIN_SAMPLES,
            channels.steps,
        )
        channels, swapped = unswapped(channels, rotation)
        phase = sliding_phase(channels, rotation)
        if phase.time_s.size - phase.slide < settings.min_plateau_samples:
            raise RunRejected("too short: the record ends before the plateau shows")
    except RunRejected as reason:
        return replace(found, status=str(reason))
    # from here on time counts from the first sample at which the pulley turns
    part = slice(phase.first, None)
    t = phase.time_s[part]
    at_rest = -rest.imbalance_N if swapped else rest.imbalance_N
    difference = phase.tensions[part, 0] - phase.tensions[part, 1] - at_rest
    sliding = phase.slide - phase.first
    level = SHARE * median(difference[sliding:])
    # counted, not cut off at the first one beyond: noise adds as many samples as it takes away
    n = int(np.count_nonzero(difference[:sliding] < level))
    lasts = float(t[n] - t[0]) if n else float(phase.time_s[phase.first] - rest.last_s)
    found = replace(
        found,
        initial_tension_N=rest.tension_N,
        pulley_speed_rad_s=rotation.speed_rad_s,
        n_samples=n,
        sampling_rate_Hz=max(n, 1) / lasts,
    )
    if n < FEWEST:
        needed = _round_up(FEWEST / lasts)
        return replace(
            found,
            needed_rate_Hz=needed,
            status=f"{n} samples before {100 * SHARE:g} % of the plateau difference, must be "
            f">= {FEWEST}: sample at {needed:g} Hz or more, or turn the pulley more slowly",
        )
    x = _travel(channels, t[:sliding], R)
    # up to where a line crosses the level: the count goes with the noise of the last samples
    line = np.polynomial.Polynomial.fit(x[:n], difference[:n], 1)
    n = max(int(np.count_nonzero(line(x) < level)), FEWEST)
    slope, slope_se, steepening = _slope(x[:n], difference[:n], rest, channels.steps)
    if not slope > 0.0:
        return replace(found, status=f"the tensions do not part: slope {slope:.3g} N/m")
    if steepening > STEEPENS:  # slip flattens it
        why = "the tensions part faster and faster: take-up of the bench, or load cells that lag"
        return replace(found, status=why)
    return replace(found, slope_N_m=slope, slope_se_N_m=slope_se, n_samples=n)


def _round_up(rate: float) -> float:
    """Two digits, upwards."""
    step = 10.0 ** (math.floor(math.log10(rate)) - 1)
    return math.ceil(rate / step) * step


def _travel(channels: Channels, t: Array, R: float) -> Array:
    """Travel of the pulley's surface at some times [m], from any origin."""
    speed = np.abs(channels.speed)
    turned = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(channels.time_s))
    return R * np.interp(t, channels.time_s, np.concatenate([[0.0], turned]))


def _slope(
    x: Array, difference: Array, rest: Rest, steps: tuple[float, float]
) -> tuple[float, float, float]:
    """Slope of a line through the samples, its standard error; curvature over its standard error.

    The intercept is free, as the start of the rotation lies anywhere between two samples. The noise
    is that about the line and that at rest together: few samples hardly know their own. The noise
    of the curvature is that at rest, if it is known.
    """
    away = x - x.mean()
    squares = float(away @ away)
    slope = float(away @ difference) / squares
    residual = difference - difference.mean() - slope * away
    freedom = np.array([x.size - 2.0, max(rest.n_samples - 2.0, 0.0)])
    variances = np.array([float(residual @ residual) / freedom[0], 2.0 * rest.noise_N**2])
    variance = float(freedom @ variances / freedom.sum()) + float(np.square(steps).sum()) / 12.0
    bend = away**2 - np.mean(away**2)
    bend -= (float(bend @ away) / squares) * away
    noise = variances[1] if freedom[1] > 0.0 else variances[0]
    noise += float(np.square(steps).sum()) / 12.0 + (LEAST_NOISE * float(np.ptp(difference))) ** 2
    curvature = float(bend @ difference) / math.sqrt(float(bend @ bend) * noise)
    return slope, math.sqrt(variance / squares), curvature
