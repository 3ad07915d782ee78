"""Contact of belt and pulley: gaps, normal forces by Eq. (1), tangential forces by status.

A contact point sits at ``r = N_c q`` and stands for a part of the belt of length ``w``. With
rho = |r| the penetration is ``delta = -g_N = R - rho``; the normal ``n = r/rho`` points from pulley
to belt, the tangent ``t`` in the direction in which the pulley's surface moves (towards B).

The contact ends inside such a part. A rule that merely asks whether the point itself touches would
make the forces jump in slope whenever a point opens, and its error falls slowly with the mesh. So
the penetration varies linearly over the part, ``delta + sigma x`` with ``sigma = -n.r'`` and
|x| <= w/2, and the elastic energy of Eq. (3) is integrated exactly over what is in contact. Its
derivatives are the line force (in delta) and the small couple (in sigma) of the part.

The advance of the pulley's surface relative to the belt during a step is
``slip = rho (omega dt - (theta - theta_old))``: the polar angle makes stick exact for any step.

The points of one element are a patch: they stick together or slide together. Sliding points carry
mu at their own force and speed; a sticking patch carries one force, spread like the friction limits
of its points, and its slip, averaged in the same way, is zero. A stick force for every point would
be more constraints than the element has tangential freedoms.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

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
"""Share by which motors miss a setting from run to run."""


class ContactArrays(NamedTuple):
    """Pulley, normal law and friction surface, as compiled code wants them.

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
        Coefficient of friction over both.
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
    """Pulley of radius ``R`` [m] with the identified laws, ready for compiled code."""
    measured = surface.validity
    # float(): an int would make the kernels be compiled once more for another signature
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
    """The same pulley with another friction surface."""
    measured = surface.validity
    return pulley._replace(
        f_range=measured["normal_force_N_m"],
        v_range=_speeds_covered(measured["slip_speed_m_s"]),
        surface=surface.tables(),
    )


def _speeds_covered(measured: tuple[float, float]) -> tuple[float, float]:
    """Sliding speeds that do not count as outside [m/s]: a node is the mean of runs that scatter.

    The slowest and the fastest runs would lie outside by that scatter alone.
    """
    low, high = measured
    return low * (1.0 - SPEED_SCATTER), high * (1.0 + SPEED_SCATTER)


class Motion(NamedTuple):
    """What the pulley does in the step at hand.

    Attributes
    ----------
    omega : float
        Speed of the pulley [rad/s].
    rate : float
        1/dt [1/s]; 0 in statics, where the belt rests and slips with omega R.
    friction : float
        Factor on the coefficient of friction: 0 for a frictionless lay-on, else 1.
    augmentation : float
        Stiffness that holds a sticking patch to its multiplier [N/m], or its damping [N s/m] where
        the belt runs.
    flow : float
        Stress-free length of belt that passes a point per second [m/s]; 0 where the belt stays. A
        belt that runs through its shape has a speed of sliding, [m/s], wherever "slip" stands here.
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
"""The points of one element as one contact.

``status`` is ``STICK`` or ``SLIDE``; with ``sign``, the direction of sliding (1 along t or -1), it
decides what acts. ``la_T`` is the multiplier of a sticking patch [N]; ``..._before`` is what the
step began with. ``ratio`` is the limit of friction over the sliding one [-].

Output: ``slip`` of the step [m]; tangential ``force`` and its ``limit`` [N]; ``pull``, the
direction W_T in the coordinates of the element, and ``carry``, by how much the slip falls with
them, which are the same in a step. ``turning`` are sliding patches of a running belt within which
the slip may change its direction, ``slip_out`` is the slip at its downstream end. ``broken`` tells
how a patch breaks the law of friction, while the statuses are revised.
"""

BEFORE = np.dtype(
    (
        np.record,
        [("theta", np.float64), ("rho", np.float64), ("limit", np.float64), ("v", np.float64)],
    )
)
"""What a point remembers of the last time step.

Its angle from the top [rad] and its radius [m], its limit of friction [N], and the sliding speed
that friction has followed so far [m/s].
"""

Patches: TypeAlias = "np.recarray[Any, np.dtype[Any]]"
Before: TypeAlias = "np.recarray[Any, np.dtype[Any]]"


MOST_ZONES = 6
"""Zones whose tangent is exact; what further ones add is right, but not their tangent."""
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
"""Where a zone begins in which sheared ribs stick.

