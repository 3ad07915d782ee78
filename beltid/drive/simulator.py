"""Solve operating points of a drive, with strings or with a rod on each pulley.

A rod bends, and its ribs seat over some length. Spans longer than six bending lengths decouple the
pulleys, so a drive is a chain of one-pulley maps coupled by span forces, flow and levers. The loop
of the string is solved with the difference of rod and string added to each pulley (D12): torque,
speed, stress-free length, and the part of the arc on which the belt can slide towards its exit.
Then the rods are solved with its forces, until these no longer change, usually twice.
"""

import math
from collections import deque
from contextlib import suppress
from dataclasses import replace
from functools import cache, cached_property
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import brentq

from beltid.arrays import Array
from beltid.drive.loop import Loop, LoopState, RestState, rest_state, solve_loop
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.results import DriveResult
from beltid.drive.string import Level, seat, sliding_arc
from beltid.errors import ConvergenceError, InputError
from beltid.laws.capstan import Spans
from beltid.rig.flow import FlowPulley, FlowState, flow
from beltid.rig.forces import friction
from beltid.rig.mesh import bending_length

Rods = tuple[FlowState | None, ...]
Method = Literal["string", "rod"]

SHORTEST_SPAN = 6.0  # in bending lengths: the bending at pulleys further apart does not interact
MOST_ROUNDS = 16
FORCE_TOLERANCE = 1e-4  # change of the span forces over the tension at rest when converged
SLIPPING = 0.02  # factor on it where a pulley slides as a whole: its speed depends on them more
REMEMBERED = 60  # states of a mesh from which a search may start
TENSION_STEP = 0.05  # of the logarithm of the tension within which tensions share a mesh
WITHOUT_RANGE = 0.05  # fastest sliding over belt speed, for friction without a speed range
SLIDING = 0.01  # over the belt's speed, where friction is looked up for what a bent belt holds
LEAST_END = 0.1  # share of a span force that acts along a bent belt on the pulley
SEATED = 4.0  # lengths of the elastic bed behind the first contact after which the ribs are seated
LIMIT_TOLERANCE = 2e-5  # relative, of a limit of a string
# shares of a limit at which its rods are solved; with whole pulleys sliding the first has none
BELOW = (0.97, 0.9)
LIMIT_STEP = 1.5  # ratio of two factors at which a limit is bracketed
SMALLEST_FACTOR, LARGEST_FACTOR = 2.0**-20, 2.0**20
MOST_RESERVE = 10.0


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


