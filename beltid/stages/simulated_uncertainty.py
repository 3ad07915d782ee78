"""Uncertainty of the runs of a simulated campaign, computed by the workers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import BeltidError
from beltid.laws.friction_surface import FrictionSurface
from beltid.rigsim.model import Bench
from beltid.rigsim.rig import RunResult
from beltid.stages.campaign import PlannedRun
from beltid.stages.uncertainties import standard_uncertainties
from beltid.stages.workers import Workers
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.simulated import (
    RunsUncertainty,
    simulated_uncertainty,
    sources_of,
    with_rig_sources,
)
from beltid.uncertainty.sources import all_sources

PER_CALL: Final = 24
ARC_GAP: Final = 1e-3  # relative


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
    arcs = _arcs(inputs.stored.get("arcs_deg", ()), [run.arc_deg for run, _ in finished])
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
    points = [run.point for run, _ in finished]
    numbers = np.array([_number(arcs, run.arc_deg) for run, _ in finished], dtype=np.intp)
    pieces = [slice(i, i + PER_CALL) for i in range(0, len(points), PER_CALL)]
    largest = max(float(result.tension_tight_N) for _, result in finished)
    calls = [
        (bench, inputs.press, points[piece], numbers[piece], sources, elements, largest)
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


def _arcs(stored: Sequence[float], simulated: Sequence[float]) -> list[float]:
    """Arc settings: those that the surface was made from, in their order, then others."""
    arcs = [float(arc) for arc in stored]
    for arc in simulated:
        if not any(math.isclose(arc, known, rel_tol=ARC_GAP) for known in arcs):
            arcs.append(float(arc))
    return arcs


def _number(arcs: Sequence[float], arc: float) -> int:
    return next(k for k, known in enumerate(arcs) if math.isclose(arc, known, rel_tol=ARC_GAP))
