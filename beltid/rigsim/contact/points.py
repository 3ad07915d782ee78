"""Compute gaps and normal forces of the contact, Eq. (1), and store the state of its points.

A contact point lies at ``r = N_c q`` and represents a part of the belt of length ``w``. With
rho = |r| the penetration is ``delta = -g_N = R - rho``; the normal ``n = r/rho`` points from pulley
to belt, the tangent ``t`` in the direction in which the pulley's surface moves (towards B).

The contact ends inside such a part. If only the point itself decided whether its part touches, the
slope of the forces would jump whenever a point opens, and the error would fall slowly with the
mesh. So the penetration varies linearly over the part, ``delta + sigma x`` with ``sigma = -n.r'``
and |x| <= w/2, and the elastic energy of Eq. (3) is integrated exactly over the length in contact.
Its derivatives are the line force (in delta) and the small couple (in sigma) of the part.

The advance of the pulley's surface relative to the belt during a step is
``slip = rho (omega dt - (theta - theta_old))``: the polar angle makes stick exact for any step.

The points of one element form a patch: they stick together or slide together. Sliding points have
mu at their own force and speed. A sticking patch carries one force, distributed like the friction
limits of its points; its slip, averaged with the same weights, is zero. One stick force per point
would give more constraints than the element has tangential degrees of freedom.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.laws.surface_tables import SurfaceTables
from beltid.params import Contact
from beltid.rigsim.beam.belt import BeltArrays
from beltid.rigsim.compiled import leaf, shared_leaf
from beltid.rigsim.compiled_laws import (
    dissipative_force,
    elastic_energy,
    elastic_force,
    elastic_stiffness,
    integral_of_energy,
)

Array = NDArray[np.float64]

Frames = NDArray[Any]  # records of FRAME, shape (n_e, n_c)

STICK, SLIDE = 1, 2
SPEED_SCATTER = 0.01
"""Relative deviation of a motor's speed from its setting between runs [-]."""


class ContactArrays(NamedTuple):
    """Pulley, normal law and friction surface for compiled code.

    Attributes
    ----------
    R : float
        Radius of the belt's centreline on the pulley [m].
    k_linear, k_quadratic : float
        Coefficients of Eq. (3) [N/m²], [N/m³].
    C_P : float
        Damping of one contact point, Eq. (4) [N s/m].
    f_range, v_range : tuple of float
        Measured range of the surface, line force [N/m] and sliding speed [m/s].
    surface : SurfaceTables
        Coefficient of friction over line force and sliding speed.
    """

    R: float
    k_linear: float
    k_quadratic: float
    C_P: float
    f_range: tuple[float, float]
    v_range: tuple[float, float]
    surface: SurfaceTables


def contact_arrays(
    R: float, contact: Contact, law: NormalLaw, surface: FrictionSurface
) -> ContactArrays:
    """Build the pulley of radius ``R`` [m] with the identified laws for compiled code."""
    measured = surface.validity
    # float(): an int would be another signature, and the kernels would be compiled again
    return ContactArrays(
        R=float(R),
        k_linear=float(law.k_linear_N_m2),
        k_quadratic=float(law.k_quadratic_N_m3),
        C_P=float(contact.C_P),
        f_range=measured["normal_force_N_m"],
        v_range=_speeds_covered(measured["slip_speed_m_s"]),
        surface=surface.tables(),
    )


def with_surface(pulley: ContactArrays, surface: FrictionSurface) -> ContactArrays:
    """Return the pulley with another friction surface."""
    measured = surface.validity
    return pulley._replace(
        f_range=measured["normal_force_N_m"],
        v_range=_speeds_covered(measured["slip_speed_m_s"]),
        surface=surface.tables(),
    )


def _speeds_covered(measured: tuple[float, float]) -> tuple[float, float]:
    """Widen the measured range of sliding speeds [m/s] by the scatter between runs.

    A node is the mean of several runs, so the slowest and fastest of them would count as outside.
    """
    low, high = measured
    return low * (1.0 - SPEED_SCATTER), high * (1.0 + SPEED_SCATTER)


