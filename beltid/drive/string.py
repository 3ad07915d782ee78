"""Model the belt on its pulleys as an extensible string on an elastic bed: one quadrature each.

Strain, penetration, angular rate and line force follow from the effective span force
P = N - m v0^2 (1 + eps) (D1). Where the belt slides, P itself is the coordinate along the arc (D4),
so an arc is an integral over ln P. On the adhesion arc the belt keeps its angular rate at the
entry; a pulley that slides as a whole runs ahead of the belt, or behind it, by the sliding speed x
at its entry (D5).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.drive.geometry import Layout
from beltid.drive.model import Drive
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.surface_tables import SurfaceTables
from beltid.rigsim.compiled import kernel, leaf, shared_leaf
from beltid.rigsim.compiled_laws import (
    elastic_energy,
    elastic_force,
    elastic_stiffness,
    evaluate_cell,
    locate,
)

Array = NDArray[np.float64]

_x, _w = np.polynomial.legendre.leggauss(8)
GAUSS_NODES, GAUSS_WEIGHTS = 0.5 * (1.0 + _x), 0.5 * _w  # on (0, 1)
WIDEST_PANEL = 0.4  # of ln P
SLIP_GRID = 24  # number of sliding speeds of the search for full slip
SLOWEST_SLIP = 0.02  # first speed of the grid, over the lowest measured speed


class Section(NamedTuple):
    """Parameters of belt and bed on one pulley, for compiled code.

    ``EA`` [N], ``m`` [kg/m]; ``k_linear`` [N/m²] (infinite on a rigid pulley), ``k_quadratic``
    [N/m³]; ``R`` [m].
    """

    EA: float
    m: float
    k_linear: float
    k_quadratic: float
    R: float


class Pulleys(NamedTuple):
    """The belt on every pulley, as arrays for compiled code; see :class:`Section`.

    Attributes
    ----------
    EA, m : float
        Axial stiffness [N] and mass per length [kg/m] of the belt.
    beds : ndarray (n, 2)
        k1 and k2 of each contact.
    R : ndarray (n,)
        Radius of the centreline without load [m].
    ribs : ndarray (n,) of bool
        Whether the ribs touch the pulley, rather than the back.
    """

    EA: float
    m: float
    beds: Array
    R: Array
    ribs: NDArray[np.bool_]


@leaf
def _section(pulleys: Pulleys, i: int) -> Section:
    """Return the parameters of pulley i."""
    return Section(pulleys.EA, pulleys.m, pulleys.beds[i, 0], pulleys.beds[i, 1], pulleys.R[i])


class Friction(NamedTuple):
    """Friction law for compiled code: tables, measured limits, and whether mu falls with speed.

    Unless mu ``falls`` with the speed somewhere, an arc has at most one steady state.
    """

    tables: SurfaceTables
    f_low: float
    f_high: float
    v_low: float
    v_high: float
    falls: bool


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
    """

    torque: Array
    W: Array
    rate: Array
    length: Array
    needed: Array
    slip: Array


class SlidingShares(NamedTuple):
    """Where the friction of the pulleys acts, all arrays (n,).

    Attributes
    ----------
    slip_speed_max : ndarray
        Largest sliding speed, at the exit [m/s].
    normal_force_min, normal_force_max : ndarray
        Line force at the two ends of the arc [N/m], sorted.
    below_speed_range : ndarray
        Share of the sliding friction below the lowest measured sliding speed [-].
    outside_force_range : ndarray
        Share of the sliding friction outside the measured line forces [-].
    steady_states : ndarray of int
        Number of states in which the arc carries its forces; more than one only if mu falls with
        speed.
    """

    slip_speed_max: Array
    normal_force_min: Array
    normal_force_max: Array
    below_speed_range: Array
    outside_force_range: Array
    steady_states: NDArray[np.int64]


class Bracket(NamedTuple):
    """Two points between which a function changes sign, the newer one ``high``, and its values.

    The Illinois rule: a secant, with the value halved at an end that does not move.
    """

    low: float
    at_low: float
    high: float
    at_high: float


@leaf
def _secant(b: Bracket) -> float:
    """Return the zero of the line through both values."""
    return (b.low * b.at_high - b.high * b.at_low) / (b.at_high - b.at_low)


@leaf
def _narrowed(b: Bracket, place: float, value: float) -> Bracket:
    """Narrow the bracket with a new point."""
    if value * b.at_high <= 0.0:
        return Bracket(b.high, b.at_high, place, value)
    return Bracket(b.low, 0.5 * b.at_low, place, value)


