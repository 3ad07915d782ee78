"""beltid compare: measured against simulated friction coefficients (paper section 7).

The simulated recording goes through the very function that reduced the measured one, with the
settings that the friction artifact says it was reduced with. Only the load cells are its own: those
of the simulated rig are perfect, those of a second bench are as the config states them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.artifacts.metadata_models import CompareMetadata
from beltid.bench.recording import columns_of, read_recording
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import EXIT_DONE, EXIT_OUT_OF_TOLERANCE, ArtifactError, ConfigError
from beltid.identify.agreement.compare import AgreementResult, AgreementSettings, compare_points
from beltid.identify.friction.reduction import FrictionSettings, reduce_runs
from beltid.report.summary import Summary
from beltid.stages.build_artifact import SUFFIX, Build, Built
from beltid.stages.outcome import Outcome, rows_of
from beltid.stages.reduction import (
    CELL_KEYS,
    cell_settings,
    friction_settings,
    reduce_simulated,
    reduction_columns,
    rig_kind,
)
from beltid.stages.reporter import Options
from beltid.stages.tables import table_columns
from beltid.stages.uncertainties import budget_details
from beltid.uncertainty.agreement import dominant, validated, within_words
from beltid.uncertainty.simulated import RunsUncertainty, runs_uncertainty_of

KIND: Final = "compare"
FIGURES: Final = (
    "passed",
    "statistics",
    "n_measured",
    "n_simulated",
    "judged",
    "validation",
    "budget",
)
KEYS: Final = (
    "compare",
    "rig.kind",
    "rig.weight_on",
    "columns.rig",
    "units.rig",
    "runs.rig",
    "dialect",
    *CELL_KEYS,
)
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
"""Share below which it says nothing about the campaign: out of tolerance."""
TOLERANCES: Final = {
    "max_rms_relative_error": "rms",
    "max_mean_relative_error": "mean magnitude",
    "max_relative_error": "largest",
    "min_share_compared": "runs compared",
    "max_rms_error_over_uncertainty": "RMS over its uncertainty",
}


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Reduce the ``simulated`` recording, compare it with ``friction``, write it, sum it up."""
    build = Build(KIND, config, KEYS, inputs, out, options, figures=FIGURES)
    built = build.up_to_date()
    if built is None:
        friction = read_artifact(inputs["friction"], "friction")
        recording = read_recording(inputs["simulated"], "rig", config.config)
        options.reporter.report(f"{recording.path}: {recording.n_samples} samples")
        radius, settings = _reduced_with(friction, config.config)
        if recording.is_artifact:
            reduced = reduce_simulated(recording.columns, radius, settings, config.config)
        else:  # a second bench, whose kind and cells the config knows
            settings = replace(settings, **cell_settings(config.config))
            kind = rig_kind(config.config)
            reduced = reduce_runs(recording.columns, radius, settings, kind)
        simulated = reduction_columns(reduced)
        known, uncertainty = settings.cells.note, _uncertainty_of(inputs["simulated"])
        notes = (f"{recording.path}: {known} ({config.origin})",) if known else ()
        built = build.write(
            _outcome(friction.columns, simulated, config.config, uncertainty, notes)
        )
    return summarise(built)


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
        A simulated recording with the columns of rig.csv, of perfect load cells; or reduced runs,
        like `friction` (those of a second bench: reduce its recording by `fit_friction`); or the
        table of `simulate_campaign`.
    config : Config, dict, path or None
        Tolerances, and for a recording the settings of its reduction.

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per matched point; ``.result`` tells ``passed`` and the
        statistics per arc, averaged, and for low, middle and high force. It is not passed,
        either, if fewer than half of the usable measured runs have a partner.

    Raises
    ------
    InputError
        If a table lacks columns, or no run of one has a partner in the other.
    """
    model = load_config(config)
    measured = table_columns(friction, "friction", NEEDED)
    return _outcome(measured, _simulated_columns(simulated, model), model)


def _simulated_columns(simulated: Any, config: Config) -> dict[str, np.ndarray]:
    if isinstance(simulated, Outcome) and simulated.kind == "friction":
        return simulated.columns
    frame = simulated.columns if isinstance(simulated, Outcome) else simulated
    names = {str(name) for name in getattr(frame, "column_names", getattr(frame, "columns", frame))}
    if "time_s" in names:
        settings = friction_settings(config, with_cells=False)
        recorded = columns_of(frame, "rig")
        reduced = reduce_simulated(recorded, config.rig.pulley_radius_m, settings, config)
        return reduction_columns(reduced)
    if "mu" in names and "mu_sliding" not in names:  # the table of a simulated campaign
        frame = {
            **{name: np.asarray(frame[name]) for name in names},
            "mu_sliding": np.asarray(frame["mu"]),
            "nominal_tension_N": np.asarray(frame["initial_tension_N"]),
        }
    return table_columns(frame, "friction", NEEDED)


def _reduced_with(friction: Artifact, config: Config) -> tuple[float, FrictionSettings]:
    """Radius and settings with which the measured runs were reduced, but for their load cells."""
    stored = friction.metadata.settings
    radius = stored.get("rig.pulley_radius_m") or config.rig.pulley_radius_m
    known = type(config.friction).model_fields
    section = {key: v for key, v in stored.get("friction", {}).items() if key in known}
    try:
        found = load_config({"friction": section}) if section else config
    except ConfigError as error:
        lines = [f"{friction.path}: its settings: {line}" for line in error.problems]
        raise ArtifactError(lines) from None
    return float(radius), friction_settings(found, with_cells=False)


def _uncertainty_of(path: Path) -> RunsUncertainty | None:
    """What an artifact of simulate-rig tells of its uncertainty; other files tell nothing."""
    if path.suffix.lower() != SUFFIX:
        return None
    try:
        return runs_uncertainty_of(read_artifact(path, "simulated").metadata.figures)
    except ArtifactError:
        return None


def _outcome(
    measured: Mapping[str, np.ndarray],
    simulated: Mapping[str, np.ndarray],
    config: Config,
    uncertainty: RunsUncertainty | None = None,
    notes: tuple[str, ...] = (),
) -> Outcome[AgreementResult]:
    section = config.compare
    plain = compare_points(
        measured,
        simulated,
        AgreementSettings(
            max_rms_relative_error=section.max_rms_relative_error,
            max_mean_relative_error=section.max_mean_relative_error,
            max_relative_error=section.max_relative_error,
            min_share_compared=MIN_SHARE_COMPARED,
            max_rms_error_over_uncertainty=section.max_rms_error_over_uncertainty,
        ),
    )
    proven = validated(plain, measured, simulated, uncertainty)
    result = proven.result
    columns = {**result.to_columns(), **proven.columns()}
    columns["status"] = np.full(len(columns["run"]), "ok", dtype=object)
    few = (
        [
            f"only {len(columns['run'])} of {result.n_usable} measured runs were compared: "
            "the verdict holds for these alone"
        ]
        if result.share_compared < ENOUGH
        else []
    )
    left_out = [f"{count} runs not compared: {why}" for why, count in result.not_compared.items()]
    return Outcome(
        kind=KIND,
        columns=columns,
        result=result,
        validity={
            "normal_force_N_m": (
                float(result.normal_force_N_m.min()),
                float(result.normal_force_N_m.max()),
            )
        },
        set_aside=[{"run": run, "why": why} for run, why in result.not_compared_runs],
        extra={
            "passed": result.passed,
            "statistics": result.statistics_table(),
            "judged": [dict(row) for row in result.verdict_table()],
            "averaged": result.averaged_table(),
            "n_measured": result.n_measured,
            "n_simulated": result.n_simulated,
            **proven.extra(),
        },
        notes=(*notes, *proven.notes()),
        warnings=(*few, *left_out),
    )


def summarise(built: Built) -> Summary:
    """Sum up a compare artifact; its exit status is the verdict."""
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
    return Summary(
        stage="compare",
        title="simulated less measured friction coefficient, relative to measured",
        out=built.artifact.path,
        facts={
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
        table=rows_of(
            built.artifact.columns,
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
        ),
        shown=(
            "run",
            "arc_deg",
            "nominal_tension_N",
            "pulley_speed_rad_s",
            "normal_force_N_m",
            "mu_measured",
            "mu_simulated",
            "e_over_u",
            "within_tolerance",
        ),
        overview=statistics,
        notes=built.notes,
        warnings=built.warnings,
        verdict=_verdict(passed, metadata.judged),
        exit_status=EXIT_DONE if passed else EXIT_OUT_OF_TOLERANCE,
        up_to_date=built.up_to_date,
        origin=built.origin,
    )


def _verdict(passed: bool, judged: Sequence[Mapping[str, Any]]) -> str:
    def in_words(row: Mapping[str, Any]) -> str:
        name = row["tolerance"]
        words = TOLERANCES.get(name, name)
        found = float("nan") if row["found"] is None else 100.0 * row["found"]
        if name == "min_share_compared":
            return f"{words} {found:.0f} % < {100.0 * row['allowed']:g} %"
        sign = "<=" if row["holds"] else ">"
        if name == "max_rms_error_over_uncertainty":
            return f"{words} {found / 100.0:.2f} {sign} {row['allowed']:g}"
        return f"{words} {found:.2f} % {sign} {100.0 * row['allowed']:g} %"

    shown = [row for row in judged if row["tolerance"] != "min_share_compared" or not row["holds"]]
    return f"{'PASS' if passed else 'FAIL'}: " + ", ".join(in_words(row) for row in shown)
