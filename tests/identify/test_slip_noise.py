"""Honest standard errors of short runs, and drives that turn backwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltid.identify.slip.noise import (
    pooled_correlation_time,
    pooled_means,
    pooled_variance,
    speed_series,
)
from beltid.identify.slip.slip import fit_slip

RADIUS, CREEP = 0.05, 0.01
TORQUES = np.arange(17.0)


def drive(n, seed, *, torque=TORQUES, speeds=(22.0, 62.8), noise=3e-3, shaking=1.0):
    """Synthetic drive of `n` samples per run and the true sliding speed of each run [m/s]."""
    rng = np.random.default_rng(seed)
    runs, true = [], []
    for speed in speeds:
        for k, moment in enumerate(torque):
            e = noise * rng.normal(size=(2, n)) * (shaking if k == 9 else 1.0)
            true.append(CREEP * moment * RADIUS)
            runs.append(
                {
                    "run": np.full(n, f"{speed:g}-{k:02d}"),
                    "initial_tension_N": np.full(n, 310.0),
                    "torque_N_m": moment + 0.02 * rng.normal(size=n),
                    "driver_speed_rad_s": speed + e[0],
                    "driven_speed_rad_s": speed - CREEP * moment + e[1],
                }
            )
    return {name: np.concatenate([r[name] for r in runs]) for name in runs[0]}, np.array(true)


def pulls(n, seeds=8, **settings):
    found = []
    for seed in range(seeds):
        columns, true = drive(n, seed, **settings)
        points = fit_slip(columns, RADIUS).points
        assert {p.status for p in points} == {"ok"}
        v = np.array([p.slip_speed_m_s for p in points])
        found.append((v - true) / [p.slip_speed_se_m_s for p in points])
    return np.concatenate(found)


@pytest.mark.parametrize("n", [3, 4, 5, 6, 8, 10])
def test_standard_errors_of_short_runs_are_honest(n):
    z = pulls(n)
    assert 0.85 < np.sqrt(np.mean(z**2)) < 1.2
    # 272 values: three binomial standard deviations
    assert np.mean(np.abs(z) < 1.0) == pytest.approx(0.683, abs=0.085)
    assert np.mean(np.abs(z) < 2.0) == pytest.approx(0.954, abs=0.038)


@pytest.mark.parametrize("n", [4, 10])
def test_a_run_that_shakes_keeps_a_wider_error(n):
    columns, _ = drive(n, 0, shaking=5.0)
    points = fit_slip(columns, RADIUS).points
    se = np.array([p.slip_speed_se_m_s for p in points])
    calm = np.median(np.delete(se, [9, 26]))
    assert np.min(se[[9, 26]]) > 2.0 * calm


def test_a_shaking_run_does_not_spoil_the_errors_of_the_others():
    assert 0.8 < np.sqrt(np.mean(pulls(10, shaking=5.0) ** 2)) < 1.3


def test_a_lone_short_run_is_widened_by_students_factor():
    x = np.array([0.0, 1.0, 2.0])
    mean, se, n_eff = pooled_means({"a": x}, [["a"]])["a"]
    # s = 1; the 68.27 % interval of t with 2 degrees of freedom: p = 0.8413, t = 1.3213
    assert (mean, n_eff) == (1.0, 3.0)
    assert se == pytest.approx(1.3213 / np.sqrt(3.0), rel=1e-3)


def test_spikes_are_found_by_the_spread_of_the_series_and_no_good_sample_is():
    rng = np.random.default_rng(1)
    samples = {f"{i}": rng.normal(size=4) for i in range(30)}
    samples["5"][2] += 100.0
    found = pooled_means(samples, [list(samples)])
    assert [label for label, m in found.items() if m.n_eff < 4.0] == ["5"]
    assert abs(found["5"].mean) < 3.0


def test_equal_variances_are_pooled_and_unequal_ones_are_not():
    rng = np.random.default_rng(2)
    dof = np.full(400, 4.0)
    variance, pooled = pooled_variance(2.5 * rng.chisquare(4, 400) / 4, dof)
    assert variance == pytest.approx(2.5, rel=0.1)
    # the variance of ln s² is known to 0.058 by 400 runs; twice that is a trigamma of 18/2
    assert pooled > 18.0
    # variances that scatter as an inverse chi-square of 6 degrees of freedom
    spread = 2.5 * 6.0 / rng.chisquare(6, 400)
    variance, pooled = pooled_variance(spread * rng.chisquare(4, 400) / 4, dof)
    assert variance == pytest.approx(2.5, rel=0.15)
    assert pooled == pytest.approx(6.0, rel=0.4)
    assert pooled_variance(np.array([1.0, 0.0]), np.array([2.0, 2.0])) == (0.0, 0.0)


def test_the_correlation_of_short_runs_is_seen_together():
    rng = np.random.default_rng(3)
    runs = []
    for _ in range(60):
        x = rng.normal(size=300)
        for j in range(1, x.size):
            x[j] = 0.6 * x[j - 1] + 0.8 * x[j]
        runs.append(x[-20:] - np.mean(x[-20:]))
    # an autoregression of first order in 20 samples: 1 + 2 sum (1 - k/20) 0.6^k
    assert pooled_correlation_time(runs) == pytest.approx(3.625, rel=0.2)
    white = [r - r.mean() for r in rng.normal(size=(60, 4))]
    assert pooled_correlation_time(white) == pytest.approx(1.0, abs=0.3)


def test_series_are_runs_of_one_speed_unless_a_speed_has_too_few():
    speeds = {"a": 10.0, "b": 50.0, "c": 10.1, "d": -10.05, "e": 50.2, "f": 49.9}
    assert [set(s) for s in speed_series(speeds)] == [{"a", "c", "d"}, {"b", "e", "f"}]
    assert speed_series(speeds | {"g": 80.0}) == (("a", "b", "c", "d", "e", "f", "g"),)
    assert speed_series(speeds | {"g": float("nan")}) == (("a", "b", "c", "d", "e", "f", "g"),)


@pytest.mark.parametrize("signed_torque", [False, True])
def test_a_drive_that_turns_backwards_is_the_mirrored_one(signed_torque):
    columns, true = drive(10, 4)
    forward = fit_slip(columns, RADIUS)
    turned = ["driver_speed_rad_s", "driven_speed_rad_s"] + ["torque_N_m"] * signed_torque
    backward = fit_slip(columns | {name: -columns[name] for name in turned}, RADIUS)
    sign = -1.0 if signed_torque else 1.0
    assert backward.points == tuple(
        replace(p, driver_speed_rad_s=-p.driver_speed_rad_s, torque_N_m=sign * p.torque_N_m)
        for p in forward.points
    )
    assert backward.max_slip_speed_m_s == forward.max_slip_speed_m_s
    assert [p.slip_speed_m_s for p in backward.points] == pytest.approx(true, abs=4e-4)
    assert backward.notes[0].startswith("the drive turns backwards in all runs: sign of the speeds")
    assert ("torque" in backward.notes[0]) == signed_torque
    assert not any("backwards" in note for note in forward.notes)


def test_single_runs_that_turn_backwards_are_named():
    columns, _ = drive(10, 5)
    forward = fit_slip(columns, RADIUS)
    part = np.isin(columns["run"], ["22-03", "62.8-05"])
    for name in ("driver_speed_rad_s", "driven_speed_rad_s"):
        columns[name] = np.where(part, -columns[name], columns[name])
    result = fit_slip(columns, RADIUS)
    assert [p.driver_speed_rad_s < 0 for p in result.points].count(True) == 2
    assert [abs(p.driver_speed_rad_s) for p in result.points] == [
        p.driver_speed_rad_s for p in forward.points
    ]
    for name in ("slip_speed_m_s", "slip_speed_se_m_s", "speed_loss_rad_s", "torque_N_m", "status"):
        assert [getattr(p, name) for p in result.points] == [
            getattr(p, name) for p in forward.points
        ]
    assert "the drive turns backwards in 22-03, 62.8-05: sign of the speeds turned" in result.notes


def test_exchanged_pulleys_are_seen_backwards_too():
    columns, _ = drive(10, 6)
    exchanged = columns | {
        "driver_speed_rad_s": -columns["driven_speed_rad_s"],
        "driven_speed_rad_s": -columns["driver_speed_rad_s"],
    }
    status = {p.run: p.status for p in fit_slip(exchanged, RADIUS).points}
    assert status["22-00"] == "ok"
    assert "gains" in status["22-10"]


def test_pulleys_that_turn_against_each_other_are_no_gross_slip():
    columns, _ = drive(10, 7)
    part = columns["run"] == "22-10"
    columns["driven_speed_rad_s"] = np.where(
        part, -columns["driven_speed_rad_s"], columns["driven_speed_rad_s"]
    )
    points = {p.run: p for p in fit_slip(columns, RADIUS).points}
    assert "opposite" in points["22-10"].status
    assert {p.status for p in points.values() if p is not points["22-10"]} == {"ok"}
