"""Runs on the simulated rig: the sliding limit with a surface, and its derivatives.

The belt of each run is laid on the pulley once; the run then slides with many surfaces. The adjoint
of the sliding state gives the derivatives of ln mu by Eq. (6) with respect to mu at every place
where the belt looks it up, and so with respect to any parameter of the surface. The derivatives by
the inputs of the rig come from one more simulation for each input.

This is the only module of the rooms ``uncertainty``, ``refine`` and ``plan`` that calls the rig.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.run import RigKind
from beltid.laws.capstan import friction_coefficient
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import OperatingPoint
from beltid.rig.forces import State
from beltid.rig.model import Bench, RigModel
from beltid.rig.runs import lay_on, slide, tension_sensitivity
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.sources import Errors, Source, changes_by

Array = NDArray[np.float64]

INPUTS: Final = ("arc", "initial tension", "radius", "span", "EI", "EA", "k_linear", "k_quadratic")
"""Inputs of the simulated rig whose errors act on a run."""
STEP: Final = 2.0e-3  # relative step of the differences by the inputs; their error is of its order
MESH: Final = 2.0
"""Ratio of elements to the default: where contact points come and go, derivatives scatter more than
values, those by bending stiffness (0.03) at the smallest tensions by a tenth."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """Measured runs and the bench on which they are simulated."""

    measured: Measured  # the runs
    bench: Bench  # belt, rig, and the surface that the inverse solution starts from
    press: PressLaw  # the contact law and its fit to the press

    def corrected(self, errors: Errors) -> Self:
        """Return runs and bench with errors corrected."""
        return self._moved(
            self.measured.corrected(errors),
            EA=1.0 + errors.at("axial_stiffness"),
            EI=1.0 + errors.at("bending_stiffness"),
            span=self.bench.rig.span + errors.at("span_length"),
            law=self.press.corrected(errors),
        )

    def _moved(self, measured: Measured, EA: float, EI: float, span: float, law: NormalLaw) -> Self:
        """Return the campaign with other runs and inputs; the stiffnesses as factors."""
        bench, belt = self.bench, self.bench.belt
        belt = belt._replace(EA=belt.EA * EA, EI=belt.EI * EI)
        bench = replace(bench, belt=belt, rig=replace(bench.rig, R=measured.R, span=span), law=law)
        return replace(self, measured=measured, bench=bench)

    def log_inputs(self) -> Array:
        """Return the ln of the inputs of the simulated rig (n, 8), in the order of `INPUTS`."""
        bench, measured = self.bench, self.measured
        k = np.array([bench.law.k_linear_N_m2, bench.law.k_quadratic_N_m3])
        shared = [bench.rig.R, bench.rig.span, bench.belt.EI, bench.belt.EA]
        shared += [*np.where(k > 0.0, k, 1.0)]
        columns = [measured.beta, measured.T_0, *(np.full(measured.mu.size, x) for x in shared)]
        return np.log(np.column_stack(columns))

    def stepped(self, name: str) -> Self:
        """Return the campaign with one input a step larger and unchanged sliding speeds."""
        factor = {n: 1.0 + STEP * (n == name) for n in INPUTS}
        measured, rig, law = self.measured, self.bench.rig, self.bench.law
        k = law.k_linear_N_m2 * factor["k_linear"], law.k_quadratic_N_m3 * factor["k_quadratic"]
        stepped = replace(
            measured,
            R=rig.R * factor["radius"],
            omega=measured.omega / factor["radius"],
            beta=measured.beta * factor["arc"],
            T_0=measured.T_0 * factor["initial tension"],
        )
        law = replace(law, k_linear_N_m2=k[0], k_quadratic_N_m3=k[1])
        return self._moved(stepped, factor["EA"], factor["EI"], rig.span * factor["span"], law)


@dataclass(frozen=True, slots=True)
class Sliding:
    """The sliding limit of a run."""

    tight: float  # tensions [N]
    slack: float
    mu: float  # by Eq. (6)
    force: Array  # line forces at which the belt looks up its friction [N/m], (m,)
    load: Array  # normal loads on which this friction acts [N], (m,)
    weight: Array  # derivatives of ln mu with respect to ln mu of each look-up, (m,)


class RigRuns:
    """Runs at n points with the belt laid on once, ready to slide with many surfaces.

    Each run belongs to the nearest of the speeds (m,) [m/s], increasing. Its mesh is a number of
    belt elements (:func:`mesh_of`), or that of its model on a bench that differs a little.
    """

    def __init__(
        self,
        bench: Bench,
        points: Sequence[OperatingPoint],
        speeds: Array,
        meshes: Sequence[int | RigModel],
    ) -> None:
        self.beta = np.array([point.beta for point in points])
        self.speeds = np.asarray(speeds, dtype=float)
        v = np.array([point.omega * bench.rig.R for point in points])
        self.label = np.argmin(np.abs(np.log(v[:, None] / self.speeds)), axis=1)
        self.off_speed = np.log(v / self.speeds[self.label])
        self.models: list[RigModel] = []
        self._laid: list[State] = []
        for point, j, mesh in zip(points, self.label, meshes, strict=True):
            at_speed = OperatingPoint(point.beta, point.T_0, self.speeds[j] / bench.rig.R)
            self.models.append(bench.model(at_speed, mesh))
            self._laid.append(lay_on(self.models[-1]))

    def slide(self, surfaces: Sequence[FrictionSurface]) -> list[Sliding]:
        """Compute every run with the surface of its speed, with derivatives by the friction.

        Raises `ConvergenceError` if a run has no sliding state.
        """
        runs = []
        for model, state, surface in self._states(surfaces):
            beta, speed = model.point.beta, model.point.omega * model.path.R
            mu = float(friction_coefficient(state.T_A, state.T_B, beta))
            force, tight, slack = tension_sensitivity(model, state)
            per_mu = tight / state.T_A - slack / state.T_B
            weight = per_mu / (beta * mu) * surface.mu(force, speed)
            load = state.now[state.touching]["F_N"]
            runs.append(Sliding(state.T_A, state.T_B, mu, force, load, weight))
        return runs

    def log_mu(self, surfaces: Sequence[FrictionSurface], speed_slope: Array) -> Array:
        """Simulate the logarithms of the coefficients (n,), corrected for the speed of each run."""
        tensions = [(state.T_A, state.T_B) for _, state, _ in self._states(surfaces)]
        tight, slack = np.array(tensions).T
        mu = friction_coefficient(tight, slack, self.beta)
        return np.asarray(np.log(mu) + self.off_speed * speed_slope)

    def _states(
        self, surfaces: Sequence[FrictionSurface]
    ) -> list[tuple[RigModel, State, FrictionSurface]]:
        states = []
        for model, laid, j in zip(self.models, self._laid, self.label, strict=True):
            run = model.with_surface(surfaces[j])
            states.append((run, slide(run, laid), surfaces[j]))
        return states


def as_measured(
    bench: Bench,
    points: Sequence[OperatingPoint],
    tensions: tuple[Array, Array],
    arc: NDArray[np.intp],
    kind: RigKind,
) -> Measured:
    """Return simulated runs as if their tight and slack tensions had been measured exactly."""
    beta, T_0, omega = np.array([(point.beta, point.T_0, point.omega) for point in points]).T
    mu, given = friction_coefficient(*tensions, beta), bench.rig.given_force
    exact = np.zeros(mu.size)
    return Measured(
        bench.rig.R, arc, beta, T_0, omega, *tensions, mu, exact, kind=kind, given_force=given
    )


def mesh_of(bench: Bench, points: Sequence[OperatingPoint], finer: float) -> list[int]:
    """Choose the number of elements of each run, even: `finer` times the default."""
    counts = (bench.model(point).nodes.size - 1 for point in points)
    return [2 * round(0.5 * finer * n) for n in counts]


def input_slopes(
    campaign: Campaign, surfaces: Sequence[FrictionSurface], speeds: Array, speed_slope: Array
) -> Array:
    """Compute derivatives of the simulated ln mu of each run by the ln of each input (n, 8).

    `surfaces` holds the surface at each of the speeds [m/s], `speed_slope` the derivative of ln mu
    of each run by ln v (n,).
    """
    points = campaign.measured.points
    rig = RigRuns(campaign.bench, points, speeds, mesh_of(campaign.bench, points, MESH))
    nominal = rig.log_mu(surfaces, speed_slope)

    def log_mu(other: Campaign) -> Array:
        # on the same mesh: the noise of another one is larger than the difference
        near = RigRuns(other.bench, other.measured.points, speeds, rig.models)
        return near.log_mu(surfaces, speed_slope)

    columns = [log_mu(campaign.stepped(name)) - nominal for name in INPUTS]
    return np.asarray(np.column_stack(columns) / np.log1p(STEP))


def residual_changes(
    campaign: Campaign, sources: Sequence[Source], slopes: Array, speed_slope: Array
) -> Array:
    """Compute the change of measured minus simulated ln mu by one u of each source (n, K).

    With the derivatives of the simulated ln mu of :func:`input_slopes`, (n, 8) and (n,).
    """
    before, inputs = campaign.measured, campaign.log_inputs()

    def residual(errors: Errors) -> Array:
        corrected = campaign.corrected(errors)
        after = corrected.measured
        simulated = np.einsum("ni,ni->n", slopes, corrected.log_inputs() - inputs)
        simulated += speed_slope * np.log(after.slip_speed / before.slip_speed)
        return np.asarray(np.log(after.mu / before.mu) - simulated)

    return changes_by(sources, residual)
