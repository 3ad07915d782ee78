"""The judge is judged: what the virtual rigs say is true, is."""

from __future__ import annotations

import numpy as np
import pytest
from virtual_rig import BELTS, CASES, Case, Drawn, Noise, Recipe, draw

QUIET = Recipe(peak=0.0, noise=0.0, ripple=0.0)


def end_of(drawn: Drawn, run: int, part: float) -> dict[str, np.ndarray]:
    """The last part of the samples of a run."""
    rows = np.flatnonzero(drawn.columns["run"] == run)
    rows = rows[round((1.0 - part) * rows.size) :]
    return {name: values[rows] for name, values in drawn.columns.items()}


def apparent(drawn: Drawn, part: float) -> np.ndarray:
    """Eq. (6) on the means of the last part of every run."""
    ends = [end_of(drawn, run, part) for run in range(drawn.mu.size)]
    ratio = np.array([np.mean(e["tension_tight_N"]) / np.mean(e["tension_slack_N"]) for e in ends])
    return np.log(ratio) / np.radians(drawn.arc_deg)


@pytest.mark.parametrize("belt", BELTS)
def test_a_quiet_run_without_a_peak_shows_its_truth(belt: str) -> None:
    drawn = draw(Case("quiet", QUIET, belt=BELTS[belt]), 120)
    np.testing.assert_allclose(apparent(drawn, 0.5), drawn.mu, rtol=1e-12)
    law = BELTS[belt]
    force = 2.0 * drawn.initial_tension_N * np.tanh(0.5 * drawn.mu * np.radians(drawn.arc_deg))
    force /= 0.05 * drawn.mu * np.radians(drawn.arc_deg)
    growth = np.log1p(drawn.omega * 0.05 / law.v0) / np.log1p(0.01 / law.v0)
    expected = law.mu0 * (force / 5400.0) ** -law.a * (1.0 + law.c * (growth - 1.0))
    np.testing.assert_allclose(drawn.mu, expected, rtol=1e-9)


def test_the_truth_of_a_drift_is_the_mean_over_the_second_half_of_the_sliding() -> None:
    # 5 s of sliding less a build-up of 0.2 s: its second half is the last 2.4 of 6 s
    drawn = draw(Case("drift", QUIET.but(rate=1000.0, drift=0.04)), 1)
    end = end_of(drawn, 0, 0.4)
    mu = np.log(end["tension_tight_N"] / end["tension_slack_N"]) / np.radians(82.0)
    assert np.mean(mu) == pytest.approx(drawn.mu[0], rel=1e-5)
    assert drawn.mu[0] == pytest.approx(0.8 * 1.03)


def test_the_tension_at_the_start_is_that_of_the_relaxed_belt() -> None:
    drawn = draw(Case("relaxed", QUIET.but(rest=30.0, duration=36.0, relaxation=0.03)), 1)
    first = np.argmax(drawn.columns["pulley_speed_rad_s"] > 0.1)
    at_start = drawn.columns["tension_tight_N"][first]
    assert at_start == pytest.approx(drawn.initial_tension_N[0], rel=1e-6)
    assert at_start == pytest.approx(270.0 * (1.0 - 0.03 * (1.0 - np.exp(-3.0))))


@pytest.mark.parametrize(
    ("part", "first", "last"),
    [
        (Noise("ar", 0.5, 1.0), 0.5, 0.5),
        (Noise("walk", 0.5, 6.0), 0.03, 0.5),
        (Noise("1/f", 0.5), 0.55, 0.55),
        (Noise("ar", 0.5, 1.0, "opposite"), 0.5, 0.5),
    ],
)
def test_slow_noise_has_its_size(part: Noise, first: float, last: float) -> None:
    drawn = draw(Case("slow", QUIET.but(slow=(part,))), 600)
    tight = drawn.columns["tension_tight_N"].reshape(600, -1)
    slack = drawn.columns["tension_slack_N"].reshape(600, -1)
    assert np.std(tight[:, 0]) == pytest.approx(first, rel=0.15)
    assert np.std(tight[:, -1]) == pytest.approx(last, rel=0.15)
    alike = np.corrcoef(tight[:, 0], slack[:, 0])[0, 1]
    assert alike == pytest.approx(-1.0 if part.cells == "opposite" else 0.0, abs=0.08)


def test_neighbours_correlate_as_the_recipe_says() -> None:
    drawn = draw(Case("memory", QUIET.but(noise=0.5, memory=0.9, duration=1.0)), 2000)
    tight = drawn.columns["tension_tight_N"].reshape(2000, -1)
    assert np.std(tight) == pytest.approx(0.5, rel=0.05)
    assert np.corrcoef(tight[:, 10], tight[:, 11])[0, 1] == pytest.approx(0.9, abs=0.02)


def test_a_fifth_of_the_sliding_samples_is_clipped() -> None:
    drawn = draw("tight cell clipped in 20 % of the sliding samples", 20)
    for run in range(20):
        c = end_of(drawn, run, 1.0)
        most = np.count_nonzero(c["tension_tight_N"] == np.max(c["tension_tight_N"]))
        assert most / np.count_nonzero(c["pulley_speed_rad_s"] > 0.02) == pytest.approx(
            0.2, abs=0.03
        )


def test_a_second_start_has_its_own_speed_and_friction() -> None:
    recipe = QUIET.but(idle=1.0, again=(2.0, 1.04))
    drawn = draw(Case("again", recipe), 1)
    assert apparent(drawn, 0.3)[0] == pytest.approx(1.04 * drawn.mu[0], rel=1e-12)
    assert end_of(drawn, 0, 0.1)["pulley_speed_rad_s"] == pytest.approx(0.42)
    assert drawn.columns["time_s"][-1] == pytest.approx(11.98)


def test_the_same_seed_draws_the_same_bench_and_a_campaign_holds_every_setting() -> None:
    for case in list(CASES)[::9]:
        one, same, other = draw(case, 5, 1), draw(case, 5, 1), draw(case, 5, 2)
        for name, values in one.columns.items():
            np.testing.assert_array_equal(values, same.columns[name])
        assert not np.array_equal(one.columns["tension_tight_N"], other.columns["tension_tight_N"])
    drawn = draw("campaign 3pk", 120)
    first = np.unique(drawn.columns["run"], return_index=True)[1]
    settings = zip(
        drawn.arc_deg, drawn.columns["initial_tension_N"][first], drawn.omega, strict=True
    )
    assert len(set(settings)) == 120
