"""Sliding speeds from the speed-loss bench, their errors, and the pulley speeds they ask for."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from beltid.errors import InputError
from beltid.identify.slip.points import OK, SIGNIFICANT, required_pulley_speeds
from beltid.identify.slip.slip import fit_slip, pooled_means, speed_series

ROOT = Path(__file__).parents[2]
BELTS = ("4pk", "5pk", "6pk")
TORQUES = np.arange(0.0, 17.0)
TRUE = np.tile(0.01 * TORQUES * 0.05, 2)  # sliding speeds of `drive` at two speeds


def table(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")


def load(belt: str) -> dict[str, np.ndarray]:
    columns = table(ROOT / "rigdata" / belt / "speedloss.csv")
    return {name: columns[name] for name in columns.dtype.names}


def truth(belt: str) -> dict[str, float]:
    columns = table(ROOT / "tests" / "truth" / belt / "speedloss_truth.csv")
    return dict(zip(columns["run"].tolist(), columns["slip_speed_m_s"].tolist(), strict=True))


def drive(
    torque=TORQUES, creep=0.01, *, speeds=(62.8,), ratio=1.0, seed=0, n=20, noise=2e-3,
    driver_noise=5e-4, shaking=1.0,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Synthetic drive: loss of `creep` [rad/s per N m], driven pulley `ratio` times larger.

    `n` samples a run; the one of 9 N m is `shaking` times as loud.
    """
    rng = np.random.default_rng(seed)
    torque = np.asarray(torque, dtype=float)
    loss = np.repeat(np.broadcast_to(creep * torque, torque.shape), n)
    loud = np.repeat(np.where(torque == 9.0, shaking, 1.0), n)
    size, parts = loss.size, []
    for speed in speeds:
        series = "S" if len(speeds) == 1 else f"{speed:g}-"
        parts.append(
            {
                "run": np.repeat([f"{series}{i:02d}" for i in range(torque.size)], n),
                "initial_tension_N": np.full(size, 310.0),
                "torque_N_m": np.repeat(torque, n) + 0.02 * rng.normal(size=size),
                "driver_speed_rad_s": speed + driver_noise * loud * rng.normal(size=size),
                "driven_speed_rad_s": (speed - loss) / ratio + noise * loud * rng.normal(size=size),
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


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
    assert result.max_slip_run == max(true, key=true.__getitem__)


def test_unequal_pulleys_are_taken_off_with_the_runs_without_torque():
    columns = drive(ratio=1.03)
    result = fit_slip(columns, 0.05)
    assert result.ratio == pytest.approx(1.03, abs=5 * result.ratio_se)
    assert 0 < result.ratio_se < 1e-4
    loss = np.array([p.speed_loss_rad_s for p in result.points])
    assert loss == pytest.approx(0.01 * np.arange(17.0), abs=4e-3)
    assert any("ratio of the pulleys" in note for note in result.notes)
    assert min(p.slip_speed_se_m_s for p in result.points) > 62.0 * 0.05 * result.ratio_se


@pytest.mark.parametrize(("step", "ratio"), [(0.1, 0.75), (math.pi / 30.0, 0.75), (0.25, 2.0)])
def test_coarse_readings_that_never_change_have_the_error_of_rounding(step, ratio):
    z = []
    for shift in np.linspace(0.0, 1.0, 12, endpoint=False) * step:
        columns = drive(speeds=(22.0 + shift, 62.8 + shift), ratio=ratio, noise=0, driver_noise=0)
        for name in ("driver_speed_rad_s", "driven_speed_rad_s"):
            columns[name] = step * np.round(columns[name] / step)
        result = fit_slip(columns, 0.05)
        assert {p.status for p in result.points} == {"ok"}
        assert abs(result.ratio - ratio) < 3.0 * result.ratio_se
        z += [
            (p.slip_speed_m_s - v) / p.slip_speed_se_m_s
            for p, v in zip(result.points, TRUE, strict=True)
        ]
    assert np.mean(np.abs(z) < 1.96) > 0.9
    assert np.sqrt(np.mean(np.square(z))) > 0.4  # both speeds, and the ratio that they give


@pytest.mark.parametrize("way", [np.linspace(0.0, 1.0, 10), np.zeros(10)])
def test_a_drive_that_comes_up_to_its_speed_and_stops_is_no_operating_point(way):
    columns = drive(n=40)
    for begin in range(0, columns["run"].size, 40):
        for rows in (slice(begin, begin + 10), slice(begin + 39, begin + 29, -1)):
            for name in ("torque_N_m", "driver_speed_rad_s", "driven_speed_rad_s"):
                columns[name][rows] *= way
    result = fit_slip(columns, 0.05)
    assert [p.slip_speed_m_s for p in result.points] == pytest.approx(TRUE[:17], abs=2e-4)
    assert {p.n_samples for p in result.points} <= {20, 21, 22}
    assert "before the driver is up to its speed left out: S00, S01" in result.notes[0]


def test_a_torque_that_is_swept_within_a_run_is_reported():
    columns = drive(n=40)
    assert not fit_slip(columns, 0.05).notes
    columns["run"] = np.full(columns["run"].shape, "sweep")
    (point,) = fit_slip(columns, 0.05).points
    assert point.slip_speed_m_s == pytest.approx(0.01 * 8.0 * 0.05, rel=0.05)
    (note,) = (n for n in fit_slip(columns, 0.05).notes if "torque changes" in n)
    # first and last of eight equal parts: 40, 40 and 5 samples of 0, 1, 2 and 16, 15, 14 N m
    assert "within sweep (0.59 to 15.4 N m)" in note


def test_pulleys_that_are_swapped_are_refused():
    columns = drive()
    driver, driven = columns["driver_speed_rad_s"], columns["driven_speed_rad_s"]
    with pytest.raises(InputError, match="run S16: the driven pulley gains on the driver"):
        fit_slip(columns | {"driver_speed_rad_s": driven, "driven_speed_rad_s": driver}, 0.05)


def test_round_speeds_without_noise_are_no_coarse_readings():
    """20, 40 and 60 rad/s do not show a resolution of 20 rad/s."""
    points = fit_slip(drive(creep=0.0, speeds=(20, 40, 60), noise=0, driver_noise=0), 0.05).points
    assert max(abs(p.speed_loss_rad_s) for p in points) < 1e-9
    assert max(p.slip_speed_se_m_s for p in points) < 1e-9


def test_pulleys_that_are_swapped_look_like_a_driven_pulley_that_drives():
    columns = drive()
    driver, driven = columns["driver_speed_rad_s"], columns["driven_speed_rad_s"]
    swapped = {"driver_speed_rad_s": driven, "driven_speed_rad_s": driver}
    (note,) = fit_slip(columns | swapped | {"torque_N_m": -columns["torque_N_m"]}, 0.05).notes
    assert note.endswith("or the columns of driver and driven speed are swapped")
    # a driven pulley that drives in some runs only is no sign of swapped columns
    assert not fit_slip(drive(torque=np.arange(-8.0, 9.0)), 0.05).notes


def test_without_a_run_without_torque_the_size_of_unequal_pulleys_is_reported():
    (note,) = (n for n in fit_slip(drive([2.0, 4.0, 6.0]), 0.05).notes if "without torque" in n)
    assert note.endswith(
        "radii that differ by 0.1 % would be 0.063 rad/s of the loss at 62.8 rad/s"
    )
    with pytest.raises(InputError, match="no run without torque: the pulleys are taken as equal"):
        fit_slip(drive([2.0, 4.0, 6.0], ratio=2.0), 0.05)  # and where all runs fail


def test_gross_slip_is_marked_and_not_counted_as_service():
    torque = np.arange(0.0, 17.0)
    creep = np.where(torque > 14.5, 0.05, 0.01)
    result = fit_slip(drive(torque, creep), 0.05)
    assert [p.run for p in result.points if p.status == "gross slip"] == ["S15", "S16"]
    assert result.max_slip_run == "S14"
    assert result.max_slip_speed_m_s == pytest.approx(0.01 * 14 * 0.05, rel=0.02)
    lone = fit_slip(drive([0.0, 5.0, 8.0], np.array([0.0, 0.01, 1.0])), 0.05)
    assert [p.status for p in lone.points] == ["ok", "ok", "gross slip"]


@pytest.mark.parametrize(("unknown", "run"), [("torque_N_m", "S04"), ("initial_tension_N", "")])
def test_what_is_unknown_does_not_blind_the_series(unknown, run):
    columns = drive(np.arange(0.0, 17.0), np.where(np.arange(17) > 14, 0.05, 0.01))
    columns[unknown][(columns["run"] == run) | (run == "")] = np.nan
    result = fit_slip(columns, 0.05)
    assert [p.run for p in result.points if p.status == "gross slip"] == ["S15", "S16"]
    assert result.max_slip_speed_m_s == pytest.approx(0.01 * 14 * 0.05, rel=0.02)


def test_gaps_spikes_and_useless_runs_are_kept_apart():
    columns = drive()
    columns["driven_speed_rad_s"][np.flatnonzero(columns["run"] == "S08")[3]] = 0.0
    columns["driver_speed_rad_s"][np.flatnonzero(columns["run"] == "S09")[:5]] = np.nan
    columns["driver_speed_rad_s"][np.flatnonzero(columns["run"] == "S09")[7]] *= 100.0
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


# --- errors of short runs, drives that turn backwards ---


LOUD = {"speeds": (22.0, 62.8), "noise": 3e-3, "driver_noise": 3e-3}


@pytest.mark.parametrize("n", [3, pytest.param(10, marks=pytest.mark.long)])
def test_standard_errors_of_short_runs_are_honest(n):
    z = []
    for seed in range(8):
        points = fit_slip(drive(n=n, seed=seed, **LOUD), 0.05).points
        assert {p.status for p in points} == {"ok"}
        z.append(
            [
                (p.slip_speed_m_s - v) / p.slip_speed_se_m_s
                for p, v in zip(points, TRUE, strict=True)
            ]
        )
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.2
    # 272 values: three binomial standard deviations
    assert np.mean(np.abs(z) < 1.0) == pytest.approx(0.683, abs=0.085)
    assert np.mean(np.abs(z) < 2.0) == pytest.approx(0.954, abs=0.038)


@pytest.mark.parametrize("runs", [2, 5])
def test_standard_errors_hold_with_correlated_noise(runs):
    """Five correlation times a run: an autoregression of a = 0.9 on the driven speed."""
    z = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        columns = drive(torque=np.arange(1.0, runs + 1.0), seed=seed, n=100, noise=0.0)
        noise = rng.normal(size=(100 * runs, 1))
        for run in range(runs):
            mine = noise[100 * run : 100 * run + 100]
            for k in range(1, 100):
                mine[k] = 0.9 * mine[k - 1] + np.sqrt(0.19) * mine[k]
        columns["driven_speed_rad_s"] = columns["driven_speed_rad_s"] + 0.01 * noise[:, 0]
        for point in fit_slip(columns, 0.05).points:
            true = 0.01 * abs(point.torque_N_m) * 0.05
            z.append((point.slip_speed_m_s - true) / point.slip_speed_se_m_s)
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.2


@pytest.mark.parametrize(("n", "share"), [pytest.param(4, 0.6, marks=pytest.mark.long), (10, 1.0)])
def test_a_run_that_shakes_keeps_a_wider_error(n, share):
    ratios = []
    for seed in range(6):
        points = fit_slip(drive(n=n, seed=seed, shaking=5.0, **LOUD), 0.05).points
        se = np.array([p.slip_speed_se_m_s for p in points])
        ratios += (se[[9, 26]] / np.median(np.delete(se, [9, 26]))).tolist()
    # five times as loud, told from its series at a probability of 1e-4: chi² of n - 1 over 21.1/25
    # for four samples (84 % of the runs), 33.7/25 for ten (99.8 %)
    assert np.median(ratios) > 3.0
    assert np.mean(np.array(ratios) > 2.0) >= share


@pytest.mark.parametrize("signed_torque", [False, True])
def test_a_drive_that_turns_backwards_is_the_mirrored_one(signed_torque):
    columns = drive(n=10, seed=4, **LOUD)
    forward = fit_slip(columns, 0.05)
    turned = ["driver_speed_rad_s", "driven_speed_rad_s"] + ["torque_N_m"] * signed_torque
    backward = fit_slip(columns | {name: -columns[name] for name in turned}, 0.05)
    sign = -1.0 if signed_torque else 1.0
    assert backward.points == tuple(
        replace(p, driver_speed_rad_s=-p.driver_speed_rad_s, torque_N_m=sign * p.torque_N_m)
        for p in forward.points
    )
    assert backward.max_slip_speed_m_s == forward.max_slip_speed_m_s
    assert [p.slip_speed_m_s for p in backward.points] == pytest.approx(TRUE, abs=4e-4)
    assert backward.notes[0].startswith("the drive turns backwards in all runs: sign of the speeds")
    assert ("torque" in backward.notes[0]) == signed_torque
    assert not any("backwards" in note for note in forward.notes)
    assert len(backward.notes) == len(forward.notes) + 1


def test_a_load_that_is_counted_as_negative_is_a_load():
    columns = drive()
    forward = fit_slip(columns, 0.05)
    found = fit_slip(columns | {"torque_N_m": -columns["torque_N_m"]}, 0.05)
    assert {p.status for p in found.points} == {"ok"}
    assert found.max_slip_speed_m_s == forward.max_slip_speed_m_s
    assert found.points[9].torque_N_m == pytest.approx(-9.0, abs=0.1)
    assert any("recorded as negative" in note for note in found.notes)
    # a generator drives: its belt gains on the pulley that turns it
    generator = drive(creep=-0.01)
    generator["torque_N_m"] *= -1.0
    assert {p.status for p in fit_slip(generator, 0.05).points} == {"ok"}


@pytest.mark.parametrize("torque", [(0, 2, 4, 6, 8, 10), (3, 6, 9, 12), (4, 8, 12, 14)])
def test_gross_slip_shows_in_a_series_of_few_runs(torque):
    """The last run slips by 3 % of the driver's speed: eight times the creep or more."""
    columns = drive(torque=torque)
    last = columns["run"] == columns["run"][-1]
    columns["driven_speed_rad_s"] = columns["driven_speed_rad_s"] - 0.03 * 62.8 * last
    result = fit_slip(columns, 0.05)
    expected = ["ok"] * (len(torque) - 1) + ["gross slip"]
    assert [p.status for p in result.points] == expected
    assert result.max_slip_speed_m_s == pytest.approx(0.01 * torque[-2] * 0.05, rel=0.05)


def test_pulleys_that_turn_against_each_other_are_no_gross_slip():
    columns = drive(n=10, seed=7, **LOUD)
    columns["driven_speed_rad_s"][columns["run"] == "22-10"] *= -1.0
    points = {p.run: p for p in fit_slip(columns, 0.05).points}
    assert "opposite" in points["22-10"].status
    assert {p.status for p in points.values() if p is not points["22-10"]} == {"ok"}


def test_runs_without_samples_and_with_one():
    runs = [np.array([np.nan, np.nan]), np.array([2.0]), np.arange(8.0) % 2]
    mean, se, _ = pooled_means(runs, np.zeros(3, dtype=int))
    assert mean == pytest.approx([np.nan, 2.0, 0.5], nan_ok=True)
    assert math.isnan(se[0])
    # the variance is that of all: s² = 2/7; 68.27 % interval of t with 7 degrees: t = 1.0767
    assert se[1] == pytest.approx(1.0767 * math.sqrt(2.0 / 7.0), rel=1e-4)


def test_runs_within_two_percent_are_one_series():
    speeds = np.array([10.0, 10.1, 10.15, 10.4, -10.5, 10.55])
    assert speed_series(speeds).tolist() == [0, 0, 0, 1, 1, 1]
    unknown = np.append(speeds, np.nan)  # a series of its own, and too short for one
    assert speed_series(unknown).tolist() == [0] * 7


def test_the_noise_of_a_series_is_one_variance():
    """se² = t² sum of squares / (all degrees of freedom) / n, for white noise and equal runs."""
    runs = [np.array([1.0, 2.0, 0.0]), np.array([5.0, 3.0, 4.0]), np.arange(3.0)]
    mean, se, _ = pooled_means(runs, np.zeros(3, dtype=int))
    assert mean.tolist() == [1.0, 4.0, 1.0]
    # 6 squares over 6 degrees of freedom: s = 1; 68.27 % interval of t with 6 of them: t = 1.0906
    assert se == pytest.approx([1.0906 / math.sqrt(3.0)] * 3, rel=1e-4)


# --- pulley speeds that a belt needs ---


def service(*speeds, se=1e-6):
    return SimpleNamespace(
        points=[SimpleNamespace(slip_speed_m_s=v, slip_speed_se_m_s=se, status=OK) for v in speeds]
    )


def test_range_and_proposal_follow_from_the_sliding_speeds():
    found = required_pulley_speeds(service(0.004, -0.016, 0.008), 0.05)
    assert found.proposed_rad_s == pytest.approx((0.08, 0.08 * 2**0.5, 0.16, 0.16 * 2**0.5, 0.32))
    assert found.covered is None
    assert found.statement == "sliding in service needs pulley speeds from 0.08 to 0.32 rad/s"
    assert required_pulley_speeds(service(0.01), 0.05).proposed_rad_s == pytest.approx((0.2,))


def test_tiny_and_doubtful_speeds_and_runs_set_aside_do_not_count():
    def ends(points):
        proposed = required_pulley_speeds(points, 0.05).proposed_rad_s
        return 0.05 * proposed[0], 0.05 * proposed[-1]

    # a hundredth of the largest
    assert ends(service(0.016, 0.00001)) == pytest.approx((0.00016, 0.016))
    for share, lowest in ((0.99, 0.016), (1.01, SIGNIFICANT * 1.01e-3)):
        doubtful = service(0.016, SIGNIFICANT * share * 1e-3, se=1e-3)
        assert ends(doubtful) == pytest.approx((lowest, 0.016))
    aside = service(0.016, 0.9)
    aside.points[1].status = "gross slip"
    assert ends(aside) == pytest.approx((0.016, 0.016))


@pytest.mark.parametrize(
    ("speeds", "said"),
    [
        ((0.0785, 0.2, 0.326), "covered"),
        ((0.0783, 0.327), "covered"),
        ((0.0815, 0.3137), "covered"),
        ((0.0817, 0.32), "0.08 to 0.0817 rad/s not covered"),
        ((0.08, 0.3135), "0.314 to 0.32 rad/s not covered"),
        ((0.5,), "0.08 to 0.32 rad/s not covered"),
        ((0.01,), "0.08 to 0.32 rad/s not covered"),
    ],
)
def test_an_end_is_missed_by_more_than_a_fiftieth(speeds, said):
    found = required_pulley_speeds(service(0.004, 0.016), 0.05, configured=speeds)
    assert found.covered == (said == "covered")
    rig = ", ".join(f"{w:g}" for w in speeds)
    assert found.statement.endswith(f"; the rig runs at {rig} rad/s: {said}")


def test_what_is_wrong_is_reported_at_once():
    with pytest.raises(InputError) as error:
        required_pulley_speeds(service(), 0.0)
    assert len(error.value.problems) == 2
