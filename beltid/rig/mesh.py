"""The path of the belt (support A, span, arc, span, support B) and its mesh.

The pulley's centre is the origin. The belt runs over the top from support A (left) to B (right);
``theta`` is the angle from the top, positive towards B, where the pulley's surface moves: the span
at A is the tight one (trap (d) of the method).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from beltid.arrays import Array
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Rig

HERMITE = np.array([[1, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1.0]])
DERIVATIVES = [polynomial.polyder(HERMITE, order, axis=1).T for order in range(3)]
_x, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)
_y, MASS_WEIGHTS = np.polynomial.legendre.leggauss(4)
GAUSS_POINTS, MASS_POINTS = 0.5 + 0.5 * _x, 0.5 + 0.5 * _y  # on (0, 1)

WIDEST = 0.15  # largest target angle of an element where the contact begins [rad]
INSIDE = 0.3  # distance of the finest elements inside the first contact, over the layer
GROWTH_IN_SPAN = 1.3  # of the element length over the distance, if layer = bending length
GROWTH_ON_ARC = 0.2
LONGEST = 1.5  # element length on the arc over the layer, at most
ELEMENT = 0.06  # length of the default elements per contact point, over the target length
FEWEST_ELEMENTS, MOST_ELEMENTS = 20, 1000
SAMPLES = 400  # of the target lengths over half the path


@dataclass(frozen=True, slots=True)
class Path:
    """Straight span, arc, straight span: radius [m], length of each span [m], angle [rad]."""

    R: float
    span: float
    beta: float

    @property
    def length(self) -> float:
        """Length from support to support [m]."""
        return 2.0 * self.span + self.R * self.beta

    def coordinates(self, s: Array) -> Array:
        """Return position [m] and unit tangent towards B at path coordinates, shape (n, 4)."""
        from_top = np.asarray(s, dtype=float) - 0.5 * self.length
        theta = np.clip(from_top / self.R, -0.5 * self.beta, 0.5 * self.beta)
        t = np.stack([np.cos(theta), -np.sin(theta)], axis=-1)
        n = np.stack([np.sin(theta), np.cos(theta)], axis=-1)
        return np.hstack([self.R * n + (from_top - self.R * theta)[:, None] * t, t])

    def stretched(self, other: "Path", s: Array) -> Array:
        """Map path coordinates ``s`` of this path to another one, part by part in proportion."""
        corners = [[0.0, p.span, p.length - p.span, p.length] for p in (self, other)]
        return np.asarray(np.interp(s, corners[0], corners[1]))


class Mesh(NamedTuple):
    """Shape functions of the elements for (r_i, r'_i, r_j, r'_j), for compiled code.

    Contact points are the midpoints of equal parts of an element.
    """

    h: Array  # lengths of the elements (n_e,) [m]
    D: Array  # first and second derivatives at the Gauss points (n_e, n_g, 4)
    DD: Array
    w_g: Array  # weights of the Gauss points (n_e, n_g) [m]
    N: Array  # shape functions and first derivatives at the contact points (n_e, n_c, 4)
    N_s: Array
    w_c: Array  # lengths of their parts (n_e, n_c) [m]
    M: Array  # mass matrices for 1 kg/m (n_e, 4, 4) [m]


def mesh_on(nodes: Array, n_c: int) -> Mesh:
    """Tabulate the shape functions of elements between ``nodes`` (n_e + 1,) [m]."""
    h, middles = np.diff(nodes), (np.arange(n_c) + 0.5) / n_c
    N_m = shapes(MASS_POINTS, h, 0)
    return Mesh(
        h=h,
        D=shapes(GAUSS_POINTS, h, 1),
        DD=shapes(GAUSS_POINTS, h, 2),
        w_g=0.5 * h[:, None] * GAUSS_WEIGHTS,
        N=shapes(middles, h, 0),
        N_s=shapes(middles, h, 1),
        w_c=np.repeat(h[:, None], n_c, axis=1) / n_c,
        M=np.swapaxes(N_m, 1, 2) @ (0.5 * h[:, None, None] * MASS_WEIGHTS[:, None] * N_m),
    )


def shapes(x: Array, h: Array, order: int) -> Array:
    """Return derivatives of the shape functions at local places x in (0, 1), shape (n_e, m, 4)."""
    unit = polynomial.polyval(x, DERIVATIVES[order]).T
    powers = h[:, None] ** (np.array([0.0, 1.0, 0.0, 1.0]) - order)
    return np.ascontiguousarray(unit * powers[:, None, :])


def bending_length(EI: float, T: float) -> float:
    """Return the length sqrt(EI/T) over which a tightened span straightens [m]."""
    return math.sqrt(EI / T)


def touchdown(belt: Belt, rig: Rig, law: NormalLaw, T: float) -> tuple[float, float, float]:
    """Compute where a tightened belt first touches, in closed form: a beam on an elastic bed.

    The gap to the pulley obeys ``EI u'''' - T u'' + k (u + delta_0) = 0`` in contact; in the span
    the curvature decays as ``exp(d/l)``; curvature, shear and slope are continuous where u = 0.
    Returned are the path coordinate of the first contact from the tangent point towards the arc
    [m], the length over which the pressure grows from zero to its value on the arc [m], and the
    growth of the penetration over the path at the first contact [-].
    """
    EI, R = belt.EI, rig.R
    delta = float(law.penetration(T / R))
    k, bend = float(law.stiffness(delta)), bending_length(EI, T)
    pq = math.sqrt(k / EI)  # exp(-p x), exp(-q x) on the bed: p q and p + q are real
    p_q = math.sqrt(T / EI + 2.0 * pq)
    # where u = 0: u'' + (p + q) u' + p q delta_0 = 0 on the bed; kappa' = kappa/bend in the span
    curvature = 1.0 / (R * bend) + delta * pq * pq / p_q
    curvature /= p_q - pq / p_q + 1.0 / bend
    slope = (curvature + delta * pq) / p_q
    offset = R * ((1.0 / R - curvature) * bend - slope)
    slow = T * T - 4.0 * EI * k
    layer = 2.0 / p_q if slow <= 0.0 else math.sqrt((T + math.sqrt(slow)) / (2.0 * k))
    return offset, layer, slope


def graded_nodes(
    belt: Belt, rig: Rig, law: NormalLaw, beta: float, T_0: float, n_c: int, n: int | None = None
) -> Array:
    """Build the nodes (n + 1,) [m] of a mesh graded towards the ends of the contact, n even.

    There the fourth derivative of the deflection jumps, which determines the error of cubic
    elements; it decays over the layer of :func:`touchdown` on the pulley's side, over the bending
    length in the span and at a clamp. The default ``n`` goes with the ``n_c`` points of an element.
    """
    half = 0.5 * Path(rig.R, rig.span, beta).length
    offset, layer, _ = touchdown(belt, rig, law, T_0)
    bend, layer = bending_length(belt.EI, T_0), min(layer, WIDEST * rig.R)
    start = min(max(rig.span + offset + INSIDE * layer, 0.5 * rig.span), 0.9 * half)
    s = np.linspace(0.0, half, SAMPLES)
    growth = GROWTH_IN_SPAN * layer / max(bend, layer)
    wanted = layer + np.where(s < start, growth * (start - s), GROWTH_ON_ARC * (s - start))
    wanted = np.where(s < start, wanted, np.minimum(wanted, LONGEST * layer))
    if rig.supports == "clamped":
        wanted = np.minimum(wanted, bend + s)
    density = 1.0 / wanted
    before = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(s))])
    wanted_count = 2 * math.ceil(before[-1] / (ELEMENT * n_c))
    count = n or min(max(wanted_count, FEWEST_ELEMENTS), MOST_ELEMENTS)
    left = np.interp(np.linspace(0.0, before[-1], count // 2 + 1), before, s)
    return np.concatenate([left, 2.0 * half - left[-2::-1]])
