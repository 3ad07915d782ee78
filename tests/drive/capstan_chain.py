"""A closed belt drive at string level by its differential equations, own code throughout.

Along a pulley the tension N, the polar angle and the stress-free length follow from the belt's own
balance, integrated along the arc with ``scipy.integrate.solve_ivp``. The sliding arc is found from
the exit backwards, what is left of the wrap sticks. Spans are common tangents of circles found by
rotation of the centre line; the loop is closed with ``scipy.optimize.root``. No effective force, no
quadrature in ln P, no lever of an energy appears.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root


@dataclass(frozen=True)
class Wheel:
    """Centre [m], radius of the centreline [m], whether it turns the belt to the left, torque that
    it takes off [N m], whether the ribs touch it."""

    x: float
    y: float
    R: float
    left: bool
    torque: float = 0.0
    ribs: bool = True


@dataclass(frozen=True)
class Chain:
    """A drive on fixed centres; the first wheel drives. ``mu(f, v)`` is the friction of the ribs,
    which carry ``k1 d + k2 d²``; the back is rigid with a coefficient ``back``."""

    wheels: tuple[Wheel, ...]
    EA: float
    mass: float
    k1: float
    k2: float
    mu: Callable[[float, float], float]
    back: float

    def spans(self) -> tuple[np.ndarray, np.ndarray]:
        """Lengths of the spans [m], and wraps [rad]; span i leaves wheel i."""
        n, lengths, headings = len(self.wheels), [], []
        for i, one in enumerate(self.wheels):
            two = self.wheels[(i + 1) % n]
            away = complex(two.x - one.x, two.y - one.y)
            # a wheel to the left of the belt stands at +R beside it
            offset = (two.R if two.left else -two.R) - (one.R if one.left else -one.R)
            lengths.append(math.sqrt(abs(away) ** 2 - offset**2))
            headings.append(math.atan2(away.imag, away.real) - math.asin(offset / abs(away)))
        wraps = []
        for i, one in enumerate(self.wheels):
            turn = (headings[i] - headings[i - 1]) * (1.0 if one.left else -1.0)
            wraps.append(turn % (2.0 * math.pi))
        return np.array(lengths), np.array(wraps)

    def depth(self, wheel: Wheel, pull: float, stretch: float) -> float:
        """Penetration that carries a belt of the curvature of its own circle [m]."""
        if not wheel.ribs:
            return 0.0
        return float(
            brentq(
                lambda d: (self.k1 * d + self.k2 * d * d) * (wheel.R - d) - pull * stretch,
                0.0,
                0.2 * wheel.R,
                xtol=1e-15,
            )
        )

    def rate(self, wheel: Wheel, N: float, v0: float) -> tuple[float, float, float]:
        """Angle per stress-free length [1/m], line force [N/m], radius [m] under a tension."""
        stretch = 1.0 + N / self.EA
        pull = N - self.mass * v0**2 * stretch
        radius = wheel.R - self.depth(wheel, pull, stretch)
        return stretch / radius, pull * stretch / radius, radius

    def arc(
        self, wheel: Wheel, N_in: float, N_out: float, v0: float, wrap: float
    ) -> tuple[float, float, float]:
        """Torque on the belt [N m], speed over v0 [1/m], stress-free length on the arc [m]."""
        entry = self.rate(wheel, N_in, v0)[0]
        sense = 1.0 if N_out > N_in else -1.0
        work = 0.0
        if abs(N_out - N_in) < 1e-9:
            return 0.0, entry, wrap / entry

        def slope(N: float, y: np.ndarray) -> list[float]:
            turn, f, radius = self.rate(wheel, N, v0)
            v = wheel.R * v0 * abs(entry - turn)
            mu = self.mu(f, v) if wheel.ribs else self.back
            # N' - m v0² (1 + N/EA)' = ± mu f along S; the force acts at the radius of the belt
            per_S = mu * f / (1.0 - self.mass * v0**2 / self.EA)
            return [turn / per_S, 1.0 / per_S, mu * f * radius / per_S]

        found = solve_ivp(
            lambda s, y: [x * abs(N_out - N_in) for x in slope(N_in + s * (N_out - N_in), y)],
            (0.0, 1.0),
            [0.0, 0.0, 0.0],
            rtol=1e-8,
            atol=1e-12,
        )
        angle, length, work = found.y[:, -1]
        if angle > wrap:
            raise ValueError(f"slides on {math.degrees(angle):.4g} deg, wraps less")
        return -sense * work, entry, length + (wrap - angle) / entry

    def solve(self, T_0: float, omega: float) -> tuple[np.ndarray, np.ndarray]:
        """Tensions behind each wheel [N] and speeds of all wheels [rad/s]."""
        lengths, wraps = self.spans()
        rest = 1.0 + T_0 / self.EA
        turns = [self.rate(w, T_0, 0.0)[0] for w in self.wheels]
        belt = lengths.sum() / rest + (wraps / turns).sum()
        n = len(self.wheels)

        def state(u: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
            N, v0 = u[:n] * T_0, u[n] * omega * self.wheels[0].R
            arcs = [self.arc(w, N[i - 1], N[i], v0, wraps[i]) for i, w in enumerate(self.wheels)]
            torque, speed, length = np.array(arcs).T
            return N, speed * v0, (lengths / (1.0 + N / self.EA)).sum() + length.sum(), torque

        def missing(u: np.ndarray) -> np.ndarray:
            _, speeds, length, torque = state(u)
            asked = [(torque[i] + w.torque) / (T_0 * w.R) for i, w in enumerate(self.wheels) if i]
            return np.array(
                [*asked, speeds[0] / omega - 1.0, (length / belt - 1.0) * self.EA / T_0]
            )

        steps = np.array([w.torque / w.R / T_0 for w in self.wheels])
        steps[0] = -steps.sum()
        # the tension falls over the driver and rises over a wheel that takes torque off
        N = np.cumsum(steps)
        start = np.append(N - N.mean() + 1.0, 1.0)
        start[:n] = np.maximum(start[:n], 0.2)
        found = root(missing, start, tol=1e-10)
        if not found.success or np.abs(missing(found.x)).max() > 1e-7:
            raise ValueError(found.message)
        N, speeds, _, _ = state(found.x)
        return N, speeds
