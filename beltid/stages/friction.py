"""From the recording of the friction rig to a coefficient per run, Eqs. (5) to (8).

Measured and simulated recordings pass the same reduction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from beltid.bench.recording import Recording, recording_in
from beltid.config import Config
from beltid.errors import InputError, counted, percent
from beltid.identify.friction.reduction import RunReduction, reduce_plateaus, reduce_records
from beltid.identify.friction.run import PERFECT, SPANS, KnownCell, RigKind, RunRecord, run_records
from beltid.laws.capstan import STRAIGHT, Spans
from beltid.stage import Outcome
from beltid.stages.columns import at, columns_from, listed, span
from beltid.stages.inputs import standard_uncertainties
from beltid.stages.plausible import refuse_implausible
from beltid.uncertainty.measured import friction_uncertainty
from beltid.uncertainty.sources import StandardUncertainties

HELD: Final = 0.005
"""Difference of the spans at rest over the initial tension above which a warning names it [-]."""
FAINT: Final = 0.1  # standard error over mu above which a run carries little weight
CONSTANT: Final = 0.03
"""Relative change of the sum of tensions up to which a hub force counts as constant [-]."""
TOUCH_DEG: Final = 360.0  # arc beyond which the turns of the belt may touch each other
TOUCHING: Final = (
    "the belt is wrapped by a whole turn or more: where its turns touch each other, the friction "
    "is not that of the pulley alone"
)


def reduced(recording: Recording, config: Config) -> Outcome[tuple[RunReduction, ...]]:
    """Reduce every run of a recording, or every row of a table of plateaus."""
    config = config.with_rig(recording.rig)
    kind, radius = rig_kind(config), config.rig.pulley_radius_m
    with at(recording):
        runs = reduce_rig(recording, config)
        refuse_implausible(runs, config, kind)
        surface, side = config.conditions.surface, config.conditions.side
        runs = tuple(
            replace(r, condition=r.condition or surface, side=r.side or side) for r in runs
        )
        if not any(run.ok for run in runs):
            raise InputError([f"run {run.run} cannot be used: {run.status}" for run in runs])
    direct = not any(np.isfinite(run.tension_tight_N) for run in runs if run.ok)
    # coefficients stated in a table do not depend on the calibration of a rig
    stated = StandardUncertainties() if direct else standard_uncertainties(config)
    columns = reduction_columns(runs)
    combined, budget = friction_uncertainty(columns, stated, radius, kind)
    columns |= combined
    good = columns["status"] == "ok"
    aside = [{"run": run.run, "why": run.status} for run in runs if not run.ok]
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
            **{f"rig_{key}": word for key, word in recording.rig.items()},
        },
        tables={"budget": budget},
        validity=ranges,
        set_aside=aside,
        notes=tuple(_notes(runs)),
        warnings=(
            *_warnings(runs, kind, held=config.rig.holds == "stretch"),
            *(f"run {row['run']} set aside: {row['why']}" for row in aside),
        ),
    )


def rig_kind(config: Config) -> RigKind:
    """Return the kind of a config's friction rig: what it measures, and its load cells."""
    rig = config.rig
    # a running belt between two pulleys turns alike at both ends; the line of force does not turn
    bent = rig.kind == "torque_hub" and not rig.running
    spans = Spans(config.belt.bending_stiffness_N_m2, rig.span_length_m, rig.supports == "clamped")
    known = config.friction
    return RigKind(
        measures=rig.kind,
        weight_on=rig.weight_on,
        weight_stated=rig.given_force in SPANS,
        running=rig.running,
        mass_per_length_kg_m=config.belt.mass_per_length_kg_m,
        cells=(
            KnownCell(known.tension_tight_tare_N, known.tension_tight_gain),
            KnownCell(known.tension_slack_tare_N, known.tension_slack_gain),
        ),
        spans=spans if bent else STRAIGHT,
    )


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def reduce_rig(rig: Recording, config: Config) -> tuple[RunReduction, ...]:
    """Reduce the runs of a recording of the friction rig, or the rows of a table of plateaus."""
    radius = config.rig.pulley_radius_m
    if rig.kind == "points":
        resolution = _or_nan(config.rig.force_resolution_N)
        return reduce_plateaus(rig.columns, radius, rig_kind(config), resolution)
    records = records_of(rig, config)
    if rig.is_artifact:  # from perfect cells
        return reduce_records(records, radius)
    return reduce_records(
        records, radius, config.uncertainty.cell_gain_rel, config.friction.free_at_rest
    )


