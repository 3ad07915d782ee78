"""Synthetic recordings of a friction rig with a known answer. Not measured data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


SHAPES: dict[str, Callable[[Array], Array]] = {
    "exponential": lambda x: np.exp(-x),
    "two exponentials": lambda x: 0.6 * np.exp(-x) + 0.4 * np.exp(-x / 3.0),
    "stretched": lambda x: np.exp(-(x**0.6)),
    "power law": lambda x: (1.0 + x) ** -2,
}
"""Decay of the sticking peak over time in units of the recipe's `tail`."""


@dataclass(frozen=True)
class Recipe:
    """What a synthetic run is made of; times in s, tensions in N."""

    rate: float = 50.0
    duration: float = 6.0
    rest: float = 1.0
    initial: float = 270.0
    arc_deg: float = 82.0
    mu: float = 0.8
    peak: float = 0.05
    tail: float = 0.6
    shape: str = "exponential"
    build_up: float = 0.2
    omega: float = 0.21
    run_up: float = 0.0
    noise: float = 0.5
    memory: float = 0.0
    ripple: float = 0.004
    ripple_period: float = 0.748
    drift: float = 0.0
    offset: float = 0.0
    seed: int = 0

    def but(self, **changes: Any) -> Recipe:
        return replace(self, **changes)


def record(recipe: Recipe) -> dict[str, Array]:
    """Columns of one synthetic run, keyed like the arguments of reduce_run."""
    r = recipe
    rng = np.random.default_rng(r.seed)
    n = round(r.duration * r.rate)
    t = np.arange(n) / r.rate
    turned = np.clip(t - r.rest, 0.0, None)
    after = np.clip(turned - r.build_up, 0.0, None)
    mu = r.mu * (1.0 + r.peak * SHAPES[r.shape](after / r.tail))
    mu *= 1.0 + r.drift * after / (r.duration - r.rest - r.build_up)
    ratio = np.exp(mu * np.radians(r.arc_deg))
    slack = 2.0 * r.initial / (1.0 + ratio)
    rise = np.clip(turned / r.build_up, 0.0, 1.0)
    wave = np.sin(2.0 * np.pi * turned / r.ripple_period + rng.uniform(0.0, 6.0)) * (turned > 0.0)
    tight = (r.initial + (slack * ratio - r.initial) * rise) * (1.0 + r.ripple * wave)
    slack = (r.initial + (slack - r.initial) * rise) * (1.0 + 0.75 * r.ripple * wave)
    speed = r.omega * (np.clip(turned / r.run_up, 0, 1) if r.run_up else (t >= r.rest))
    quiet = r.noise == 0.0
    speed = speed if quiet else speed * (1 + 4e-3 * rng.normal(size=n)) + 5e-5 * rng.normal(size=n)
    return {
        "time_s": t,
        "tension_tight_N": tight + _noise(rng, n, r) + 0.5 * r.offset,
        "tension_slack_N": slack + _noise(rng, n, r) - 0.5 * r.offset,
        "pulley_speed_rad_s": speed,
    }


def bench(recipe: Recipe, n_runs: int) -> dict[str, Array]:
    """Columns of rig.csv of runs that differ in noise and phase of the ripple only."""
    runs = [record(recipe.but(seed=recipe.seed + k)) for k in range(n_runs)]
    size = runs[0]["time_s"].size
    columns = {name: np.concatenate([run[name] for run in runs]) for name in runs[0]}
    label, arc = np.repeat(np.arange(float(n_runs)), size), np.full(n_runs * size, recipe.arc_deg)
    return {**columns, "run": label, "arc_deg": arc}


def _noise(rng: np.random.Generator, n: int, recipe: Recipe) -> Array:
    white = rng.normal(size=n)
    if recipe.memory:
        out = np.empty(n)
        out[0] = white[0]
        for k in range(1, n):
            out[k] = recipe.memory * out[k - 1] + np.sqrt(1 - recipe.memory**2) * white[k]
        white = out
    return recipe.noise * white
