"""Model the belt on its pulleys as an extensible string on an elastic bed: one quadrature an arc.

Strain, penetration, angular rate and line force follow from the effective span force
P = N - m v0^2 (1 + eps) (D1). Where the belt slides, P itself is the coordinate along the arc (D4),
so an arc is an integral over ln P. On the adhesion arc the belt keeps its angular rate at the
entry; a pulley that slides as a whole differs from it by the sliding speed x at its entry (D5).
What rods differ by from strings is added here (D12), (D15).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.optimize import brentq

from beltid.arrays import Array
from beltid.drive.model import Drive, Layout, Pulley, following
from beltid.laws import penalty
from beltid.laws.bicubic import SurfaceTables
from beltid.laws.friction_surface import FrictionSurface
from beltid.rig.banded import kernel
from beltid.rig.forces import elastic_force, elastic_stiffness, friction

_x, _w = np.polynomial.legendre.leggauss(8)
GAUSS_NODES, GAUSS_WEIGHTS = 0.5 * (1.0 + _x), 0.5 * _w  # on (0, 1)
FEWEST_PANELS, MOST_PANELS, PANEL = 2, 32, 0.25  # number, and width in ln P
RIGID = 1e30  # stiffness of a bed that gives way by less than rounding [N/m²]
SLIP_GRID = 24  # number of sliding speeds of the search for full slip, if mu falls with the speed
SLOWEST_SLIP = 0.02  # first speed of the grid, over the lowest measured speed

elastic_energy = kernel(penalty.elastic_energy)


class Section(NamedTuple):
    """Belt and bed on one pulley, and the friction there, for compiled code.

    ``EA`` [N], ``m`` [kg/m]; ``k_linear`` [N/m²], ``k_quadratic`` [N/m³]; ``R`` [m]; ``surface``;
    ``speeds`` (n,), sliding speeds of the search for full slip up to the fastest measured one
    [m/s], none if mu does not depend on the speed.
    """

    EA: float
    m: float
    k_linear: float
    k_quadratic: float
    R: float
    surface: SurfaceTables
    speeds: Array


class Arcs(NamedTuple):
    """State of the belt on every pulley, all arrays (n,)."""

    torque: Array  # of the shaft on the belt [N m]: > 0 on a driver, < 0 where power is taken off
    W: Array  # omega/v0 [1/m]; in gross slip, its value at the fastest measured sliding
    rate: Array  # theta'/v0 of the belt at the entry [1/m]
    length: Array  # stress-free length of belt on the arc [m]
    needed: Array  # arc that the change of force needs if the entry sticks [rad], (D4)
    slip: Array  # sliding speed at the entry [m/s]: 0 with an adhesion arc, nan in gross slip
    room: Array  # part of the arc on which the belt can slide towards its exit [rad]


@kernel
def seat(P: float, v0: float, s: Section) -> tuple[float, float]:
    """Return stretch 1 + eps, (D1), and radius R - delta with f (R - delta) = P (1 + eps), (D2)."""
    stretch = (s.EA + P) / (s.EA - s.m * v0 * v0)
    delta = 2.0 * P * stretch / s.R
    delta /= s.k_linear + math.sqrt(s.k_linear * s.k_linear + 2.0 * s.k_quadratic * delta)
    for _ in range(20):
        f = elastic_force(delta, s.k_linear, s.k_quadratic)
        slope = elastic_stiffness(delta, s.k_linear, s.k_quadratic) * (s.R - delta) - f
        step = (f * (s.R - delta) - P * stretch) / slope
        delta -= step
        if abs(step) <= 1e-9 * s.R:  # the next one would be its square
            break
    return stretch, s.R - delta


@kernel
def contact(P: float, entry: float, v0: float, x: float, s: Section) -> tuple[float, float, float]:
    """Return line force, sliding speed (D3) and length per angle at P; ``entry``: rate/v0 there."""
    stretch, radius = seat(P, v0, s)
    f, v = P * stretch / radius, x + s.R * v0 * abs(entry - stretch / radius)
    return f, v, radius / stretch


@kernel
def sliding_arc(P_in: float, P_out: float, v0: float, x: float, s: Section) -> tuple[float, float]:
    """Integrate angle (D4) and stress-free length of an arc that slides with x at the entry."""
    fall = math.log(P_out / P_in)
    angle, length = 0.0, 0.0
    if fall == 0.0:
        return angle, length
    stretch, radius = seat(P_in, v0, s)
    entry = stretch / radius
    panels = min(FEWEST_PANELS + int(abs(fall) / PANEL), MOST_PANELS)
    for panel in range(panels):
        for q in range(GAUSS_NODES.size):
            P = P_in * math.exp(fall * (panel + GAUSS_NODES[q]) / panels)
            f, v, per_angle = contact(P, entry, v0, x, s)
            turn = GAUSS_WEIGHTS[q] * abs(fall) / (panels * friction(s.surface, f, v)[0])
            angle += turn
            length += turn * per_angle
    return angle, length


@kernel
def full_slip(P_in: float, P_out: float, v0: float, room: float, s: Section) -> float:
    """Find the smallest sliding speed at the entry with an arc as long as the room (D5), or nan."""
    low, high, at_low = 0.0, 0.0, sliding_arc(P_in, P_out, v0, 0.0, s)[0] - room
    at_high = at_low
    for k in range(s.speeds.size):
        high = s.speeds[k]
        at_high = sliding_arc(P_in, P_out, v0, high, s)[0] - room
        if at_high <= 0.0:
            break
        low, at_low = high, at_high
    if at_high > 0.0:
        return math.nan
    # the Illinois rule, in a coordinate over which friction laws are nearly straight
    v = s.surface.v_ref
    low, high = math.log1p(low / v), math.log1p(high / v)
    for _ in range(60):
        y = (low * at_high - high * at_low) / (at_high - at_low)
        at_y = sliding_arc(P_in, P_out, v0, v * math.expm1(y), s)[0] - room
        if at_y * at_high <= 0.0:
            low, at_low = high, at_high
        else:
            at_low *= 0.5
        high, at_high = y, at_y
        if abs(at_high) < 1e-12 * room or abs(high - low) < 1e-13 * high:
            break
    return v * math.expm1(high)


@kernel
def arc(
    P_in: float, P_out: float, v0: float, wrap: float, room: float, s: Section
) -> tuple[float, float, float, float, float, float]:
    """Return the values of :class:`Arcs`, but the room, for one pulley with a ``wrap`` [rad]."""
    (stretch, radius), radius_out = seat(P_in, v0, s), seat(P_out, v0, s)[1]
    # levers of the span forces about the axis, (D6)
    lever = radius * (1.0 + elastic_energy(s.R - radius, s.k_linear, s.k_quadratic) / P_in)
    energy = elastic_energy(s.R - radius_out, s.k_linear, s.k_quadratic)
    torque = P_in * lever - P_out * (radius_out * (1.0 + energy / P_out))
    rate = stretch / radius
    needed, length = sliding_arc(P_in, P_out, v0, 0.0, s)
    x = slip = 0.0
    if needed <= room:
        length += (wrap - needed) * radius / stretch
    else:
        slip = full_slip(P_in, P_out, v0, room, s)
        # in gross slip the torque sets the forces, with mu at the fastest measured speed
        x = slip
        if math.isnan(slip):
            x = s.speeds[-1] if s.speeds.size else 0.0
        angle, length = sliding_arc(P_in, P_out, v0, x, s)
        length *= wrap / angle
    W = rate + math.copysign(x, P_in - P_out) / (s.R * v0)
    return torque, W, rate, length, needed, slip


@dataclass(frozen=True, slots=True)
class Level:
    """The pulleys of a drive with the belt on them: strings, and what rods differ by from them."""

    drive: Drive
    sections: tuple[Section, ...]  # belt, bed and friction on every pulley
    # differences of the rods, (D12): of the torques (n,) [N m], factors on the speeds (n,), of the
    # arcs on which the belt can slide (n,) [rad], of the length of the loop [m]
    torque: Array | float = 0.0
    speed: Array | float = 1.0
    room: Array | float = 0.0
    length: float = 0.0
    EI: float = 0.0  # bending stiffness of the spans [N m²]; that of a string is 0
    # length at one end of an arc beyond that of a string, over (EI/P)**1.5, (n,), (D15) [1/m²]
    ends: Array | float = 0.0

    @classmethod
    def of(cls, drive: Drive) -> Self:
        """Return a drive of strings."""
        back = FrictionSurface.constant(drive.back_friction)

        def section(pulley: Pulley) -> Section:
            bed = (RIGID, 0.0)
            if pulley.ribs and drive.law is not None:
                bed = (float(drive.law.k_linear_N_m2), float(drive.law.k_quadratic_N_m3))
            surface = drive.surface if pulley.ribs else back
            tables = drive.friction if pulley.ribs else back.tables()
            belt, R = drive.belt, float(pulley.R)
            return Section(belt.EA, belt.rhoA, *bed, R, tables, _slip_speeds(surface))

        return cls(drive, tuple(section(pulley) for pulley in drive.pulleys))

    def arcs(self, P_in: Array, P_out: Array, v0: float, wraps: Array) -> Arcs:
        """Compute the state of the belt on every pulley with its wrap, arrays (n,) [N], [rad]."""
        room = wraps + self.room
        given = zip(P_in.tolist(), P_out.tolist(), wraps.tolist(), room.tolist(), strict=True)
        rows = [
            arc(P, Q, v0, wrap, most, s)
            for (P, Q, wrap, most), s in zip(given, self.sections, strict=True)
        ]
        torque, W, rate, length, needed, slip = np.array(rows).T
        torque, W, rate = torque + self.torque, W * self.speed, rate * self.speed
        return Arcs(torque, W, rate, length, needed, slip, room)

    def extra_length(self, laid: Layout, P: Array) -> float:
        """Return the stress-free length of the loop beyond that of spans and arcs [m], (D15)."""
        if self.EI == 0.0:
            return self.length
        ends = np.broadcast_to(self.ends, P.shape)
        at_ends = (ends + following(ends)) * (self.EI / P) ** 1.5
        # both ends of the span move outwards, each to its side; the span tilts by the sum
        outwards = laid.senses / np.array([pulley.R for pulley in self.drive.pulleys])
        tilts = (self.EI / (2.0 * P) * (outwards - following(outwards))) ** 2 / (2.0 * laid.spans)
        return self.length + float(np.sum(at_ends - tilts))

    def along_arc(self, i: int, P: Array, v0: float, x: float) -> tuple[Array, Array, Array]:
        """Return line force, sliding speed and mu on pulley i at forces P (n,) from the entry."""
        s = self.sections[i]
        stretch, radius = seat(float(P[0]), v0, s)
        rows = [contact(force, stretch / radius, v0, x, s)[:2] for force in P.tolist()]
        mu = [friction(s.surface, f, v)[0] for f, v in rows]
        return *np.array(rows).T, np.array(mu)

    def arcs_by_speed(self, i: int, P_in: float, P_out: float, v0: float) -> Array:
        """Return the arcs (D4) of pulley i without slip at the entry and at measured speeds."""
        s = self.sections[i]
        return np.array([sliding_arc(P_in, P_out, v0, x, s)[0] for x in (0.0, *s.speeds.tolist())])

    def outside(
        self, i: int, P_in: float, P_out: float, v0: float, x: float
    ) -> tuple[float, float]:
        """Return the shares of friction below the measured speeds, outside the measured forces."""
        if P_in == P_out or not self.drive.pulleys[i].ribs:
            return 0.0, 0.0
        validity = self.drive.surface.validity

        def share_below(limit: float, of_speed: int) -> float:
            """Share of the change of force on the part of the arc below a limit."""

            def over(P: float) -> float:
                return float(self.along_arc(i, np.array([P_in, P]), v0, x)[of_speed][1]) - limit

            if over(P_in) * over(P_out) >= 0.0:
                return 1.0 if over(P_in) + over(P_out) < 0.0 else 0.0
            at = brentq(over, P_in, P_out, xtol=1e-13 * P_in)
            before = (P_in - at) / (P_in - P_out)
            return before if over(P_in) < 0.0 else 1.0 - before

        low, high = validity["normal_force_N_m"]
        # in gross slip the sliding speed is not known
        below_speed = 0.0 if math.isnan(x) else share_below(validity["slip_speed_m_s"][0], 1)
        return below_speed, share_below(low, 0) + 1.0 - share_below(high, 0)


def _slip_speeds(surface: FrictionSurface) -> Array:
    """Return the speeds of the search for full slip: one if no friction falls with the speed."""
    fastest = surface.validity["slip_speed_m_s"][1]
    if surface.slip_speed_m_s.size == 1:
        return np.zeros(0)
    if not surface.falls_with_speed:
        return np.array([fastest])
    return np.geomspace(SLOWEST_SLIP * surface.tables().v_ref, fastest, SLIP_GRID)
