"""Pieces of the friction model against sums, integrals and Gaussians written out by brute force."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from beltid.identify.friction import campaign, rest, shared
from beltid.identify.friction.campaign import block_covariance, wander_since_rest
from beltid.identify.friction.channels import SlidingPhase
from beltid.identify.friction.prepare import block_starts, sliding_record
from beltid.identify.friction.rest import rest_state
from beltid.identify.friction.shared import (
    RANK,
    spectra_of,
    stretched,
    stretching,
    summed,
    tail_basis,
    tail_coefficients,
)

# --- noise of block means ---

BLOCKS = [(0.0, 1), (0.02, 1), (0.04, 3), (0.10, 7), (0.24, 20)]
"""First time and number of samples of each block; 50 samples per second."""


def sample_times():
    return [first + 0.02 * np.arange(n) for first, n in BLOCKS]


def mean_product(s, t, tau):
    return float(np.mean(np.exp(-np.abs(s[:, None] - t[None, :]) / tau)))


@pytest.mark.parametrize("tau", [0.005, 0.06, 0.5, 20.0, 1e5])
def test_covariance_of_block_means_is_the_mean_over_pairs_of_samples(tau):
    times = sample_times()
    first, last = np.array([(t[0], t[-1]) for t in times]).T
    found = block_covariance(first, last, np.array([float(n) for _, n in BLOCKS]), tau)
    expected = [[mean_product(s, t, tau) for t in times] for s in times]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("tau", [0.06, 20.0])
def test_wander_is_what_the_process_moved_since_its_mean_at_rest(tau):
    times, rest = sample_times(), -1.0 + 0.02 * np.arange(40)
    first, last = np.array([(t[0], t[-1]) for t in times]).T
    count = np.array([float(n) for _, n in BLOCKS])
    at_rest = rest_state(rest, np.full((40, 2), 100.0), first=40)
    found = wander_since_rest(first, last, count, at_rest, tau)
    whole = np.array([[mean_product(s, t, tau) for t in [rest, *times]] for s in [rest, *times]])
    moved = np.hstack([-np.ones((5, 1)), np.eye(5)])
    np.testing.assert_allclose(found, moved @ whole @ moved.T, rtol=1e-7, atol=1e-12)


# --- shapes of the tail ---

TRAVEL = np.concatenate([[0.0], np.geomspace(1e-4, 0.3, 60)])


@pytest.mark.parametrize("length", [3e-4, 2e-3, 0.011, 0.2])
def test_a_spectrum_without_width_is_one_exponential(length):
    (c,) = tail_coefficients(np.array([np.log(length)]), np.zeros(1), np.zeros(1))
    np.testing.assert_allclose(tail_basis(TRAVEL) @ c, np.exp(-TRAVEL / length), atol=2.5e-3)


@pytest.mark.parametrize(("slow", "fast"), [(0.8, 0.0), (0.0, 0.7), (0.9, 0.5)])
def test_a_tail_is_the_integral_over_its_spectrum(slow, fast):
    centre = math.log(5e-3)
    (c,) = tail_coefficients(np.array([centre]), np.array([slow]), np.array([fast]))

    def integral(f):
        above = (
            quad(lambda u: f(centre + u) * math.exp(-0.5 * (u / slow) ** 2), 0, 3 * slow)[0]
            if slow
            else 0.0
        )
        below = (
            quad(lambda u: f(centre - u) * math.exp(-0.5 * (u / fast) ** 2), 0, 3 * fast)[0]
            if fast
            else 0.0
        )
        return above + below

    weight = integral(lambda _: 1.0)
    for x in (0.0, 1e-3, 5e-3, 0.02, 0.08):
        expected = integral(lambda log_l, x=x: math.exp(-x / math.exp(log_l))) / weight
        assert float(tail_basis(np.array([x]))[0] @ c) == pytest.approx(expected, abs=4e-3)


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.6])
def test_stretching_makes_a_tail_longer(factor):
    length = 5e-3
    (c,) = tail_coefficients(np.array([np.log(length)]), np.zeros(1), np.zeros(1))
    (E,) = stretching(np.array([math.log(factor)]))
    found = tail_basis(TRAVEL) @ (E @ c)
    np.testing.assert_allclose(found, np.exp(-TRAVEL / (factor * length)), atol=6e-3)
    slope = tail_basis(TRAVEL) @ stretched(c)
    x = TRAVEL / length  # d/d ln l of exp(-x/l)
    np.testing.assert_allclose(slope, x * np.exp(-x), atol=6e-3)


# --- the record of a run ---


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
    assert np.all(count[1:-1] <= np.maximum(count[0], 0.1 * starts[1:-1]))


AT_REST = rest_state(np.linspace(0.0, 1.0, 50), np.full((50, 2), 260.0), first=50)


def recorded(seed=0, n=400, ripple=0.0, noise=0.5, steps=(0.0, 0.0), weight=None, rest=None):
    """Sliding at 400 and 150 N with noise of 0.5 N, 10 mm/s, one spike; after a second at rest."""
    rng = np.random.default_rng(seed)
    t = 1.0 + 0.02 * np.arange(n + 11)
    tensions = np.array([400.0, 150.0]) + noise * rng.normal(size=(n + 11, 2))
    tensions[:, 0] += ripple * np.sin(2.0 * np.pi * t / 0.31)
    tensions[211] += 30.0
    angle = 0.2 * (t - t[0])
    phase = SlidingPhase(t, tensions, angle, np.full(n + 11, 22.0), first=0, built=9, slide=11)
    record = sliding_record(phase, rest or AT_REST, np.array(steps), weight, 0.05)
    return record, np.delete(tensions, 211, axis=0)[11:]


def test_block_means_keep_the_mean_of_the_logarithm_to_first_order():
    record, tensions = recorded()
    assert (record.n_outliers, record.count.sum()) == (1, 399)
    tight, slack = tensions.mean(axis=0)
    found = np.average(record.z, weights=record.count)
    # of second order in the noise, (0.5/150)²/2: the plain mean of logarithms is off by it
    assert found == pytest.approx(math.log(tight / slack), abs=1e-6)
    assert record.noise_N == pytest.approx(0.5, rel=0.15)
    assert record.speed_m_s == pytest.approx(0.01, rel=0.01)
    assert record.waves.shape[1] == 0
    waving = recorded(ripple=4.0)[0]
    assert waving.ripple_N == pytest.approx(4.0, abs=0.2)


def test_the_unrest_is_that_of_sections_as_long_as_the_rest():
    # a second each, about a line; 50 samples
    assert recorded()[0].unrest_N == pytest.approx(0.5, rel=0.1)
    instant = replace(AT_REST, last_s=AT_REST.first_s)
    assert recorded(rest=instant)[0].unrest_N == 0.0


@pytest.mark.parametrize(
    ("weight", "shifts"),
    [(None, (1 / 400, -1 / 150)), ("tight", (0.0, -1 / 150)), ("slack", (1 / 400, 0.0))],
)
def test_only_a_cell_has_errors_and_a_dead_weight_none(weight, shifts):
    record, _ = recorded(weight=weight)
    assert record.zero_shifts == pytest.approx(shifts, rel=1e-3)
    assert record.sensitivity == pytest.approx(math.hypot(*shifts), rel=1e-3)


def test_coarse_converters_round_the_level():
    record, _ = recorded(noise=0.0, steps=(1.0, 2.0))
    # a uniform distribution as wide as a step, in either cell
    assert record.rounding == pytest.approx(math.hypot(1 / 400, 2 / 150) / math.sqrt(12), rel=2e-3)
    assert recorded()[0].rounding == 0.0


def test_the_level_of_one_run_is_that_of_generalised_least_squares():
    record, _ = recorded()
    stack = campaign.Stack([record], campaign.log_settings([record])[0])
    stack.stretch(np.zeros(campaign.SETTINGS))
    sd = np.array([0.05, 0.1, 0.2, 0.3, 2e-4, 0.15, 0.1, 3e-3])
    w = campaign.whiten(stack, sd)
    c = record.sensitivity
    V = c**2 * np.diag(record.noise_N**2 / record.count)
    blocks = (record.first_s, record.last_s, record.count)
    *short, walk = campaign.MEMORIES_S
    for s, tau in zip(sd, short, strict=False):
        V += (c * s) ** 2 * block_covariance(*blocks, tau)
    V += (c * sd[3]) ** 2 * wander_since_rest(*blocks, record.rest, walk)
    # half of a ripple goes with the level, half with the middle one, here the same
    V += (record.level * sd[4]) ** 2 * record.turn @ record.turn.T
    V += campaign.FREE**2 * record.take_up @ record.take_up.T
    V += (record.level * sd[7]) ** 2 * record.slow_take_up @ record.slow_take_up.T
    root = np.linalg.cholesky(V)
    one, z = np.linalg.solve(root, np.ones(V.shape[0])), np.linalg.solve(root, record.z)
    (level,), squares = np.linalg.lstsq(one[:, None], z, rcond=None)[:2]
    assert w.level[0] == pytest.approx(level, rel=1e-9)
    assert w.variance[0] == pytest.approx(1.0 / (one @ one), rel=1e-9)
    assert w.squares[0] == pytest.approx(squares[0], rel=1e-6)


@pytest.mark.parametrize("noise", [1.0, 0.15])
def test_the_posterior_of_a_tail_is_that_of_brute_force(noise):
    """Over spectra and heights laid out one by one; a quiet record leaves a narrow ridge."""
    rng = np.random.default_rng(2)
    x = np.linspace(0.0, 0.05, 80)
    design = tail_basis(x) / (0.01 * noise)
    z = (0.03 * np.exp(-x / 6e-3) + 0.02 * np.exp(-x / 18e-3)) / (0.01 * noise)
    z += rng.normal(size=80)
    M, b = design.T @ design, design.T @ z
    longest = 3.0 * 0.05
    found, covered, _, height = summed(M, b, spectra_of(M, b, (1e-3, longest)))
    middle, (_, _, width) = math.log(5e-3), shared.CENTRE
    log_centre = np.linspace(math.log(1e-3), math.log(longest), 80)
    slow, fast = (np.arange(n) * step + 0.5 * step for n, step in ((40, 0.06), (30, 0.07)))
    heights = np.linspace(0.0, 0.12, 201)
    prior_of_height = -0.5 * (heights / shared.HEIGHT) ** 2
    total, of_height, first, second = 0.0, 0.0, np.zeros(RANK), np.zeros((RANK, RANK))
    top = 0.5 * float(np.linalg.lstsq(design, z)[0] @ b)
    for c in log_centre:
        s, f = (axis.ravel() for axis in np.meshgrid(slow, fast, indexing="ij"))
        tails = tail_coefficients(np.full(s.size, c), s, f)
        squares = np.sum((tails @ M) * tails, axis=1)
        log_p = (tails @ b)[:, None] * heights - 0.5 * squares[:, None] * heights**2
        log_p += prior_of_height - 0.5 * ((c - middle) / width) ** 2
        log_p -= ((s + f) / shared.WIDTH)[:, None]
        p = np.exp(log_p - top)
        total += p.sum()
        of_height += float(np.sum(p @ heights))
        first += (p @ heights) @ tails
        second += (tails * (p @ heights**2)[:, None]).T @ tails
    basis = tail_basis(np.array([0.0, 2e-3, 1e-2, 4e-2]))
    mean, by_hand = (basis @ v for v in (found, first / total))
    covariance = second / total - np.outer(first, first) / total**2
    spread, spread_by_hand = (np.sqrt(np.diag(basis @ C @ basis.T)) for C in (covered, covariance))
    np.testing.assert_allclose(mean, by_hand, rtol=0, atol=0.15 * np.max(spread_by_hand))
    np.testing.assert_allclose(spread, spread_by_hand, rtol=0.1)
    assert height == pytest.approx(of_height / total, rel=0.02)


def one_run(shortest, longest):
    """Limits of the lengths of a tail, and settings."""
    return np.array([[shortest, longest]]), np.zeros((1, shared.SETTINGS))


def test_lengths_of_tails_that_decay_over_time_are_limited_by_time():
    """Two runs of equal duration at speeds v and 100 v show the same times, not lengths."""
    limits_m = np.array([[1e-5, 4e-3], [1e-3, 0.4]])
    settings = np.zeros((2, shared.SETTINGS))
    settings[:, 0] = math.log(10.0) * np.array([-1.0, 1.0])
    given = shared.Given(np.zeros((2, 2)), np.zeros(2), 200.0, limits_m, settings)
    assert given.range_m(np.zeros(shared.SETTINGS)) == pytest.approx((1e-5, 0.4))
    assert given.range_m(campaign.CLOCKS[1]) == pytest.approx((1e-4, 0.04))


def posterior_of_tail(share, length):
    """Of 3 mm and a share of another length, in 60 mm of a very quiet record."""
    x, noise = np.linspace(0.0, 0.06, 200), 1e-4
    design = np.zeros((x.size, shared.SHARED))
    design[:, :RANK] = tail_basis(x) / noise
    design -= design.mean(axis=0)  # the level is free
    z = 0.05 * ((1.0 - share) * np.exp(-x / 3e-3) + share * np.exp(-x / length)) / noise
    # zeros of the cells that do not drift, by their rest
    given = shared.Given(1e12 * np.eye(2), np.zeros(2), 200.0, *one_run(1e-3, 3.0 * 0.06))
    before = shared.Shared.before(np.zeros(shared.SETTINGS))
    return shared.posterior(design.T @ design, design.T @ z, given, before)


@pytest.mark.parametrize(("share", "large"), [(0.0, False), (0.4, True)])
def test_the_record_says_whether_its_tail_is_of_the_family(share, large):
    """One exponential is; two whose lengths differ fivefold are not, in so quiet a record."""
    probability = posterior_of_tail(share, 15e-3).weights.sum(axis=1)[-1]
    assert probability > 0.99 if large else probability < shared.UNLIKE_BEFORE[-1]


@pytest.mark.parametrize("length", [30e-3, 80e-3])
def test_a_part_of_the_tail_as_long_as_the_record_is_found(length):
    """Between the lengths that are tried, too: what is left of it at the end is in the mean."""
    found = posterior_of_tail(0.3, length)
    basis = tail_basis(np.array([0.0, 0.06]))
    drop = basis[0] - basis[1]  # what the record shows; the rest of the tail is to be inferred
    left, sd = basis[1] @ found.mean[:RANK], np.linalg.norm(basis[1] @ found.factor[:RANK])
    true = 0.05 * 0.3 * np.exp(-0.06 / length)
    assert drop @ found.mean[:RANK] == pytest.approx(0.05 - true, rel=0.02)
    assert abs(left - true) < 2.0 * sd
    assert sd < 0.5 * true


def test_a_level_is_averaged_over_tails_that_both_explain_the_runs():
    """Three runs often leave open whether tails decay over travel or over time."""
    rng = np.random.default_rng(7)
    none = np.zeros(shared.RANK)
    one, other = (
        campaign.RunLevel(
            y=y,
            variance=1e-4,
            shared_tail=-0.01,
            shared_drift=0.02,
            away=np.array([-0.03, 0.01]),
            spread=np.array([0.01, 0.02]),
            misfit=1.0,
            drift=0.0,
            tail=none,
            own=none,
            known=none,
            lean=none,
        )
        for y in (1.0, 1.1)
    )
    mixed = campaign._averaged([one, other], np.array([0.75, 0.25]))
    # draws of the mixture: a fit, then one of its hypotheses, of probability 1/4 and 3/4
    fit, hypothesis = rng.random(400_000) < 0.25, (rng.random(400_000) < 0.75).astype(int)
    drawn = np.where(fit, 1.1, 1.0) + one.away[hypothesis]
    probability = np.kron([0.75, 0.25], [0.25, 0.75])
    assert mixed.y + probability @ mixed.away == pytest.approx(np.mean(drawn), abs=2e-4)
    assert probability @ mixed.away**2 == pytest.approx(np.var(drawn), rel=0.02)
    assert np.all(mixed.spread == [0.01, 0.02, 0.01, 0.02])
    assert mixed.y == pytest.approx(1.025, rel=1e-12)
    assert mixed.shared_tail == pytest.approx(-math.sqrt(1e-4 + 0.75 * 0.25 * 0.1**2), rel=1e-12)


def test_rests_of_too_few_samples_for_a_slope_tell_nothing_of_a_drift():
    short = [replace(recorded(0)[0].rest, slope_ses_N_s=(np.inf, np.inf))] * 2
    given = shared.Given.by(short, *one_run(1e-3, 0.2))
    assert not given.squares.any()
    assert not given.products.any()


@pytest.mark.parametrize("tensions", [[270.0] * 8, [60.0, 90.0, 130.0, 180.0, 230.0, 290.0, 420.0]])
@pytest.mark.parametrize(("drift", "relaxation"), [(0.3, 0.0), (0.0, -1e-3)])
def test_a_relaxing_belt_explains_slopes_at_rest_in_proportion_to_the_tension(
    tensions, drift, relaxation
):
    T, se = np.array(tensions), 0.02
    sums = drift + relaxation * T
    rests = [
        replace(recorded(0)[0].rest, tension_N=t, slopes_N_s=(0.0, x), slope_ses_N_s=(np.inf, se))
        for t, x in zip(T, sums, strict=True)
    ]
    given = shared.Given.by(rests, *one_run(1e-3, 0.2))
    # the sum of both drifts s and the rate of relaxation k: sums = s + k T + noise, k ~ N(0, k0²)
    k0 = np.mean(sums) / np.mean(T)
    X = np.column_stack([np.ones(T.size), T])
    covariance = np.linalg.inv(X.T @ X / se**2 + np.diag([0.0, k0**-2]))
    s = covariance[0] @ X.T @ sums / se**2
    np.testing.assert_allclose(given.squares, 1.0 / covariance[0, 0], rtol=1e-9)
    np.testing.assert_allclose(given.products, s / covariance[0, 0], rtol=1e-9)
    if np.ptp(T):  # several tensions tell drift and relaxation apart
        assert s == pytest.approx(drift, abs=0.02)
        assert np.sqrt(covariance[0, 0]) < 0.1


def test_the_slope_of_the_evidence_is_its_difference_quotient():
    """A search with a wrong slope stops anywhere."""
    records = [recorded(seed)[0] for seed in (0, 1)]
    stack = campaign.Stack(records, np.mean(campaign.log_settings(records), axis=0))
    given = shared.Given.by([record.rest for record in records], *one_run(1e-3, 0.2))
    sd = np.array([0.05, 0.1, 0.2, 0.3, 2e-4, 0.15, 0.1, 3e-3])
    before = shared.Shared.before(np.zeros(shared.SETTINGS))
    stack.stretch(before.powers)
    w = campaign.whiten(stack, sd)
    scale = np.array([0.9, 1.1])
    known = campaign.fit_shared(w, scale, given, before, every_drift=True)
    stack.stretch(known.powers, known)
    stack.deviate(known)

    def log_evidence(log_sd):
        return campaign.log_evidence(stack, np.exp(log_sd), scale, given, known)[0]

    _, *found = campaign.log_evidence(stack, sd, scale, given, known)
    slope = campaign.slope_of_evidence(stack, sd, scale, *found)
    step = 1e-4 * np.eye(sd.size)
    quotient = [(log_evidence(np.log(sd) + e) - log_evidence(np.log(sd) - e)) / 2e-4 for e in step]
    # rounding of the logarithms leaves some 1e-5 of the quotient
    np.testing.assert_allclose(slope, quotient, rtol=1e-5, atol=1e-5)


# --- the cells ---


@pytest.mark.parametrize("ratio", [1.0, 3.0])
@pytest.mark.parametrize("D", [[0.6, 1.5, 2.4, 3.9], [0.1, -0.3, 2.0, -4.0]])
def test_errors_of_the_cells_are_averaged_over_all_explanations(D, ratio):
    """The zeros of either cell are unknowns of their own; their sum never shows at rest."""
    D, T, se = np.array(D), np.array([60.0, 150.0, 240.0, 400.0]), 0.05
    sliding = np.column_stack([T * ratio, T]) * 2.0 / (1.0 + ratio)
    found = rest.cell_errors(D, np.full(4, se), T, sliding)
    unit, n = 195.0, 4
    log_p, means, variances = [], [], []
    tight, slack = 1.0 / sliding.T
    for s_w, s_f, s_z, s_g in itertools.product(rest.SIZES, repeat=4):
        # unknowns: both zeros [N], gamma [-], what both move by [N] and f [-] of every run; the
        # difference of two zeros has twice the variance of each; gamma and f move no tension of
        # the sliding
        zero, move = 0.5 * (s_z * unit) ** 2, 0.5 * (s_w * unit) ** 2
        prior = np.diag([zero, zero, s_g**2, *[move] * (2 * n), *[s_f**2] * n])
        one, none = np.ones(n), np.zeros((n, n))
        see = np.column_stack([one, -one, T, np.eye(n), -np.eye(n), np.diag(T)])
        error = np.column_stack([tight, -slack, none[0], np.diag(tight), -np.diag(slack), none])
        V = see @ prior @ see.T + se**2 * np.eye(n)
        gain = error @ prior @ see.T @ np.linalg.inv(V)
        rare = sum(s > 0.0 for s in (s_w, s_f, s_z, s_g))
        log_p.append(multivariate_normal.logpdf(D, cov=V) - rare * math.log(4.0))
        means.append(gain @ D)
        variances.append(np.diag(error @ prior @ error.T - gain @ see @ prior @ error.T))
    p = np.exp(np.array(log_p) - max(log_p))
    p /= p.sum()
    mean = p @ np.array(means)
    variance = p @ (np.array(variances) + np.square(np.array(means) - mean))
    np.testing.assert_allclose(found.mean, mean, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.variance + found.shared**2, variance, rtol=1e-5)
    within = (found.spread**2 + found.away**2) @ found.probability
    np.testing.assert_allclose(within, variance, rtol=1e-5)
    np.testing.assert_allclose(found.away @ found.probability, 0.0, atol=1e-12)
