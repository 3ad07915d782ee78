"""Reduce the runs of the friction rig: tensions over time to one friction coefficient per run.

The same function serves the bench and the simulated rig; nothing in it depends on which one wrote
the recording. A run that cannot be reduced is set aside with its reason, never dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.channels import Channels, prepare
from beltid.identify.friction_run import (
    NAN,
    FrictionSettings,
    RunRecord,
    RunReduction,
    arc_problem,
)
from beltid.identify.peak import StickingPeak, sticking_peak
from beltid.identify.plateau import Plateau, PlateauCriteria, settle
from beltid.identify.rest_phase import Rest, Rotation, SetAsideError, find_rotation, rest_state
from beltid.identify.rig_table import check_columns, run_records
from beltid.identify.sliding_phase import sliding_phase, unswapped
from beltid.laws.capstan import friction_coefficient, mean_normal_force, sliding_speed

__all__ = ["FrictionSettings", "RunRecord", "RunReduction", "reduce_run", "reduce_runs"]

Array = NDArray[np.float64]
Found = dict[str, Any]

SPEED_CHANGE_NOTED = 0.02
SPEED_CHANGE_ALLOWED = 0.2
"""Relative change of the pulley's speed between the halves of the rotation."""
SIGNIFICANT_IMBALANCE = 4.0
"""Imbalance over its standard error above which it is worth a note."""


def reduce_run(
    time_s: ArrayLike,
    tension_tight_N: ArrayLike,
    tension_slack_N: ArrayLike,
    pulley_speed_rad_s: ArrayLike,
    *,
    arc_deg: float,
    pulley_radius_m: float,
    settings: FrictionSettings | None = None,
) -> RunReduction:
    """Reduce one recording of the friction rig.

    Parameters
    ----------
    time_s : array_like
        Times [s], shape (n,).
    tension_tight_N, tension_slack_N : array_like
        Tensions of the two spans [N], > 0; nan where a sample is missing, shape (n,).
    pulley_speed_rad_s : array_like
        Speed of the pulley [rad/s], of either sign, zero at the beginning, shape (n,).
    arc_deg : float
        Contact arc [deg].
    pulley_radius_m : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings, optional
        Settings of the reduction.

    Returns
    -------
    RunReduction
        With ``status == "ok"``, or with the reason why the run was set aside.

    Raises
    ------
    InputError
        If the columns differ in length, or the radius is not positive.
    """
    columns = {
        "time_s": time_s,
        "tension_tight_N": tension_tight_N,
        "tension_slack_N": tension_slack_N,
        "pulley_speed_rad_s": pulley_speed_rad_s,
    }
    arrays = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    check_columns(arrays)
    _check_radius(pulley_radius_m)
    record = RunRecord(
        time_s=arrays["time_s"],
        tension_tight_N=arrays["tension_tight_N"],
        tension_slack_N=arrays["tension_slack_N"],
        pulley_speed_rad_s=arrays["pulley_speed_rad_s"],
        arc_deg=float(arc_deg),
        defect=arc_problem(float(arc_deg)),
    )
    return _reduce(record, pulley_radius_m, settings or FrictionSettings())


def reduce_runs(
    columns: Mapping[str, ArrayLike],
    pulley_radius_m: float,
    settings: FrictionSettings | None = None,
) -> tuple[RunReduction, ...]:
    """Reduce all runs of a recording of the friction rig.

    Parameters
    ----------
    columns : mapping of str to array_like
        The columns of rig.csv: run, time_s [s], tension_tight_N, tension_slack_N [N],
        pulley_speed_rad_s [rad/s], arc_deg [deg], and optionally temperature_degC [°C] and
        initial_tension_N (nominal) [N], shape (n,) each. Rows of a run need not be together.
    pulley_radius_m : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings, optional
        Settings of the reduction.

    Returns
    -------
    tuple of RunReduction
        One for every run, in the order in which they first appear.

    Raises
    ------
    InputError
        If a column is missing, has another length or is not numeric, if there are no samples, or
        if the radius is not positive.
    """
    _check_radius(pulley_radius_m)
    chosen = settings or FrictionSettings()
    return tuple(_reduce(record, pulley_radius_m, chosen) for record in run_records(columns))


