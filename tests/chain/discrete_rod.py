"""An independent model of the rig: a discrete elastic rod, static, the whole arc sliding.

Shares nothing with the simulator: nodes joined by springs of stiffness EA/l, turning angles with
the moment EI times the rotation per stress-free length, pressure and friction lumped at the nodes,
Newton's method on a banded matrix. The supports stay where they are; the stress-free length is what
makes their force T_0 with a frictionless pulley.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

Array = NDArray[np.float64]
Friction = Callable[[Array], tuple[Array, Array]]
"""Coefficient of friction and its derivative of the line force [N/m]."""

BAND = 5


def constant(mu: float) -> Friction:
    return lambda f: (np.full_like(f, mu), np.zeros_like(f))


@dataclass(frozen=True)
class DiscreteRod:
    """The rig in numbers; line force = k_1 delta + k_2 delta**2 at the penetration delta."""

    EA: float
    EI: float
    R: float
    span: float
    beta: float
    k_1: float
    k_2: float
    elements: int = 600

    @property
    def path(self) -> float:
        return 2.0 * self.span + self.R * self.beta

    def shares(self) -> Array:
        """Lengths of the elements over the whole, finer near the pulley."""
        u = np.linspace(0.0, self.path, 4001)
        beyond = np.abs(u - 0.5 * self.path) - 0.5 * self.R * self.beta
        density = 1.0 + 2.0 / (1.0 + np.exp((beyond - 0.012) / 0.004))
        count = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1])))
        ends = np.interp(np.linspace(0.0, count[-1], self.elements + 1), count, u)
        return np.diff(ends) / self.path

    def laid(self) -> Array:
        """Nodes on the tangents and the arc, shape (n, 2); the pulley's centre is the origin."""
        half = 0.5 * self.beta
        u = np.append(0.0, np.cumsum(self.shares())) * self.path
        phi = np.clip((u - self.span) / self.R - half, -half, half)
        r = self.R * np.column_stack([np.sin(phi), np.cos(phi)])
        before = np.minimum(u - self.span, 0.0)
        behind = np.maximum(u - self.span - self.R * self.beta, 0.0)
        r[:, 0] += (before + behind) * np.cos(half)
        r[:, 1] += (before - behind) * np.sin(half)
        return r

    def forces(self, r: Array, length: float, mu: Friction) -> tuple[Array, Array]:
        """Residual force at the nodes, shape (n, 2), and its banded derivative."""
        l = self.shares() * length
        n = l.size
        band = np.zeros((2 * BAND + 1, 2 * n + 2))
        force = np.zeros((n + 1, 2))
        e = np.diff(r, axis=0)
        q = np.hypot(e[:, 0], e[:, 1])
        t = e / q[:, None]
        N = self.EA * (q / l - 1.0)
        by_e = np.column_stack([-e[:, 1], e[:, 0]]) / (q**2)[:, None]
        joint = 0.5 * (l[1:] + l[:-1])
        M = self.EI * np.diff(np.unwrap(np.arctan2(e[:, 1], e[:, 0]))) / joint
        on_angle = np.append(0.0, M) - np.append(M, 0.0)
        pull = N[:, None] * t + on_angle[:, None] * by_e
        force[:-1] -= pull
        force[1:] += pull
        tt = t[:, :, None] * t[:, None, :]
        axial = (self.EA / l)[:, None, None] * tt + (N / q)[:, None, None] * (np.eye(2) - tt)
        xx = 2.0 * e[:, 0] * e[:, 1] / q**4
        xy = (e[:, 1] ** 2 - e[:, 0] ** 2) / q**4
        turn = np.stack([np.stack([xx, xy], -1), np.stack([xy, -xx], -1)], -2)
        stiff = axial + on_angle[:, None, None] * turn
        for p, q_ in ((0, 0), (0, 1), (1, 0), (1, 1)):
            _add(band, np.arange(n) + p, np.arange(n) + q_, stiff * (1.0 if p == q_ else -1.0))
        legs = (by_e[:-1], -by_e[1:] - by_e[:-1], by_e[1:])
        for p, a in enumerate(legs):
            for q_, b in enumerate(legs):
                block = (self.EI / joint)[:, None, None] * a[:, :, None] * b[:, None, :]
                _add(band, np.arange(n - 1) + p, np.arange(n - 1) + q_, block)
        self._contact(r, l, mu, force, band)
        return force, band

    def _contact(self, r: Array, l: Array, mu: Friction, force: Array, band: Array) -> None:
        share = 0.5 * (np.append(l, 0.0) + np.append(0.0, l))
        share[[0, -1]] = 0.0
        rho = np.hypot(r[:, 0], r[:, 1])
        out = r / rho[:, None]
        drag = np.column_stack([out[:, 1], -out[:, 0]])
        delta = np.maximum(self.R - rho, 0.0)
        f = self.k_1 * delta + self.k_2 * delta**2
        df = np.where(delta > 0.0, self.k_1 + 2.0 * self.k_2 * delta, 0.0)
        m, dm = mu(f)
        force -= (f * share)[:, None] * (out + m[:, None] * drag)
        nn, nt = out[:, :, None] * out[:, None, :], out[:, :, None] * drag[:, None, :]
        tn, tt = drag[:, :, None] * out[:, None, :], drag[:, :, None] * drag[:, None, :]
        block = np.zeros_like(nn)
        terms = ((-df, nn), (f / rho, tt), (-(m + dm * f) * df, tn), (-m * f / rho, nt))
        for factor, matrix in terms:
            block += (factor * share)[:, None, None] * matrix
        _add(band, np.arange(rho.size), np.arange(rho.size), -block)

    def solve(self, r: Array, length: float, mu: Friction) -> tuple[Array, float, float]:
        """Nodes in equilibrium and the forces on both supports [N]."""
        r = r.copy()
        last = 2 * self.elements + 1
        for _ in range(60):
            force, band = self.forces(r, length, mu)
            free = force.copy()
            free[[0, -1]] = 0.0
            if np.max(np.abs(free)) < 1e-7:
                return r, float(np.hypot(*force[0])), float(np.hypot(*force[-1]))
            for row in (0, 1, last - 1, last):
                columns = np.arange(max(0, row - BAND), min(last, row + BAND) + 1)
                band[BAND + row - columns, columns] = 0.0
                band[BAND, row] = 1.0
            change = solve_banded((BAND, BAND), band, -free.ravel()).reshape(-1, 2)
            r += change * min(1.0, 3e-3 / np.max(np.abs(change)))
        raise AssertionError("the reference found no equilibrium")

    def lay_on(self, T_0: float) -> tuple[Array, float]:
        """Nodes and stress-free length with the supports' force T_0 and no friction."""
        r = self.laid()
        old = self.path / (1.0 + T_0 / self.EA)
        r, T_old, _ = self.solve(r, old, constant(0.0))
        new = old * (1.0 + (T_old - T_0) / self.EA)
        for _ in range(20):
            r, T, _ = self.solve(r, new, constant(0.0))
            if abs(T - T_0) < 1e-7 * T_0:
                return r, new
            old, new, T_old = new, new - (T - T_0) * (new - old) / (T - T_old), T
        raise AssertionError("the reference found no stress-free length")

    def tensions(self, laid: tuple[Array, float], mu: Friction) -> tuple[float, float]:
        """Tight and slack tension [N] with the whole arc sliding."""
        r, length = laid
        tight = slack = 0.0
        for part in (0.3, 0.6, 0.8, 1.0):

            def weaker(f: Array, part: float = part) -> tuple[Array, Array]:
                m, dm = mu(f)
                return part * m, part * dm

            r, tight, slack = self.solve(r, length, weaker)
        return tight, slack


def _add(band: Array, rows: NDArray[np.intp], columns: NDArray[np.intp], blocks: Array) -> None:
    """Add 2 x 2 blocks at pairs of nodes."""
    for a in range(2):
        for b in range(2):
            i, j = 2 * rows + a, 2 * columns + b
            np.add.at(band, (BAND + i - j, j), blocks[:, a, b])
