"""beltid fit-stiffness: press recording -> normal contact law (paper Eqs. 1 to 4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.metadata_models import StiffnessMetadata
from beltid.bench.recording import columns_of, read_recording
from beltid.config import Config, ConfigSource, load_config
from beltid.identify.press.recording import StiffnessSettings
from beltid.identify.press.stiffness import LawEstimate, StiffnessResult
from beltid.identify.press.stiffness import fit_stiffness as identify
from beltid.report.summary import Summary, rows_of
from beltid.stages.build_artifact import Build, Built, reading
from beltid.stages.identification.alternatives import normal_laws
from beltid.stages.outcome import Outcome
from beltid.stages.reporter import Options
from beltid.stages.uncertainties import SECTION, budget_details, standard_uncertainties
from beltid.uncertainty.reduced import stiffness_uncertainty

KIND: Final = "stiffness"
USES: Final = ("press", *reading("press"), SECTION)
POOLED: Final = "pooled"
COEFFICIENTS: Final = (
    "k_linear_N_m2",
    "k_linear_se_N_m2",
    "k_linear_u_N_m2",
    "k_quadratic_N_m3",
    "k_quadratic_se_N_m3",
    "k_quadratic_u_N_m3",
)
"""Coefficients of the law, each with its standard error and its combined uncertainty."""


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Read a press recording (input ``press``), identify the law, write it, summarise it."""
    build = Build(KIND, config, USES, inputs, out, options)
    built = build.up_to_date()
    if built is None:
        recording = read_recording(inputs["press"], "press", config.config)
        options.reporter.report(f"{recording.path}: {recording.n_samples} samples")
        built = build.write(_outcome(recording.columns, config.config, recording.notes))
    return summarise(built)


def fit_stiffness(
    frame: Any, config: Config | Mapping[str, Any] | str | Path | None = None
) -> Outcome[StiffnessResult]:
    """Identify the normal contact law, Eq. (3), from a press recording.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        Columns ``test``, ``temperature_degC`` (optional), ``time_s``, ``displacement_mm``,
        ``force_N``.
    config : Config, dict, path or None
        Segment length, machine compliance, choice of cycles; None is the built-in 5PK rig.

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per temperature and a pooled row; ``.result.pooled.law`` is the
        `NormalLaw`.

    Raises
    ------
    InputError
        If the recording cannot be used.
    FitError
        If no law with coefficients >= 0 fits.
    """
    model = load_config(config)
    return _outcome(columns_of(frame, "press", model), model, ()).with_origin(model, frame)


def _outcome(
    columns: Mapping[str, np.ndarray], config: Config, notes: tuple[str, ...]
) -> Outcome[StiffnessResult]:
    settings = StiffnessSettings(**config.press.si())
    result = identify(columns, settings)
    alternatives = normal_laws(result)
    laws = (*result.laws, result.pooled)
    uncertainty, budget = stiffness_uncertainty(
        laws, standard_uncertainties(config), settings.segment_length_m
    )
    return Outcome(
        kind=KIND,
        columns={**_columns(laws), **uncertainty},
        result=result,
        validity={
            "penetration_m": (0.0, result.pooled.max_penetration_m),
            "force_N_m": (0.0, result.pooled.max_force_N_m),
        },
        set_aside=[{"test": test, "why": why} for test, why in result.recording.set_aside],
        extra={
            "temperature": asdict(result.temperature),
            "n_effective": result.pooled.n_effective,
            "budget": budget,
            "n_missing": result.recording.n_missing,
            "n_spikes": result.recording.n_spikes,
            **alternatives.extra,
        },
        notes=(*notes, *result.notes, *alternatives.notes),
        warnings=(
            *(f"test {test} set aside: {why}" for test, why in result.recording.set_aside),
            *result.pooled.warnings,
        ),
    )


def _columns(laws: tuple[LawEstimate, ...]) -> dict[str, np.ndarray]:
    plain = (
        "k_linear_N_m2",
        "k_quadratic_N_m3",
        "k_linear_se_N_m2",
        "k_quadratic_se_N_m3",
        "covariance",
        "contact_offset_mm",
        "rms_residual_N_m",
        "hysteresis_ratio",
        "max_penetration_m",
        "max_force_N_m",
        "n_samples",
        "n_cycles",
    )
    temperatures = [
        np.nan if law.temperature_degC is None else law.temperature_degC for law in laws
    ]
    return {
        "temperature_degC": np.array(temperatures, dtype=float),
        **{name: np.array([getattr(law, name) for law in laws]) for name in plain},
        "notes": np.array(
            ["; ".join((*law.notes, *law.warnings)) or None for law in laws], dtype=object
        ),
    }


def summarise(built: Built) -> Summary:
    """Summarise a stiffness artifact."""
    artifact = built.artifact
    rows = rows_of(
        artifact.columns,
        "temperature_degC",
        *COEFFICIENTS,
        "contact_offset_mm",
        "rms_residual_N_m",
        "hysteresis_ratio",
        "max_penetration_m",
        "max_force_N_m",
        "n_samples",
    )
    pooled = next(row for row in rows if row["temperature_degC"] is None)
    shown = ("k_linear_N_m2", "k_quadratic_N_m3", "hysteresis_ratio", "max_force_N_m")
    overview = [
        {
            "temperature_degC": POOLED if row is pooled else row["temperature_degC"],
            **{name: row[name] for name in shown},
        }
        for row in rows
    ]
    metadata: StiffnessMetadata = artifact.metadata
    choice, loss = metadata.law_choice, metadata.dissipation
    return built.summary(
        "fit-stiffness",
        "normal contact law, force = k_linear * penetration + k_quadratic * penetration²",
        facts={
            **{name: pooled[name] for name in COEFFICIENTS},
            "temperature_matters": metadata.temperature.get("matters"),
            "quadratic_law_supported": choice and choice.get("quadratic_supported"),
            "damping_at_press_speed_N_s_m": loss and loss.get("C_P_N_s_m"),
            "budget": metadata.budget,
        },
        table=rows,
        shown=tuple(name for name in pooled if name != "max_penetration_m"),
        overview=overview,
        details=budget_details(metadata.budget),
    )
