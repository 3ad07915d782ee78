"""The runs of the friction rig, simulated (Eqs. 9 to 12): a campaign, or one run from Python.

The measured runs are simulated, each combination of settings once; if every run has its own tension
and speed, that is every run. Settings stated in the config take precedence: measured runs at other
settings are left out, and a stated setting that was not measured is combined with all the others.
Without measured runs all combinations of the config are simulated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd

from beltid.bench.recording import as_frame
from beltid.config import Config, load_config
from beltid.errors import BeltidError, InputError, NotPossible, NumericsError, counted, percent
from beltid.identify.agreement import SAME_SETTING
from beltid.laws.capstan import Spans
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.notes import log, progress
from beltid.params import OperatingPoint
from beltid.rig.model import Bench
from beltid.rig.runs import Method, RunResult, SimulationSettings, runs_of_one_belt
from beltid.stage import Outcome, as_measured
from beltid.stages.friction import rig_kind
from beltid.stages.inputs import (
    Columns,
    friction_columns,
    joined,
    law_from,
    listed,
    nominal_settings,
    ok_rows,
    press_law,
    span,
    standard_uncertainties,
    surface_from,
    with_tensions,
)
from beltid.stages.workers import Workers, threads
from beltid.tables import schemas
from beltid.uncertainty.measured import PressLaw, numbered_arcs
from beltid.uncertainty.simulated import (
    Campaign,
    RunsUncertainty,
    simulated_runs,
    simulated_uncertainty,
)
from beltid.uncertainty.sources import SURFACE, Source, stated_sources, with_sources

KEYS = {
    "arc_deg": "arcs_deg",
    "nominal_tension_N": "initial_tensions_N",
    "pulley_speed_rad_s": "pulley_speeds_rad_s",
}
"""Column of a setting in the friction table -> its list in the section `rig`."""
SETTINGS = ("arc_deg", "initial_tension_N", "pulley_speed_rad_s")
STATE = ("tension_tight_N", "tension_slack_N", "mu", "normal_force_N_m")  # sliding
PER_CALL = 24  # number of runs whose uncertainty a worker computes in one call
REST_SAMPLES = 10
SLIDING_SAMPLES = 60
TRAVEL_PER_SAMPLE_M = 5.0e-5


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """One run of the simulated rig; its label is its place in the whole campaign."""

    label: str
    arc_deg: float
    initial_tension_N: float
    pulley_speed_rad_s: float

    @property
    def point(self) -> OperatingPoint:
        """The settings in SI units."""
        return OperatingPoint(
            math.radians(self.arc_deg), self.initial_tension_N, self.pulley_speed_rad_s
        )


Results = Mapping[PlannedRun, RunResult | BeltidError]  # in the order of the campaign


def simulated(
    surface: Any,
    law: Any,
    friction: Any,
    config: Config,
    picked: Sequence[Sequence[float]],
    method: str | None,
    workers: Workers,
) -> Outcome[Results]:
    """Simulate the runs of `friction`, else those of the config, and reduce nothing."""
    settings, press = simulation_settings(config, method), press_law(law, config)
    bench = bench_of(config, surface, press.law)
    runs = planned_runs(config, None if friction is None else friction.columns, picked)
    log.info("%s, %s", counted(len(runs), "run"), settings.method)
    results = simulate(bench, runs, settings, workers)
    good, rows = finished(results), rows_of_runs(results)
    failed = {run: error for run, error in results.items() if isinstance(error, BeltidError)}
    failures = [f"run {run.label}: {line}" for run, e in failed.items() for line in e.problems]
    if not good:
        raise NumericsError(failures)
    stored = getattr(surface, "facts", {}).get("uncertainty") or {}
    uncertainty, notes = _uncertainty(good, bench, config, press, stored, workers)
    points = np.concatenate([run.sliding.now[run.sliding.touching] for run in good.values()])
    outside = np.count_nonzero(~bench.surface.covers(points["f_N"], points["speed"]))
    share = percent(100 * outside / max(points.size, 1))
    beyond = f"nearest value used: {share} of the sliding contacts are outside the measured surface"
    columns = recording_columns(good.items(), config)
    return Outcome(
        columns,
        results,
        facts={
            "method": settings.method,
            "runs": len(rows),
            "runs_failed": len(failed),
            "samples": len(columns["time_s"]),
            "mu_range": span([result.mu for result in good.values()]),
            "clamped_lookups": outside,
            "lookups": points.size,
            **({"uncertainty": uncertainty.extra()} if uncertainty else {}),
        },
        tables={"simulated_runs": rows},
        validity={name: span([getattr(run, name) for run in good]) for name in SETTINGS},
        set_aside=[{"run": run.label, "why": "; ".join(e.problems)} for run, e in failed.items()],
        notes=(
            *([beyond] if outside else []),
            *guided_weight(config, *np.array([(p.point.beta, p.point.T_0) for p in good]).T),
            *notes,
        ),
        warnings=tuple(failures),
        verdict=f"{len(failed)} of {len(rows)} runs failed" if failed else "",
        passed=False if failed else None,
    )


def finished(results: Results) -> dict[PlannedRun, RunResult]:
    """Return the runs that succeeded."""
    return {run: result for run, result in results.items() if isinstance(result, RunResult)}


def rows_of_runs(results: Results) -> list[dict[str, Any]]:
    """Return a row per run: settings, sliding state, status."""
    return [
        {
            "run": run.label,
            **{name: getattr(run, name) for name in SETTINGS},
            **{name: getattr(result, name, None) for name in STATE},
            "status": "; ".join(getattr(result, "problems", ["ok"])),
        }
        for run, result in results.items()
    ]


def planned_runs(
    config: Config,
    friction: Columns | None = None,
    picked: Sequence[Sequence[float]] = ((), (), ()),
) -> tuple[PlannedRun, ...]:
    """Return the runs to simulate; `picked` are the wanted arcs, tensions, speeds (empty: all)."""
    measured = None if friction is None else measured_settings(friction, config)
    lists = setting_lists(config, measured)
    settings = list(product(*lists)) if measured is None else _at_measured(lists, measured)
    if not settings:
        keys = ", ".join(f"rig.{key}" for key in KEYS.values())
        raise InputError(f"no usable run has an arc, a tension at rest and a speed; state {keys}")
    problems, wanted = list[str](), []
    for option, values, of, gap in zip(
        ("--arc", "--tension", "--speed"), picked, lists, SAME_SETTING.values(), strict=True
    ):
        near = {value: _same_setting(np.array(of), value, gap) for value in values}
        problems += [
            f"{option} = {value:g}, must be one of those of the campaign: "
            f"{listed([f'{setting:.4g}' for setting in of])}"
            for value, found in near.items()
            if not found
        ]
        wanted.append({x for found in near.values() for x in found} or set(of))
    if problems:
        raise InputError(problems)
    return tuple(
        PlannedRun(f"S{k:03d}", *run)
        for k, run in enumerate(settings, start=1)
        if all(value in allowed for value, allowed in zip(run, wanted, strict=True))
    )


def _at_measured(lists: Sequence[Sequence[float]], measured: np.ndarray) -> list[tuple[float, ...]]:
    """Return the measured runs in the lists, and every combination with a setting of no run."""
    unmeasured = [set(values) - set(measured[:, k].tolist()) for k, values in enumerate(lists)]
    kept = np.all([np.isin(measured[:, k], values) for k, values in enumerate(lists)], axis=0)
    runs = set(map(tuple, measured[kept].tolist()))
    if any(unmeasured):
        runs |= {
            run
            for run in product(*lists)
            if any(value in new for value, new in zip(run, unmeasured, strict=True))
        }
    return sorted(runs, key=lambda run: [of.index(x) for of, x in zip(lists, run, strict=True)])


def measured_settings(friction: Columns, config: Config) -> np.ndarray:
    """Return the settings of the usable runs, each combination once, without small scatter."""
    settings = with_tensions(friction, config)
    rows = np.abs(np.column_stack([np.asarray(settings[name], dtype=float) for name in KEYS]))
    rows = rows[np.all((rows > 0.0) & np.isfinite(rows), axis=1) & ok_rows(friction)]
    snapped = [nominal_settings(rows[:, k], SAME_SETTING[name]) for k, name in enumerate(KEYS)]
    return np.unique(np.column_stack(snapped), axis=0)


def setting_lists(config: Config, measured: np.ndarray | None) -> list[list[float]]:
    """Return arcs, tensions and speeds: those stated, else those measured, else the defaults."""
    lists = []
    for k, (name, key) in enumerate(KEYS.items()):
        values = list(getattr(config.rig, key))
        if measured is not None:
            occurring, gap = np.unique(measured[:, k]), SAME_SETTING[name]
            near = (_same_setting(occurring, value, gap) or [value] for value in values)
            stated = key in config.rig.model_fields_set
            values = [x for found in near for x in found] if stated else occurring.tolist()
        lists.append(list(dict.fromkeys(values)))
    return lists


def _same_setting(values: np.ndarray, other: float, gap: float) -> list[float]:
    """Return the values that are the same setting as another one."""
    return values[np.abs(values - other) <= gap * values].tolist()


def refuse_running(config: Config) -> None:
    """Raise an error for a running belt, which no simulated rig has."""
    if config.rig.running:
        raise NotPossible(
            "a running belt has no simulated rig: only fit-friction and build-surface take it"
        )


def simulation_settings(
    config: Config, method: str | None = None, elements: int | None = None
) -> SimulationSettings:
    """Return the settings of the simulation from the call, else from the config."""
    return SimulationSettings(
        method=cast(Method, method or config.simulation.method),
        elements=config.simulation.elements if elements is None else elements,
        friction_solver=config.simulation.friction_solver,
    )


def bench_of(config: Config, surface: Any, law: Any) -> Bench:
    """Build the rig of a config with identified laws; a number for a surface is a constant mu."""
    refuse_running(config)
    return Bench(
        belt=config.belt_params(),
        rig=config.rig_params(),
        contact=config.contact_params(),
        law=law_from(law),
        surface=surface_from(surface),
    )


def simulate(
    bench: Bench, runs: Sequence[PlannedRun], settings: SimulationSettings, workers: Workers
) -> Results:
    """Simulate runs by workers, and report the progress; the results do not depend on them."""
    results: dict[PlannedRun, RunResult | BeltidError] = {}
    by_setting: dict[tuple[float, float], list[PlannedRun]] = {}
    for run in runs:
        by_setting.setdefault((run.arc_deg, run.initial_tension_N), []).append(run)
    belts = list(by_setting.values())
    calls = [(bench, [run.point for run in belt], settings) for belt in belts]
    for number, part in workers.as_ended(runs_of_one_belt, calls):
        results |= zip(belts[number], part, strict=True)
        progress("simulated runs", len(results), len(runs))
    return {run: results[run] for run in runs}


def guided_weight(config: Config, beta: np.ndarray, T_0: np.ndarray) -> list[str]:
    """Return a note on the assumed guidance of a dead weight and its effect; empty without one."""
    if config.rig.kind != "dead_weight":
        return []
    rig = config.rig_params()
    # a guided end adds the turn of the spans to the arc, a free one does not
    lower = 100.0 * np.max(Spans(config.belt_params().EI, rig.span).turn(T_0, rig.R) / beta)
    return [f"a dead weight that swings, not guided, makes mu lower by up to {percent(lower)}"]


def recording_columns(
    runs: Iterable[tuple[PlannedRun, RunResult]], config: Config
) -> dict[str, np.ndarray]:
    """Return the recordings of runs as one table with the columns of rig.csv."""
    parts = []
    for run, result in runs:
        recorded = result.recording or _two_levels(run, result, config)
        n = len(recorded["time_s"])
        of_run = {
            **recorded,
            "run": np.full(n, run.label, dtype=object),
            "temperature_degC": np.full(n, np.nan),
            "arc_deg": np.full(n, run.arc_deg),
            "initial_tension_N": np.full(n, run.initial_tension_N),
        }
        parts.append({name: of_run[name] for name in schemas.table("simulated").names})
    return joined(parts)


def _two_levels(run: PlannedRun, result: RunResult, config: Config) -> dict[str, np.ndarray]:
    """Return a recording with two levels, at rest and sliding, for a known sliding limit."""
    omega, T_0, n = run.pulley_speed_rad_s, run.initial_tension_N, REST_SAMPLES + SLIDING_SAMPLES
    turning = np.arange(n) >= REST_SAMPLES
    return {
        "time_s": np.arange(n) * (TRAVEL_PER_SAMPLE_M / (omega * config.rig.pulley_radius_m)),
        "tension_tight_N": np.where(turning, result.tension_tight_N, T_0),
        "tension_slack_N": np.where(turning, result.tension_slack_N, T_0),
        "pulley_speed_rad_s": np.where(turning, omega, 0.0),
    }


def _uncertainty(
    good: Mapping[PlannedRun, RunResult],
    bench: Bench,
    config: Config,
    press: PressLaw,
    stored: Mapping[str, Any],
    workers: Workers,
) -> tuple[RunsUncertainty | None, list[str]]:
    """Return the uncertainty of simulated runs; a note if it stays unknown."""
    numbers, arcs = numbered_arcs([run.arc_deg for run in good], stored.get("arcs_deg", ()))
    sources = with_sources(
        [Source(**row) for row in stored.get("sources", ())],
        stated_sources(standard_uncertainties(config), SURFACE, len(arcs)),
    )
    points, kind, calls = [run.point for run in good], rig_kind(config), []
    tensions = np.array([(run.tension_tight_N, run.tension_slack_N) for run in good.values()]).T
    for piece in (slice(i, i + PER_CALL) for i in range(0, len(points), PER_CALL)):
        runs = simulated_runs(bench, points[piece], numbers[piece], kind, tensions[:, piece])
        calls.append((Campaign(runs, bench, press), sources, config.simulation.elements))
    try:
        parts = workers.run(simulated_uncertainty, calls)
        return RunsUncertainty.joined(parts, [run.label for run in good]), []
    except BeltidError as error:
        return None, [f"uncertainty of the simulated runs is not known: {error.problems[0]}"]


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRun:
    """One run of the simulated rig."""

    settings: PlannedRun  # arc, initial tension, pulley speed
    result: RunResult  # all results of the simulation as plain arrays
    config: Config
    tension_tight_N: float  # support force of the tight span while sliding [N]
    tension_slack_N: float  # support force of the slack span while sliding [N]
    mu: float  # friction coefficient by Eq. (6) from these tensions [-]
    normal_force_N_m: float  # mean normal force per length by Eq. (8) [N/m]

    @property
    def recording(self) -> pd.DataFrame | None:
        """The run over time with the columns of rig.csv; None for the steady method."""
        if self.result.recording is None:
            return None
        return as_frame(recording_columns([(self.settings, self.result)], self.config))

    @property
    def profile(self) -> pd.DataFrame:
        """The sliding state along the arc."""
        return pd.DataFrame(self.result.profile)

    def __repr__(self) -> str:
        shown = [(self.settings, name) for name in SETTINGS] + [(self, name) for name in STATE]
        return f"SimulatedRun({', '.join(f'{n}={getattr(of, n):.6g}' for of, n in shown)})"


def simulate_rig(
    config: Config | Mapping[str, Any] | str | Path | None,
    surface: FrictionSurface | Outcome[Any] | float,
    law: NormalLaw | Outcome[Any],
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
    surface : FrictionSurface, Outcome of build_surface or refine_surface, or float
        Friction coefficient; a number is a constant coefficient.
    law : NormalLaw or Outcome of fit_stiffness
        Normal contact law.
    arc_deg : float
        Contact arc [°], in (0, 360); it need not be in the config.
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
    stated = {
        "arcs_deg": [arc_deg],
        "initial_tensions_N": [initial_tension_N],
        "pulley_speeds_rad_s": [pulley_speed_rad_s],
    }
    rig = load_config({"rig": stated, "simulation": {"elements": elements}}).rig
    run = PlannedRun("S001", *rig.arcs_deg, *rig.initial_tensions_N, *rig.pulley_speeds_rad_s)
    settings, bench = simulation_settings(model, method, elements), bench_of(model, surface, law)
    result = simulate(bench, [run], settings, Workers())[run]
    if isinstance(result, BeltidError):
        raise result
    return SimulatedRun(run, result, model, *(float(getattr(result, name)) for name in STATE))


def simulate_campaign(
    config: Config | Mapping[str, Any] | str | Path | None,
    surface: FrictionSurface | Outcome[Any] | float,
    law: NormalLaw | Outcome[Any],
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
        As for `simulate_rig`.
    jobs : int or None
        Number of parallel runs; None is one per core. The result does not depend on it.
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping, optional
        The reduced runs of the bench, which are simulated unless the config states the settings of
        the rig; without them all combinations of the config are simulated.

    Returns
    -------
    DataFrame
        A row per run: run, arc_deg, initial_tension_N, pulley_speed_rad_s, tension_tight_N,
        tension_slack_N, mu, normal_force_N_m, status ("ok", or why it failed).
    """
    model = as_measured(load_config(config), friction)
    measured = None if friction is None else friction_columns(friction, tuple(KEYS))
    results = simulate(
        bench_of(model, surface, law),
        planned_runs(model, measured),
        simulation_settings(model, method, elements),
        threads(jobs),
    )
    return pd.DataFrame(rows_of_runs(results)).astype(dict.fromkeys(STATE, float))
