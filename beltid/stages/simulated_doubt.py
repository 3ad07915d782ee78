"""What is not known of simulated runs: for the metadata of a simulated recording, and back."""

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
    SimulatedUncertainty,
    simulated_uncertainty,
    with_rig_sources,
)
from beltid.uncertainty.sources import Source, all_sources

PER_CALL: Final = 24
ARC_GAP: Final = 1e-3  # relative
DIGITS: Final = 5
MESH_SHARE: Final = 0.4
"""Of the change by twice as many elements: a third is the error that is left at order two, times
1.25, the safety factor of the grid convergence index (ASME V&V 20-2009, section 2)."""


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


@dataclass(frozen=True, slots=True)
class RunsUncertainty:
    """Uncertainty of simulated runs as the metadata hold it, arrays by run.

    Attributes
    ----------
    sources : tuple of Source
        Shared errors.
    runs : tuple of str
        Labels of the runs.
    simulated, difference : ndarray, shape (n, K)
        Relative changes of the simulated coefficient, and of its difference from the measured one.
    scatter, numerical : ndarray, shape (n,)
        Relative standard uncertainties.
    by_setting : ndarray, shape (n, 2)
        Derivatives of ln mu by the ln of initial tension and speed.
    """

    sources: tuple[Source, ...]
    runs: tuple[str, ...]
    simulated: np.ndarray
    difference: np.ndarray
    scatter: np.ndarray
    numerical: np.ndarray
    by_setting: np.ndarray

    def extra(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "sources": [
                {field: getattr(source, field) for field in Source.__slots__}
                for source in self.sources
            ],
            "runs": list(self.runs),
            **{name: _short(getattr(self, name)) for name in ARRAYS},
        }


ARRAYS: Final = ("simulated", "difference", "scatter", "numerical", "by_setting")


def _short(values: np.ndarray) -> list[Any]:
    """Nested lists with few digits: a doubt needs no more."""
    return [
        _short(row) if np.ndim(row) else float(f"{row:.{DIGITS}g}") for row in np.asarray(values)
    ]


def runs_uncertainty_of(extra: Mapping[str, Any]) -> RunsUncertainty | None:
    """What the metadata of a simulated recording say; None if they say nothing."""
    told = extra.get("uncertainty")
    if not told:
        return None
    sources = _sources(told["sources"])
    arrays = {name: np.array(told[name], dtype=float) for name in ARRAYS}
    return RunsUncertainty(sources=sources, runs=tuple(told["runs"]), **arrays)


def _sources(told: Sequence[Mapping[str, Any]]) -> tuple[Source, ...]:
    return tuple(Source(**{name: one[name] for name in Source.__slots__}) for one in told)


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
    stored = _sources(inputs.stored.get("sources", ()))
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
    return _gathered(finished, sources, ordered), ()


def _gathered(
    finished: Sequence[tuple[PlannedRun, RunResult]],
    sources: tuple[Source, ...],
    parts: Sequence[SimulatedUncertainty],
) -> RunsUncertainty:
    mesh = np.concatenate([part.mesh for part in parts])
    limit = np.concatenate([part.mu for part in parts])
    # what is left of the build-up at the end of a simulated run, and of its time steps
    ended = np.array(
        [abs(math.log(result.mu / mu)) for (_, result), mu in zip(finished, limit, strict=True)]
    )
    return RunsUncertainty(
        sources=sources,
        runs=tuple(run.label for run, _ in finished),
        simulated=np.concatenate([part.simulated for part in parts]),
        difference=np.concatenate([part.difference for part in parts]),
        scatter=np.concatenate([part.scatter for part in parts]),
        numerical=np.hypot(MESH_SHARE * mesh, ended),
        by_setting=np.concatenate([part.by_setting for part in parts]),
    )


def _arcs(stored: Sequence[float], simulated: Sequence[float]) -> list[float]:
    """Arc settings: those that the surface was made from, in their order, then others."""
    arcs = [float(arc) for arc in stored]
    for arc in simulated:
        if not any(math.isclose(arc, known, rel_tol=ARC_GAP) for known in arcs):
            arcs.append(float(arc))
    return arcs


def _number(arcs: Sequence[float], arc: float) -> int:
    return next(k for k, known in enumerate(arcs) if math.isclose(arc, known, rel_tol=ARC_GAP))
