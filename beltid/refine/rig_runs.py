"""The measured runs on the simulated rig: sliding state with a given surface, and its derivatives.

The belt of each run is laid on the pulley once; the run is then simulated with many surfaces. A
surface is a set of curves (:mod:`beltid.refine.curves`), one per speed. The result is ln mu by
Eq. (6) of every run and its derivatives with respect to the parameters of the curves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.laws.capstan import friction_coefficient
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import OperatingPoint
from beltid.refine.curves import Curves
from beltid.rig.model import Bench, RigModel
from beltid.rig.sensitivity import tension_sensitivity
from beltid.rig.steady import StaticState, lay_on, slide

Array = NDArray[np.float64]

FINE_NODES = 48  # nodes of the simulated surface, over the range of the knots
SHARES = (5.0e-4, 5.0e-3)
"""Shares of a run's friction that act below the lowest knot and below the range of the surface.

Below the lowest knot the nearest value applies, even if the law continues to rise: with a share of
0.5 % the whole surface came out 0.02 to 0.04 % too high."""


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """One reduced run of the bench.

    Attributes
    ----------
    point : OperatingPoint
        Arc, measured initial tension, measured speed.
    mu, mu_se : float
        Sliding coefficient by Eq. (6) and its standard error from run-to-run errors [-].
    arc : int
        Number of the arc setting; runs of one setting share its effect.
    order : int
        Position of the run in the campaign.
    temperature_degC : float
        Temperature during sliding [°C]; nan if unknown.
    """

    point: OperatingPoint
    mu: float
    mu_se: float
    arc: int = 0
    order: int = 0
    temperature_degC: float = float("nan")


@dataclass(frozen=True, slots=True)
class Sweep:
    """All runs simulated with one surface.

    Attributes
    ----------
    log_mu : ndarray, shape (n,)
        Logarithms of the simulated coefficients.
    J : ndarray, shape (n, size)
        Derivatives of ``log_mu`` with respect to the parameters.
    speed_slope : ndarray, shape (n,)
        Derivative of ``log_mu`` with respect to ln v of the run.
    """

    log_mu: Array
    J: Array
    speed_slope: Array

    @property
    def response(self) -> Array:
        """Derivative of ``log_mu`` (n,) with respect to ln of a factor on the whole surface."""
        return np.asarray(self.J.sum(axis=1))


class RigRuns:
    """The runs with the belt laid on once, ready to be simulated with many surfaces.

    Parameters
    ----------
    bench : Bench
        Belt, rig, normal law.
    runs : sequence of MeasuredRun
        The measured runs.
    speeds : ndarray, shape (m,)
        Speed settings [m/s], increasing; each run belongs to the nearest one.
    elements : sequence of int or RigModel
        Number of belt elements of each run, even (:func:`mesh_of`), or the model of the same run on
        a bench that differs a little, to take its mesh.
    """

    def __init__(
        self,
        bench: Bench,
        runs: Sequence[MeasuredRun],
        speeds: Array,
        elements: Sequence[int | RigModel],
    ) -> None:
        self.beta = np.array([run.point.beta for run in runs])
        self.speeds = speeds
        v = np.array([run.point.omega * bench.rig.R for run in runs])
        self.label = np.argmin(np.abs(np.log(v[:, None] / speeds)), axis=1)
        self.off_speed = np.log(v / speeds[self.label])
        self.models: list[RigModel] = []
        self.laid: list[StaticState] = []
        for k, run in enumerate(runs):
            point = run.point
            at_speed = OperatingPoint(point.beta, point.T_0, speeds[self.label[k]] / bench.rig.R)
            model = bench.model(at_speed, elements[k])
            self.models.append(model)
            self.laid.append(lay_on(model))

    def slide(self, surfaces: Sequence[FrictionSurface]) -> list[tuple[RigModel, StaticState]]:
        """Compute the sliding state of every run with the surface of its speed."""
        states = []
        for k, model in enumerate(self.models):
            run_model = model.with_surface(surfaces[self.label[k]])
            states.append((run_model, slide(run_model, self.laid[k])))
        return states

    def log_mu(self, surfaces: Sequence[FrictionSurface], speed_slope: Array) -> Array:
        """Simulate the logarithms of the coefficients (n,), corrected for the speed of each run."""
        tensions = [(state.T_A, state.T_B) for _, state in self.slide(surfaces)]
        tight, slack = np.array(tensions).T
        mu = friction_coefficient(tight, slack, self.beta)
        return np.asarray(np.log(mu) + self.off_speed * speed_slope)


def mesh_of(bench: Bench, runs: Sequence[MeasuredRun], finer: float) -> list[int | RigModel]:
    """Choose the number of elements of each run, even: `finer` times the default."""
    counts = (bench.model(run.point).nodes.size - 1 for run in runs)
    return [2 * round(0.5 * finer * n) for n in counts]


def surfaces_of(curves: Curves, parameters: Array) -> list[FrictionSurface]:
    """Tabulate the surface of each speed finely, as mu is a spline only in the logarithm."""
    log_force = np.linspace(curves.log_force[0], curves.log_force[-1], FINE_NODES)
    log_mu = curves.basis(log_force) @ parameters.reshape(curves.log_speed.size, -1).T
    return [
        FrictionSurface(np.exp(log_force), [float(np.exp(v))], np.exp(column)[:, None])
        for v, column in zip(curves.log_speed, log_mu.T, strict=True)
    ]


def lookup_weights(
    model: RigModel, state: StaticState, surface: FrictionSurface
) -> tuple[float, Array, Array]:
    """Return mu, line forces of its look-ups (m,) [N/m], and d ln mu / d ln mu(look-up) (m,)."""
    beta, speed = model.point.beta, model.point.omega * model.path.R
    mu = float(friction_coefficient(state.T_A, state.T_B, beta))
    s = tension_sensitivity(model, state)
    per_mu = (s.tension_tight_N / state.T_A - s.tension_slack_N / state.T_B) / (beta * mu)
    return mu, s.normal_force_N_m, per_mu * surface.mu(s.normal_force_N_m, speed)


def sweep_with_slopes(rig: RigRuns, curves: Curves, parameters: Array) -> Sweep:
    """Simulate every run with the surface of its speed and compute the derivatives."""
    surfaces = surfaces_of(curves, parameters)
    k = curves.log_force.size
    log_mu, speed_slope = np.empty((2, len(rig.models)))
    J = np.zeros((len(rig.models), curves.size))
    # small deviations from the speed of the group are corrected by the slope between the speeds
    by_speed = np.zeros((1, k))
    if curves.log_speed.size > 1:
        values = parameters.reshape(-1, k)
        by_speed = np.asarray(np.gradient(values, curves.log_speed, axis=0), dtype=float)
    for i, (model, state) in enumerate(rig.slide(surfaces)):
        j = rig.label[i]
        mu, force, weight = lookup_weights(model, state, surfaces[j])
        row = weight @ curves.basis(np.log(force))
        J[i, j * k : (j + 1) * k] = row
        speed_slope[i] = float(row @ by_speed[j])
        log_mu[i] = np.log(mu) + rig.off_speed[i] * speed_slope[i]
    return Sweep(log_mu, J, speed_slope)


def acting_forces(rig: RigRuns, start: FrictionSurface) -> Array:
    """Return line forces at each speed (m, 3) [N/m]: limits of both :data:`SHARES`, and peak."""
    acting = np.empty((len(rig.models), 3))
    for i, (_, state) in enumerate(rig.slide([start] * rig.speeds.size)):
        points = state.points[state.touching]
        f, load = points["f_N"], points["F_N"]
        order = np.argsort(f)
        share = np.cumsum(load[order]) / load.sum()
        acting[i] = *np.interp(SHARES, share, f[order]), f.max()
    by_speed = [acting[rig.label == j] for j in range(rig.speeds.size)]
    return np.array([[*of.min(axis=0)[:2], of[:, 2].max()] for of in by_speed])
