"""Agreement of two campaigns: matched by settings, judged without mercy for gaps and nan."""

from dataclasses import replace

import numpy as np
import pytest

from beltid.arrays import Columns
from beltid.errors import InputError
from beltid.identify.agreement import compare_points

ARCS, TENSIONS, SPEEDS = (40.0, 68.0, 82.0), (50.0, 150.0, 270.0, 450.0), (0.05, 0.21, 0.84)


def campaign(label: str = "R") -> Columns:
    arc, tension, speed = (a.ravel() for a in np.meshgrid(ARCS, TENSIONS, SPEEDS, indexing="ij"))
    n = arc.size
    return {
        "run": np.array([f"{label}{k:03d}" for k in range(n)], dtype=object),
        "arc_deg": arc,
        "nominal_tension_N": tension,
        "pulley_speed_rad_s": speed,
        "normal_force_N_m": tension / 0.05 * (1 + arc / 1e4),
        "mu_sliding": 1.0 + 0.1 * np.log(speed) - 1e-4 * tension,
        "status": np.full(n, "ok", dtype=object),
    }


def pair() -> tuple[Columns, Columns]:
    return campaign("M"), campaign("S")


def shuffled(columns: Columns, seed: int = 4) -> Columns:
    order = np.random.default_rng(seed).permutation(columns["run"].size)
    return {k: a[order] for k, a in columns.items()}


def test_difference_is_simulated_less_measured_over_measured() -> None:
    measured, simulated = pair()
    simulated["mu_sliding"] = measured["mu_sliding"] * 1.02
    result = compare_points(measured, shuffled(simulated))
    assert result.columns["mu_measured"] == pytest.approx(measured["mu_sliding"], rel=1e-15)
    assert result.columns["difference"] == pytest.approx(0.02 * measured["mu_sliding"], rel=1e-12)
    assert result.columns["relative_difference"] == pytest.approx(np.full(36, 0.02), rel=1e-12)
    assert list(result.columns["run"]) == list(measured["run"])
    assert result.not_compared == {}
    assert result.passed  # without tolerances nothing is judged
    assert result.columns["within_tolerance"].all()
    backward = {**measured, "pulley_speed_rad_s": -1.01 * measured["pulley_speed_rad_s"]}
    assert np.array_equal(
        compare_points(backward, simulated).columns["mu_simulated"], simulated["mu_sliding"]
    )


def test_statistics_of_hand_made_differences() -> None:
    measured, simulated = pair()
    relative = np.zeros(36)
    relative[[0, 1, 2]] = 0.03, -0.04, 0.12  # arc 40°, lowest tension
    simulated["mu_sliding"] = measured["mu_sliding"] * (1 + relative)
    groups = {row["group"]: row for row in compare_points(measured, simulated).groups}
    arcs, words = ("40°", "68°", "82°"), ("low", "middle", "high")
    thirds = [f"{word} third of the force" for word in words]
    assert list(groups) == ["all points", *(f"arc {a}" for a in arcs), "means over arcs", *thirds]
    overall = groups["all points"]
    assert overall["n_points"] == 36
    assert overall["rms_percent"] == pytest.approx(13 / 6)  # sqrt(9 + 16 + 144) = 13
    assert overall["mean_percent"] == pytest.approx(11 / 36)
    assert overall["mean_magnitude_percent"] == pytest.approx(19 / 36)
    assert overall["largest_percent"] == pytest.approx(12.0)
    assert groups["arc 40°"]["rms_percent"] == pytest.approx(13 / np.sqrt(12))
    assert groups["arc 68°"]["largest_percent"] == pytest.approx(0.0, abs=1e-13)
    low, middle, high = (groups[third] for third in thirds)
    assert [third["n_points"] for third in (low, middle, high)] == [12, 12, 12]
    assert low["largest_percent"] == pytest.approx(12.0)
    assert low["force_high_N_m"] <= middle["force_low_N_m"]
    assert middle["force_high_N_m"] <= high["force_low_N_m"]


def test_mean_over_arcs_is_taken_before_the_difference() -> None:
    measured, simulated = pair()
    factor = {40.0: 1.06, 68.0: 1.0, 82.0: 0.94}  # cancels in the mean over arcs
    simulated["mu_sliding"] = measured["mu_sliding"] * [factor[a] for a in measured["arc_deg"]]
    result = compare_points(measured, simulated)
    assert result.groups[0]["rms_percent"] == pytest.approx(6.0 * np.sqrt(2 / 3))
    (means,) = (row for row in result.groups if row["group"] == "means over arcs")
    assert means["n_points"] == 12
    assert means["largest_percent"] == pytest.approx(0.0, abs=1e-12)
    assert np.array_equal(result.averaged["n_arcs"], np.full(12, 3))
    setting = result.averaged["nominal_tension_N"][0], result.averaged["pulley_speed_rad_s"][0]
    assert setting == pytest.approx((50.0, 0.05))


