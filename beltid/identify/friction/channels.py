"""Make the channels of one run usable: gaps, spikes, dead and saturated cells.

Everything is kept at its place in time; what is not usable becomes nan, and is counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import converter_steps, median, spike_mask
from beltid.identify.estimators.statistics import mad_sigma
from beltid.identify.friction.condense import missing_rows
from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.identify.friction.rest_phase import RunRejected
from beltid.identify.friction.run import FrictionSettings, RunRecord

Array = NDArray[np.float64]

CLIPPED_FRACTION = 0.04
"""Part of the sliding samples at one and the same extreme value that betrays a saturated cell."""
FEWEST_CLIPPED = 4
"""Fewest samples that do: every channel has one at its extreme, and one or two may equal it."""
LARGEST_N = 1e12
"""Readings beyond this are none [N]: no cell has them, and their squares are no numbers."""
LEAST_ANSWER = 0.02
"""Least change of a cell over the change of the other one."""


@dataclass(frozen=True, slots=True)
class Channels:
    """Usable channels of a run; rows without a time are gone, shape (n,) each."""

    time_s: Array
    tight: Array
    """Tension of the tight cell [N], nan where it is not usable."""
    slack: Array
    speed: Array
    """Speed of the pulley [rad/s], without gaps."""
    temperature: Array | None
    n_spikes: int
    n_missing: int
    steps: tuple[float, float] = (0.0, 0.0)
    """Steps of the converters of the tight and the slack cell [N]; zero where they do not show."""
    kind: RigKind = TWO_CELLS
    """What the bench measured."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Samples with both tensions."""
        return np.isfinite(self.tight) & np.isfinite(self.slack)


def read_channels(record: RunRecord, settings: FrictionSettings) -> Channels:
    """Check the channels of a run, take out its spikes and count its gaps.

    Raises
    ------
    RunRejected
        If the record cannot be reduced.
    """
    timed = np.isfinite(record.time_s)
    n = record.time_s.size
    if n < 2:
        raise RunRejected(f"too short: {n} samples")
    if np.count_nonzero(timed) < 0.5 * n or np.count_nonzero(timed) < 2:
        raise RunRejected(f"time_s is missing in {n - np.count_nonzero(timed)} of {n} samples")
    t = record.time_s[timed]
    back = np.flatnonzero(np.diff(t) < 0.0)
    if back.size:
        k = int(back[0])
        raise RunRejected(
            f"time_s goes back from {t[k]:g} to {t[k + 1]:g} s at sample {k + 2}: not one recording"
        )
    if t[-1] <= t[0]:
        raise RunRejected(f"time_s stands still at {t[0]:g} s")
    weight = record.kind.weight
    (tight, spikes_tight), (slack, spikes_slack) = (
        (values, np.zeros(values.size, dtype=bool))
        if span == weight
        else _tension(values, f"tension_{span}_N", settings)
        for span, values in (
            ("tight", record.tension_tight_N[timed]),
            ("slack", record.tension_slack_N[timed]),
        )
    )
    present = [
        values[timed & np.isfinite(values) & (values != 0.0)]
        for values in (record.tension_tight_N, record.tension_slack_N)
    ]
    lost = ~(np.isfinite(tight) | spikes_tight) | ~(np.isfinite(slack) | spikes_slack)
    n_spikes = int(np.count_nonzero(spikes_tight | spikes_slack))
    raw = record.raw
    temperature = record.temperature_degC
    return Channels(
        time_s=_untied(t),
        tight=tight,
        slack=slack,
        speed=_speed(t, record.pulley_speed_rad_s[timed]),
        temperature=None if temperature is None else temperature[timed],
        n_spikes=n_spikes + (raw.n_spikes if raw else 0),
        n_missing=(
            raw.n_missing if raw else int(np.count_nonzero(lost)) + n - t.size + missing_rows(t)
        ),
        steps=raw.steps if raw else converter_steps(present[0], present[1]),
        kind=record.kind,
    )


