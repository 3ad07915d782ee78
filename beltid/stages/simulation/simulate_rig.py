"""beltid simulate-rig: simulate the friction rig (paper Eqs. 9 to 12)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.artifacts.metadata_models import SimulatedMetadata, SurfaceMetadata
from beltid.config import ConfigSource
from beltid.errors import EXIT_DONE, EXIT_NUMERICS, BeltidError, NumericsError, counted, percent
from beltid.report.summary import Summary
from beltid.rigsim.kernel_cache import COMPILING, compile_ahead
from beltid.rigsim.rig import SimulationSettings
from beltid.stages.build_artifact import Build, Built
from beltid.stages.identification.reduction import rig_kind
from beltid.stages.outcome import Outcome, rows_per_setting, span
from beltid.stages.reporter import Options
from beltid.stages.simulation.campaign import (
    RIG_USES,
    Campaign,
    bench_of,
    guided_weight,
    recording_columns,
    simulate,
    simulation_settings,
)
from beltid.stages.simulation.planned_runs import (
    Picked,
    PlannedRun,
    differing_settings,
    measured_settings,
    planned_runs,
    refuse_running,
)
from beltid.stages.tables import friction_of, press_law, surface_of
from beltid.stages.uncertainties import standard_uncertainties
from beltid.stages.workers import Workers
from beltid.uncertainty.measured import numbered_arcs
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.simulated import RunsUncertainty, simulated_uncertainty
from beltid.uncertainty.sources import all_sources, sources_of, with_rig_sources

KIND: Final = "simulated"
SHOWN_OF_SOLVER: Final = (
    "elements",
    "steps",
    "newton_iterations",
    "status_changes",
    "halvings",
    "residual",
    "slip_m",
    "cone",
)
USES: Final = (*RIG_USES, "friction")
SHOWN_FAILURES: Final = 20
PER_CALL: Final = 24
"""Number of runs whose uncertainty a worker computes in one call."""
ROW: Final = (
    "run",
    "arc_deg",
    "initial_tension_N",
    "pulley_speed_rad_s",
    "tension_tight_N",
    "tension_slack_N",
    "mu",
    "normal_force_N_m",
    "status",
)


def run(
    config: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    options: Options,
    *,
    picked: Picked | None = None,
    method: str | None = None,
    jobs: int = 1,
) -> Summary:
    """Simulate the runs with ``surface`` and ``stiffness``, write the recording, summarise it.

    The runs are those of ``friction`` if it is given or found next to the surface that was made
    from it; otherwise those of the config.

    Parameters
    ----------
    config, inputs, out, options
        As for every stage.
    picked : Picked, optional
        Simulate these runs only; by default all.
    method : {"transient", "steady"}, optional
        By default that of the config.
    jobs : int
        Number of parallel runs in this process if no workers are given.
    """
    model = config.config
    refuse_running(model)
    settings = simulation_settings(model, method)
    inputs = _with_friction(inputs)
    measured = None
    if "friction" in inputs:
        measured = measured_settings(read_artifact(inputs["friction"], "friction").columns, model)
    runs = planned_runs(model, picked or Picked(), measured)
    differing = differing_settings(model, measured)
    for line in differing:
        options.reporter.warn(line)
    choices, guests = _choices(settings, runs), ("friction",)
    build = Build(KIND, config, USES, inputs, out, options, choices, guests)
    built = build.up_to_date()
    if built is None:
        surface = build.read("surface")
        press = press_law(inputs["stiffness"], model)
        stated = differing or measured is None or not measured.size
        settings_source = "as the config states" if stated else "at the settings measured"
        options.reporter.report(
            f"{counted(len(runs), 'run')}, {settings.method}, {settings_source}"
        )
        if compile_ahead(["rigsim"]):
            options.reporter.report(COMPILING)
        bench, workers = bench_of(model, surface_of(surface), press.law), options.workers
        parallel = workers if workers.jobs > 1 else jobs
        campaign = simulate(model, bench, runs, settings, parallel, options.reporter)
        _require_results(campaign)
        uncertainty = _uncertainty(campaign, press, surface, settings.elements, workers)
        built = build.write(_outcome(campaign, settings, uncertainty))
    return summarise(built)


def _choices(settings: SimulationSettings, runs: Sequence[PlannedRun]) -> dict[str, Any]:
    """Return the settings of a call and the measured runs that a recording depends on."""
    return {
        "method": settings.method,
        "runs": [[r.label, r.arc_deg, r.initial_tension_N, r.pulley_speed_rad_s] for r in runs],
    }


def _with_friction(inputs: Mapping[str, Path]) -> Mapping[str, Path]:
    """Add the reduced runs to the inputs if they are next to the surface made from them."""
    if "friction" in inputs:
        return inputs
    path = inputs["surface"]
    friction = friction_of(read_artifact(path, "surface"), path.parent)
    return inputs if friction is None else {**inputs, "friction": friction.path}


def _failures(campaign: Campaign) -> list[str]:
    return [f"run {run.label}: {line}" for run, e in campaign.failures for line in e.problems]


def _require_results(campaign: Campaign) -> None:
    """Raise an error if a campaign has no result at all."""
    if not campaign.finished:
        failures = _failures(campaign)
        n_hidden = len(failures) - SHOWN_FAILURES
        raise NumericsError(
            [*failures[:SHOWN_FAILURES], *([f"and {n_hidden} more"] if n_hidden > 0 else [])]
        )


def _outcome(
    campaign: Campaign,
    settings: SimulationSettings,
    uncertainty: tuple[RunsUncertainty | None, tuple[str, ...]],
) -> Outcome[Campaign]:
    config = campaign.config
    runs, results = zip(*campaign.finished, strict=True)
    records = {run.label: asdict(result.record) for run, result in campaign.finished}
    rows = [{**row, "solver": records.get(row["run"])} for row in campaign.rows()]
    outside = sum(int(record["clamped_lookups"]) for record in records.values())
    points = sum(int(record["lookups"]) for record in records.values())
    notes = []
    if outside:
        notes.append(
            f"{percent(100 * outside / points)} of the sliding contact points lie outside the "
            "measured range of the surface: the nearest measured value was used"
        )
    notes += guided_weight(config, [run.point for run in runs])
    return Outcome(
        kind=KIND,
        columns=recording_columns(runs, results, config),
        result=campaign,
        validity={
            name: (min(values), max(values))
            for name in ("arc_deg", "initial_tension_N", "pulley_speed_rad_s")
            for values in ([getattr(run, name) for run in runs],)
        },
        set_aside=[
            {"run": run.label, "why": "; ".join(e.problems)} for run, e in campaign.failures
        ],
        extra={
            "method": settings.method,
            "runs": rows,
            "clamped_lookups": outside,
            "lookups": points,
            **({"uncertainty": uncertainty[0].extra()} if uncertainty[0] else {}),
        },
        notes=(*notes, *uncertainty[1]),
        warnings=tuple(_failures(campaign)),
    )


def _uncertainty(
    campaign: Campaign,
    press: PressLaw,
    surface: Artifact[SurfaceMetadata],
    elements: int | None,
    workers: Workers,
) -> tuple[RunsUncertainty | None, tuple[str, ...]]:
    """Return the uncertainty of the simulated runs of a campaign; a note if it stays unknown."""
    stored: Mapping[str, Any] = surface.metadata.uncertainty or {}
    runs, results = zip(*campaign.finished, strict=True)
    numbers, arcs = numbered_arcs([run.arc_deg for run in runs], stored.get("arcs_deg", ()))
    rig_sources = all_sources(standard_uncertainties(campaign.config), len(arcs), press.has_scatter)
    sources = with_rig_sources(sources_of(stored.get("sources", ())), rig_sources)
    points = [run.point for run in runs]
    pieces = [slice(i, i + PER_CALL) for i in range(0, len(points), PER_CALL)]
    kind = rig_kind(campaign.config)
    calls = [
        (campaign.bench, press, points[piece], numbers[piece], sources, elements, kind)
        for piece in pieces
    ]
    try:
        parts = dict(workers.as_ended(simulated_uncertainty, calls))
    except BeltidError as error:
        return None, (f"uncertainty of the simulated runs is not known: {error.problems[0]}",)
    ordered = [parts[i] for i in range(len(pieces))]
    mu = np.array([result.mu for result in results])
    labels = [run.label for run in runs]
    return RunsUncertainty.of(labels, mu, sources, ordered), ()


def summarise(built: Built) -> Summary:
    """Summarise a simulated recording."""
    metadata: SimulatedMetadata = built.artifact.metadata
    runs = metadata.runs or ()
    rows: list[dict[str, Any]] = [{name: row.get(name) for name in ROW} for row in runs]
    good = [row for row in rows if row["status"] == "ok"]
    failed = len(rows) - len(good)
    names = ("arc_deg", "pulley_speed_rad_s", "normal_force_N_m", "mu")
    settings = (np.array([row[name] for row in good], dtype=float) for name in names)
    return built.summary(
        "simulate-rig",
        "friction coefficient of every simulated run, sliding",
        facts={
            "method": metadata.method,
            "runs": len(rows),
            "runs_failed": failed,
            "samples": len(built.artifact.columns["time_s"]),
            "mu_range": span(np.array([row["mu"] for row in good], dtype=float)),
        },
        table=rows,
        overview=rows_per_setting(*settings) if len(rows) > 20 else [],
        details={"solver": [_solver_row(row) for row in runs if row.get("solver")]},
        verdict=f"{failed} of {len(rows)} runs failed" if failed else "",
        exit_status=EXIT_NUMERICS if failed else EXIT_DONE,
    )


def _solver_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the solver statistics of a run; look-ups outside the measured range in percent."""
    record = row["solver"]
    share = record["clamped_lookups"] / max(record["lookups"], 1)
    return {
        "run": row.get("run"),
        **{name: record[name] for name in SHOWN_OF_SOLVER},
        "clamped_lookups_percent": 100.0 * share,
    }