@leaf
def strain(P: float, v0: float, EA: float, m: float) -> float:
    """Return the strain under an effective force: P = EA eps - m v0^2 (1 + eps), (D1) [-]."""
    flow = m * v0 * v0
    return (P + flow) / (EA - flow)


@leaf
def penetration(load: float, R: float, k_linear: float, k_quadratic: float) -> float:
    """Solve f(delta) (R - delta) = load = P (1 + eps) for the penetration, (D2) [m]."""
    if math.isinf(k_linear):
        return 0.0
    delta = 2.0 * load / R
    delta /= k_linear + math.sqrt(k_linear * k_linear + 2.0 * k_quadratic * delta)
    for _ in range(20):
        f = elastic_force(delta, k_linear, k_quadratic)
        slope = elastic_stiffness(delta, k_linear, k_quadratic) * (R - delta) - f
        step = (f * (R - delta) - load) / slope
        delta -= step
        if abs(step) <= 1e-15 * R:
            break
    return delta


@leaf
def seat(P: float, v0: float, s: Section) -> tuple[float, float]:
    """Return stretch 1 + eps [-] and radius R - delta [m] of the belt under an effective force."""
    stretch = 1.0 + strain(P, v0, s.EA, s.m)
    return stretch, s.R - penetration(P * stretch, s.R, s.k_linear, s.k_quadratic)


@leaf
def lever(P: float, radius: float, s: Section) -> float:
    """Return the lever of a span force about the axis, (D6) [m]."""
    if math.isinf(s.k_linear):
        return radius
    return radius * (1.0 + elastic_energy(s.R - radius, s.k_linear, s.k_quadratic) / P)


@leaf
def force_and_speed(P: float, v0: float, entry: float, s: Section) -> tuple[float, float]:
    """Return line force [N/m] and creep speed relative to the entry [m/s], (D3)."""
    stretch, radius = seat(P, v0, s)
    return P * stretch / radius, s.R * v0 * abs(entry - stretch / radius)


@leaf
def _coefficient(f: float, v: float, tables: SurfaceTables) -> float:
    """Look up the friction coefficient at a line force [N/m] and a sliding speed [m/s]."""
    i, s, _ = locate(tables.x_nodes, tables.f_ref, f)
    j, t, _ = locate(tables.y_nodes, tables.v_ref, v)
    mu, _, _ = evaluate_cell(tables.C, i, j, s, t)
    return float(mu)


@shared_leaf
def crossing(
    limit: float, P_in: float, P_out: float, v0: float, s: Section, of_speed: int
) -> float:
    """Find where line force or creep speed crosses a limit, as a fraction of the range of ln P.

    Both are monotonic in P.

    Returns
    -------
    float
        In (0, 1); 1 if the limit is not crossed.
    """
    fall = math.log(P_out / P_in)
    stretch, radius = seat(P_in, v0, s)
    entry = stretch / radius
    at_in = force_and_speed(P_in, v0, entry, s)[of_speed] - limit
    at_out = force_and_speed(P_out, v0, entry, s)[of_speed] - limit
    if at_in * at_out >= 0.0:
        return 1.0
    b = Bracket(0.0, at_in, 1.0, at_out)
    for _ in range(60):
        share = _secant(b)
        P = P_in * math.exp(fall * share)
        b = _narrowed(b, share, force_and_speed(P, v0, entry, s)[of_speed] - limit)
        if b.at_high == 0.0 or abs(b.high - b.low) < 1e-12:
            break
    return b.high


@leaf
def _breaks(
    P_in: float, P_out: float, v0: float, x: float, s: Section, friction: Friction
) -> tuple[float, float, float, float, float, float]:
    """Return the ends of the panels on which mu is smooth, as fractions of ln P, ascending."""
    f_low = crossing(friction.f_low, P_in, P_out, v0, s, 0)
    f_high = crossing(friction.f_high, P_in, P_out, v0, s, 0)
    v_low = crossing(friction.v_low - x, P_in, P_out, v0, s, 1)
    v_high = crossing(friction.v_high - x, P_in, P_out, v0, s, 1)
    # sort each pair, then the two inner points
    f_1, f_2, v_1, v_2 = (
        min(f_low, f_high),
        max(f_low, f_high),
        min(v_low, v_high),
        max(v_low, v_high),
    )
    second, third = max(f_1, v_1), min(f_2, v_2)
    return 0.0, min(f_1, v_1), min(second, third), max(second, third), max(f_2, v_2), 1.0


