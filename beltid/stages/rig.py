"""The runs of the friction rig, simulated (Eqs. 9 to 12), with their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import BeltidError, NumericsError, counted, percent
from beltid.notes import log
from beltid.rig.runs import SimulationSettings
from beltid.stage import Outcome
from beltid.stages.campaign import (
    Campaign,
    bench_of,
    guided_weight,
    recording_columns,
    simulate,
    simulation_settings,
)
from beltid.stages.columns import span
from beltid.stages.inputs import friction_of, press_law, surface_from
from beltid.stages.planned_runs import (
    Picked,
    differing_settings,
    measured_settings,
    planned_runs,
    refuse_running,
)
from beltid.stages.reduction import rig_kind
from beltid.stages.uncertainties import standard_uncertainties
from beltid.stages.workers import Workers, threads
from beltid.store.artifact import read_artifact
from beltid.uncertainty.measured import numbered_arcs
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.simulated import RunsUncertainty, simulated_uncertainty
from beltid.uncertainty.sources import all_sources, sources_of, with_rig_sources

OF_SOLVER: Final = (
    *("elements", "steps", "newton_iterations", "status_changes"),
    *("halvings", "residual", "slip_m", "cone"),
)
SHOWN_FAILURES: Final = 20
PER_CALL: Final = 24
"""Number of runs whose uncertainty a worker computes in one call."""


def simulated(
    surface: Any,
    law: Any,
    friction: Any,
    config: Config,
    picked: Picked,
    method: str | None,
    jobs: int | None,
    workers: Workers | None,
) -> Outcome[Campaign]:
    """Simulate the runs of `friction`, else those of the config, and reduce nothing."""
    refuse_running(config)
    settings = simulation_settings(config, method)
    measured = None if friction is None else measured_settings(friction.columns, config)
    runs = planned_runs(config, picked, measured)
    differing = differing_settings(config, measured)
    for line in differing:
        log.warning("%s", line)
    stated = differing or measured is None or not measured.size
    origin = "as the config states" if stated else "at the settings measured"
    log.info("%s, %s, %s", counted(len(runs), "run"), settings.method, origin)
    press, workers = press_law(law, config), workers or threads(jobs)
    bench = bench_of(config, surface_from(surface), press.law)
    campaign = simulate(config, bench, runs, settings, workers)
    _require_results(campaign)
    stored = getattr(surface, "facts", {}).get("uncertainty") or {}
    uncertainty, lines = _uncertainty(campaign, press, stored, settings.elements, workers)
    return _outcome(campaign, settings, uncertainty, lines)


def friction_beside(files: dict[str, Path]) -> dict[str, Path]:
    """Add the reduced runs to the inputs if they are next to the surface made from them."""
    path = files["surface"]
    friction = friction_of(read_artifact(path, "surface"), path.parent)
    return files if friction is None else {**files, "friction": friction.path}


def _failures(campaign: Campaign) -> list[str]:
    return [f"run {run.label}: {line}" for run, e in campaign.failures for line in e.problems]


def _require_results(campaign: Campaign) -> None:
    """Raise an error if a campaign has no result at all."""
    if not campaign.finished:
        failures = _failures(campaign)
        hidden = len(failures) - SHOWN_FAILURES
        more = [f"and {hidden} more"] if hidden > 0 else []
        raise NumericsError([*failures[:SHOWN_FAILURES], *more])


def _outcome(
    campaign: Campaign,
    settings: SimulationSettings,
    uncertainty: RunsUncertainty | None,
    lines: tuple[str, ...],
) -> Outcome[Campaign]:
    config, failed = campaign.config, campaign.failures
    runs, results = zip(*campaign.finished, strict=True)
    records = {run.label: asdict(result.record) for run, result in campaign.finished}
    rows, columns = campaign.rows(), recording_columns(runs, results, config)
    outside = sum(int(record["clamped_lookups"]) for record in records.values())
    points = sum(int(record["lookups"]) for record in records.values())
    notes = guided_weight(config, [run.point for run in runs])
    if outside:
        notes.insert(
            0,
            f"{percent(100 * outside / points)} of the sliding contact points lie outside the "
            "measured range of the surface: the nearest measured value was used",
        )
    names = ("arc_deg", "initial_tension_N", "pulley_speed_rad_s")
    return Outcome(
        columns,
        campaign,
        facts={
            "method": settings.method,
            "runs": len(rows),
            "runs_failed": len(failed),
            "samples": len(columns["time_s"]),
            "mu_range": span([result.mu for result in results]),
            "clamped_lookups": outside,
            "lookups": points,
            **({"uncertainty": uncertainty.extra()} if uncertainty else {}),
        },
        tables={
            "simulated_runs": rows,
            "solver": [_solver_row(run, record) for run, record in records.items()],
        },
        validity={name: span([getattr(run, name) for run in runs]) for name in names},
        set_aside=[{"run": run.label, "why": "; ".join(e.problems)} for run, e in failed],
        notes=(*notes, *lines),
        warnings=tuple(_failures(campaign)),
        verdict=f"{len(failed)} of {len(rows)} runs failed" if failed else "",
        passed=False if failed else None,
    )


def _solver_row(run: str, record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the solver statistics of a run; look-ups outside the measured range in percent."""
    share = record["clamped_lookups"] / max(record["lookups"], 1)
    return {
        "run": run,
        **{name: record[name] for name in OF_SOLVER},
        "clamped_lookups_percent": 100.0 * share,
    }


def _uncertainty(
    campaign: Campaign,
    press: PressLaw,
    stored: Mapping[str, Any],
    elements: int | None,
    workers: Workers,
) -> tuple[RunsUncertainty | None, tuple[str, ...]]:
    """Return the uncertainty of the simulated runs of a campaign; a note if it stays unknown."""
    runs, results = zip(*campaign.finished, strict=True)
    numbers, arcs = numbered_arcs([run.arc_deg for run in runs], stored.get("arcs_deg", ()))
    of_rig = all_sources(standard_uncertainties(campaign.config), len(arcs), press.has_scatter)
    sources = with_rig_sources(sources_of(stored.get("sources", ())), of_rig)
    points: Sequence[Any] = [run.point for run in runs]
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
    mu = np.array([result.mu for result in results])
    labels = [run.label for run in runs]
    ordered = [parts[i] for i in range(len(pieces))]
    return RunsUncertainty.of(labels, mu, sources, ordered), ()
