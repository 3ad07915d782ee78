"""Friction that shifts over a campaign beside the surface, put into the synthetic benches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from truth_bench import SPEEDS, TWO, R, bench_and_runs, solved, true_mu

from beltid.refine.effects import (
    ARC,
    BEFORE,
    COURSE,
    ORDER,
    TEMPERATURE,
    Effect,
    EstimatedEffect,
    campaign_effects,
)
from beltid.refine.evidence import Smoothness, choose_smoothness
from beltid.refine.inverse import MeasuredRun, RefinedSurface, refine_surface
from beltid.uncertainty.refined import LEAST_EVIDENCE, Refined, ShownEffect
from beltid.uncertainty.sources import Source

NOISE = 0.001
START = Smoothness(10.0, 10.0, 1.0)
N = 120
NO_MATTER = np.eye(1), np.zeros(1)
PERMUTED = np.random.default_rng(1).permutation(N)


def test_effects_that_the_runs_cannot_show_are_left_out():
    arc, unknown = np.zeros(5, dtype=int), np.full(5, np.nan)
    assert campaign_effects(arc, np.zeros(5), unknown, None) == ()
    (warm,) = campaign_effects(arc, np.zeros(5), np.array([20, 20, 30, 30, np.nan]), None)
    # a temperature that is not known is the mean; per 10 K
    np.testing.assert_allclose(warm.columns[:, 0], [-0.5, -0.5, 0.5, 0.5, 0.0])
    (at_20,) = campaign_effects(arc, np.zeros(5), np.array([20, 20, 30, 30, np.nan]), 20.0)
    np.testing.assert_allclose(at_20.columns[:, 0], [0.0, 0.0, 1.0, 1.0, 0.5])


def test_the_order_has_a_steady_change_of_one_and_bends_of_no_mean():
    steady, bends = campaign_effects(
        np.zeros(200, dtype=int), np.arange(200.0), np.full(200, np.nan), None
    )
    assert (steady.key, bends.key) == (ORDER, COURSE)
    np.testing.assert_allclose(steady.columns[[0, -1], 0], [-0.5, 0.5])
    np.testing.assert_allclose(bends.columns.mean(axis=0), 0.0, atol=0.003)
    # orthogonal to it and to each other, but for the sum in place of the integral
    products = bends.columns.T @ np.column_stack([steady.columns, bends.columns]) / 200
    expected = np.column_stack([np.zeros(3), np.diag([1 / (2 * k + 1) / k**4 for k in (2, 3, 4)])])
    np.testing.assert_allclose(products, expected, atol=0.004)


@dataclass(frozen=True)
class Shifted:
    """A campaign whose friction shifts: change of ln mu, order and temperature of its runs."""

    change: np.ndarray
    order: np.ndarray
    temperature: np.ndarray


def run_in(order: np.ndarray) -> Shifted:
    """5 % more from the first run to the last."""
    return Shifted(0.05 * (order / (N - 1) - 0.5), order, np.full(N, np.nan))


def quick_run_in(order: np.ndarray) -> Shifted:
    """5 % within some 90 runs, its mean taken off."""
    change = -0.05 * np.exp(-order / 30.0)
    return Shifted(change - change.mean(), order, np.full(N, np.nan))


def warm(order: np.ndarray, temperature: np.ndarray) -> Shifted:
    """2 % less by 10 K."""
    return Shifted(-0.002 * (temperature - temperature.mean()), order, temperature)


def refined(shifted: Shifted, seed: int = 0, reference: float | None = None) -> RefinedSurface:
    bench, runs, _ = bench_and_runs("5pk")
    _, arc = np.unique([round(run.point.beta, 6) for run in runs], return_inverse=True)
    noise = NOISE * np.random.default_rng(seed).normal(size=N)
    factor = np.exp(solved("5pk").response * shifted.change + noise)
    runs = [
        replace(
            run,
            mu=run.mu * by,
            mu_se=NOISE * run.mu * by,
            arc=int(k),
            order=int(place),
            temperature_degC=float(T),
        )
        for run, by, k, place, T in zip(
            runs, factor, arc, shifted.order, shifted.temperature, strict=True
        )
    ]
    return refine_surface(bench, runs, SPEEDS, reference_degC=reference)


def errors_of(found: RefinedSurface, factor: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Errors of ln mu at the nodes within the forces of the runs, and their standard errors."""
    _, runs, f = bench_and_runs("5pk")
    surface, error, size = found.surface, [], []
    for j, v in enumerate(SPEEDS):
        mine = [i for i, run in enumerate(runs) if abs(run.point.omega * R / v - 1) < 0.02]
        force = surface.normal_force_N_m
        seen = (force >= f[mine].min()) & (force <= f[mine].max())
        error.append(np.log(surface.mu_nodes[seen, j] / true_mu("5pk", force[seen], v)) - factor)
        size.append(surface.mu_se_nodes[seen, j] / surface.mu_nodes[seen, j])
    return np.concatenate(error), np.concatenate(size)


