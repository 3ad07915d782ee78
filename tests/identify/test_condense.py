"""Long runs are averaged over blocks: same numbers, same doubts, spikes and gaps still found."""

from __future__ import annotations

import numpy as np
import pytest
from virtual_rig import RADIUS_M, Recipe, record

from beltid.identify.friction.channels import BLOCKS, Channels, condensed, read_channels
from beltid.identify.friction.reduction import reduce_runs
from beltid.identify.friction.run import RunRecord, RunReduction

ARC_DEG, MU, TENSION_N, NOISE_N = 82.0, 0.47, 270.0, 0.5
N = 60_000


def long_run(seed: int = 0, n: int = N) -> dict[str, np.ndarray]:
    """A run with white noise: at rest for a second, then sliding at MU for eleven."""
    plain = Recipe(peak=0.0, ripple=0.0, build_up=0.1, noise=NOISE_N, initial=TENSION_N, mu=MU)
    return record(plain.but(rate=n / 12.0, duration=12.0, arc_deg=ARC_DEG, seed=seed))


def reduced(columns: dict[str, np.ndarray]) -> RunReduction:
    n = columns["time_s"].size
    settings = {"run": np.zeros(n), "arc_deg": np.full(n, ARC_DEG)}
    return reduce_runs({**columns, **settings}, RADIUS_M)[0]


def channels_of(columns: dict[str, np.ndarray]) -> Channels:
    return read_channels(RunRecord(**columns, arc_deg=ARC_DEG))


def test_a_short_run_stays_as_it_is() -> None:
    channels = channels_of(long_run(n=2 * BLOCKS - 1))
    assert condensed(channels) is channels


@pytest.mark.parametrize("n", [2 * BLOCKS, 20_011, N, 300_000])
def test_blocks_keep_means_and_the_length(n: int) -> None:
    whole = channels_of(long_run(n=n))
    short = condensed(whole)
    assert BLOCKS <= short.time_s.size <= 2 * BLOCKS
    counts = np.full(short.time_s.size, n // BLOCKS)
    counts[-1] = n - counts[:-1].sum()
    for name in ("time_s", "tensions"):
        weighted = counts @ getattr(short, name) / n
        assert weighted == pytest.approx(np.mean(getattr(whole, name), axis=0), rel=1e-12)


def test_mu_and_its_error_are_those_of_white_noise() -> None:
    results = [reduced(long_run(seed)) for seed in range(4)]
    half = TENSION_N * np.tanh(0.5 * MU * np.radians(ARC_DEG))
    tight, slack = TENSION_N + half, TENSION_N - half
    sliding = N * 11.0 / 12.0
    # independent means of two tensions over all sliding samples
    ideal = NOISE_N * np.hypot(1.0 / tight, 1.0 / slack) / np.sqrt(sliding) / np.radians(ARC_DEG)
    errors = [result.mu_sliding - MU for result in results]
    assert all(result.status == "ok" for result in results)
    assert np.sqrt(np.mean(np.square(errors))) < 2.0 * ideal
    for result in results:
        # one run alone knows neither its tail nor its cells: most of the error is theirs
        assert ideal < result.mu_sliding_se < 1e-3 * MU


def test_spikes_in_long_blocks_of_correlated_noise_are_taken_out() -> None:
    """Blocks of 146 samples, in which the noise alone spreads over the limit of a spike."""
    columns = long_run(n=600_000)
    for name in ("tension_tight_N", "tension_slack_N"):
        smooth = 0.5 * (columns[name] + np.roll(columns[name], 1))
        columns[name] = np.where(columns["time_s"] > 0.0, smooth, columns[name])
    before = channels_of(columns).n_spikes
    places = np.random.default_rng(5).choice(np.arange(200_000, 599_000, 50), 40, replace=False)
    columns["tension_tight_N"][places[:20]] += 30.0
    columns["tension_slack_N"][places[20:]] -= 30.0
    after = channels_of(columns).n_spikes
    assert before < 10  # of 1.2 million samples
    assert after - before == 40


def test_spikes_at_the_ends_of_the_record_and_of_its_blocks_are_taken_out() -> None:
    """In the first and the last block there are samples on one side only."""
    n = 20_011
    size = n // BLOCKS
    at = [0, 40, 10 * size - 1, 12 * size, n - 40, n - 1]
    columns = long_run(n=n)
    columns["tension_tight_N"][at] += 40.0
    assert channels_of(long_run(n=n)).n_spikes == 0
    assert channels_of(columns).n_spikes == len(at)


@pytest.mark.parametrize("below", [0.15, 10.0])
def test_a_saturated_cell_is_still_seen(below: float) -> None:
    """Saturated a little below its level, where the noise still shows in a third of the samples."""
    columns = long_run()
    level = TENSION_N * (1.0 + np.tanh(0.5 * MU * np.radians(ARC_DEG)))
    columns["tension_tight_N"] = np.minimum(columns["tension_tight_N"], level - below)
    assert "tension_tight_N is saturated" in reduced(columns).status


def test_a_coarse_converter_keeps_its_rounding_error() -> None:
    columns = long_run()
    columns["tension_tight_N"] = np.round(columns["tension_tight_N"] / 4.0) * 4.0
    columns["tension_slack_N"] = np.round(columns["tension_slack_N"] / 4.0) * 4.0
    result = reduced(columns)
    assert result.status == "ok"
    assert abs(result.mu_sliding - MU) < 3.0 * result.mu_sliding_se
    half = TENSION_N * np.tanh(0.5 * MU * np.radians(ARC_DEG))
    # noise of an eighth of a step: the saw tooth of rounding, smoothed by it, is 0.169 steps
    rounding = 4.0 * 0.169 * np.hypot(1 / (TENSION_N + half), 1 / (TENSION_N - half))
    assert result.mu_sliding_se > 0.7 * rounding / np.radians(ARC_DEG)
