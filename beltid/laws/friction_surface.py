"""The friction coefficient as a function of line force and sliding speed, identified on the rig.

Between the nodes, bicubic splines interpolate (:mod:`beltid.laws.bicubic`). Outside them the
nearest measured value applies; the surface never extrapolates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.laws.bicubic import patches
from beltid.laws.surface_tables import SurfaceTables, evaluate_cell, log_nodes

Array = NDArray[np.float64]

MIN_RELATIVE_GAP = 1e-9  # between closer nodes, rounding spoils the slope
_DEGREE_WORDS = ("constant", "linear", "quadratic", "cubic")


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
        Nodes of the sliding speed [m/s], >= 0, strictly increasing. The single node 0 means that
        mu does not depend on the speed.
    mu : array_like (nf, nv)
        Friction coefficient at the nodes [-], > 0.
    mu_se : array_like (nf, nv), optional
        Standard errors of the node values [-], >= 0; nan where unknown.

    Raises
    ------
    InputError
        If the arguments are invalid; the error lists all problems.

    Notes
    -----
    Interpolation along an axis is cubic with four or more nodes, quadratic with three, linear with
    two and constant with one (:attr:`degree`).

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
    limited: NDArray[np.bool_]
    _tables: SurfaceTables = field(repr=False)

    def __init__(
        self,
        normal_force_N_m: ArrayLike,
        slip_speed_m_s: ArrayLike,
        mu: ArrayLike,
        mu_se: ArrayLike | None = None,
    ) -> None:
        f = _to_array("normal_force_N_m", normal_force_N_m)
        v = _to_array("slip_speed_m_s", slip_speed_m_s)
        z = _to_array("mu", mu)
        se = None if mu_se is None else _to_array("mu_se", mu_se)
        problems = _axis_problems("normal_force_N_m", f) + _axis_problems("slip_speed_m_s", v)
        problems += _value_problems(f, v, z, se)
        if problems:
            raise InputError(problems)
        (x, f_ref), (y, v_ref) = log_nodes(f), log_nodes(v)
        C, limited = patches(x, y, z)
        tables = SurfaceTables(x, y, f_ref, v_ref, C)
        # read-only: numba would compile its kernels a second time for writable arrays
        for array in (f, v, z, se, limited, x, y, C):
            if array is not None:
                array.flags.writeable = False
        values = (f, v, z, se, limited, tables)
        for attribute, value in zip(fields(FrictionSurface), values, strict=True):
            object.__setattr__(self, attribute.name, value)

    @classmethod
    def constant(cls, mu: float) -> Self:
        """Create a surface with the same friction coefficient everywhere.

        Parameters
        ----------
        mu : float
            Friction coefficient [-], > 0.
        """
        return cls([0.0], [0.0], np.full((1, 1), mu, dtype=float))

    @property
    def degree(self) -> tuple[int, int]:
        """Degree of the interpolation along force and speed: 3 with four or more nodes."""
        return min(self.normal_force_N_m.size - 1, 3), min(self.slip_speed_m_s.size - 1, 3)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the interpolation for the user, one line each."""
        axes = (
            ("normal force", self.normal_force_N_m, self.degree[0]),
            ("sliding speed", self.slip_speed_m_s, self.degree[1]),
        )
        lines = [
            f"{nodes.size} node{'s' if nodes.size > 1 else ''} of {name}: "
            f"{_DEGREE_WORDS[degree]} along it, cubic needs 4"
            for name, nodes, degree in axes
            if degree < 3 and math.isfinite(_range_of(nodes)[1])
        ]
        count = int(self.limited.sum())
        if count:
            lines.append(
                f"slopes limited at {count} of {self.limited.size} nodes to keep the surface "
                "between the measured values"
            )
        return tuple(lines)

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
        """Evaluate the friction coefficient; outside the range, at the nearest measured point.

        Parameters
        ----------
        normal_force_N_m : array_like
            Normal force per length [N/m].
        slip_speed_m_s : array_like
            Sliding speed [m/s] of either sign, broadcast against the force.

        Returns
        -------
        ndarray
            mu [-] in the broadcast shape, nan where an input is nan.

        Raises
        ------
        InputError
            If an argument is not numeric, or the shapes cannot be broadcast.
        """
        by_f, by_v, valid = self._locate(normal_force_N_m, slip_speed_m_s)
        cell = by_f.cell, by_v.cell, by_f.local, by_v.local
        mu, _, _ = evaluate_cell(self._tables.C, *cell)
        mu = np.clip(mu, self.mu_nodes.min(), self.mu_nodes.max())
        # the polynomial matches its node only to rounding: return the node value itself
        corner = by_f.cell + (by_f.local == 1.0), by_v.cell + (by_v.local == 1.0)
        mu = np.where(by_f.on_node & by_v.on_node, self.mu_nodes[corner], mu)
        return np.where(valid, mu, np.nan)[()]

    def gradient(
        self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike
    ) -> tuple[Array, Array]:
        """Differentiate :meth:`mu` with respect to force [m/N] and signed speed [s/m].

        A derivative is 0 where its variable lies outside the measured range; on the boundary it is
        the derivative from inside. mu is an even function of the speed, so its derivative is odd
        (at zero speed, the derivative from above).
        """
        by_f, by_v, valid = self._locate(normal_force_N_m, slip_speed_m_s)
        cell = by_f.cell, by_v.cell, by_f.local, by_v.local
        _, mu_s, mu_t = evaluate_cell(self._tables.C, *cell)
        nan_mask = np.where(valid, 0.0, np.nan)
        return (mu_s * by_f.slope + nan_mask)[()], (mu_t * by_v.slope + nan_mask)[()]

    def covers(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points lie within the measured range, where no input is clamped."""
        f, v = _points(normal_force_N_m, slip_speed_m_s)
        v = np.abs(v)
        (f_low, f_high), (v_low, v_high) = (
            self.validity[k] for k in ("normal_force_N_m", "slip_speed_m_s")
        )
        return ((f >= f_low) & (f <= f_high) & (v >= v_low) & (v <= v_high))[()]

    def mu_se_at(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Interpolate the standard error of mu [-] bilinearly; nan where unknown."""
        unknown = np.full(self.mu_nodes.shape, np.nan)
        se = unknown if self.mu_se_nodes is None else self.mu_se_nodes
        return self._bilinear(se[..., None], normal_force_N_m, slip_speed_m_s)[..., 0][()]

    def tables(self) -> SurfaceTables:
        """Return the plain float64 arrays for compiled kernels."""
        return self._tables

    def _locate(
        self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike
    ) -> tuple[_Place, _Place, NDArray[np.bool_]]:
        """Find points along force and signed speed, and whether both inputs are numbers."""
        f, v = _points(normal_force_N_m, slip_speed_m_s)
        valid = ~(np.isnan(f) | np.isnan(v))
        f, v = np.where(valid, f, 0.0), np.where(valid, v, 0.0)
        T = self._tables
        by_f = _along_axis(f, self.normal_force_N_m, T.x_nodes, T.f_ref)
        by_v = _along_axis(np.abs(v), self.slip_speed_m_s, T.y_nodes, T.v_ref)
        return by_f, by_v._replace(slope=np.where(v < 0.0, -by_v.slope, by_v.slope)), valid

    def _bilinear(
        self, nodes: Array, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike
    ) -> Array:
        """Interpolate values at the nodes (nf, nv, r) bilinearly, shape (..., r)."""
        by_f, by_v, valid = self._locate(normal_force_N_m, slip_speed_m_s)
        total = np.where(valid[..., None], np.zeros(nodes.shape[2]), np.nan)
        for i, weight_f in ((by_f.cell, 1.0 - by_f.local), (by_f.cell + 1, by_f.local)):
            for j, weight_v in ((by_v.cell, 1.0 - by_v.local), (by_v.cell + 1, by_v.local)):
                weight = (weight_f * weight_v)[..., None]
                corner = nodes[np.minimum(i, len(nodes) - 1), np.minimum(j, nodes.shape[1] - 1)]
                # ignore a nan neighbour with zero weight
                total = total + np.where(weight > 0.0, weight * corner, 0.0)
        return total

    @property
    def _given(self) -> tuple[Array, Array, Array, Array | None]:
        return self.normal_force_N_m, self.slip_speed_m_s, self.mu_nodes, self.mu_se_nodes

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FrictionSurface):
            return NotImplemented
        return all(
            a is b or (a is not None and b is not None and np.array_equal(a, b, equal_nan=True))
            for a, b in zip(self._given, other._given, strict=True)
        )

    def __hash__(self) -> int:
        # + 0.0: a node -0.0 equals 0.0 and must have the same hash
        nodes = (self.normal_force_N_m, self.slip_speed_m_s, self.mu_nodes)
        return hash(tuple((a + 0.0).tobytes() for a in nodes))

    def __repr__(self) -> str:
        if self.mu_nodes.size == 1 and not math.isfinite(_range_of(self.normal_force_N_m)[1]):
            return f"FrictionSurface.constant({float(self.mu_nodes[0, 0])!r})"
        (f0, f1), (v0, v1), (m0, m1) = self.validity.values()
        return (
            f"FrictionSurface({self.normal_force_N_m.size} x {self.slip_speed_m_s.size} nodes, "
            f"normal_force_N_m {f0:.6g}..{f1:.6g}, slip_speed_m_s {v0:.6g}..{v1:.6g}, "
            f"mu {m0:.4g}..{m1:.4g}{', with mu_se' if self.mu_se_nodes is not None else ''})"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        # rebuild from the nodes: unpickled arrays would be writable
        return type(self), self._given


def _to_array(name: str, values: ArrayLike) -> Array:
    """Copy values to a float64 array, since the caller may change the original."""
    try:
        return np.array(values, dtype=float, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: must be an array of numbers ({error})") from None


def _axis_problems(name: str, nodes: Array) -> list[str]:
    """List the problems of the nodes of one axis."""
    if nodes.ndim != 1 or nodes.size == 0:
        return [f"{name}: shape {nodes.shape}, must be one-dimensional with at least one node"]
    problems = [
        f"{name}[{k}] = {nodes[k]:g}, must be >= 0 and finite"
        for k in np.flatnonzero(~(np.isfinite(nodes) & (nodes >= 0.0)))
    ]
    if not problems:
        gaps = np.diff(nodes)
        problems = [
            f"{name}[{k + 1}] = {nodes[k + 1]:.12g} after {nodes[k]:.12g}, "
            "must be strictly increasing"
            for k in np.flatnonzero(~(gaps > MIN_RELATIVE_GAP * nodes[1:]))
        ]
    return problems


def _value_problems(f: Array, v: Array, mu: Array, mu_se: Array | None) -> list[str]:
    """List the problems of the node values and their standard errors."""
    shape, problems = (f.size, v.size), []
    checked = [("mu", mu, ~(np.isfinite(mu) & (mu > 0.0)), "> 0 and finite")]
    if mu_se is not None:
        checked.append(("mu_se", mu_se, (mu_se < 0.0) | np.isinf(mu_se), ">= 0 or nan"))
    for name, values, wrong, allowed in checked:
        if values.shape != shape:
            problems.append(
                f"{name}: shape {values.shape}, must be {shape}: a row per force node, a column "
                "per speed node"
            )
        problems += [
            f"{name}[{', '.join(map(str, k))}] = {values[tuple(k)]:g}, must be {allowed}"
            for k in np.argwhere(wrong)
        ]
    return problems


def _points(normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> tuple[Array, Array]:
    """Broadcast forces and speeds to a common shape."""
    f = _to_array("normal_force_N_m", normal_force_N_m)
    v = _to_array("slip_speed_m_s", slip_speed_m_s)
    try:
        f, v = np.broadcast_arrays(f, v)
    except ValueError:
        raise InputError(
            f"normal_force_N_m and slip_speed_m_s: shapes {f.shape} and {v.shape} do not go "
            "together, must be equal or broadcast"
        ) from None
    return f, v


class _Place(NamedTuple):
    """Places of points along an axis, all in the broadcast shape."""

    cell: NDArray[np.intp]
    local: Array  # coordinate in the cell, 0 to 1
    slope: Array  # its derivative with respect to the value
    on_node: NDArray[np.bool_]  # whether the clamped value is a node


def _along_axis(value: Array, nodes: Array, coordinates: Array, reference: float) -> _Place:
    """Find values on an axis with the given nodes and their logarithmic coordinates."""
    if nodes.size == 1:
        zero = np.zeros(value.shape)
        return _Place(zero.astype(np.intp), zero, zero, np.ones(value.shape, dtype=bool))
    inside = np.clip(value, nodes[0], nodes[-1])
    cell = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, nodes.size - 2)
    width = coordinates[cell + 1] - coordinates[cell]
    local = np.clip((np.log1p(inside / reference) - coordinates[cell]) / width, 0.0, 1.0)
    lower, upper = inside == nodes[cell], inside == nodes[cell + 1]
    local = np.where(lower, 0.0, np.where(upper, 1.0, local))
    slope = np.where(inside == value, 1.0 / (width * (reference + inside)), 0.0)
    return _Place(cell, local, slope, lower | upper)


def _range_of(nodes: Array) -> tuple[float, float]:
    if nodes.size == 1 and nodes[0] == 0.0:
        return 0.0, math.inf
    return float(nodes[0]), float(nodes[-1])
