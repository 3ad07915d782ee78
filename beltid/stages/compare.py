"""Measured against simulated friction coefficients (section 4).

The simulated recording passes the same function that reduced the measured one, with the radius
stored in the friction artifact. Only the load cells differ: those of the simulated rig are perfect,
those of a second bench are as the config states.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.errors import counted
from beltid.identify.agreement import AgreementResult, compare_points
from beltid.report.summary import rows_of
from beltid.stage import Outcome
from beltid.stages.columns import span
from beltid.stages.friction import reduce_rig, reduction_columns, simulated_recording
from beltid.stages.inputs import friction_columns
from beltid.stages.planned_runs import with_tensions
from beltid.store.artifact import Artifact
from beltid.uncertainty.simulated import RunsUncertainty, dominant, runs_uncertainty_of, validated

NEEDED: Final = (
    *("run", "arc_deg", "nominal_tension_N", "pulley_speed_rad_s"),
    *("normal_force_N_m", "mu_sliding"),
)
ENOUGH: Final = 0.8
"""Share of the usable measured runs below which a comparison is one of few runs."""
MIN_SHARE_COMPARED: Final = 0.5
"""Share of compared runs below which the campaign fails: too few to judge it."""
Columns = Mapping[str, np.ndarray]


def compared(friction: Any, simulated: Any, config: Config) -> Outcome[AgreementResult]:
    """Compare run by run; the simulated runs are a recording, reduced runs, or a campaign."""
    measured = friction_columns(friction, NEEDED)
    uncertainty = None
    if isinstance(simulated, Artifact):
        uncertainty = runs_uncertainty_of(simulated.facts)
    return agreement(measured, _reduced(simulated, friction, config), config, uncertainty)


def _reduced(simulated: Any, friction: Any, config: Config) -> Columns:
    """Return the simulated runs, reduced like the measured ones."""
    if isinstance(friction, Artifact) and "rig" in friction.record.settings:
        radius = float(friction.record.settings["rig"]["pulley_radius_m"])
        rig = config.rig.model_copy(update={"pulley_radius_m": radius})
        config = config.model_copy(update={"rig": rig})
    if isinstance(simulated, Recording):  # of a second bench
        return reduction_columns(reduce_rig(simulated, config))
    frame = simulated
    if isinstance(simulated, (Outcome, Artifact)):
        if simulated.kind != "simulated":
            return friction_columns(simulated, NEEDED, "simulated")
        frame = simulated.columns
    named = getattr(frame, "column_names", getattr(frame, "columns", frame))
    names = {str(name) for name in named} if isinstance(named, Iterable) else set()
    if "time_s" in names:
        return reduction_columns(reduce_rig(simulated_recording(frame), config))
    if "mu" in names and "mu_sliding" not in names:  # the table of a simulated campaign
        frame = {name: np.asarray(frame[name]) for name in names}
        frame |= {"mu_sliding": frame["mu"], "nominal_tension_N": frame["initial_tension_N"]}
    return friction_columns(frame, NEEDED, "simulated")


def agreement(
    measured: Columns,
    simulated: Columns,
    config: Config,
    uncertainty: RunsUncertainty | None = None,
) -> Outcome[AgreementResult]:
    """Compare two tables of reduced runs, and judge the differences by the tolerances."""
    measured, simulated = with_tensions(measured, config), with_tensions(simulated, config)
    tolerances = {**config.compare.model_dump(), "min_share_compared": MIN_SHARE_COMPARED}
    result, parts = validated(
        compare_points(measured, simulated, tolerances), measured, simulated, uncertainty
    )
    found, budget = parts.facts(result), parts.budget()
    columns = {**result.to_columns(), **parts.columns(result)}
    n = len(columns["run"])
    columns["status"] = np.full(n, "ok", dtype=object)
    warnings = [
        f"{counted(count, 'run')} not compared: {why}" for why, count in result.not_compared.items()
    ]
    if result.share_compared < ENOUGH:
        few = f"only {n} of {result.n_usable} measured runs were compared: the verdict holds for "
        warnings.insert(0, f"{few}these only")
    return Outcome(
        columns,
        result,
        facts={
            "runs_compared": n,
            "runs_measured": result.n_measured,
            "runs_simulated": result.n_simulated,
            "within_two_u_validation": f"{found['within_2u']} of {found['n']} runs",
            "rms_over_u_validation": found["rms_e_over_u"],
            "u_validation_mostly_from": dominant(budget),
            "validation": found,
        },
        tables={
            "groups": [group.as_row() for group in result.groups],
            "judged": result.verdict_table(),
            "averaged": rows_of(result.averaged, *result.averaged),
            "budget": budget,
        },
        validity={"normal_force_N_m": span(result.normal_force_N_m)},
        set_aside=[{"run": run, "why": why} for run, why in result.not_compared_runs],
        notes=tuple(filter(None, (*parts.notes(), result.against_uncertainty))),
        warnings=tuple(warnings),
        verdict=result.verdict,
        passed=bool(result.passed),
    )
