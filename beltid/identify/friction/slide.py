"""The sliding of a run of the friction rig: plateau and sticking peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.channels import Channels
from beltid.identify.friction.peak import StickingPeak, sticking_peak
from beltid.identify.friction.plateau import Plateau, PlateauCriteria, settle
from beltid.identify.friction.rest_phase import SetAsideError
from beltid.identify.friction.run import NAN, FrictionSettings, RunRecord, RunReduction
from beltid.identify.friction.sliding_phase import sliding_phase, unswapped
from beltid.identify.friction.start import Found, Run, Start
from beltid.laws.capstan import friction_coefficient, mean_normal_force

Array = NDArray[np.float64]


def finish_run(run: Run, R: float, settings: FrictionSettings) -> RunReduction:
    """Reduce the sliding of a run that was started; what only all runs tell is to follow."""
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
