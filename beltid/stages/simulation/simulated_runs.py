"""A simulated campaign: its runs, their uncertainty, the contact along the arc at chosen times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.config import Config, load_config
from beltid.errors import BeltidError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.rigsim.model import Bench
from beltid.rigsim.rig import RunResult, SimulationSettings
from beltid.stages.identification.reduction import rig_kind
from beltid.stages.outcome import Outcome
from beltid.stages.reporter import Reporter
from beltid.stages.simulation.campaign import (
    recording_columns,
    result_row,
    simulated_results,
    simulation_settings,
)
from beltid.stages.simulation.planned_runs import (
    KEYS,
    Picked,
    PlannedRun,
    as_resting,
    checked_run,
    measured_settings,
    planned_runs,
)
from beltid.stages.tables import table_columns
from beltid.stages.uncertainties import standard_uncertainties
from beltid.stages.workers import Workers
from beltid.tables import schemas
from beltid.uncertainty.measured import numbered_arcs
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.simulated import (
    RunsUncertainty,
    simulated_uncertainty,
    sources_of,
    with_rig_sources,
)
from beltid.uncertainty.sources import all_sources

if TYPE_CHECKING:
    import pandas as pd

PROFILES: Final = "profiles"
"""Kind of the table of the contact along the arc at chosen times."""
PER_CALL: Final = 24
"""Runs whose uncertainty a worker computes at a time."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """Runs of a simulated campaign, in their order, each with its result or its failure."""

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
        """A row per run: settings, sliding state, status."""
        return [result_row(*pair) for pair in zip(self.runs, self.results, strict=True)]


def simulate(
    config: Config,
    laws: tuple[FrictionSurface | float, NormalLaw],
    runs: Sequence[PlannedRun],
    settings: SimulationSettings,
    jobs: int | Workers | None,
    reporter: Reporter | None = None,
) -> Campaign:
    """Simulate runs with a surface and a normal law; the arguments are of `simulated_results`."""
    results: dict[int, RunResult | BeltidError] = {}
    with (reporter or Reporter()).progress("simulated runs", len(runs)) as advance:
        for index, result in simulated_results(config, laws, runs, settings, jobs):
            results[index] = result
            advance()
    return Campaign(tuple(runs), tuple(results[i] for i in range(len(runs))))


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRun:
    """One run of the simulated rig.

    Attributes
    ----------
    tension_tight_N, tension_slack_N : float
        Forces in the supports, sliding [N]; of a running rig less what turns the belt.
    mu : float
        Friction coefficient by Eq. (6) from these tensions [-].
    normal_force_N_m : float
        Mean normal force per length by Eq. (8) [N/m].
    settings : PlannedRun
        Arc, initial tension, pulley speed.
    result : RunResult
        Everything that the simulation tells, as plain arrays.
    config : Config
        The config of the rig.
    """

    tension_tight_N: float
    tension_slack_N: float
    mu: float
    normal_force_N_m: float
    settings: PlannedRun
    result: RunResult
    config: Config

    @property
    def recording(self) -> pd.DataFrame | None:
        """The run over time with the columns of rig.csv; None for the steady method."""
        import pandas as pd

        if self.result.recording is None:
            return None
        columns = recording_columns([self.settings], [self.result], self.config)
        return pd.DataFrame(columns)

    @property
    def profile(self) -> pd.DataFrame:
        """The sliding state along the arc."""
        import pandas as pd

        return pd.DataFrame(self.result.profile)


def simulate_rig(
    config: Config | Mapping[str, Any] | str | Path | None,
    surface: FrictionSurface | float,
    law: NormalLaw,
    *,
    arc_deg: float,
    initial_tension_N: float,
    pulley_speed_rad_s: float,
    method: str | None = None,
    elements: int | None = None,
) -> SimulatedRun:
    """Simulate one run of the friction rig.

    Parameters
    ----------
    config : Config, dict, path or None
        Belt, rig and contact; None is the built-in 5PK rig.
    surface : FrictionSurface or float
        Friction coefficient; a number is a constant one.
    law : NormalLaw
        Normal contact law.
    arc_deg : float
        Contact arc [°], in (0, 360); it need not be one of the config.
    initial_tension_N : float
        Tension before the pulley turns [N].
    pulley_speed_rad_s : float
        Speed of the pulley [rad/s].
    method : {"transient", "steady"}, optional
        By default that of the config.
    elements : int, optional
        Beam elements of the belt; by default those of the config.

    Returns
    -------
    SimulatedRun
        ``tension_tight_N``, ``tension_slack_N``, ``mu``, ``normal_force_N_m``, ``recording``,
        ``profile``.

    Raises
    ------
    InputError
        If an argument is out of its range.
    ConvergenceError
        If the simulation does not converge.
    """
    model = load_config(config)
    run = checked_run(arc_deg, initial_tension_N, pulley_speed_rad_s)
    settings = simulation_settings(model, method, elements)
    (_, result), *_ = simulated_results(model, (surface, law), [run], settings, jobs=1)
    if isinstance(result, BeltidError):
        raise result
    return SimulatedRun(
        tension_tight_N=float(result.tension_tight_N),
        tension_slack_N=float(result.tension_slack_N),
        mu=float(result.mu),
        normal_force_N_m=float(result.normal_force_N_m),
        settings=run,
        result=result,
        config=model,
    )


def simulate_campaign(
    config: Config | Mapping[str, Any] | str | Path | None,
    surface: FrictionSurface | float,
    law: NormalLaw,
    *,
    method: str | None = None,
    jobs: int | None = 1,
    elements: int | None = None,
    friction: Any = None,
) -> pd.DataFrame:
    """Simulate every run of a campaign.

    Parameters
    ----------
    config, surface, law, method, elements
        As of `simulate_rig`.
    jobs : int or None
        Runs at the same time; None is one per core. The result does not depend on it.
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping, optional
        The reduced runs of the bench, to be simulated where the config does not state the settings
        of the rig; without them all combinations of the config are.

    Returns
    -------
    DataFrame
        A row per run: run, arc_deg, initial_tension_N, pulley_speed_rad_s, tension_tight_N,
        tension_slack_N, mu, normal_force_N_m, status ("ok", or why it failed).
    """
    import pandas as pd

    model = load_config(config)
    measured = None
    if friction is not None:
        measured = measured_settings(table_columns(friction, "friction", tuple(KEYS)))
    runs = planned_runs(model, Picked(), measured)
    settings = simulation_settings(model, method, elements)
    done = simulate(model, (surface, law), runs, settings, jobs)
    return pd.DataFrame(done.rows()).astype(
        {"tension_tight_N": float, "tension_slack_N": float, "mu": float, "normal_force_N_m": float}
    )


def path_beside(recording: Path) -> Path:
    """Where the profiles of a simulated recording stand."""
    return recording.parent / f"{recording.stem}_{PROFILES}.parquet"


def profiles_outcome(done: Campaign, times_s: Sequence[float]) -> Outcome[Campaign]:
    """Table of the profiles of a campaign.

    Parameters
    ----------
    done : Campaign
        Transient runs that kept their contact at these times.
    times_s : sequence of float
        Times after the start of rotation that were asked for [s].
    """
    parts = [part for run, result in done.finished for part in _profiles(run, result)]
    columns = {
        name: np.concatenate([part[name] for part in parts])
        for name in schemas.table(PROFILES).names
    }
    return Outcome(
        kind=PROFILES,
        columns=columns,
        result=done,
        validity={"arc_position_m": (0.0, float(np.max(columns["arc_position_m"])))},
        set_aside=[{"run": run.label, "why": "; ".join(e.problems)} for run, e in done.failures],
        extra={"profile_times_s": list(times_s)},
        notes=_too_late(done, times_s),
    )


def _profiles(run: PlannedRun, result: RunResult) -> list[dict[str, np.ndarray]]:
    """Profiles of a run, one per step: two times may lie in one step."""
    states = dict(result.snapshots)
    parts = []
    for time, state in states.items():
        profile = state.profile()
        n = len(profile["arc_position_m"])
        parts.append(
            {"run": np.full(n, run.label, dtype=object), "time_s": np.full(n, time), **profile}
        )
    return parts


def _too_late(done: Campaign, times_s: Sequence[float]) -> tuple[str, ...]:
    notes = []
    for time in times_s:
        short = [run.label for run, result in done.finished if time > _turned(result)]
        if short:
            which = short[0] if len(short) == 1 else f"{len(short)} runs"
            notes.append(
                f"profile at {time:g} s: {which} had ended before, the state at the end was taken"
            )
    return tuple(notes)


def _turned(result: RunResult) -> float:
    """How long the pulley turned in a transient run [s]."""
    assert result.recording is not None
    time, omega = result.recording["time_s"], result.recording["pulley_speed_rad_s"]
    return float(time[-1] - time[np.flatnonzero(omega > 0.0)[0] - 1]) * (1.0 + 1e-12)


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a campaign was simulated with.

    Attributes
    ----------
    surface : FrictionSurface
        The surface, best one with its covariance.
    stored : mapping
        What its artifact says of its uncertainty.
    press : PressLaw
        The contact law and its making.
    """

    surface: FrictionSurface
    stored: Mapping[str, Any]
    press: PressLaw


