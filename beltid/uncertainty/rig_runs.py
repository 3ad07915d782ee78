"""Runs on the simulated rig: the sliding limit with a surface, and its derivatives.

The belt of each run is laid on the pulley once; the run then slides with many surfaces. The adjoint
of the sliding state gives the derivatives of ln mu by Eq. (6) with respect to mu at every place
where the belt looks it up, and so with respect to any parameter of the surface. The derivatives by
the inputs of the rig come from one more simulation for each input.

This is the only module of the rooms ``uncertainty``, ``refine`` and ``plan`` that calls the rig.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.run import RigKind
from beltid.laws.capstan import friction_coefficient
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import OperatingPoint
from beltid.rig.model import Bench, RigModel
from beltid.rig.steady import StaticState, lay_on, slide, tension_sensitivity
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.sources import NO_ERRORS, Errors, Source, changes_by

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

    def inputs(self, runs: Measured, errors: Errors = NO_ERRORS) -> Array:
        """Return `INPUTS` of the simulated rig for its runs, with errors of the bench corrected.

        `runs` are those that were measured, with the same errors corrected, (n, 8).
        """
        belt, law = self.bench.belt, self.press.corrected(errors)
        shared = (
            runs.R,
            self.bench.rig.span + errors.at("span_length"),
            belt.EI * (1.0 + errors.at("bending_stiffness")),
            belt.EA * (1.0 + errors.at("axial_stiffness")),
            law.k_linear_N_m2,
            law.k_quadratic_N_m3,
        )
        same = np.broadcast_to(shared, (runs.mu.size, len(shared)))
        return np.column_stack([runs.beta, runs.T_0, same])


def simulated_runs(
    bench: Bench,
    points: Sequence[OperatingPoint],
    arc: NDArray[np.intp],
    kind: RigKind,
    tensions: Array | tuple[Array, Array] | None = None,
) -> Measured:
    """Return simulated runs as if their tight and slack tensions had been measured exactly.

    Without `tensions` they are those at rest.
    """
    beta, T_0, omega = np.array([(point.beta, point.T_0, point.omega) for point in points]).T
    tight, slack = (T_0, T_0) if tensions is None else tensions
    mu, given = friction_coefficient(tight, slack, beta), bench.rig.given_force
    settings = bench.rig.R, arc, beta, T_0, omega
    return Measured(*settings, tight, slack, mu, np.zeros(mu.size), kind=kind, given_force=given)


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
    """The runs of a campaign with the belt laid on once, ready to slide with many surfaces.

    Each run belongs to the nearest of the speeds (m,) [m/s], increasing. The mesh is a ratio of
    belt elements to the default, their number in each run, or that of the models of a rig that
    differs a little: the noise of another mesh is larger than the difference. `inputs` (n, 8) take
    the place of those of the campaign.
    """

    def __init__(
        self,
        campaign: Campaign,
        speeds: Array,
        mesh: float | Sequence[int | RigModel],
        inputs: Array | None = None,
    ) -> None:
        bench, runs = campaign.bench, campaign.measured
        inputs = campaign.inputs(runs) if inputs is None else inputs
        self.beta, self.speeds = inputs[:, 0], np.asarray(speeds, dtype=float)
        self.label = np.argmin(np.abs(np.log(runs.slip_speed[:, None] / self.speeds)), axis=1)
        self.off_speed = np.log(runs.slip_speed / self.speeds[self.label])
        self.models: list[RigModel] = []
        for i, (beta, T_0, R, span, EI, EA, *k) in enumerate(inputs.tolist()):
            belt, rig = replace(bench.belt, EI=EI, EA=EA), replace(bench.rig, R=R, span=span)
            of_run = replace(bench, belt=belt, rig=rig, law=NormalLaw(*k))
            point = OperatingPoint(beta, T_0, self.speeds[self.label[i]] / R)
            if isinstance(mesh, float):
                own: int | RigModel = even(mesh * (of_run.model(point).nodes.size - 1))
            else:
                own = mesh[i]
            self.models.append(of_run.model(point, own))
        self._laid = [lay_on(model) for model in self.models]

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
            load = state.points[state.touching]["F_N"]
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
    ) -> Iterator[tuple[RigModel, StaticState, FrictionSurface]]:
        for model, laid, j in zip(self.models, self._laid, self.label, strict=True):
            run = model.with_surface(surfaces[j])
            yield run, slide(run, laid), surfaces[j]


def even(number: float) -> int:
    """Round a number of elements to an even one."""
    return 2 * round(0.5 * number)


def input_slopes(
    campaign: Campaign, surfaces: Sequence[FrictionSurface], speeds: Array, speed_slope: Array
) -> Array:
    """Compute derivatives of the simulated ln mu of each run by the ln of each input (n, 8).

    `surfaces` holds the surface at each of the speeds [m/s], `speed_slope` the derivative of ln mu
    of each run by ln v (n,).
    """
    rig, inputs = RigRuns(campaign, speeds, MESH), campaign.inputs(campaign.measured)
    nominal, steps = rig.log_mu(surfaces, speed_slope), 1.0 + STEP * np.eye(len(INPUTS))
    stepped = (RigRuns(campaign, speeds, rig.models, inputs * step) for step in steps)
    columns = [near.log_mu(surfaces, speed_slope) - nominal for near in stepped]
    return np.asarray(np.column_stack(columns) / np.log1p(STEP))


def residual_changes(
    campaign: Campaign, sources: Sequence[Source], slopes: Array, speed_slope: Array
) -> Array:
    """Compute the change of measured minus simulated ln mu by one u of each source (n, K).

    With the derivatives of the simulated ln mu of :func:`input_slopes`, (n, 8) and (n,).
    """
    before = campaign.measured
    inputs = campaign.inputs(before)

    def residual(errors: Errors) -> Array:
        """Return the residual with errors corrected, less that without."""
        after = before.corrected(errors)
        corrected = campaign.inputs(after, errors)
        known = (inputs > 0.0) & (corrected > 0.0)  # either coefficient of the law may be zero
        steps = np.log(np.divide(corrected, inputs, out=np.ones_like(inputs), where=known))
        simulated = np.sum(slopes * steps, axis=1)
        simulated += speed_slope * np.log(after.slip_speed / before.slip_speed)
        return np.asarray(np.log(after.mu / before.mu) - simulated)

    return changes_by(sources, residual)
