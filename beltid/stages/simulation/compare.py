"""beltid compare: compare measured with simulated friction coefficients (paper section 4).

The simulated recording passes the same function that reduced the measured one, with the settings
stored in the friction artifact. Only the load cells differ: those of the simulated rig are perfect,
those of a second bench are as the config states.

With runs held out there is no recording: the surface is refined from the other runs, and the runs
left out are predicted (:mod:`beltid.stages.simulation.hold_out`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import Artifact, may_be_artifact, read_artifact
from beltid.artifacts.metadata_models import CompareMetadata
from beltid.bench.recording import read_recording
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import (
    EXIT_DONE,
    EXIT_OUT_OF_TOLERANCE,
    ArtifactError,
    InputError,
    counted,
)
from beltid.identify.agreement.compare import (
    AgreementResult,
    Statistics,
    compare_points,
)
from beltid.identify.agreement.hold_out import FEWEST, HoldOut
from beltid.laws.penalty import NormalLaw
from beltid.report.summary import Summary, rows_of
from beltid.stages.build_artifact import Build, Built, reading
from beltid.stages.identification.reduction import (
    recording_in_memory,
    reduce_rig,
    reduction_columns,
    rig_kind,
)
from beltid.stages.outcome import Outcome, span
from beltid.stages.reporter import Options
from beltid.stages.simulation.hold_out import (
    HELD_OUT,
    as_simulated,
    beyond_range,
    knows_arcs,
    predictions,
)
from beltid.stages.simulation.planned_runs import with_tensions
from beltid.stages.simulation.refinement import USES as REFINEMENT_USES
from beltid.stages.tables import press_law, table_columns
from beltid.stages.uncertainties import budget_details
from beltid.stages.workers import Workers
from beltid.uncertainty.agreement import dominant, validated, within_words
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.simulated import RunsUncertainty, runs_uncertainty_of

KIND: Final = "compare"
USES: Final = ("compare", "friction", "rig", "belt", *reading("rig"))
NEEDED: Final = (
    "run",
    "arc_deg",
    "nominal_tension_N",
    "pulley_speed_rad_s",
    "normal_force_N_m",
    "mu_sliding",
)
ENOUGH: Final = 0.8
"""Share of the usable measured runs below which a comparison is one of few runs."""
MIN_SHARE_COMPARED: Final = 0.5
"""Share of compared runs below which the campaign fails: too few to judge it."""
ROW: Final = (
    "run",
    "arc_deg",
    "nominal_tension_N",
    "pulley_speed_rad_s",
    "normal_force_N_m",
    "mu_measured",
    "mu_simulated",
    "difference",
    "relative_difference",
    "u_measured",
    "u_input",
    "u_numerical",
    "u_validation",
    "e_over_u",
    "within_tolerance",
)
HIDDEN: Final = ROW[7:13]
"""Columns that are in the file but not shown."""
TITLES: Final = {
    "none": "simulated less measured friction coefficient, relative to measured",
    "arc": "friction of each arc predicted from the other arcs, less measured, relative to it",
    "speed": "friction of each speed predicted from the others, less measured, relative to it",
}
TOLERANCES: Final = {
    "max_rms_relative_error": "rms",
    "max_mean_relative_error": "mean magnitude",
    "max_relative_error": "largest",
    "min_share_compared": "runs compared",
}


def run(
    config: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    options: Options,
    *,
    hold_out: str | None = None,
) -> Summary:
    """Compare ``friction`` with the ``simulated`` recording, write the result, summarise it.

    With ``stiffness`` instead of ``simulated`` the runs of each arc or speed are predicted from the
    others; `hold_out`, or else the config, selects arc or speed.
    """
    if "stiffness" in inputs:
        by = _checked_hold_out(hold_out or config.config.compare.hold_out)
        return _run_held_out(config, inputs, out, options, by)
    path = inputs["simulated"]
    role = "simulated" if may_be_artifact(path) else "recording"
    given = {"friction": inputs["friction"], role: path}
    build = Build(KIND, config, USES, given, out, options)
    built = build.up_to_date()
    if built is None:
        friction = read_artifact(inputs["friction"], "friction")
        recording = read_recording(path, "rig", config.config)
        options.reporter.report(f"{recording.path}: {recording.n_samples} samples")
        reduced = reduce_rig(recording, _as_measured(friction, config.config))
        notes: tuple[str, ...] = ()
        uncertainty = None
        if recording.is_artifact:
            with suppress(ArtifactError):  # a compressed recording is not readable as an artifact
                metadata = read_artifact(recording.path, "simulated").metadata
                uncertainty = runs_uncertainty_of(metadata.figures)
        elif cells := rig_kind(config.config).cells.note:  # a second bench, as the config states
            # name without folder, so that the same input gives the same bytes anywhere
            notes = (f"{recording.path.name}: {cells}",)
        simulated = reduction_columns(reduced)
        built = build.write(
            _outcome(friction.columns, simulated, config.config, uncertainty, notes)
        )
    return summarise(built)


def _run_held_out(
    config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options, by: HoldOut
) -> Summary:
    """Predict the runs of ``friction`` with ``stiffness``, and compare them with measured ones."""
    uses = ("compare", *REFINEMENT_USES)
    build = Build(KIND, config, uses, inputs, out, options, {"hold_out": by})
    built = build.up_to_date()
    if built is None:
        friction = read_artifact(inputs["friction"], "friction")
        press = press_law(inputs["stiffness"], config.config)
        options.reporter.report(f"{friction.path}: every {by} left out once and predicted")
        built = build.write(_held_out(friction.columns, press, config.config, by, options.workers))
    return summarise(built)


def predict_held_out(
    friction: Any,
    law: NormalLaw | Outcome[Any],
    config: Config | Mapping[str, Any] | str | Path | None = None,
    *,
    hold_out: HoldOut = "arc",
) -> Outcome[AgreementResult]:
    """Predict the runs of every arc or speed from the others, and compare with the measured ones.

    Parameters
    ----------
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping
        The reduced runs of the bench.
    law : NormalLaw or Outcome of fit_stiffness
        Normal contact law of the belt; a result also provides its scatter.
    config : Config, dict, path or None
        Belt, rig and tolerances.
    hold_out : {"arc", "speed"}
        Setting that is left out in turn. The lowest and the highest speed are never left out.

    Returns
    -------
    Outcome
        Like that of `compare`, with a row per predicted run.

    Raises
    ------
    TooFewSettings
        If too few settings or runs would be left.
    ConvergenceError
        If a surface does not converge, or a run cannot be simulated.
    """
    by = _checked_hold_out(hold_out)
    model = load_config(config)
    columns = table_columns(friction, "friction", HELD_OUT)
    press = press_law(law, model)
    return _held_out(columns, press, model, by, Workers()).with_origin(model, friction, law)


def _checked_hold_out(hold_out: str) -> HoldOut:
    if hold_out not in FEWEST:
        raise InputError(f"hold_out = {hold_out}, must be {' or '.join(FEWEST)}")
    return hold_out


def _held_out(
    columns: Mapping[str, np.ndarray],
    press: PressLaw,
    config: Config,
    by: HoldOut,
    workers: Workers,
) -> Outcome[AgreementResult]:
    columns = with_tensions(columns, config)
    predicted_folds = predictions(columns, press, config, by, workers)
    rows = np.concatenate([prediction.fold.left_out for prediction in predicted_folds])
    measured = {name: values[rows] for name, values in columns.items()}
    predicted, uncertainty = as_simulated(columns, predicted_folds)
    beyond = beyond_range(columns, predicted_folds)
    notes = [
        f"each {by} was left out once: its runs were predicted by a surface refined from the rest"
    ]
    if by == "speed":
        notes.append("predicted between speeds: the lowest and the highest were never left out")
    if beyond:
        notes.append(
            f"{beyond} of {rows.size} predicted runs have a mean force that no other run reached: "
            "the nearest value was used there"
        )
    if by == "arc" and not knows_arcs(predicted_folds):
        notes.append(
            "a single arc was left, which does not show how much arcs differ: such a difference is "
            "not included in the uncertainty of the prediction"
        )
    outcome = _outcome(measured, predicted, config, uncertainty, tuple(notes))
    relative, force = outcome.result.relative_difference, outcome.result.normal_force_N_m
    ends = np.cumsum([prediction.fold.left_out.size for prediction in predicted_folds])[:-1]
    parts = zip(predicted_folds, np.split(relative, ends), np.split(force, ends), strict=True)
    groups = [Statistics.of(part.fold.name, *values).as_row() for part, *values in parts]
    statistics = [*outcome.extra["statistics"], *(groups if by == "speed" else [])]
    return replace(
        outcome,
        extra={**outcome.extra, "statistics": statistics, "hold_out": by},
        warnings=(*outcome.warnings, *(line for p in predicted_folds for line in p.warnings)),
    )


def compare(
    friction: Any,
    simulated: Any,
    config: Config | Mapping[str, Any] | str | Path | None = None,
) -> Outcome[AgreementResult]:
    """Compare measured with simulated friction coefficients, run by run.

    Parameters
    ----------
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping
        The reduced runs of the bench.
    simulated : DataFrame, pyarrow Table or mapping
        A simulated recording with the columns of rig.csv from perfect load cells; or reduced runs
        like `friction` (for a second bench, reduce its recording with `fit_friction`); or the table
        of `simulate_campaign`.
    config : Config, dict, path or None
        Tolerances, and for a recording the settings of its reduction.

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per matched point; ``.result`` has ``passed`` and the statistics
        per arc, averaged, and for low, middle and high force. The comparison also fails if fewer
        than half of the usable measured runs have a partner.

    Raises
    ------
    InputError
        If a table lacks columns, or no run of one has a partner in the other.
    """
    model = load_config(config)
    measured = table_columns(friction, "friction", NEEDED, "friction")
    outcome = _outcome(measured, _simulated_columns(simulated, model), model)
    # a simulation given as a plain table takes the origin of the measured runs
    origin_source = simulated if isinstance(simulated, Outcome) else None
    return outcome.with_origin(model, friction, origin_source)


def _simulated_columns(simulated: Any, config: Config) -> dict[str, np.ndarray]:
    if isinstance(simulated, Outcome) and simulated.kind != "simulated":
        return table_columns(simulated, "friction", NEEDED, "simulated")
    frame = simulated.columns if isinstance(simulated, Outcome) else simulated
    named = getattr(frame, "column_names", getattr(frame, "columns", frame))
    names = {str(name) for name in named} if isinstance(named, Iterable) else set()
    if "time_s" in names:
        recording = recording_in_memory(frame, None, simulated=True)
        return reduction_columns(reduce_rig(recording, config))
    if "mu" in names and "mu_sliding" not in names:  # the table of a simulated campaign
        frame = {
            **{name: np.asarray(frame[name]) for name in names},
            "mu_sliding": np.asarray(frame["mu"]),
            "nominal_tension_N": np.asarray(frame["initial_tension_N"]),
        }
    return table_columns(frame, "friction", NEEDED, "simulated")


def _as_measured(friction: Artifact, config: Config) -> Config:
    """Return the config with the radius of the measured runs."""
    radius = friction.metadata.settings["rig"]["pulley_radius_m"]
    rig = config.rig.model_copy(update={"pulley_radius_m": float(radius)})
    return config.model_copy(update={"rig": rig})


def _outcome(
    measured: Mapping[str, np.ndarray],
    simulated: Mapping[str, np.ndarray],
    config: Config,
    uncertainty: RunsUncertainty | None = None,
    notes: tuple[str, ...] = (),
) -> Outcome[AgreementResult]:
    section = config.compare
    measured, simulated = with_tensions(measured, config), with_tensions(simulated, config)
    tolerances = {
        "max_rms_relative_error": section.max_rms_relative_error,
        "max_mean_relative_error": section.max_mean_relative_error,
        "max_relative_error": section.max_relative_error,
        "min_share_compared": MIN_SHARE_COMPARED,
    }
    plain = compare_points(measured, simulated, tolerances)
    proven = validated(plain, measured, simulated, uncertainty)
    result = proven.result
    columns = {**result.to_columns(), **proven.columns()}
    columns["status"] = np.full(len(columns["run"]), "ok", dtype=object)
    warnings = [
        f"{counted(count, 'run')} not compared: {why}" for why, count in result.not_compared.items()
    ]
    if result.share_compared < ENOUGH:
        warnings.insert(
            0,
            f"only {len(columns['run'])} of {result.n_usable} measured runs were compared: "
            "the verdict holds for these only",
        )
    return Outcome(
        kind=KIND,
        columns=columns,
        result=result,
        validity={"normal_force_N_m": span(result.normal_force_N_m)},
        set_aside=[{"run": run, "why": why} for run, why in result.not_compared_runs],
        extra={
            "passed": result.passed,
            "statistics": [group.as_row() for group in result.groups],
            "judged": result.verdict_table(),
            "averaged": rows_of(result.averaged, *result.averaged),
            "n_measured": result.n_measured,
            "n_simulated": result.n_simulated,
            "hold_out": "none",
            **proven.extra(),
        },
        notes=(*notes, *proven.notes()),
        warnings=tuple(warnings),
    )


def summarise(built: Built) -> Summary:
    """Summarise a compare artifact; its exit status is the verdict."""
    metadata: CompareMetadata = built.artifact.metadata
    passed = bool(metadata.passed)
    statistics = [
        {
            "group": row["group"],
            "runs": row["n_points"],
            "rms_percent": row["rms_percent"],
            "mean_percent": row["mean_percent"],
            "largest_percent": row["largest_percent"],
            "from_force_N_m": row["force_low_N_m"],
            "to_force_N_m": row["force_high_N_m"],
        }
        for row in metadata.statistics
    ]
    return built.summary(
        "compare",
        TITLES[metadata.hold_out],
        facts={
            "hold_out": metadata.hold_out,
            "runs_compared": len(built.artifact.columns["run"]),
            "runs_measured": metadata.n_measured,
            "runs_simulated": metadata.n_simulated,
            "groups": metadata.statistics,
            "judged": metadata.judged,
            "within_two_u_validation": within_words(metadata.validation),
            "rms_over_u_validation": metadata.validation.get("rms_e_over_u"),
            "u_validation_mostly_from": dominant(metadata.budget),
            "budget": metadata.budget,
        },
        details=budget_details(metadata.budget),
        table=rows_of(built.artifact.columns, *ROW),
        shown=tuple(name for name in ROW if name not in HIDDEN),
        overview=statistics,
        verdict=_verdict(passed, metadata.judged),
        exit_status=EXIT_DONE if passed else EXIT_OUT_OF_TOLERANCE,
    )


def _verdict(passed: bool, judged: Sequence[Mapping[str, Any]]) -> str:
    def in_words(row: Mapping[str, Any]) -> str:
        name = row["tolerance"]
        label = TOLERANCES.get(name, name)
        found = float("nan") if row["found"] is None else 100.0 * row["found"]
        if name == "min_share_compared":
            return f"{label} {found:.0f} % < {100.0 * row['allowed']:g} %"
        sign = "<=" if row["holds"] else ">"
        return f"{label} {found:.2f} % {sign} {100.0 * row['allowed']:g} %"

    shown = [row for row in judged if row["tolerance"] != "min_share_compared" or not row["holds"]]
    return f"{'PASS' if passed else 'FAIL'}: " + ", ".join(in_words(row) for row in shown)
