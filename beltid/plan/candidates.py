"""Simulate each rig setting once with the present surface, and differentiate it.

The rows J, S of the linear model are computed as for the refined surface: J from the sensitivities
of the simulated rig, S as the change of measured less simulated ln mu by each shared error. The
noise of a run is

    v = s² [ s_r² + s_T² (1/T_tight² + 1/T_slack²) / (mu beta)² + s_m² ],                    (P6)

the scatter of the friction from run to run, the scatter of the tensions in Eq. (6), and the error
of the simulated coefficient that the surface fit allows for. A run in the other direction has the
same row, except that the two cells have changed places: a gain of a cell changes its sign.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from beltid.errors import InputError
from beltid.identify.friction.run import TWO_CELLS, RigKind
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import OperatingPoint
from beltid.plan.knowledge import RunRows, knots_for, speeds_for, usual_surface
from beltid.refine.inverse import KNOTS, MODEL_ERROR, acting_forces, sweep
from beltid.refine.posterior import Curves
from beltid.rig.model import Bench
from beltid.uncertainty.measured import Measured, PressLaw, numbered_arcs
from beltid.uncertainty.rig_runs import (
    MESH,
    Campaign,
    RigRuns,
    input_slopes,
    residual_changes,
    simulated_runs,
)
from beltid.uncertainty.sources import ARC, Source

Array = NDArray[np.float64]

OF_CELLS: Final = ("cell_gain", "cell_offset")
"""Errors of each cell, which reversing the pulley swaps."""


@dataclass(frozen=True, slots=True)
class NoiseLaw:
    """Noise of a run, (P6)."""

    friction: float = 3.0e-3  # standard deviation s_r of ln mu from run to run [-]
    tension: float = 0.1  # standard deviation s_T of the tensions of a run [N]
    scale: float = 1.0  # factor s from the fit of the surface [-]

    def variance(self, measured: Measured) -> Array:
        """Return the variance of ln mu of each run (n,)."""
        by_tension = np.square(self.tension) * _tension_share(measured)
        return np.asarray(self.scale**2 * (self.friction**2 + by_tension + MODEL_ERROR**2))


def noise_law(measured: Measured, scale: float = 1.0) -> NoiseLaw:
    """Fit (P6) to the squared standard errors of reduced runs, in relative misfits.

    Raises `InputError` if no run has a standard error.
    """
    squares = np.square(measured.mu_se / measured.mu)
    has_error = squares > 0.0
    if not has_error.any():
        raise InputError(
            "the runs have no standard errors, so their noise is unknown; state mu_se or "
            "rig.force_resolution_N when they are reduced, or plan without them"
        )
    terms = np.column_stack([np.ones(squares.size), _tension_share(measured)])
    scaled = terms[has_error] / squares[has_error, None]
    friction, tension = np.sqrt(nnls(scaled, np.ones(scaled.shape[0]))[0])
    return NoiseLaw(float(friction), float(tension), scale)


def _tension_share(measured: Measured) -> Array:
    """Return the variance of ln mu per unit variance of both tensions [1/N²]."""
    squares = 1.0 / np.square(measured.tight) + 1.0 / np.square(measured.slack)
    return np.asarray(squares / np.square(measured.mu * measured.beta))


@dataclass(frozen=True, slots=True)
class Settings:
    """Available settings of the rig."""

    arcs_deg: tuple[float, ...]  # contact arcs [deg]
    tensions: tuple[float, ...]  # initial tensions [N]
    omegas: tuple[float, ...]  # speeds of the pulley [rad/s]

    def points(self) -> list[OperatingPoint]:
        """List every combination as operating points in SI units; the speed varies fastest."""
        every = itertools.product(self.arcs_deg, self.tensions, self.omegas)
        return [OperatingPoint(math.radians(arc), T_0, w) for arc, T_0, w in every]


@dataclass(frozen=True, slots=True)
class Candidates:
    """Candidate runs, simulated with the present surface."""

    campaign: Campaign  # the runs with their simulated tensions, and the bench
    curves: Curves  # knots and speeds of the surface
    J: Array  # derivatives of ln mu with respect to the parameters, (n, size)
    speed_slope: Array  # and to ln v, (n,)
    slopes: Array  # and to the inputs of the simulated rig, (n, 8)

    @property
    def measured(self) -> Measured:
        """Simulated runs."""
        return self.campaign.measured

    @property
    def can_reverse(self) -> bool:
        """Whether reversing the pulley swaps the cells: each span has one."""
        kind = self.measured.kind
        return kind.measures == "two_cells" and kind.weight is None

    def rows(
        self, sources: Sequence[Source], noise: NoiseLaw, columns: Mapping[str, float]
    ) -> RunRows:
        """Build the rows of the linear model, one for each candidate.

        The shared errors are in the order of the columns of S; one that does not affect new runs
        has zeros. `columns` holds the change of ln mu per unit of each reduction error, by key.
        """
        n, arc = self.J.shape[0], self.measured.arc
        shared = {key: np.full((n, 1), value) for key, value in columns.items()}
        shared[ARC] = self.J.sum(axis=1)[:, None] * np.eye(int(arc.max()) + 1)[arc]
        campaign = replace(self.campaign, measured=replace(self.measured, columns=shared))
        S = residual_changes(campaign, sources, self.slopes, self.speed_slope)
        return RunRows(self.J, S, noise.variance(self.measured), arc)


def in_both_directions(rows: RunRows, sources: Sequence[Source]) -> RunRows:
    """Append every run in the other direction, numbered after those in the first (2n).

    The errors of the cells have changed places; those of one size for both cells.
    """
    place = {(source.error, source.place): k for k, source in enumerate(sources)}
    swapped = [
        place.get((s.error, 1 - s.place), k) if s.error in OF_CELLS else k
        for k, s in enumerate(sources)
    ]
    return RunRows(
        J=np.tile(rows.J, (2, 1)),
        S=np.vstack([rows.S, rows.S[:, swapped]]),
        variance=np.tile(rows.variance, 2),
        arc=np.tile(rows.arc, 2),
    )


def simulate_candidates(
    bench: Bench,
    press: PressLaw,
    settings: Settings,
    known_arcs_deg: Sequence[float],
    measured: FrictionSurface | None,
    kind: RigKind = TWO_CELLS,
) -> Candidates:
    """Simulate each setting once with the present surface, and differentiate it.

    Parameters
    ----------
    bench, press, kind
        Belt and rig (its surface is not used), its contact law, and what it measures.
    settings : Settings
        Available settings of the rig.
    known_arcs_deg : sequence of float
        Arc settings of the measured surface, numbered as in its sources [deg].
    measured : FrictionSurface or None
        The present surface; None before any run, which takes the mean of the prior.

    Raises
    ------
    ConvergenceError
        If a setting has no sliding state.
    """
    points, R = settings.points(), bench.rig.R
    wanted = np.array(settings.omegas) * R
    speeds = speeds_for(wanted, measured)
    at = speeds[np.argmin(np.abs(np.log(wanted[:, None] / speeds)), axis=1)]
    arc = numbered_arcs([math.degrees(point.beta) for point in points], known_arcs_deg)[0]
    campaign = Campaign(simulated_runs(bench, points, arc, kind), bench, press)
    T_0, start = campaign.measured.T_0, measured
    if start is None:
        rough = np.log([0.2 * T_0.min() / R, 2.0 * T_0.max() / R])
        start = usual_surface(rough, np.log(speeds))
    _, low, high = acting_forces(RigRuns(campaign, np.unique(at), MESH), start)
    log_force = knots_for(low, high, measured, KNOTS)
    curves = Curves(log_force, np.log(speeds))
    present = usual_surface(log_force, curves.log_speed) if measured is None else measured
    log_mu = np.log(present.mu(np.exp(log_force), speeds[:, None])).ravel()
    rig = RigRuns(campaign, speeds, MESH)
    done, surfaces = sweep(rig, curves, log_mu), curves.surfaces(log_mu)
    campaign = Campaign(
        simulated_runs(bench, points, arc, kind, (done.tight, done.slack)), bench, press
    )
    slopes = input_slopes(campaign, surfaces, speeds, done.speed_slope)
    return Candidates(campaign, curves, done.J, done.speed_slope, slopes)