The ``element`` of the point before the zone, on which its ``a_z`` depends, and the derivatives of
``a_z`` by the coordinates of that element [-], by the stretch [m] and by the speed of the pulley
[m s].
"""

Zones: TypeAlias = "np.recarray[Any, np.dtype[Any]]"


def fields_of(records: np.recarray[Any, np.dtype[Any]]) -> SimpleNamespace:
    """Fields of records, as arrays that share their memory.

    A record array makes a field anew whenever it is asked for, which takes longer than what is done
    with the field.
    """
    plain = records.view(np.ndarray)
    return SimpleNamespace(**{name: plain[name] for name in records.dtype.names or ()})


class Ribs(NamedTuple):
    """Ribs of a belt that runs, and where they stick, see :mod:`beltid.rigsim.contact.ribs`.

    Attributes
    ----------
    stiffness : float
        Tangential force per stress-free length and displacement [N/m²]; infinite where the ribs do
        not shear: then there are no zones, but patches.
    zone : ndarray of int, shape (n_e, n_c)
        Zone of every contact point that sticks, from the entry on; ``SLIDES`` of all others.
    zones : records of ZONE, shape (MOST_ZONES,)
        Where they begin.
    number : ndarray of int, shape (1,)
        How many of them there are.
    """

    stiffness: float
    zone: NDArray[np.int64]
    zones: Zones
    number: NDArray[np.int64]


def new_ribs(n_e: int, n_c: int, stiffness: float) -> Ribs:
    """Ribs with a shear stiffness [N/m²], nowhere in contact."""
    return Ribs(
        stiffness=float(stiffness),
        zone=np.full((n_e, n_c), SLIDES),
        zones=np.zeros(MOST_ZONES, dtype=ZONE).view(np.recarray),
        number=np.zeros(1, dtype=np.int64),
    )


RIGID = new_ribs(0, 0, math.inf)
"""Ribs that do not shear: what they would have to remember is never written."""


class Points(NamedTuple):
    """State of the contact: patches, memory, and output of the points of shape (n_e, n_c).

    Attributes
    ----------
    patches : records of PATCH, shape (n_e,)
        The contacts that stick or slide.
    last : records of BEFORE
        The last time step.
    memory : ndarray, shape (1,)
        Slip over which friction follows a change of speed [m]; 0 for at once.
    theta, rho : ndarray
        Polar coordinates of the points that touch, angle from the top [rad] and radius [m].
    f_N : ndarray
        Elastic line force of the part [N/m].
    F_N, F_T, F_max : ndarray
        Normal force, tangential force and its limit [N].
    slip : ndarray
        Slip of the step [m].
    f_look, F_look : ndarray, shape (n_e, n_c, 2)
        Line forces at which mu is looked up [N/m], and the normal forces they stand for [N].
    frames : ndarray of FRAME
        What describes a point that touches while it is assembled.
    counts : ndarray, shape (2, n_c)
        Room for the derivatives of a patch's slips by those of its points [-].
    ribs : Ribs
        Ribs that shear.
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
    """Contact points at rest, all patches with the given status, no forces.

    Ribs with a finite shear stiffness [N/m²] stick by zones, not by patches.
    """
    n_e, n_c = belt.w_c.shape
    patches = np.zeros(n_e, dtype=PATCH)
    patches["status"] = status
    patches["sign"] = patches["ratio"] = 1.0
    return Points(
        patches=patches.view(np.recarray),
        last=np.zeros((n_e, n_c), dtype=BEFORE).view(np.recarray),
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
    """Slip [m], or slip rate [m/s], at rho as it is at the radius R, where mu is looked up."""
    return slip * R / rho


@leaf
def in_range(limits: tuple[float, float], value: float) -> bool:
    """Whether a value lies in the measured range, give or take the rounding of a step."""
    return limits[0] * (1.0 - 1e-9) <= value <= limits[1] * (1.0 + 1e-9)


class PartEnergy(NamedTuple):
    """Derivatives of the mean elastic energy of a part, per length.

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
    """Energy of Eq. (3) of a part of the half length ``a`` with the penetration delta + sigma x."""
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
    """What of a part touches, and with which penetrations; derivatives in delta and sigma.

    Attributes
    ----------
    share, share_d, share_s : float
        Share of the part that touches [-].
    middle, middle_d, middle_s : float
        Penetration in the middle of what touches [m].
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
    """What touches of a part of the half length ``a`` with the penetration delta + sigma x."""
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


@shared_leaf
def remember(belt: BeltArrays, points: Points, q: Array) -> None:
    """Keep the polar coordinates of all points, touching or not, for the next step."""
    for e in range(belt.h.size):
        for c in range(belt.w_c.shape[1]):
            x = y = 0.0
            for j in range(4):
                x += belt.N_c[e, c, j] * q[4 * e + 2 * j]
                y += belt.N_c[e, c, j] * q[4 * e + 2 * j + 1]
            before = points.last[e, c]
            before.theta = math.atan2(x, y)
            before.rho = math.sqrt(x * x + y * y)


@leaf
def within_reach(q: Array, e: int, h: float, R: float) -> bool:
    """Whether an element can touch: a node of it is nearer to the pulley than half its length."""
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
                *("slip_n", "slip_t", "slip_s"),  # by how much the slip falls with r n, r t, r' t
                *("T_stretch", "T_omega"),  # of a running belt, beyond the length of the part
            )
        ],
    )
)
"""What describes a point that touches while it is assembled."""


@leaf
def press(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    q: Array,
    stretch: float,
) -> None:
    """Normal forces of all points, Eq. (1), and the frames of those that touch.

    The fields of a frame that belong to friction are zero until :func:`sliding_friction`.
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
                # of a part that touches in part only that share dissipates, else the force jumps
                part, C_P = touching_share(delta, sigma, a), pulley.C_P
                F_N += dissipative_force(g_N_dot, part.share * C_P)
                frame.damp_d = C_P * (part.share * motion.rate - part.share_d * g_N_dot)
                frame.damp_s = -C_P * part.share_s * g_N_dot
            points.f_N[e, c], points.F_N[e, c] = energy.force, F_N