def _check_radius(pulley_radius_m: float) -> None:
    if not (np.isfinite(pulley_radius_m) and pulley_radius_m > 0.0):
        raise InputError(f"pulley_radius_m = {pulley_radius_m!r}, must be > 0")


_EMPTY: Found = {
    field.name: {"int": 0, "bool": False, "str": "", "tuple[str, ...]": ()}.get(
        str(field.type), NAN
    )
    for field in fields(RunReduction)
}


def _reduce(record: RunRecord, R: float, settings: FrictionSettings) -> RunReduction:
    """Reduce one record; whatever is wrong with it ends in its status."""
    found: Found = {
        **_EMPTY,
        "run": record.run,
        "arc_deg": record.arc_deg,
        "nominal_tension_N": record.nominal_tension_N,
        "mu_sticking_reason": "the run was set aside",
    }
    notes: list[str] = []
    try:
        if record.defect:
            raise SetAsideError(record.defect)
        _fill(record, R, settings, found, notes)
        found["status"] = "ok"
    except SetAsideError as reason:
        found["status"] = str(reason)
    return RunReduction(**{**found, "notes": tuple(notes)})


def _fill(
    record: RunRecord, R: float, settings: FrictionSettings, found: Found, notes: list[str]
) -> None:
    """Find one quantity after the other, so that a run set aside keeps what came before."""
    channels = prepare(record, settings)
    found |= {"n_spikes": channels.n_spikes, "n_missing": channels.n_missing}
    rotation = find_rotation(channels.speed)
    found |= {
        "pulley_speed_rad_s": rotation.speed_rad_s,
        "slip_speed_m_s": float(sliding_speed(rotation.speed_rad_s, R)),
        "start_time_s": float(channels.time_s[rotation.first]),
    }
    _note_rotation(rotation, channels, notes)
    rest = rest_state(channels.tight, channels.slack, rotation.first, settings.min_rest_samples)
    found |= {
        "initial_tension_N": rest.tension_N,
        "imbalance_N": rest.imbalance_N,
        "imbalance_se_N": rest.imbalance_se_N,
    }
    _check_balance(rest, settings, notes)
    channels, found["swapped"] = unswapped(channels, rotation, notes)
    if settings.correct_imbalance:
        half = -0.5 * rest.imbalance_N if found["swapped"] else 0.5 * rest.imbalance_N
        channels = replace(channels, tight=channels.tight - half, slack=channels.slack + half)
    t, tensions, first, slide = sliding_phase(channels, rotation)
    criteria = PlateauCriteria(
        settings.steady_tolerance,
        settings.max_drift,
        settings.min_plateau_samples,
        settings.min_plateau_fraction,
    )
    plateau = settle(t[slide:], tensions[slide:], criteria)
    extra = rest.imbalance_se_N if settings.correct_imbalance else 0.0
    _fill_plateau(record, R, channels, t[slide:], plateau, extra, found)
    _note_plateau(plateau, notes)
    mu = found["mu_sliding"]
    if not 0.0 < mu <= settings.max_mu:
        raise SetAsideError(f"mu_sliding = {mu:.4g}, must be in (0, {settings.max_mu:g}]")
    peak = sticking_peak(t, tensions, first, slide, plateau, settings.max_peak_error)
    _fill_peak(record, peak, found)