def runs_uncertainty(
    finished: Sequence[tuple[PlannedRun, RunResult]],
    inputs: Inputs,
    config: Config,
    elements: int | None,
    workers: Workers,
) -> tuple[RunsUncertainty | None, tuple[str, ...]]:
    """Uncertainty of the runs of a campaign that were simulated; a note if it stays unknown."""
    arcs_deg = [run.arc_deg for run, _ in finished]
    numbers, arcs = numbered_arcs(arcs_deg, inputs.stored.get("arcs_deg", ()))
    given = all_sources(standard_uncertainties(config), len(arcs), inputs.press.has_scatter)
    stored = sources_of(inputs.stored.get("sources", ()))
    sources = with_rig_sources(stored, given)
    bench = Bench(
        config.belt_params(),
        config.rig_params(),
        config.contact_params(),
        inputs.press.law,
        inputs.surface,
    )
    points = [run.point for run in as_resting(config, [run for run, _ in finished])]
    pieces = [slice(i, i + PER_CALL) for i in range(0, len(points), PER_CALL)]
    largest = max(float(result.tension_tight_N) for _, result in finished)
    kind = rig_kind(config)
    calls = [
        (bench, inputs.press, points[piece], numbers[piece], sources, elements, largest, kind)
        for piece in pieces
    ]
    try:
        parts = dict(workers.as_ended(simulated_uncertainty, calls))
    except BeltidError as error:
        return None, (f"uncertainty of the simulated runs is not known: {error.problems[0]}",)
    ordered = [parts[i] for i in range(len(pieces))]
    mu = np.array([result.mu for _, result in finished])
    labels = [run.label for run, _ in finished]
    return RunsUncertainty.of(labels, mu, sources, ordered), ()
