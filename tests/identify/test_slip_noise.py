"""Honest standard errors of short runs, and drives that turn backwards."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltid.identify.slip.pooled_means import pooled_means, speed_series
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


@pytest.mark.parametrize("n", [3, 5, 10])
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


def test_a_lone_short_run_is_widened_by_students_factor():
    x = np.array([0.0, 1.0, 2.0])
    mean, se, n_eff = pooled_means({"a": x}, [["a"]])["a"]
    # s = 1; the 68.27 % interval of t with 2 degrees of freedom: p = 0.8413, t = 1.3213
    assert (mean, n_eff) == (1.0, 3.0)
    assert se == pytest.approx(1.3213 / np.sqrt(3.0), rel=1e-3)


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


def test_pulleys_that_turn_against_each_other_are_no_gross_slip():
    columns, _ = drive(10, 7)
    columns["driven_speed_rad_s"][columns["run"] == "22-10"] *= -1.0
    points = {p.run: p for p in fit_slip(columns, RADIUS).points}
    assert "opposite" in points["22-10"].status
    assert {p.status for p in points.values() if p is not points["22-10"]} == {"ok"}


def test_runs_without_samples_and_with_one():
    series = {"a": np.array([np.nan, np.nan]), "b": np.array([2.0]), "c": np.arange(8.0) % 2}
    found = pooled_means(series, [["a", "b", "c"]])
    assert math.isnan(found["a"].mean)
    assert math.isnan(found["a"].se)
    assert found["b"].mean == 2.0
    # the variance of c is that of all: s² = 2/7; 68.27 % interval of t with 7 degrees: t = 1.0767
    assert found["b"].se == pytest.approx(1.0767 * math.sqrt(2.0 / 7.0), rel=1e-4)
    assert found["c"].mean == 0.5


def test_runs_within_two_percent_are_one_series():
    speeds = {f"{k}": v for k, v in enumerate([10.0, 10.1, 10.15, 10.4, 10.5, 10.55])}
    assert speed_series(speeds) == (("0", "1", "2"), ("3", "4", "5"))
    assert speed_series({}) == ((),)
    unknown = speeds | {"x": math.nan}  # a series of its own, and too short for one
    assert speed_series(unknown) == (tuple(unknown),)


def test_the_noise_of_a_series_is_one_variance():
    """se² = t² sum of squares / (all degrees of freedom) / n, for white noise and equal runs."""
    runs = {"a": np.array([1.0, 2.0, 0.0]), "b": np.array([5.0, 3.0, 4.0]), "c": np.arange(3.0)}
    found = pooled_means(runs, [list(runs)])
    # 6 squares over 6 degrees of freedom: s = 1; 68.27 % interval of t with 6 of them: t = 1.0906
    for label, mean in (("a", 1.0), ("b", 4.0), ("c", 1.0)):
        assert found[label].mean == mean
        assert found[label].se == pytest.approx(1.0906 / math.sqrt(3.0), rel=1e-4)
