"""The bending stiffness from the runs: the integral of the evidence, and synthetic benches."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "refine"))

from truth_bench import BELTS, SPEEDS, TWO, bench_and_runs
from virtual_bench import USUAL_CLASS

from beltid.errors import ConvergenceError
from beltid.identify.surface.surface import build_surface
from beltid.uncertainty import bending
from beltid.uncertainty.bending import WIDE, FittedBending, fit_bending
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.sources import all_sources


def campaign_of(
    belt: str, stated: float, scatter: float = 0.0, speeds: np.ndarray = TWO
) -> Campaign:
    """The synthetic bench of a belt, its EI stated at a multiple of the truth."""
    bench, runs, f = bench_and_runs(belt, speeds=speeds)
    rng = np.random.default_rng(1)
    beta, T_0, omega = (
        np.array([getattr(run.point, key) for run in runs]) for key in ("beta", "T_0", "omega")
    )
    exact = np.array([run.mu for run in runs])
    half = 0.5 * exact * beta
    mean = f * bench.rig.R * half / np.sinh(half)  # Eq. (8): f = (T_t - T_s)/(R mu beta)
    measured = Measured(
        R=bench.rig.R,
        arc=np.unique(np.round(beta, 5), return_inverse=True)[1].astype(np.intp),
        beta=beta,
        T_0=T_0,
        omega=omega,
        tight=mean * np.exp(half),
        slack=mean * np.exp(-half),
        mu=exact,
        mu_se=1e-4 * exact,
        order=rng.permutation(exact.size),
    ).scattered(math.hypot(scatter, 1e-4) * rng.standard_normal(exact.size))
    start = build_surface(
        np.degrees(beta), measured.normal_force, measured.slip_speed, measured.mu, measured.mu_se
    ).surface
    stiff = replace(bench.belt, EI=bench.belt.EI * stated)
    press = PressLaw(bench.law, np.zeros((2, 2)), 1.2e-4, 0.04)
    return Campaign(measured, replace(bench, belt=stiff, surface=start), press)


def fitted_with(
    log_evidence: Callable[[float], float], stated: float, monkeypatch: Any
) -> FittedBending:
    """The fit where refining the surface gives a known evidence of ln(EI/0.02)."""

    def refine(bench: Any, *_: Any, **__: Any) -> SimpleNamespace:
        value = log_evidence(math.log(bench.belt.EI / 0.02))
        if value == -math.inf:
            raise ConvergenceError("not to be simulated", iterations=1, residual=1.0)
        return SimpleNamespace(log_evidence=value, surface=bench.surface, speed_slope=0.0)

    monkeypatch.setattr(bending, "refine_surface", refine)
    monkeypatch.setattr(bending, "refined_slopes", lambda *_: None)
    monkeypatch.setattr(bending, "changes_of_residuals", lambda *_: np.zeros((48, 0)))
    return fit_bending(campaign_of("5pk", stated), TWO, ())


@pytest.mark.parametrize("stated", [0.25, 1.4583, 4.0])
@pytest.mark.parametrize("deviation", [0.003, 0.2])
def test_a_normal_evidence_gives_its_product_with_the_prior(deviation, stated, monkeypatch):
    found = fitted_with(lambda x: -0.5 * (x / deviation) ** 2 - 40.0, stated, monkeypatch)
    precision = deviation**-2 + WIDE**-2
    mean = math.log(stated) * WIDE**-2 / precision
    assert math.log(found.EI / 0.02) == pytest.approx(mean, abs=0.1 * deviation)
    assert found.relative == pytest.approx(precision**-0.5, rel=0.05)
    assert found.refinements < 20


def test_of_two_maxima_the_larger_counts_and_a_stiffness_that_cannot_be_simulated_is_left_out(
    monkeypatch,
):
    """A step from the stated value would stay at the lower one, 4 times the truth."""

    def evidence(x: float) -> float:
        if x > math.log(5.0):
            return -math.inf
        off = x - math.log(4.0)
        return max(-0.5 * (x / 0.02) ** 2, -30.0 - 0.5 * (off / 0.02) ** 2, -200.0 - abs(x))

    found = fitted_with(evidence, 4.0, monkeypatch)
    assert pytest.approx(0.02, rel=0.01) == found.EI
    assert found.relative == pytest.approx(0.02, rel=0.1)


def test_runs_that_do_not_tell_it_give_back_what_was_known(monkeypatch):
    found = fitted_with(lambda x: 0.01 * x, 1.0, monkeypatch)
    # the prior within three octaves, a normal one cut off at 1.5 of its standard deviations: half
    # of the interval between the percentiles of one standard deviation
    cut = 3.0 * math.log(2.0) / WIDE
    inside = NormalDist().cdf(cut) - NormalDist().cdf(-cut)
    share = 0.5 + (NormalDist().cdf(1.0) - 0.5) * inside
    expected = WIDE * NormalDist().inv_cdf(share)
    assert found.relative == pytest.approx(expected, rel=0.05)
    assert not found.is_determined
    assert FittedBending(0.02, 0.1, 9).is_determined


def test_no_stiffness_that_can_be_simulated_is_an_error(monkeypatch):
    with pytest.raises(
        ConvergenceError, match=r"any value between 0\.125 and 8 times the stated one"
    ):
        fitted_with(lambda _: -math.inf, 1.0, monkeypatch)


def test_a_statement_that_is_far_off_is_recognised_by_both_uncertainties():
    found = FittedBending(0.020, 0.03, 9)
    # ln 1.5 = 0.405; sqrt(0.03² + 0.04²) = 0.05
    assert found.away_from(0.030, 0.04) == pytest.approx(8.109, abs=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("belt", "stated"),
    [
        ("6pk", 1.4583),
        ("6pk", 4.0),
        ("6pk", 0.25),
        ("5pk", 0.5),
        ("5pk", 2.0),
        ("4pk", 1.0),
        ("4pk", 4.0),
    ],
)
def test_the_stiffness_of_synthetic_belts_is_found_wherever_it_was_stated(belt, stated):
    campaign = campaign_of(belt, stated)
    found = fit_bending(campaign, TWO, all_sources(USUAL_CLASS, 3, False))
    error = math.log(found.EI / BELTS[belt][1])
    assert found.relative < 0.02
    assert abs(error) < 3.0 * found.relative
    used, sources = found.used(campaign, all_sources(USUAL_CLASS, 3, False))
    assert used.bench.belt.EI == found.EI
    (own,) = (source for source in sources if source.error == "bending_stiffness")
    assert (own.size, own.basis) == (found.relative, "fitted")


@pytest.mark.long
def test_friction_that_scatters_leaves_the_stiffness_as_open_as_it_is():
    campaign = campaign_of("5pk", 2.0, scatter=0.01, speeds=SPEEDS)
    found = fit_bending(campaign, SPEEDS, all_sources(USUAL_CLASS, 3, False))
    assert 0.05 < found.relative < 0.35
    assert abs(math.log(found.EI / BELTS["5pk"][1])) < 3.0 * found.relative
