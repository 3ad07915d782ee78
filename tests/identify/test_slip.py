"""Sliding speeds from the speed-loss bench, and the pulley speeds they ask for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from beltid.errors import InputError
from beltid.identify.slip.slip import fit_slip

ROOT = Path(__file__).parents[2]
BELTS = ("4pk", "5pk", "6pk")
TORQUES = np.arange(0.0, 17.0)


def table(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")


def load(belt: str) -> dict[str, np.ndarray]:
    columns = table(ROOT / "rigdata" / belt / "speedloss.csv")
    return {name: columns[name] for name in columns.dtype.names}


def truth(belt: str) -> dict[str, float]:
    columns = table(ROOT / "tests" / "truth" / belt / "speedloss_truth.csv")
    return dict(zip(columns["run"].tolist(), columns["slip_speed_m_s"].tolist(), strict=True))


def drive(
    torque=TORQUES, creep=0.01, speed=62.8, ratio=1.0, seed=0, n=20, noise=2e-3
) -> dict[str, np.ndarray]:
    """Synthetic drive: loss of `creep` [rad/s per N m], driven pulley `ratio` times larger."""
    rng = np.random.default_rng(seed)
    torque = np.asarray(torque, dtype=float)
    loss = np.broadcast_to(creep * torque, torque.shape)
    size = torque.size * n
    return {
        "run": np.repeat([f"S{i:02d}" for i in range(torque.size)], n),
        "initial_tension_N": np.full(size, 310.0),
        "torque_N_m": np.repeat(torque, n) + 0.02 * rng.normal(size=size),
        "driver_speed_rad_s": speed + 5e-4 * rng.normal(size=size),
        "driven_speed_rad_s": (speed - np.repeat(loss, n)) / ratio + noise * rng.normal(size=size),
    }


@pytest.mark.parametrize("belt", BELTS)
def test_virtual_bench_gives_the_true_sliding_speeds_within_their_errors(belt):
    result, true = fit_slip(load(belt), 0.05), truth(belt)
    assert [p.run for p in result.points] == list(true)
    assert {p.status for p in result.points} == {"ok"}
    error = np.array([p.slip_speed_m_s - true[p.run] for p in result.points])
    se = np.array([p.slip_speed_se_m_s for p in result.points])
    pulls = error / se
    # 51 points of 10 samples each: Student's t with 9 degrees of freedom
    assert np.max(np.abs(pulls)) < 5.0
    assert 0.8 < np.sqrt(np.mean(pulls**2)) < 1.5
    # the speed sensors' 3 mrad/s over sqrt(10) samples, times R
    assert np.sqrt(np.mean(error**2)) < 6e-5
    assert result.max_slip_speed_m_s == pytest.approx(max(true.values()), rel=5e-3)
    assert result.max_slip_run == "S51"


def test_correlated_samples_widen_the_error():
    white = drive(torque=[8.0], n=4000, noise=1e-3)
    reference = fit_slip(white, 0.05).points[0].slip_speed_se_m_s
    ratios = []
    for seed in range(10):
        drift = np.repeat(np.random.default_rng(seed).normal(size=200), 20)
        slow = white | {"driven_speed_rad_s": 62.72 + 1e-3 * drift}
        ratios.append(fit_slip(slow, 0.05).points[0].slip_speed_se_m_s / reference)
    # 20 equal samples hold as much as one; the driver's white noise is a fifth of the variance:
    # sqrt(0.8 * 20 + 0.2) = 4.02, determined to 14 % by one record and to 5 % by ten
    assert np.mean(ratios) == pytest.approx(4.02, rel=0.15)


def test_unequal_pulleys_are_taken_off_with_the_runs_without_torque():
    columns = drive(ratio=1.03)
    result = fit_slip(columns, 0.05)
    assert result.ratio == pytest.approx(1.03, abs=5 * result.ratio_se)
    assert 0 < result.ratio_se < 1e-4
    loss = np.array([p.speed_loss_rad_s for p in result.points])
    assert loss == pytest.approx(0.01 * np.arange(17.0), abs=4e-3)
    assert any("ratio of the pulleys" in note for note in result.notes)
    assert min(p.slip_speed_se_m_s for p in result.points) > 62.0 * 0.05 * result.ratio_se


def test_gross_slip_is_marked_and_not_counted_as_service():
    torque = np.arange(0.0, 17.0)
    creep = np.where(torque > 14.5, 0.05, 0.01)
    result = fit_slip(drive(torque, creep), 0.05)
    assert [p.run for p in result.points if p.status == "gross slip"] == ["S15", "S16"]
    assert result.max_slip_run == "S14"
    assert result.max_slip_speed_m_s == pytest.approx(0.01 * 14 * 0.05, rel=0.02)
    lone = fit_slip(drive([0.0, 5.0, 8.0], np.array([0.0, 0.01, 1.0])), 0.05)
    assert [p.status for p in lone.points] == ["ok", "ok", "gross slip"]


def test_a_run_without_torque_does_not_blind_its_series():
    columns = drive(np.arange(0.0, 17.0), np.where(np.arange(17) > 14, 0.05, 0.01))
    columns["torque_N_m"][columns["run"] == "S04"] = np.nan
    result = fit_slip(columns, 0.05)
    assert [p.run for p in result.points if p.status == "gross slip"] == ["S15", "S16"]
    assert result.max_slip_speed_m_s == pytest.approx(0.01 * 14 * 0.05, rel=0.02)


def test_gaps_spikes_and_useless_runs_are_kept_apart():
    columns = drive()
    columns["driven_speed_rad_s"][np.flatnonzero(columns["run"] == "S08")[3]] = 0.0
    columns["driver_speed_rad_s"][np.flatnonzero(columns["run"] == "S09")[:5]] = np.nan
    columns["driven_speed_rad_s"][np.flatnonzero(columns["run"] == "S10")[2:]] = np.nan
    gains = columns["run"] == "S12"
    columns["driven_speed_rad_s"][gains] += 1.0
    stands = columns["run"] == "S13"
    columns["driver_speed_rad_s"][stands] = columns["driven_speed_rad_s"][stands] = 0.0
    result = fit_slip(columns, 0.05)
    status = {p.run: p.status for p in result.points}
    assert len(result.points) == 17
    assert "fewer than 3" in status.pop("S10")
    assert "gains" in status.pop("S12")
    assert "does not turn" in status.pop("S13")
    assert set(status.values()) == {"ok"}
    points = {p.run: p for p in result.points}
    assert points["S08"].slip_speed_m_s == pytest.approx(0.05 * 0.08, abs=1.5e-4)
    assert points["S09"].n_samples == 15
    assert len(result.notes) == 3


def test_a_driving_generator_has_a_loss_of_the_other_sign():
    result = fit_slip(drive(torque=-np.arange(0.0, 17.0)), 0.05)
    assert {p.status for p in result.points} == {"ok"}
    assert result.points[10].slip_speed_m_s < 0
    assert result.max_slip_speed_m_s == pytest.approx(0.16 * 0.05, rel=0.02)


def test_wrong_inputs_name_every_problem():
    with pytest.raises(InputError) as error:
        fit_slip({"run": np.array(["a"])}, -1.0)
    assert len(error.value.problems) == 5
    empty = {k: v[:0] for k, v in drive().items()}
    with pytest.raises(InputError, match="0 samples"):
        fit_slip(empty, 0.05)
    useless = {k: v[:2] for k, v in drive().items()}
    with pytest.raises(InputError, match="run S00: fewer than 3"):
        fit_slip(useless, 0.05)
