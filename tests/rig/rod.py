"""An independent model of the rig: the extensible elastic rod in strong form, by collocation.

Shares nothing with the simulator but the laws of contact: no elements, no contact points, no
assembly. Unknowns over the stress-free length S are the position r, the direction theta of the
belt, the moment M and the force n that the part beyond S exerts:

    r' = (1 + N/EA) t,  theta' = M/EI,  n' = -f,  M' = -(r' x n),  N = n.t

with the load f of pulley and friction per stress-free length.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp

from beltid.arrays import Array
from beltid.laws.penalty import NormalLaw


@dataclass(frozen=True)
class Rod:
    """The rig in numbers; ``mu`` maps a line force [N/m] to the coefficient of friction."""

    EA: float
    EI: float
    R: float
    span: float
    beta: float
    law: NormalLaw
    mu: Callable[[Array], Array]
    clamped: bool = False

    def path(self, u: Array) -> tuple[Array, Array]:
        """Points and directions (x, y), theta of support, arc, support; u in [0, 1]."""
        s = u * (2 * self.span + self.R * self.beta)
        turn = np.clip((s - self.span) / self.R, 0, self.beta) - self.beta / 2
        out = np.minimum(s - self.span, 0) + np.maximum(s - self.span - self.R * self.beta, 0)
        x = self.R * np.sin(turn) + out * np.cos(turn)
        y = self.R * np.cos(turn) - out * np.sin(turn)
        return np.stack([x, y]), -turn

    def load(self, x: Array, y: Array, friction: float) -> tuple[Array, Array]:
        rho = np.hypot(x, y)
        f = self.law.force(self.R - rho)
        drag = friction * self.mu(f) * f if friction else 0.0 * f
        return (f * x + drag * y) / rho, (f * y - drag * x) / rho

    def slopes(self, y: Array, length: float | Array, friction: float) -> Array:
        px, py, theta, M, nx, ny = y
        c, s = np.cos(theta), np.sin(theta)
        stretch = 1 + (nx * c + ny * s) / self.EA
        fx, fy = self.load(px, py, friction)
        rx, ry = stretch * c, stretch * s
        return length * np.stack([rx, ry, M / self.EI, -(rx * ny - ry * nx), -fx, -fy])

    def ends(self, a: Array, b: Array, M_unit: float) -> list[float]:
        """Conditions at both supports, without units."""
        (r, theta) = self.path(np.array([0.0, 1.0]))
        held = [a[0] - r[0, 0], a[1] - r[1, 0], b[0] - r[0, 1], b[1] - r[1, 1]]
        held = [miss / self.R for miss in held]
        if self.clamped:
            return [*held, a[2] - theta[0], b[2] - theta[1]]
        return [*held, a[3] / M_unit, b[3] / M_unit]

    def guess(self, u: Array, T_0: float) -> Array:
        r, theta = self.path(u)
        arc = (np.abs(theta) < 0.999 * self.beta / 2).astype(float)
        r = r * (1 - arc * float(self.law.penetration(T_0 / self.R)) / self.R)
        t = T_0 * np.stack([np.cos(theta), np.sin(theta)])
        return np.concatenate([r, theta[None], -arc[None] * self.EI / self.R, t])

    def solve(self, T_0: float, tolerance: float = 1e-5) -> tuple[float, float]:
        """Forces on supports A and B of the sliding belt, tightened to T_0 without friction [N]."""
        u = np.linspace(0, 1, 600)
        # all unknowns of order one: the collocation weighs their residuals alike
        unit = np.array([self.R, self.R, 1, 0.05 * T_0 * self.R, T_0, T_0])
        whole = (2 * self.span + self.R * self.beta) / (1 + T_0 / self.EA)

        def slopes(y: Array, length: float, friction: float) -> Array:
            by_u = self.slopes(y * unit[:, None], length, friction)
            return np.asarray(by_u / unit[:, None])

        def ends(a: Array, b: Array) -> list[float]:
            return self.ends(a * unit, b * unit, unit[3])

        laid = solve_bvp(
            lambda _, y, p: slopes(y, whole * p[0], 0.0),
            lambda a, b, p: np.array([*ends(a, b), math.hypot(a[4], a[5]) - 1]),
            u,
            self.guess(u, T_0) / unit[:, None],
            p=[1.0],
            tol=tolerance,
            max_nodes=20000,
        )
        if laid.status:
            raise AssertionError(f"the rod was not laid on: {laid.message}")
        x, y = laid.x, laid.y
        for friction in (0.5, 1.0):
            slides = solve_bvp(
                lambda _, y, k=friction: slopes(y, whole * laid.p[0], k),
                lambda a, b: np.array(ends(a, b)),
                x,
                y,
                tol=tolerance,
                max_nodes=20000,
            )
            if slides.status:
                raise AssertionError(f"the rod does not slide: {slides.message}")
            x, y = slides.x, slides.y
        return T_0 * math.hypot(y[4, 0], y[5, 0]), T_0 * math.hypot(y[4, -1], y[5, -1])