@shared_leaf
def sliding_arc(
    P_in: float, P_out: float, v0: float, x: float, s: Section, friction: Friction
) -> tuple[float, float]:
    """Integrate angle (D4) and stress-free length of an arc that slides from P_in to P_out.

    Parameters
    ----------
    P_in, P_out : float
        Effective forces at the two ends [N], > 0.
    v0 : float
        Stress-free length of belt per second [m/s].
    x : float
        Sliding speed at the entry [m/s].
    s : Section
        Belt and bed on this pulley.
    friction : Friction
        mu as a function of line force and sliding speed.

    Returns
    -------
    angle, length : float
        [rad], [m].
    """
    fall = math.log(P_out / P_in)
    angle, length = 0.0, 0.0
    if fall == 0.0:
        return angle, length
    stretch, radius = seat(P_in, v0, s)
    entry = stretch / radius
    ends = _breaks(P_in, P_out, v0, x, s, friction)
    tables = friction.tables
    for panel in range(5):
        width = ends[panel + 1] - ends[panel]
        if width <= 0.0:
            continue
        pieces = int(abs(fall) * width / WIDEST_PANEL) + 1
        for piece in range(pieces):
            for q in range(GAUSS_NODES.size):
                share = (piece + GAUSS_NODES[q]) / pieces
                P = P_in * math.exp(fall * (ends[panel] + width * share))
                stretch, radius = seat(P, v0, s)
                creep = s.R * v0 * abs(entry - stretch / radius)
                mu = _coefficient(P * stretch / radius, x + creep, tables)
                turn = GAUSS_WEIGHTS[q] * abs(fall) * width / (pieces * mu)
                angle += turn
                length += turn * radius / stretch
    return angle, length


@leaf
def _slip_of_grid(k: int, friction: Friction) -> float:
    """Return speed k of the full-slip search, geometric up to the fastest measured one [m/s]."""
    first = SLOWEST_SLIP * friction.tables.v_ref
    return first * (friction.v_high / first) ** (k / (SLIP_GRID - 1.0))


@shared_leaf
def full_slip(
    P_in: float, P_out: float, v0: float, wrap: float, s: Section, friction: Friction
) -> float:
    """Find the sliding speed at the entry at which the arc (D4) equals the whole wrap, (D5).

    Returns
    -------
    float
        The smallest such speed [m/s]; nan if there is none within the measured speeds.
    """
    if friction.tables.y_nodes.size == 1:  # mu does not depend on the speed
        return math.nan
    low, at_low = 0.0, sliding_arc(P_in, P_out, v0, 0.0, s, friction)[0] - wrap
    high, at_high = low, at_low
    for k in range(0 if friction.falls else SLIP_GRID - 1, SLIP_GRID):
        high = _slip_of_grid(k, friction)
        at_high = sliding_arc(P_in, P_out, v0, high, s, friction)[0] - wrap
        if at_high <= 0.0:
            break
        low, at_low = high, at_high
    if at_high > 0.0:
        return math.nan
    b = Bracket(low, at_low, high, at_high)
    for _ in range(60):
        x = _secant(b)
        b = _narrowed(b, x, sliding_arc(P_in, P_out, v0, x, s, friction)[0] - wrap)
        if abs(b.at_high) < 1e-13 * wrap or abs(b.high - b.low) < 1e-13 * b.high:
            break
    return b.high


@shared_leaf
def least_arc(P_in: float, P_out: float, v0: float, s: Section, friction: Friction) -> float:
    """Find the smallest arc, (D4), that holds the forces at any measured sliding speed.

    Returns
    -------
    float
        [rad].
    """
    if P_in == P_out:
        return 0.0
    least = sliding_arc(P_in, P_out, v0, 0.0, s, friction)[0]
    if friction.tables.y_nodes.size == 1:
        return least
    for k in range(0 if friction.falls else SLIP_GRID - 1, SLIP_GRID):
        x = _slip_of_grid(k, friction)
        least = min(least, sliding_arc(P_in, P_out, v0, x, s, friction)[0])
    return least