def test_nearest_speed_wins_within_the_tolerance() -> None:
    measured = {k: a[:1] for k, a in campaign("M").items()}
    simulated = {k: np.repeat(a[:1], 3) for k, a in campaign("S").items()}
    simulated["run"] = np.array(["a", "b", "c"], dtype=object)
    simulated["pulley_speed_rad_s"] = 0.05 * np.array([0.98, 1.005, 1.02])
    simulated["mu_sliding"] = np.array([1.0, 2.0, 3.0])
    assert compare_points(measured, simulated).columns["mu_simulated"] == [2.0]
    simulated["run"][2] = "M000"  # the same label says more than a percent of speed
    assert compare_points(measured, simulated).columns["mu_simulated"] == [3.0]


def test_runs_without_partner_and_set_aside_are_counted_with_reasons() -> None:
    measured, simulated = pair()
    measured["status"][3] = "never slides"
    measured["mu_sliding"][5], measured["mu_sliding"][6] = np.nan, np.inf
    simulated["mu_sliding"][11] = -1.0
    simulated["status"][7] = "never settles: the standard error of its level is 6 %, allowed is 5 %"
    keep = np.arange(36) != 9
    simulated = {k: a[keep] for k, a in simulated.items()}
    extra = {k: np.concatenate([a, a[:1]]) for k, a in simulated.items()}
    extra["arc_deg"][-1] = 120.0
    extra["run"][-1] = "S999"
    result = compare_points(measured, extra)
    assert result.groups[0]["n_points"] == 30
    assert np.isfinite(result.columns["relative_difference"]).all()
    assert result.not_compared == {
        "measured: never slides": 1,
        "measured: mu_sliding not a number > 0": 2,
        "simulated: never settles": 1,
        "simulated: mu_sliding not a number > 0": 1,
        "no simulated run with these settings": 1,
        "no measured run with these settings": 1,
    }
    assert dict(result.not_compared_runs)["simulated S999"] == "no measured run with these settings"


@pytest.mark.parametrize(
    "name", ["max_rms_relative_error", "max_mean_relative_error", "max_relative_error"]
)
def test_each_tolerance_decides(name: str) -> None:
    measured, simulated = pair()
    sign = np.where(np.arange(36) % 2, 1.0, -1.0)  # errors of both signs do not cancel
    simulated["mu_sliding"] = measured["mu_sliding"] * (1 + 0.03 * sign)
    assert compare_points(measured, simulated, {name: 0.0301}).passed
    failed = compare_points(measured, simulated, {name: 0.0299})
    assert not failed.passed
    (row,) = failed.judged
    found = pytest.approx(0.03)
    assert row == {"tolerance": name, "found": found, "allowed": 0.0299, "holds": False}


@pytest.mark.parametrize(("u", "said"), [(0.01, "ratio 2 "), (0.009, "ratio 2.2 ")])
def test_differences_beyond_twice_their_uncertainty_fail_it(u: float, said: str) -> None:
    measured, simulated = pair()
    simulated["mu_sliding"] = measured["mu_sliding"] * 1.02
    found = compare_points(measured, simulated, {"max_rms_relative_error": 0.05})
    assert found.verdict == "PASS: rms 2.00 % <= 5 %"
    assert found.against_uncertainty == ""
    known = replace(found, rms_over_u=0.02 / u)
    assert "error is 2 % RMS" in known.against_uncertainty
    assert said in known.against_uncertainty
    assert known.passed
    assert known.verdict.endswith(
        "FAIL of the uncertainty: the differences are 2.2 times as large"
    ) == (u < 0.01)


def test_comparison_of_nothing_is_an_error_that_says_why() -> None:
    measured, simulated = pair()
    simulated["arc_deg"] = simulated["arc_deg"] + 5
    with pytest.raises(InputError) as error:
        compare_points(measured, simulated)
    assert "no measured run has a simulated partner" in error.value.problems[0]
    assert "36 runs: no simulated run with these settings" in error.value.problems
    empty = {k: a[:0] for k, a in simulated.items()}
    with pytest.raises(InputError, match="36 measured and 0 simulated"):
        compare_points(measured, empty)
    measured["mu_sliding"][:] = np.nan
    with pytest.raises(InputError, match="36 runs: measured: mu_sliding not a number > 0"):
        compare_points(measured, campaign("S"))
