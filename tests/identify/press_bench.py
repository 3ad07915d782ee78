"""A synthetic press bench with a known law, for tests only."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from beltid.identify.press.stiffness import LawEstimate

HYSTERESIS: dict[str, Callable[[np.ndarray, np.ndarray, float], np.ndarray]] = {
    # half the distance of the branches [N] over share s of the deepest penetration, law f, top F
    "none": lambda s, f, top: 0.0 * s,
    "parabola": lambda s, f, top: 0.06 * top * 4.0 * s * (1.0 - s),
    "relative": lambda s, f, top: 0.12 * f,
    "root": lambda s, f, top: 0.12 * np.sqrt(f * top),
}


@dataclass(frozen=True)
class Bench:
    """Settings of the synthetic bench; SI, per metre of belt for the law."""

    k_linear: float = 6.5e7
    k_quadratic: float = 3.0256e11
    powers: tuple[tuple[float, float], ...] = ()  # (k, n) of another law, in place of the quadratic
    length: float = 0.04
    top_force: float = 1.0e4
    speed: float = 1.7e-6
    unloading_speed: float = 1.7e-6
    dt: float = 0.1
    toe: float = 2.0e-5
    hysteresis: str = "parabola"
    travel_noise: float = 2.0e-8
    force_noise: float = 0.15
    zero: float = 0.0
    cycles: int = 1
    turn_way: float = 0.0  # over which friction turns round after a turn, share of the top
    virgin: float = 0.0
    dwell: float = 0.0
    valley: float = 0.0
    temperature_slope: float = 0.0
    temperatures: Sequence[float] = field(default=(22.0, 40.0, 60.0, 80.0))
    tests_per_temperature: int = 1

    def force(self, delta: np.ndarray) -> np.ndarray:
        """The true law [N/m]."""
        d = np.maximum(delta, 0.0)
        if self.powers:
            return sum(k * d**n for k, n in self.powers)
        return self.k_linear * d + self.k_quadratic * d * d

    @property
    def top(self) -> float:
        """Penetration under the largest force [m], from a bisection."""
        low, high = 0.0, 2.0e-4
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.force(middle) < self.top_force else (low, middle)
        return low

    def record(self, seed: int = 0) -> dict[str, np.ndarray]:
        """Columns of a press recording."""
        rng = np.random.default_rng(seed)
        tests = [
            self._test(rng, f"S{t:g}-{k}", t)
            for t in self.temperatures
            for k in range(self.tests_per_temperature)
        ]
        return joined(*tests)

    def _test(self, rng: np.random.Generator, label: str, temperature: float) -> dict:
        top, contact = self.top, self.toe * (1.0 + 0.4 * rng.uniform(-1, 1))
        low = self.valley * top
        path, side, stiffer = [], [], []
        for cycle in range(self.cycles):
            last = cycle == self.cycles - 1
            end = -0.3 * contact if last and not self.valley else low
            up = np.arange(low if cycle else -contact, top, self.speed * self.dt)
            down = np.arange(top, end, -self.unloading_speed * self.dt)
            hold = np.linspace(1.0, -1.0, int(self.dwell / self.dt))
            path += [up, np.full(hold.size, top), down]
            side += [np.ones(up.size), hold, -np.ones(down.size)]
            n = up.size + hold.size + down.size
            stiffer += [np.full(n, 0.0 if cycle else self.virgin)]
        delta, branch = np.concatenate(path), np.concatenate(side)
        if self.turn_way:  # a slider: +1 or -1 once it has gone half of that way
            sliding, steps = -1.0, np.diff(delta, prepend=delta[0]) / (0.5 * self.turn_way * top)
            for i, step in enumerate(steps):
                branch[i] = sliding = min(max(sliding + step, -1.0), 1.0)
        law, share = self.force(delta) * self.length, np.clip(delta / top, 0.0, 1.0)
        gap = HYSTERESIS[self.hysteresis](share, law, self.force(top) * self.length)
        factor = 1.0 + np.concatenate(stiffer) + self.temperature_slope * (temperature - 22.0)
        force = factor * np.maximum(law + branch * gap, 0.0)
        travel = delta + contact
        n = delta.size
        return {
            "test": np.full(n, label, dtype=object),
            "temperature_degC": temperature + 0.3 * rng.normal(size=n),
            "time_s": self.dt * np.arange(n),
            "displacement_mm": 1e3 * (travel + self.travel_noise * rng.normal(size=n)),
            "force_N": force + self.zero + self.force_noise * rng.normal(size=n),
        }


def joined(*records: dict[str, np.ndarray], labels: str = "") -> dict[str, np.ndarray]:
    """One recording of several; each is one test with its own label, if labels are given."""
    for record, label in zip(records, labels, strict=False):
        record["test"] = np.full(record["test"].size, label, dtype=object)
    return {name: np.concatenate([r[name] for r in records]) for name in records[0]}


def force_errors(law: LawEstimate, force: Callable) -> tuple[float, float]:
    """Largest relative error of the force from a tenth of it on, and that over its stated error."""
    delta = np.linspace(0.02, 1.0, 2000) * law.max_penetration_m
    found, true = law.law.force(delta), force(delta)
    columns = np.column_stack([delta, delta**2])
    variance = np.einsum("ij,jk,ik->i", columns, np.reshape(law.covariance, (2, 2)), columns)
    inside = true >= 0.1 * true.max()
    error = np.abs(found - true)[inside]
    return float(np.max(error / true[inside])), float(np.max(error / np.sqrt(variance[inside])))
