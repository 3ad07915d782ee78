"""Cross-validation: the runs of each arc or speed, predicted by a surface of the others.

A left-out run is simulated at its measured tension and speed, in the sliding limit. The uncertainty
of the prediction comes from the surface of the remaining runs, as in `simulate-rig`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import InputError
from beltid.identify.agreement.compare import AgreementResult, Statistics
from beltid.identify.agreement.hold_out import FEWEST, Fold, HoldOut, between_speeds, folds
from beltid.notes import log
from beltid.refine.curves import SPEED_BEND
from beltid.refine.inverse import refine_surface
from beltid.stage import Outcome
from beltid.stages.columns import flat
from beltid.stages.compare import agreement
from beltid.stages.inputs import friction_columns, press_law
from beltid.stages.planned_runs import with_tensions
from beltid.stages.refinement import (
    NEEDED,
    prepared_campaign,
    reference_temperature,
    rig_of_runs,
    usable_runs,
)
from beltid.stages.workers import Workers, threads
from beltid.uncertainty.measured import measured_runs, numbered_arcs
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.simulated import (
    RunsUncertainty,
    SimulatedUncertainty,
    simulated_uncertainty,
)
from beltid.uncertainty.sources import (
    ARC,
    Source,
    between_speeds_source,
    reduction_sources,
    with_rig_sources,
)

SETTINGS: Final = ("arc_deg", "nominal_tension_N", "pulley_speed_rad_s")
HELD_OUT: Final = (*NEEDED, "nominal_tension_N", "pulley_speed_rad_s")
"""Columns of the friction table that a prediction needs."""


@dataclass(frozen=True, slots=True)
class Predicted:
    """The predicted runs of one fold.

    Attributes
    ----------
    fold : Fold
        The runs that were left out.
    part : SimulatedUncertainty
        The predicted coefficients and their uncertainty by source.
    sources : tuple of Source
        The sources.
    force_range : tuple of float
        Lowest and highest mean force of the runs that were not left out [N/m].
    warnings : tuple of str
        What the user should know about the surface of these runs.
    """

    fold: Fold
    part: SimulatedUncertainty
    sources: tuple[Source, ...]
    force_range: tuple[float, float]
    warnings: tuple[str, ...] = ()


def predicted_runs(
    friction: Any,
    law: Any,
    config: Config,
    by: str | None,
    jobs: int | None,
    workers: Workers | None,
) -> Outcome[AgreementResult]:
    """Predict the runs of every arc or speed from the others, and compare them."""
    by = by or config.cross_validate.by
    if by not in FEWEST:
        raise InputError(f"by = {by}, must be {' or '.join(FEWEST)}")
    columns = with_tensions(friction_columns(friction, HELD_OUT), config)
    log.info("every %s left out once and predicted", by)
    press, pool = press_law(law, config), workers or threads(jobs)
    folds_predicted = predictions(columns, press, config, by, pool)
    rows = np.concatenate([prediction.fold.left_out for prediction in folds_predicted])
    measured = {name: values[rows] for name, values in columns.items()}
    predicted, uncertainty = as_simulated(columns, folds_predicted)
    notes = tuple(_notes(columns, folds_predicted, by))
    outcome = agreement(measured, predicted, config, uncertainty, notes)
    groups = outcome.tables["groups"]
    if by == "speed":
        result = outcome.result
        ends = np.cumsum([p.fold.left_out.size for p in folds_predicted])[:-1]
        values = zip(
            folds_predicted,
            np.split(result.relative_difference, ends),
            np.split(result.normal_force_N_m, ends),
            strict=True,
        )
        groups = [*groups, *(Statistics.of(p.fold.name, *v).as_row() for p, *v in values)]
    return replace(
        outcome,
        facts={"hold_out": by, **outcome.facts},
        tables={**outcome.tables, "groups": groups},
        warnings=(*outcome.warnings, *(line for p in folds_predicted for line in p.warnings)),
    )


def _notes(columns: Mapping[str, np.ndarray], predicted: Sequence[Predicted], by: HoldOut) -> Any:
    yield f"each {by} was left out once: its runs were predicted by a surface refined from the rest"
    if by == "speed":
        yield "predicted between speeds: the lowest and the highest were never left out"
    if beyond := beyond_range(columns, predicted):
        n = sum(p.fold.left_out.size for p in predicted)
        yield (
            f"{beyond} of {n} predicted runs have a mean force that no other run reached: "
            "the nearest value was used there"
        )
    if by == "arc" and not knows_arcs(predicted):
        yield (
            "a single arc was left, which does not show how much arcs differ: such a difference is "
            "not included in the uncertainty of the prediction"
        )


def predictions(
    columns: Mapping[str, np.ndarray],
    press: PressLaw,
    config: Config,
    by: HoldOut,
    workers: Workers,
) -> list[Predicted]:
    """Predict the runs of every setting from those of the others."""
    usable, _ = usable_runs(columns, rig_of_runs(columns, config))
    plain = flat(columns)
    calls = [(plain, press, config, fold) for fold in folds(columns, usable, by)]
    results = dict(workers.as_ended(predict, calls))
    return [results[k] for k in range(len(calls))]


def predict(
    columns: Mapping[str, np.ndarray], press: PressLaw, config: Config, fold: Fold
) -> Predicted:
    """Refine the surface from the remaining runs and simulate the runs left out."""
    remaining = {name: values[fold.rest] for name, values in columns.items()}
    campaign, speeds, _, _ = prepared_campaign(remaining, press, config, f"without {fold.name}")
    reference = reference_temperature(config, campaign)
    shared = reduction_sources(campaign.measured.columns)
    solution = refine_surface(campaign, speeds, shared, reference)
    names = [source.name for source in solution.sources]
    surface = solution.surface.with_covariance(solution.uncertainty.factor, names)

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
            simulated=np.hstack([part.simulated, missed]),
            difference=np.hstack([part.difference, missed]),
        )
        sources = (*sources, between_speeds_source(int(fold.left_out[0])))
    force = campaign.measured.normal_force
    warnings = tuple(f"without {fold.name}: {line}" for line in solution.convergence_warnings())
    return Predicted(fold, part, sources, (float(force.min()), float(force.max())), warnings)


def as_simulated(
    columns: Mapping[str, np.ndarray], predicted: Sequence[Predicted]
) -> tuple[dict[str, np.ndarray], RunsUncertainty]:
    """Return predicted runs as a table of reduced runs, and their uncertainty.

    The settings are those of the measured runs, exactly as measured. Both sides are of one bench:
    its errors are none of the difference, unlike effects and an interpolation, which the predicted
    runs have for themselves, and errors of the reduction, which cancel.
    """
    rows = np.concatenate([prediction.fold.left_out for prediction in predicted])
    mu = np.concatenate([prediction.part.mu for prediction in predicted])
    table = {name: columns[name][rows] for name in (*SETTINGS, "run", "normal_force_N_m")}
    labels = [str(label) for label in table["run"]]
    uncertainty = RunsUncertainty.of(labels, mu, *_on_common_sources(predicted))
    return {**table, "mu_sliding": mu}, uncertainty


def _on_common_sources(
    predicted: Sequence[Predicted],
) -> tuple[tuple[Source, ...], list[SimulatedUncertainty]]:
    """Align the folds on the union of their sources, which may differ between folds."""
    column_of: dict[tuple[str, int], int] = {}
    sources: list[Source] = []
    for prediction in predicted:
        for source in prediction.sources:
            if column_of.setdefault((source.error, source.place), len(sources)) == len(sources):
                sources.append(source)
    aligned = []
    for prediction in predicted:
        columns = [column_of[source.error, source.place] for source in prediction.sources]
        simulated, difference = np.zeros((2, prediction.part.mu.size, len(sources)))
        simulated[:, columns], difference[:, columns] = (
            prediction.part.simulated,
            prediction.part.difference,
        )
        aligned.append(
            replace(
                prediction.part,
                simulated=simulated,
                difference=difference,
                by_setting=np.zeros((prediction.part.mu.size, 2)),
            )
        )
    return tuple(sources), aligned


def beyond_range(columns: Mapping[str, np.ndarray], predicted: Sequence[Predicted]) -> int:
    """Count predicted runs whose mean force no other run reached; they use the nearest value."""
    force = columns["normal_force_N_m"]
    count = 0
    for prediction in predicted:
        low, high = prediction.force_range
        left_out = force[prediction.fold.left_out]
        count += int(np.count_nonzero((left_out < low) | (left_out > high)))
    return count


def knows_arcs(predicted: Sequence[Predicted]) -> bool:
    """Return whether the remaining runs show how much arcs differ; a single arc does not."""
    return all(
        any(source.error == ARC for source in prediction.sources) for prediction in predicted
    )
