"""Build the belt path (support A, span, arc, span, support B) and its mesh.

The pulley's centre is the origin. The belt runs over the top from support A (left) to support B
(right); ``theta`` is the angle from the top, positive towards B. The pulley's surface moves towards
B, so the span at A is the tight one (trap (d) of the method).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.laws.capstan import Spans
from beltid.laws.penalty import NormalLaw, elastic_stiffness, stiffness_under
from beltid.params import Belt, OperatingPoint, Rig

Array = NDArray[np.float64]

WIDEST = 0.15  # largest target angle of an element where the contact begins [rad]
INSIDE = 0.3  # distance of the finest elements inside the first contact, over the layer
# growth of the element length over the distance; in the span for layer = bending length
GROWTH_IN_SPAN = 1.3
GROWTH_ON_ARC = 0.2
LONGEST = 1.5  # element length on the arc over the layer, at most
ELEMENT = 0.6  # length of the default elements over the target length
FEWEST_ELEMENTS = 10
MOST_ELEMENTS = 1000


@dataclass(frozen=True, slots=True)
class Path:
    """Straight span, arc, straight span.

    Parameters
    ----------
    R : float
        Radius of the arc [m].
    span : float
        Length of each straight part [m].
    beta : float
        Angle of the arc [rad].
    """

    R: float
    span: float
    beta: float

    @property
    def length(self) -> float:
        """Length from support to support [m]."""
        return 2.0 * self.span + self.R * self.beta

    @property
    def entry(self) -> float:
        """Path coordinate of the first tangent point [m]."""
        return self.span

    @property
    def exit(self) -> float:
        """Path coordinate of the second tangent point [m]."""
        return self.span + self.R * self.beta

    def coordinates(self, s: Array) -> Array:
        """Return points of the path [m] and unit tangents towards B, shape (n, 4)."""
        rows: Array = path_coordinates(self.R, self.span, self.beta, np.asarray(s, dtype=float))
        return rows.reshape(-1, 4)

    def position(self, s: Array) -> Array:
        """Return points of the path, shape (n, 2) [m]."""
        return self.coordinates(s)[:, :2]

    def tangent(self, s: Array) -> Array:
        """Return unit tangents towards B, shape (n, 2)."""
        return self.coordinates(s)[:, 2:]


def path_coordinates(R: float, span: float, beta: float, nodes: Array) -> Array:
    """Return the belt coordinates (4 n,), position and tangent, on the path at nodes (n,) [m]."""
    half = 0.5 * beta
    from_top = nodes - (span + R * half)
    theta = np.minimum(np.maximum(from_top / R, -half), half)
    q = np.empty((nodes.size, 2), dtype=complex)  # x + i y
    tangent = q[:, 1] = np.exp(-1j * theta)
    q[:, 0] = tangent * (from_top - R * theta + 1j * R)
    return q.view(float).ravel()


def bending_length(EI: float, T: float) -> float:
    """Return the length sqrt(EI/T) over which a tightened span straightens [m]."""
    return math.sqrt(EI / T)


def bed_length(EI: float, k: float) -> float:
    """Return the length (4 EI/k)**(1/4) over which a force peak spreads on the bed [m]."""
    return (4.0 * EI / k) ** 0.25


def swinging_share(belt: Belt, rig: Rig, point: OperatingPoint) -> float:
    """Return the share of ln(T_tight/T_slack) lost by a freely swinging weight, first order [-].

    Bending stiffness offsets the belt from the line of the span by EI/(2 R W). A guided end pulls
    it back, which adds the angle EI/(2 R W L) to the contact arc; the force of a swinging weight
    stays in line with the belt.
    """
    return float(Spans(belt.EI, rig.span).turn(point.T_0, rig.R)) / point.beta


@dataclass(frozen=True, slots=True)
class Touchdown:
    """First contact of a tightened belt with the pulley, without friction.

    Parameters
    ----------
    offset : float
        Path coordinate of the first contact, from the tangent point towards the arc [m].
    layer : float
        Length over which the pressure grows from zero to its value on the arc [m].
    """

    offset: float
    layer: float


def touchdown(belt: Belt, rig: Rig, law: NormalLaw, T_0: float) -> Touchdown:
    """Compute the touchdown near a tangent point in closed form: tensioned beam on an elastic bed.

    The gap to the pulley obeys ``EI u_xxxx - T u_xx + k (u + delta_0) = 0`` in contact, with the
    penetration ``delta_0`` of the pressure T/R and the stiffness k there; in the span the curvature
    decays as ``exp(d/l)``. Curvature, shear and slope are continuous where u = 0.

    Parameters
    ----------
    belt, rig, law : Belt, Rig, NormalLaw
        The bench.
    T_0 : float
        Tension [N].
    """
    EI, R, T = belt.EI, rig.R, T_0
    k1, k2, f = law.k_linear_N_m2, law.k_quadratic_N_m3, T / R
    delta = 2.0 * f / (k1 + float(stiffness_under(np.asarray(f), k1, k2)))
    k = elastic_stiffness(delta, k1, k2)
    bend = bending_length(EI, T)
    # exp(-p x) and exp(-q x) on the bed: p and q may be complex, p q and p + q are real
    pq = 2.0 / bed_length(EI, k) ** 2
    p_q = math.sqrt(T / EI + 2.0 * pq)
    # where u = 0: u_xx + (p + q) u_x + p q delta_0 = 0 on the bed, and its derivative;
    # in the span kappa_x = kappa/bend, kappa = 1/R - u_xx
    curvature = 1.0 / (R * bend) + delta * pq * pq / p_q
    curvature /= p_q - pq / p_q + 1.0 / bend
    slope = -(curvature + delta * pq) / p_q
    kappa = 1.0 / R - curvature
    offset = R * (slope + kappa * bend)
    for _ in range(3):  # the span force passes through the support, at an angle to the tangent
        angle = (offset * offset / (2.0 * R) - kappa * bend * bend) / (rig.span + offset)
        offset = R * (slope + kappa * bend + angle)
    slow = T * T - 4.0 * EI * k
    layer = 2.0 / p_q if slow <= 0.0 else math.sqrt((T + math.sqrt(slow)) / (2.0 * k))
    return Touchdown(offset, layer)


def element_count(belt: Belt, rig: Rig, law: NormalLaw, beta: float, T_0: float) -> int:
    """Return the default number of elements, even: that of the target lengths over ``ELEMENT``."""
    half = 0.5 * Path(rig.R, rig.span, beta).length
    return _count(_elements_before(*wanted_lengths(belt, rig, law, half, T_0))[-1])


def _count(elements_in_half: float) -> int:
    target = 2 * math.ceil(elements_in_half / ELEMENT)
    return min(max(target, FEWEST_ELEMENTS), MOST_ELEMENTS)


def graded_nodes(
    belt: Belt, rig: Rig, law: NormalLaw, point: OperatingPoint, n: int | None = None
) -> tuple[Array, float]:
    """Build the nodes of a mesh graded towards the contact ends, see :func:`wanted_lengths`.

    Parameters
    ----------
    belt, rig, law : Belt, Rig, NormalLaw
        The bench.
    point : OperatingPoint
        Contact arc and initial tension.
    n : int, optional
        Number of elements, even; default :func:`element_count`.

    Returns
    -------
    nodes : ndarray, shape (n + 1,)
        Path coordinates of the nodes [m], symmetric about the middle.
    fineness : float
        Number of elements over the default number.
    """
    half = 0.5 * Path(rig.R, rig.span, point.beta).length
    at, lengths = wanted_lengths(belt, rig, law, half, point.T_0)
    before = _elements_before(at, lengths)
    default = _count(before[-1])
    count = n or default
    return _place(at, lengths, before, count), count / default


def wanted_lengths(
    belt: Belt, rig: Rig, law: NormalLaw, half: float, T_0: float
) -> tuple[list[float], list[float]]:
    """Return relative target lengths of the elements, linear between points of half the path.

    At the end of the contact, the fourth derivative of the deflection, which determines the error
    of cubic elements, jumps; it decays over the layer of :func:`touchdown` on the pulley's side and
    over the bending length in the span. So the elements there are as long as the layer and grow in
    both directions, on the arc up to ``LONGEST``. They are shorter on a small pulley, where their
    angle is the limit, and at a clamp, which also bends the belt.

    Parameters
    ----------
    belt, rig, law : Belt, Rig, NormalLaw
        The bench.
    half : float
        Half the length of the path [m].
    T_0 : float
        Tension [N].

    Returns
    -------
    at, lengths : list of float
        Path coordinates from the support to the middle, and target lengths there [m].
    """
    end = touchdown(belt, rig, law, T_0)
    bend = bending_length(belt.EI, T_0)
    layer = min(end.layer, WIDEST * rig.R)
    start = min(max(rig.span + end.offset + INSIDE * layer, 0.5 * rig.span), 0.9 * half)
    growth = GROWTH_IN_SPAN * layer / max(bend, layer)
    points = [(0.0, layer + growth * start)]
    if rig.supports == "clamped" and bend < points[0][1]:
        crossing = (points[0][1] - bend) / (1.0 + growth)
        points = [(0.0, bend), (min(crossing, start), min(bend + crossing, points[0][1]))]
        points[1] = (points[1][0], layer + growth * (start - points[1][0]))
    points.append((start, layer))
    full = start + (LONGEST - 1.0) * layer / GROWTH_ON_ARC
    if full < half:
        points.append((full, LONGEST * layer))
    points.append((half, min(layer + GROWTH_ON_ARC * (half - start), LONGEST * layer)))
    at, lengths = zip(*points, strict=True)
    return list(at), list(lengths)


def _elements_before(at: list[float], lengths: list[float]) -> list[float]:
    """Return the (fractional) number of elements from the support up to each point."""
    count = [0.0]
    for i in range(1, len(at)):
        ratio = lengths[i] / lengths[i - 1]
        mean = lengths[i]
        if abs(ratio - 1.0) > 1e-9:
            mean = (lengths[i] - lengths[i - 1]) / math.log(ratio)
        count.append(count[-1] + (at[i] - at[i - 1]) / mean)
    return count


def _place(at: list[float], lengths: list[float], before: list[float], n: int) -> Array:
    """Place the nodes (n + 1,) of n elements in proportion to ``lengths``, symmetrically."""
    half = [0.0]
    piece = 0
    for k in range(1, n // 2):
        count = before[-1] * k / (n // 2)
        while piece < len(at) - 2 and count > before[piece + 1]:
            piece += 1
        slope = (lengths[piece + 1] - lengths[piece]) / (at[piece + 1] - at[piece])
        advance = count - before[piece]
        if abs(slope) > 1e-9:
            advance = math.expm1(slope * advance) / slope
        half.append(at[piece] + lengths[piece] * advance)
    mirrored = [2.0 * at[-1] - node for node in reversed(half)]
    return np.array([*half, at[-1], *mirrored])
