"""beltid fit-friction: rig recording -> a friction coefficient per run (paper Eqs. 5 to 8)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.recording import columns_of, read_recording, read_rig
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import InputError, counted, percent
from beltid.identify.estimators.statistics import as_set
from beltid.identify.friction.drift_check import CAUSES, Drift, drift_check
from beltid.identify.friction.kinds import TOUCH_DEG, RigKind, other
from beltid.identify.friction.reduction import RunReduction
from beltid.report.summary import Summary
from beltid.stages.build_artifact import Build, Built
from beltid.stages.identification.reduction import (
    BINNED,
    TOUCHING,
    FrictionTable,
    reduce_columns,
    reduce_points,
    reduce_rig,
    rig_kind,
    taken_off,
    with_conditions,
)
from beltid.stages.outcome import Outcome, listed, rows_of, rows_per_setting, span
from beltid.stages.reporter import Options
from beltid.stages.uncertainties import (
    SECTION,
    budget_details,
    confounded_note,
    standard_uncertainties,
)
from beltid.uncertainty.sources import StandardUncertainties

KIND: Final = "friction"
FAINT: Final = 0.1  # of mu: a run whose standard error is more says little
DRIFT: Final = (
    "drift of the friction over the campaign, in percent of mu; share of its cause that force, "
    "speed and arc explain"
)
CONSTANT: Final = 0.03
"""Change of a sum of tensions up to which a force on the axis counts as constant [-]."""
RIG_KEYS: Final = (
    "kind",
    "weight_on",
    "torque_with",
    "running_measures",
    "belt_speed_m_s",
    "speed_bins_rad_s",
    "force_resolution_N",
    "pulley_radius_m",
)


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Reduce a recording (input ``rig``) or a table of plateaus (``points``), write and sum up."""
    model = config.config
    (role, path), *_ = inputs.items()
    build = Build(KIND, config, _keys(model, role), inputs, out, options)
    built = build.up_to_date()
    if built is None:
        if role == "points":
            points = read_recording(path, "points", model)
            notes, n_samples = points.notes, points.n_samples
            try:
                runs = reduce_points(points.columns, model)
            except InputError as error:
                raise InputError(error.at(str(path))) from None
        else:
            rig = read_rig(path, model)
            runs = reduce_rig(rig, model, options.workers)
            notes, n_samples = rig.notes, rig.n_samples
        options.reporter.report(f"{path}: {n_samples} {'rows' if role == 'points' else 'samples'}")
        built = build.write(_outcome(runs, model, str(path), notes))
    return summarise(built)


