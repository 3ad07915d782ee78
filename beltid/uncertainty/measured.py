"""Reduced runs of a friction rig from the columns of their table, and with errors corrected."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.laws.capstan import (
    hub_force,
    mean_normal_force,
    sliding_speed,
    tensions_by_hub_force,
    tensions_by_torque,
)
from beltid.params import GivenForce
from beltid.refine.effects import Effect
from beltid.uncertainty.sources import REDUCTION_SOURCES, Errors

Array = NDArray[np.float64]

POSITIVE = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")
ARC_GAP = 1e-3  # relative; arcs are nominal settings and only differ by rounding


@dataclass(frozen=True, slots=True)
class Measured:
    """Reduced runs of a friction rig, arrays (n,).

    Attributes
    ----------
    R : float
        Radius of the belt's centreline on the pulley [m].
    arc : ndarray of int
        Number of the arc setting.
    beta : ndarray
        Contact arc [rad].
    T_0 : ndarray
        Initial tension [N], mean of both cells; where a force is given, the tension it gives.
    omega : ndarray
        Speed of the pulley [rad/s].
    tight, slack : ndarray
        Tensions while sliding [N].
    mu, mu_se : ndarray
        Sliding coefficient by Eq. (6) and its standard error by the scatter of the run [-].
    columns : mapping of str to ndarray, shape (n, places)
        Change of ln mu of each run by a unit of errors that runs share and follow each in its own
        way: key of the source -> a column per place.
    order : ndarray of int, optional
        Place of each run in the campaign; by default they come one after the other.
    temperature_degC : ndarray, optional
        Temperature of each run while sliding [°C], nan where it is not known, as by default.
    largest_tension : float, optional
        Largest tension of the campaign [N]; by default that of these runs.
    kind : RigKind
        What the rig measures: which errors the tensions can have.
    given_force : {"none", "tight", "slack", "hub"}
        Force that stays while the pulley turns, see :class:`beltid.params.Rig`.
    momentum : ndarray or float
        Part of the tensions as they were measured that turned a running belt [N]; it is taken off
        all tensions here.
    beside_torque : ndarray of bool, optional
        Whether it is the tight tension that was measured beside a torque; by default as the kind
        says.
    """

    R: float
    arc: NDArray[np.intp]
    beta: Array
    T_0: Array
    omega: Array
    tight: Array
    slack: Array
    mu: Array
    mu_se: Array
    columns: Mapping[str, Array] = field(default_factory=dict)
    order: NDArray[np.intp] | None = None
    temperature_degC: Array | None = None
    largest_tension: float | None = None
    kind: RigKind = TWO_CELLS
    given_force: GivenForce = "none"
    momentum: Array | float = 0.0
    beside_torque: NDArray[np.bool_] | None = None

    @property
    def arcs_deg(self) -> Array:
        """Contact arc of each setting, in the order of their numbers [deg]."""
        numbers = range(int(self.arc.max()) + 1)
        return np.array([np.degrees(self.beta[self.arc == k].mean()) for k in numbers])

    @property
    def normal_force(self) -> Array:
        """Mean of Eq. (8) over the arc [N/m]."""
        return mean_normal_force(self.tight, self.slack, self.R)

    @property
    def slip_speed(self) -> Array:
        """Sliding speed, Eq. (7) [m/s]."""
        return sliding_speed(self.omega, self.R)

    def with_effects(self, effects: Sequence[Effect], response: Array) -> Self:
        """The runs with what shifts the friction beside the surface among the columns.

        `response` (n,) is the derivative of ln mu of each run by ln of a factor on the surface.
        """
        columns = {
            effect.key: effect.columns * response[:, None]
            for effect in effects
            if effect.before is not None
        }
        return replace(self, columns={**self.columns, **columns})

    def corrected(self, errors: Errors) -> Self:
        """The runs with errors put right: each value as it would truly have been.

        Raises
        ------
        InputError
            If an error is as large as what it is an error of.
        """
        setting = np.array([errors.at("arc_setting", int(k)) for k in self.arc])
        beta = self.beta + errors.at("arc") + setting
        tight, slack, T_0 = self._corrected_tensions(errors, beta)
        lowest = min(float(np.min(a)) for a in (tight, slack, beta, T_0))
        if not lowest > 0.0:
            raise InputError(
                "uncertainty: an error of the load cells or of the arc is as large as a tension or "
                f"an arc itself (lowest tension {np.min(self.slack):.3g} N, shortest arc "
                f"{np.degrees(np.min(self.beta)):.3g} deg), must be small against them"
            )
        log_ratio = self.mu * self.beta + np.log(tight / self.tight) - np.log(slack / self.slack)
        corrected = replace(
            self,
            R=self.R * (1.0 + errors.at("pulley_radius")),
            beta=beta,
            T_0=T_0,
            omega=self.omega * (1.0 + errors.at("pulley_speed")),
            tight=tight,
            slack=slack,
            mu=log_ratio / beta,
        )
        return corrected.scattered(self._by_columns(errors))

    def scattered(self, change: Array) -> Self:
        """Runs whose ln mu differs by `change` (n,), their force at rest unchanged.

        One tension rises and the other falls; what is given, a tension or their sum, stays.
        """
        more = self.mu * self.beta * np.expm1(change)  # of ln(tight/slack)
        if self.given_force == "hub":
            both, ratio = self.tight + self.slack, self.tight / self.slack * np.exp(more)
            tight, slack = both * ratio / (1.0 + ratio), both / (1.0 + ratio)
        else:
            of_tight = {"none": 0.5, "tight": 0.0, "slack": 1.0}[self.given_force]
            tight = self.tight * np.exp(of_tight * more)
            slack = self.slack * np.exp((of_tight - 1.0) * more)
        return replace(self, mu=self.mu * np.exp(change), tight=tight, slack=slack)

    def _corrected_tensions(self, errors: Errors, beta: Array) -> tuple[Array, Array, Array]:
        """Tight, slack and initial tension [N] with errors of what is measured put right.

        Each kind by its own formula, as in :mod:`beltid.identify.friction.kinds`; `beta` (n,) is
        the arc put right. The only cell beside a torque is that of its span; the force on the axis
        has the errors of the first cell. A weight has none.
        """
        kind, R = self.kind, self.R * (1.0 + errors.at("pulley_radius"))
        M = (self.tight - self.slack) * self.R * (1.0 + errors.at("torque_gain"))
        M = M - errors.at("bearing_drag")
        if kind.measures == "torque_hub":
            hub = self._cell(
                errors, 0, hub_force(self.tight, self.slack, self.beta, self.R, kind.spans)
            )
            spans = replace(
                kind.spans,
                EI=kind.spans.EI * (1.0 + errors.at("bending_stiffness")),
                length=kind.spans.length + errors.at("span_length"),
            )
            tight, slack = tensions_by_hub_force(M, hub, beta, R, spans)
            T_0 = self._cell(errors, 0, self.T_0)
        elif kind.measures == "torque":
            of_tight = self.beside_torque
            if of_tight is None:
                of_tight = np.full(self.mu.size, kind.torque_with == "tight")
            by_tight = tensions_by_torque(M, R, T_tight=self._cell(errors, 0, self.tight))
            by_slack = tensions_by_torque(M, R, T_slack=self._cell(errors, 1, self.slack))
            tight, slack = np.where(of_tight, by_tight, by_slack)
            T_0 = np.where(of_tight, *(self._cell(errors, cell, self.T_0) for cell in (0, 1)))
        else:
            tight, slack = self._cell(errors, 0, self.tight), self._cell(errors, 1, self.slack)
            T_0 = 0.5 * (self._cell(errors, 0, self.T_0) + self._cell(errors, 1, self.T_0))
            if kind.weight is not None:
                turning = self._turning(errors)
                T_0 = self.T_0 - turning
                tight, slack = (
                    (self.tight - turning, slack)
                    if kind.weight == "tight"
                    else (tight, self.slack - turning)
                )
        return tight, slack, tension_given(self.given_force, tight, slack, T_0)

    def _cell(self, errors: Errors, cell: int, tension: Array) -> Array:
        """Tensions by a cell that is put right [N]; cell 0 is the tight one.

        The cell reads what turns a running belt, too; that is taken off by the belt's mass.
        """
        zero, reading = errors.at("cell_offset", cell), tension + self.momentum
        gain = self._gain(errors, cell, reading)
        return np.asarray(tension + reading * gain + zero - self._turning(errors))

    def _turning(self, errors: Errors) -> Array | float:
        """Error of m v² (n,) [N], which is taken off all tensions of a running belt.

        The speed of the belt is taken as known as well as that of the pulley, whose gain it shares.
        """
        return self.momentum * (errors.at("mass_per_length") + 2.0 * errors.at("pulley_speed"))

    def _gain(self, errors: Errors, cell: int, tension: Array) -> Array:
        """Error of the gain of a cell at some tensions, as a share."""
        largest = self.largest_tension or float(np.max(self.tight))
        gain = errors.at("tension_gain") + errors.at("cell_gain", cell)
        return np.asarray(gain + errors.at("cell_linearity", cell) * tension / largest)

    def _by_columns(self, errors: Errors) -> Array:
        """Change of ln mu (n,) by the errors that each run follows in its own way."""
        change = np.zeros(self.mu.size)
        for key, columns in self.columns.items():
            size = [errors.at(key, place) for place in range(columns.shape[1])]
            change += np.sum(columns * size, axis=1)
        return change


def tension_given(given: GivenForce, tight: Array, slack: Array, T_0: Array) -> Array:
    """Tension before the pulley turns (n,) [N], from those while sliding where a force is given."""
    return {"none": T_0, "tight": tight, "slack": slack, "hub": 0.5 * (tight + slack)}[given]


def measured_runs(
    columns: Mapping[str, np.ndarray],
    rows: np.ndarray,
    R: float,
    kind: RigKind = TWO_CELLS,
    given_force: GivenForce = "none",
) -> Measured:
    """Rows of a friction table; the tensions follow from force and coefficient, Eqs. (5) and (8).

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of a friction table.
    rows : ndarray of int
        The rows to take, valid ones.
    R : float
        Radius of the belt's centreline on the pulley [m].
    kind : RigKind
        What the rig measures.
    given_force : {"none", "tight", "slack", "hub"}
        Force that stays while the pulley turns.

    Returns
    -------
    Measured
        A standard error that is missing is the median of the others, or zero if none is known; what
        the runs share is not in it but in the columns.
    """
    arc_deg, f, v, mu = (np.asarray(columns[name], dtype=float)[rows] for name in POSITIVE)
    own = own_errors(columns)
    errors = np.full(mu.size, np.nan) if own is None else own[rows]
    known = np.isfinite(errors)
    typical = float(np.median(errors[known])) if known.any() else 0.0
    initial, warm = columns.get("initial_tension_N"), columns.get("temperature_degC")
    beta = np.radians(arc_deg)
    log_ratio = mu * beta
    slack = f * R * log_ratio / np.expm1(log_ratio)
    tight = slack * np.exp(log_ratio)
    T_0 = np.sqrt(tight * slack) if initial is None else np.asarray(initial, dtype=float)[rows]
    T_0 = np.where(np.isfinite(T_0), T_0, np.sqrt(tight * slack))
    turning, beside = columns.get("momentum_N"), columns.get("torque_with")
    return Measured(
        R=R,
        arc=arc_settings(arc_deg),
        beta=beta,
        T_0=tension_given(given_force, tight, slack, T_0),
        omega=np.abs(v) / R,
        tight=tight,
        slack=slack,
        mu=mu,
        mu_se=np.where(known, errors, typical),
        columns={key: values[rows][:, None] for key, values in shared_columns(columns).items()},
        order=np.asarray(rows, dtype=np.intp),
        temperature_degC=None if warm is None else np.asarray(warm, dtype=float)[rows],
        kind=kind,
        given_force=given_force,
        momentum=0.0 if turning is None else np.nan_to_num(np.asarray(turning, dtype=float)[rows]),
        beside_torque=None if beside is None else np.asarray(beside == "tight")[rows],
    )


def shared_columns(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Change of ln mu of each run (n,) by what the reduction shares; 0 where it is not known."""
    named = {key: np.asarray(columns[key], float) for key, _ in REDUCTION_SOURCES if key in columns}
    return {key: np.where(np.isfinite(values), values, 0.0) for key, values in named.items()}


