"""First pass over the runs: from a recording to what its campaign needs of it.

Sensor facts, rest, rotation and the condensed sliding of one run, whatever the other runs show.
What is kept is small, so that a bench of any size can be read once, run by run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import block_means
from beltid.identify.friction.channels import Channels, read_channels
from beltid.identify.friction.condense import condensed
from beltid.identify.friction.kinds import TOUCH_DEG, TOUCHING, Span
from beltid.identify.friction.plateaus import BY_BINS, binned_plateaus, course
from beltid.identify.friction.rest_phase import (
    Rest,
    Rotation,
    RunRejected,
    find_rotation,
    rest_state,
)
from beltid.identify.friction.run import FrictionSettings, RunRecord, RunReduction
from beltid.identify.friction.sliding_phase import as_if_held, sliding_phase, unswapped
from beltid.identify.friction.sliding_record import SlidingRecord, sliding_record
from beltid.laws.capstan import sliding_speed

Array = NDArray[np.float64]

SPEED_CHANGE_NOTED = 0.02
SPEED_CHANGE_ALLOWED = 0.2
"""Relative change of the pulley's speed between the halves of the rotation."""
ROUNDING_NOTED = 1e-4
"""Rounding error of ln(T_tight/T_slack) from which on a run tells of its converters [-]."""
ONSET = 200
"""Most samples of the build-up that are kept for the sticking peak."""


