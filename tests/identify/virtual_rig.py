"""Virtual friction rigs with a known answer, to judge the reduction by. Not measured data.

A `Recipe` says what a run is made of, a `Belt` turns it into a campaign over arcs, tensions and
speeds, a `Case` adds what is wrong with the bench. `draw` makes recordings and their truth;
nothing here knows how the reduction works.

**Truth.** `mu_sliding` of a run is the friction coefficient of Eq. (6) that is left when the
sticking peak has decayed. Where friction itself drifts within a run, it is the mean over the
second half of the (first) sliding phase, from the end of the build-up until the pulley stops.
A run that sticks and slips has no sliding value: its truth is nan.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from beltid.arrays import Array, Mask
from beltid.identify.friction.reduction import reduce_records
from beltid.identify.friction.run import TWO_CELLS, run_records

RADIUS_M = 0.05
REFERENCE_SPEED = 0.21  # pulley speed [rad/s] at which the belt's own times are stated

SHAPES: dict[str, Callable[[Array], Array]] = {
    "exponential": lambda x: np.exp(-x),
    "two exponentials": lambda x: 0.6 * np.exp(-x) + 0.4 * np.exp(-x / 3.0),
    "stretched": lambda x: np.exp(-(x**0.6)),
    "power law": lambda x: (1.0 + x) ** -2,
    "twenty times": lambda x: 0.7 * np.exp(-x) + 0.3 * np.exp(-x / 20.0),
}
"""Decay of the sticking peak over the time since the build-up in units of the recipe's `tail`."""


def reduce_runs(columns, R, kind=TWO_CELLS):
    """Reduce a recording with all its runs together."""
    return reduce_records(run_records(columns, R, kind), R)


@dataclass(frozen=True)
class Noise:
    """Slow noise of the zeros of the load cells, on top of the white noise."""

    kind: Literal["ar", "walk", "1/f"]
    sd: float  # [N]: stationary ("ar"), after `time` ("walk"), from once per record ("1/f")
    time: float = 1.0  # correlation time ("ar") or time after which a walk has reached `sd` [s]
    opposite: bool = False  # whether it is the same in both cells with opposite sign


@dataclass(frozen=True)
class Recipe:
    """What a run is made of: times in s, tensions in N.

    `build_up`, `tail` and `ripple_period` are times at `REFERENCE_SPEED`. They go with the
    pulley's travel; with ``clock="time"`` the first two last equally long at every speed.
    """

    rate: float = 50.0
    duration: float = 6.0  # until the end of the (first) sliding
    rest: float = 1.0
    initial: float = 270.0
    arc_deg: float = 82.0
    mu: float = 0.8
    peak: float = 0.05
    tail: float = 0.6
    shape: str = "exponential"
    clock: Literal["travel", "time"] = "travel"
    peak_spread: float = 0.0  # standard deviation of ln of the peak's height from run to run
    tail_spread: float = 0.0  # the same of its length
    build_up: float = 0.2
    slow_part: float = 0.0  # of the build-up: takes five times as long to nine tenths of its end
    omega: float = REFERENCE_SPEED
    run_up: float = 0.0  # time until the pulley has its speed
    idle: float = 0.0  # time for which the pulley stands still after the sliding
    noise: float = 0.5
    memory: float = 0.0  # correlation of the noise of neighbouring samples
    slow: tuple[Noise, ...] = ()
    ripple: float = 0.004
    ripple_period: float = 0.748
    drift: float = 0.0  # relative change of mu from the end of the build-up to that of the sliding
    stick_slip: float = 0.0  # relative height of a saw tooth in mu at the slowest speed
    relaxation: float = 0.0  # part of the tension that is lost in the end, with `relaxation_time`
    relaxation_time: float = 10.0
    offset: float = 0.0  # difference of the zeros of the cells, half each
    seed: int = 0

    def but(self, **changes: Any) -> Recipe:
        return replace(self, **changes)