class Motion(NamedTuple):
    """Motion of the pulley in the current step.

    Attributes
    ----------
    omega : float
        Speed of the pulley [rad/s].
    rate : float
        1/dt [1/s]; 0 in statics, where the belt rests and the slip is omega R.
    friction : float
        Factor on the coefficient of friction: 0 for a frictionless lay-on, else 1.
    augmentation : float
        Penalty stiffness of a sticking patch [N/m]; for a running belt a damping [N s/m].
    flow : float
        Stress-free length of belt that passes a point per second [m/s]; 0 for a belt that does not
        run. For a running belt, "slip" in this module is a sliding speed [m/s].
    """

    omega: float
    rate: float
    friction: float
    augmentation: float
    flow: float = 0.0


PATCH = np.dtype(
    (
        np.record,
        [
            ("status", np.int64),
            ("sign", np.float64),
            ("la_T", np.float64),
            ("status_before", np.int64),
            ("sign_before", np.float64),
            ("la_T_before", np.float64),
            ("ratio", np.float64),
            ("slip", np.float64),
            ("force", np.float64),
            ("limit", np.float64),
            ("pull", np.float64, (8,)),
            ("carry", np.float64, (8,)),
            ("turning", np.bool_),
            ("slip_out", np.float64),
            ("broken", np.int64),
        ],
    )
)
"""Patch: the points of one element as one contact.

``status`` (``STICK`` or ``SLIDE``) and ``sign``, the direction of sliding (1 along t or -1),
determine the friction. ``la_T`` is the multiplier of a sticking patch [N]; ``..._before`` are the
values at the start of the step. ``ratio`` is the limit of friction over that of sliding [-].

Output: ``slip`` of the step [m]; tangential ``force`` and its ``limit`` [N]; ``pull``, the
direction W_T in the coordinates of the element; ``carry``, the decrease of the slip with these
coordinates (``pull`` and ``carry`` are equal in a time step). ``turning`` marks sliding patches of
a running belt within which the slip may reverse; ``slip_out`` is the slip at the downstream end.
``broken`` is the kind of violation of the friction law, set while the statuses are revised.
"""

BEFORE = np.dtype(
    (
        np.record,
        [("theta", np.float64), ("rho", np.float64), ("limit", np.float64), ("v", np.float64)],
    )
)
"""State of a point at the last time step.

Angle from the top [rad], radius [m], friction limit [N], and the filtered sliding speed of friction
with memory [m/s].
"""

Patches = NDArray[Any]  # records of PATCH, shape (n_e,)
Before = NDArray[Any]  # records of BEFORE, shape (n_e, n_c)

MOST_ZONES = 6
"""Number of zones with an exact tangent; the forces of further zones are exact, too."""
SLIDES = -1

ZONE = np.dtype(
    (
        np.record,
        [
            ("element", np.int64),
            ("by_q", np.float64, (8,)),
            ("by_stretch", np.float64),
            ("by_omega", np.float64),
        ],
    )
)
"""Start of a zone in which sheared ribs stick.

``element`` is that of the point before the zone, on which ``a_z`` depends; the other fields are the
derivatives of ``a_z`` with respect to the coordinates of that element [-], the stretch [m] and the
speed of the pulley [m s].
"""

Zones = NDArray[Any]  # records of ZONE, shape (MOST_ZONES,)


def fields_of(records: NDArray[Any]) -> SimpleNamespace:
    """Return the fields of records as arrays that share their memory."""
    return SimpleNamespace(**{name: records[name] for name in records.dtype.names or ()})


class Ribs(NamedTuple):
    """Ribs of a running belt and the zones in which they stick, :mod:`beltid.rigsim.contact.ribs`.

    Attributes
    ----------
    stiffness : float
        Tangential force per stress-free length and displacement [N/m²]; infinite for ribs that do
        not shear, which stick by patches instead of zones.
    zone : ndarray of int, shape (n_e, n_c)
        Zone of every sticking contact point, counted from the entry; ``SLIDES`` for all others.
    zones : records of ZONE, shape (MOST_ZONES,)
        Starts of the zones.
    number : ndarray of int, shape (1,)
        Number of zones.
    """

    stiffness: float
    zone: NDArray[np.int64]
    zones: Zones
    number: NDArray[np.int64]