class Simulator:
    """Solve operating points of a drive; pulleys on the rigid back of the belt stay strings.

    An InputError says that rods have no contact law: a rigid pulley has no bed.
    """

    def __init__(self, drive: Drive, method: Method = "string") -> None:
        self.drive, self.method, self.strings = drive, method, Level.of(drive)
        if method == "rod":
            if drive.law is None:
                raise InputError(
                    "rod level: needs a contact law of the ribs; rigid pulleys have none"
                )
            self.law = drive.law
        self.fastest = float(drive.surface.validity["slip_speed_m_s"][1])
        self._rest: dict[str, RestState] = {}
        self._idle: dict[tuple[float, str], LoopState] = {}
        self._found: dict[int, deque[LoopState]] = {}
        self._known: dict[tuple[int, float, float], FlowPulley] = {}

    def solve(self, point: DrivePoint, near: DriveResult | None = None) -> DriveResult:
        """Find the steady state of a point, and of the drive that idles at its speed.

        At a negative speed of the driver the belt runs against the order of the pulleys. The search
        starts from a result at the same point of a similar drive ``near``. An InputError says that
        the belt cannot be laid on or tightened as stated, a ConvergenceError that none was found.
        """
        if point.omega < 0.0:
            return self.backwards._forwards(point.reversed(), near)
        return self._forwards(point, near)

    @cached_property
    def backwards(self) -> "Simulator":
        """Simulator of the belt that runs the other way."""
        return Simulator(self.drive.reversed(), self.method)

    def at_rest(self, point: DrivePoint) -> RestState:
        """Tighten the belt at rest as the point states it; rods add the lengths of their ends."""
        key, EI = str(point.T_0), self.drive.belt.EI  # nan is no key: it differs from itself
        if key not in self._rest:
            rest = rest_state(self.strings, point.T_0)
            for _ in range(2 if self.method == "rod" else 0):  # they hardly depend on the tension
                ends = np.array([self._end(i, rest) for i in range(len(self.drive.pulleys))])
                rest = rest_state(replace(self.strings, EI=EI, ends=ends), point.T_0)
            self._rest[key] = rest
        return self._rest[key]

    def _forwards(self, point: DrivePoint, near: DriveResult | None) -> DriveResult:
        """Solve a point with the belt running in the order of the pulleys."""
        solve = solve_loop if self.method == "string" else self._with_rods
        rest, key, unloaded = self.at_rest(point), (point.omega, str(point.T_0)), point.scaled(0.0)
        if key not in self._idle:
            self._idle[key] = solve(unloaded, rest, None if near is None else near.idle)
        idle = state = self._idle[key]
        if point != unloaded:
            state = solve(point, rest, None if near is None else near.state)
        return DriveResult(point, rest, state, idle)

    def _with_rods(self, point: DrivePoint, rest: RestState, near: LoopState | None) -> LoopState:
        """Find the steady state with rods, from that of a similar drive if it is known."""
        mesh, loop = round(math.log(rest.T_0) / TENSION_STEP), Loop(point, rest, None)
        found = self._found.setdefault(mesh, deque(maxlen=REMEMBERED))

        def distance(other: LoopState) -> float:
            """From where the search would start without a similar state, scaled."""
            return float(np.abs(loop.start(other) - loop.start(None)).max())

        like, state = min(found, key=distance, default=near), None
        if like is not None:
            rods = {key: getattr(like.level, key) for key in ("torque", "speed", "room", "length")}
            with suppress(ConvergenceError):
                state = solve_loop(point, replace(rest, level=replace(rest.level, **rods)), like)
            near = min(like, near or like, key=distance)
        if state is None or np.isnan(state.arcs.slip).any():
            state = solve_loop(point, rest)
        for _ in range(MOST_ROUNDS):
            if state.slack or np.isnan(state.arcs.slip).any():
                return state
            if state.v0 <= 0.0:  # the belt would have to slide faster than the driver turns
                slip = np.full(state.P.size, math.nan)
                return replace(state, arcs=state.arcs._replace(slip=slip))
            last, near = state, replace(state, rods=self._rods(state, rest, near))
            state = solve_loop(point, self._corrected(state, rest, near.rods), state)
            moved = float(np.abs(state.P - last.P).max()) / rest.T_0
            if moved <= FORCE_TOLERANCE * (SLIPPING if state.arcs.slip.any() else 1.0):
                found.append(self._told(state, near.rods))
                return found[-1]
        raise ConvergenceError(
            f"drive at {point.omega:g} rad/s: the forces of loop and rods did not converge in "
            f"{MOST_ROUNDS} rounds; they still change by {moved:.2g} of the tension at rest",
        )

    def _told(self, state: LoopState, rods: Rods) -> LoopState:
        """Return a state with what its rods say of the slip of whole pulleys."""
        slip = state.arcs.slip.copy()
        for i, rod in enumerate(rods):
            if rod is not None and not math.isnan(slip[i]):
                whole = self._whole_slip(i, rod)
                slip[i] = whole if whole <= self.fastest and rod.W > 0.0 else math.nan
        R = np.array([pulley.R for pulley in self.drive.pulleys])
        ahead = np.copysign(slip, state.P_in - state.P) / (R * state.v0)
        rate = np.where(np.isnan(slip), state.arcs.rate, state.arcs.W - ahead)
        return replace(state, arcs=state.arcs._replace(slip=slip, rate=rate), rods=rods)

    def _corrected(self, state: LoopState, rest: RestState, rods: Rods) -> RestState:
        """Return the level with the differences of the rods to the strings on the arcs at rest."""
        wraps, v0, P_in, P_out = rest.laid.wraps, state.v0, state.P_in, state.P.copy()
        room, torque, speed = np.zeros(len(rods)), np.zeros(len(rods)), np.ones(len(rods))
        length = 0.0
        there = [(i, rod) for i, rod in enumerate(rods) if rod is not None]
        for i, rod in there:
            P_in[i], P_out[i] = rod.s.T_A, rod.s.T_B
            x = min(self._whole_slip(i, rod), self.fastest) * math.isfinite(self.fastest)
            held, _ = sliding_arc(rod.s.T_A, rod.s.T_B, v0, x, self.strings.sections[i])
            room[i] = max(held + rod.adhesion_arc, self._bent_arc(i, rest, rod)) - wraps[i]
        strings = replace(self.strings, room=room).arcs(P_in, P_out, v0, wraps)
        for i, rod in there:
            torque[i] = rod.torque - strings.torque[i]
            speed[i] = rod.W / strings.W[i]
            span, P = self._pulley(i, rest).span, np.array([rod.s.T_A, rod.s.T_B])
            # the far end of the computed span stays on the tangent of the circle
            of_string = span / self.drive.stretch(P, v0) + self._bent(i, rest.level, P, span)
            length += rod.length - float(strings.length[i] + of_string.sum())
        level = replace(rest.level, torque=torque, speed=speed, room=room, length=length)
        return replace(rest, level=level)

    def _bent(self, i: int, level: Level, P: Array, span: float) -> Array:
        """Return the lengths of a rod with spans of that length beyond those of a string, (D15)."""
        ends = np.broadcast_to(level.ends, len(self.drive.pulleys))
        tilt = self.drive.belt.EI / (2.0 * P * self.drive.pulleys[i].R)
        return ends[i] * (self.drive.belt.EI / P) ** 1.5 - tilt**2 / (2.0 * span)

    def _end(self, i: int, rest: RestState) -> float:
        """Return the length at an end of an arc over (EI/P)^1.5, that of a rod laid on [1/m²]."""
        if not self.drive.pulleys[i].ribs:
            return 1.0 / (12.0 * self.drive.pulleys[i].R ** 2)  # of a rigid pulley
        rod, s = self._pulley(i, rest), self.strings.sections[i]
        stretch, radius = seat(rod.tension, 0.0, s)
        own = 0.5 * float(rod.laid.u[0]) * rod.model.path.length
        own -= (rod.span + 0.5 * rod.wrap * radius) / stretch
        own -= self._bent(i, self.strings, np.array([rod.tension]), rod.span)[0]
        return float(own / (self.drive.belt.EI / rod.tension) ** 1.5)

    def _bent_arc(self, i: int, rest: RestState, rod: FlowState) -> float:
        """Return the arc of a string that holds what a bent belt does, (T15) [rad]."""
        pulley, EI = self._pulley(i, rest), self.drive.belt.EI
        mu = friction(pulley.surface, rod.s.T_A / pulley.R, SLIDING * rod.v0)[0]
        P = np.sort([rod.s.T_A, rod.s.T_B])[::-1]
        psi = np.arccos(np.maximum(1.0 - EI / (2.0 * P * pulley.R**2), 0.0))
        ends = np.cos(psi) + mu * np.sin(psi) * (-1.0, 1.0)
        turns = Spans(EI, pulley.span).turn(P, pulley.R)
        gain = math.log(ends[1] / max(ends[0], LEAST_END)) / mu
        return float(pulley.wrap + np.sum(turns - psi) + gain)

    def _rods(self, state: LoopState, rest: RestState, near: LoopState | None) -> Rods:
        """Solve the rods with the forces of a loop; one that cannot hold them slides at most."""
        rods: list[FlowState | None] = []
        for i, pulley in enumerate(self.drive.pulleys):
            if not pulley.ribs:
                rods.append(None)
                continue
            rod, v0 = self._pulley(i, rest), state.v0
            P_in, P_out = float(state.P_in[i]), float(state.P[i])
            start = near.rods[i] if near is not None and near.rods else None
            try:
                found = flow(rod, v0, P_in, P_out, start=start)
            except ConvergenceError:
                fastest = self.fastest if math.isfinite(self.fastest) else WITHOUT_RANGE * v0
                ahead = math.copysign(fastest, P_in - P_out) / rod.R
                found = flow(rod, v0, P_in, omega=float(state.arcs.rate[i]) * v0 + ahead)
                if abs(math.log(P_out / P_in)) < abs(math.log(found.s.T_B / P_in)):
                    raise  # friction could hold the forces
            rods.append(found)
        return tuple(rods)

    def _pulley(self, i: int, rest: RestState) -> FlowPulley:
        """Return the rod of a pulley."""
        drive, spans, wrap = self.drive, rest.laid.spans, float(rest.laid.wraps[i])
        tension = math.exp(round(math.log(rest.T_0) / TENSION_STEP) * TENSION_STEP)
        if (i, wrap, tension) not in self._known:
            shortest = SHORTEST_SPAN * bending_length(drive.belt.EI, tension)
            span = max(0.5 * float(min(spans[i], spans[i - 1])), shortest)
            laws, R = (drive.belt, self.law, drive.friction), drive.pulleys[i].R
            self._known[i, wrap, tension] = FlowPulley(*laws, R, wrap, span, tension)
        return self._known[i, wrap, tension]

    def _whole_slip(self, i: int, rod: FlowState) -> float:
        """Return the sliding speed where the ribs are seated if nothing sticks [m/s], else 0."""
        if rod.adhesion_arc > 0.0:
            return 0.0
        points = rod.touching
        stiffness = float(self.law.stiffness(self.law.penetration(np.median(points["f_N"]))))
        behind = (points["theta"] - points["theta"][0]) * self.drive.pulleys[i].R
        seated = behind >= SEATED * (self.drive.belt.EI / stiffness) ** 0.25
        return abs(float(points["slip"][np.argmax(seated) if seated.any() else -1]))


