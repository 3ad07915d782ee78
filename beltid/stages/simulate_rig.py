"""beltid simulate-rig: the friction rig on the computer (paper Eqs. 9 to 12)."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

from beltid.artifacts.artifact import read_artifact
from beltid.artifacts.metadata_models import SimulatedMetadata
from beltid.config import Config, ConfigSource
from beltid.errors import EXIT_DONE, EXIT_NUMERICS, NumericsError
from beltid.report.summary import Summary
from beltid.rigsim.rig import SimulationSettings
from beltid.stages import profiles
from beltid.stages.campaign import (
    Picked,
    planned_runs,
    recording_columns,
    simulation_settings,
    sliding_samples,
    solver_record,
)
from beltid.stages.making import Made, Recipe, admit, make
from beltid.stages.outcome import Outcome
from beltid.stages.simulated_doubt import Inputs, RunsDoubt, runs_doubt
from beltid.stages.simulated_runs import Campaign, simulate
from beltid.stages.tables import law_of, surface_of
from beltid.stages.talk import Options
from beltid.stages.uncertainties import SECTION, press_law, stated_keys
from beltid.stages.workers import Workers

KIND: Final = "simulated"
FIGURES: Final = ("method", "runs")
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
    "press.segment_length_cm",
    SECTION,
)
SHOWN_FAILURES: Final = 20
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
    profile_times_s : tuple of float
        Times after the start of rotation at which the contact along the arc is kept [s].
    """

    method: str | None = None
    arcs_deg: tuple[float, ...] = ()
    tensions_N: tuple[float, ...] = ()
    speeds_rad_s: tuple[float, ...] = ()
    elements: int | None = None
    jobs: int | None = None
    profile_times_s: tuple[float, ...] = ()


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Simulate the runs with ``surface`` and ``stiffness``, write the recording, sum it up.

    Profiles of the contact go beside the recording if times for them are given.
    """
    chosen = options if isinstance(options, SimulateOptions) else _with_defaults(options)
    model, times = config.config, tuple(sorted(set(chosen.profile_times_s)))
    settings = simulation_settings(model, chosen.method, chosen.elements, times)
    runs = planned_runs(model, Picked(chosen.arcs_deg, chosen.tensions_N, chosen.speeds_rad_s))

    @functools.cache
    def given() -> Inputs:
        surface = read_artifact(inputs["surface"], "surface")
        stiffness = read_artifact(inputs["stiffness"], "stiffness")
        return Inputs(
            surface_of(surface),
            surface.metadata.uncertainty or {},
            press_law(law_of(stiffness), model, stiffness),
        )

    @functools.cache
    def campaign() -> Campaign:
        laws = given().surface, given().press.law
        options.talk.say(f"{len(runs)} runs, {settings.method}")
        how = options.talk, options.workers or chosen.jobs
        return simulate(model, laws, runs, settings, how)

    def compute() -> Outcome[Campaign]:
        done = campaign()
        _refuse_nothing(done)
        workers = options.workers or Workers()
        doubt = runs_doubt(done.finished, given(), model, settings.elements, workers)
        return _outcome(done, model, settings, doubt)

    choices: dict[str, Any] = {
        "method": settings.method,
        "elements": settings.elements,
        "runs": [[r.label, r.arc_deg, r.initial_tension_N, r.pulley_speed_rad_s] for r in runs],
        "uncertainty_stated": stated_keys(model),
    }
    if settings.method == "steady":
        choices["sliding_samples"] = sliding_samples(model)
    recipe = Recipe(KIND, config, KEYS, inputs, choices, FIGURES)
    of_profiles = replace(
        recipe,
        kind=profiles.KIND,
        choices={**choices, "profile_times_s": list(times)},
        figures=(),
    )
    beside = profiles.path_beside(out)
    if times:  # what stands in the way is said before the work
        admit(of_profiles, beside, options)
    made = make(recipe, out, options, compute)
    if not times:
        return summarise(made)
    more = make(of_profiles, beside, options, lambda: profiles.profiles_outcome(campaign(), times))
    return summarise(made, more)


def _with_defaults(options: Options) -> SimulateOptions:
    return SimulateOptions(**{f.name: getattr(options, f.name) for f in fields(Options)})


def _failures(done: Campaign) -> list[str]:
    return [f"run {run.label}: {line}" for run, e in done.failures for line in e.problems]


def _refuse_nothing(done: Campaign) -> None:
    """A campaign without a single result is a failure."""
    if not done.finished:
        failures = _failures(done)
        more = len(failures) - SHOWN_FAILURES
        raise NumericsError(
            [*failures[:SHOWN_FAILURES], *([f"and {more} more"] if more > 0 else [])]
        )


def _outcome(
    done: Campaign,
    config: Config,
    settings: SimulationSettings,
    doubt: tuple[RunsDoubt | None, tuple[str, ...]],
) -> Outcome[Campaign]:
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
            **({"uncertainty": doubt[0].extra()} if doubt[0] else {}),
        },
        notes=(*notes, *doubt[1]),
        warnings=tuple(_failures(done)),
    )


def summarise(made: Made, of_profiles: Made | None = None) -> Summary:
    """Sum up a simulated recording, and the profiles beside it."""
    metadata: SimulatedMetadata = made.artifact.metadata
    runs = metadata.runs or ()
    rows: list[dict[str, Any]] = [{name: row.get(name) for name in ROW} for row in runs]
    good = [row for row in rows if row["status"] == "ok"]
    failed = len(rows) - len(good)
    beside = {} if of_profiles is None else {"profiles": str(of_profiles.artifact.path)}
    return Summary(
        stage="simulate-rig",
        title="friction coefficient of every simulated run, sliding",
        out=made.artifact.path,
        facts={
            "method": metadata.method,
            "runs": len(rows),
            "runs_failed": failed,
            "samples": len(made.artifact.columns["time_s"]),
            "mu_range": (min(row["mu"] for row in good), max(row["mu"] for row in good)),
            **beside,
        },
        table=rows,
        overview=_per_setting(good) if len(rows) > 20 else [],
        details={"solver": [_solver_row(row) for row in runs if row.get("solver")]},
        notes=(*made.notes, *(of_profiles.notes if of_profiles else ())),
        warnings=made.warnings,
        verdict=f"{failed} of {len(rows)} runs failed" if failed else "",
        exit_status=EXIT_NUMERICS if failed else EXIT_DONE,
        up_to_date=made.up_to_date and (of_profiles is None or of_profiles.up_to_date),
        origin=made.origin,
    )


def _solver_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """What the solver did in a run; look-ups beyond the measured range as a share of all."""
    record = row["solver"]
    share = record["clamped_lookups"] / max(record["lookups"], 1)
    return {
        "run": row.get("run"),
        **{name: record[name] for name in SHOWN_OF_SOLVER},
        "clamped_lookups_percent": 100.0 * share,
    }


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