def number(found: RefinedSurface, key: str) -> tuple[float, float]:
    effect = found.effect(key)
    return effect.values[0], np.sqrt(effect.covariance[0, 0])


@pytest.mark.parametrize(
    ("shift", "order", "steady"),
    [
        pytest.param(run_in, PERMUTED, 0.0005, id="steady, random", marks=pytest.mark.long),
        pytest.param(quick_run_in, np.arange(N), 0.012, id="quick, sorted by arcs"),
        pytest.param(
            run_in, np.arange(N), 0.012, id="steady, sorted by arcs", marks=pytest.mark.long
        ),
        pytest.param(quick_run_in, PERMUTED, 0.0005, id="quick, random", marks=pytest.mark.long),
    ],
)
def test_a_run_in_is_found_and_leaves_the_surface(shift, order, steady):
    shifted = shift(order)
    found = refined(shifted)
    # the straight part of the course, least squares
    expected = np.polyfit(order / (N - 1), shifted.change, 1)[0]
    size, u = number(found, ORDER)
    assert size == pytest.approx(expected, abs=3.0 * u)
    assert u < steady
    assert size > 3.0 * u
    error, se = errors_of(found)
    assert np.sqrt(np.mean(error**2)) < 0.0015
    assert np.sqrt(np.mean(np.square(error / se))) < 1.5  # one draw, its nodes move together
    assert found.noise_scale < 1.3


def test_a_temperature_is_found_and_corrected_to_the_one_asked_for():
    rng = np.random.default_rng(2)
    shifted = warm(PERMUTED, 20.0 + 15.0 * rng.random(N))
    found = refined(shifted, reference=22.0)
    size, u = number(found, TEMPERATURE)
    assert size == pytest.approx(-0.02, abs=3.0 * u)
    assert u < 0.001
    error, se = errors_of(found, -0.002 * (22.0 - shifted.temperature.mean()))
    assert np.sqrt(np.mean(error**2)) < 0.0015
    assert np.sqrt(np.mean(np.square(error / se))) < 1.5  # one draw, its nodes move together


@pytest.mark.long
def test_a_temperature_that_rises_with_the_order_cannot_be_distinguished_from_it_unless_asked_for():
    shifted = warm(np.arange(N), np.linspace(20.0, 35.0, N))
    found = refined(shifted)
    for key, half in ((ORDER, -0.015), (TEMPERATURE, -0.010)):
        size, u = number(found, key)
        assert u > 0.5 * abs(half)  # either may be the other
    error, _ = errors_of(found)
    assert np.sqrt(np.mean(error**2)) < 0.0015
    asked = refined(shifted, reference=22.0)
    size, _ = number(asked, TEMPERATURE)
    assert size == pytest.approx(-0.02, abs=0.004)
    error, _ = errors_of(asked, -0.002 * (22.0 - 27.5))
    assert np.sqrt(np.mean(error**2)) < 0.003