class SlipLimit(NamedTuple):
    """Torque limits of an operating point, as factors on all of its torques and powers [-]."""

    adhesion: float  # at which the first pulley loses its adhesion arc
    slip: float  # beyond which no steady sliding within the measured speeds transmits them


def slip_limit(simulator: Simulator, point: DrivePoint) -> SlipLimit:
    """Find the largest factors on the torques of a point, which must not all be zero.

    Torques without a steady state count as not transmitted. With rods the limit is that of the
    string with the differences of rods and string of a state just below it.
    """
    if point.omega < 0.0:
        return slip_limit(simulator.backwards, replace(point.reversed(), omega=-point.omega))
    state, limits = simulator.solve(point.scaled(0.0)).state, [1.0]
    for with_slip in (False, True):
        factor = _of_level(simulator, point, with_slip, state, limits[-1])
        is_found = 0.0 < factor < math.inf
        for share in BELOW[with_slip:] if is_found and simulator.method == "rod" else ():
            with suppress(ConvergenceError):
                below = simulator.solve(point.scaled(share * factor)).state
                if below.rods:
                    state, factor = below, _of_level(simulator, point, with_slip, below, factor)
                    break
        limits.append(factor)
        if not is_found:
            break
    return SlipLimit(limits[1], limits[-1])


