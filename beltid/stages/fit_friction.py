"""beltid fit-friction: rig recording -> a friction coefficient per run (paper Eqs. 5 to 8)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.recording import columns_of, read_rig
from beltid.config import Config, ConfigSource, load_config
from beltid.identify.estimators.statistics import as_set
from beltid.identify.friction.load_cells import TOLD
from beltid.identify.friction.reduction import RunReduction, reduce_runs
from beltid.report.summary import Summary
from beltid.stages.build_artifact import Build, Built
from beltid.stages.outcome import Outcome, rows_of, span
from beltid.stages.reduction import FrictionTable, friction_settings, reduce_rig, rig_kind
from beltid.stages.reporter import Options
from beltid.stages.uncertainties import SECTION, budget_details, standard_uncertainties

KIND: Final = "friction"
FIGURES: Final = ("budget",)
KEYS: Final = (
    "friction",
    "rig.pulley_radius_m",
    "columns.rig",
    "units.rig",
    "runs.rig",
    "dialect",
    SECTION,
)


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Read a recording of the friction rig (input ``rig``), reduce it, write it, sum it up."""
    build = Build(KIND, config, KEYS, inputs, out, options, figures=FIGURES)
    built = build.up_to_date()
    if built is None:
        model = config.config
        rig = read_rig(inputs["rig"], model)
        runs = reduce_rig(rig, model, options.workers)
        options.reporter.report(f"{rig.path}: {rig.n_samples} samples")
        uncertainty, radius_m = standard_uncertainties(model), model.rig.pulley_radius_m
        table = FrictionTable.of(runs, uncertainty, radius_m, str(rig.path))
        built = build.write(_outcome(table, rig.notes))
    return summarise(built)


def fit_friction(
    frame: Any, config: Config | Mapping[str, Any] | str | Path | None = None
) -> Outcome[tuple[RunReduction, ...]]:
    """Reduce every run of a recording of the friction rig to its friction coefficient, Eq. (6).

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The columns of rig.csv.
    config : Config, dict, path or None
        Radius of the pulley, settings of the reduction; None is the built-in 5PK rig.

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
    radius_m = model.rig.pulley_radius_m
    columns = columns_of(frame, "rig", model)
    runs = reduce_runs(columns, radius_m, friction_settings(model), rig_kind(model))
    return _outcome(FrictionTable.of(runs, standard_uncertainties(model), radius_m, "frame"), ())


def _outcome(table: FrictionTable, notes: tuple[str, ...]) -> Outcome[tuple[RunReduction, ...]]:
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
        warnings=tuple(f"run {run} set aside: {why}" for run, why in aside),
    )


def _notes(reduced: Sequence[RunReduction]) -> tuple[str, ...]:
    """What happened in several runs, each with the number of runs."""
    spikes = [r for r in reduced if r.n_spikes]
    missing = [r for r in reduced if r.n_missing]
    swapped = [r.run for r in reduced if r.swapped]
    unresolved = [r for r in reduced if r.ok and not np.isfinite(r.mu_sticking)]
    lines = list(dict.fromkeys(n for r in reduced for n in r.notes if n.startswith(TOLD)))
    if spikes:
        lines.append(f"{sum(r.n_spikes for r in spikes)} spikes left out, in {len(spikes)} runs")
    if missing:
        lines.append(f"{sum(r.n_missing for r in missing)} samples missing in {len(missing)} runs")
    if swapped:
        lines.append(f"tight and slack cell were swapped in {_listed(swapped)}; corrected")
    if unresolved:
        lines.append(
            f"no mu_sticking for {len(unresolved)} runs whose records do not resolve the peak"
        )
    return tuple(lines)


def _listed(runs: Sequence[str]) -> str:
    text = ", ".join(runs[:8])
    return f"{text} and {len(runs) - 8} more" if len(runs) > 8 else text


def summarise(built: Built) -> Summary:
    """Sum up a friction artifact."""
    columns = built.artifact.columns
    good = columns["status"] == "ok"
    n_aside = int(np.count_nonzero(~good))
    validity = built.artifact.metadata.validity
    return Summary(
        stage="fit-friction",
        title="friction coefficient of every run",
        out=built.artifact.path,
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
        overview=_per_setting(columns, good),
        notes=built.notes,
        warnings=built.warnings,
        up_to_date=built.up_to_date,
        origin=built.origin,
    )


def _per_setting(columns: Mapping[str, np.ndarray], good: np.ndarray) -> list[dict[str, Any]]:
    """A row per arc and speed: force and friction over the initial tensions."""
    rows = []
    arcs, speeds = columns["arc_deg"], as_set(columns["pulley_speed_rad_s"])
    for arc in np.unique(arcs[good]):
        for speed in np.unique(speeds[good & (arcs == arc)]):
            here = good & (arcs == arc) & (speeds == speed)
            force, mu = columns["normal_force_N_m"][here], columns["mu_sliding"][here]
            rows.append(
                {
                    "arc_deg": float(arc),
                    "pulley_speed_rad_s": float(speed),
                    "runs": int(here.sum()),
                    "lowest_force_N_m": float(force.min()),
                    "highest_force_N_m": float(force.max()),
                    "mu_at_lowest": float(mu[np.argmin(force)]),
                    "mu_at_highest": float(mu[np.argmax(force)]),
                }
            )
    return rows
