"""What the cells show before the pulley turns: records whose answer is known by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltid.identify.friction.channels import against_stated, rest_state
from beltid.identify.friction.run import RunRejected


def state(tight, slack, rounding_N=0.0):
    t = 0.02 * np.arange(tight.size)
    return rest_state(t, np.column_stack([tight, slack]), rounding_N)


def resting(n=200, tension=270.0, imbalance=4.0, noise=0.5, seed=0):
    rng = np.random.default_rng(seed)
    tight = tension + 0.5 * imbalance + noise * rng.normal(size=n)
    return tight, tension - 0.5 * imbalance + noise * rng.normal(size=n)


@pytest.mark.parametrize("signs", [(1.0, -1.0), (1.0, 0.0), (0.0, -1.0)])
def test_tensions_that_part_before_the_speed_rises_are_left_out(signs):
    tight, slack = resting()
    away = np.concatenate([np.zeros(170), np.linspace(4.0, 60.0, 30)])
    found = state(tight + signs[0] * away, slack + signs[1] * away)
    assert 168 <= found.n_samples <= 174
    assert found.imbalance_N == pytest.approx(4.0, abs=0.2)
    assert found.tension_N == pytest.approx(270.0, abs=0.1)


def test_gaps_and_outliers_at_rest_are_left_out():
    tight, slack = resting()
    tight[[5, 6]], slack[70] = np.nan, np.nan
    tight[50] += 30.0  # moves difference and mean
    tight[90], slack[90] = tight[90] + 20.0, slack[90] + 20.0  # the mean alone
    kept = np.delete(np.arange(200), [5, 6, 70, 50, 90])
    found = state(tight, slack)
    assert found.n_samples == 195
    assert found.imbalance_N == pytest.approx(np.mean((tight - slack)[kept]), rel=1e-12)
    assert found.tension_N == pytest.approx(0.5 * np.mean((tight + slack)[kept]), rel=1e-12)
    # two cells of 0.5 N; the memory of white noise is estimated, and never below one sample
    white = float(np.std((tight - slack)[kept], ddof=1)) / math.sqrt(195.0)
    assert white * 0.999 < found.imbalance_se_N < 1.3 * white


def test_too_short_a_rest():
    tight, slack = resting(3)
    assert state(tight, slack).n_samples == 3
    tight[1] = np.nan
    with pytest.raises(RunRejected, match="no rest phase"):
        state(tight, slack)


def test_coarse_converters_leave_their_rounding_in_the_imbalance():
    found = state(np.full(100, 270.0), np.full(100, 265.0), [3.0, 4.0])
    assert (found.imbalance_N, found.imbalance_se_N) == (5.0, 5.0)


def test_slopes_of_the_cells_at_rest_are_those_of_least_squares():
    t, rng = 0.02 * np.arange(200), np.random.default_rng(4)
    tight, slack = 270.0 + 0.3 * t, 268.0 - 0.1 * t
    tight, slack = tight + 0.2 * rng.normal(size=200), slack + 0.2 * rng.normal(size=200)
    found = state(tight, slack)
    for k, x in enumerate((tight - slack, tight + slack)):
        (slope, _), cov = np.polyfit(t, x, 1, cov="unscaled")
        assert found.slopes_N_s[k] == pytest.approx(slope, rel=1e-9)
        # 0.2 sqrt(2) N of noise, estimated from 200 samples, and a memory of one sample or more
        assert 0.85 < found.slope_ses_N_s[k] / (0.2 * np.sqrt(2.0 * cov[0, 0])) < 1.4
    # the last eighth, 25 samples of the mean of two cells: white noise of 0.2 / sqrt(2) N
    assert found.end_N == pytest.approx(np.mean(0.5 * (tight + slack)[-25:]), rel=1e-12)
    assert found.end_se_N == pytest.approx(0.2 / math.sqrt(2.0 * 25), rel=0.15)


# --- tensions at rest against the stated ones ---

STATED = np.repeat([50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0], 5)


def at_rest(offset: float = 0.0, factor: float = 1.0, seed: int = 0) -> np.ndarray:
    """Set to 1 % and 1 N, two runs by mistake to something else."""
    rng = np.random.default_rng(seed)
    measured = offset + factor * STATED * (1.0 + 0.01 * rng.normal(size=40)) + rng.normal(size=40)
    measured[[3, 30]] += 80.0
    return measured


def test_tensions_at_rest_are_as_stated_but_for_their_scatter() -> None:
    for seed in range(20):
        assert not against_stated(at_rest(seed=seed), STATED)
    assert not against_stated(at_rest(offset=3.0), STATED)
    assert not against_stated(at_rest(factor=0.95), STATED)
    assert not against_stated(at_rest(offset=30.0), np.full(40, np.nan))
    assert not against_stated(at_rest(offset=30.0)[:3], STATED[:3])


@pytest.mark.parametrize(
    ("change", "remedy"),
    [({"offset": 20.0}, "tension_tight_tare_N"), ({"factor": 1.0 / 4.448}, "units.rig")],
)
def test_cells_not_tared_or_in_another_unit_are_recognised(change: dict, remedy: str) -> None:
    assert remedy in against_stated(at_rest(**change), STATED)