def test_friction_that_scatters_from_run_to_run_is_no_noise_of_the_cells():
    scatter = 0.01 * np.random.default_rng(4).normal(size=N)
    found = refined(Shifted(scatter, PERMUTED, np.full(N, np.nan)))
    assert found.smoothness.scatter == pytest.approx(np.std(scatter), rel=0.15)
    # stated: 0.1 %
    assert found.noise_scale == pytest.approx(np.std(scatter) / NOISE, rel=0.15)
    error, se = errors_of(found)
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert np.sqrt(np.mean(np.square(error / se))) < 1.5  # one draw, its nodes move together


def test_a_campaign_in_which_nothing_shifts_shows_nothing():
    found = refined(
        Shifted(np.zeros(N), PERMUTED, 20.0 + 15.0 * np.random.default_rng(6).random(N))
    )
    for key in (ORDER, TEMPERATURE):
        size, u = number(found, key)
        assert abs(size) < 3.0 * u < 0.003
    assert found.smoothness.scatter < 0.001


def usual_errors(runs: list[MeasuredRun]) -> np.ndarray:
    """Changes of ln mu by Eq. (6): arc settings by 0.2°, gains by 0.1 %, offsets by 0.05 N."""
    mu, beta, T_0 = np.array([(run.mu, run.point.beta, run.point.T_0) for run in runs]).T
    _, arc = np.unique(np.round(beta, 6), return_inverse=True)
    ratio = np.exp(mu * beta)
    slack = 2.0 * T_0 / (1.0 + ratio)
    of_cells = np.column_stack([np.full((N, 2), 0.001), 0.05 / slack, 0.05 / (slack * ratio)])
    of_arcs = np.radians(0.2) * np.eye(3)[arc] / beta[:, None]
    return np.column_stack([of_arcs, of_cells / (mu * beta)[:, None]])


def test_effects_that_are_absent_cost_the_surface_little():
    """Against a solution that knows neither effects nor errors, on draws of noise alone.

    In a campaign sorted by arcs, errors as large as stated would take part of every effect, and
    what is left of an absent one would be noise: 2.1 times the error.
    """
    bench, runs, force = bench_and_runs("5pk", 0.0005)
    _, arc = np.unique([round(run.point.beta, 6) for run in runs], return_inverse=True)
    runs = [replace(run, arc=int(arc[i]), order=i) for i, run in enumerate(runs)]
    found = refine_surface(bench, runs, SPEEDS, stated=usual_errors(runs))
    log_force = found.curves.log_force
    # a power law at each speed, so that no error is one of smoothness
    law = np.concatenate([np.log(true_mu("5pk", np.exp(log_force), v)) for v in SPEEDS])
    within = found.curves.basis(np.log(np.geomspace(force.min(), force.max(), 40)))
    looked_at = np.kron(np.eye(SPEEDS.size), within)
    squares = []
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(size=N)
        model = replace(found.model, y=found.model.J @ law + noise)
        alone = replace(model, stated=None, effects=(), before=())
        solutions = [m.solve_surface(choose_smoothness(m, START)) for m in (model, alone)]
        squares.append([np.mean((looked_at @ (s.parameters - law)) ** 2) for s in solutions])
    of_both = np.sqrt(np.mean(squares, axis=0))
    assert of_both[1] < 0.0005  # the noise of a run
    assert of_both[0] < 1.25 * of_both[1]


def few_runs(by: str) -> RefinedSurface:
    """Six tensions at two speeds and one arc, in the order of their forces or in random order."""
    bench, runs, force = bench_and_runs("5pk")
    arcs, speeds = (
        np.array([getattr(run.point, key) for run in runs]) for key in ("beta", "omega")
    )
    middle = np.isclose(np.degrees(arcs), 68.0, atol=0.5)
    mine = np.flatnonzero(middle & np.isin(speeds, np.unique(speeds)[[2, 4]]))
    place = {"force": force[mine], "random": np.random.default_rng(1).random(mine.size)}[by]
    mine = mine[np.argsort(place)]
    ordered = [replace(runs[i], mu_se=NOISE * runs[i].mu, order=k) for k, i in enumerate(mine)]
    return refine_surface(bench, ordered, SPEEDS[[2, 4]])


