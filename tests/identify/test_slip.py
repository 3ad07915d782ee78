"""Sliding speeds from the speed-loss bench, their errors, and the pulley speeds they ask for."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from beltid.errors import InputError
from beltid.identify.slip import OK, SIGNIFICANT, fit_slip, pooled_means, required_pulley_speeds

TORQUES = np.arange(0.0, 17.0)
TRUE = np.tile(0.01 * TORQUES * 0.05, 2)  # sliding speeds of `drive` at two speeds
LOUD = {"speeds": (22.0, 62.8), "noise": 3e-3, "driver_noise": 3e-3}
DRIVER, DRIVEN, TORQUE = "driver_speed_rad_s", "driven_speed_rad_s", "torque_N_m"


def drive(
    torque=TORQUES, creep=0.01, *, speeds=(62.8,), ratio=1.0, seed=0, n=20, noise=2e-3,
    driver_noise=5e-4,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Synthetic drive: loss of `creep` [rad/s per N m], driven pulley `ratio` times larger.

    `n` samples a run.
    """
    rng = np.random.default_rng(seed)
    torque = np.asarray(torque, dtype=float)
    loss = np.repeat(np.broadcast_to(creep * torque, torque.shape), n)
    size, parts = loss.size, []
    for speed in speeds:
        series = "S" if len(speeds) == 1 else f"{speed:g}-"
        parts.append(
            {
                "run": np.repeat([f"{series}{i:02d}" for i in range(torque.size)], n),
                "initial_tension_N": np.full(size, 310.0),
                TORQUE: np.repeat(torque, n) + 0.02 * rng.normal(size=size),
                DRIVER: speed + driver_noise * rng.normal(size=size),
                DRIVEN: (speed - loss) / ratio + noise * rng.normal(size=size),
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def statuses(columns) -> dict[str, str]:
    found = fit_slip(columns, 0.05).columns
    return dict(zip(found["run"], found["status"], strict=True))


def pulls(columns) -> list[float]:
    found = fit_slip(columns, 0.05).columns
    v = found["slip_speed_m_s"]
    return list((v - TRUE[: v.size]) / found["slip_speed_se_m_s"])


def test_unequal_pulleys_are_taken_off_with_the_runs_without_torque():
    result = fit_slip(drive(ratio=1.03), 0.05)
    assert result.ratio == pytest.approx(1.03, abs=5 * result.ratio_se)
    assert 0 < result.ratio_se < 1e-4
    assert result.columns["speed_loss_rad_s"] == pytest.approx(0.01 * TORQUES, abs=4e-3)
    assert any("ratio of the pulleys" in note for note in result.notes)
    assert np.min(result.columns["slip_speed_se_m_s"]) > 62.0 * 0.05 * result.ratio_se
    (note,) = fit_slip(drive([2.0, 4.0, 6.0]), 0.05).notes
    assert "no run without torque" in note
    assert note.endswith("0.063 rad/s of the loss")
    with pytest.raises(InputError, match="no run without torque"):
        fit_slip(drive([2.0, 4.0, 6.0], ratio=2.0), 0.05)


@pytest.mark.parametrize(("step", "ratio"), [(0.1, 0.75), (math.pi / 30.0, 0.75)])
def test_coarse_readings_that_never_change_have_the_error_of_rounding(step, ratio):
    z = []
    for shift in np.linspace(0.0, 1.0, 5, endpoint=False) * step:
        columns = drive(speeds=(22.0 + shift, 62.8 + shift), ratio=ratio, noise=0, driver_noise=0)
        for name in (DRIVER, DRIVEN):
            columns[name] = step * np.round(columns[name] / step)
        result = fit_slip(columns, 0.05)
        assert set(result.columns["status"]) == {"ok"}
        assert abs(result.ratio - ratio) < 3.0 * result.ratio_se
        z += pulls(columns)
    assert np.mean(np.abs(z) < 1.96) > 0.9
    assert np.sqrt(np.mean(np.square(z))) > 0.4  # both speeds, and the ratio that they give


def test_round_speeds_without_noise_are_no_coarse_readings():
    """20, 40 and 60 rad/s do not show a resolution of 20 rad/s."""
    found = fit_slip(drive(creep=0.0, speeds=(20, 40, 60), noise=0, driver_noise=0), 0.05).columns
    assert np.abs(found["speed_loss_rad_s"]).max() < 1e-9
    assert found["slip_speed_se_m_s"].max() < 1e-9


@pytest.mark.parametrize("way", [np.linspace(0.0, 1.0, 10), np.zeros(10)])
def test_a_drive_that_comes_up_to_its_speed_and_stops_is_no_operating_point(way):
    columns = drive(n=40)
    for begin in range(0, columns["run"].size, 40):
        for rows in (slice(begin, begin + 10), slice(begin + 39, begin + 29, -1)):
            for name in (TORQUE, DRIVER, DRIVEN):
                columns[name][rows] *= way
    result = fit_slip(columns, 0.05)
    assert result.columns["slip_speed_m_s"] == pytest.approx(TRUE[:17], abs=2e-4)
    assert set(result.columns["n_samples"]) <= {20, 21, 22}
    assert "before the driver is up to its speed left out: S00, S01" in result.notes[0]


def test_swapped_pulleys_generators_and_drives_that_turn_backwards_are_refused():
    columns = drive()
    with pytest.raises(InputError, match=r"run S16: .*gains on the driver: .*swapped"):
        fit_slip(columns | {DRIVER: columns[DRIVEN], DRIVEN: columns[DRIVER]}, 0.05)
    with pytest.raises(InputError, match=r"run S00: .*backwards: .*factor of -1 under units"):
        fit_slip(columns | {name: -columns[name] for name in (DRIVER, DRIVEN)}, 0.05)
    found = statuses(drive(torque=np.arange(-8.0, 9.0)))
    assert [run for run in found if "gains" in found[run]] == [f"S{k:02d}" for k in range(8)]
    assert set(list(found.values())[8:]) == {"ok"}
    one = drive(n=10, seed=7, **LOUD)
    one[DRIVEN][one["run"] == "22-10"] *= -1.0
    found = statuses(one)
    assert "opposite" in found.pop("22-10")
    assert set(found.values()) == {"ok"}


@pytest.mark.parametrize(("unknown", "run"), [("", ""), (TORQUE, "S04"), ("initial_tension_N", "")])
def test_gross_slip_is_marked_and_not_counted_as_service(unknown, run):
    columns = drive(creep=np.where(TORQUES > 14.5, 0.05, 0.01))
    if unknown:  # what is unknown does not blind the series
        columns[unknown][(columns["run"] == run) | (run == "")] = np.nan
    for way in (1.0, -1.0):  # the sign of the torque does not matter
        result = fit_slip(columns | {TORQUE: way * columns[TORQUE]}, 0.05)
        gross = result.columns["status"] == "gross slip"
        assert result.columns["run"][gross].tolist() == ["S15", "S16"]
        assert result.max_slip_run == "S14"
        assert result.max_slip_speed_m_s == pytest.approx(0.01 * 14 * 0.05, rel=0.02)


@pytest.mark.parametrize("torque", [(0, 2, 4, 6, 8, 10), (3, 6, 9, 12), (4, 8, 12, 14), (0, 5, 8)])
def test_gross_slip_shows_in_a_series_of_few_runs(torque):
    """The last run slips by 3 % of the driver's speed, or by 12 %, too much for any creep."""
    columns = drive(torque=torque)
    last = columns["run"] == columns["run"][-1]
    share = 0.03 if len(torque) > 3 else 0.12
    columns[DRIVEN] = columns[DRIVEN] - share * 62.8 * last
    result = fit_slip(columns, 0.05)
    assert result.columns["status"].tolist() == ["ok"] * (len(torque) - 1) + ["gross slip"]
    assert result.max_slip_speed_m_s == pytest.approx(0.01 * torque[-2] * 0.05, rel=0.05)


def test_gaps_spikes_and_useless_runs_are_kept_apart():
    columns = drive()
    rows = {run: np.flatnonzero(columns["run"] == run) for run in np.unique(columns["run"])}
    columns[DRIVEN][rows["S08"][3]] = 0.0
    columns[DRIVER][rows["S09"][:5]] = np.nan
    columns[DRIVER][rows["S09"][7]] *= 100.0
    columns[DRIVEN][rows["S10"][2:]] = np.nan
    columns[DRIVEN][rows["S12"]] += 1.0
    columns[DRIVER][rows["S13"]] = columns[DRIVEN][rows["S13"]] = 0.0
    found, status = fit_slip(columns, 0.05).columns, statuses(columns)
    assert "fewer than 3" in status.pop("S10")
    assert "gains" in status.pop("S12")
    assert "does not turn" in status.pop("S13")
    assert set(status.values()) == {"ok"}
    assert found["slip_speed_m_s"][8] == pytest.approx(0.05 * 0.08, abs=1.5e-4)
    assert found["n_samples"][9] == 15
    with pytest.raises(InputError, match="run S00: fewer than 3"):
        fit_slip({k: v[:2] for k, v in columns.items()}, 0.05)


def test_standard_errors_of_short_runs_are_honest():
    z = np.concatenate([pulls(drive(n=3, seed=seed, **LOUD)) for seed in range(8)])
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.2
    # 272 values: three binomial standard deviations
    assert np.mean(np.abs(z) < 1.0) == pytest.approx(0.683, abs=0.085)
    assert np.mean(np.abs(z) < 2.0) == pytest.approx(0.954, abs=0.038)


@pytest.mark.parametrize("runs", [2, 5])
def test_standard_errors_hold_with_correlated_noise(runs):
    """Five correlation times a run: an autoregression of a = 0.9 on the driven speed."""
    z = []
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(size=(runs, 100))
        for k in range(1, 100):
            noise[:, k] = 0.9 * noise[:, k - 1] + np.sqrt(0.19) * noise[:, k]
        columns = drive(torque=np.arange(1.0, runs + 1.0), seed=seed, n=100, noise=0.0)
        columns[DRIVEN] = columns[DRIVEN] + 0.01 * noise.ravel()
        found = fit_slip(columns, 0.05).columns
        true = 0.01 * np.round(found[TORQUE]) * 0.05
        z += list((found["slip_speed_m_s"] - true) / found["slip_speed_se_m_s"])
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.2


def test_the_noise_of_a_series_is_one_variance():
    """se² = sum of squares / (all degrees of freedom) / n, for white noise."""
    runs = [np.array([1.0, 2.0, 0.0]), np.array([5.0, 3.0, 4.0]), np.arange(3.0)]
    mean, se, _ = pooled_means(runs, np.zeros(3, dtype=int))
    assert mean.tolist() == [1.0, 4.0, 1.0]
    # 6 squares over 6 degrees of freedom
    assert se == pytest.approx([1.0 / math.sqrt(3.0)] * 3, rel=1e-9)
    few = [np.array([np.nan, np.nan]), np.array([2.0]), np.arange(8.0) % 2]
    mean, se, _ = pooled_means(few, np.zeros(3, dtype=int))
    assert mean == pytest.approx([np.nan, 2.0, 0.5], nan_ok=True)
    assert se[:2] == pytest.approx([np.nan, math.sqrt(2.0 / 7.0)], rel=1e-9, nan_ok=True)


def service(*speeds, se=1e-6):
    status = np.full(len(speeds), OK, dtype=object)
    columns = {"slip_speed_m_s": np.array(speeds), "status": status}
    return SimpleNamespace(columns=columns | {"slip_speed_se_m_s": np.full(len(speeds), se)})


def proposed(*speeds, **how):
    return required_pulley_speeds(service(*speeds, **how), 0.05)[0]


def test_range_and_proposal_follow_from_the_sliding_speeds():
    found, covered, said = required_pulley_speeds(service(0.004, -0.016, 0.008), 0.05)
    assert found == pytest.approx((0.08, 0.08 * 2**0.5, 0.16, 0.16 * 2**0.5, 0.32))
    assert covered is None
    assert said == "sliding in service needs pulley speeds from 0.08 to 0.32 rad/s"
    assert proposed(0.01) == pytest.approx((0.2,))
    # a hundredth of the largest; a doubtful one; one set aside
    assert 0.05 * proposed(0.016, 1e-5)[0] == pytest.approx(0.00016)
    assert proposed(0.016, SIGNIFICANT * 0.99e-3, se=1e-3) == pytest.approx((0.32,))
    aside = service(0.016, 0.9)
    aside.columns["status"][1] = "gross slip"
    assert required_pulley_speeds(aside, 0.05)[0] == pytest.approx((0.32,))
    with pytest.raises(InputError, match="significantly"):
        proposed()


@pytest.mark.parametrize(
    ("speeds", "said"),
    [
        ((0.0815, 0.3137), "covered"),
        ((0.0817, 0.32), "not covered"),
        ((0.08, 0.3135), "not covered"),
        ((0.01,), "not covered"),
    ],
)
def test_an_end_is_missed_by_more_than_a_fiftieth(speeds, said):
    _, covered, statement = required_pulley_speeds(service(0.004, 0.016), 0.05, configured=speeds)
    assert covered == (said == "covered")
    assert statement.endswith(f"rad/s: {said}")
