"""beltid fit-friction: rig recording -> a friction coefficient per run (paper Eqs. 5 to 8)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.recording import columns_of, read_recording
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import InputError, counted, percent
from beltid.identify.estimators.statistics import snap_to_settings
from beltid.identify.friction.kinds import TOUCH_DEG, RigKind, other
from beltid.identify.friction.reduction import RunReduction
from beltid.report.summary import Summary, rows_of
from beltid.stages.build_artifact import Build, Built, reading
from beltid.stages.identification.plausible import refuse_implausible
from beltid.stages.identification.reduction import (
    TOUCHING,
    FrictionTable,
    recording_in_memory,
    reduce_points,
    reduce_rig,
    rig_kind,
    taken_off,
    with_conditions,
)
from beltid.stages.outcome import Outcome, listed, rows_per_setting, span
from beltid.stages.reporter import Options
from beltid.stages.uncertainties import (
    SECTION,
    budget_details,
    standard_uncertainties,
)
from beltid.uncertainty.sources import StandardUncertainties

KIND: Final = "friction"
USES: Final = ("friction", "rig", "belt", "conditions", SECTION)
HELD: Final = 0.005
"""Difference of the spans at rest over the initial tension above which a warning names it [-]."""
FAINT: Final = 0.1  # standard error over mu above which a run carries little weight
CONSTANT: Final = 0.03
"""Relative change of the sum of tensions up to which a hub force counts as constant [-]."""


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Reduce a recording (input ``rig``) or a table of plateaus (``points``), write, summarise."""
    model = config.config
    (role, path), *_ = inputs.items()
    build = Build(KIND, config, (*USES, *reading(role)), inputs, out, options)
    built = build.up_to_date()
    if built is None:
        recording = read_recording(path, role, model)
        if role == "points":
            try:
                runs = reduce_points(recording.columns, model)
            except InputError as error:
                raise InputError(error.at(str(path))) from None
        else:
            runs = reduce_rig(recording, model)
        what = "rows" if role == "points" else "samples"
        options.reporter.report(f"{path}: {recording.n_samples} {what}")
        built = build.write(_outcome(runs, model, str(path), recording.notes))
    return summarise(built)


def fit_friction(
    frame: Any,
    config: Config | Mapping[str, Any] | str | Path | None = None,
    *,
    table: bool = False,
) -> Outcome[tuple[RunReduction, ...]]:
    """Reduce every run of a recording of the friction rig to its friction coefficient, Eq. (6).

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The columns of rig.csv, with the channels of the kind of the rig.
    config : Config, dict, path or None
        Kind of the rig, radius of the pulley, conditions; None is the built-in 5PK rig.
    table : bool
        Whether the frame has a row per plateau instead of samples over time.

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per run; ``status`` gives the reason if a run cannot be used.

    Raises
    ------
    InputError
        If the recording cannot be used, or none of its runs.
    """
    model = load_config(config)
    if table:
        runs = reduce_points(columns_of(frame, "points", model), model)
    else:
        runs = reduce_rig(recording_in_memory(frame, model), model)
    return _outcome(runs, model, "frame", ()).with_origin(model, frame)


def _outcome(
    runs: tuple[RunReduction, ...],
    config: Config,
    name: str,
    notes: tuple[str, ...],
) -> Outcome[tuple[RunReduction, ...]]:
    try:
        refuse_implausible(runs, config, rig_kind(config))
    except InputError as error:
        raise InputError(error.at(name)) from None
    runs = with_conditions(runs, config)
    direct = not any(np.isfinite(run.tension_tight_N) for run in runs if run.ok)
    # coefficients stated in a table do not depend on the calibration of a rig
    uncertainty = StandardUncertainties() if direct else standard_uncertainties(config)
    radius_m = config.rig.pulley_radius_m
    table = FrictionTable.of(runs, uncertainty, radius_m, name, rig_kind(config))
    good = table.columns["status"] == "ok"
    aside = [(r.run, r.status) for r in table.runs if not r.ok]
    ranges = {
        column: span(table.columns[column][good])
        for column in ("normal_force_N_m", "slip_speed_m_s", "mu_sliding", "arc_deg")
    }
    return Outcome(
        kind=KIND,
        columns=table.columns,
        result=table.runs,
        validity=ranges,
        set_aside=[{"run": run, "why": why} for run, why in aside],
        extra={"budget": table.budget},
        notes=(*notes, *_notes(table.runs)),
        warnings=(
            *_warnings(table.runs, rig_kind(config), held=config.rig.slide == "held"),
            *(f"run {run} set aside: {why}" for run, why in aside),
        ),
    )


def _warnings(runs: Sequence[RunReduction], kind: RigKind, *, held: bool) -> Iterator[str]:
    """Yield warnings about common mistakes on a rig of this kind, where the runs suggest them."""
    good = [run for run in runs if run.ok]
    derived = any(np.isfinite(run.tension_tight_N) for run in good)
    if kind.has_torque and derived and not any(run.treatment.drag_N_m for run in good):
        yield (
            "the torque includes the drag of the bearings, which raises mu: record a run of the "
            "pulley without the belt and mark it with a column idle: true"
        )
    if any(run.treatment.other_span for run in good):
        span = other(kind.torque_with)
        yield (
            f"the tension measured with the torque is that of the {span} span: state "
            f"rig.torque_with: {span}, which the plan and the simulated rig use"
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
                "state rig.slide: held"
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
    lines = list(dict.fromkeys(line for r in reduced for line in taken_off(r.treatment)))
    if spikes:
        lines.append(
            f"{sum(r.n_spikes for r in spikes)} spikes left out, in {counted(len(spikes), 'run')}"
        )
    if marked := [r for r in reduced if r.treatment.n_marks]:
        lines.append(
            f"{sum(r.treatment.n_marks for r in marked)} samples of the pulley's speed left out, "
            f"far off all others, in {counted(len(marked), 'run')}"
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


def summarise(built: Built) -> Summary:
    """Summarise a friction artifact."""
    columns = built.artifact.columns
    good = columns["status"] == "ok"
    n_aside = int(np.count_nonzero(~good))
    validity = built.artifact.metadata.validity
    return built.summary(
        "fit-friction",
        "friction coefficient of every run",
        facts={
            "runs": len(good),
            "runs_set_aside": n_aside,
            "mu_sliding_range": validity.get("mu_sliding"),
            "normal_force_range_N_m": validity.get("normal_force_N_m"),
            "slip_speed_range_m_s": validity.get("slip_speed_m_s"),
            "budget": built.artifact.metadata.budget,
        },
        details=budget_details(built.artifact.metadata.budget),
        table=rows_of(
            columns,
            "run",
            "arc_deg",
            "nominal_tension_N",
            "initial_tension_N",
            "pulley_speed_rad_s",
            "slip_speed_m_s",
            "tension_tight_N",
            "tension_slack_N",
            "normal_force_N_m",
            "mu_sliding",
            "mu_sliding_se",
            "mu_sliding_u",
            "mu_sticking",
            "status",
        ),
        shown=(
            "run",
            "arc_deg",
            "nominal_tension_N",
            "pulley_speed_rad_s",
            "normal_force_N_m",
            "mu_sliding",
            "mu_sliding_se",
            "mu_sticking",
            "status",
        ),
        overview=rows_per_setting(
            columns["arc_deg"][good],
            snap_to_settings(columns["pulley_speed_rad_s"])[good],
            columns["normal_force_N_m"][good],
            columns["mu_sliding"][good],
        ),
    )
