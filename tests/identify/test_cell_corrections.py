"""Corrections of the load cells from their difference at rest: numbers by hand, both sides."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from beltid.identify.friction.imbalance import CellCorrection, correction_of_one, corrections
from scipy.optimize import brute, fmin

from beltid.identify.friction.channels import Channels
from beltid.identify.friction.rest_phase import Rest

TENSIONS = np.array([120.0, 160.0, 200.0, 240.0, 280.0, 320.0, 360.0, 400.0])


def rests(imbalance, se=0.05, tension=TENSIONS):
    imbalance = np.broadcast_to(imbalance, tension.shape)
    return [Rest(100, float(t), float(x), se) for t, x in zip(tension, imbalance, strict=True)]


def test_a_correction_keeps_the_mean_at_rest():
    cells = Channels(
        time_s=np.arange(3.0),
        tight=np.array([203.0, 303.0, np.nan]),
        slack=np.array([197.0, 97.0, 90.0]),
        speed=np.ones(3),
        temperature=None,
        n_spikes=0,
        n_missing=0,
    )
    assert CellCorrection().applied(cells) is cells
    moved = CellCorrection(offset_N=6.0).applied(cells)
    assert moved.tight[:2].tolist() == [200.0, 300.0]
    assert moved.slack.tolist() == [200.0, 100.0, 93.0]
    scaled = CellCorrection(gain=0.03).applied(cells)
    assert scaled.tight[:2] == pytest.approx([203.0 / 1.015, 303.0 / 1.015], rel=1e-14)
    assert scaled.slack == pytest.approx([197.0 / 0.985, 97.0 / 0.985, 90.0 / 0.985], rel=1e-14)


def test_what_is_left_in_doubt_adds_up_in_squares():
    tight, slack, rest = 400.0, 100.0, 250.0
    per_newton = 0.5 * (1 / 400.0 + 1 / 100.0)  # of a difference of the zero points
    alone = [
        (CellCorrection(offset_se_N=2.0), 2.0 * per_newton),
        (CellCorrection(gain_se=0.004), 0.004),
        (CellCorrection(doubt_N=-3.0), 3.0 * per_newton),
        (CellCorrection(common_zero_N=2.0), 2.0 * (1 / 100.0 - 1 / 400.0)),
        (CellCorrection(offset_N=-4.0, cause_open=True), 2.0 * (per_newton - 1 / 250.0)),
        (CellCorrection(offset_N=-4.0), 0.0),
    ]
    for correction, expected in alone:
        found = correction.log_ratio_se(tight, slack, rest)
        assert found == pytest.approx(expected, rel=1e-12)
    whole = CellCorrection(
        offset_N=-4.0, offset_se_N=2.0, gain_se=0.004, common_zero_N=2.0, doubt_N=-3.0,
        cause_open=True,
    )  # fmt: skip
    expected = math.sqrt(sum(value**2 for _, value in alone))
    assert whole.log_ratio_se(tight, slack, rest) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_run_is_corrected_from_three_thousandths_and_five_errors(sign):
    for imbalance, se, corrected in (
        (0.61, 0.1, True),
        (0.59, 0.1, False),  # less than 0.003 of 200 N
        (0.9, 0.179, True),
        (0.9, 0.181, False),  # less than five errors
    ):
        found = correction_of_one(Rest(50, 200.0, sign * imbalance, se), "auto")
        if corrected:
            assert found.offset_N == sign * imbalance
            assert (found.offset_se_N, found.doubt_N, found.cause_open) == (se, 0.0, True)
            assert found.common_zero_N == 0.5 * imbalance
            relative = f"{100 * imbalance / 200.0:.2g}"
            said = f"differ by {sign * imbalance:+.3g} N at rest ({relative} %), taken off as a"
            assert said in found.note
        else:
            assert found.offset_N == 0.0
            five = imbalance > 5 * se
            assert found == (CellCorrection(doubt_N=sign * imbalance) if five else CellCorrection())
        left = correction_of_one(Rest(50, 200.0, sign * imbalance, se), False)
        assert left.offset_N == 0.0
        assert left.doubt_N == (sign * imbalance if imbalance > 5 * se else 0.0)
        assert ("not corrected" in left.note) == corrected


def test_on_demand_every_difference_is_taken_off_and_clear_ones_are_told():
    for imbalance, told, clear in ((0.4, False, False), (0.7, False, True), (1.1, True, True)):
        found = correction_of_one(Rest(50, 200.0, imbalance, 0.05), True)
        assert (found.offset_N, found.offset_se_N) == (imbalance, 0.05)
        assert found.common_zero_N == (0.5 * imbalance if clear else 0.0)
        assert bool(found.note) == told  # from five thousandths
    assert correction_of_one(Rest(50, 200.0, 0.01, 0.05), False) == CellCorrection()
    # without noise a ten thousandth of the tension is the measure
    assert correction_of_one(Rest(50, 200.0, 0.019, 0.0), False).doubt_N == 0.0
    assert correction_of_one(Rest(50, 200.0, 0.021, 0.0), False).doubt_N == 0.021


def test_fewer_than_five_runs_are_judged_each_by_itself():
    few, enough = rests(1.5, tension=TENSIONS[:4]), rests(1.5, tension=TENSIONS[:5])
    assert corrections(few, "auto") == [correction_of_one(rest, "auto") for rest in few]
    assert corrections(enough, "auto") != [correction_of_one(rest, "auto") for rest in enough]
    assert corrections(enough, False) == [correction_of_one(rest, False) for rest in enough]


def most_likely(x, se, unit):
    """Mean, scatter and largest log likelihood of x = unit (mean + scatter), by brute force."""

    def cost(p):
        sigma = np.sqrt(se**2 + (p[1] * unit) ** 2)
        z = (x - p[0] * unit) / sigma
        return float(np.sum(2.5 * np.log(1 + z * z / 4) + np.log(sigma)))

    ratio = x / unit
    spread = float(np.ptp(ratio)) + 5 * float(np.max(se / unit))
    box = ((ratio.min() - spread, ratio.max() + spread), (0.0, 2 * spread))
    best = brute(cost, box, Ns=60, finish=None)
    best = fmin(cost, best, xtol=1e-10, ftol=1e-12, disp=False)
    return best[0], abs(best[1]), -cost(best)


def test_zero_points_are_weighed_with_the_noise_of_each_run():
    rng = np.random.default_rng(1)
    imbalance = 2.0 + 0.3 * rng.normal(size=8)
    found = corrections(rests(imbalance, 0.1), "auto")
    mean, scatter, _ = most_likely(imbalance, np.full(8, 0.1), np.ones(8))
    share = scatter**2 / (scatter**2 + 0.01)
    mean_se = math.sqrt((0.01 + scatter**2) / 8)
    for correction, x in zip(found, imbalance, strict=True):
        assert correction.offset_N == pytest.approx(mean + share * (x - mean), abs=2e-3)
        assert correction.offset_se_N == pytest.approx(
            math.hypot(math.sqrt(share) * 0.1, (1 - share) * mean_se), rel=0.02
        )
        assert correction.common_zero_N == pytest.approx(0.5 * math.hypot(mean, scatter), rel=0.01)
        assert (correction.gain, correction.doubt_N, correction.cause_open) == (0.0, 0.0, False)
        assert f"differ by {mean:+.3g} N over all runs" in correction.note
    wander = [abs(share * (x - mean)) > 0.1 * mean for x in imbalance]
    assert [" and wander by " in c.note for c in found] == wander
    percent = [float(re.search(r"\(([\d.]+) %\) taken off", c.note)[1]) for c in found]
    expected = [100 * c.offset_N / t for c, t in zip(found, TENSIONS, strict=True)]
    assert percent == pytest.approx(expected, rel=0.06)


def test_a_run_unlike_the_others_keeps_its_doubt():
    imbalance = np.full(8, 2.0)
    imbalance[3] = 9.0
    found = corrections(rests(imbalance), "auto")
    assert found[3].offset_N == pytest.approx(2.0, abs=0.05)
    assert found[3].doubt_N == pytest.approx(7.0, abs=0.05)
    assert "unlike in the other runs" in found[3].note
    assert found[2].offset_N == pytest.approx(2.0, abs=0.05)
    assert found[2].doubt_N == 0.0


def test_gains_are_told_by_their_proportion_to_the_tension():
    rng = np.random.default_rng(2)
    imbalance = 0.012 * TENSIONS + 0.1 * rng.normal(size=8)
    found = corrections(rests(imbalance, 0.1), "auto")
    expected = float(np.sum(imbalance * TENSIONS) / np.sum(TENSIONS**2))
    for correction in found:
        assert correction.gain == pytest.approx(expected, rel=0.02)
        assert correction.gain_se == pytest.approx(
            0.1 / math.sqrt(float(np.sum(TENSIONS**2))), rel=0.05
        )
        assert correction.offset_N == 0.0
        assert abs(correction.doubt_N) < 0.1
        assert correction.note.startswith(f"the gains of the cells differ by {100 * expected:+.2g}")
    imbalance[5] += 8.0
    found = corrections(rests(imbalance, 0.1), "auto")
    assert found[5].doubt_N == pytest.approx(8.0, abs=0.3)
    assert "N of the imbalance at rest in proportion to the tension is left" in found[5].note
    assert "is left" not in found[4].note


def test_friction_of_tightening_scatters_with_the_tension_and_is_left():
    part = 0.02 * np.random.default_rng(3).normal(size=120)
    tension = np.tile(np.geomspace(50.0, 800.0, 8), 15)
    found = corrections(rests(part * tension, tension=tension), "auto")
    for correction, p, t in zip(found, part, tension, strict=True):
        assert (correction.gain, correction.offset_N) == (0.0, 0.0)
        assert correction.doubt_N == pytest.approx(p * t, rel=0.02, abs=0.02)


def test_at_one_tension_zero_points_and_gains_cannot_be_told_apart():
    found = corrections(rests(2.0, tension=np.full(6, 250.0)), "auto")
    assert all(c.cause_open and c.offset_N == pytest.approx(2.0, abs=0.01) for c in found)


@pytest.mark.parametrize(("size", "corrected"), [(0.35, False), (0.45, True)])
def test_a_common_difference_counts_from_a_thousandth_of_some_tension(size, corrected):
    tension = np.linspace(400.0, 420.0, 8)
    found = corrections(rests(size, 1e-3, tension), "auto")
    assert all((c.offset_N != 0.0 or c.gain != 0.0) == corrected for c in found)


def test_noise_is_no_fault_of_the_cells():
    for seed in range(5):
        noise = np.random.default_rng(seed).normal(size=8)
        assert corrections(rests(noise, 1.0), "auto") == [CellCorrection()] * 8
