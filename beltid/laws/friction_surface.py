"""The friction coefficient as a function of line force and sliding speed, identified on the rig.

Between the nodes, bicubic splines interpolate (:mod:`beltid.laws.bicubic`). Outside them the
nearest measured value applies; the surface never extrapolates. A drive goes on below the slowest
measured speed (:func:`continued`).

The errors of ln mu at the nodes are correlated: an error of a load cell moves the whole surface. A
surface may therefore have a factor S of the covariance ``S S'`` of ln mu at all nodes, with one
column for each shared source and more columns for the scatter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from beltid.arrays import Array, Mask
from beltid.errors import InputError
from beltid.laws.bicubic import (
    SurfaceTables,
    bounded_patches,
    coordinate,
    evaluate_cell,
    hermite_patches,
    local,
    log_nodes,
)

MIN_RELATIVE_GAP = 1e-9  # between closer nodes, rounding spoils the slope
HALF_TREND = 0.5
REST = 0.01  # ratio to the slowest speed below which the trend fades: friction at rest is finite
STEEPEST = 0.5  # slope of ln mu over ln v that counts as a trend; steeper ones are scatter
PLACES = np.array([0.0, 0.01, 0.03, 0.08, 0.2, 0.45, 1.0])  # of patches, over the slowest speed


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrictionSurface:
    """Friction coefficient mu(f_N, v) through the nodes of a rectangular grid.

    The surface reproduces its nodes exactly and never leaves the band of its node values.

    Parameters
    ----------
    normal_force_N_m : array_like (nf,)
        Nodes of the normal force per length of belt [N/m], >= 0, strictly increasing. The single
        node 0 means that mu does not depend on the force.
    slip_speed_m_s : array_like (nv,)
        Nodes of the sliding speed [m/s], likewise.
    mu : array_like (nf, nv)
        Friction coefficient at the nodes [-], > 0.
    mu_se : array_like (nf, nv), optional
        Standard errors of the node values [-], >= 0; nan where unknown.
    factor : array_like (nf, nv, r), optional
        Factor of the covariance of ln mu at the nodes. Without it, the only uncertainty is the
        standard error of each node.
    sources : sequence of str
        Names of the first columns of the factor, which are errors common to all nodes. The other
        columns are scatter.

    An InputError lists all that is wrong with the arguments.

    Examples
    --------
    >>> surface = FrictionSurface([2000.0, 6000.0], [0.01], [[1.1], [0.9]])
    >>> float(surface.mu(9000.0, -0.01)), surface.degree
    (0.9, (1, 0))
    """

    normal_force_N_m: Array
    slip_speed_m_s: Array
    mu_nodes: Array
    mu_se_nodes: Array | None
    factor: Array | None
    sources: tuple[str, ...]
    _tables: SurfaceTables = field(repr=False)

    def __init__(
        self,
        normal_force_N_m: ArrayLike,
        slip_speed_m_s: ArrayLike,
        mu: ArrayLike,
        mu_se: ArrayLike | None = None,
        factor: ArrayLike | None = None,
        sources: Sequence[str] = (),
    ) -> None:
        f = _to_array("normal_force_N_m", normal_force_N_m)
        v = _to_array("slip_speed_m_s", slip_speed_m_s)
        z = _to_array("mu", mu)
        se = None if mu_se is None else _to_array("mu_se", mu_se)
        S = None if factor is None else _to_array("factor", factor)
        problems = _axis_problems("normal_force_N_m", f) + _axis_problems("slip_speed_m_s", v)
        shape = (f.size, v.size)
        problems += _value_problems("mu", z, shape, ~(np.isfinite(z) & (z > 0.0)), "> 0 and finite")
        if se is not None:
            problems += _value_problems("mu_se", se, shape, (se < 0) | np.isinf(se), ">= 0 or nan")
        if S is not None and (S.shape[:2] != shape or S.ndim != 3 or S.shape[2] < len(sources)):
            problems.append(f"factor: shape {S.shape}, must be {(*shape, '>= sources')}")
        if problems:
            raise InputError(problems)
        (x, f_ref), (y, v_ref) = log_nodes(f), log_nodes(v)
        C = bounded_patches(x, y, z)
        # read-only: numba would compile its kernels a second time for writable arrays
        for array in (f, v, z, se, S, x, y, C):
            if array is not None:
                array.flags.writeable = False
        values = (f, v, z, se, S, tuple(sources), SurfaceTables(x, y, f_ref, v_ref, C))
        for attribute, value in zip(fields(FrictionSurface), values, strict=True):
            object.__setattr__(self, attribute.name, value)

    @classmethod
    def constant(cls, mu: float) -> Self:
        """Create a surface with the same friction coefficient `mu` [-], > 0, everywhere."""
        return cls([0.0], [0.0], np.full((1, 1), mu, dtype=float))

    def with_covariance(self, factor: ArrayLike | None, sources: Sequence[str] = ()) -> Self:
        """Return the same surface with another covariance; parameters as of the class."""
        return type(self)(*self._given, factor=factor, sources=sources)

    @property
    def degree(self) -> tuple[int, int]:
        """Degree of the interpolation along force and speed: 3 with four or more nodes."""
        return min(self.normal_force_N_m.size - 1, 3), min(self.slip_speed_m_s.size - 1, 3)

    @property
    def falls_with_speed(self) -> bool:
        """Whether mu decreases with speed anywhere on the surface."""
        return bool(np.any(np.diff(self.mu_nodes, axis=1) < 0.0))

    @property
    def validity(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest measured value of each variable; the keys include the units."""
        return {
            "normal_force_N_m": _range_of(self.normal_force_N_m),
            "slip_speed_m_s": _range_of(self.slip_speed_m_s),
            "mu": (float(self.mu_nodes.min()), float(self.mu_nodes.max())),
        }

    def mu(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Evaluate mu [-]; outside the range, at the nearest measured point.

        Forces per length [N/m] and sliding speeds [m/s] of either sign are broadcast; the result is
        nan where an input is nan.
        """
        (i, s, _), (j, t, _) = self._places(*_points(normal_force_N_m, slip_speed_m_s))
        mu, _, _ = evaluate_cell(self._tables.C, i, j, s, t)
        mu = np.clip(mu, self.mu_nodes.min(), self.mu_nodes.max())
        # the polynomial matches its node only to rounding: return the node value itself
        at_node = (s % 1.0 == 0.0) & (t % 1.0 == 0.0)
        return np.where(at_node, self.mu_nodes[i + (s == 1.0), j + (t == 1.0)], mu)[()]

    def gradient(
        self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike
    ) -> tuple[Array, Array]:
        """Differentiate :meth:`mu` with respect to force [m/N] and signed speed [s/m].

        A derivative is 0 where its variable lies outside the measured range; on the boundary it is
        the derivative from inside. mu is an even function of the speed, so its derivative is odd
        (at zero speed, the derivative from above).
        """
        f, v = _points(normal_force_N_m, slip_speed_m_s)
        (i, s, ds_df), (j, t, dt_dv) = self._places(f, v)
        _, mu_s, mu_t = evaluate_cell(self._tables.C, i, j, s, t)
        return (mu_s * ds_df)[()], (mu_t * dt_dv * np.where(v < 0.0, -1.0, 1.0))[()]

    def covers(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Mask:
        """Return whether points lie within the measured range, where no input is clamped."""
        f, v = _points(normal_force_N_m, slip_speed_m_s)
        (f_low, f_high), (v_low, v_high), _ = self.validity.values()
        speed = np.abs(v)
        return ((f >= f_low) & (f <= f_high) & (speed >= v_low) & (speed <= v_high))[()]

    def mu_se_at(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Interpolate the standard error of mu from scatter [-] bilinearly; nan where unknown."""
        se = np.full_like(self.mu_nodes, np.nan) if self.mu_se_nodes is None else self.mu_se_nodes
        return self._bilinear(se[..., None], normal_force_N_m, slip_speed_m_s)[..., 0][()]

    def mu_u(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Compute the combined standard uncertainty of mu [-]: scatter and shared errors (k = 1).

        Outside the range it is that of the nearest node, like mu itself. Without a covariance, the
        standard error is all that is known. Between nodes whose errors are independent, the errors
        of an interpolated value average out, but not those of the surface: it is at least the
        smallest relative standard error of the neighbouring nodes.
        """
        if self.factor is None:
            return self.mu_se_at(normal_force_N_m, slip_speed_m_s)
        rows = self.factor_at(normal_force_N_m, slip_speed_m_s)
        mu, relative = self.mu(normal_force_N_m, slip_speed_m_s), np.linalg.norm(rows, axis=-1)
        if self.mu_se_nodes is not None:
            of_nodes = (self.mu_se_nodes / self.mu_nodes)[..., None]
            near = self._corners(of_nodes, normal_force_N_m, slip_speed_m_s)
            least = np.fmin.reduce([np.where(weight > 0.0, se, np.nan) for weight, se in near])
            relative = np.fmax(relative, least[..., 0])
        return np.asarray(mu * relative)[()]

    def factor_at(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Interpolate the rows of the factor of ln mu bilinearly between nodes, shape (..., r).

        The covariance of two points is the product of their rows, ``cov = row_1 . row_2``. A
        surface without a factor raises an InputError.
        """
        if self.factor is None:
            raise InputError("the surface has no covariance: it was built without uncertainties")
        return self._bilinear(self.factor, normal_force_N_m, slip_speed_m_s)

    def band(
        self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike, level: float = 0.95
    ) -> tuple[Array, Array]:
        """Compute the limits of mu [-] that cover the truth with a probability `level` in (0, 1).

        Based on the combined standard uncertainty of ln mu, so that the lower limit is positive.
        """
        if not 0.0 < level < 1.0:
            raise InputError(f"level = {level!r}, must be in (0, 1)")
        mu = self.mu(normal_force_N_m, slip_speed_m_s)
        k = float(ndtri(0.5 + 0.5 * level))
        width = np.exp(k * self.mu_u(normal_force_N_m, slip_speed_m_s) / mu)
        return np.asarray(mu / width)[()], np.asarray(mu * width)[()]

    def tables(self) -> SurfaceTables:
        """Return the plain float64 arrays for compiled kernels."""
        return self._tables

    def _places(self, f: Array, v: Array) -> tuple[tuple[Any, Any, Any], tuple[Any, Any, Any]]:
        """Locate points on both axes; nan in one variable makes both local coordinates nan."""
        T, unknown = self._tables, 0.0 * (f + v)
        places = []
        for nodes, reference, value in ((T.x_nodes, T.f_ref, f), (T.y_nodes, T.v_ref, np.abs(v))):
            x, change = coordinate(reference, value)
            cell = np.searchsorted(nodes[1:-1], x, side="right")
            place, slope = local(nodes, cell, x)
            places.append((cell, place + unknown, slope * change))
        return places[0], places[1]

    def _bilinear(self, nodes: Array, f: ArrayLike, v: ArrayLike) -> Array:
        """Interpolate values at the nodes (nf, nv, r) bilinearly, shape (..., r)."""
        # ignore a nan neighbour with zero weight, but not a point that is nan
        parts = [np.where(w == 0.0, 0.0, w * corner) for w, corner in self._corners(nodes, f, v)]
        return np.asarray(sum(parts[1:], parts[0]))

    def _corners(self, nodes: Array, f: ArrayLike, v: ArrayLike) -> list[tuple[Array, Array]]:
        """Return weight (..., 1) and values (..., r) of the four neighbouring nodes."""
        (i, s, _), (j, t, _) = self._places(*_points(f, v))
        after_i, after_j = np.minimum(i + 1, len(nodes) - 1), np.minimum(j + 1, nodes.shape[1] - 1)
        return [
            ((weight_f * weight_v)[..., None], nodes[row, column])
            for row, weight_f in ((i, 1.0 - s), (after_i, s))
            for column, weight_v in ((j, 1.0 - t), (after_j, t))
        ]

    @property
    def _given(self) -> tuple[Array, Array, Array, Array | None]:
        return self.normal_force_N_m, self.slip_speed_m_s, self.mu_nodes, self.mu_se_nodes

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FrictionSurface) and all(
            a is b or (a is not None and b is not None and np.array_equal(a, b, equal_nan=True))
            for a, b in zip(self._given, other._given, strict=True)
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        sizes = f"{self.normal_force_N_m.size} x {self.slip_speed_m_s.size} nodes"
        spans = (f"{name} {low:.6g}..{high:.6g}" for name, (low, high) in self.validity.items())
        return f"FrictionSurface({sizes}, {', '.join(spans)})"

    def __reduce__(self) -> tuple[Any, ...]:
        # rebuild from the nodes: unpickled arrays would be writable
        return type(self), (*self._given, self.factor, self.sources)


def continued(surface: FrictionSurface, share: float = HALF_TREND) -> SurfaceTables:
    """Continue a surface below its slowest speed, (D14); one with one speed, or from 0, stays.

    There are two limits: mu keeps its value at the slowest speed (share 0), or continues with its
    trend there (share 1). Half of the trend is the mean if all between them is equally likely, and
    their difference over sqrt(12) the standard uncertainty.

    ``mu = mu_1 [(v/v_1 + REST)/(1 + REST)]^(share p)`` with ``p = d ln mu/d ln v`` at the slowest
    speed ``v_1``: positive, monotonic, and smooth down to rest. ``share`` is 0 to 1 [-].
    """
    tables, f, v = surface.tables(), surface.normal_force_N_m, surface.slip_speed_m_s
    if v.size == 1 or v[0] == 0.0:
        return tables
    by_f, by_v = surface.gradient(f, v[0])
    mu, mu_x = surface.mu_nodes[:, 0], by_f * (tables.f_ref + f)
    p = share * np.clip(v[0] * by_v / mu, -STEEPEST, STEEPEST)
    x, nodes = tables.x_nodes, np.stack([mu, mu_x, p])[..., None]
    if f.size == 1:  # as in bicubic.bounded_patches
        x, nodes = np.array([0.0, 1.0]), np.repeat(np.nan_to_num(nodes), 2, axis=1)
    mu, mu_x, p = nodes
    p_x = np.gradient(p, x, axis=0)
    log, log_y = np.log((PLACES + REST) / (1.0 + REST)), (PLACES + 1.0) / (PLACES + REST)
    y, z = np.log1p(PLACES), mu * np.exp(p * log)
    z_x = (mu_x / mu + p_x * log) * z
    slower = hermite_patches(x, y, z, z_x, p * log_y * z, log_y * (p_x * z + p * z_x))
    y_nodes = np.concatenate([y[:-1], tables.y_nodes])
    C = np.concatenate([slower, tables.C], axis=1)
    # read-only like those of the surface, for which the kernels are compiled
    y_nodes.flags.writeable = C.flags.writeable = False
    return tables._replace(y_nodes=y_nodes, C=C)


def _to_array(name: str, values: ArrayLike) -> Array:
    """Copy values to a float64 array, since the caller may change the original."""
    try:
        return np.array(values, dtype=float, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: must be an array of numbers ({error})") from None


def _axis_problems(name: str, nodes: Array) -> list[str]:
    if nodes.ndim != 1 or nodes.size == 0:
        return [f"{name}: shape {nodes.shape}, must be one-dimensional with at least one node"]
    wrong = ~(np.isfinite(nodes) & (nodes >= 0.0))
    problems = _value_problems(name, nodes, nodes.shape, wrong, ">= 0 and finite")
    return problems or [
        f"{name}[{k + 1}] = {nodes[k + 1]:.12g} after {nodes[k]:.12g}, must be strictly increasing"
        for k in np.flatnonzero(~(np.diff(nodes) > MIN_RELATIVE_GAP * nodes[1:]))
    ]


def _value_problems(
    name: str, values: Array, shape: tuple[int, ...], wrong: Mask, allowed: str
) -> list[str]:
    problems = [
        f"{name}[{', '.join(map(str, k))}] = {values[tuple(k)]:g}, must be {allowed}"
        for k in np.argwhere(wrong)
    ]
    if values.shape != shape:
        problems.append(f"{name}: shape {values.shape}, must be {shape} (forces, speeds)")
    return problems


def _points(normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> tuple[Array, Array]:
    """Broadcast forces and speeds to a common shape."""
    f = _to_array("normal_force_N_m", normal_force_N_m)
    v = _to_array("slip_speed_m_s", slip_speed_m_s)
    try:
        f, v = np.broadcast_arrays(f, v)
    except ValueError as error:
        raise InputError(f"normal_force_N_m and slip_speed_m_s: {error}") from None
    return f, v


def _range_of(nodes: Array) -> tuple[float, float]:
    if nodes.size == 1 and nodes[0] == 0.0:
        return 0.0, math.inf
    return float(nodes[0]), float(nodes[-1])