def new_ribs(n_e: int, n_c: int, stiffness: float) -> Ribs:
    """Allocate ribs with a shear stiffness [N/m²], nowhere in contact."""
    return Ribs(
        stiffness=float(stiffness),
        zone=np.full((n_e, n_c), SLIDES),
        zones=np.zeros(MOST_ZONES, dtype=ZONE),
        number=np.zeros(1, dtype=np.int64),
    )


RIGID = new_ribs(0, 0, math.inf)
"""Ribs that do not shear; their arrays are empty."""


class Points(NamedTuple):
    """State of the contact: patches, memory, and output of the points of shape (n_e, n_c).

    Attributes
    ----------
    patches : records of PATCH, shape (n_e,)
        Elements that stick or slide as a whole.
    last : records of BEFORE
        State at the last time step.
    memory : ndarray, shape (1,)
        Slip over which friction follows a change of speed [m]; 0 for immediately.
    theta, rho : ndarray
        Polar coordinates of the touching points, angle from the top [rad] and radius [m].
    f_N : ndarray
        Elastic line force of the part [N/m].
    F_N, F_T, F_max : ndarray
        Normal force, tangential force and its limit [N].
    slip : ndarray
        Slip of the step [m].
    f_look, F_look : ndarray, shape (n_e, n_c, 2)
        Line forces at which mu is looked up [N/m], and the normal forces they represent [N].
    frames : ndarray of FRAME
        Normals and derivatives of the touching points, used in assembly.
    counts : ndarray, shape (2, n_c)
        Derivatives of a patch's slips in the slips of its points [-].
    ribs : Ribs
        Ribs of a running belt.
    """

    patches: Patches
    last: Before
    memory: Array
    theta: Array
    rho: Array
    f_N: Array
    F_N: Array
    F_T: Array
    F_max: Array
    slip: Array
    f_look: Array
    F_look: Array
    frames: Frames
    counts: Array
    ribs: Ribs


def new_points(belt: BeltArrays, status: int, shear_stiffness: float = math.inf) -> Points:
    """Allocate contact points at rest, without forces, all patches with the given status.

    Ribs with a finite shear stiffness [N/m²] stick by zones, not by patches.
    """
    n_e, n_c = belt.w_c.shape
    patches = np.zeros(n_e, dtype=PATCH)
    patches["status"] = status
    patches["sign"] = patches["ratio"] = 1.0
    return Points(
        patches=patches,
        last=np.zeros((n_e, n_c), dtype=BEFORE),
        memory=np.zeros(1),
        theta=np.zeros((n_e, n_c)),
        rho=np.zeros((n_e, n_c)),
        f_N=np.zeros((n_e, n_c)),
        F_N=np.zeros((n_e, n_c)),
        F_T=np.zeros((n_e, n_c)),
        F_max=np.zeros((n_e, n_c)),
        slip=np.zeros((n_e, n_c)),
        f_look=np.zeros((n_e, n_c, 2)),
        F_look=np.zeros((n_e, n_c, 2)),
        frames=np.zeros((n_e, n_c), dtype=FRAME),
        counts=np.zeros((2, n_c)),
        ribs=RIGID if math.isinf(shear_stiffness) else new_ribs(n_e, n_c, shear_stiffness),
    )


@leaf
def at_radius(slip: float, rho: float, R: float) -> float:
    """Convert a slip [m] or slip rate [m/s] from radius rho to R, where mu is looked up."""
    return slip * R / rho


@leaf
def in_range(limits: tuple[float, float], value: float) -> bool:
    """Return whether a value lies in the measured range, with a margin for rounding."""
    return limits[0] * (1.0 - 1e-9) <= value <= limits[1] * (1.0 + 1e-9)


