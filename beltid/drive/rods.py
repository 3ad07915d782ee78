"""Solve the loop with a rod on each pulley: the belt bends, and its ribs seat over some length.

Spans longer than six bending lengths decouple the pulleys, so a drive is a chain of one-pulley maps
coupled by span forces, flow and levers. The loop of the string is solved with the difference of rod
and string added to each pulley (D12): torque, speed, stress-free length, and the part of the arc on
which the belt can slide towards its exit. Then the rods are solved with its forces. This repeats
until the forces no longer change, usually twice.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.drive.geometry import Layout
from beltid.drive.loop import LoopState, solve_loop
from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.rest import RestState
from beltid.drive.string import Arcs, StringLevel, seat, sliding_arc
from beltid.errors import ConvergenceError, InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt
from beltid.rig.flow import FlowPulley, FlowState, flow
from beltid.rig.mesh import bending_length

Array = NDArray[np.float64]

SHORTEST_SPAN: Final = 6.0
"""In bending lengths: the bending at pulleys further apart does not interact."""
MOST_ROUNDS: Final = 16
FORCE_TOLERANCE: Final = 5e-5
"""Change of the span forces over the tension at rest at which the rods have converged."""
TENSION_STEP: Final = 0.05
"""Step of the logarithm of the tension within which tensions share a mesh."""
FASTEST_WITHOUT_RANGE: Final = 0.05
"""Largest sliding speed over belt speed, for friction without a speed range [-]."""
SLIDING: Final = 0.01
"""Sliding speed over that of the belt of a rod whose whole arc slides [-]."""
ROOM_STEP: Final = 0.2
"""Step of the logarithm of the force within which such a rod is not solved again."""
SEATED: Final = 4.0
"""Lengths of the elastic bed behind the first contact after which the ribs are seated."""
END_STEP: Final = 0.4
"""Step of the logarithm of the force at which the ends of an arc are computed."""
LOOSEST: Final = 1.5
"""Bending length over the radius up to which they are."""
TIGHTEST: Final = 0.05
"""Strain up to which they are."""
REMEMBERED: Final = 12
"""Number of stored states per pulley; the next solution starts from the nearest one."""


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


def adhesion_arc(rod: FlowState) -> float:
    """Return the angle on which a rod sticks [rad]; a single point is no adhesion arc."""
    width = np.abs(np.gradient(rod.angle))
    pairs = rod.sticks[1:] & rod.sticks[:-1]
    return float(width[rod.sticks].sum()) if pairs.any() else 0.0


@dataclass(frozen=True, slots=True)
class WithRods:
    """Pulleys at string level plus the difference to the rods, (D12).

    Parameters
    ----------
    rods : RodLevel
        The string, and the ends of the arcs of a belt that bends.
    torque : ndarray (n,)
        Correction added to the torques [N m].
    speed : ndarray (n,)
        Factor on the speeds of the pulleys [-].
    length : float
        Correction added to the length of the loop [m].
    room : ndarray (n,)
        Correction added to the arc on which the belt can slide [rad].
    """

    rods: RodLevel
    torque: Array
    speed: Array
    length: float
    room: Array

    def arcs(self, P_in: Array, P_out: Array, v0: float, wraps: Array) -> Arcs:
        """Return the corrected state of the belt on every pulley, as :meth:`StringLevel.arcs`."""
        arcs = self.rods.level.arcs(P_in, P_out, v0, wraps, wraps + self.room)
        return arcs._replace(
            torque=arcs.torque + self.torque, W=arcs.W * self.speed, rate=arcs.rate * self.speed
        )

    def extra_length(self, laid: Layout, P: Array) -> float:
        """Return the stress-free length of the loop beyond that of a string [m]."""
        return self.rods.extra_length(laid, P) + self.length


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
        self.fastest = float(drive.surface.validity["slip_speed_m_s"][1])
        self._rooms: dict[tuple[tuple[int, float, float], bool, int], float] = {}
        self._pulleys: dict[tuple[int, float, float], FlowPulley] = {}
        self._states: dict[tuple[int, float, float], deque[FlowState]] = {}

    def arcs(self, P_in: Array, P_out: Array, v0: float, wraps: Array) -> Arcs:
        """Return the state of the belt on the pulleys at string level, before any rod is solved."""
        return self.level.arcs(P_in, P_out, v0, wraps)

    def extra_length(self, laid: Layout, P: Array) -> float:
        """Return the stress-free length of a loop that bends beyond that of a string [m], (D15).

        A belt that resists bending leaves the circle early and enters a span that runs further out
        than the tangent of the circle, the more so the looser the span.
        """
        total = 0.0
        for i, force in enumerate(P.tolist()):
            ends = (i, (i + 1) % P.size)
            total += sum(self._at_end(k, force) for k in ends)
            # both ends of the span move outwards, each to its side; the span tilts by the sum
            offsets = [laid.senses[k] * self._further_out(k, force) for k in ends]
            total -= (offsets[0] - offsets[1]) ** 2 / (2.0 * laid.spans[i])
        return float(total)

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
        n = len(self.drive.pulleys)
        level = WithRods(self, np.zeros(n), np.ones(n), 0.0, np.zeros(n))
        if near is not None and isinstance(near.level, WithRods):
            level = replace(near.level, rods=self)
        state = solve_loop(self.drive, point, level, rest, near)
        for _ in range(MOST_ROUNDS):
            if state.slack or np.isnan(state.arcs.slip).any():
                return state
            if state.v0 <= 0.0:  # the belt would have to slide faster than the driver turns
                return replace(state, arcs=state.arcs._replace(slip=np.full(n, np.nan)))
            rods = self._rods(state, rest, near)
            level = self._corrected(state, rest, rods)
            last, state = state, solve_loop(self.drive, point, level, rest, state)
            moved = float(np.abs(state.P - last.P).max()) / rest.T_0
            if moved <= FORCE_TOLERANCE:
                return self._told(state, rods)
        raise ConvergenceError(
            f"drive at {point.omega:g} rad/s: the forces of loop and rods did not converge in "
            f"{MOST_ROUNDS} rounds; they still change by {moved:.2g} of the tension at rest",
            iterations=MOST_ROUNDS,
            residual=moved,
        )

    def _told(self, state: LoopState, rods: tuple[FlowState | None, ...]) -> LoopState:
        """Return a state with what its rods say of the slip of whole pulleys."""
        slip = state.arcs.slip.copy()
        for i, rod in enumerate(rods):
            if rod is not None and not math.isnan(slip[i]):
                slip[i] = self._whole_slip(i, rod)
                if slip[i] > self.fastest or rod.W <= 0.0:
                    slip[i] = math.nan
        R = np.array([pulley.R for pulley in self.drive.pulleys])
        ahead = np.copysign(slip, state.P_in - state.P) / (R * state.v0)
        rate = np.where(np.isnan(slip), state.arcs.rate, state.arcs.W - ahead)
        return replace(state, arcs=state.arcs._replace(slip=slip, rate=rate), rods=rods)

    def _corrected(
        self, state: LoopState, rest: RestState, rods: tuple[FlowState | None, ...]
    ) -> WithRods:
        """Compute the difference of the rods to the string on the arcs at rest."""
        n, length = len(rods), 0.0
        torque, speed, room = np.zeros(n), np.ones(n), np.zeros(n)
        for i, rod in enumerate(rods):
            if rod is None:
                continue
            wrap, v0 = float(rest.laid.wraps[i]), state.v0
            forces, span = (rod.T_in, rod.T_out), self._pulley(i, rest).span
            # the rod holds what it does, and at least what it does if it slides as a whole
            s, slips = self.level.sections[i], self._whole_slip(i, rod)
            x = min(slips, self.fastest) if math.isfinite(self.fastest) else 0.0
            held = sliding_arc(*forces, v0, x, s)[0] + adhesion_arc(rod)
            room[i] = max(held, self._room(i, state, rest)) - wrap
            ones = np.ones(n)
            string = self.level.arcs(
                forces[0] * ones, forces[1] * ones, v0, wrap * ones, (wrap + room[i]) * ones
            )
            torque[i] = rod.torque - string.torque[i]
            speed[i] = rod.W / string.W[i]
            length += rod.length - float(string.length[i])
            for P in forces:
                # the far end of the computed span stays on the tangent of the circle
                tilts = self._further_out(i, P) ** 2 / (2.0 * span)
                length -= span / float(self.drive.stretch(P, v0)) + self._at_end(i, P) - tilts
        return WithRods(self, torque, speed, length, room)

    def _rods(
        self, state: LoopState, rest: RestState, near: LoopState | None
    ) -> tuple[FlowState | None, ...]:
        """Solve the rods with the forces of a loop; one that cannot hold them slides at most."""
        rods: list[FlowState | None] = []
        for i, pulley in enumerate(self.drive.pulleys):
            if not pulley.ribs:
                rods.append(None)
                continue
            rod, known = self._pulley(i, rest), self._known(i, rest)
            P_in, P_out, v0 = float(state.P_in[i]), float(state.P[i]), state.v0
            start = min(known, key=lambda s: _distance(s, P_in, P_out, v0), default=None)
            other = near.rods[i] if near is not None and near.rods else None
            if other is not None and other.q.size == 4 * rod.model.nodes.size:
                start = other
            try:
                found = flow(rod, v0, P_in, T_out=P_out, start=start)
            except ConvergenceError:
                found = self._at_fastest(rod, state, i)
                if abs(math.log(P_out / P_in)) < abs(math.log(found.T_out / P_in)):
                    raise  # friction could hold the forces
            known.append(found)
            rods.append(found)
        return tuple(rods)

    def _at_fastest(self, rod: FlowPulley, state: LoopState, i: int) -> FlowState:
        """Return the rod with the whole arc sliding at the fastest measured speed."""
        P_in, P_out, v0 = float(state.P_in[i]), float(state.P[i]), state.v0
        fastest = self.fastest if math.isfinite(self.fastest) else FASTEST_WITHOUT_RANGE * v0
        ahead = math.copysign(fastest, P_in - P_out) / rod.R
        return flow(rod, v0, P_in, omega=float(state.arcs.rate[i]) * v0 + ahead)

    def _room(self, i: int, state: LoopState, rest: RestState) -> float:
        """Return the arc of a string that carries what a rod carries if it slides as a whole [rad].

        It hardly depends on the forces, so that similar ones share it.
        """
        P_in, P_out, v0 = float(state.P_in[i]), float(state.P[i]), state.v0
        ahead = math.copysign(SLIDING * v0, P_in - P_out)
        key = (self._key(i, rest), ahead > 0.0, round(math.log(P_in) / ROOM_STEP))
        if key not in self._rooms:
            omega = float(state.arcs.rate[i]) * v0 + ahead / self.drive.pulleys[i].R
            try:
                rod = flow(self._pulley(i, rest), v0, P_in, omega=omega)
            except ConvergenceError:
                return float(rest.laid.wraps[i])
            s = self.level.sections[i]
            self._rooms[key] = sliding_arc(P_in, rod.T_out, v0, abs(ahead), s)[0]
        return self._rooms[key]

    def _pulley(self, i: int, rest: RestState) -> FlowPulley:
        """Return the rod of a pulley at rest; similar tensions share a mesh."""
        key = self._key(i, rest)
        if key not in self._pulleys:
            drive, spans = self.drive, rest.laid.spans
            assert drive.law is not None
            tension = key[2]
            shortest = SHORTEST_SPAN * bending_length(drive.belt.EI, tension)
            span = max(0.5 * float(min(spans[i], spans[i - 1])), shortest)
            self._pulleys[key] = FlowPulley(
                drive.belt, drive.law, drive.friction, drive.pulleys[i].R, key[1], span, tension
            )
            self._states[key] = deque(maxlen=REMEMBERED)
        return self._pulleys[key]

    def _known(self, i: int, rest: RestState) -> deque[FlowState]:
        return self._states[self._key(i, rest)]

    def _key(self, i: int, rest: RestState) -> tuple[int, float, float]:
        tension = math.exp(round(math.log(rest.T_0) / TENSION_STEP) * TENSION_STEP)
        return i, float(rest.laid.wraps[i]), tension

    def _whole_slip(self, i: int, rod: FlowState) -> float:
        """Return the sliding speed where the ribs are seated if nothing sticks [m/s], else 0."""
        if adhesion_arc(rod) > 0.0:
            return 0.0
        touching = np.flatnonzero(rod.line_force > 0.0)
        law, f = self.drive.law, float(np.median(rod.line_force[touching]))
        assert law is not None
        bed = (self.drive.belt.EI / float(law.stiffness(law.penetration(f)))) ** 0.25
        behind = np.abs(rod.angle - rod.angle[touching[0]]) * self.drive.pulleys[i].R
        seated = touching[behind[touching] >= SEATED * bed]
        return abs(float(rod.slip_speed[seated[0] if seated.size else touching[-1]]))

    def _further_out(self, i: int, P: float) -> float:
        """Return the offset of a span outwards from the tangent of pulley i, ``b²/(2R)`` [m]."""
        return self.drive.belt.EI / (2.0 * P * self.drive.pulleys[i].R)

    def _at_end(self, i: int, P: float) -> float:
        """Return the length beyond that of a string at one end of the arc of pulley i [m].

        ``b³/(12 R²)`` with ``b = sqrt(EI/P)`` on a rigid pulley; on a bed half of that of a rod
        laid on without friction: its ratio to b³ from a cubic over ln P.
        """
        pulley, b = self.drive.pulleys[i], bending_length(self.drive.belt.EI, P)
        if not pulley.ribs:
            return b**3 / (12.0 * pulley.R**2)
        # a looser belt hardly touches, a tighter one hardly bends
        loosest = self.drive.belt.EI / (LOOSEST * pulley.R) ** 2
        place = math.log(min(max(P, loosest), TIGHTEST * self.drive.belt.EA)) / END_STEP
        k = math.floor(place)
        t = place - k
        assert self.drive.law is not None
        of = self.drive.belt, self.drive.law, pulley.R
        weights = (
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        )
        ratio = sum(w * _laid_end(*of, k + j) for j, w in enumerate(weights, start=-1))
        return ratio * b**3


@functools.lru_cache(maxsize=256)
def _laid_end(belt: Belt, law: NormalLaw, R: float, node: int) -> float:
    """Return the length at an end of an arc over b³, at the force of a node [1/m²]."""
    P = math.exp(END_STEP * node)
    b, span = bending_length(belt.EI, P), 2.0 * SHORTEST_SPAN * bending_length(belt.EI, P)
    friction = FrictionSurface.constant(1.0)
    rod = FlowPulley(belt, law, friction.tables(), R, math.pi, span, P)
    string = StringLevel(Drive(belt, law, friction, (Pulley("", 0.0, 0.0, R),) * 2))
    stretch, radius = seat(P, 0.0, string.sections[0])
    of_string = (2.0 * span + math.pi * radius) / stretch
    tilts = (belt.EI / (2.0 * P * R)) ** 2 / (2.0 * span)
    own = rod.laid.stretch * rod.model.path.length
    return (0.5 * (own - of_string) + tilts) / b**3


def _distance(state: FlowState, P_in: float, P_out: float, v0: float) -> float:
    """Return how far a state is from forces and a flow."""
    steps = (state.T_in / P_in, state.T_out / P_out, state.v0 / v0)
    return sum(abs(math.log(step)) for step in steps)