def _keys(config: Config, role: str) -> tuple[str, ...]:
    """What of a config matters for a recording, or for a table of plateaus."""
    rig = tuple(f"rig.{name}" for name in RIG_KEYS)
    of_kind = {
        "running": ("belt.mass_per_length_kg_m",),
        "torque_hub": ("belt.bending_stiffness_N_m2", "rig.span_length_m", "rig.supports"),
    }
    files = tuple(f"{section}.{role}" for section in ("columns", "units", "runs"))
    return (
        "friction",
        *rig,
        *of_kind.get(config.rig.kind, ()),
        "conditions",
        *files,
        "dialect",
        SECTION,
    )


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
        Kind of the rig, radius of the pulley, settings of the reduction, conditions; None is the
        built-in 5PK rig.
    table : bool
        Whether the frame has a row per plateau in place of samples over the time.

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per run; a run that cannot be used says why in ``status``.

    Raises
    ------
    InputError
        If the recording cannot be used, or none of its runs.
    """
    model = load_config(config)
    columns = columns_of(frame, "points" if table else "rig", model)
    runs = reduce_points(columns, model) if table else reduce_columns(columns, model)
    return _outcome(runs, model, "frame", ()).with_origin(model, frame)


def _outcome(
    runs: tuple[RunReduction, ...],
    config: Config,
    name: str,
    notes: tuple[str, ...],
) -> Outcome[tuple[RunReduction, ...]]:
    runs = with_conditions(runs, config)
    direct = not any(np.isfinite(run.tension_tight_N) for run in runs if run.ok)
    # nothing of the calibration of a rig is in coefficients that a table states by itself
    uncertainty = StandardUncertainties() if direct else standard_uncertainties(config)
    radius_m = config.rig.pulley_radius_m
    table = FrictionTable.of(runs, uncertainty, radius_m, name, rig_kind(config))
    good = table.columns["status"] == "ok"
    aside = [(r.run, r.status) for r in table.runs if not r.ok]
    drifts = drift_check(table.columns)
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
        extra={"budget": table.budget, "drift": _drift_rows(drifts)},
        notes=(
            *notes,
            *_notes(table.runs),
            *confounded_note(
                {CAUSES[d.cause][0]: d.explained for d in drifts if d.is_confounded},
                "force, speed and arc",
            ),
        ),
        warnings=(
            *_traps(table.runs, rig_kind(config), held=config.rig.slide == "held"),
            *(_drift_line(drift) for drift in drifts if drift.is_clear),
            *(f"run {run} set aside: {why}" for run, why in aside),
        ),
    )


def _drift_rows(drifts: Sequence[Drift]) -> list[dict[str, Any]]:
    """The check for drift as it is shown and stored, in percent of mu; empty if it tells none."""
    return [
        {
            "cause": CAUSES[drift.cause][0],
            "per": CAUSES[drift.cause][2],
            "change_percent": None if drift.is_confounded else 100.0 * drift.change,
            "standard_error_percent": None if drift.is_confounded else 100.0 * drift.standard_error,
            "clear": drift.is_clear,
            "explained_percent": 100.0 * drift.explained,
        }
        for drift in drifts
    ]


def _drift_line(drift: Drift) -> str:
    """A clear drift in words."""
    words, _, per = CAUSES[drift.cause]
    size = f"{100 * drift.change:+.2g} ± {100 * drift.standard_error:.1g} %"
    mended = {
        "order": "run-in or wear; refine-surface takes it into account",
        "distance": "run-in or wear; refine-surface takes the order of the runs into account",
        "temperature": "friction.correct_temperature: true refers the refined surface to "
        "friction.reference_temperature_degC",
    }[drift.cause]
    return f"the friction drifts with the {words}: {size} per {per} ({mended})"


def _traps(runs: Sequence[RunReduction], kind: RigKind, *, held: bool) -> Iterator[str]:
    """What a bench of this kind easily does wrong, where it may have."""
    good = [run for run in runs if run.ok]
    derived = any(np.isfinite(run.tension_tight_N) for run in good)
    if kind.has_torque and derived and not any(run.treatment.drag_N_m for run in good):
        yield (
            "the torque includes the drag of the bearings, which raises mu: record a run of the "
            "pulley without the belt and mark it by a column idle: true"
        )
    if any(run.treatment.other_span for run in good):
        span = other(kind.torque_with)
        yield (
            f"the tension beside the torque is that of the {span} span: state rig.torque_with: "
            f"{span}, which a plan and the simulated rig go by"
        )
    if kind.measures == "torque_hub" and not kind.running and not held:
        ratio = np.array(
            [(r.tension_tight_N + r.tension_slack_N) / (2.0 * r.initial_tension_N) for r in good]
        )
        grown = float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else 1.0
        if abs(grown - 1.0) > CONSTANT:
            yield (
                f"the tensions sum up to {grown:.3g} times what they were at rest: the pulley does "
                "not give way to a constant force; if its slide is held, by the load cell of the "
                "hub force, say so: rig.slide: held"
            )
    touching = [run.run for run in good if run.arc_deg >= TOUCH_DEG]
    if touching:
        yield f"{TOUCHING} ({listed(touching)})"
    if any(run.conditions.side == "back" for run in good):
        yield (
            "measured on the back of the belt: it shares the units with the ribs, not the laws; "
            "neither surface nor contact stiffness of one side holds for the other"
        )
    if good and not any(np.isfinite(run.mu_sliding_se) for run in good):
        yield (
            "no standard error is known: state mu_se in the table, or the resolution of the forces "
            "as rig.force_resolution_N"
        )
    if any(run.treatment.course for run in good):
        yield f"runs whose speed is not steady were cut into bins of the speed: {BINNED}"


def _notes(reduced: Sequence[RunReduction]) -> tuple[str, ...]:
    """What happened in several runs, each with the number of runs."""
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
            "their resolution or noise, which count for little"
        )
    return tuple(lines)


def summarise(built: Built) -> Summary:
    """Sum up a friction artifact."""
    columns = built.artifact.columns
    good = columns["status"] == "ok"
    n_aside = int(np.count_nonzero(~good))
    validity = built.artifact.metadata.validity
    drift = [dict(row) for row in built.artifact.metadata.drift]
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
            "drift": drift,
        },
        details=budget_details(built.artifact.metadata.budget),
        beside={DRIFT: drift} if drift else {},
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
            as_set(columns["pulley_speed_rad_s"])[good],
            columns["normal_force_N_m"][good],
            columns["mu_sliding"][good],
        ),
    )