class PartEnergy(NamedTuple):
    """Derivatives of the mean elastic energy of a part per length.

    Attributes
    ----------
    force, couple : float
        First derivatives in delta and sigma: line force [N/m] and couple [N].
    K_dd, K_ds, K_ss : float
        Second derivatives [N/m²], [N/m], [N].
    """

    force: float
    couple: float
    K_dd: float
    K_ds: float
    K_ss: float


@leaf
def part_energy(delta: float, sigma: float, a: float, k1: float, k2: float) -> PartEnergy:
    """Differentiate the energy of a part |x| <= ``a`` with penetration delta + sigma x, Eq. (3)."""
    m = abs(sigma) * a
    if delta >= m:
        k = elastic_stiffness(delta, k1, k2)
        a2 = a * a / 3.0
        f = elastic_force(delta, k1, k2) + k2 * a2 * sigma * sigma
        return PartEnergy(f, a2 * sigma * k, k, 2.0 * k2 * a2 * sigma, a2 * k)
    if delta <= -m:
        return PartEnergy(0.0, 0.0, 0.0, 0.0, 0.0)
    top = delta + m  # only 0 ... top of the penetrations delta - m ... delta + m is in contact
    half = 0.5 / m
    V = integral_of_energy(top, k1, k2) * half
    V_d = elastic_energy(top, k1, k2) * half
    V_dd = elastic_force(top, k1, k2) * half
    V_s = V_d - V / m
    V_ds = V_dd - V_d / m
    V_ss = V_dd - 2.0 * V_s / m
    a_s = math.copysign(a, sigma)
    return PartEnergy(V_d, a_s * V_s, V_dd, a_s * V_ds, a * a * V_ss)


class Touching(NamedTuple):
    """Touching share of a part and its penetrations; derivatives in delta and sigma.

    Attributes
    ----------
    share, share_d, share_s : float
        Share of the part that touches [-].
    middle, middle_d, middle_s : float
        Penetration in the middle of the touching length [m].
    half, half_d, half_s : float
        Half the difference of the penetrations at its ends [m].
    """

    share: float
    share_d: float
    share_s: float
    middle: float
    middle_d: float
    middle_s: float
    half: float
    half_d: float
    half_s: float


@leaf
def touching_share(delta: float, sigma: float, a: float) -> Touching:
    """Compute the touching share of a part |x| <= ``a`` with penetration delta + sigma x."""
    m = abs(sigma) * a
    a_s = math.copysign(a, sigma)
    if delta >= m:
        return Touching(1.0, 0.0, 0.0, delta, 1.0, 0.0, m, 0.0, a_s)
    top = delta + m
    share = 0.5 * top / m
    half = 0.5 * top
    return Touching(
        share, 0.5 / m, a_s * (0.5 - share) / m, half, 0.5, 0.5 * a_s, half, 0.5, 0.5 * a_s
    )


@leaf
def position(belt: BeltArrays, q: Array, e: int, c: int) -> tuple[float, float]:
    """Return the coordinates ``r = N_c q`` of a contact point [m]."""
    x = y = 0.0
    for j in range(4):
        x += belt.N_c[e, c, j] * q[4 * e + 2 * j]
        y += belt.N_c[e, c, j] * q[4 * e + 2 * j + 1]
    return x, y


@shared_leaf
def remember(belt: BeltArrays, points: Points, q: Array) -> None:
    """Store the polar coordinates of all points, touching or not, for the next step."""
    for e in range(belt.h.size):
        for c in range(belt.w_c.shape[1]):
            x, y = position(belt, q, e, c)
            before = points.last[e, c]
            before.theta = math.atan2(x, y)
            before.rho = math.sqrt(x * x + y * y)