@shared_leaf
def steady_states(
    P_in: float, P_out: float, v0: float, wrap: float, s: Section, friction: Friction
) -> int:
    """Count the steady states of an arc: more than one only if mu falls with the speed."""
    above = sliding_arc(P_in, P_out, v0, 0.0, s, friction)[0] > wrap
    count = 0 if above else 1
    if friction.tables.y_nodes.size == 1:
        return count
    for k in range(0 if friction.falls else SLIP_GRID - 1, SLIP_GRID):
        x = _slip_of_grid(k, friction)
        now = sliding_arc(P_in, P_out, v0, x, s, friction)[0] > wrap
        if now != above:
            count += 1
        above = now
    return count


@kernel
def arcs_of_pulleys(
    P_in: Array,
    P_out: Array,
    v0: float,
    wraps: Array,
    pulleys: Pulleys,
    of_ribs: Friction,
    of_back: Friction,
    arcs: Arcs,
) -> None:
    """Write the state of the belt on every pulley into ``arcs``."""
    for i in range(wraps.size):
        s = _section(pulleys, i)
        friction = of_ribs if pulleys.ribs[i] else of_back
        stretch, radius = seat(P_in[i], v0, s)
        out = seat(P_out[i], v0, s)[1]
        arcs.torque[i] = P_in[i] * lever(P_in[i], radius, s) - P_out[i] * lever(P_out[i], out, s)
        arcs.rate[i] = stretch / radius
        needed, sliding = sliding_arc(P_in[i], P_out[i], v0, 0.0, s, friction)
        x = slip = 0.0
        if needed <= wraps[i]:
            arcs.length[i] = sliding + (wraps[i] - needed) * radius / stretch
        else:
            slip = full_slip(P_in[i], P_out[i], v0, wraps[i], s, friction)
            # in gross slip the torque sets the forces, with mu at the fastest measured speed
            fastest = friction.v_high if math.isfinite(friction.v_high) else 0.0
            x = fastest if math.isnan(slip) else slip
            angle, sliding = sliding_arc(P_in[i], P_out[i], v0, x, s, friction)
            arcs.length[i] = sliding * wraps[i] / angle
        ahead = x / (s.R * v0)
        arcs.W[i] = arcs.rate[i] + (ahead if P_in[i] > P_out[i] else -ahead)
        arcs.needed[i], arcs.slip[i] = needed, slip


@kernel
def least_arcs_of_pulleys(
    P_in: Array,
    P_out: Array,
    v0: float,
    pulleys: Pulleys,
    of_ribs: Friction,
    of_back: Friction,
    least: Array,
) -> None:
    """Write the smallest arc of every pulley [rad] into ``least`` (n,); see :func:`least_arc`."""
    for i in range(least.size):
        friction = of_ribs if pulleys.ribs[i] else of_back
        least[i] = least_arc(P_in[i], P_out[i], v0, _section(pulleys, i), friction)


@leaf
def _share_before(u: float, P_in: float, P_out: float) -> float:
    """Return the share of the change of P up to a fraction u of ln P."""
    return (1.0 - (P_out / P_in) ** u) / (1.0 - P_out / P_in)


@leaf
def _shares(
    P_in: float, P_out: float, v0: float, x: float, s: Section, friction: Friction
) -> tuple[float, float]:
    """Return the shares of friction below the measured speeds and outside the measured forces."""
    if P_in == P_out:
        return 0.0, 0.0
    below = 0.0
    if x < friction.v_low:
        below = _share_before(crossing(friction.v_low - x, P_in, P_out, v0, s, 1), P_in, P_out)
    to_low = _share_before(crossing(friction.f_low, P_in, P_out, v0, s, 0), P_in, P_out)
    to_high = _share_before(crossing(friction.f_high, P_in, P_out, v0, s, 0), P_in, P_out)
    f_in = force_and_speed(P_in, v0, 0.0, s)[0]
    outside = to_low if f_in < friction.f_low else 1.0 - to_low
    outside += to_high if f_in > friction.f_high else 1.0 - to_high
    return below, outside


@kernel
def shares_of_pulleys(
    P_in: Array,
    P_out: Array,
    v0: float,
    wraps: Array,
    slip: Array,
    pulleys: Pulleys,
    of_ribs: Friction,
    of_back: Friction,
    shares: SlidingShares,
) -> None:
    """Write force, speed and range shares of every pulley's friction into ``shares``."""
    for i in range(wraps.size):
        s = _section(pulleys, i)
        friction = of_ribs if pulleys.ribs[i] else of_back
        stretch, radius = seat(P_in[i], v0, s)
        f_in = P_in[i] * stretch / radius
        f_out, creep = force_and_speed(P_out[i], v0, stretch / radius, s)
        shares.slip_speed_max[i] = slip[i] + creep
        shares.normal_force_min[i] = f_in if f_in < f_out else f_out
        shares.normal_force_max[i] = f_out if f_in < f_out else f_in
        below, outside = _shares(P_in[i], P_out[i], v0, slip[i], s, friction)
        shares.below_speed_range[i], shares.outside_force_range[i] = below, outside
        states = steady_states(P_in[i], P_out[i], v0, wraps[i], s, friction)
        shares.steady_states[i] = states


