"""Solve the loop at rod level: the effect of the bending stiffness of the belt on each pulley.

Spans longer than six bending lengths decouple the pulleys, so a drive is a chain of one-pulley maps
coupled by span forces, flow and levers. The string nearly reproduces the torque and the speed of a
pulley, and its error hardly changes with the forces. So the loop of the string is solved with the
difference of rod and string added to each pulley (D12), then the rods are solved with its forces.
This repeats until the forces no longer change, usually twice.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.drive.bending import extra_at_end, extra_length, further_out
from beltid.drive.geometry import Layout
from beltid.drive.loop import LoopState, RestState, solve_loop
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.rod import SHORTEST_SPAN, RodPulley, RodState, pulley_map
from beltid.drive.string import Arcs, StringLevel
from beltid.errors import ConvergenceError, InputError
from beltid.rigsim.beam.path import Path, bending_length
from beltid.rigsim.steady import lay_on

Array = NDArray[np.float64]

MOST_ROUNDS: Final = 12
FORCE_TOLERANCE: Final = 1e-4
"""Change of the span forces over the tension at rest at which the rods have converged."""
TENSION_STEP: Final = 0.05
"""Step of the logarithm of the tension within which tensions share a mesh."""
REMEMBERED: Final = 12
"""Number of stored states per pulley; the next solution starts from the nearest one."""
FASTEST_WITHOUT_RANGE: Final = 0.05
"""Largest sliding speed over belt speed, for friction without a speed range [-]."""


@dataclass(frozen=True, slots=True)
class Corrected:
    """Pulleys at string level plus the difference to the rods, (D12) and (D15).

    Parameters
    ----------
    drive : Drive
        Belt, laws and pulleys.
    level : StringLevel
        The string.
    torque : ndarray (n,)
        Correction added to the torques [N m].
    speed : ndarray (n,)
        Factor on the speeds of the pulleys [-].
    length : float
        Correction added to the length of the loop, in addition to (D15) [m].
    """

    drive: Drive
    level: StringLevel
    torque: Array
    speed: Array
    length: float

    def arcs(self, P_in: Array, P_out: Array, v0: float, wraps: Array) -> Arcs:
        """Return the corrected state of the belt on every pulley, as :meth:`StringLevel.arcs`."""
        arcs = self.level.arcs(P_in, P_out, v0, wraps)
        return arcs._replace(
            torque=arcs.torque + self.torque, W=arcs.W * self.speed, rate=arcs.rate * self.speed
        )

    def extra_length(self, laid: Layout, P: Array) -> float:
        """Return the length of the loop beyond that of a string [m], (D15)."""
        return extra_length(self.drive, laid, P) + self.length


@dataclass(slots=True)
class _CachedRod:
    """Rod of one pulley, and its latest solutions."""

    pulley: RodPulley
    states: deque[RodState] = field(default_factory=lambda: deque(maxlen=REMEMBERED))

    def fits(self, state: RodState | None) -> bool:
        """Return whether a state has the same number of nodes."""
        return state is not None and state.contact.q.size == 4 * self.pulley.model.nodes.size

    def nearest(self, v0: float, P_in: float, P_out: float) -> RodState | None:
        """Return the stored state with the nearest forces and flow."""

        def distance(state: RodState) -> float:
            steps = (state.P_in / P_in, state.P_out / P_out, state.v0 / v0)
            return sum(abs(math.log(step)) for step in steps)

        return min(self.states, key=distance, default=None)


def short_spans(drive: Drive, spans: Array, P: Array) -> list[str]:
    """Describe the spans that are shorter than six bending lengths at their force."""
    names = [pulley.name for pulley in drive.pulleys]
    shortest = [SHORTEST_SPAN * bending_length(drive.belt.EI, force) for force in P.tolist()]
    return [
        f"span {name} to {names[(i + 1) % len(names)]}: {spans[i]:.3g} m, must be at least "
        f"{shortest[i]:.3g} m, six bending lengths of the belt at {P[i]:.3g} N, for drive.method: "
        "rod; string has no bending"
        for i, name in enumerate(names)
        if spans[i] < shortest[i]
    ]


class RodLevel:
    """The pulleys of a drive at rod level.

    Pulleys on the back of the belt stay at string level, because the back is assumed to be rigid.

    Parameters
    ----------
    drive : Drive
        Belt, laws and pulleys.
    level : StringLevel
        The pulleys at string level.

    Raises
    ------
    InputError
        If there is no contact law, because a rigid pulley has no bed.
    """

    def __init__(self, drive: Drive, level: StringLevel) -> None:
        if drive.law is None:
            raise InputError("rod level: needs a contact law of the ribs; rigid pulleys have none")
        self.drive, self.level = drive, level
        self._cache: dict[tuple[int, float, float], _CachedRod] = {}
        self._lengths_at_rest: dict[tuple[float, tuple[float, ...]], float] = {}
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
            State of a similar drive, from which the search starts.

        Raises
        ------
        ConvergenceError
            If the loop or a rod has no steady state, or their forces do not converge.
        """
        n, length = len(self.drive.pulleys), self._beyond_bending_at_rest(rest.laid, rest.T_0)
        first = Corrected(self.drive, self.level, np.zeros(n), np.ones(n), length)
        state = solve_loop(self.drive, point, first, rest, near)
        for _ in range(MOST_ROUNDS):
            if state.slack or np.isnan(state.arcs.slip).any():
                return state
            if state.v0 <= 0.0:  # the belt would have to slide faster than the driver turns
                return replace(state, arcs=state.arcs._replace(slip=np.full(n, np.nan)))
            rods, slip = self._rods(state, rest.T_0, near)
            if np.isnan(slip).any():
                return replace(state, arcs=state.arcs._replace(slip=slip))
            of_string = self.level.arcs(state.P_in, state.P, state.v0, state.laid.wraps)
            corrected = self._corrected(state, of_string, rods)
            last, state = state, solve_loop(self.drive, point, corrected, rest, state)
            moved = float(np.abs(state.P - last.P).max()) / rest.T_0
            if moved <= FORCE_TOLERANCE:
                return replace(state, arcs=self._arcs(state, slip), rods=rods)
        raise ConvergenceError(
            f"drive at {point.omega:g} rad/s: the forces of loop and rods did not converge in "
            f"{MOST_ROUNDS} rounds; they still change by {moved:.2g} of the tension at rest",
            iterations=MOST_ROUNDS,
            residual=moved,
        )

    def _arcs(self, state: LoopState, slip: Array) -> Arcs:
        """Return the arcs of a state with the slip of the rods."""
        arcs, R = state.arcs, np.array([pulley.R for pulley in self.drive.pulleys])
        ahead = np.where(state.P_in > state.P, slip, -slip) / (R * state.v0)
        needed = np.where(slip > 0.0, np.maximum(arcs.needed, state.laid.wraps), arcs.needed)
        return arcs._replace(rate=arcs.W - ahead, slip=slip, needed=needed)

    def arcs(self, P_in: Array, P_out: Array, v0: float, wraps: Array) -> Arcs:
        """Return the state of the belt on the pulleys at string level, before any rod is solved."""
        return self.level.arcs(P_in, P_out, v0, wraps)

    def extra_length(self, laid: Layout, P: Array) -> float:
        """Return the length of the loop at rest beyond that of a string [m], at a uniform force."""
        bent = extra_length(self.drive, laid, P)
        return bent + self._beyond_bending_at_rest(laid, float(P[0]))

    def _beyond_bending_at_rest(self, laid: Layout, T_0: float) -> float:
        """Return the length beyond (D15) of rods that are laid on without friction [m]."""
        if self.drive.installation == "slack_force":
            return 0.0
        key = (T_0, tuple(laid.wraps.tolist()))
        if key not in self._lengths_at_rest:
            P, length = np.full(len(self.drive.pulleys), T_0), 0.0
            on_arcs = self.level.arcs(P, P, 0.0, laid.wraps).length
            for i, pulley in enumerate(self.drive.pulleys):
                if pulley.ribs:
                    model = self._rod(i, laid, T_0).pulley.model
                    rod = lay_on(replace(model, point=replace(model.point, T_0=T_0)))
                    own = rod.stretch * model.path.length - float(on_arcs[i])
                    length += own - self._bent_spans(i, model.path, (T_0, T_0), 0.0)
            self._lengths_at_rest[key] = length
        return self._lengths_at_rest[key]

    def _corrected(
        self, state: LoopState, of_string: Arcs, rods: tuple[RodState | None, ...]
    ) -> Corrected:
        """Compute the difference of the rods to the string, and their length beyond (D15)."""
        torque, speed, length = np.zeros(len(rods)), np.ones(len(rods)), 0.0
        for i, rod in enumerate(rods):
            if rod is None:
                continue
            torque[i] = rod.torque - of_string.torque[i]
            speed[i] = rod.W / of_string.W[i]
            path, forces = rod.contact.model.path, (rod.P_in, rod.P_out)
            own = rod.contact.stretch * path.length - float(of_string.length[i])
            length += own - self._bent_spans(i, path, forces, rod.v0)
        return Corrected(self.drive, self.level, torque, speed, length)

    def _bent_spans(self, i: int, path: Path, forces: tuple[float, float], v0: float) -> float:
        """Return the stress-free length of the spans computed with a rod, by (D15) [m]."""
        length = 0.0
        for P in forces:
            # the far end of the computed span stays on the tangent of the circle
            tilts = further_out(self.drive, i, P) ** 2 / (2.0 * path.span)
            bent = path.span + extra_at_end(self.drive, i, P) - tilts
            length += bent / float(self.drive.stretch(P, v0))
        return length

    def _rods(
        self, state: LoopState, T_0: float, near: LoopState | None
    ) -> tuple[tuple[RodState | None, ...], Array]:
        """Solve the rods with the forces of a loop; also return each pulley's whole slip [m/s]."""
        rods: list[RodState | None] = []
        slip = np.zeros(len(self.drive.pulleys))
        for i, pulley in enumerate(self.drive.pulleys):
            if not pulley.ribs:
                rods.append(None)
                slip[i] = state.arcs.slip[i]
                continue
            cached = self._rod(i, state.laid, T_0)
            P_in, P_out = float(state.P_in[i]), float(state.P[i])
            start = cached.nearest(state.v0, P_in, P_out)
            if near is not None and near.rods and cached.fits(near.rods[i]):
                start = near.rods[i]
            try:
                rod = pulley_map(cached.pulley, state.v0, P_in, P_out=P_out, start=start)
            except ConvergenceError:
                if not self._is_beyond_limit(cached.pulley, state, i):
                    raise
                rods.append(None)
                slip[i] = math.nan
                continue
            cached.states.append(rod)
            rods.append(rod)
            slip[i] = rod.whole_slip
            if slip[i] > self.fastest or rod.W <= 0.0:
                slip[i] = math.nan
        return tuple(rods), slip

    def _rod(self, i: int, laid: Layout, T_0: float) -> _CachedRod:
        """Return the rod of a pulley; similar tensions at the same wrap share a mesh."""
        wrap = float(laid.wraps[i])
        tension = math.exp(round(math.log(T_0) / TENSION_STEP) * TENSION_STEP)
        key = (i, wrap, tension)
        if key not in self._cache:
            drive = self.drive
            assert drive.law is not None
            half = 0.5 * float(min(laid.spans[i], laid.spans[i - 1]))
            shortest = SHORTEST_SPAN * bending_length(drive.belt.EI, tension)
            span = max(half, shortest)
            self._cache[key] = _CachedRod(
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
        return self._cache[key]

    def _is_beyond_limit(self, pulley: RodPulley, state: LoopState, i: int) -> bool:
        """Return whether even sliding at the fastest measured speed cannot hold the forces."""
        P_in, P_out, v0 = float(state.P_in[i]), float(state.P[i]), state.v0
        fastest = self.fastest if math.isfinite(self.fastest) else FASTEST_WITHOUT_RANGE * v0
        ahead = math.copysign(fastest, P_in - P_out) / (pulley.R * v0)
        try:
            limit = pulley_map(pulley, v0, P_in, W=float(state.arcs.rate[i]) + ahead)
        except ConvergenceError:
            return False
        return abs(math.log(P_out / P_in)) > abs(math.log(limit.P_out / P_in))
