"""The steady window and the model of the sliding phase, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from beltid.identify.friction.plateau import PlateauCriteria, settle
from beltid.identify.friction.sliding import fit_sliding
from beltid.identify.friction.steady_window import steady_window

from beltid.identify.estimators.signal import (
    NOISE_FLOOR,
    block_means,
    difference_sigma,
    parabolic_maximum,
    spike_mask,
    strongest_line,
)
from beltid.identify.friction.rest_phase import SetAsideError

CRITERIA = PlateauCriteria(steady_tolerance=0.005, max_drift=0.02, min_samples=12, min_fraction=0.2)
T = np.linspace(0.0, 10.0, 500)


def window_start(signal: np.ndarray, tolerance: float = 0.01) -> float | None:
    window = steady_window(T, signal, tolerance, min_samples=12, min_fraction=0.2)
    return None if window is None else float(T[window.first])


def test_constant_signal_is_steady_from_its_start() -> None:
    # up to the samples that do not fill a block
    assert window_start(np.ones(500)) == 0.0
    noisy = np.ones(500) + 0.05 * np.random.default_rng(0).normal(size=500)
    assert window_start(noisy) == 0.0


def test_window_starts_where_an_exponential_has_decayed_to_the_tolerance() -> None:
    start = window_start(1.0 + 0.1 * np.exp(-T))
    # change over the window exp(-s) * 0.1 <= 0.01 at s = ln 10 = 2.3; blocks are 0.42 s long
    assert start is not None
    assert 1.5 < start < 3.6


def test_ramp_has_no_steady_window_unless_its_last_part_is_within_the_tolerance() -> None:
    assert window_start(1.0 + 0.02 * T) is None
    start = window_start(1.0 + 0.002 * T)
    assert start is not None
    assert 10.0 - start <= 0.01 / 0.002 + 0.42


def test_short_peak_at_the_start_does_not_hide_behind_the_medians() -> None:
    signal = np.ones(500)
    signal[:20] += 0.2
    start = window_start(signal)
    assert start is not None
    assert start > T[19]


def test_sawtooth_of_stick_slip_is_not_steady() -> None:
    assert window_start(1.0 + 0.2 * ((T / 3.0) % 1.0)) is None


def model(level: tuple[float, float], tail: tuple[float, float], tau: float) -> np.ndarray:
    return np.array(level) + np.array(tail) * np.exp(-T / tau)[:, None]


def test_fit_returns_levels_tail_and_ripple_of_a_noise_free_signal() -> None:
    wave = np.sin(2.0 * np.pi * T / 1.7 + 0.4)[:, None] * [1.5, 0.5]
    fit = fit_sliding(T, model((400.0, 120.0), (20.0, -3.0), 1.8) + wave, np.array([0.01, 0.01]))
    np.testing.assert_allclose(fit.levels, [400.0, 120.0], rtol=NOISE_FLOOR)
    np.testing.assert_allclose(fit.tail, [20.0, -3.0], rtol=2e-3)
    assert fit.tau == pytest.approx(1.8, rel=2e-3)
    assert 1.0 / fit.lines[0] == pytest.approx(1.7, rel=1e-3)
    np.testing.assert_allclose(fit.ripple_N, [1.5, 0.5], rtol=0.01)


def test_standard_error_of_a_constant_in_white_noise_is_that_of_a_mean() -> None:
    rng = np.random.default_rng(5)
    ratios, errors = [], []
    for _ in range(60):
        noisy = np.array([400.0, 120.0]) + rng.normal(size=(500, 2)) * [0.5, 0.4]
        fit = fit_sliding(T, noisy, np.array([0.5, 0.4]))
        ratios.append(fit.log_ratio)
        errors.append(fit.log_ratio_se)
    expected = np.hypot(0.5 / 400.0, 0.4 / 120.0) / np.sqrt(500.0)
    assert np.median(errors) == pytest.approx(expected, rel=0.15)
    assert np.std(ratios) == pytest.approx(expected, rel=0.35)


def test_settle_takes_off_a_tail_that_lasts_to_the_end() -> None:
    rng = np.random.default_rng(2)
    noisy = model((400.0, 120.0), (20.0, -3.0), 3.5) + 0.3 * rng.normal(size=(500, 2))
    plateau = settle(T, noisy, CRITERIA)
    true = np.log(400.0 / 120.0)
    mean_of_last_fifth = np.mean(np.log(noisy[400:, 0] / noisy[400:, 1]))
    assert abs(mean_of_last_fifth - true) > 0.005  # the tail is still in there
    assert abs(np.log(plateau.levels[0] / plateau.levels[1]) - true) < 0.002


def test_settle_leaves_a_tail_of_another_shape_out_of_the_fit() -> None:
    rng = np.random.default_rng(4)
    late = 60.0 * np.exp(-T / 0.2) + 12.0 * np.exp(-T / 2.0)
    tensions = np.column_stack([400.0 + late, 120.0 - 0.2 * late])
    plateau = settle(T, tensions + 0.3 * rng.normal(size=(500, 2)), CRITERIA)
    ratio = np.log(plateau.levels[0] / plateau.levels[1])
    assert not plateau.from_start
    assert abs(ratio / np.log(400.0 / 120.0) - 1.0) < 0.001


def test_settle_refuses_what_does_not_settle() -> None:
    with pytest.raises(SetAsideError, match=r"rises|changes by \+"):
        settle(T, np.column_stack([300.0 + 10.0 * T, 150.0 - 3.0 * T]), CRITERIA)
    with pytest.raises(SetAsideError, match="too short"):
        settle(T[:7], np.ones((7, 2)), CRITERIA)


def test_settle_accepts_a_rise_that_is_over_and_refuses_one_that_goes_on() -> None:
    """A swing before a level that lasts, as in a simulated start; a drift over the same part."""
    t = np.concatenate([np.linspace(0.0, 0.1, 120, endpoint=False), np.linspace(0.1, 1.0, 180)])
    swing = -0.06 * np.exp(-t / 0.05) * np.cos(2.0 * np.pi * t / 0.12)
    over = np.log(2.0) * (1.0 + swing)
    still = np.log(2.0) * (1.0 + 0.05 * t)
    assert np.ptp(over[t > 0.5]) < 1e-4
    tensions = [np.column_stack([300.0 * np.exp(y), np.full(t.size, 300.0)]) for y in (over, still)]
    plateau = settle(t, tensions[0], CRITERIA)
    assert np.log(plateau.levels[0] / plateau.levels[1]) == pytest.approx(np.log(2.0), rel=1e-3)
    with pytest.raises(SetAsideError, match=r"rises|changes by \+"):
        settle(t, tensions[1], CRITERIA)


def test_spikes_are_found_at_the_ends_and_steep_edges_are_none() -> None:
    rng = np.random.default_rng(1)
    x = np.where(np.arange(200) < 100, 50.0, 150.0) + 0.5 * rng.normal(size=200)
    assert not np.any(spike_mask(x, 6.0))
    spiked = [0, 40, 41, 160, 199]
    x[spiked] += 20.0
    assert np.flatnonzero(spike_mask(x, 6.0)).tolist() == spiked


def test_noise_from_differences_ignores_a_slope_and_survives_coarse_steps() -> None:
    rng = np.random.default_rng(3)
    x = 3.0 + 0.01 * np.arange(5000) + rng.normal(size=5000)
    assert difference_sigma(x) == pytest.approx(1.0, rel=0.05)
    assert difference_sigma(np.round(0.2 * x)) > 0.1
    assert difference_sigma(np.ones(10)) == 0.0


def test_block_means_keep_the_mean_and_the_limit() -> None:
    x = np.random.default_rng(0).normal(size=(10_000, 2))
    thin = block_means(x, 1000)
    assert thin.shape == (1000, 2)
    np.testing.assert_allclose(np.mean(thin, axis=0), np.mean(x, axis=0), atol=1e-15)
    assert block_means(x[:10], 1000).shape == (10, 2)
    np.testing.assert_allclose(block_means(np.arange(7.0)[:, None], 3)[:, 0], [1.0, 4.0, 6.0])


def test_line_is_found_on_uneven_times_and_white_noise_has_none() -> None:
    rng = np.random.default_rng(6)
    basis = np.full((500, 1), 1.0 / np.sqrt(500.0))
    false = 0
    for _ in range(40):
        noise = rng.normal(size=(500, 2))
        false += strongest_line(T, noise - np.mean(noise, axis=0), basis) is not None
    assert false <= 1
    t = np.sort(rng.uniform(0.0, 10.0, 500))
    wave = np.sin(2.0 * np.pi * 0.83 * t)[:, None] * [1.0, 0.3] + 0.3 * noise
    found = strongest_line(t, (wave - np.mean(wave, axis=0)) / 0.5, basis)
    assert found == pytest.approx(0.83, rel=0.01)


def test_parabola_through_three_points_gives_its_vertex() -> None:
    x = np.linspace(0.0, 1.0, 6)
    assert parabolic_maximum(x, -((x - 0.53) ** 2)) == pytest.approx(0.53)
    assert parabolic_maximum(x, x) == 1.0