def test_an_order_that_goes_with_the_force_is_explained_by_the_surface():
    assert few_runs("force").effect(ORDER).explained[0] > 0.95
    assert few_runs("random").effect(ORDER).explained[0] < 0.7


def test_what_the_surface_explains_is_no_clear_effect():
    assert ShownEffect(ORDER, 0.05, 0.01, explained=0.5).is_clear
    assert not ShownEffect(ORDER, 0.05, 0.01, explained=0.95).is_clear


def test_what_no_usual_campaign_shows_is_named():
    """Errors beyond three of their standard uncertainties, the largest of each name; effects, too.

    ln s of an order effect is expected at ln 1 % ± 1.5, so that 98 % of them are below 20 %.
    """
    sources = tuple(Source(name, "arc", 0, 1.0, "", 1.0, "") for name in ("cells", "cells", "arc"))
    refined = SimpleNamespace(stated=np.array([3.5, -4.0, 2.0]))
    assert Refined(refined, None, sources, None).contradictions() == {"cells": 4.0}
    for size, unusual in ((-0.21, True), (0.19, False)):
        order = EstimatedEffect(
            Effect(ORDER, np.eye(1), BEFORE[ORDER]), 0.1, np.array([size]), *NO_MATTER
        )
        assert order.largest_usual == pytest.approx(0.2009, rel=1e-3)
        assert order.is_unusual is unusual


def two_arcs(order: np.ndarray) -> RefinedSurface:
    """32 runs at two arcs, the friction at the longer one 2 % higher."""
    bench, runs, _ = bench_and_runs("5pk", speeds=TWO)
    runs = [run for run in runs if not np.isclose(np.degrees(run.point.beta), 68.0, atol=0.5)]
    longer = np.array([run.point.beta > 1.0 for run in runs])
    noise = 0.003 * np.random.default_rng(8).normal(size=longer.size)
    factor = np.exp(0.02 * longer + noise)
    shifted = [
        replace(run, mu=run.mu * by, mu_se=0.003 * run.mu * by, arc=int(k), order=int(place))
        for run, by, k, place in zip(runs, factor, longer, order, strict=True)
    ]
    return refine_surface(bench, shifted, TWO)


def test_arcs_are_not_distinguished_from_the_order_of_a_campaign_that_is_sorted_by_arc():
    sorted_by_arc = two_arcs(np.arange(32))
    at_random = two_arcs(np.random.default_rng(3).permutation(32))
    # one of the two is there in either case, and only at random it is known which
    assert sorted_by_arc.log_evidence_for(ARC, ORDER) > LEAST_EVIDENCE
    assert sorted_by_arc.log_evidence_for(ARC) < LEAST_EVIDENCE
    assert at_random.log_evidence_for(ARC) > LEAST_EVIDENCE
    assert at_random.log_evidence_for(ORDER) < 1.0


def test_a_large_effect_without_evidence_is_not_clear():
    assert ShownEffect(ARC, 0.05, 0.01, log_evidence=4.0).is_clear
    alone = ShownEffect(ARC, 0.05, 0.01, log_evidence=1.0)
    assert alone.is_large
    assert not alone.is_clear


@pytest.mark.long
def test_intervals_hold_the_truth_over_many_draws():
    inside = []
    for seed in range(12):
        order = np.random.default_rng(100 + seed).permutation(N)
        error, se = errors_of(refined(run_in(order), seed))
        inside.append(np.abs(error) < 1.96 * se)
    assert 0.88 <= np.mean(inside) <= 0.995
