"""Hold-out: the runs of each arc, or speed, predicted by a surface refined from the others.

A left-out run is simulated at the tension and the speed that it was measured at, in the sliding
limit; what is not known of the prediction comes from the surface of the rest, as in `simulate-rig`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from beltid.config import Config
from beltid.identify.agreement.hold_out import Fold, HoldOut, folds
from beltid.laws.uncertain_surface import UncertainSurface
from beltid.refine.effects import ARC
from beltid.stages.outcome import flat
from beltid.stages.simulation.refinement import (
    NEEDED,
    prepared_campaign,
    reference_temperature,
    refined_uncertainty,
    rig_of_runs,
    shared_sources,
    usable_runs,
)
from beltid.stages.uncertainties import standard_uncertainties
from beltid.stages.workers import Workers
from beltid.uncertainty.measured import measured_runs, numbered_arcs
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.refined import refined_campaign
from beltid.uncertainty.simulated import (
    RunsUncertainty,
    SimulatedUncertainty,
    simulated_uncertainty,
    with_rig_sources,
)
from beltid.uncertainty.sources import Source, all_sources

SETTINGS: Final = ("arc_deg", "nominal_tension_N", "pulley_speed_rad_s")
HELD_OUT: Final = (*NEEDED, "nominal_tension_N", "pulley_speed_rad_s")
"""Columns of the friction table that a prediction needs."""


@dataclass(frozen=True, slots=True)
class Predicted:
    """The predicted runs of one fold.

    Attributes
    ----------
    fold : Fold
        What was left out.
    part : SimulatedUncertainty
        The predicted coefficients and what is not known of them, by source.
    sources : tuple of Source
        The sources.
    force_range : tuple of float
        Lowest and highest mean force of the runs that were not left out [N/m].
    """

    fold: Fold
    part: SimulatedUncertainty
    sources: tuple[Source, ...]
    force_range: tuple[float, float]


def predictions(
    columns: Mapping[str, np.ndarray],
    press: PressLaw,
    config: Config,
    by: HoldOut,
    workers: Workers,
) -> list[Predicted]:
    """Predict the runs of every setting from those of the others.

    Parameters
    ----------
    columns : mapping of str to ndarray (n,)
        The reduced runs, `HELD_OUT` among them.
    press : PressLaw
        The contact law and its making.
    config : Config
        Belt and rig.
    by : {"arc", "speed"}
        What is left out in turn.
    workers : Workers
        Who computes the folds; the result does not depend on it.

    Raises
    ------
    TooFewSettings
        If too few settings or runs would be left.
    ConvergenceError
        If a surface does not converge, or a run cannot be simulated.
    """
    usable, _ = usable_runs(columns, rig_of_runs(columns, config))
    plain = flat(columns)
    calls = [(plain, press, config, fold) for fold in folds(columns, usable, by)]
    found = dict(workers.as_ended(predict, calls))
    return [found[k] for k in range(len(calls))]


def predict(
    columns: Mapping[str, np.ndarray], press: PressLaw, config: Config, fold: Fold
) -> Predicted:
    """Refine the surface from the rest of the runs and simulate those left out."""
    rest = {name: values[fold.rest] for name, values in columns.items()}
    campaign, speeds, _, _ = prepared_campaign(rest, press, config, f"without {fold.name}")
    reference = reference_temperature(config, campaign)
    found = refined_campaign(campaign, speeds, shared_sources(campaign, config), reference)
    of_rest = refined_uncertainty(found)
    names = [source.name for source in found.sources]
    surface = UncertainSurface(found.refined.surface, of_rest.factor, names)

    rig, kind = campaign.bench.rig, campaign.measured.kind
    measured = measured_runs(columns, fold.left_out, rig.R, kind, rig.given_force)
    arcs, _ = numbered_arcs(columns["arc_deg"][fold.left_out], campaign.measured.arcs_deg)
    n_arcs = int(max(arcs.max(), campaign.measured.arc.max())) + 1
    # an arc not seen has an effect of its own, as large as those of the others
    of_arcs = [source for source in found.sources if source.error == ARC][:1]
    given = (
        *all_sources(standard_uncertainties(config), n_arcs, press.has_scatter),
        *(replace(source, place=k) for source in of_arcs for k in range(n_arcs)),
    )
    sources = with_rig_sources(found.sources, given)
    points = [run.point for run in replace(campaign, measured=measured).runs]
    bench = replace(campaign.bench, surface=surface)
    largest = float(max(measured.tight.max(), campaign.measured.tight.max()))
    part = simulated_uncertainty(
        bench, press, points, arcs, sources, largest_tension=largest, kind=kind
    )
    force = campaign.measured.normal_force
    return Predicted(fold, part, sources, (float(force.min()), float(force.max())))


def as_simulated(
    columns: Mapping[str, np.ndarray], found: Sequence[Predicted]
) -> tuple[dict[str, np.ndarray], RunsUncertainty]:
    """Predicted runs as a table of reduced ones, and what is not known of them.

    The settings are those of the measured runs, as they were measured: none was missed.
    """
    rows = np.concatenate([one.fold.left_out for one in found])
    mu = np.concatenate([one.part.mu for one in found])
    table = {name: columns[name][rows] for name in (*SETTINGS, "run", "normal_force_N_m")}
    sources, aligned = _on_common_sources(found)
    labels = [str(label) for label in table["run"]]
    return {**table, "mu_sliding": mu}, RunsUncertainty.of(labels, mu, sources, aligned)


def _on_common_sources(
    found: Sequence[Predicted],
) -> tuple[tuple[Source, ...], list[SimulatedUncertainty]]:
    """The parts with the columns of all sources that a fold has: not all folds have the same."""
    places: dict[tuple[str, int], int] = {}
    sources: list[Source] = []
    for one in found:
        for source in one.sources:
            if places.setdefault((source.error, source.place), len(sources)) == len(sources):
                sources.append(source)
    aligned = []
    for one in found:
        here = [places[source.error, source.place] for source in one.sources]
        simulated, difference = np.zeros((2, one.part.mu.size, len(sources)))
        simulated[:, here], difference[:, here] = one.part.simulated, one.part.difference
        aligned.append(
            replace(
                one.part,
                simulated=simulated,
                difference=difference,
                by_setting=np.zeros((one.part.mu.size, 2)),
            )
        )
    return tuple(sources), aligned


def beyond_range(columns: Mapping[str, np.ndarray], found: Sequence[Predicted]) -> int:
    """Number of predicted runs whose mean force no other run reached: the nearest value held."""
    force = columns["normal_force_N_m"]
    return sum(
        int(np.count_nonzero((force[one.fold.left_out] < low) | (force[one.fold.left_out] > high)))
        for one in found
        for low, high in [one.force_range]
    )


def knows_arcs(found: Sequence[Predicted]) -> bool:
    """Whether the runs that were left show how far arcs differ: of a single arc nothing does."""
    return all(any(source.error == ARC for source in one.sources) for one in found)