@dataclass(frozen=True)
class Belt:
    """A belt on its rig: mu(f, v) = mu0 (f/5400)^-a [1 + c (L(v)/L(0.01) - 1)],
    L(v) = ln(1 + v/v0), in which f is the mean force of Eq. (8)."""

    mu0: float
    a: float
    c: float
    v0: float
    arcs_deg: tuple[float, ...] = (40.0, 68.0, 82.0)
    tensions: tuple[float, ...] = (60.0, 90.0, 130.0, 180.0, 230.0, 290.0, 350.0, 420.0)
    speeds: tuple[float, ...] = (0.05, 0.1, 0.21, 0.42, 0.84)
    sliding_s: tuple[float, ...] = (12.0, 6.0, 4.0, 3.0, 3.0)

    def but(self, **changes: Any) -> Belt:
        return replace(self, **changes)

    def friction(self, arc_deg: Array, tension: Array, omega: Array) -> Array:
        """mu of runs, in agreement with the mean force it leads to."""
        v, beta = omega * RADIUS_M, np.radians(arc_deg)
        rate = 1.0 + self.c * (np.log1p(v / self.v0) / np.log1p(0.01 / self.v0) - 1.0)
        mu = np.full(arc_deg.size, self.mu0)
        for _ in range(60):
            # T_tight - T_slack = 2 T0 tanh(mu beta / 2), over R mu beta
            force = 2.0 * tension * np.tanh(0.5 * mu * beta) / (RADIUS_M * mu * beta)
            mu = self.mu0 * (force / 5400.0) ** -self.a * rate
        return mu


BELTS = {
    "3pk": Belt(0.75, 0.16, 0.40, 0.0020),
    "8pk, friction falls with speed": Belt(
        0.60,
        0.10,
        -0.25,
        0.0040,
        arcs_deg=(50.0, 75.0, 110.0),
        tensions=(120.0, 180.0, 250.0, 320.0, 400.0, 480.0, 560.0, 650.0),
    ),
    "flat": Belt(
        0.42,
        0.05,
        0.30,
        0.0010,
        arcs_deg=(60.0, 90.0, 160.0),
        speeds=(0.08, 0.15, 0.3, 0.6, 1.0),
        sliding_s=(8.0, 5.0, 4.0, 3.0, 3.0),
    ),
}


@dataclass
class Frame:
    """Runs before they are written down; shape (n runs, samples) each."""

    time: Array
    cells: Array  # readings of the tight and the slack cell [N], shape (2, n runs, samples)
    speed: Array
    sliding: Mask  # samples of the first sliding, behind the build-up
    kept: Mask  # samples that the recording holds
    rate: float


Spoil = Callable[[Frame, np.random.Generator], None]  # what instruments do to the readings


@dataclass(frozen=True)
class Case:
    """A bench: its runs, and what is wrong with it."""

    recipe: Recipe
    spoil: Spoil | None = None
    belt: Belt | None = None  # none: all runs have the recipe's settings


def draw(name: str, n: int, seed: int = 0) -> tuple[dict[str, Array], Array]:
    """n runs of a case, the same for the same seed: columns of rig.csv, true mu_sliding.

    Fewer runs than a campaign has settings are a random choice of them; more repeat them.
    """
    return _drawn(CASES[name], n, np.random.default_rng([seed, zlib.crc32(name.encode())]))


def bench(recipe: Recipe, n_runs: int) -> dict[str, Array]:
    """Columns of rig.csv of runs that differ in noise and phase of the ripple only."""
    return _drawn(Case(recipe), n_runs, np.random.default_rng(recipe.seed))[0]


COLUMNS = ("time_s", "tension_tight_N", "tension_slack_N", "pulley_speed_rad_s")


def record(recipe: Recipe) -> dict[str, Array]:
    """Channels of one run."""
    columns = bench(recipe, 1)
    return {name: columns[name] for name in COLUMNS}