def _untied(t: Array) -> Array:
    """Times of a coarse clock, spread evenly until the clock goes on."""
    first = np.flatnonzero(np.append(True, np.diff(t) > 0.0))
    if first.size == t.size:
        return t
    tick = t[first[-1]] - t[first[-2]]
    places, ticks = np.append(first, t.size), np.append(t[first], t[-1] + tick)
    return np.interp(np.arange(t.size), places, ticks)


def _tension(
    values: Array, name: str, settings: FrictionSettings
) -> tuple[Array, NDArray[np.bool_]]:
    """Tension with gaps and spikes as nan, and the mask of the spikes."""
    clean = np.where(np.abs(values) < LARGEST_N, values, np.nan)
    present = np.isfinite(clean)
    n, limit = values.size, settings.max_missing_fraction
    if np.count_nonzero(present) < (1.0 - limit) * n:
        missing = n - np.count_nonzero(present)
        raise RunRejected(
            f"{name} is missing in {100 * missing / n:.3g} % of the samples, "
            f"allowed is {100 * limit:g} %"
        )
    low, high = float(np.min(clean[present])), float(np.max(clean[present]))
    if low == high:
        raise RunRejected(f"{name} is dead: {low:g} N throughout")
    positive = np.count_nonzero(clean[present] > 0.0)
    if positive < (1.0 - limit) * n:
        raise RunRejected(
            f"{name} is not positive in {100 * (n - positive) / n:.3g} % of the samples, "
            f"allowed is {100 * limit:g} %"
        )
    # an exact zero is a lost reading; a negative one may be the noise of a nearly slack span, and
    # leaving those out would bias the mean
    present &= clean != 0.0
    clean[~present] = np.nan
    spikes = np.zeros(n, dtype=bool)
    spikes[present] = spike_mask(clean[present], settings.spike_threshold)
    clean[spikes] = np.nan
    return clean, spikes


def _speed(t: Array, speed: Array) -> Array:
    """Speed of the pulley with its gaps bridged."""
    present = np.isfinite(speed)
    if np.count_nonzero(present) < 0.5 * speed.size:
        raise RunRejected(
            f"pulley_speed_rad_s is missing in {np.count_nonzero(~present)} of {speed.size} samples"
        )
    return speed if np.all(present) else np.interp(t, t[present], speed[present])


def check_cells(channels: Channels, first: int, sliding: slice, tension_N: float) -> None:
    """Refuse a cell that does not answer the rotation or is saturated while the belt slides.

    The ends of the belt are held: if one tension changes by a good part of the initial one
    (`tension_N`), so does the other.

    Raises
    ------
    RunRejected
        With the name of the cell.
    """
    change, weight = {}, channels.kind.weight
    for name, values in (("tight", channels.tight), ("slack", channels.slack)):
        rest, slide = values[:first], values[sliding]
        rest, slide = rest[np.isfinite(rest)], slide[np.isfinite(slide)]
        change[name] = abs(median(slide) - median(rest))
        reason = "" if name == weight else _clipped(rest, slide)
        if reason:
            raise RunRejected(f"tension_{name}_N is saturated: {reason}")
    for name, other in (("tight", "slack"), ("slack", "tight")) if weight is None else ():
        answered = change[name] >= LEAST_ANSWER * change[other]
        if not answered and change[other] > 0.2 * tension_N:
            raise RunRejected(
                f"tension_{name}_N is dead: it changes by {change[name]:.3g} N while "
                f"the other cell changes by {change[other]:.3g} N"
            )


def _clipped(rest: Array, slide: Array) -> str:
    """Where a channel is stuck at an extreme value; empty if it is not.

    Only a channel whose noise is seen at rest can be told to be stuck: a noise-free
    recording may be constant while the belt slides, and a coarse converter repeats values.
    """
    for extreme in (float(np.max(slide)), float(np.min(slide))):
        count = np.count_nonzero(slide == extreme)
        part = count / slide.size
        if count < FEWEST_CLIPPED or part <= CLIPPED_FRACTION:
            continue
        levels = np.unique(rest)
        if levels.size >= 3 and mad_sigma(rest) >= 1.5 * float(np.min(np.diff(levels))):
            return f"{100 * part:.3g} % of the sliding samples are {extreme:g} N"
    return ""