def own_errors(columns: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Standard errors of mu (n,) without what the runs share; None if the table has none.

    The column ``mu_sliding_se`` is the whole of it: its own and the shared parts add up in squares.
    """
    if "mu_sliding_se" not in columns:
        return None
    whole, mu = (np.asarray(columns[key], float) for key in ("mu_sliding_se", "mu_sliding"))
    shared = sum(np.square(mu * share) for share in shared_columns(columns).values())
    return np.asarray(np.sqrt(np.maximum(np.square(whole) - shared, 0.0)))


def arc_settings(arc_deg: np.ndarray) -> np.ndarray:
    """Number of the arc setting of each run (n,), ascending from 0."""
    order = np.argsort(arc_deg, kind="stable")
    ordered = arc_deg[order]
    labels = np.empty(arc_deg.size, dtype=np.intp)
    labels[order] = np.concatenate([[0], np.cumsum(np.diff(ordered) > ARC_GAP * ordered[:-1])])
    return labels


def numbered_arcs(
    arcs_deg: Sequence[float] | np.ndarray, known_deg: Sequence[float] | np.ndarray
) -> tuple[NDArray[np.intp], list[float]]:
    """Number of each arc (n,) among known ones, and all arcs [deg]: new ones follow the known."""
    every = [float(arc) for arc in known_deg]
    numbers = []
    for arc in arcs_deg:
        near = [k for k, other in enumerate(every) if math.isclose(arc, other, rel_tol=ARC_GAP)]
        numbers.append(near[0] if near else len(every))
        if not near:
            every.append(float(arc))
    return np.array(numbers, dtype=np.intp), every


def valid_rows(columns: Mapping[str, Any], rows: np.ndarray) -> np.ndarray:
    """Those of some rows whose arc, force, speed and coefficient are positive numbers."""
    good = np.ones(rows.size, dtype=bool)
    for name in POSITIVE:
        values = np.asarray(columns[name], dtype=float)[rows]
        values = np.abs(values) if name == "slip_speed_m_s" else values
        good &= np.isfinite(values) & (values > 0.0)
    return np.asarray(rows[good])
