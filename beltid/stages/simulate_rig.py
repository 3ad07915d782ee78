"""beltid simulate-rig: the friction rig on the computer (METHOD 4; paper Eqs. 9 to 12)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from beltid.config import Config, ConfigSource, load_config
from beltid.errors import EXIT_DONE, EXIT_NUMERICS, BeltidError, NumericsError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.report.summary import Summary
from beltid.rigsim.rig import RunResult, SimulationSettings
from beltid.stages.campaign import (
    Picked,
    PlannedRun,
    planned_runs,
    recording_columns,
    result_row,
    simulated_results,
    simulation_settings,
    sliding_samples,
    solver_record,
)
from beltid.stages.making import Made, Recipe, make
from beltid.stages.outcome import Outcome
from beltid.stages.tables import law_of, surface_of
from beltid.stages.talk import Options, Talk
from beltid.store.artifacts import read_artifact

if TYPE_CHECKING:
    import pandas as pd

KIND: Final = "simulated"
KEYS: Final = (
    "belt.axial_stiffness_N",
    "belt.bending_stiffness_N_m2",
    "belt.mass_per_length_kg_m",
    "belt.damping_time_s",
    "rig.pulley_radius_m",
    "rig.span_length_m",
    "rig.supports",
    "contact",
    "simulation.steps_per_run",
    "simulation.friction_solver",
    "simulation.sticking_ratio",
)
SHOWN_FAILURES: Final = 20


@dataclass(frozen=True, slots=True)
class SimulateOptions(Options):
    """Options of a simulated campaign.

    Attributes
    ----------
    method : str or None
        "transient", "steady", or None for that of the config.
    arcs_deg, tensions_N, speeds_rad_s : tuple of float
        Runs to pick; empty for all of the config.
    elements : int or None
        Beam elements of the belt; None for those of the config.
    jobs : int or None
        Runs at the same time; None for one per core.
    """

    method: str | None = None
    arcs_deg: tuple[float, ...] = ()
    tensions_N: tuple[float, ...] = ()
    speeds_rad_s: tuple[float, ...] = ()
    elements: int | None = None
    jobs: int | None = None


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


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Simulate the runs with ``surface`` and ``stiffness``, write the recording, sum it up."""
    chosen = options if isinstance(options, SimulateOptions) else _with_defaults(options)
    model = config.config
    settings = simulation_settings(model, chosen.method, chosen.elements)
    runs = planned_runs(model, Picked(chosen.arcs_deg, chosen.tensions_N, chosen.speeds_rad_s))

    def compute() -> Outcome[Campaign]:
        surface = surface_of(read_artifact(inputs["surface"], "surface"))
        law = law_of(read_artifact(inputs["stiffness"], "stiffness"))
        options.talk.say(f"{len(runs)} runs, {settings.method}")
        done = _simulate(model, (surface, law), runs, settings, chosen)
        return _outcome(done, model, settings)

    choices: dict[str, Any] = {
        "method": settings.method,
        "elements": settings.elements,
        "runs": [[r.label, r.arc_deg, r.initial_tension_N, r.pulley_speed_rad_s] for r in runs],
    }
    if settings.method == "steady":
        choices["sliding_samples"] = sliding_samples(model)
    return summarise(make(Recipe(KIND, config, KEYS, inputs, choices), out, options, compute))


def _with_defaults(options: Options) -> SimulateOptions:
    return SimulateOptions(force=options.force, talk=options.talk)


def _simulate(
    config: Config,
    laws: tuple[FrictionSurface | float, NormalLaw],
    runs: Sequence[PlannedRun],
    settings: SimulationSettings,
    options: SimulateOptions,
) -> Campaign:
    results: dict[int, RunResult | BeltidError] = {}
    with options.talk.progress("simulate-rig", len(runs)) as advance:
        for index, result in simulated_results(config, laws, runs, settings, options.jobs):
            results[index] = result
            advance()
    return Campaign(tuple(runs), tuple(results[i] for i in range(len(runs))))