@dataclass(frozen=True, slots=True)
class StringLevel:
    """The pulleys of a drive at string level.

    Parameters
    ----------
    drive : Drive
        Belt, laws and pulleys.
    """

    drive: Drive
    _laws: tuple[Pulleys, Friction, Friction] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        law, pulleys = self.drive.law, self.drive.pulleys
        rigid = (math.inf, 0.0)
        soft = rigid if law is None else (law.k_linear_N_m2, law.k_quadratic_N_m3)
        arrays = Pulleys(
            self.drive.belt.EA,
            self.drive.belt.rhoA,
            np.array([soft if p.ribs else rigid for p in pulleys]),
            np.array([p.R for p in pulleys]),
            np.array([p.ribs for p in pulleys]),
        )
        of_ribs = _friction(self.drive.surface, self.drive.friction)
        of_back = _friction_of_back(self.drive.back_friction)
        object.__setattr__(self, "_laws", (arrays, of_ribs, of_back))

    def arcs(self, P_in: Array, P_out: Array, v0: float, wraps: Array) -> Arcs:
        """Compute the state of the belt on every pulley.

        Parameters
        ----------
        P_in, P_out : ndarray (n,)
            Effective span forces before and after each pulley [N], > 0.
        v0 : float
            Stress-free length of belt per second [m/s], > 0.
        wraps : ndarray (n,)
            Arcs between tangent points [rad].
        """
        arcs = Arcs(*np.empty((6, wraps.size)))
        arcs_of_pulleys(P_in, P_out, v0, wraps, *self._laws, arcs)
        return arcs

    def extra_length(self, laid: Layout, P: Array) -> float:
        """Return zero: a string does not bend, so (D15) does not apply."""
        return 0.0

    def least_arcs(self, P_in: Array, P_out: Array, v0: float) -> Array:
        """Return the arcs [rad] needed at the most effective measured sliding speed, shape (n,).

        Parameters are those of :meth:`arcs`.
        """
        least = np.empty(P_in.size)
        least_arcs_of_pulleys(P_in, P_out, v0, *self._laws, least)
        return least

    def along_arc(self, i: int, P: Array, v0: float, x: float) -> tuple[Array, Array, Array]:
        """Return line force [N/m], sliding speed [m/s] and mu on pulley i at forces P (n,) [N].

        ``P[0]`` is the force at the entry, where the belt slides with x [m/s].
        """
        pulleys, of_ribs, of_back = self._laws
        friction, s = of_ribs if pulleys.ribs[i] else of_back, _section(pulleys, i)
        stretch, radius = seat(P[0], v0, s)
        contact = []
        for force in P.tolist():
            f, creep = force_and_speed(force, v0, stretch / radius, s)
            contact.append((f, x + creep, _coefficient(f, x + creep, friction.tables)))
        f, v, mu = np.array(contact).T
        return f, v, mu

    def shares(
        self, P_in: Array, P_out: Array, v0: float, wraps: Array, slip: Array
    ) -> SlidingShares:
        """Compute sliding speeds, line forces, and the shares of friction outside measurements.

        Parameters
        ----------
        P_in, P_out, v0, wraps
            As in :meth:`arcs`.
        slip : ndarray (n,)
            Sliding speeds at the entries [m/s], as :meth:`arcs` gives them.
        """
        speeds, least, most, below, outside = np.empty((5, wraps.size))
        states = np.empty(wraps.size, dtype=np.int64)
        shares = SlidingShares(speeds, least, most, below, outside, states)
        shares_of_pulleys(P_in, P_out, v0, wraps, slip, *self._laws, shares)
        return shares


@functools.cache
def _friction_of_back(mu: float) -> Friction:
    surface = FrictionSurface.constant(mu)
    return _friction(surface, surface.tables())


def _friction(measured: FrictionSurface, tables: SurfaceTables) -> Friction:
    validity = measured.validity
    limits = (*validity["normal_force_N_m"], *validity["slip_speed_m_s"])
    return Friction(tables, *limits, measured.falls_with_speed)
