"""The reduction on synthetic records with a known answer: other rigs, noise and faults."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from golden import benches
from hypothesis import assume, example, given, settings, strategies as st
from virtual_rig import CASES, Recipe, bench, case, draw, record, reduce_runs, with_memory

from beltid.identify.friction.reduction import RunReduction

Columns = dict[str, np.ndarray]
ROOT = Path(__file__).parents[2]


def reduce_columns(columns: Columns, arc_deg: float = 82.0) -> RunReduction:
    n = len(columns["time_s"])
    return reduce_runs({**columns, "run": np.zeros(n), "arc_deg": np.full(n, arc_deg)}, 0.05)[0]


def reduce_recipe(recipe: Recipe) -> RunReduction:
    return reduce_columns(record(recipe), recipe.arc_deg)


BASE = Recipe()


@pytest.mark.parametrize(
    ("recipe", "allowed"),
    [
        (BASE, 0.002),
        (BASE.but(tail=2.0), 0.005),
        (BASE.but(rate=2000.0, duration=3.0, tail=0.3), 0.0005),
        (BASE.but(mu=0.3, arc_deg=20.0), 0.012),
    ],
    ids=lambda value: None if isinstance(value, float) else "rig",
)
def test_other_rigs_give_their_coefficient(recipe: Recipe, allowed: float) -> None:
    columns = bench(recipe, 3)
    for run in reduce_runs(columns, 0.05):
        assert run.status == "ok"
        assert abs(run.mu_sliding / recipe.mu - 1.0) < allowed
        assert abs(run.mu_sliding - recipe.mu) < 4.0 * run.mu_sliding_se
        assert abs(run.initial_tension_N - 270.0) < recipe.noise
        assert run.slip_speed_m_s == pytest.approx(0.21 * 0.05, rel=0.003)


def test_noise_free_record_with_a_constant_plateau_is_exact() -> None:
    run = reduce_recipe(BASE.but(noise=0.0, ripple=0.0, peak=0.0))
    assert run.status == "ok"
    # the spectrum of a tail is positive: none at all is at the edge of its prior
    assert run.mu_sliding == pytest.approx(0.8, rel=2e-4)
    assert run.initial_tension_N == pytest.approx(270.0, rel=1e-12)
    assert run.imbalance_N == 0.0
    assert abs(run.mu_sliding - 0.8) < run.mu_sliding_se < 1.6e-3
    assert run.notes == ()
    assert np.isnan(run.mu_sticking)
    assert "no peak" in run.mu_sticking_reason


def test_sticking_peak_is_null_where_it_decays_within_a_few_samples() -> None:
    run = reduce_recipe(BASE.but(build_up=0.001, peak=0.25, tail=0.03))
    assert run.status == "ok"
    assert abs(run.mu_sliding - 0.8) < 2.0 * run.mu_sliding_se < 0.004
    assert np.isnan(run.mu_sticking)
    assert run.mu_sticking_reason


TIGHT, SLACK, SPEED = "tension_tight_N", "tension_slack_N", "pulley_speed_rad_s"


def put(x: np.ndarray, at: Any, value: Any) -> np.ndarray:
    x = x.copy()
    x[at] = value
    return x


def jumps(x: np.ndarray, at: list[int], by: float) -> np.ndarray:
    return put(x, at, x[at] + by)


FAULTS = {
    "swapped": lambda c: {TIGHT: c[SLACK], SLACK: c[TIGHT]},
    "backwards": lambda c: {SPEED: -c[SPEED]},
    "spikes": lambda c: {
        TIGHT: jumps(c[TIGHT], [0, 30, 49, 51, 90, 91, 150, 222, 299], 60.0),
        SLACK: jumps(c[SLACK], [1, 48, 61, 100, 180, 298], -60.0),
    },
    "short drop-out": lambda c: {TIGHT: put(c[TIGHT], slice(150, 175), 0.0)},
    "half signal": lambda c: {SLACK: put(c[SLACK], slice(200, 220), 0.5 * c[SLACK][200:220])},
    "nan burst": lambda c: {
        TIGHT: put(c[TIGHT], slice(120, 150), np.nan),
        SLACK: put(c[SLACK], slice(200, 210), np.nan),
        SPEED: put(c[SPEED], slice(130, 140), np.nan),
    },
    "missing rows": lambda c: {name: np.delete(x, np.arange(100, 140)) for name, x in c.items()},
    "speed glitches": lambda c: {SPEED: put(c[SPEED], [20, 200, 201], (0.21, 0.0, 2.0))},
    "coarse time": lambda c: {"time_s": np.round(c["time_s"], 1)},
    "coarse converter": lambda c: {name: np.round(c[name]) for name in (TIGHT, SLACK)},
}
"""What is wrong with the columns of the base run."""


@cache
def faulty_bench() -> dict[str, RunReduction]:
    parts = []
    for seed, (name, fault) in enumerate(FAULTS.items()):
        columns = record(BASE.but(seed=seed))
        parts.append((name, columns | fault(columns), 82.0))
    return {run.run: run for run in reduce_runs(table(*parts), 0.05)}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_that_a_run_survives(fault: str) -> None:
    run = faulty_bench()[fault]
    assert run.status == "ok"
    assert abs(run.mu_sliding / 0.8 - 1.0) < 0.0015
    assert abs(run.initial_tension_N - 270.0) < 0.5
    assert abs(run.mu_sticking / 0.84 - 1.0) < 0.01


def test_what_a_run_survives_is_reported() -> None:
    after = faulty_bench()
    assert after["swapped"].swapped
    assert any("swapped" in note for note in after["swapped"].notes)
    assert after["swapped"].tension_tight_N > after["swapped"].tension_slack_N
    assert after["backwards"].pulley_speed_rad_s > 0.2
    assert any("negative" in note for note in after["backwards"].notes)
    for fault, n_missing in (("short drop-out", 25), ("nan burst", 40)):
        assert after[fault].n_missing == n_missing
    assert after["half signal"].n_spikes == 20
    # the spike on the steep build-up (sample 51) is beyond telling, and harmless
    assert 13 <= after["spikes"].n_spikes <= 15


@pytest.mark.parametrize(
    ("recipe", "reason"),
    [
        (BASE.but(build_up=30.0), "never slides"),
        (BASE.but(build_up=3.5), "never slides"),
        (BASE.but(mu=0.001, peak=0.0), "never slides"),
        (BASE.but(mu=3.5), "mu_sliding = 3."),
        (BASE.but(offset=80.0), "the cells differ by +"),
        (BASE.but(drift=0.2), "drifts, or goes with the turn of the pulley: mu is 13 % off"),
    ],
)
def test_runs_without_a_credible_plateau_are_set_aside(recipe: Recipe, reason: str) -> None:
    assert reduce_recipe(recipe).status.startswith(reason)


def test_a_run_that_sticks_and_slips_is_set_aside_with_its_noise() -> None:
    columns = record(BASE)
    moving = np.cumsum(columns[SPEED] > 0.1) > 10
    more = 12.0 * BASE.noise * moving * np.random.default_rng(4).normal(size=moving.size)
    run = reduce_columns(columns | {TIGHT: columns[TIGHT] + more})
    assert run.status.startswith("sticks and slips")


def test_zeros_that_drift_by_as_much_in_each_record_do_not_pass_for_a_tail() -> None:
    runs = []
    # all of the same travel, over which the drift is alike
    for k, slide_s in enumerate(np.geomspace(4.0, 24.0, 20).tolist()):
        initial = (80.0, 140.0, 210.0, 290.0, 380.0)[k % 5]
        of = BASE.but(seed=k, rest=2.0, duration=2.0 + slide_s, omega=1.4 / slide_s)
        run = bench(of.but(initial=initial), 1)
        for name in ("tension_tight_N", "tension_slack_N"):
            run[name] = run[name] + 0.5 * run["time_s"] / run["time_s"][-1]
        runs.append({**run, "run": run["run"] + k})
    found = reduce_runs({name: np.concatenate([r[name] for r in runs]) for name in runs[0]}, 0.05)
    error = np.array([run.mu_sliding for run in found]) / 0.8 - 1.0
    assert np.sqrt(np.mean(error**2)) < 1.5e-3


def test_noise_that_remembers_at_rest_is_no_drift_of_the_zeros() -> None:
    columns, mu = draw("correlated noise, 10 samples (0.2 s)", 20, seed=70000)
    found = np.array([(run.mu_sliding, run.mu_sliding_se) for run in reduce_runs(columns, 0.05)])
    assert np.sqrt(np.mean(((found[:, 0] - mu) / found[:, 1]) ** 2)) < 1.5


def test_a_slow_drift_of_friction_is_kept_and_reported() -> None:
    run = reduce_recipe(BASE.but(drift=0.05))
    assert run.status == "ok"
    assert 0.8 < run.mu_sliding < 0.8 * 1.05
    assert (run.drift, run.mu_sliding_se) == pytest.approx((0.05, 0.04 / np.sqrt(12)), rel=0.5)
    assert any("drifts by +" in note for note in run.notes)


def table(*runs: tuple[str, Columns, float]) -> dict[str, Any]:
    """Columns of several runs with their labels and arcs."""
    parts = [
        {
            **columns,
            "run": np.full(columns["time_s"].size, label, dtype=object),
            "arc_deg": np.full(columns["time_s"].size, arc),
            "initial_tension_N": np.full(columns["time_s"].size, 270.0),
            "temperature_degC": np.full(columns["time_s"].size, 22.5),
        }
        for label, columns, arc in runs
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(1, 120),
    scale=st.sampled_from([0.0, 1e-300, 1.0, 1e6, 1e300]),
    holes=st.floats(0.0, 1.0),
)
@example(seed=47, n=47, scale=0.0, holes=1.0)  # a speed of nothing but infinities
def test_no_record_whatever_raises(seed: int, n: int, scale: float, holes: float) -> None:
    rng = np.random.default_rng(seed)

    def channel() -> np.ndarray:
        values = scale * rng.normal(size=n) + rng.choice([0.0, 100.0])
        values[rng.random(n) < holes * rng.choice([0.0, 1.0])] = rng.choice([np.nan, np.inf, 0.0])
        return values

    speed = np.where(np.arange(n) > n // 4, 0.2, 0.0) if rng.random() < 0.7 else channel()
    columns = {
        "time_s": np.arange(n) * (0.02 if rng.random() < 0.8 else 0.0),
        "tension_tight_N": channel(),
        "tension_slack_N": channel(),
        "pulley_speed_rad_s": speed,
    }
    assume(all(np.isfinite(columns[name]).any() for name in (TIGHT, SLACK)))
    run = reduce_columns(columns)
    assert run.status
    assert not run.ok or 0.0 < run.mu_sliding <= 3.0


def test_mu_depends_neither_on_the_unit_of_force_nor_on_the_origin_of_time() -> None:
    factor, columns = 2.0, record(BASE.but(seed=78))
    run = reduce_columns(columns)
    columns["time_s"] = columns["time_s"] - 300.0
    for name in (TIGHT, SLACK):
        columns[name] = columns[name] * factor
    other = reduce_columns(columns)
    # the search for the variances ends where they no longer matter, not at the last digit
    assert abs(other.mu_sliding - run.mu_sliding) < 0.01 * run.mu_sliding_se
    assert other.mu_sliding_se == pytest.approx(run.mu_sliding_se, rel=0.01)
    assert other.initial_tension_N == pytest.approx(run.initial_tension_N * factor, rel=1e-6)


def test_noise_that_is_slower_than_the_sliding_is_seen_at_rest() -> None:
    """Correlated over 0.1 s, it is a constant in a sliding of 0.06 s, a different one in each."""
    rng = np.random.default_rng(11)
    n, t = 36, np.arange(2060) / 1000.0
    tension, arc = rng.uniform(80.0, 300.0, n), rng.choice([60.0, 90.0, 140.0], n)
    build_up = 1.0 - np.exp(-np.maximum(t - 2.0, 0.0) / 2.5e-4)
    memory = np.exp(-1.0 / 100.0)
    steps = rng.normal(0.0, 0.3 * np.sqrt(1.0 - memory**2), (2, n, t.size + 1000))
    noise = with_memory(steps, memory)[..., 1000:]
    ratio = 0.3 * np.radians(arc)[:, None] * build_up
    slack = 2.0 * tension[:, None] / (1.0 + np.exp(ratio))
    columns = {
        "run": np.repeat([f"R{k:02d}" for k in range(n)], t.size),
        "time_s": np.tile(t, n),
        "tension_tight_N": (2.0 * tension[:, None] - slack + noise[0]).ravel(),
        "tension_slack_N": (slack + noise[1]).ravel(),
        "pulley_speed_rad_s": np.where(ratio > 0.0, 0.4 / 0.05, 0.0).ravel(),
        "arc_deg": np.repeat(arc, t.size),
        "initial_tension_N": np.repeat(tension, t.size),
    }
    runs = reduce_runs(columns, 0.05)
    z = np.array([(run.mu_sliding - 0.3) / run.mu_sliding_se for run in runs])
    assert all(run.ok for run in runs)
    assert np.mean(np.abs(z) < 1.96) > 0.85
    assert 0.6 <= np.sqrt(np.mean(z**2)) <= 1.25


def test_sticking_peak_of_a_build_up_without_a_sharp_end() -> None:
    """The tail alone, extrapolated, is 6 % above the true peak, 3 to 4 % above the plateau."""
    rig = benches.Rig(radius_m=0.02)
    frame, truth = rig.recording(), rig.runs()
    runs = reduce_runs({name: frame[name].to_numpy() for name in benches.CELLS}, rig.radius_m)
    x, T0 = np.linspace(0.0, 1e-3, 1001), truth["initial_tension_N"]
    rise = np.max(1 - np.exp(-x / benches.BUILD_UP) + 0.04 * x / 2e-4 * np.exp(1 - x / 2e-4))
    tight, slack = (T0 + rise * (truth[name] - T0) for name in (TIGHT, SLACK))
    true = (np.log(tight / slack) / np.radians(truth["arc_deg"])).to_numpy()
    found, se = np.array([(run.mu_sticking, run.mu_sticking_se) for run in runs]).T
    seen = np.isfinite(found)
    assert np.count_nonzero(seen) >= 15
    assert np.max(np.abs(found / true - 1.0)[seen]) < 0.006
    assert np.sqrt(np.mean(((found - true) / se)[seen] ** 2)) < 1.5


@pytest.mark.parametrize(
    "belt", ["5pk", *(pytest.param(belt, marks=pytest.mark.long) for belt in ("4pk", "6pk"))]
)
def test_sticking_coefficient_meets_the_truth_at_every_speed_that_resolves_it(belt: str) -> None:
    recording = pd.read_csv(ROOT / "rigdata" / belt / "rig.csv", dtype={"run": str})
    truth = pd.read_csv(ROOT / "tests" / "truth" / belt / "truth.csv")
    runs = reduce_runs({name: recording[name].to_numpy() for name in recording}, 0.05)
    error = np.array([run.mu_sticking for run in runs]) / truth["mu_stick"].to_numpy() - 1.0
    se = np.array([run.mu_sticking_se / run.mu_sticking for run in runs])
    slow, seen = truth["omega"].to_numpy() <= 0.1, np.isfinite(error)
    assert np.all(seen[slow])
    assert np.sqrt(np.mean(error[slow] ** 2)) < 0.004
    assert np.sqrt(np.mean((error / se)[seen] ** 2)) < 1.5
    assert np.max(np.abs(error[seen])) < 0.03
    assert [not run.mu_sticking_reason for run in runs] == seen.tolist()


def test_a_wave_once_per_turn_is_no_zero_that_wanders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 2 %, over half a turn: it made mu 1 % wrong, now 0.2 %."""

    def once_per_turn(f: Any, rng: np.random.Generator) -> None:
        phase = 0.21 * (f.time - 1.0) + rng.uniform(0.0, 2.0 * np.pi, (len(f.time), 1))
        f.cells *= np.exp(np.multiply.outer([0.5, -0.5], 0.02 * np.sin(phase) * (f.time > 1.0)))

    monkeypatch.setitem(CASES, "wave", case(once_per_turn, duration=18.0))
    columns, mu = draw("wave", 6)
    found = [run.mu_sliding for run in reduce_runs(columns, 0.05)]
    np.testing.assert_allclose(found, mu, rtol=0.003)
