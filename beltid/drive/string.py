"""Model the belt on its pulleys as an extensible string on an elastic bed: one quadrature an arc.

Strain, penetration, angular rate and line force follow from the effective span force
P = N - m v0^2 (1 + eps) (D1). Where the belt slides, P itself is the coordinate along the arc (D4),
so an arc is an integral over ln P. On the adhesion arc the belt keeps its angular rate at the
entry; a pulley that slides as a whole runs ahead of the belt, or behind it, by the sliding speed x
at its entry (D5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from beltid.drive.geometry import Layout
from beltid.drive.model import Drive
from beltid.laws import penalty
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.surface_tables import SurfaceTables
from beltid.rig.compiler import kernel
from beltid.rig.contact import elastic_force, elastic_stiffness, friction

Array = NDArray[np.float64]

_x, _w = np.polynomial.legendre.leggauss(8)
GAUSS_NODES, GAUSS_WEIGHTS = 0.5 * (1.0 + _x), 0.5 * _w  # on (0, 1)
FEWEST_PANELS, MOST_PANELS, PANEL = 4, 32, 0.15  # number, and width in ln P
SLIP_GRID = 24  # number of sliding speeds of the search for full slip
SLOWEST_SLIP = 0.02  # first speed of the grid, over the lowest measured speed

elastic_energy = kernel(penalty.elastic_energy)


class Section(NamedTuple):
    """Belt and bed on one pulley, and the friction there, for compiled code.

    ``EA`` [N], ``m`` [kg/m]; ``k_linear`` [N/m²] (infinite on a rigid pulley), ``k_quadratic``
    [N/m³]; ``R`` [m]; ``surface``; ``speeds`` (n,), sliding speeds of the search for full slip up
    to the fastest measured one [m/s], none if mu does not depend on the speed.
    """

    EA: float
    m: float
    k_linear: float
    k_quadratic: float
    R: float
    surface: SurfaceTables
    speeds: Array


class Arcs(NamedTuple):
    """State of the belt on every pulley, all arrays (n,).

    Attributes
    ----------
    torque : ndarray
        Torque of the shaft on the belt [N m]: > 0 on a driver, < 0 where power is taken off.
    W : ndarray
        omega / v0 of the pulley [1/m]; in gross slip, its value at the fastest measured sliding.
    rate : ndarray
        theta' / v0 of the belt at the entry [1/m].
    length : ndarray
        Stress-free length of belt on the arc [m].
    needed : ndarray
        Arc that the change of force needs if the entry sticks [rad], (D4).
    slip : ndarray
        Sliding speed at the entry [m/s]: 0 with an adhesion arc, nan in gross slip.
    room : ndarray
        Part of the arc on which the belt can slide towards its exit [rad].
    """

    torque: Array
    W: Array
    rate: Array
    length: Array
    needed: Array
    slip: Array
    room: Array


@kernel
def seat(P: float, v0: float, s: Section) -> tuple[float, float]:
    """Return stretch 1 + eps [-], (D1), and radius R - delta [m], (D2), under an effective force.

    The penetration solves f(delta) (R - delta) = P (1 + eps).
    """
    stretch = (s.EA + P) / (s.EA - s.m * v0 * v0)
    if math.isinf(s.k_linear):
        return stretch, s.R
    delta = 2.0 * P * stretch / s.R
    delta /= s.k_linear + math.sqrt(s.k_linear * s.k_linear + 2.0 * s.k_quadratic * delta)
    for _ in range(20):
        f = elastic_force(delta, s.k_linear, s.k_quadratic)
        slope = elastic_stiffness(delta, s.k_linear, s.k_quadratic) * (s.R - delta) - f
        step = (f * (s.R - delta) - P * stretch) / slope
        delta -= step
        if abs(step) <= 1e-15 * s.R:
            break
    return stretch, s.R - delta


@kernel
def lever(P: float, radius: float, s: Section) -> float:
    """Return the lever of a span force about the axis, (D6) [m]."""
    if math.isinf(s.k_linear):
        return radius
    return radius * (1.0 + elastic_energy(s.R - radius, s.k_linear, s.k_quadratic) / P)


@kernel
def contact(P: float, entry: float, v0: float, x: float, s: Section) -> tuple[float, float, float]:
    """Return line force [N/m] and sliding speed [m/s], (D3), and length per angle [m] at P.

    The belt's angular rate at the entry is ``entry`` times v0 [1/m]; there it slides with x.
    """
    stretch, radius = seat(P, v0, s)
    f, v = P * stretch / radius, x + s.R * v0 * abs(entry - stretch / radius)
    return f, v, radius / stretch


@kernel
def sliding_arc(P_in: float, P_out: float, v0: float, x: float, s: Section) -> tuple[float, float]:
    """Integrate angle [rad], (D4), and stress-free length [m] of an arc from P_in to P_out.

    The effective forces are > 0 [N]; the belt slides with x at the entry [m/s].
    """
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
def full_slip(P_in: float, P_out: float, v0: float, wrap: float, falls: bool, s: Section) -> float:
    """Find the sliding speed at the entry at which the arc (D4) equals the whole wrap, (D5).

    Returns
    -------
    float
        The smallest such speed [m/s]; nan if there is none within the measured speeds.
    """
    low, at_low = 0.0, sliding_arc(P_in, P_out, v0, 0.0, s)[0] - wrap
    high, at_high = low, at_low
    # without friction that falls with the speed there is one such speed at most
    for k in range(0 if falls else max(s.speeds.size - 1, 0), s.speeds.size):
        high = s.speeds[k]
        at_high = sliding_arc(P_in, P_out, v0, high, s)[0] - wrap
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
        at_y = sliding_arc(P_in, P_out, v0, v * math.expm1(y), s)[0] - wrap
        if at_y * at_high <= 0.0:
            low, at_low = high, at_high
        else:
            at_low *= 0.5
        high, at_high = y, at_y
        if abs(at_high) < 1e-12 * wrap or abs(high - low) < 1e-13 * high:
            break
    return v * math.expm1(high)


@kernel
def arc(
    P_in: float, P_out: float, v0: float, wrap: float, room: float, falls: bool, s: Section
) -> tuple[float, float, float, float, float, float, float]:
    """Return the values of :class:`Arcs` for one pulley with a ``wrap`` [rad]."""
    stretch, radius = seat(P_in, v0, s)
    torque = P_in * lever(P_in, radius, s) - P_out * lever(P_out, seat(P_out, v0, s)[1], s)
    rate = stretch / radius
    needed, length = sliding_arc(P_in, P_out, v0, 0.0, s)
    x = slip = 0.0
    if needed <= room:
        length += (wrap - needed) * radius / stretch
    else:
        slip = full_slip(P_in, P_out, v0, room, falls, s)
        # in gross slip the torque sets the forces, with mu at the fastest measured speed
        x = slip
        if math.isnan(slip):
            x = s.speeds[-1] if s.speeds.size else 0.0
        angle, length = sliding_arc(P_in, P_out, v0, x, s)
        length *= wrap / angle
    W = rate + math.copysign(x, P_in - P_out) / (s.R * v0)
    return torque, W, rate, length, needed, slip, room


class StringLevel:
    """The pulleys of a drive at string level.

    Parameters
    ----------
    drive : Drive
        Belt, laws and pulleys.
    """

    def __init__(self, drive: Drive) -> None:
        law, belt = drive.law, drive.belt
        rigid = (math.inf, 0.0)
        soft = rigid if law is None else (law.k_linear_N_m2, law.k_quadratic_N_m3)
        back = FrictionSurface.constant(drive.back_friction)
        self.measured = [drive.surface if p.ribs else back for p in drive.pulleys]
        self.falls = [surface.falls_with_speed for surface in self.measured]
        self.sections = []
        for pulley, surface in zip(drive.pulleys, self.measured, strict=True):
            k_linear, k_quadratic = map(float, soft if pulley.ribs else rigid)
            tables = drive.friction if pulley.ribs else back.tables()
            R, speeds = float(pulley.R), _slip_speeds(surface)
            section = Section(belt.EA, belt.rhoA, k_linear, k_quadratic, R, tables, speeds)
            self.sections.append(section)

    def arcs(
        self, P_in: Array, P_out: Array, v0: float, wraps: Array, room: Array | None = None
    ) -> Arcs:
        """Compute the state of the belt on every pulley.

        Parameters
        ----------
        P_in, P_out : ndarray (n,)
            Effective span forces before and after each pulley [N], > 0.
        v0 : float
            Stress-free length of belt per second [m/s], > 0.
        wraps : ndarray (n,)
            Arcs between tangent points [rad].
        room : ndarray (n,), optional
            Part of them on which the belt can slide [rad]; by default the whole arc.
        """
        most = wraps if room is None else room
        given = P_in.tolist(), P_out.tolist(), wraps.tolist(), most.tolist()
        rows = [
            arc(P, Q, v0, wrap, most, falls, s)
            for P, Q, wrap, most, falls, s in zip(*given, self.falls, self.sections, strict=True)
        ]
        return Arcs(*np.array(rows).T)

    def extra_length(self, laid: Layout, P: Array) -> float:
        """Return zero: a string has no length beyond that of spans and arcs."""
        return 0.0

    def along_arc(self, i: int, P: Array, v0: float, x: float) -> tuple[Array, Array, Array]:
        """Return line force [N/m], sliding speed [m/s] and mu on pulley i at forces P (n,) [N].

        ``P[0]`` is the force at the entry, where the belt slides with x [m/s].
        """
        s = self.sections[i]
        stretch, radius = seat(float(P[0]), v0, s)
        rows = [contact(force, stretch / radius, v0, x, s)[:2] for force in P.tolist()]
        mu = [friction(s.surface, f, v)[0] for f, v in rows]
        return *np.array(rows).T, np.array(mu)

    def arcs_by_speed(self, i: int, P_in: float, P_out: float, v0: float) -> Array:
        """Return the arcs (D4) of pulley i without slip at the entry and at measured speeds."""
        s = self.sections[i]
        # friction that does not fall with the speed needs the least arc at the fastest one
        speeds = (0.0, *s.speeds.tolist()[0 if self.falls[i] else -1 :])
        return np.array([sliding_arc(P_in, P_out, v0, x, s)[0] for x in speeds])

    def outside(
        self, i: int, P_in: float, P_out: float, v0: float, x: float
    ) -> tuple[float, float]:
        """Return shares of the friction of pulley i below the measured speeds, outside the forces.

        Both change monotonically along the arc.
        """
        if P_in == P_out:
            return 0.0, 0.0
        s, validity = self.sections[i], self.measured[i].validity
        stretch, radius = seat(P_in, v0, s)

        def share_below(limit: float, of_speed: int) -> float:
            """Share of the change of force on the part of the arc below a limit."""

            def over(P: float) -> float:
                return contact(P, stretch / radius, v0, x, s)[of_speed] - limit

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
    """Return the sliding speeds of the search for full slip [m/s], none without a dependence."""
    fastest = surface.validity["slip_speed_m_s"][1]
    if surface.slip_speed_m_s.size == 1:
        return np.zeros(0)
    return np.geomspace(SLOWEST_SLIP * surface.tables().v_ref, fastest, SLIP_GRID)
