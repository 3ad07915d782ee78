"""Cross-validation: the runs of each arc or speed, predicted by a surface of the others.

A left-out run is simulated at its measured tension and speed, in the sliding limit. The uncertainty
of the prediction comes from the surface of the remaining runs, as in `simulate-rig`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.identify.agreement import AgreementResult, Fold, Statistics, between_speeds, folds
from beltid.notes import log
from beltid.refine.inverse import refine_surface
from beltid.refine.posterior import SPEED_BEND
from beltid.stage import Outcome
from beltid.stages.compare import agreement
from beltid.stages.inputs import friction_columns, press_law
from beltid.stages.planned_runs import with_tensions
from beltid.stages.refine import (
    NEEDED,
    prepared_campaign,
    reference_temperature,
    rig_of_runs,
    usable_runs,
    with_covariance,
)
from beltid.stages.workers import Workers
from beltid.uncertainty.measured import PressLaw, measured_runs, numbered_arcs
from beltid.uncertainty.simulated import RunsUncertainty, simulated_uncertainty
from beltid.uncertainty.sources import (
    ARC,
    BETWEEN_SPEEDS,
    Source,
    reduction_sources,
    with_rig_sources,
)

SETTINGS: Final = ("arc_deg", "nominal_tension_N", "pulley_speed_rad_s")
HELD_OUT: Final = (*NEEDED, "nominal_tension_N", "pulley_speed_rad_s")
"""Columns of the friction table that a prediction needs."""
Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True)
class Predicted:
    """The predicted runs of one fold."""

    fold: Fold
    part: RunsUncertainty
    """The predicted coefficients and their uncertainty by source."""
    beyond: int
    """Number of predicted runs whose mean force no other run reached."""
    warnings: tuple[str, ...] = ()


def predicted_runs(
    friction: Any, law: Any, config: Config, by: str, workers: Workers
) -> Outcome[AgreementResult]:
    """Predict the runs of every arc or speed from the others, and compare them."""
    columns = with_tensions(friction_columns(friction, HELD_OUT), config)
    log.info("every %s left out once and predicted", by)
    press = press_law(law, config)
    usable, _ = usable_runs(columns, rig_of_runs(columns, config))
    flat = {name: values for name, values in columns.items() if values.ndim == 1}
    calls = [(flat, press, config, fold) for fold in folds(columns, usable, by)]
    found = dict(workers.as_ended(predict, calls))
    predicted = [found[k] for k in range(len(calls))]
    rows = np.concatenate([prediction.fold.left_out for prediction in predicted])
    measured = {name: values[rows] for name, values in columns.items()}
    simulated, uncertainty = as_simulated(columns, predicted)
    outcome = agreement(measured, simulated, config, uncertainty)
    groups = outcome.tables["groups"]
    if by == "speed":
        result = outcome.result
        ends = np.cumsum([p.fold.left_out.size for p in predicted])[:-1]
        of_folds = (
            np.split(x, ends) for x in (result.relative_difference, result.normal_force_N_m)
        )
        groups = [
            *groups,
            *(
                Statistics.of(p.fold.name, *values).as_row()
                for p, *values in zip(predicted, *of_folds, strict=True)
            ),
        ]
    return replace(
        outcome,
        facts={"hold_out": by, **outcome.facts},
        tables={**outcome.tables, "groups": groups},
        notes=(*_notes(predicted, by), *outcome.notes),
        warnings=(*outcome.warnings, *(line for p in predicted for line in p.warnings)),
    )


def _notes(predicted: Sequence[Predicted], by: str) -> Iterator[str]:
    yield f"each {by} was left out once: its runs were predicted by a surface refined from the rest"
    if by == "speed":
        yield "predicted between speeds: the lowest and the highest were never left out"
    if beyond := sum(prediction.beyond for prediction in predicted):
        n = sum(prediction.fold.left_out.size for prediction in predicted)
        yield (
            f"{beyond} of {n} predicted runs have a mean force that no other run reached: "
            "the nearest value was used there"
        )
    knows_arcs = all(any(s.error == ARC for s in p.part.sources) for p in predicted)
    if by == "arc" and not knows_arcs:
        yield (
            "a single arc was left, which does not show how much arcs differ: such a difference is "
            "not included in the uncertainty of the prediction"
        )


def predict(columns: Columns, press: PressLaw, config: Config, fold: Fold) -> Predicted:
    """Refine the surface from the remaining runs and simulate the runs left out."""
    remaining = {name: values[fold.rest] for name, values in columns.items()}
    campaign, speeds, _, _ = prepared_campaign(remaining, press, config, {})
    reference = reference_temperature(config, campaign)
    shared = reduction_sources(campaign.measured.columns)
    solution = refine_surface(campaign, speeds, shared, reference)
    surface = with_covariance(solution)
    rig, kind = campaign.bench.rig, campaign.measured.kind
    measured = measured_runs(columns, fold.left_out, rig.R, kind, rig.given_force)
    arcs, _ = numbered_arcs(columns["arc_deg"][fold.left_out], campaign.measured.arcs_deg)
    n_arcs = int(max(arcs.max(), campaign.measured.arc.max())) + 1
    # an unseen arc has its own effect, with the same variance as the others
    arc_sources = [source for source in solution.sources if source.error == ARC][:1]
    of_arcs = [replace(source, place=k) for source in arc_sources for k in range(n_arcs)]
    sources = with_rig_sources(solution.sources, of_arcs)
    points = measured.points
    bench = replace(campaign.bench, surface=surface)
    part = simulated_uncertainty(bench, press, points, arcs, sources, kind=kind, same_bench=True)
    if fold.by == "speed":
        log_mu = np.log(surface.mu_nodes).mean(axis=0)
        measured_at, at = np.log(surface.slip_speed_m_s), np.log(measured.slip_speed)
        missed = between_speeds(measured_at, log_mu, at, SPEED_BEND**2)[:, None]
        part = replace(
            part,
            sources=(*sources, replace(BETWEEN_SPEEDS, place=int(fold.left_out[0]))),
            simulated=np.hstack([part.simulated, missed]),
            difference=np.hstack([part.difference, missed]),
        )
    force, left_out = campaign.measured.normal_force, columns["normal_force_N_m"][fold.left_out]
    beyond = int(np.count_nonzero((left_out < force.min()) | (left_out > force.max())))
    warnings = tuple(f"without {fold.name}: {line}" for line in solution.convergence_warnings())
    return Predicted(fold, part, beyond, warnings)


def as_simulated(
    columns: Columns, predicted: Sequence[Predicted]
) -> tuple[dict[str, np.ndarray], RunsUncertainty]:
    """Return predicted runs as a table of reduced runs, and their uncertainty.

    The settings are those of the measured runs, exactly as measured. Both sides are of one bench:
    its errors are none of the difference, unlike effects and an interpolation, which the predicted
    runs have for themselves, and errors of the reduction, which cancel.
    """
    rows = np.concatenate([prediction.fold.left_out for prediction in predicted])
    table = {name: columns[name][rows] for name in (*SETTINGS, "run", "normal_force_N_m")}
    # the folds may differ in their sources
    by_key: dict[tuple[str, int], Source] = {}
    for source in (source for prediction in predicted for source in prediction.part.sources):
        by_key.setdefault((source.error, source.place), source)
    column_of = {key: k for k, key in enumerate(by_key)}
    parts = []
    for part in (prediction.part for prediction in predicted):
        aligned = [column_of[source.error, source.place] for source in part.sources]
        simulated, difference = np.zeros((2, part.mu.size, len(by_key)))
        simulated[:, aligned], difference[:, aligned] = part.simulated, part.difference
        zero = np.zeros((part.mu.size, 2))
        parts.append(replace(part, simulated=simulated, difference=difference, by_setting=zero))
    labels = tuple(str(label) for label in table["run"])
    uncertainty = replace(
        RunsUncertainty.joined(parts), sources=tuple(by_key.values()), runs=labels
    )
    return {**table, "mu_sliding": uncertainty.mu}, uncertainty
