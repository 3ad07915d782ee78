"""beltid simulate-rig: the friction rig on the computer (paper Eqs. 9 to 12)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from beltid.artifacts.artifact import read_artifact
from beltid.artifacts.metadata_models import SimulatedMetadata
from beltid.config import Config, ConfigSource
from beltid.errors import EXIT_DONE, EXIT_NUMERICS, NumericsError, counted, percent
from beltid.report.summary import Summary
from beltid.rigsim.kernel_cache import COMPILING, compile_ahead
from beltid.rigsim.rig import SimulationSettings
from beltid.stages.build_artifact import Build, Built
from beltid.stages.outcome import Outcome
from beltid.stages.reporter import Options
from beltid.stages.simulation.campaign import (
    guided_weight,
    recording_columns,
    simulation_settings,
    sliding_samples,
    solver_record,
)
from beltid.stages.simulation.planned_runs import (
    Picked,
    differing_settings,
    measured_settings,
    planned_runs,
)
from beltid.stages.simulation.simulated_runs import (
    PROFILES,
    Campaign,
    Inputs,
    path_beside,
    profiles_outcome,
    runs_uncertainty,
    simulate,
)
from beltid.stages.tables import friction_of, law_of, surface_of
from beltid.stages.uncertainties import SECTION, press_law
from beltid.stages.workers import Workers
from beltid.uncertainty.simulated import RunsUncertainty

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
    "rig.kind",
    "rig.weight_on",
    "rig.torque_with",
    "rig.running_measures",
    "rig.belt_speed_m_s",
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


def run(
    config: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    options: Options,
    *,
    picked: Picked | None = None,
    method: str | None = None,
    elements: int | None = None,
    jobs: int | None = None,
    profile_times_s: Sequence[float] = (),
) -> Summary:
    """Simulate the runs with ``surface`` and ``stiffness``, write the recording, sum it up.

    The runs are those of ``friction``, where it is given or stands beside the surface that was made
    from it; otherwise those of the config; only those `picked`, if any are. Method and number of
    beam elements are those of the config, if not stated. Where no workers are given, `jobs` runs
    are simulated at the same time; None is one per core.

    Profiles of the contact go beside the recording if times for them are given, after the start of
    rotation [s].
    """
    model, times = config.config, tuple(sorted(set(profile_times_s)))
    settings = simulation_settings(model, method, elements, times)
    inputs = _with_friction(inputs)
    measured = None
    if "friction" in inputs:
        measured = measured_settings(read_artifact(inputs["friction"], "friction").columns)
    runs = planned_runs(model, picked or Picked(), measured)
    choices: dict[str, Any] = {
        "method": settings.method,
        "elements": settings.elements,
        "runs": [[r.label, r.arc_deg, r.initial_tension_N, r.pulley_speed_rad_s] for r in runs],
    }
    if settings.method == "steady":
        choices["sliding_samples"] = sliding_samples(model)
    build = Build(KIND, config, KEYS, inputs, out, options, choices, FIGURES)
    of_profiles = Build(
        PROFILES,
        config,
        KEYS,
        inputs,
        path_beside(out),
        options,
        {**choices, "profile_times_s": list(times)},
    )
    contacts = of_profiles.up_to_date() if times else None
    built = build.up_to_date()
    if built is None or (times and contacts is None):
        given = _inputs(inputs, model)
        differing = differing_settings(model, measured)
        for line in differing:
            options.reporter.warn(line)
        stated = measured is None or differing
        whose = "as the config states" if stated else "at the settings measured"
        count = counted(len(runs), "run")
        options.reporter.report(f"{count}, {settings.method}, {whose}")
        if compile_ahead(["rigsim"]):
            options.reporter.report(COMPILING)
        campaign = simulate(
            model,
            (given.surface, given.press.law),
            runs,
            settings,
            options.workers or jobs,
            options.reporter,
        )
        _refuse_nothing(campaign)
        if built is None:
            workers = options.workers or Workers()
            uncertainty = runs_uncertainty(
                campaign.finished, given, model, settings.elements, workers
            )
            built = build.write(_outcome(campaign, model, settings, uncertainty))
        if times and contacts is None:
            contacts = of_profiles.write(profiles_outcome(campaign, times))
    return summarise(built, contacts)


def _with_friction(inputs: Mapping[str, Path]) -> Mapping[str, Path]:
    """The inputs, with the reduced runs beside the surface that was made from them."""
    if "friction" in inputs:
        return inputs
    path = inputs["surface"]
    friction = friction_of(read_artifact(path, "surface"), path.parent)
    return inputs if friction is None else {**inputs, "friction": friction.path}


def _inputs(inputs: Mapping[str, Path], config: Config) -> Inputs:
    """Surface and normal law to simulate with, and what is known of their uncertainty."""
    surface = read_artifact(inputs["surface"], "surface")
    stiffness = read_artifact(inputs["stiffness"], "stiffness")
    return Inputs(
        surface_of(surface),
        surface.metadata.uncertainty or {},
        press_law(law_of(stiffness), config, stiffness),
    )


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
    uncertainty: tuple[RunsUncertainty | None, tuple[str, ...]],
) -> Outcome[Campaign]:
    runs, results = zip(*done.finished, strict=True)
    records = {run.label: solver_record(result) for run, result in done.finished}
    rows = [{**row, "solver": records.get(row["run"])} for row in done.rows()]
    outside = sum(int(record["clamped_lookups"]) for record in records.values())
    points = sum(int(record["lookups"]) for record in records.values())
    notes = []
    if outside:
        notes.append(
            f"{percent(100 * outside / points)} of the sliding contact points lie outside the "
            "measured range of the surface: the nearest measured value was taken"
        )
    notes += guided_weight(config, [run.point for run in runs])
    if config.rig.kind == "running":
        notes.append(
            "a running belt is simulated at rest: the tensions of the table are those that press "
            "it onto the pulley; the recording holds the whole ones"
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
            **({"uncertainty": uncertainty[0].extra()} if uncertainty[0] else {}),
        },
        notes=(*notes, *uncertainty[1]),
        warnings=tuple(_failures(done)),
    )


def summarise(built: Built, of_profiles: Built | None = None) -> Summary:
    """Sum up a simulated recording, and the profiles beside it."""
    metadata: SimulatedMetadata = built.artifact.metadata
    runs = metadata.runs or ()
    rows: list[dict[str, Any]] = [{name: row.get(name) for name in ROW} for row in runs]
    good = [row for row in rows if row["status"] == "ok"]
    failed = len(rows) - len(good)
    beside = {} if of_profiles is None else {"profiles": str(of_profiles.artifact.path)}
    return built.summary(
        "simulate-rig",
        "friction coefficient of every simulated run, sliding",
        facts={
            "method": metadata.method,
            "runs": len(rows),
            "runs_failed": failed,
            "samples": len(built.artifact.columns["time_s"]),
            "mu_range": (min(row["mu"] for row in good), max(row["mu"] for row in good)),
            **beside,
        },
        table=rows,
        overview=_per_setting(good) if len(rows) > 20 else [],
        details={"solver": [_solver_row(row) for row in runs if row.get("solver")]},
        notes=(*built.notes, *(of_profiles.notes if of_profiles else ())),
        verdict=f"{failed} of {len(rows)} runs failed" if failed else "",
        exit_status=EXIT_NUMERICS if failed else EXIT_DONE,
        up_to_date=built.up_to_date and (of_profiles is None or of_profiles.up_to_date),
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
