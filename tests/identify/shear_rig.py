"""A friction rig whose belt has ribs that shear, built up from nothing that the package knows.

The belt is laid on first: a beam under tension on a bed that only pushes gives the line force along
the arc. Then the pulley turns: a chain of belt elements, each held by a spring to a slider that
carries mu times its line force at most, is pulled between the supports. Synthetic data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.sparse.linalg import spsolve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ShearRig:
    """Belt and rig; `support` is the compliance of each support [m/N]."""

    k_s: float
    EA: float = 1.0e5
    EI: float = 0.02
    R: float = 0.05
    span: float = 0.10
    k_linear: float = 6.5e7
    k_quadratic: float = 3.0256e11
    mu: float = 0.8
    support: float = 0.0
    step: float = 5.0e-4

    def laid_on(self, T: float, arc_deg: float) -> tuple[Array, Array]:
        """Places along the belt from the middle of the arc, and the penetration there [m].

        With the penetration d: T (1/R + d'') - EI d'''' = k_1 d + k_2 d² where d > 0, without
        moment at the supports, in the spans without pulley.
        """
        arc = 0.5 * self.R * np.radians(arc_deg)
        half = arc + self.span
        n = round(2 * half / self.step) + 1
        s = np.linspace(-half, half, n)
        d = -np.square(np.maximum(np.abs(s) - arc, 0.0)) / (2 * self.R)
        held = d[0]
        second = sp.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(n, n)).tolil()
        second[0], second[-1] = 0.0, 0.0
        second = second.tocsr() / (s[1] - s[0]) ** 2
        bends = np.ones(n)
        bends[[0, -1]] = 0.0
        ends = sp.diags_array(1.0 - bends)
        for _ in range(100):
            deep = np.maximum(d, 0.0)
            force = self.k_linear * deep + self.k_quadratic * deep**2
            rate = np.where(d > 0.0, self.k_linear + 2 * self.k_quadratic * d, 0.0)
            curvature = bends / self.R + second @ d
            residual = bends * (T * curvature - self.EI * (second @ curvature) - force)
            residual += (1.0 - bends) * (d - held)
            tangent = T * second - self.EI * (second @ second) - sp.diags_array(rate)
            change = spsolve((sp.diags_array(bends) @ tangent + ends).tocsc(), -residual)
            d = d + change
            if np.max(np.abs(change)) < 1e-13:
                return s, d
        raise AssertionError("the belt does not lie")

    def build_up(self, T: float, arc_deg: float, travel: Array) -> Array:
        """T_tight - T_slack [N] over the travel [m] of the pulley's surface, from 0 upwards."""
        s, d = self.laid_on(T, arc_deg)
        h = s[1] - s[0]
        deep = np.maximum(d, 0.0)
        limit = self.mu * h * (self.k_linear * deep + self.k_quadratic * deep**2)
        spring = np.where(limit > 0.0, self.k_s * h, 0.0)
        bars = np.full(s.size, 2.0)
        bars[[0, -1]] = 1.0
        bars *= self.EA / h
        bars[[0, -1]] += 1.0 / max(self.support, 1e-15)
        slipped, sticks = np.zeros(s.size), limit > 0.0
        tension = np.full(s.size, T)
        found = []
        for x in travel:
            for _ in range(200):
                now = limit * tension / T
                held = np.where(sticks, spring, 0.0)
                load = held * (x - slipped) + np.where((limit > 0.0) & ~sticks, now, 0.0)
                band = np.vstack([np.full(s.size, -self.EA / h), bars + held])
                w = solveh_banded(band, load)
                bar = T + self.EA * np.diff(w) / h
                tension = np.concatenate([bar[:1], 0.5 * (bar[1:] + bar[:-1]), bar[-1:]])
                force = spring * (x - slipped - w)
                capacity = limit * tension / T
                keeps = force <= capacity * np.where(sticks, 1 + 1e-9, 1 - 1e-6)
                new = (limit > 0.0) & keeps
                settled = np.max(np.abs(capacity - now)) < 1e-6 * np.max(capacity)
                if settled and np.array_equal(new, sticks):
                    break
                sticks = new
            else:
                raise AssertionError("no equilibrium")
            slides = (limit > 0.0) & ~sticks
            slipped[slides] = (x - w)[slides] - capacity[slides] / spring[slides]
            found.append(bar[0] - bar[-1])
        return np.array(found)

    def curve(self, T: float, arc_deg: float, points: int = 90) -> tuple[Array, Array]:
        """Travel [m] and difference of the tensions [N], from rest to sliding as a whole."""
        beta = np.radians(arc_deg)
        plateau = 2 * T * np.sinh(0.5 * self.mu * beta)
        # of ribs and spans in series, the arc in contact shortened generously
        soft = self.span / self.EA + self.support + 4.0 / (self.k_s * self.R * beta)
        travel = np.linspace(0.0, plateau * soft + 2e-4, points)
        return travel, np.append(0.0, self.build_up(T, arc_deg, travel[1:]))


Setting = tuple[float, float]
"""Contact arc [deg] and initial tension [N]."""


def recording(
    rig: ShearRig,
    curves: dict[Setting, tuple[Array, Array]],
    rng: np.random.Generator,
    *,
    rate: float = 1000.0,
    omega: float = 0.05,
    noise: float = 0.5,
    rest: float = 0.15,
    sliding: float = 0.2,
) -> dict[str, NDArray]:
    """Columns of rig.csv: every setting once, with noise of the cells [N] and of the speed."""
    parts = []
    for k, ((arc, T), (travel, difference)) in enumerate(curves.items()):
        v = omega * rig.R
        # the pulley starts anywhere between two samples
        t = np.arange(0.0, rest + travel[-1] / v + sliding, 1.0 / rate)
        start = rest + rng.uniform(0.0, 1.0 / rate)
        D = np.interp(v * np.maximum(t - start, 0.0), travel, difference)
        white = rng.standard_normal((3, t.size))
        turns = np.where(t > start, omega * (1.0 + 0.004 * white[2]), 3e-5 * white[2])
        parts.append(
            {
                "run": np.full(t.size, f"R{k + 1:02d}", dtype=object),
                "time_s": t,
                "tension_tight_N": T + 0.5 * D + noise * white[0],
                "tension_slack_N": T - 0.5 * D + noise * white[1],
                "pulley_speed_rad_s": turns,
                "arc_deg": np.full(t.size, arc),
                "initial_tension_N": np.full(t.size, T),
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def settings(arcs: Sequence[float], tensions: Sequence[float]) -> list[Setting]:
    return [(arc, T) for arc in arcs for T in tensions]
