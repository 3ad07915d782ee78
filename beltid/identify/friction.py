"""Reduce the runs of the friction rig: tensions over time to one friction coefficient per run.

The same function serves the bench and the simulated rig; nothing in it depends on which one wrote
the recording. A run that cannot be reduced is set aside with its reason, never dropped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.channels import Channels
from beltid.identify.friction_imbalance import (
    correction_of_one,
    corrections,
)
from beltid.identify.friction_run import (
    NAN,
    FrictionSettings,
    RunRecord,
    RunReduction,
    arc_problem,
)
from beltid.identify.friction_slow_ripple import allow_for_slow_ripple
from beltid.identify.friction_start import Found, Run, Start, start_run
from beltid.identify.friction_tails import average_over_tails
from beltid.identify.peak import StickingPeak, sticking_peak
from beltid.identify.plateau import Plateau, PlateauCriteria, settle
from beltid.identify.rest_phase import SetAsideError
from beltid.identify.rig_table import check_columns, run_records
from beltid.identify.sliding_phase import sliding_phase, unswapped
from beltid.laws.capstan import friction_coefficient, mean_normal_force

__all__ = ["FrictionSettings", "RunRecord", "RunReduction", "reduce_run", "reduce_runs"]

Array = NDArray[np.float64]


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
    chosen = settings or FrictionSettings()
    run = start_run(record, pulley_radius_m, chosen)
    if run.state is not None:
        run.correction = correction_of_one(run.state.rest, chosen.correct_imbalance)
    return read_together([finish_run(run, pulley_radius_m, chosen)])[0]


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
    runs = [start_run(record, pulley_radius_m, chosen) for record in run_records(columns)]
    at_rest = [run for run in runs if run.state is not None]
    rests = [run.state.rest for run in at_rest if run.state is not None]
    cells = corrections(rests, chosen.correct_imbalance)
    for run, correction in zip(at_rest, cells, strict=True):
        run.correction = correction
    return read_together([finish_run(run, pulley_radius_m, chosen) for run in runs])


def _check_radius(pulley_radius_m: float) -> None:
    if not (np.isfinite(pulley_radius_m) and pulley_radius_m > 0.0):
        raise InputError(f"pulley_radius_m = {pulley_radius_m!r}, must be > 0")


def read_together(runs: Sequence[RunReduction]) -> tuple[RunReduction, ...]:
    """What only all runs of a bench tell: the shape of their tails, and a slow ripple."""
    return allow_for_slow_ripple(average_over_tails(runs))


def finish_run(run: Run, R: float, settings: FrictionSettings) -> RunReduction:
    """Reduce the sliding of a run; `read_together` is to follow."""
    if run.state is not None:
        try:
            _slide(run, run.state, R, settings)
            run.found["status"] = "ok"
        except SetAsideError as reason:
            run.found["status"] = str(reason)
    return RunReduction(**{**run.found, "notes": tuple(run.notes)})


def _slide(run: Run, start: Start, R: float, settings: FrictionSettings) -> None:
    """Plateau and sticking peak of a run."""
    found, notes, rotation = run.found, run.notes, start.rotation
    if run.correction.note:
        notes.append(run.correction.note)
    channels = run.correction.applied(start.channels)
    channels, found["swapped"] = unswapped(channels, rotation, notes)
    t, tensions, first, slide = sliding_phase(channels, rotation)
    criteria = PlateauCriteria(
        settings.steady_tolerance,
        settings.max_drift,
        settings.min_plateau_samples,
        settings.min_plateau_fraction,
    )
    step = start.channels.steps
    at_rest = 0.5 * float(channels.time_s[0] + channels.time_s[rotation.first])
    plateau = settle(
        t[slide:], tensions[slide:], criteria, step[::-1] if found["swapped"] else step, at_rest
    )
    if plateau.systematic_se > 0.0:
        notes.append(f"the converters of the cells resolve only {max(step):.3g} N")
    _fill_plateau(run, R, channels, t[slide:], plateau)
    _note_plateau(plateau, notes)
    mu = found["mu_sliding"]
    if not 0.0 < mu <= settings.max_mu:
        raise SetAsideError(f"mu_sliding = {mu:.4g}, must be in (0, {settings.max_mu:g}]")
    peak = sticking_peak(t, tensions, first, slide, plateau, settings.max_peak_error)
    _fill_peak(run.record, peak, found)


def _fill_plateau(run: Run, R: float, channels: Channels, t: Array, plateau: Plateau) -> None:
    """Results of the plateau, Eqs. (6) and (8)."""
    found = run.found
    tight, slack = (float(level) for level in plateau.levels)
    beta = float(np.radians(run.record.arc_deg))
    start, end = plateau.start_s, float(t[-1])
    cells = run.correction.log_ratio_se(tight, slack, found["initial_tension_N"])
    cells = float(np.hypot(cells, plateau.systematic_se))
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
        "mu_sliding_se": float(np.hypot(plateau.log_ratio_se, cells) / beta),
        "cells_log_ratio_se": cells,
        "tails": plateau.tails,
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