def _of_level(
    simulator: Simulator, point: DrivePoint, with_slip: bool, near: LoopState, guess: float
) -> float:
    """Find the factor with the belt on its pulleys as in a state, bracketed about a guess."""
    level = near.level
    rest = replace(simulator.at_rest(point), level=level)

    @cache
    def margin(factor: float) -> float:
        """Room over the arc that is needed, less 1, of the pulley with the least."""
        nonlocal near
        found = None
        with suppress(ConvergenceError):
            found = solve_loop(point.scaled(factor), rest, near)
        if found is None or found.slack or found.v0 <= 0.0:
            return -1.0
        needed = found.arcs.needed
        if with_slip:
            forces = zip(found.P_in.tolist(), found.P.tolist(), strict=True)
            arcs = [level.arcs_by_speed(i, *P, found.v0) for i, P in enumerate(forces)]
            needed = np.array([of_pulley.min() for of_pulley in arcs])
        # bounded: the infinite reserve of an idling pulley could not be interpolated
        most = found.arcs.room / np.maximum(needed, found.arcs.room / MOST_RESERVE)
        if most.min() > 1.0:
            near = found
        return float(most.min()) - 1.0

    low = high = guess
    while margin(high) > 0.0:
        low, high = high, LIMIT_STEP * high
        if high > LARGEST_FACTOR:
            return math.inf
    while low == high or margin(low) <= 0.0:
        low, high = low / LIMIT_STEP, low
        if low < SMALLEST_FACTOR:
            return 0.0
    return float(brentq(margin, low, high, xtol=LIMIT_TOLERANCE * high, rtol=LIMIT_TOLERANCE))


def installed_belts(
    drive: Drive, method: Method, point: DrivePoint, tolerance: float
) -> dict[str, DriveResult]:
    """Solve a point with the shortest, the mean and the longest belt, by a tolerance both ways [m].

    An InputError says that a belt does not fit the pulleys, or that any does.
    """
    if drive.installation == "slack_force":
        raise InputError(
            "drive.belt_length_tolerance_m: must be left out with installation: slack_force"
        )
    mean = Simulator(drive, method).solve(point).rest.belt_length
    lengths = {"min": mean - tolerance, "mean": mean, "max": mean + tolerance}
    return {
        name: Simulator(replace(drive, belt_length=length), method).solve(
            replace(point, T_0=np.nan)
        )
        for name, length in lengths.items()
    }
