"""Simplify the law for programs that cannot represent all of it, and compute the deviation.

A program may support only a linear normal law, a constant friction coefficient, or straight lines
between the nodes of a table. Each is a reduction; its deviation is sampled over the range of the
surface, evenly in its logarithmic coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError, percent
from beltid.export.law import ContactLaw
from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]

SAMPLES: Final = 121
TABLE_TOLERANCE: Final = 1.0e-3
PENETRATIONS: Final = 65
FINEST: Final = 8
"""Largest number of table intervals per cell of the surface."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """Deviation of a reduction from the law.

    Attributes
    ----------
    rms, worst : float
        Root mean square and largest magnitude of (reduction - law)/law [-].
    where : str
        Location of the worst deviation, as text.
    """

    rms: float
    worst: float
    where: str

    def __str__(self) -> str:
        return f"{percent(100 * self.rms)} rms, {percent(100 * self.worst)} at worst ({self.where})"


@dataclass(frozen=True, slots=True)
class ReferencePoint:
    """Line force and sliding speed at which one-point reductions are exact.

    Attributes
    ----------
    normal_force_N_m, slip_speed_m_s : float
        Line force [N/m] and sliding speed [m/s].
    """

    normal_force_N_m: float
    slip_speed_m_s: float

    def __str__(self) -> str:
        return f"f_N = {self.normal_force_N_m:.6g} N/m, v = {self.slip_speed_m_s:.6g} m/s"


@dataclass(frozen=True, slots=True, eq=False)
class FrictionTable:
    """Friction coefficients on a grid fine enough for linear interpolation.

    Attributes
    ----------
    normal_force_N_m : ndarray (nf,)
        Nodes of the line force [N/m].
    slip_speed_m_s : ndarray (nv,)
        Nodes of the sliding speed [m/s].
    mu : ndarray (nf, nv)
        Friction coefficients [-].
    deviation : Deviation
        Deviation of bilinear interpolation from the law.
    """

    normal_force_N_m: Array
    slip_speed_m_s: Array
    mu: Array
    deviation: Deviation

    @property
    def reductions(self) -> dict[str, Deviation]:
        """Simplifications of a file that contains this table."""
        return {"straight lines between nodes": self.deviation}

    def with_nodes(self, fewest: int) -> FrictionTable:
        """Extend each axis to at least `fewest` nodes; the new ones take the nearest mu."""
        f, v = (_extended(axis, fewest) for axis in (self.normal_force_N_m, self.slip_speed_m_s))
        missing = f.size - self.normal_force_N_m.size, v.size - self.slip_speed_m_s.size
        mu = np.pad(self.mu, ((0, missing[0]), (0, missing[1])), mode="edge")
        return FrictionTable(f, v, mu, self.deviation)


def reference_point(
    law: ContactLaw, normal_force_N_m: float | None = None, slip_speed_m_s: float | None = None
) -> ReferencePoint:
    """Return the requested point; by default the logarithmic middle of the range of mu.

    Raises
    ------
    InputError
        If a value is not positive or lies outside the range of mu.
    """
    problems: list[str] = []
    surface = law.surface
    chosen = []
    for option, unit, value, nodes in (
        ("--normal-force", "N/m", normal_force_N_m, surface.normal_force_N_m),
        ("--speed", "m/s", slip_speed_m_s, surface.slip_speed_m_s),
    ):
        # a single node 0 means that mu does not depend on this variable: any value is valid
        low, high = (0.0, math.inf) if nodes[-1] == 0.0 else (float(nodes[0]), float(nodes[-1]))
        if value is not None and not (low <= value <= high and 0.0 < value < math.inf):
            text = (
                f"{option} = {value:g}, must be in the range of mu, {low:.6g} to {high:.6g} {unit}"
            )
            problems.append(text)
        chosen.append(_middle(nodes) if value is None else value)
    if problems:
        raise InputError(problems)
    return ReferencePoint(*chosen)


def linear_stiffness(law: ContactLaw, point: ReferencePoint) -> float:
    """Return the stiffness of the line through the origin and the reference force [N/m²]."""
    force = point.normal_force_N_m
    return force / float(law.normal_law.penetration(force))


def linear_normal_deviation(law: ContactLaw, point: ReferencePoint) -> Deviation:
    """Compute the deviation of the linear normal law, in force at the same penetration.

    Samples the penetrations in the range of mu.
    """
    f = sample_points(law.surface)[0][:, 0]
    f = f[f > 0.0]  # without contact both laws are zero
    delta = law.normal_law.penetration(f)
    ratio = linear_stiffness(law, point) * delta / law.normal_law.force(delta)
    return _deviation(ratio, lambda i: f"at {f[i[0]]:.4g} N/m")


def constant_deviation(surface: FrictionSurface, point: ReferencePoint) -> Deviation:
    """Compute the deviation of a constant mu, equal to that at the reference point."""
    f, v = sample_points(surface)
    ratio = surface.mu(point.normal_force_N_m, point.slip_speed_m_s) / surface.mu(f, v)
    return _deviation(ratio, lambda i: _place(f, v, i))


def friction_table(surface: FrictionSurface) -> FrictionTable:
    """Refine a table until linear interpolation is within 0.1 % of the law, if `FINEST` allows."""
    for parts in range(1, FINEST + 1):
        f = _finer(surface.normal_force_N_m, parts)
        v = _finer(surface.slip_speed_m_s, parts)
        mu = surface.mu(f[:, None], v[None, :])
        deviation = _bilinear_deviation(surface, f, v, mu)
        if deviation.worst <= TABLE_TOLERANCE:
            break
    return FrictionTable(f, v, mu, deviation)


def press_end(law: ContactLaw) -> float | None:
    """Return the largest line force of the press [N/m]; beyond, the normal law is extrapolated."""
    pressed = law.validity.press_force_N_m
    return None if pressed is None else pressed[1]


def penetration_nodes(law: ContactLaw) -> Array:
    """Space penetrations [m] evenly from 0 to at least that of the largest line force of the law.

    One node is at the end of the press test, so that no straight line joins measured and
    extrapolated values, unless that is within half a step of zero.
    """
    largest, end = float(law.surface.normal_force_N_m[-1]), press_end(law) or 0.0
    deepest = float(law.normal_law.penetration(max(largest, end, 1.0)))
    measured = float(law.normal_law.penetration(end)) or deepest
    steps = round((PENETRATIONS - 1) * measured / deepest)
    step = measured / steps if steps else deepest / (PENETRATIONS - 1)
    return np.asarray(step * np.arange(math.ceil(deepest / step - 1e-9) + 1), dtype=float)


def is_extrapolated(law: ContactLaw, penetration_m: Array) -> NDArray[np.bool_]:
    """Return whether penetrations (n,) are deeper than those of the press test."""
    end = press_end(law)
    if end is None:
        return np.zeros(penetration_m.shape, dtype=bool)
    return np.asarray(law.normal_law.force(penetration_m) > end * (1.0 + 1e-9))


def between_nodes(law: ContactLaw, table: FrictionTable) -> str:
    """Describe the error of straight lines between the nodes of both tables."""
    width = float(penetration_nodes(law)[1])
    # a chord of the parabola k_quadratic delta² lies above it by at most k_quadratic width²/4
    above = law.normal_law.k_quadratic_N_m3 * width**2 / 4.0
    return (
        f"Straight lines between penetrations overestimate the line force by <= {above:.2g} N/m. "
        f"Straight lines of mu are off by {table.deviation}."
    )


def sample_points(surface: FrictionSurface) -> tuple[Array, Array]:
    """Sample the range of mu evenly in logarithms: forces (n, 1) and speeds (1, m)."""
    return (
        _even(surface.normal_force_N_m, SAMPLES)[:, None],
        _even(surface.slip_speed_m_s, SAMPLES)[None, :],
    )


def _middle(nodes: Array) -> float:
    if nodes.size == 1:
        return float(nodes[0]) or 1.0
    return float(_even(nodes, 3)[1])


def _even(nodes: Array, count: int) -> Array:
    """Space values evenly in ln(1 + x/reference) from the first node to the last."""
    if nodes.size == 1:
        return nodes if nodes[0] > 0.0 else np.ones(1)
    reference = nodes[nodes > 0.0][0]
    even = np.linspace(math.log1p(nodes[0] / reference), math.log1p(nodes[-1] / reference), count)
    inner = reference * np.expm1(even[1:-1])
    return np.concatenate([nodes[:1], inner, nodes[-1:]])


def _finer(nodes: Array, parts: int) -> Array:
    """Divide each interval between nodes into equal logarithmic parts."""
    if nodes.size == 1:
        return nodes
    reference = nodes[nodes > 0.0][0]
    x = np.log1p(nodes / reference)
    cuts = [reference * np.expm1(a + (b - a) * np.arange(1, parts) / parts) for a, b in pairwise(x)]
    return np.sort(np.concatenate([nodes, *cuts]))


def _extended(nodes: Array, fewest: int) -> Array:
    """Append nodes until there are `fewest`, each twice the one before."""
    missing = np.arange(1, fewest - nodes.size + 1)
    return np.concatenate([nodes, (nodes[-1] or 1.0) * 2.0**missing])


def _bilinear_deviation(surface: FrictionSurface, f: Array, v: Array, mu: Array) -> Deviation:
    at_f, at_v = sample_points(surface)
    along_v = np.array([np.interp(at_v[0], v, row) for row in mu])
    bilinear = np.array([np.interp(at_f[:, 0], f, column) for column in along_v.T]).T
    return _deviation(bilinear / surface.mu(at_f, at_v), lambda i: _place(at_f, at_v, i))


def _deviation(ratio: Array, place: Callable[[tuple[int, ...]], str]) -> Deviation:
    relative = np.abs(ratio - 1.0)
    index = tuple(int(i) for i in np.unravel_index(int(np.argmax(relative)), relative.shape))
    return Deviation(float(np.sqrt(np.mean(relative**2))), float(relative.max()), place(index))


def _place(f: Array, v: Array, index: tuple[int, ...]) -> str:
    return f"at {f[index[0], 0]:.4g} N/m, {v[0, index[1]]:.4g} m/s"