@leaf
def within_reach(q: Array, e: int, h: float, R: float) -> bool:
    """Return whether an element can touch: a node is within 0.55 lengths of the pulley."""
    d = 4 * e
    from_here = q[d] * q[d] + q[d + 1] * q[d + 1]
    from_there = q[d + 4] * q[d + 4] + q[d + 5] * q[d + 5]
    reach = R + 0.55 * h
    return min(from_here, from_there) < reach * reach


FRAME = np.dtype(
    (
        np.record,
        [
            (name, np.float64)
            for name in (
                *("n_x", "n_y"),  # normal, from pulley to belt; t = (n_y, -n_x)
                *("kappa", "sigma"),  # t.r'/rho [1/m] and -n.r' [-]
                "length",  # stress-free length of the part [m]
                "couple",  # of the part's energy, in sigma [N m]
                *("K_dd", "K_ds", "K_ss"),  # second derivatives of that energy
                *("damp_d", "damp_s"),  # dissipation in the derivatives of F_N in delta, sigma
                *("T_d", "T_s", "T_slip"),  # derivatives of the tangential force, and in the slip
                *("slip_n", "slip_t", "slip_s"),  # decrease of the slip with r n, r t, r' t
                *("T_stretch", "T_omega"),  # running belt only, besides the length of the part
            )
        ],
    )
)
"""Normal and derivatives of a touching point, used in assembly."""


@leaf
def press(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    q: Array,
    stretch: float,
) -> None:
    """Compute the normal forces of all points, Eq. (1), and the frames of those that touch.

    The friction fields of a frame are set to zero; :func:`sliding_friction` fills them.
    """
    R = pulley.R
    n_c = belt.w_c.shape[1]
    for e in range(belt.h.size):
        reached = within_reach(q, e, belt.h[e], R)
        for c in range(n_c):
            points.F_look[e, c, 0] = points.F_look[e, c, 1] = 0.0
            points.F_T[e, c] = points.F_max[e, c] = points.slip[e, c] = 0.0
            points.f_N[e, c] = points.F_N[e, c] = 0.0
            if not reached:
                continue
            x = y = sx = sy = 0.0
            for j in range(4):
                k = 4 * e + 2 * j
                x += belt.N_c[e, c, j] * q[k]
                y += belt.N_c[e, c, j] * q[k + 1]
                sx += belt.D_c[e, c, j] * q[k]
                sy += belt.D_c[e, c, j] * q[k + 1]
            rho = math.sqrt(x * x + y * y)
            inverse = 1.0 / rho
            nx, ny = x * inverse, y * inverse
            sigma = -(nx * sx + ny * sy)
            a, delta = 0.5 * belt.w_c[e, c], R - rho
            energy = part_energy(delta, sigma, a, pulley.k_linear, pulley.k_quadratic)
            points.rho[e, c] = rho
            if energy.force == 0.0:
                continue
            points.theta[e, c] = math.atan2(x, y)
            w = belt.w_c[e, c] * stretch
            frame = points.frames[e, c]
            frame.n_x, frame.n_y = nx, ny
            frame.kappa, frame.sigma = (ny * sx - nx * sy) * inverse, sigma
            frame.length, frame.couple = w, w * energy.couple
            frame.K_dd, frame.K_ds, frame.K_ss = w * energy.K_dd, w * energy.K_ds, w * energy.K_ss
            frame.damp_d = frame.damp_s = 0.0
            frame.T_d = frame.T_s = frame.T_slip = 0.0
            frame.slip_n = frame.slip_t = frame.slip_s = 0.0
            frame.T_stretch = frame.T_omega = 0.0
            F_N = w * energy.force
            g_N_dot = (rho - points.last[e, c].rho) * motion.rate
            if g_N_dot < 0.0:
                # only the touching share of a part dissipates, otherwise the force would jump
                part, C_P = touching_share(delta, sigma, a), pulley.C_P
                F_N += dissipative_force(g_N_dot, part.share * C_P)
                frame.damp_d = C_P * (part.share * motion.rate - part.share_d * g_N_dot)
                frame.damp_s = -C_P * part.share_s * g_N_dot
            points.f_N[e, c], points.F_N[e, c] = energy.force, F_N
