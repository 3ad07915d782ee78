"""Pieces of the friction model against sums and least squares written out by brute force."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from virtual_rig import RADIUS_M, draw

from beltid.identify.friction.bench_model import (
    FREE,
    LENGTHS_M,
    MEMORIES_S,
    Bench,
    block_covariance,
    cell_errors,
    fit_bench,
    log_settings,
)
from beltid.identify.friction.prepare import Rest, SlidingRecord, block_starts, prepare_run
from beltid.identify.friction.run import run_records
from beltid.mixed import root


def test_covariance_of_block_means_is_the_mean_over_pairs_of_samples():
    memories = np.array([0.005, 0.06, 0.5, 20.0, 1e5])
    times = [0.02 * np.arange(a, b) for a, b in ((0, 1), (1, 2), (2, 5), (5, 12), (12, 32))]
    first, last, count = np.array([(t[0], t[-1], t.size) for t in times]).T
    found = block_covariance(first, last, count, memories)
    expected = [
        [[np.mean(np.exp(-np.abs(s[:, None] - t) / tau)) for t in times] for s in times]
        for tau in memories
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 9, 255, 256, 257, 600, 5000, 60_000])
def test_blocks_hold_every_sample_once_and_grow(n):
    starts = block_starts(n)
    count = np.diff(np.append(starts, n))
    assert starts[0] == 0
    assert count.sum() == n
    assert count.min() >= 1
    if n >= 256:
        assert count[0] == -(-n // 256)
        assert 20 <= starts.size <= 100
    # none but the last, which takes in the rest, is longer than a twelfth of what came before
    assert np.all(count[1:-1] <= np.maximum(count[0], 0.15 * starts[1:-1]))


AT_REST = Rest(np.linspace(0.0, 1.0, 50), np.full((50, 2), 260.0))


def phases(t, tensions, angle):
    """Sliding after eleven samples, all of which turn."""
    parts = {"time_s": t, "tensions": tensions, "angle": angle, "temperature": 22.0 + 0.0 * t}
    return SimpleNamespace(**parts, first=0, built=9, slide=11)


def recorded(seed=0, n=400, ripple=0.0, noise=0.5, rounding_N=(0.0, 0.0), weight=None):
    """Sliding at 400 and 150 N with noise of 0.5 N, 10 mm/s, one spike; after a second at rest."""
    rng = np.random.default_rng(seed)
    t = 1.0 + 0.02 * np.arange(n + 11)
    tensions = np.array([400.0, 150.0]) + noise * rng.normal(size=(n + 11, 2))
    tensions[:, 0] += ripple * np.sin(2.0 * np.pi * t / 0.31)
    tensions[211] += 30.0
    phase = phases(t, tensions, 0.2 * (t - t[0]))
    record = SlidingRecord(phase, AT_REST, np.array(rounding_N), weight, 0.05)
    return record, np.delete(tensions, 211, axis=0)[11:]


def test_block_means_keep_the_mean_of_the_logarithm_to_first_order():
    record, tensions = recorded()
    assert (record.n_outliers, record.count.sum()) == (1, 399)
    tight, slack = tensions.mean(axis=0)
    found = np.average(record.z, weights=record.count)
    # of second order in the noise, (0.5/150)²/2: the plain mean of logarithms is off by it
    assert found == pytest.approx(math.log(tight / slack), abs=1e-6)
    assert record.noise_N == pytest.approx(0.5, rel=0.15)
    assert record.unrest_N == pytest.approx(0.5, rel=0.15)
    assert np.exp(log_settings([record])[0, 0]) == pytest.approx(0.01, rel=0.01)
    assert record.waves.shape[1] == 0
    assert recorded(ripple=4.0)[0].ripple_N == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize(
    ("weight", "shifts"),
    [(None, (1 / 400, -1 / 150)), ("tight", (0.0, -1 / 150)), ("slack", (1 / 400, 0.0))],
)
def test_only_a_cell_has_errors_and_a_dead_weight_none(weight, shifts):
    record, _ = recorded(weight=weight)
    assert record.zero_shifts == pytest.approx(shifts, rel=1e-3)
    assert record.sensitivity == pytest.approx(math.hypot(*shifts), rel=1e-3)


def test_coarse_converters_round_the_level():
    record, _ = recorded(noise=0.0, rounding_N=(1.0, 2.0))
    assert record.rounding == pytest.approx(math.hypot(1 / 400, 2 / 150), rel=1e-3)


def test_the_level_of_one_run_is_that_of_generalised_least_squares():
    record, _ = recorded()
    bench = Bench([record], log_settings([record])[0])
    A = bench.A
    sizes = {"walk": 0.3, "turn": 2e-4, "height": 0.15, "length": 0.1, "own decay": 3e-3}
    short = {f"memory {tau:g} s": 0.1 for tau in MEMORIES_S[:-1]}
    found = bench.model().at({**sizes, **short, "white": 1.0})
    c, rest = record.sensitivity, record.rest
    V = c**2 * np.diag(record.noise_N**2 / record.count)
    blocks = (record.first_s, record.last_s, record.count)
    ends = (rest.first_s, rest.last_s, rest.n_samples)
    V += (c * 0.1) ** 2 * block_covariance(*blocks, MEMORIES_S[:-1]).sum(axis=0)
    walk = block_covariance(
        *(np.append(a, b) for a, b in zip(ends, blocks, strict=True)), MEMORIES_S[-1:]
    )[0]
    moved = np.hstack([-np.ones((record.z.size, 1)), np.eye(record.z.size)])
    V += (c * 0.3) ** 2 * moved @ walk @ moved.T
    # half of a ripple goes with the level, half with the middle one, here the same
    V += (record.level * 2e-4) ** 2 * record.turn @ record.turn.T
    V += FREE**2 * record.take_up @ record.take_up.T
    V += (record.level * 3e-3) ** 2 * record.slow_take_up @ record.slow_take_up.T
    u = record.travel[:, None] / LENGTHS_M
    own = record.level * np.column_stack([np.exp(-u) @ A, (u * np.exp(-u)) @ A])
    V += own * [0.15**2, 0.1**2] @ own.T
    precision = np.linalg.inv(V).sum()
    residual = record.z - c * bench.model().X[0, 2:] @ found.mean
    assert found.level[0] == pytest.approx(np.linalg.solve(V, residual).sum() / precision, rel=1e-9)
    assert found.level_variance[0] == pytest.approx(1.0 / precision, rel=1e-9)


def several(n_runs, noise):
    """Runs at 400 and 150 N with a tail of two lengths; true level without it."""
    records = []
    for k in range(n_runs):
        rng, t = np.random.default_rng(k), 1.0 + 0.02 * np.arange(411)
        x = 0.01 * (t - t[0])
        level = math.log(400.0 / 150.0)
        z = level * (1.0 + 0.03 * np.exp(-x / 0.006) + 0.02 * np.exp(-x / 0.02))
        tensions = math.sqrt(6e4) * np.exp(np.outer(z, [0.5, -0.5]))
        tensions += noise * rng.normal(size=tensions.shape)
        phase = phases(t, tensions, 20 * x)
        records.append(SlidingRecord(phase, AT_REST, np.zeros(2), None, 0.05))
    return records, level


def test_the_tail_of_the_model_is_that_of_the_runs():
    records, level = several(6, 0.1)
    found = fit_bench(records)
    x = np.array([0.006, 0.01, 0.03])
    true = level * (0.03 * np.exp(-x / 0.006) + 0.02 * np.exp(-x / 0.02))
    # travel counts from the end of the build-up, a ninth further than its nine tenths
    z, error = found.course(0, x - 0.01 * 0.02 * 9 / 0.9)
    assert np.all(np.abs(z - level - true) < 3.0 * error)
    assert np.all(error < 3e-3)
    factor = root(found.posterior.covariance)
    columns = np.hstack([found.posterior.level_shift @ factor, found.doubt])
    np.testing.assert_allclose(np.sum(found.shared**2, axis=1), np.sum(columns**2, axis=1))


def test_the_spectrum_of_own_tails_is_that_of_the_posterior():
    """By full steps alone the search went there and back: 7.5 % beside 2.1 % here."""
    columns, _ = draw("a third of the build-up five times slower", 20, seed=4)
    bench = fit_bench([prepare_run(r, RADIUS_M)[1] for r in run_records(columns, RADIUS_M)])
    assert bench.A.sum() == pytest.approx(bench.posterior.of("tail")[0].sum(), rel=0.1)


def of_cells(T, D, se, d=1.0):
    """Correction, its variance, the shared error and the share held of runs with such a rest."""
    runs, ends = [], []
    for k, (tension, difference, way) in enumerate(np.broadcast(T, D, d)):
        runs.append(SimpleNamespace(swapped=way < 0.0, notes=(), arc_deg=60.0))
        rest = SimpleNamespace(tension_N=tension, imbalance_N=difference, imbalance_se_N=se)
        sliding = {"travel": [0.0, 0.1 + 0.1 * k], "middle_s": [0.0, 1.0], "level": 1.04}
        tensions_N = (1.7 * tension, 0.6 * tension)
        ends.append(SimpleNamespace(rest=rest, tensions_N=tensions_N, **sliding))
    found = cell_errors(runs, ends, 1.04 + 0.0 * T, 1e-3 + 0.0 * T)
    return np.array([*found, [run.held for run in runs]]).T


def test_errors_of_the_cells_change_sign_with_the_cells_and_scale_with_the_force():
    T, D = np.geomspace(80.0, 400.0, 5), 1.5 + np.random.default_rng(2).normal(scale=0.2, size=5)
    first = of_cells(T, D, 0.02)  # with the cells, all but the variance change their signs
    same = of_cells(T, -D, 0.02) * [-1, 1, -1, -1], of_cells(3 * T, 3 * D, 0.06)
    np.testing.assert_allclose(same, [first, first], rtol=1e-3, atol=1e-8)


def test_an_imbalance_at_one_tension_is_half_taken_off_and_half_stated():
    """Zeros that differ, or friction held: nobody can tell."""
    T, D = np.full(8, 200.0), np.random.default_rng(4).normal(size=8)
    mean, variance, *_ = of_cells(T, D, 1e-3).T
    half = 0.25 * (1 / 340.0 + 1 / 120.0)
    assert np.diff(mean) == pytest.approx(half * np.diff(D), rel=1e-3)
    assert np.all(np.sqrt(variance) > 0.95 * half * np.abs(D - D.mean()))


def test_five_settings_in_both_directions_do_not_tell_a_gain_from_held_friction():
    """Friction may change with each setting as a gain would change it: nothing is a gain here."""
    d, T = np.array([1, -1, 1, -1, 1]), np.array([380.0, 80.0, 210.0, 140.0, 290.0])
    mean, variance, common, _ = of_cells(T, 0.02 * d * T, 0.05, d).T
    assert np.all(np.abs(mean) < 1.5 * np.sqrt(variance + common**2))
