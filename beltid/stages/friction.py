"""From the recording of the friction rig to a coefficient per run, Eqs. (5) to (8)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.errors import InputError, counted, percent
from beltid.identify.friction.kinds import TOUCH_DEG, RigKind
from beltid.identify.friction.reduction import RunReduction
from beltid.stage import Outcome
from beltid.stages.columns import at, listed, span
from beltid.stages.plausible import refuse_implausible
from beltid.stages.reduction import (
    TOUCHING,
    drag_taken_off,
    reduce_points,
    reduce_rig,
    reduction_columns,
    rig_kind,
    with_conditions,
)
from beltid.stages.uncertainties import standard_uncertainties
from beltid.uncertainty.reduced import friction_uncertainty
from beltid.uncertainty.sources import StandardUncertainties

HELD: Final = 0.005
"""Difference of the spans at rest over the initial tension above which a warning names it [-]."""
FAINT: Final = 0.1  # standard error over mu above which a run carries little weight
CONSTANT: Final = 0.03
"""Relative change of the sum of tensions up to which a hub force counts as constant [-]."""


def reduced(recording: Recording, config: Config) -> Outcome[tuple[RunReduction, ...]]:
    """Reduce every run of a recording, or every row of a table of plateaus."""
    kind = rig_kind(config)
    with at(recording):
        if recording.kind == "points":
            runs = reduce_points(recording.columns, config)
        else:
            runs = reduce_rig(recording, config)
        refuse_implausible(runs, config, kind)
        runs = with_conditions(runs, config)
        if not any(run.ok for run in runs):
            raise InputError([f"run {run.run} cannot be used: {run.status}" for run in runs])
    direct = not any(np.isfinite(run.tension_tight_N) for run in runs if run.ok)
    # coefficients stated in a table do not depend on the calibration of a rig
    stated = StandardUncertainties() if direct else standard_uncertainties(config)
    columns = reduction_columns(runs)
    combined, budget = friction_uncertainty(columns, stated, config.rig.pulley_radius_m, kind)
    columns |= combined
    good = columns["status"] == "ok"
    aside = [(run.run, run.status) for run in runs if not run.ok]
    names = ("mu_sliding", "normal_force_N_m", "slip_speed_m_s", "arc_deg")
    ranges = {name: span(columns[name][good]) for name in names}
    return Outcome(
        columns,
        runs,
        facts={
            "runs": len(runs),
            "runs_set_aside": len(aside),
            "mu_sliding_range": ranges["mu_sliding"],
            "normal_force_range_N_m": ranges["normal_force_N_m"],
            "slip_speed_range_m_s": ranges["slip_speed_m_s"],
        },
        tables={"budget": budget},
        validity=ranges,
        set_aside=[{"run": run, "why": why} for run, why in aside],
        notes=_notes(runs),
        warnings=(
            *_warnings(runs, kind, held=config.rig.holds == "stretch"),
            *(f"run {run} set aside: {why}" for run, why in aside),
        ),
    )


def _warnings(runs: Sequence[RunReduction], kind: RigKind, *, held: bool) -> Iterator[str]:
    """Yield warnings about common mistakes on a rig of this kind, where the runs suggest them."""
    good = [run for run in runs if run.ok]
    derived = any(np.isfinite(run.tension_tight_N) for run in good)
    if kind.has_torque and derived and not any(run.drag_N_m for run in good):
        yield (
            "the torque includes the drag of the bearings, which raises mu: record a run of the "
            "pulley without the belt and mark it with a column idle: true"
        )
    if kind.measures == "torque_hub" and not kind.running and not held:
        ratio = np.array(
            [(r.tension_tight_N + r.tension_slack_N) / (2.0 * r.initial_tension_N) for r in good]
        )
        growth = float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else 1.0
        if abs(growth - 1.0) > CONSTANT:
            yield (
                f"the sum of the tensions is {growth:.3g} times that at rest: the hub force is not "
                "constant; if the slide of the pulley is held by the load cell of the hub force, "
                "state rig.holds: stretch"
            )
    shares = [abs(run.held) for run in good if abs(run.held) > HELD]
    if shares:
        yield (
            f"at rest the spans differ by {percent(100 * float(np.median(shares)))} of the initial "
            f"tension (median of {counted(len(shares), 'run')} of {len(good)}): "
            "friction held in the belt, or gains of the cells that differ by as much; neither is "
            "corrected. Turn the pulley back and forth before the rest and state "
            "friction.free_at_rest: true, or add a few runs in the other direction; state what the "
            "gains may be off as uncertainty.cell_gain_rel"
        )
    touching = [run.run for run in good if run.arc_deg >= TOUCH_DEG]
    if touching:
        yield f"{TOUCHING} ({listed(touching)})"
    if any(run.conditions.side == "back" for run in good):
        yield (
            "measured on the back of the belt: surface and contact stiffness of one side do not "
            "hold for the other"
        )
    if good and not any(np.isfinite(run.mu_sliding_se) for run in good):
        yield (
            "no standard error is known: state mu_se in the table, or the resolution of the forces "
            "as rig.force_resolution_N"
        )


def _notes(reduced: Sequence[RunReduction]) -> tuple[str, ...]:
    """Return notes on events in several runs, with the number of runs."""
    spikes = [r for r in reduced if r.n_spikes]
    missing = [r for r in reduced if r.n_missing]
    swapped = [r.run for r in reduced if r.swapped]
    unresolved = [r for r in reduced if r.ok and r.mu_sticking_reason]
    lines = list(dict.fromkeys(line for r in reduced for line in drag_taken_off(r)))
    if spikes:
        lines.append(
            f"{sum(r.n_spikes for r in spikes)} spikes left out, in {counted(len(spikes), 'run')}"
        )
    if missing:
        lines.append(
            f"{sum(r.n_missing for r in missing)} samples missing in {counted(len(missing), 'run')}"
        )
    if swapped:
        lines.append(f"tight and slack cell were swapped in {listed(swapped)}; corrected")
    if unresolved:
        lines.append(
            f"no mu_sticking for {counted(len(unresolved), 'run')}: the records do not resolve the "
            "peak"
        )
    faint = [r.run for r in reduced if r.ok and r.mu_sliding_se > FAINT * r.mu_sliding]
    if faint:
        lines.append(
            f"standard error of mu above {percent(100 * FAINT)} in {listed(faint)}: readings near "
            "their resolution or noise, which carry little weight"
        )
    return tuple(lines)
