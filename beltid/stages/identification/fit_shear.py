"""beltid fit-shear: tension build-up of the rig's runs -> shear stiffness of the ribs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import read_artifact
from beltid.artifacts.metadata_models import ShearMetadata
from beltid.bench.recording import read_rig
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import InputError
from beltid.identify.friction.rest import against_stated
from beltid.identify.friction.run import RunRecord
from beltid.identify.shear.build_up import build_up
from beltid.identify.shear.stiffness import (
    NORMAL_LAW,
    SHARED,
    SPREADS,
    BenchValues,
    ShearStiffness,
    fit_shear_stiffness,
    not_used,
)
from beltid.laws.penalty import NormalLaw
from beltid.report.summary import Summary, rows_of
from beltid.stages.build_artifact import Build, Built, reading
from beltid.stages.identification.reduction import (
    friction_settings,
    recording_in_memory,
    records_of,
)
from beltid.stages.outcome import Outcome, span, table_columns_of
from beltid.stages.reporter import Options
from beltid.stages.tables import press_law
from beltid.stages.uncertainties import SECTION, budget_details, standard_uncertainties
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.reduced import shear_budget

KIND: Final = "shear"
USES: Final = ("friction", "belt", "rig", "press", *reading("rig"), SECTION)
STATED: Final = tuple(name for name in (*SHARED, "arc_setting") if name not in SPREADS)
"""Uncertainties of the bench that the config states."""
SCATTER_REPORTED: Final = 2.0
"""Scatter of the slopes over their standard errors above which the user is warned."""


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Read a recording of the friction rig (input ``rig``), fit the stiffness, summarise it.

    If ``stiffness`` is among the inputs, the normal law of the ribs is that of the press.
    """
    build = Build(KIND, config, USES, inputs, out, options)
    built = build.up_to_date()
    if built is None:
        model = config.config
        _check_kind(model)
        rig = read_rig(inputs["rig"], model)
        press = press_law(inputs["stiffness"], model) if "stiffness" in inputs else None
        try:
            outcome = _outcome(records_of(rig, model), model, press)
        except InputError as error:
            raise InputError(error.at(str(rig.path))) from None
        options.reporter.report(f"{rig.path}: {rig.n_samples} samples")
        built = build.write(outcome)
    return summarise(built)


def fit_shear(
    frame: Any,
    config: Config | Mapping[str, Any] | str | Path | None = None,
    stiffness: NormalLaw | Outcome[Any] | str | Path | None = None,
) -> Outcome[ShearStiffness]:
    """Find the shear stiffness of the ribs from the build-up of runs of the friction rig.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The columns of rig.csv.
    config : Config, dict, path or None
        Axial and bending stiffness of the belt, radius of the pulley; None is the built-in 5PK rig.
    stiffness : NormalLaw, Outcome of fit_stiffness, or path, optional
        Normal contact law of the ribs; a result or its stiffness.parquet also provides scatter and
        origin. By default the law of a usual ribbed belt, known to 40 %.

    Returns
    -------
    Outcome
        ``.result`` has the stiffness, its uncertainty and interval; ``.to_frame()`` a row per run.

    Raises
    ------
    InputError
        If the recording cannot be used, or all usable runs have the same contact arc.
    FitError
        If the tensions do not build up like those of a sticking elastic belt.
    """
    model = load_config(config)
    _check_kind(model)
    records = records_of(recording_in_memory(frame, model), model)
    law = read_artifact(stiffness, "stiffness") if isinstance(stiffness, (str, Path)) else stiffness
    press = None if law is None else press_law(law, model)
    return _outcome(records, model, press).with_origin(model, frame, law)


def _check_kind(config: Config) -> None:
    """Refuse rigs other than a belt between two fixed ends with a load cell at each."""
    if config.rig.kind != "two_cells":
        raise InputError(
            f"rig.kind = {config.rig.kind}: the shear stiffness needs both span tensions of a belt "
            "between fixed ends, must be two_cells"
        )