@dataclass(frozen=True, slots=True, eq=False)
class Onset:
    """The record from the start of the rotation to the sliding, shape (n,) each."""

    time_s: Array
    travel: Array
    """Travel of the pulley's surface since the end of the build-up [m]."""
    z: Array
    """ln(T_tight/T_slack); nan where a tension is not positive."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedRun:
    """A run as its campaign needs it; without `sliding` it is set aside for the reason found."""

    found: RunReduction
    rest: Rest | None = None
    sliding: SlidingRecord | None = None
    onset: Onset | None = None
    weight: Span | None = None
    """Span that hangs on a dead weight."""
    plateaus: tuple[RunReduction, ...] = ()
    """Those of a run whose speed is not steady, in place of the one found."""


def prepare_run(record: RunRecord, R: float, settings: FrictionSettings) -> PreparedRun:
    """Reduce one record to what its campaign needs; what is wrong with it ends in its status.

    Parameters
    ----------
    record : RunRecord
        The samples.
    R : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings
        Settings of the reduction.
    """
    if settings.speed_bins_rad_s and course(record):
        plateaus = binned_plateaus(record, R, settings)
        return PreparedRun(RunReduction(run=record.run), plateaus=plateaus)
    run = PreparedRun(
        RunReduction(
            run=record.run,
            arc_deg=record.arc_deg,
            nominal_tension_N=record.nominal_tension_N,
            conditions=record.conditions,
        ),
        weight=record.kind.weight,
    )
    try:
        if record.defect:
            raise RunRejected(record.defect)
        # one quantity after the other, so that a run set aside keeps what came before
        channels = read_channels(condensed(record, settings.spike_threshold), settings)
        if not record.kind.is_derived:  # else they were taken off before
            channels = settings.cells.applied(channels)
        run = _with(run, n_spikes=channels.n_spikes, n_missing=channels.n_missing)
        if settings.cells.note:
            run = _noted(run, settings.cells.note)
        rotation = find_rotation(channels.speed)
        run = _with(
            run,
            pulley_speed_rad_s=_pulley_speed(rotation, record, R),
            slip_speed_m_s=float(sliding_speed(rotation.speed_rad_s, R)),
            start_time_s=float(channels.time_s[rotation.first]),
        )
        if record.note:
            run = _noted(run, record.note)
        if record.arc_deg >= TOUCH_DEG:
            run = _noted(run, TOUCHING)
        run = _noted(run, *_rotation_notes(rotation, channels))
        rest = rest_state(
            channels.time_s,
            channels.tight,
            channels.slack,
            rotation.first,
            settings.min_rest_samples,
            channels.steps,
        )
        if record.kind.weight is not None:
            on_tight = record.kind.weight == "tight"
            rest = _of_weight(rest, float((channels.tight if on_tight else channels.slack)[0]))
        run = _with(
            run,
            initial_tension_N=rest.tension_N,
            imbalance_N=rest.imbalance_N,
            imbalance_se_N=rest.imbalance_se_N,
        )
        _check_balance(rest, settings)
        run = replace(run, rest=rest)
        return _slide(run, rest, channels, rotation, R, settings)
    except RunRejected as reason:
        hint = f"; {BY_BINS}" if course(record) else ""
        return _with(replace(run, sliding=None), status=f"{reason}{hint}")


def _pulley_speed(rotation: Rotation, record: RunRecord, R: float) -> float:
    """Speed of the pulley, also where the belt moves [rad/s]."""
    if not record.belt_speed_m_s:
        return rotation.speed_rad_s
    relative = -rotation.speed_rad_s if rotation.reversed else rotation.speed_rad_s
    return record.belt_speed_m_s / R + relative


def _of_weight(rest: Rest, weight_N: float) -> Rest:
    """The rest of a belt on a dead weight: W is its tension, and friction holds the difference."""
    return replace(
        rest,
        tension_N=weight_N,
        end_N=weight_N,
        end_se_N=0.0,
        imbalance_N=0.0,
        imbalance_se_N=0.0,
    )


def _with(run: PreparedRun, **found: object) -> PreparedRun:
    return replace(run, found=replace(run.found, **found))  # type: ignore[arg-type]


def _noted(run: PreparedRun, *notes: str) -> PreparedRun:
    return _with(run, notes=(*run.found.notes, *notes))


def _rotation_notes(rotation: Rotation, channels: Channels) -> list[str]:
    notes = []
    if rotation.reversed and not channels.kind.running:
        notes.append("the pulley speed is negative: its magnitude is used")
    change = abs(rotation.unsteadiness)
    if change > SPEED_CHANGE_ALLOWED:
        raise RunRejected(
            f"the pulley speed is not steady: it changes by {100 * rotation.unsteadiness:+.3g} %, "
            f"allowed is {100 * SPEED_CHANGE_ALLOWED:g} %"
        )
    if change > SPEED_CHANGE_NOTED:
        notes.append(f"the pulley speed changes by {100 * rotation.unsteadiness:+.2g} %")
    if channels.time_s.size - rotation.end > 2:
        notes.append(f"the pulley stops at {channels.time_s[rotation.end]:.4g} s")
        after = np.abs(channels.speed[rotation.end :]) > 0.1 * rotation.speed_rad_s
        if np.count_nonzero(after) > 8:
            notes.append("the pulley starts again: only the first start is used")
    return notes


def _check_balance(rest: Rest, settings: FrictionSettings) -> None:
    if abs(rest.imbalance_N) > settings.max_imbalance * rest.tension_N:
        raise RunRejected(
            f"the cells differ by {rest.imbalance_N:+.4g} N at rest at a mean of "
            f"{rest.tension_N:.4g} N, allowed is {100 * settings.max_imbalance:g} %"
        )


def _slide(
    run: PreparedRun,
    rest: Rest,
    channels: Channels,
    rotation: Rotation,
    R: float,
    settings: FrictionSettings,
) -> PreparedRun:
    """The sliding phase, condensed."""
    channels, swapped = unswapped(channels, rotation)
    if swapped:
        words = "the tight and the slack cell were swapped: T_tight < T_slack while sliding"
        run = _with(_noted(run, words), swapped=True)
        slopes = (-rest.slopes_N_s[0], rest.slopes_N_s[1])
        rest = replace(rest, imbalance_N=-rest.imbalance_N, slopes_N_s=slopes)
        run = replace(run, rest=rest)
    recorded = channels
    if channels.kind.weight is not None:
        channels = as_if_held(channels, rotation)
    phase = sliding_phase(channels, rotation)
    first, slide = phase.first, phase.slide
    t, tensions = phase.time_s, phase.tensions
    if t.size - slide < settings.min_plateau_samples:
        raise RunRejected(
            f"too short: {t.size - slide} usable samples of sliding, "
            f"must be >= {settings.min_plateau_samples}"
        )
    speed = np.abs(channels.speed)
    turned = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(channels.time_s))
    angle = np.interp(t, channels.time_s, np.concatenate([[0.0], turned]))
    angle = angle - angle[first]
    # nine tenths of the build-up were reached at `built`: its end lies a ninth further
    travel = R * (angle - angle[phase.built] / 0.9)
    temperature = np.full(t.size, np.nan)
    if channels.temperature is not None:
        temperature = np.interp(t, channels.time_s, channels.temperature)
    steps = channels.steps[::-1] if swapped else channels.steps
    sliding = sliding_record(
        t[slide:],
        tensions[slide:],
        angle[slide:],
        np.maximum(travel[slide:], 0.0),
        temperature[slide:],
        (rest.first_s, rest.last_s),
        rest.n_samples,
        float(R * angle[phase.built]),
        steps,
        channels.kind.noisy,
    )
    if sliding.rounding > ROUNDING_NOTED:
        run = _noted(run, f"the converters of the cells resolve only {max(steps):.3g} N")
    positive = np.all(tensions[first:slide] > 0.0, axis=1)
    ratio = np.where(positive[:, None], tensions[first:slide], np.nan)
    with np.errstate(invalid="ignore"):
        z = np.log(ratio[:, 0] / ratio[:, 1])
    columns = np.column_stack([t[first:slide], travel[first:slide], z])[-20 * ONSET :]
    onset = Onset(*block_means(columns, ONSET).T)
    run = _with(
        run,
        ripple_amplitude_N=sliding.ripple_N,
        ripple_period_s=sliding.ripple_s,
        plateau_end_s=float(sliding.last_s[-1]),
        n_spikes=run.found.n_spikes + sliding.n_outliers,
    )
    if channels.kind.is_derived:
        # noise of a weight's cell may be that of the cell, or of the ratio of the tensions
        noise = max(_noise_at_rest(rest, seen, sliding) for seen in (recorded, channels))
        rest = replace(rest, noise_N=noise)
    _check_noise(rest, sliding, max(steps), settings)
    return replace(run, sliding=sliding, onset=onset)


def _noise_at_rest(rest: Rest, channels: Channels, sliding: SlidingRecord) -> float:
    """Noise that the errors at rest would make while sliding, over the sensitivity there [N]."""
    here = (channels.time_s >= rest.first_s) & (channels.time_s <= rest.last_s) & channels.usable
    time = channels.time_s[here]
    tight, slack = sliding.tensions_N
    z = channels.tight[here] / tight - channels.slack[here] / slack
    if time.size < 4:
        return rest.noise_N
    line = np.polynomial.Polynomial.fit(time, z, 1)
    return float(np.std(z - line(time), ddof=2)) / sliding.sensitivity


def _check_noise(
    rest: Rest, sliding: SlidingRecord, step_N: float, settings: FrictionSettings
) -> None:
    """Refuse a run that sticks and slips: its tensions are restless only while it slides."""
    # a restlessness of less than 0.1 % in T_tight/T_slack, or of the rounding of a converter
    floor = max(1e-3 / sliding.sensitivity, step_N / np.sqrt(12.0))
    ratio = sliding.unrest_N / max(rest.noise_N, floor)
    if ratio > settings.max_noise_ratio and rest.n_samples >= 8:
        raise RunRejected(
            f"sticks and slips: the noise while sliding is {ratio:.2g} times that at rest, "
            f"allowed is {settings.max_noise_ratio:g} times"
        )