def _note_rotation(rotation: Rotation, channels: Channels, notes: list[str]) -> None:
    if rotation.reversed:
        notes.append("the pulley speed is negative: its magnitude is used")
    change = abs(rotation.unsteadiness)
    if change > SPEED_CHANGE_ALLOWED:
        raise SetAsideError(
            f"the pulley speed is not steady: it changes by {100 * rotation.unsteadiness:+.3g} %, "
            f"allowed is {100 * SPEED_CHANGE_ALLOWED:g} %"
        )
    if change > SPEED_CHANGE_NOTED:
        notes.append(f"the pulley speed changes by {100 * rotation.unsteadiness:+.2g} %")
    if channels.time_s.size - rotation.end > 2:
        notes.append(f"the pulley stops at {channels.time_s[rotation.end]:.4g} s")


def _check_balance(rest: Rest, settings: FrictionSettings, notes: list[str]) -> None:
    relative = abs(rest.imbalance_N) / rest.tension_N
    if relative > settings.max_imbalance:
        raise SetAsideError(
            f"the cells differ by {rest.imbalance_N:+.4g} N at rest at a mean of "
            f"{rest.tension_N:.4g} N, allowed is {100 * settings.max_imbalance:g} %"
        )
    if relative > 0.005 and abs(rest.imbalance_N) > SIGNIFICANT_IMBALANCE * rest.imbalance_se_N:
        done = "taken off" if settings.correct_imbalance else "not corrected"
        notes.append(
            f"the cells differ by {rest.imbalance_N:+.3g} N at rest "
            f"({100 * relative:.2g} %), {done}"
        )


def _fill_plateau(
    record: RunRecord,
    R: float,
    channels: Channels,
    t: Array,
    plateau: Plateau,
    imbalance_se_N: float,
    found: Found,
) -> None:
    """Results of the plateau, Eqs. (6) and (8)."""
    tight, slack = (float(level) for level in plateau.levels)
    beta = float(np.radians(record.arc_deg))
    start, end = plateau.start_s, float(t[-1])
    imbalance = 0.5 * imbalance_se_N * (1.0 / tight + 1.0 / slack)
    temperature = NAN
    if channels.temperature is not None:
        values = channels.temperature[(channels.time_s >= start) & (channels.time_s <= end)]
        values = values[np.isfinite(values)]
        temperature = float(np.mean(values)) if values.size else NAN
    has_ripple = bool(plateau.fit.lines)
    found |= {
        "tension_tight_N": tight,
        "tension_slack_N": slack,
        "mu_sliding": float(friction_coefficient(tight, slack, beta)),
        "mu_sliding_se": float(np.hypot(plateau.log_ratio_se, imbalance) / beta),
        "normal_force_N_m": float(mean_normal_force(tight, slack, R)),
        "temperature_degC": temperature,
        "n_samples": int(np.count_nonzero(~plateau.rejected[t >= start])),
        "n_spikes": found["n_spikes"] + int(np.count_nonzero(plateau.rejected)),
        "plateau_start_s": start,
        "plateau_end_s": end,
        "ripple_amplitude_N": float(plateau.fit.ripple_N[0]),
        "ripple_period_s": 1.0 / plateau.fit.lines[0] if has_ripple else NAN,
        "tail_time_s": plateau.fit.tau,
        "drift": plateau.drift,
    }


def _note_plateau(plateau: Plateau, notes: list[str]) -> None:
    if plateau.drift != 0.0:
        notes.append(f"mu drifts by {100 * plateau.drift:+.2g} % over the sliding phase")
    if abs(plateau.tail_left) > 1e-3:
        notes.append(
            f"mu is still {100 * plateau.tail_left:+.2g} % off its plateau at the end of the "
            "record: the tail of the sticking peak is taken off"
        )


def _fill_peak(record: RunRecord, peak: StickingPeak, found: Found) -> None:
    beta = float(np.radians(record.arc_deg))
    found |= {
        "mu_sticking": peak.log_ratio / beta,
        "mu_sticking_se": peak.log_ratio_se / beta,
        "mu_sticking_reason": peak.reason,
        "peak_time_s": peak.time_s,
    }
