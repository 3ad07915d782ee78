"""Simulated campaigns: the results of their runs, and their recording as one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from beltid.errors import BeltidError, InputError, percent
from beltid.notes import progress
from beltid.params import OperatingPoint
from beltid.rig.mesh import swinging_share
from beltid.rig.model import Bench
from beltid.rig.runs import (
    Method,
    RunResult,
    SimulationSettings,
    runs_of_one_belt,
)
from beltid.rig.runs import campaign as rig_campaign
from beltid.stages.inputs import checked_law, is_number, surface_from
from beltid.stages.planned_runs import PlannedRun, refuse_running
from beltid.stages.workers import Workers
from beltid.tables import schemas

if TYPE_CHECKING:
    from beltid.config import Config

REST_SAMPLES: Final = 10
SLIDING_SAMPLES: Final = 60
TRAVEL_PER_SAMPLE_M: Final = 5.0e-5
STATE: Final = ("tension_tight_N", "tension_slack_N", "mu", "normal_force_N_m")
"""The sliding state of a run."""


def simulation_settings(
    config: Config,
    method: str | None = None,
    elements: int | None = None,
) -> SimulationSettings:
    """Return the settings of the simulation from the call, else from the config."""
    section = config.simulation
    chosen = method or section.method
    if chosen not in ("transient", "steady"):
        raise InputError(f"method = {chosen!r}, must be transient or steady")
    if elements is not None and not (is_number(elements) and float(elements).is_integer()):
        found = f"{elements:g}" if is_number(elements) else repr(elements)
        raise InputError(f"elements = {found}, must be a whole number, even and >= 4")
    count = section.elements if elements is None else int(elements)
    try:
        return SimulationSettings(
            method=cast(Method, chosen),
            elements=count,
            friction_solver=section.friction_solver,
        )
    except InputError as error:
        raise InputError(error.at("simulation")) from None


def guided_weight(config: Config, points: Sequence[OperatingPoint]) -> list[str]:
    """Return a note on the assumed guidance of a dead weight and its effect; empty without one."""
    if config.rig.kind != "dead_weight":
        return []
    belt, rig = config.belt_params(), config.rig_params()
    share = max(swinging_share(belt, rig, point) for point in points)
    return [
        "the dead weight is guided along its span; one that swings freely makes mu lower, "
        f"by up to {percent(100 * share)} in these runs"
    ]


def bench_of(config: Config, surface: Any, law: Any) -> Bench:
    """Build the rig of a config with identified laws; a number for a surface is a constant mu."""
    refuse_running(config)
    return Bench(
        belt=config.belt_params(),
        rig=config.rig_params(),
        contact=config.contact_params(),
        law=checked_law(law),
        surface=surface_from(surface),
    )


@dataclass(frozen=True, slots=True)
class Campaign:
    """Runs of a simulated campaign, in their order, each with its result or its failure."""

    config: Config
    bench: Bench
    runs: tuple[PlannedRun, ...]
    results: tuple[RunResult | BeltidError, ...]

    @property
    def failures(self) -> list[tuple[PlannedRun, BeltidError]]:
        """Runs that failed."""
        pairs = zip(self.runs, self.results, strict=True)
        return [(run, result) for run, result in pairs if isinstance(result, BeltidError)]

    @property
    def finished(self) -> list[tuple[PlannedRun, RunResult]]:
        """Runs that succeeded."""
        pairs = zip(self.runs, self.results, strict=True)
        return [(run, result) for run, result in pairs if not isinstance(result, BeltidError)]

    def rows(self) -> list[dict[str, Any]]:
        """Return a row per run: settings, sliding state, status."""
        found: dict[str, dict[str, Any]] = {run.label: asdict(run) for run in self.runs}
        for run, result in self.finished:
            state = {name: float(getattr(result, name)) for name in STATE}
            found[run.label] |= {**state, "status": "ok"}
        for run, error in self.failures:
            found[run.label] |= {**dict.fromkeys(STATE), "status": "; ".join(error.problems)}
        return [{"run": row.pop("label"), **row} for row in found.values()]


def simulate(
    config: Config,
    bench: Bench,
    runs: Sequence[PlannedRun],
    settings: SimulationSettings,
    workers: Workers,
) -> Campaign:
    """Simulate runs by workers, and report the progress; the results do not depend on them."""
    results: dict[int, RunResult | BeltidError] = {}
    points = [run.point for run in runs]
    groups = runs_of_one_belt(points)
    with progress("simulated runs", len(runs)) as advance:
        calls = [(bench, [points[i] for i in group], settings) for group in groups]
        for number, part in workers.as_ended(simulated_group, calls):
            for index, result in zip(groups[number], part, strict=True):
                results[index] = result
                advance()
    return Campaign(config, bench, tuple(runs), tuple(results[i] for i in range(len(runs))))


def simulated_group(
    bench: Bench, points: Sequence[OperatingPoint], settings: SimulationSettings
) -> list[RunResult | BeltidError]:
    """Return the results of a few runs in their order; a single call of a worker."""
    return [result for _, result in rig_campaign(bench, points, settings)]


def recording_columns(
    runs: Sequence[PlannedRun], results: Sequence[RunResult], config: Config
) -> dict[str, np.ndarray]:
    """Return the recordings of runs as one table with the columns of rig.csv."""
    parts = [_one_recording(*pair, config) for pair in zip(runs, results, strict=True)]
    return {
        column.name: np.concatenate([part[column.name] for part in parts])
        for column in schemas.table("simulated").columns
    }


def _one_recording(run: PlannedRun, result: RunResult, config: Config) -> dict[str, np.ndarray]:
    recorded = result.recording
    if recorded is None:
        recorded = _two_levels(run, result, config)
    n = len(recorded["time_s"])
    return {
        **recorded,
        "run": np.full(n, run.label, dtype=object),
        "temperature_degC": np.full(n, np.nan),
        "arc_deg": np.full(n, run.arc_deg),
        "initial_tension_N": np.full(n, run.initial_tension_N),
    }


def _two_levels(run: PlannedRun, result: RunResult, config: Config) -> dict[str, np.ndarray]:
    """Return a recording with two levels, at rest and sliding, for a known sliding limit.

    The sliding limit thus passes the same reduction as any recording. It has no build-up, and
    therefore no sticking peak.
    """
    omega = run.pulley_speed_rad_s
    n = REST_SAMPLES + SLIDING_SAMPLES
    turning = np.arange(n) >= REST_SAMPLES
    T_0 = run.initial_tension_N
    return {
        "time_s": np.arange(n) * (TRAVEL_PER_SAMPLE_M / (omega * config.rig.pulley_radius_m)),
        "tension_tight_N": np.where(turning, result.tension_tight_N, T_0),
        "tension_slack_N": np.where(turning, result.tension_slack_N, T_0),
        "pulley_speed_rad_s": np.where(turning, omega, 0.0),
    }
