"""The loop at rod level: what the bending stiffness of the belt changes on each pulley.

Spans longer than six bending lengths part the pulleys, so a drive is a chain of one-pulley maps
that span forces, flow and levers couple. Of the torque and the speed of a pulley the string misses
little, and this little hardly changes with the forces. So the loop of the string is solved with the
difference of rod and string added to each pulley (D12), the rods are solved with its forces, and
so on until the forces stay: twice, as a rule.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.drive.loop import LoopState, RestState, solve_loop
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.rod import SHORTEST_SPAN, RodPulley, RodState, pulley_map
from beltid.drive.string import Arcs, StringLevel
from beltid.errors import ConvergenceError, InputError
from beltid.rigsim.beam.path import bending_length

Array = NDArray[np.float64]

MOST_ROUNDS: Final = 12
FORCE_TOLERANCE: Final = 1e-4
"""Change of the span forces over the tension at rest with which the rods need no other round."""
TENSION_STEP: Final = 0.05
"""Of the logarithm of the tension: nearly the same tensions share a mesh."""
REMEMBERED: Final = 12
"""States of a pulley of which the nearest is where the next one is begun from."""
FASTEST_WITHOUT_RANGE: Final = 0.05
"""Sliding speed over that of the belt taken for the limit of a friction without a speed range."""


@dataclass(frozen=True, slots=True)
class Corrected:
    """Pulleys at string level with the difference to the rods added, (D12).

    Parameters
    ----------
    level : StringLevel
        The string.
    torque : ndarray (n,)
        To be added to the torques [N m].
    speed : ndarray (n,)
        Factor on the speeds of the pulleys [-].
    """

    level: StringLevel
    torque: Array
    speed: Array

    def arcs(self, P_in: Array, P_out: Array, v0: float, wraps: Array) -> Arcs:
        """State of the belt on every pulley, as :meth:`StringLevel.arcs`."""
        arcs = self.level.arcs(P_in, P_out, v0, wraps)
        return arcs._replace(
            torque=arcs.torque + self.torque, W=arcs.W * self.speed, rate=arcs.rate * self.speed
        )


@dataclass(slots=True)
class _Known:
    """Rod of one pulley, and the states that were found."""

    pulley: RodPulley
    states: deque[RodState] = field(default_factory=lambda: deque(maxlen=REMEMBERED))

    def fits(self, state: RodState | None) -> bool:
        """Whether a state has as many nodes."""
        return state is not None and state.contact.q.size == 4 * self.pulley.model.nodes.size

    def nearest(self, v0: float, P_in: float, P_out: float) -> RodState | None:
        """The state with the nearest forces and flow."""

        def distance(state: RodState) -> float:
            steps = (state.P_in / P_in, state.P_out / P_out, state.v0 / v0)
            return sum(abs(math.log(step)) for step in steps)

        return min(self.states, key=distance, default=None)


class RodLevel:
    """The pulleys of a drive at rod level.

    The back of the belt is taken as rigid: such pulleys stay those of the string.

    Parameters
    ----------
    drive : Drive
        Belt, laws and pulleys.
    level : StringLevel
        The same at string level.

    Raises
    ------
    InputError
        If there is no contact law, as a rigid pulley has no bed.
    """

    def __init__(self, drive: Drive, level: StringLevel) -> None:
        if drive.law is None:
            raise InputError(
                "rod level: a contact law of the ribs is needed; rigid pulleys have none"
            )
        self.drive, self.level = drive, level
        self._known: dict[tuple[int, float, float], _Known] = {}
        fastest = drive.surface.validity["slip_speed_m_s"][1]
        self.fastest = float(fastest)

    def solve(self, point: DrivePoint, rest: RestState, near: LoopState | None = None) -> LoopState:
        """Find the steady state of an operating point.

        Parameters
        ----------
        point : DrivePoint
            The operating point.
        rest : RestState
            The belt at rest.
        near : LoopState, optional
            State of a drive that differs little, from which the search is begun.

        Raises
        ------
        InputError
            If a span is shorter than six bending lengths.
        ConvergenceError
            If the loop or a rod has no steady state, or both do not come together.
        """
        state = solve_loop(self.drive, point, self.level, rest, near)
        for _ in range(MOST_ROUNDS):
            if state.slack or np.isnan(state.arcs.slip).any():
                return state
            rods, slip = self._rods(state, rest, near)
            if np.isnan(slip).any():
                return replace(state, arcs=state.arcs._replace(slip=slip))
            of_string = self.level.arcs(state.P_in, state.P, state.v0, state.laid.wraps)
            corrected = _difference(self.level, of_string, rods)
            last, state = state, solve_loop(self.drive, point, corrected, rest, state)
            moved = float(np.abs(state.P - last.P).max()) / rest.T_0
            if moved <= FORCE_TOLERANCE:
                return replace(state, arcs=self._arcs(state, slip), rods=rods)
        raise ConvergenceError(
            f"drive at {point.omega:g} rad/s: forces of loop and rods do not come together in "
            f"{MOST_ROUNDS} rounds; they still change by {moved:.2g} of the tension at rest",
            iterations=MOST_ROUNDS,
            residual=moved,
        )

    def _arcs(self, state: LoopState, slip: Array) -> Arcs:
        """Arcs of a state with what the rods say of slip.

        By how much a pulley is ahead of a belt whose ribs shear, the string says.
        """
        arcs, R = state.arcs, np.array([pulley.R for pulley in self.drive.pulleys])
        ahead = np.where(state.P_in > state.P, slip, -slip) / (R * state.v0)
        needed = np.where(slip > 0.0, np.maximum(arcs.needed, state.laid.wraps), arcs.needed)
        rate = arcs.rate if math.isfinite(self.drive.shear_stiffness) else arcs.W - ahead
        return arcs._replace(rate=rate, slip=slip, needed=needed)

    def _rods(
        self, state: LoopState, rest: RestState, near: LoopState | None
    ) -> tuple[tuple[RodState | None, ...], Array]:
        """Rods with the forces of a loop, and the sliding speed of each pulley as a whole [m/s]."""
        rods: list[RodState | None] = []
        slip = np.zeros(len(self.drive.pulleys))
        for i, pulley in enumerate(self.drive.pulleys):
            if not pulley.ribs:
                rods.append(None)
                slip[i] = state.arcs.slip[i]
                continue
            known = self._rod(i, state, rest)
            P_in, P_out = float(state.P_in[i]), float(state.P[i])
            start = known.nearest(state.v0, P_in, P_out)
            if near is not None and near.rods and known.fits(near.rods[i]):
                start = near.rods[i]
            try:
                rod = pulley_map(known.pulley, state.v0, P_in, P_out=P_out, start=start)
            except ConvergenceError:
                if not self._is_beyond_limit(known.pulley, state, i):
                    raise
                rods.append(None)
                slip[i] = math.nan
                continue
            known.states.append(rod)
            rods.append(rod)
            slip[i] = rod.whole_slip
            if slip[i] > self.fastest:
                slip[i] = math.nan
        return tuple(rods), slip

    def _rod(self, i: int, state: LoopState, rest: RestState) -> _Known:
        """Rod of a pulley; near tensions and the same wrap share a mesh."""
        wrap = float(state.laid.wraps[i])
        tension = math.exp(round(math.log(rest.T_0) / TENSION_STEP) * TENSION_STEP)
        key = (i, wrap, tension)
        if key not in self._known:
            drive = self.drive
            assert drive.law is not None
            half = 0.5 * float(min(state.laid.spans[i], state.laid.spans[i - 1]))
            shortest = SHORTEST_SPAN * bending_length(drive.belt.EI, tension)
            span = max(half, shortest)
            self._known[key] = _Known(
                RodPulley(
                    drive.belt,
                    drive.law,
                    drive.surface,
                    drive.pulleys[i].R,
                    wrap,
                    span,
                    tension,
                    shear_stiffness=drive.shear_stiffness,
                    slow_trend=drive.slow_trend,
                )
            )
        return self._known[key]

    def _is_beyond_limit(self, pulley: RodPulley, state: LoopState, i: int) -> bool:
        """Whether even the fastest known sliding of the whole arc cannot hold the forces."""
        P_in, P_out, v0 = float(state.P_in[i]), float(state.P[i]), state.v0
        fastest = self.fastest if math.isfinite(self.fastest) else FASTEST_WITHOUT_RANGE * v0
        ahead = math.copysign(fastest, P_in - P_out) / (pulley.R * v0)
        try:
            limit = pulley_map(pulley, v0, P_in, W=float(state.arcs.rate[i]) + ahead)
        except ConvergenceError:
            return False
        return abs(math.log(P_out / P_in)) > abs(math.log(limit.P_out / P_in))


def _difference(
    level: StringLevel, of_string: Arcs, rods: tuple[RodState | None, ...]
) -> Corrected:
    """What the rods have beyond the string with the same forces."""
    torque, speed = np.zeros(len(rods)), np.ones(len(rods))
    for i, rod in enumerate(rods):
        if rod is not None:
            torque[i] = rod.torque - of_string.torque[i]
            speed[i] = rod.W / of_string.W[i]
    return Corrected(level, torque, speed)
