"""Simplify the law for programs that cannot represent all of it, and compute the deviation.

A program may support only a linear normal law, a constant friction coefficient, or straight lines
between the nodes of a table. The deviation of each is sampled over the range of the surface, evenly
in its logarithmic coordinates ln(1 + x/x_ref).
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError, percent
from beltid.export.law import ContactLaw
from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]
TABLE: Final = "straight lines between nodes"
LINEAR: Final = "linear normal law"
CONSTANT: Final = "constant mu"
SAMPLES: Final = 121
TABLE_TOLERANCE: Final = 1.0e-3
FINEST: Final = 8  # largest number of table intervals per cell of the surface
FEWEST: Final = 4  # smallest number of nodes on an axis of a table: a spline of Adams needs them
PENETRATIONS: Final = 65


class Deviation(NamedTuple):
    """Root mean square and largest magnitude of (reduction - law)/law [-], and its place."""

    rms: float
    worst: float
    where: str

    def __str__(self) -> str:
        return f"{percent(100 * self.rms)} rms, {percent(100 * self.worst)} at worst ({self.where})"


class ReferencePoint(NamedTuple):
    """Line force [N/m] and sliding speed [m/s] at which one-point reductions are exact."""

    normal_force_N_m: float
    slip_speed_m_s: float


def reference_point(
    law: ContactLaw, normal_force_N_m: float | None = None, slip_speed_m_s: float | None = None
) -> ReferencePoint:
    """Return the requested point; by default the logarithmic middle of the range of mu.

    Raises
    ------
    InputError
        If a value is not positive or lies outside the range of mu.
    """
    problems, chosen = [], []
    for option, unit, value, nodes in (
        ("--normal-force", "N/m", normal_force_N_m, law.surface.normal_force_N_m),
        ("--speed", "m/s", slip_speed_m_s, law.surface.slip_speed_m_s),
    ):
        # a single node 0 means that mu does not depend on this variable: any value is valid
        low, high = (0.0, math.inf) if nodes[-1] == 0.0 else (float(nodes[0]), float(nodes[-1]))
        if value is not None and not (low <= value <= high and 0.0 < value < math.inf):
            problems.append(
                f"{option} = {value:g}, must be in the range of mu, {low:.6g} to {high:.6g} {unit}"
            )
        even = _even(nodes, 3)
        chosen.append(float(even[even.size // 2]) if value is None else value)
    if problems:
        raise InputError(problems)
    return ReferencePoint(*chosen)


def deviations(law: ContactLaw, point: ReferencePoint) -> dict[str, Deviation]:
    """Compute the deviations of a linear normal law (in force) and of a constant mu.

    Both are exact at the point: the one is the line through the origin and its force.
    """
    f, v = _samples(law.surface)
    pressed = f[f[:, 0] > 0.0]  # without contact both laws are zero
    delta = law.normal_law.penetration(pressed)
    stiffness = point.normal_force_N_m / law.normal_law.penetration(point.normal_force_N_m)
    linear = stiffness * delta / law.normal_law.force(delta)
    constant = law.surface.mu(*point) / law.surface.mu(f, v)
    return {LINEAR: _deviation(linear, pressed), CONSTANT: _deviation(constant, f, v)}


def friction_table(surface: FrictionSurface) -> tuple[Array, Array, Array, Deviation]:
    """Refine a table until straight lines are within 0.1 % of the law, if `FINEST` allows.

    Each axis has at least `FEWEST` nodes; those appended take the nearest mu, as the law does.
    Returns the nodes of force (nf,) [N/m] and speed (nv,) [m/s], mu (nf, nv), and its deviation.
    """
    at_f, at_v = _samples(surface)
    for parts in range(1, FINEST + 1):
        f, v = (_finer(n, parts) for n in (surface.normal_force_N_m, surface.slip_speed_m_s))
        mu = surface.mu(f[:, None], v[None, :])
        along_v = np.array([np.interp(at_v[0], v, row) for row in mu])
        lines = np.array([np.interp(at_f[:, 0], f, column) for column in along_v.T]).T
        deviation = _deviation(lines / surface.mu(at_f, at_v), at_f, at_v)
        if deviation.worst <= TABLE_TOLERANCE:
            break
    return f, v, mu, deviation


def press_end(law: ContactLaw) -> float:
    """Return the largest line force of the press [N/m]; beyond, the normal law is extrapolated."""
    pressed = law.validity.press_force_N_m
    return math.inf if pressed is None else pressed[1]


def penetration_nodes(law: ContactLaw) -> Array:
    """Space penetrations [m] evenly from 0 to at least that of the largest line force of the law.

    One node is at the end of the press test, so that no straight line joins measured and
    extrapolated values, unless that is within half a step of zero.
    """
    end = press_end(law) if math.isfinite(press_end(law)) else 0.0
    deepest = float(law.normal_law.penetration(max(law.surface.normal_force_N_m[-1], end, 1.0)))
    measured = float(law.normal_law.penetration(end)) or deepest
    steps = round((PENETRATIONS - 1) * measured / deepest)
    step = measured / steps if steps else deepest / (PENETRATIONS - 1)
    return np.asarray(step * np.arange(math.ceil(deepest / step - 1e-9) + 1), dtype=float)


def _samples(surface: FrictionSurface) -> tuple[Array, Array]:
    """Sample the range of mu: forces (n, 1) and speeds (1, m)."""
    f, v = surface.normal_force_N_m, surface.slip_speed_m_s
    return _even(f, SAMPLES)[:, None], _even(v, SAMPLES)[None, :]


def _even(nodes: Array, count: int) -> Array:
    """Space values evenly in the logarithmic coordinate from the first node to the last."""
    if nodes.size == 1:
        return nodes if nodes[0] > 0.0 else np.ones(1)
    reference = nodes[nodes > 0.0][0]
    first, *_, last = np.log1p(nodes / reference)
    return np.clip(reference * np.expm1(np.linspace(first, last, count)), nodes[0], nodes[-1])


def _finer(nodes: Array, parts: int) -> Array:
    """Divide each interval between nodes into equal logarithmic parts; append up to `FEWEST`."""
    reference = nodes[nodes > 0.0][0] if nodes[-1] > 0.0 else 1.0
    x = np.log1p(nodes / reference)
    cuts = [reference * np.expm1(a + (b - a) * np.arange(1, parts) / parts) for a, b in pairwise(x)]
    finer = np.sort(np.concatenate([nodes, *cuts]))
    appended = np.arange(1, FEWEST - finer.size + 1)
    return np.concatenate([finer, (nodes[-1] or 1.0) * 2.0**appended])


def _deviation(ratio: Array, *axes: Array) -> Deviation:
    """Describe ratios of a reduction to the law at forces (n, 1) and, if given, speeds (1, m)."""
    relative = np.abs(ratio - 1.0)
    i, j = np.unravel_index(int(np.argmax(relative)), relative.shape)
    f, v = axes[0][i, 0], axes[-1][0, j]
    where = f"at {f:.4g} N/m" + (f", {v:.4g} m/s" if len(axes) > 1 else "")
    return Deviation(float(np.sqrt(np.mean(relative**2))), float(relative.max()), where)