def _drawn(case: Case, n: int, rng: np.random.Generator) -> tuple[dict[str, Array], Array]:
    r, belt = case.recipe, case.belt
    if belt is None:
        arc, nominal, omega, mu = (np.full(n, x) for x in (r.arc_deg, r.initial, r.omega, r.mu))
        initial, end, slowest = nominal, np.full(n, r.duration), r.omega
    else:
        arc, nominal, omega, sliding = _settings(belt, n, rng)
        initial = nominal * (1.0 + 0.01 * rng.normal(size=n))
        mu = belt.friction(arc, initial, omega)
        end, slowest = r.rest + sliding, min(belt.speeds)
    frame, mu = _runs(r, arc, initial, omega, mu, end, slowest, rng)
    if case.spoil is not None:
        case.spoil(frame, rng)
    row = np.nonzero(frame.kept)[0]
    columns = {
        "run": row.astype(float),
        "time_s": frame.time[frame.kept],
        "tension_tight_N": frame.cells[0][frame.kept],
        "tension_slack_N": frame.cells[1][frame.kept],
        "pulley_speed_rad_s": frame.speed[frame.kept],
        "arc_deg": arc[row],
        "initial_tension_N": nominal[row],
    }
    return columns, mu


def _settings(belt: Belt, n: int, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Arc [deg], tension [N], speed [rad/s] and time of sliding [s] of n runs."""
    shape = (len(belt.arcs_deg), len(belt.tensions), len(belt.speeds))
    size = int(np.prod(shape))
    chosen = np.concatenate([np.sort(rng.permutation(size)[: n - k]) for k in range(0, n, size)])
    arc, tension, speed = np.unravel_index(chosen, shape)
    return (
        np.array(belt.arcs_deg)[arc],
        np.array(belt.tensions)[tension],
        np.array(belt.speeds)[speed],
        np.array(belt.sliding_s)[speed],
    )


def _runs(
    r: Recipe,
    arc_deg: Array,
    initial: Array,
    omega: Array,
    mu: Array,
    end: Array,
    slowest: float,
    rng: np.random.Generator,
) -> tuple[Frame, Array]:
    """The readings and the true mu_sliding."""
    n = omega.size
    arc_deg, initial, omega, end = (x[:, None] for x in (arc_deg, initial, omega, end))
    length = end + r.idle
    t = np.arange(round(float(np.max(length)) * r.rate)) / r.rate
    t = np.broadcast_to(t, (n, t.size))
    kept = t < length - 0.5 / r.rate
    moves = (t >= r.rest) & (t < end)

    # time since the start at full speed: travel over omega R
    turned = _ramp(np.minimum(t, end) - r.rest, r.run_up)
    pace = REFERENCE_SPEED / omega
    own = pace if r.clock == "travel" else 1.0
    after = np.maximum(turned - r.build_up * own, 0.0)
    height = r.peak * np.exp(r.peak_spread * rng.normal(size=(n, 1)))
    tail = r.tail * own * np.exp(r.tail_spread * rng.normal(size=(n, 1)))
    decay = SHAPES[r.shape]
    friction = mu[:, None] * (1.0 + height * decay(after / tail))
    friction *= 1.0 + r.drift * after / (end - r.rest - r.build_up * own)
    truth = mu * (1.0 + 0.75 * r.drift)
    if r.stick_slip:
        tooth = (after / 0.3 + rng.uniform(size=(n, 1))) % 1.0 * (after > 0.0)
        friction = np.where(omega == slowest, friction * (1.0 + r.stick_slip * tooth), friction)
        truth = np.where(omega[:, 0] == slowest, np.nan, truth)
    speed = omega * moves
    if r.run_up:
        speed = speed * np.clip((t - r.rest) / r.run_up, 0.0, 1.0)

    ratio = np.exp(friction * np.radians(arc_deg))
    low = 2.0 * initial / (1.0 + ratio)
    built = turned / (r.build_up * own)
    rise = (1.0 - r.slow_part) * np.clip(built, 0.0, 1.0)
    rise += r.slow_part * (1.0 - 0.1 ** (built / 5.0))
    phase = rng.uniform(0.0, 2.0 * np.pi, (n, 1))
    wave = r.ripple * np.sin(2.0 * np.pi * turned / (r.ripple_period * pace) + phase)
    wave *= turned > 0.0
    left = 1.0 - r.relaxation * (1.0 - np.exp(-t / r.relaxation_time))
    spans = np.stack([initial + (low * ratio - initial) * rise, initial + (low - initial) * rise])
    cells = spans * np.stack([1.0 + wave, 1.0 + 0.75 * wave]) * left
    for cell, sign in zip(cells, (1.0, -1.0), strict=True):
        cell += r.noise * _autoregressive(r.memory, t.shape, rng) + sign * 0.5 * r.offset
    for part in r.slow:
        one, other = (part.sd * _slow(part, r.rate, t.shape, rng) for _ in range(2))
        cells[0] += one
        cells[1] += -one if part.opposite else other
    if r.noise:
        speed = speed * (1.0 + 4e-3 * rng.normal(size=t.shape)) + 5e-5 * rng.normal(size=t.shape)
    sliding = (after > 0.0) & moves
    return Frame(t, cells, speed, sliding, kept, r.rate), truth


def _ramp(t: Array, run_up: float) -> Array:
    """Time at full speed that gives the travel after the time t, with a linear run-up."""
    t = np.maximum(t, 0.0)
    if not run_up:
        return t
    return np.where(t < run_up, 0.5 * t**2 / run_up, t - 0.5 * run_up)


def _autoregressive(a: float, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Stationary noise of unit variance in which neighbours correlate by a."""
    x = rng.normal(size=shape)
    if not a:
        return x
    x[:, 1:] *= np.sqrt(1.0 - a**2)
    return with_memory(x, a)


def with_memory(x: Array, a: float) -> Array:
    """y[k] = a y[k-1] + x[k] along the last axis."""
    from scipy.signal import lfilter  # slow to import

    return lfilter([1.0], [1.0, -a], x)


def _slow(part: Noise, rate: float, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Noise of a cell in units of its `sd`."""
    n, m = shape
    if part.kind == "ar":
        return _autoregressive(np.exp(-1.0 / (rate * part.time)), shape, rng)
    if part.kind == "walk":
        return np.cumsum(rng.normal(size=shape), axis=1) / np.sqrt(rate * part.time)
    # amplitudes as 1/sqrt(f) from once per record, on a period four times as long so that the
    # record does not close on itself
    k = np.arange(4, 2 * m + 1)
    spectrum = np.zeros((n, 2 * m + 1), dtype=complex)
    spectrum[:, 4:] = (rng.normal(size=(n, k.size)) + 1j * rng.normal(size=(n, k.size))) / k**0.5
    return np.fft.irfft(spectrum, 4 * m, axis=1)[:, :m] * 2.0 * m / np.sqrt(np.sum(1.0 / k))


# What instruments do. Times are those of the recording.


def spikes(f: Frame, rng: np.random.Generator) -> None:
    for cell in f.cells:
        hit = rng.random(cell.shape) < 0.01
        cell[hit] += rng.choice([-60.0, 60.0], np.count_nonzero(hit))


def wandering_tare(f: Frame, rng: np.random.Generator) -> None:
    f.cells[0] += rng.choice((-1.0, 1.0)) + 0.5 * rng.normal(size=(len(f.time), 1))


def drifting_zeros(tight: float, slack: float, f: Frame, rng: np.random.Generator) -> None:
    """Zeros of the cells that move by so many N in 6 s; a bench draws up or down."""
    sign = rng.choice((-1.0, 1.0))
    for cell, newton in zip(f.cells, (tight, slack), strict=True):
        cell += sign * newton * f.time / 6.0


def second_ripple(period_s: float, f: Frame, rng: np.random.Generator) -> None:
    """Another ripple, of 0.3 % and any phase."""
    phase = rng.uniform(0.0, 2.0 * np.pi, (len(f.time), 1))
    turned = np.maximum(f.time - 1.0, 0.0)
    wave = 0.003 * np.sin(2.0 * np.pi * turned / period_s + phase) * (turned > 0.0)
    f.cells *= np.stack([1.0 + wave, 1.0 + 0.75 * wave])


def zeros_of_the_bench(f: Frame, rng: np.random.Generator) -> None:
    """The zero of each cell is off by some N, the same in all runs."""
    f.cells += rng.normal(size=(2, 1, 1))


def zeros_on_their_own(f: Frame, rng: np.random.Generator) -> None:
    """The zero of each cell is anywhere within 2 N in every run."""
    f.cells += rng.uniform(-2.0, 2.0, (2, len(f.time), 1))


def clipped(part: float, f: Frame, rng: np.random.Generator) -> None:
    """The tight cell reads no more than what it exceeds in a part of the sliding samples."""
    tight = f.cells[0]
    seen = np.where(f.sliding & f.kept, tight, np.nan)
    np.minimum(tight, np.nanquantile(seen, 1.0 - part, axis=1)[:, None], out=tight)


def soft_saturation(f: Frame, rng: np.random.Generator) -> None:
    """The tight cell loses 2 % at 500 N, as the square of the force."""
    f.cells[0] *= 1.0 - 0.02 * (f.cells[0] / 500.0) ** 2


def drop_outs(f: Frame, rng: np.random.Generator) -> None:
    """Bursts of 0.2 s: lost rows, missing values in one cell, zeros in the other."""
    m = round(0.2 * f.rate)
    for run in range(len(f.time)):
        rest = np.count_nonzero(~np.logical_or.accumulate(f.sliding[run]))
        begin = rng.integers(rest + 5, np.count_nonzero(f.kept[run]) - m, 3)
        f.kept[run, begin[0] : begin[0] + m] = False
        f.cells[0, run, begin[1] : begin[1] + m] = np.nan
        f.cells[1, run, begin[2] : begin[2] + m] = 0.0


def case(spoil: Spoil | None = None, belt: Belt | None = None, **changes: Any) -> Case:
    """A case whose recipe differs from the usual one by some changes."""
    return Case(Recipe(**changes), spoil, belt)


def _cases() -> dict[str, Case]:
    double = {"shape": "two exponentials"}
    plain = {
        "one exponential": case(),
        "one exponential, four times the noise": case(noise=2.0),
        "two exponentials": case(**double),
        "two exponentials, four times the noise": case(noise=2.0, **double),
        "stretched exponential": case(shape="stretched"),
        "stretched exponential, a quarter of the noise": case(shape="stretched", noise=0.125),
        "power law": case(shape="power law"),
        "power law, a quarter of the noise": case(shape="power law", noise=0.125),
        "power law, long tail": case(shape="power law", tail=1.0),
        "no peak": case(peak=0.0),
        "correlated noise, 2 samples": case(memory=0.5),
        "correlated noise, 5 samples": case(memory=0.8),
        "correlated noise, 5 samples, two exponentials": case(memory=0.8, **double),
        "correlated noise, 10 samples (0.2 s)": case(memory=np.exp(-0.1)),
        "correlated noise, 20 samples (0.4 s)": case(memory=0.95),
        "slow ripple": case(ripple_period=1.0 / 0.35),
        "strong ripple": case(ripple=0.03),
        "spikes in 1 % of the samples": case(spikes),
        "tare that wanders from run to run, 1 ± 0.5 N": case(wandering_tare),
        "short plateau (1.8 s, tail 0.6 s)": case(duration=3.0),
        "short plateau, two exponentials": case(duration=3.0, tail=0.3, **double),
        "long plateau (18.8 s), two exponentials": case(duration=20.0, **double),
        "low tension (60 N)": case(initial=60.0),
        "zero of the tight cell drifts by 1 N in a run": case(partial(drifting_zeros, 1.0, 0.0)),
        "zero of the slack cell drifts by 0.3 N in a run": case(partial(drifting_zeros, 0.0, 0.3)),
        "zero of the slack cell drifts by 1 N in a run": case(partial(drifting_zeros, 0.0, 1.0)),
        "both zeros drift by 1 N in a run": case(partial(drifting_zeros, 1.0, 1.0)),
        "two ripples, second of 2.1 s": case(partial(second_ripple, 2.1)),
        "two ripples, second of 4.5 s": case(partial(second_ripple, 4.5)),
        "ripple of 8 s, longer than the sliding": case(ripple_period=8.0),
        "1000 samples per second, quick build-up": case(rate=1000.0, build_up=0.05),
    }
    belt = BELTS["3pk"]
    # sliding of 5 to 100 mm in 5 s
    wide = belt.but(speeds=(0.02, 0.042, 0.09, 0.19, 0.4), sliding_s=(5.0,) * 5)
    turn = 2.0 * np.pi / REFERENCE_SPEED

    def slow(*noise: Any) -> dict[str, Any]:
        return {"slow": (Noise(*noise),)}

    hard = {
        "zeros of both cells wander 0.5 N in 10 s": case(**slow("walk", 0.5, 10.0)),
        "zeros of both cells wander 0.5 N around their place, 10 s": case(**slow("ar", 0.5, 10.0)),
        "tight cell clipped in 20 % of the sliding samples": case(partial(clipped, 0.2)),
        "tight cell saturates softly (2 % at 500 N)": case(soft_saturation),
        "second tail twenty times longer (30 %)": case(shape="twenty times"),
        "AR noise 1 s, 0.35 N": case(**slow("ar", 0.35)),
        "AR noise 1 s, 0.35 N, opposite in both cells": case(**slow("ar", 0.35, 1.0, True)),
        "AR noise 1 s, 1 N": case(**slow("ar", 1.0)),
        "AR noise 1 s, 1 N, opposite in both cells": case(**slow("ar", 1.0, 1.0, True)),
        "1/f noise, 1 N": case(**slow("1/f", 1.0)),
        "AR noise 0.2 s, 0.5 N": case(**slow("ar", 0.5, 0.2)),
        "AR(0.9) noise": case(memory=0.9),
        "sliding of 5 to 100 mm": case(belt=wide, build_up=0.05),
        "ripple once per turn, 1 %": case(ripple=0.01, ripple_period=turn),
        "belt relaxes at rest, 3 % in 30 s": case(rest=30.0, relaxation=0.03, rate=20.0),
        "belt relaxes by 3 %, time constant 30 s, short rest": case(
            relaxation=0.03,
            relaxation_time=30.0,
        ),
        "mu drifts within a run, +1 %": case(drift=0.01),
        "mu drifts within a run, +4 %": case(drift=0.04),
        "a tenth of the build-up five times slower": case(slow_part=0.1),
        "a third of the build-up five times slower": case(slow_part=0.33),
    }
    robust = {
        "drop-outs": case(drop_outs, belt),
        "spikes in 1 % of the samples, campaign": case(spikes, belt),
        "10 samples per second": case(belt=belt, rate=10.0),
        "1000 samples per second": case(rate=1000.0),
        "soft start, 0.5 s": case(belt=belt, run_up=0.5),
        "idle tails of 2 s": case(belt=belt, idle=2.0),
        "zeros of the cells off by 1 N in all runs": case(zeros_of_the_bench, belt),
        "zeros of both cells off by up to 2 N in each run": case(zeros_on_their_own, belt),
        "stick-slip at the slowest speed": case(belt=belt, stick_slip=0.08),
    }
    kinds: dict[str, dict[str, Any]] = {
        "two-term tails": double,
        "stretched tails": {"shape": "stretched"},
        "peaks and tails spread by 30 %": {"peak_spread": 0.3, "tail_spread": 0.3},
        "slow noise": slow("ar", 0.3, 0.5),
    }
    drift = partial(drifting_zeros, 0.0, 1.0)
    return {
        **plain,
        **{name: replace(one, belt=one.belt or belt) for name, one in hard.items()},
        **robust,
        **{f"campaign {name}": case(belt=b) for name, b in BELTS.items()},
        **{
            f"campaign {name}: {kind}": case(belt=b, **changes)
            for name, b in BELTS.items()
            for kind, changes in kinds.items()
        },
        "campaign 3pk: tails over time": case(belt=belt, clock="time", build_up=0.1),
        "campaign 3pk: zero of the slack cell drifts by 1 N": case(drift, belt),
        "campaign 3pk: both zeros drift by 1 N": case(partial(drifting_zeros, 1.0, 1.0), belt),
    }


CASES = _cases()  # all benches by their names
