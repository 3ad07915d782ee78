"""Measured against simulated: friction coefficients (section 4), runs left out, losses of a drive.

The simulated recording passes the same function that reduced the measured one, with the radius
stored in the friction artifact. Only the load cells differ: those of the simulated rig are perfect,
those of a second bench are as the config states.

Runs left out are simulated at their measured tension and speed, in the sliding limit, with a
surface of the others, whose uncertainty becomes that of the prediction, as in `simulate-rig`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd

from beltid.bench.raw import frame_of
from beltid.bench.recording import Recording, recording_in
from beltid.config import Config
from beltid.drive.results import ADHESION, FULL_SLIP, MOST_OF_ARC, RESOLVED, compare_losses
from beltid.errors import InputError, counted
from beltid.identify.agreement import (
    AgreementResult,
    Fold,
    between_speeds,
    compare_points,
    folds,
    statistics,
)
from beltid.identify.slip import GROSS_SLIP, OK
from beltid.notes import log
from beltid.refine.inverse import refine_surface
from beltid.refine.posterior import SPEED_BEND
from beltid.report.summary import rows_of
from beltid.stage import Outcome
from beltid.stages.friction import reduce_rig, reduction_columns
from beltid.stages.inputs import Columns, friction_columns, press_law, span, with_tensions
from beltid.stages.surface import (
    NEEDED,
    prepared_campaign,
    reference_temperature,
    rig_of_runs,
    usable_runs,
)
from beltid.stages.workers import Workers
from beltid.store.artifact import Artifact
from beltid.uncertainty.measured import PressLaw, measured_runs, numbered_arcs
from beltid.uncertainty.simulated import (
    RunsUncertainty,
    dominant,
    runs_uncertainty_of,
    simulated_uncertainty,
    validated,
)
from beltid.uncertainty.sources import ARC, BETWEEN_SPEEDS, reduction_sources, with_sources

SETTINGS = ("run", "arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m")
COMPARED = (*SETTINGS, "mu_sliding")
HELD_OUT = (*NEEDED, "nominal_tension_N", "pulley_speed_rad_s")
ENOUGH = 0.8  # share of the usable measured runs below which a comparison is one of few runs
MIN_SHARE_COMPARED = 0.5  # share of compared runs below which the campaign fails


def compared(friction: Any, simulated: Any, config: Config) -> Outcome[AgreementResult]:
    """Compare run by run; the simulated runs are a recording, reduced runs, or a campaign."""
    return agreement(
        friction_columns(friction, COMPARED),
        _reduced(simulated, friction, config),
        config,
        runs_uncertainty_of(simulated.facts) if isinstance(simulated, Artifact) else None,
    )


def _reduced(simulated: Any, friction: Any, config: Config) -> Columns:
    """Return the simulated runs, reduced like the measured ones."""
    if isinstance(friction, Artifact) and "rig" in friction.record.settings:
        radius = {"pulley_radius_m": float(friction.record.settings["rig"]["pulley_radius_m"])}
        config = config.model_copy(update={"rig": config.rig.model_copy(update=radius)})
    if isinstance(simulated, Recording):  # of a second bench
        return reduction_columns(reduce_rig(simulated, config))
    is_result = isinstance(simulated, (Outcome, Artifact))
    if is_result and simulated.kind != "simulated":
        return friction_columns(simulated, COMPARED, "simulated")
    frame = frame_of(simulated.columns if is_result else simulated, "simulated").frame
    if "time_s" in frame:
        simulated = replace(recording_in(frame, "rig"), is_artifact=True)  # from perfect cells
        return reduction_columns(reduce_rig(simulated, config))
    if "mu" in frame and "mu_sliding" not in frame:  # the table of a simulated campaign
        frame = frame.assign(mu_sliding=frame["mu"], nominal_tension_N=frame["initial_tension_N"])
    return friction_columns(frame, COMPARED, "simulated")


def agreement(
    measured: Columns,
    simulated: Columns,
    config: Config,
    uncertainty: RunsUncertainty | None = None,
) -> Outcome[AgreementResult]:
    """Compare two tables of reduced runs, and judge the differences by the tolerances."""
    measured, simulated = with_tensions(measured, config), with_tensions(simulated, config)
    tolerances = {**config.compare.model_dump(), "min_share_compared": MIN_SHARE_COMPARED}
    result, columns, budget, facts, notes = validated(
        compare_points(measured, simulated, tolerances), measured, simulated, uncertainty
    )
    n = len(result.columns["run"])
    warnings = [
        f"{counted(count, 'run')} not compared: {why}" for why, count in result.not_compared.items()
    ]
    if n < ENOUGH * result.n_usable:
        warnings.insert(
            0,
            f"only {n} of {result.n_usable} measured runs were compared: the verdict holds for "
            "these only",
        )
    return Outcome(
        result.columns | columns | {"status": np.full(n, OK, dtype=object)},
        result,
        facts={
            "runs_compared": n,
            "runs_measured": len(measured["run"]),
            "runs_simulated": len(simulated["run"]),
            "within_two_u_validation": f"{facts['within_2u']} of {n} runs",
            "rms_over_u_validation": facts["rms_e_over_u"],
            "u_validation_mostly_from": dominant(budget),
            "validation": facts,
        },
        tables={
            "groups": list(result.groups),
            "judged": list(result.judged),
            "averaged": rows_of(result.averaged),
            "budget": budget,
        },
        validity={"normal_force_N_m": span(result.columns["normal_force_N_m"])},
        set_aside=[{"run": run, "why": why} for run, why in result.not_compared_runs],
        notes=tuple(filter(None, (*notes, result.against_uncertainty))),
        warnings=tuple(warnings),
        verdict=result.verdict,
        passed=bool(result.passed),
    )


def predicted_runs(
    friction: Any, law: Any, config: Config, by: str, workers: Workers
) -> Outcome[AgreementResult]:
    """Predict the runs of every arc or speed from the others, and compare them."""
    columns = with_tensions(friction_columns(friction, HELD_OUT), config)
    log.info("every %s left out once and predicted", by)
    press = press_law(law, config)
    usable, _ = usable_runs(columns, rig_of_runs(columns, config))
    left_out = folds(columns, usable, by)
    calls = [(columns, press, config, fold) for fold in left_out]
    parts, beyond, warnings = zip(*workers.run(predict, calls), strict=True)
    rows = np.concatenate([fold.left_out for fold in left_out])
    measured = {name: values[rows] for name, values in columns.items()}
    # both sides are of one bench and have the same settings: its errors are none of the difference,
    # unlike effects and an interpolation, which the predicted runs have for themselves
    uncertainty = RunsUncertainty.joined(parts, measured["run"])
    simulated = {**{name: measured[name] for name in SETTINGS}, "mu_sliding": uncertainty.mu}
    outcome = agreement(measured, simulated, config, uncertainty)
    groups, notes = [*outcome.tables["groups"]], [*outcome.notes]
    if by == "speed":
        found, ends = outcome.result.columns, np.cumsum([fold.left_out.size for fold in left_out])
        for fold, end in zip(left_out, ends, strict=True):
            of_fold = slice(end - fold.left_out.size, end)
            difference = found["relative_difference"][of_fold]
            groups.append(statistics(fold.name, difference, found["normal_force_N_m"][of_fold]))
    elif not all(any(source.error == ARC for source in part.sources) for part in parts):
        notes.insert(
            0, "a single arc was left: the uncertainty does not include how much arcs differ"
        )
    if any(beyond):
        of_all = f"{sum(beyond)} of {rows.size} runs"
        notes.insert(0, f"nearest value used: {of_all} have a mean force that no other has")
    return replace(
        outcome,
        facts={"hold_out": by, **outcome.facts},
        tables={**outcome.tables, "groups": groups},
        notes=tuple(notes),
        warnings=(*outcome.warnings, *chain(*warnings)),
    )


def predict(
    columns: Columns, press: PressLaw, config: Config, fold: Fold
) -> tuple[RunsUncertainty, int, list[str]]:
    """Refine the surface from the remaining runs and simulate the runs left out.

    Returns their coefficients with the uncertainty by source, the number of those whose mean force
    no other run reached, and warnings.
    """
    remaining = {name: values[fold.rest] for name, values in columns.items()}
    campaign, speeds, _, _ = prepared_campaign(remaining, press, config, {})
    rig, rest = campaign.bench.rig, campaign.measured
    solution = refine_surface(
        campaign, speeds, reduction_sources(rest.columns), reference_temperature(config, campaign)
    )
    surface = solution.surface
    measured = measured_runs(columns, fold.left_out, rig.R, rest.kind, rig.given_force)
    arcs, _ = numbered_arcs(columns["arc_deg"][fold.left_out], rest.arcs_deg)
    # an unseen arc has its own effect, with the same variance as the others
    places = range(int(max(arcs.max(), rest.arc.max())) + 1)
    arc_sources = [source for source in solution.uncertainty.sources if source.error == ARC][:1]
    of_arcs = [replace(source, place=k) for source in arc_sources for k in places]
    sources = with_sources(solution.uncertainty.sources, of_arcs)
    of_fold = replace(
        campaign,
        measured=replace(measured, arc=arcs),
        bench=replace(campaign.bench, surface=surface),
    )
    part = simulated_uncertainty(of_fold, sources, same_bench=True)
    if fold.by == "speed":
        missed = between_speeds(
            np.log(surface.slip_speed_m_s),
            np.log(surface.mu_nodes).mean(axis=0),
            np.log(measured.slip_speed),
            SPEED_BEND**2,
        )[:, None]
        part = replace(
            part,
            sources=(*sources, replace(BETWEEN_SPEEDS, place=int(fold.left_out[0]))),
            simulated=np.hstack([part.simulated, missed]),
            difference=np.hstack([part.difference, missed]),
        )
    force, left_out = rest.normal_force, columns["normal_force_N_m"][fold.left_out]
    beyond = np.count_nonzero((left_out < force.min()) | (left_out > force.max()))
    return part, int(beyond), [f"without {fold.name}: {line}" for line in solution.warnings]


def compared_losses(slip: Any, drive: Any, config: Config) -> Outcome[dict[str, Any]]:
    """Compare every run of a drive with its prediction, and judge those of enough torque."""
    measured, table = slip.columns, _predicted(slip, drive)
    at_idle = table["speed_rad_s"].abs() + table["speed_loss_rad_s"]
    ratio = table["driver_speed_rad_s"].abs() / at_idle.where(at_idle > 0.0)
    loss = measured["speed_loss_rad_s"]
    # Eq. (7): the standard error of the loss is that of the sliding speed over R
    radius = np.nanmedian(measured["slip_speed_m_s"][loss != 0.0] / loss[loss != 0.0])
    points = {
        **{name: measured[name] for name in ("run", "driver_speed_rad_s", "initial_tension_N")},
        "torque_N_m": measured["torque_N_m"],
        "loss_predicted_rad_s": (table["speed_loss_rad_s"] * ratio).to_numpy(),
        "u_input_rad_s": (table["speed_loss_u_rad_s"] * ratio).to_numpy(),
        **{
            f"loss_{part}_rad_s": (table[f"loss_{part}_rad_s"] * ratio).to_numpy()
            for part in ("creep", "seating", "slip")
        },
        "loss_measured_rad_s": loss,
        "u_measured_rad_s": measured["slip_speed_se_m_s"] / radius,
        "arc_share": table["arc_share"].to_numpy(),
    }
    allowed = config.compare_drive.max_rms_relative_error
    columns, facts, passed = compare_losses(
        points, measured["status"] == OK, allowed, config.compare_drive.min_torque_share
    )
    judged, of_prediction = columns["judged"], table["status"].fillna("no steady state")
    status = np.array(list(map(_status, measured["status"], of_prediction)), dtype=object)
    status[(status == OK) & ~judged] = "torque too small to be judged"
    return Outcome(
        {**points, **columns, "status": status},
        facts,
        facts=facts,
        validity={"torque_N_m": span(measured["torque_N_m"][judged])},
        set_aside=[
            {"run": str(run), "why": str(why)}
            for run, why in zip(measured["run"], status, strict=True)
            if why != OK
        ],
        notes=tuple(_statements(facts)),
        verdict=_verdict(facts, passed, 100.0 * allowed),
        passed=passed,
    )


def _predicted(slip: Any, drive: Any) -> pd.DataFrame:
    """Return the rows of the loaded pulley for the measured runs, missing if not predicted."""
    loaded, name = drive.facts.get("loaded_pulley"), getattr(drive, "path", "drive")
    if loaded is None:
        raise InputError(
            f"{name}: its points do not come from a recording; predict those of the recording with "
            "beltid simulate-drive --from"
        )
    table, runs = pd.DataFrame(drive.columns), slip.columns["run"]
    rows = table[table["pulley"] == loaded].set_index("run")
    if not rows.index.isin(runs).any():
        raise InputError(f"{name}: has none of the runs of {getattr(slip, 'path', 'slip')}")
    # that of the arc that slides most, over all pulleys
    shares = (table["arc_used_deg"] / table["wrap_deg"]).groupby(table["run"]).max()
    return rows.reindex(runs).assign(arc_share=shares)


def _status(measured: str, predicted: str) -> str:
    """Return "ok", or why a point cannot be judged."""
    if measured == GROSS_SLIP:
        return f"{GROSS_SLIP} on the bench (predicted: {predicted})"
    if measured != OK:
        return measured
    return OK if predicted in (ADHESION, FULL_SLIP) else f"predicted: {predicted}"


def _statements(facts: Mapping[str, Any]) -> Iterator[str]:
    """State what the recording tests and what it does not test."""
    sliding, sizes = facts["largest_arc_share"], facts["prominence"]
    share = f"{100.0 * sliding:.0f} % of an arc slides"
    words = {name: f"{name} ({size:.1f} standard uncertainties)" for name, size in sizes.items()}
    seen = [words.pop(name) for name, size in sizes.items() if size > RESOLVED]
    more = f"; too small to be seen in it: {', '.join(words.values())}" if words else ""
    yield f"parts of the loss that this recording can test: {', '.join(seen) or 'none'}{more}"
    if sliding <= MOST_OF_ARC:
        yield f"friction is not tested: at most {share}"
    elif sizes["slip"] <= RESOLVED:
        yield f"up to {share}: friction carries the torques, but how large it is stays open"
    else:
        yield f"up to {share}: friction is tested by the points in full slip"
    yield "belt.axial_stiffness_N must not come from this recording: agreement would be no test"


def _verdict(facts: Mapping[str, Any], passed: bool, allowed_percent: float) -> str:
    word, rms = "PASS" if passed else "FAIL", 100.0 * facts["rms_relative_error"]
    if not np.isfinite(rms):
        return f"{word}: no point could be judged"
    text = (
        f"{word}: RMS {rms:.2f} % {'<=' if rms <= allowed_percent else '>'} {allowed_percent:g} %"
    )
    if np.isfinite(facts["rms_over_uncertainty"]):
        text += f", {facts['rms_over_uncertainty']:.2f} standard uncertainties"
    missing = facts["points_to_be_judged"] - facts["points_judged"]
    return text + (f"; {missing} points have no prediction" if missing else "")