def _outcome(
    records: Iterable[RunRecord], config: Config, press: PressLaw | None
) -> Outcome[ShearStiffness]:
    settings, radius = friction_settings(config), config.rig.pulley_radius_m
    runs = [build_up(record, radius, settings) for record in records]
    if config.friction.check_initial_tension:
        measured, stated = np.array([(r.initial_tension_N, r.nominal_tension_N) for r in runs]).T
        problem = against_stated(measured, stated)
        if problem:
            raise InputError(problem)
    uncertainty = standard_uncertainties(config)
    stated = {name: getattr(uncertainty, name) for name in STATED}
    belt, span_m, law, spread = config.belt, config.rig.span_length_m, NORMAL_LAW, None
    tensions = [run.initial_tension_N for run in runs if run.ok]
    if press is not None and tensions:
        line_force = float(np.median(tensions)) / radius
        spread = stated["normal_stiffness"] = press.stiffness_spread(uncertainty, line_force)
        law = press.law.k_linear_N_m2, press.law.k_quadratic_N_m3
    EA, EI = belt.axial_stiffness_N, belt.bending_stiffness_N_m2
    shear = fit_shear_stiffness(runs, BenchValues(EA, EI, radius, span_m, stated, law))
    columns = _columns(shear)
    good = columns["status"] == "ok"
    return Outcome(
        kind=KIND,
        columns=columns,
        result=shear,
        validity={name: span(columns[name][good]) for name in ("arc_deg", "initial_tension_N")},
        set_aside=[{"run": run.run, "why": run.status} for run in shear.runs if not run.ok],
        extra={
            "resolved": shear.resolved,
            "shear_stiffness_N_m2": shear.shear_stiffness_N_m2,
            "shear_stiffness_u_N_m2": shear.shear_stiffness_u_N_m2,
            "shear_stiffness_low_N_m2": shear.low_N_m2,
            "shear_stiffness_high_N_m2": shear.high_N_m2,
            "effective_span_m": shear.effective_span_m,
            "effective_span_u_m": shear.effective_span_u_m,
            "slope_scatter": shear.scatter,
            "budget": shear_budget(shear.shares, uncertainty, spread),
        },
        notes=tuple(not_used(shear.runs)),
        warnings=tuple(_warnings(shear)),
    )


def _warnings(shear: ShearStiffness) -> list[str]:
    lines = []
    if not shear.resolved:
        lines.append(
            "the ribs are too stiff for this recording to resolve their shear: shear stiffness "
            f"above {shear.low_N_m2:.3g} N/m² (95 %), no upper bound; more runs, or arcs that are "
            "shorter or further apart, would narrow it"
        )
    if shear.scatter > SCATTER_REPORTED:
        lines.append(
            f"the slopes deviate from the model by {shear.scatter:.2g} times their standard "
            "errors; the interval accounts for it"
        )
    return lines


def _columns(shear: ShearStiffness) -> dict[str, np.ndarray]:
    """Return the columns of the shear table, with a row per run."""

    def values_of(name: str) -> Sequence[Any]:
        if name == "slope_fitted_N_m":
            return shear.fitted_N_m
        return [getattr(run, name) for run in shear.runs]

    return table_columns_of(KIND, values_of)


def summarise(built: Built) -> Summary:
    """Summarise a shear artifact."""
    columns = built.artifact.columns
    metadata: ShearMetadata = built.artifact.metadata
    return built.summary(
        "fit-shear",
        "shear stiffness of the ribs, from the build-up of the tensions",
        facts={
            "shear_stiffness_N_m2": metadata.shear_stiffness_N_m2,
            "shear_stiffness_u_N_m2": metadata.shear_stiffness_u_N_m2,
            "shear_stiffness_low_N_m2": metadata.shear_stiffness_low_N_m2,
            "shear_stiffness_high_N_m2": metadata.shear_stiffness_high_N_m2,
            "effective_span_m": metadata.effective_span_m,
            "effective_span_u_m": metadata.effective_span_u_m,
            "slope_scatter": metadata.slope_scatter,
            "runs": len(columns["status"]),
            "runs_used": int(np.count_nonzero(columns["status"] == "ok")),
            "budget": metadata.budget,
        },
        table=rows_of(columns, *columns),
        shown=(
            "run",
            "arc_deg",
            "initial_tension_N",
            "slope_N_m",
            "slope_se_N_m",
            "slope_fitted_N_m",
            "n_samples",
            "status",
        ),
        overview=_per_arc(columns),
        details=budget_details(metadata.budget),
        snippet=_snippet(metadata),
    )


def _snippet(metadata: ShearMetadata) -> str:
    """Return the config line that passes the result to a drive; empty without a result."""
    k_s = metadata.shear_stiffness_N_m2
    return "" if k_s is None else f"belt: {{shear_stiffness_N_m2: {k_s:.3e}}}"


def _per_arc(columns: Mapping[str, np.ndarray]) -> list[dict[str, Any]]:
    """Return a row per arc with the measured and fitted slopes of its runs."""
    good = columns["status"] == "ok"
    rows = []
    for arc in np.unique(columns["arc_deg"]):
        at_arc = columns["arc_deg"] == arc
        usable = at_arc & good
        slopes = [columns[name][usable] for name in ("slope_N_m", "slope_fitted_N_m")]
        measured, fitted = (float(x.mean()) if x.size else None for x in slopes)
        rows.append(
            {
                "arc_deg": float(arc),
                "runs": int(at_arc.sum()),
                "runs_used": int(usable.sum()),
                "mean_slope_N_m": measured,
                "mean_slope_fitted_N_m": fitted,
            }
        )
    return rows
