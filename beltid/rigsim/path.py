"""The path of the belt: support, tangent point, arc, tangent point, support; and the mesh on it.

The pulley's centre is the origin. The belt runs over the top from support A (left) to support B
(right); ``theta`` is the angle from the top, positive towards B. The pulley's surface moves towards
B, so the tight span is the one at A (trap (d) of the method).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Rig

Array = NDArray[np.float64]


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

    def position(self, s: Array) -> Array:
        """Points of the path, shape (n, 2) [m]."""
        s = np.asarray(s, dtype=float)
        theta = self.angle(s)
        normal = np.stack([np.sin(theta), np.cos(theta)], axis=-1)
        beyond = np.where(s < self.entry, s - self.entry, np.maximum(s - self.exit, 0.0))
        return self.R * normal + beyond[:, None] * self.tangent(s)

    def tangent(self, s: Array) -> Array:
        """Unit tangents towards B, shape (n, 2)."""
        theta = self.angle(s)
        return np.stack([np.cos(theta), -np.sin(theta)], axis=-1)

    def angle(self, s: Array) -> Array:
        """Direction of the path: angle of the arc's normal from the top [rad], shape (n,)."""
        half = 0.5 * self.beta
        return np.clip((np.asarray(s, dtype=float) - self.span) / self.R - half, -half, half)


def bending_length(EI: float, T: float) -> float:
    """Length sqrt(EI/T) over which a tightened span straightens [m]."""
    return math.sqrt(EI / T)


def bed_length(EI: float, k: float) -> float:
    """Length (4 EI/k)**(1/4) over which a force peak spreads on the elastic bed [m]."""
    return (4.0 * EI / k) ** 0.25


def graded_nodes(belt: Belt, rig: Rig, law: NormalLaw, beta: float, T_0: float, n: int) -> Array:
    """Nodes of a mesh graded from the bending length and the elastic-bed length.

    The wanted element length follows the solution: it is proportional to the elastic-bed length at
    the ends of the contact, where the force peaks stand, and grows with the distance from there, in
    units of the bending length in the spans and of the bed length on the arc. Both halves are alike.

    Parameters
    ----------
    belt, rig, law : Belt, Rig, NormalLaw
        The bench.
    beta : float
        Contact arc [rad].
    T_0 : float
        Initial tension [N].
    n : int
        Number of elements, even.

    Returns
    -------
    ndarray, shape (n + 1,)
        Path coordinates of the nodes [m].
    """
    path = Path(rig.R, rig.span, beta)
    edge = path.entry
    middle = 0.5 * path.length
    bed = bed_length(belt.EI, float(law.stiffness(law.penetration(T_0 / rig.R))))
    bend = bending_length(belt.EI, T_0)
    s = np.linspace(0.0, middle, 2001)
    outside = np.maximum(edge - s, 0.0) / bend
    inside = np.maximum(s - edge, 0.0) / bed
    wanted = bed * (1.0 + SPAN_GROWTH * outside + ARC_GROWTH * np.maximum(inside - ARC_FLAT, 0.0))
    density = 1.0 / wanted
    if rig.supports == "clamped":
        density = np.maximum(density, 1.0 / (bend * (1.0 + SPAN_GROWTH * s / bend)))
    cumulative = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(s))])
    half = np.interp(np.linspace(0.0, cumulative[-1], n // 2 + 1), cumulative, s)
    return np.concatenate([half, path.length - half[-2::-1]])


SPAN_GROWTH = 1.0
ARC_GROWTH = 0.25
ARC_FLAT = 2.0