def simulated_recording(frame: Any) -> Recording:
    """Return a frame with the columns of rig.csv as a recording of the simulated rig."""
    return replace(recording_in(frame, "rig"), is_artifact=True)


def records_of(rig: Recording, config: Config) -> tuple[RunRecord, ...]:
    """Return the records of the runs of a recording.

    The recording of the simulated rig holds the tensions of both spans from perfect load cells, for
    every kind of bench. Only the span of a dead weight has no cell: its tension is the initial
    tension. The belt of a running rig runs here as well.
    """
    kind, columns = rig_kind(config), rig.columns
    if rig.is_artifact:
        kind = replace(kind, cells=PERFECT)
        if config.rig.kind == "dead_weight" or config.rig.given_force in SPANS:
            kind = replace(kind, measures="dead_weight")
            columns = {**columns, "weight_N": columns["initial_tension_N"]}
        else:
            kind = replace(kind, measures="two_cells")
    return run_records(columns, config.rig.pulley_radius_m, kind)


def reduction_columns(runs: Sequence[RunReduction]) -> dict[str, np.ndarray]:
    """Return the columns of the friction table; a run set aside keeps the values found for it."""
    return columns_from(
        "friction",
        runs,
        notes=[_notes_of(run) for run in runs],
    )


def _drag_taken_off(run: RunReduction) -> Iterator[str]:
    """Yield the bearing drag that was subtracted from the torque of a run."""
    if run.drag_N_m is not None:
        low, high = run.drag_N_m
        size = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
        yield f"bearing drag subtracted: {size} N m, measured on the idle pulley"


def _notes_of(run: RunReduction) -> str | None:
    """Return the notes of a run for the user, as one text."""
    notes = [*_drag_taken_off(run), *([TOUCHING] if run.arc_deg >= TOUCH_DEG else [])]
    notes += run.notes
    if run.mu_sticking_reason:
        notes.append(f"no mu_sticking: {run.mu_sticking_reason}")
    return "; ".join(notes) or None


def _warnings(runs: Sequence[RunReduction], kind: RigKind, *, held: bool) -> Iterator[str]:
    """Yield warnings about common mistakes on a rig of this kind, where the runs suggest them."""
    good = [run for run in runs if run.ok]
    if not all(run.converged for run in good):
        yield "the search for the noise of the bench did not end: the standard errors may be wrong"
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
    if shares := [abs(run.held) for run in good if abs(run.held) > HELD]:
        yield (
            f"at rest the spans differ by {percent(100 * float(np.median(shares)))} of the initial "
            f"tension (median of {counted(len(shares), 'run')} of {len(good)}): "
            "friction held in the belt, or gains of the cells that differ by as much; neither is "
            "corrected. Turn the pulley back and forth before the rest and state "
            "friction.free_at_rest: true, or add a few runs in the other direction; state what the "
            "gains may be off as uncertainty.cell_gain_rel"
        )
    if touching := [run.run for run in good if run.arc_deg >= TOUCH_DEG]:
        yield f"{TOUCHING} ({listed(touching)})"
    if any(run.side == "back" for run in good):
        yield (
            "measured on the back of the belt: surface and contact stiffness of one side do not "
            "hold for the other"
        )
    if good and not any(np.isfinite(run.mu_sliding_se) for run in good):
        yield (
            "no standard error is known: state mu_se in the table, or the resolution of the forces "
            "as rig.force_resolution_N"
        )


def _notes(runs: Sequence[RunReduction]) -> Iterator[str]:
    """Yield notes on events in several runs, with the number of runs."""
    yield from dict.fromkeys(line for run in runs for line in _drag_taken_off(run))
    for text, counts in (
        ("spikes left out", [run.n_spikes for run in runs]),
        ("samples missing", [run.n_missing for run in runs]),
    ):
        if hit := sum(count > 0 for count in counts):
            yield f"{sum(counts)} {text}, in {counted(hit, 'run')}"
    if swapped := [run.run for run in runs if run.swapped]:
        yield f"tight and slack cell were swapped in {listed(swapped)}; corrected"
    if unresolved := sum(run.ok and bool(run.mu_sticking_reason) for run in runs):
        why = "the records do not resolve the peak"
        yield f"no mu_sticking for {counted(unresolved, 'run')}: {why}"
    if faint := [run.run for run in runs if run.ok and run.mu_sliding_se > FAINT * run.mu_sliding]:
        yield (
            f"standard error of mu above {percent(100 * FAINT)} in {listed(faint)}: readings near "
            "their resolution or noise, which carry little weight"
        )