def _outcome(done: Campaign, config: Config, settings: SimulationSettings) -> Outcome[Campaign]:
    failures = [f"run {run.label}: {line}" for run, e in done.failures for line in e.problems]
    if not done.finished:
        more = len(failures) - SHOWN_FAILURES
        raise NumericsError(
            [*failures[:SHOWN_FAILURES], *([f"and {more} more"] if more > 0 else [])]
        )
    runs, results = zip(*done.finished, strict=True)
    records = {run.label: solver_record(result) for run, result in done.finished}
    rows = [{**row, "solver": records.get(row["run"])} for row in done.rows()]
    outside = sum(int(record["clamped_lookups"]) for record in records.values())
    points = sum(int(record["lookups"]) for record in records.values())
    notes = []
    if outside:
        notes.append(
            f"{100 * outside / points:.2g} % of the sliding contact points lie outside the "
            "measured range of the surface: the nearest measured value was taken"
        )
    return Outcome(
        kind=KIND,
        columns=recording_columns(runs, results, config),
        result=done,
        validity={
            name: (min(values), max(values))
            for name in ("arc_deg", "initial_tension_N", "pulley_speed_rad_s")
            for values in ([getattr(run, name) for run in runs],)
        },
        set_aside=[{"run": run.label, "why": "; ".join(e.problems)} for run, e in done.failures],
        extra={
            "method": settings.method,
            "runs": rows,
            "clamped_lookups": outside,
            "lookups": points,
        },
        notes=tuple(notes),
        warnings=tuple(failures),
    )


def summarise(made: Made) -> Summary:
    """Sum up a simulated recording."""
    extra = made.artifact.metadata.extra
    rows = [{k: v for k, v in row.items() if k != "solver"} for row in extra["runs"]]
    good = [row for row in rows if row["status"] == "ok"]
    failed = len(rows) - len(good)
    return Summary(
        stage="simulate-rig",
        title="friction coefficient of every simulated run, sliding",
        out=made.artifact.path,
        facts={
            "method": extra["method"],
            "runs": len(rows),
            "runs_failed": failed,
            "samples": len(made.artifact.columns["time_s"]),
            "mu_range": (min(row["mu"] for row in good), max(row["mu"] for row in good)),
        },
        table=rows,
        overview=_per_setting(good) if len(rows) > 20 else [],
        notes=made.notes,
        warnings=made.warnings,
        verdict=f"{failed} of {len(rows)} runs failed" if failed else "",
        exit_status=EXIT_NUMERICS if failed else EXIT_DONE,
        up_to_date=made.up_to_date,
    )


def _per_setting(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row per arc and speed: force and friction over the initial tensions."""
    groups: dict[tuple[float, float], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["arc_deg"], row["pulley_speed_rad_s"]), []).append(row)
    table = []
    for (arc, speed), group in sorted(groups.items()):
        low = min(group, key=lambda row: row["normal_force_N_m"])
        high = max(group, key=lambda row: row["normal_force_N_m"])
        table.append(
            {
                "arc_deg": arc,
                "pulley_speed_rad_s": speed,
                "runs": len(group),
                "lowest_force_N_m": low["normal_force_N_m"],
                "highest_force_N_m": high["normal_force_N_m"],
                "mu_at_lowest": low["mu"],
                "mu_at_highest": high["mu"],
            }
        )
    return table


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRun:
    """One run of the simulated rig.

    Attributes
    ----------
    tension_tight_N, tension_slack_N : float
        Forces in the supports, sliding [N].
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
    run = PlannedRun("S001", float(arc_deg), float(initial_tension_N), float(pulley_speed_rad_s))
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
) -> pd.DataFrame:
    """Simulate every run of a config.

    Parameters
    ----------
    config, surface, law, method, elements
        As of `simulate_rig`.
    jobs : int or None
        Runs at the same time; None is one per core. The result does not depend on it.

    Returns
    -------
    DataFrame
        A row per run: run, arc_deg, initial_tension_N, pulley_speed_rad_s, tension_tight_N,
        tension_slack_N, mu, normal_force_N_m, status ("ok", or why it failed).
    """
    import pandas as pd

    model = load_config(config)
    runs = planned_runs(model, Picked())
    settings = simulation_settings(model, method, elements)
    done = _simulate(model, (surface, law), runs, settings, SimulateOptions(talk=Talk(), jobs=jobs))
    return pd.DataFrame(done.rows()).astype(
        {"tension_tight_N": float, "tension_slack_N": float, "mu": float, "normal_force_N_m": float}
    )
