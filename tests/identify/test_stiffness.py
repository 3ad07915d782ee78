"""The normal law from press recordings against the laws that made them, and its intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from press_bench import TRUTH, Bench, each_test, force_errors, load
from scipy.optimize import minimize_scalar

from beltid.errors import FitError, InputError
from beltid.identify.press.stiffness import StiffnessSettings, fit_stiffness
from beltid.stages.curves import branch_columns


def settings(bench: Bench, **changes: object) -> StiffnessSettings:
    base = StiffnessSettings(bench.length, 22.0, bench.compliance)
    return replace(base, **changes)


def off(law, *truth: float) -> float:
    """Largest relative error of the force between 10 % and 100 % of the largest force."""
    return force_errors(law, Bench(*truth).force)[0]


@pytest.mark.parametrize("belt", TRUTH)
def test_virtual_bench_gives_the_law_within_three_hundredths_of_a_percent(belt):
    k_linear, k_quadratic, compliance = TRUTH[belt]
    result = fit_stiffness(load(belt), StiffnessSettings(0.04, 22.0, compliance))
    assert off(result.pooled, k_linear, k_quadratic) < 3e-4
    assert [e.temperature_degC for e in result.laws] == [22.0, 40.0, 60.0, 80.0]
    assert not result.temperature.matters
    assert result.temperature.f_p_value > 0.01
    assert result.pooled.temperature_degC is None
    assert abs(result.pooled.k_linear_N_m2 - k_linear) < 3 * result.pooled.k_linear_se_N_m2
    # the virtual belts were pressed to 100 N/cm
    assert result.pooled.max_force_N_m == pytest.approx(1.0e4, rel=2e-3)


def test_the_first_cycle_is_nine_percent_stiffer():
    result = fit_stiffness(load("6pk"), StiffnessSettings(0.04, 22.0, 1.5e-8, cycles="first"))
    k_linear, k_quadratic, _ = TRUTH["6pk"]
    assert off(result.pooled, 1.09 * k_linear, 1.09 * k_quadratic) < 1e-3
    assert any("3 cycles found, used: 1" in note for note in result.notes)


@pytest.mark.parametrize(
    "change",
    [
        {"k_linear": 1.0e8, "k_quadratic": 0.0},
        {"length": 0.10},
        {"unloading_speed": 0.5e-6},
        {"dwell": 5.0, "valley": 0.1, "valley_dwell": 10.0, "cycles": 3, "relaxes_to": 0.0},
        {"dwell": 4.0, "relaxes_to": 0.0, "hysteresis": "relative", "unloading_speed": 5.0e-6},
        {"cycles": 3, "virgin": 0.09, "valley": 0.1, "compliance": 3.0e-8},
        {"zero": 30.0},
        *({"hysteresis": shape, "hysteresis_scale": 3.0} for shape in ("sine", "skew", "fading")),
    ],
    ids=str,
)
def test_other_belts_and_other_ways_to_drive_the_press(change):
    bench = Bench(**{"dt": 0.2, **change})
    result = fit_stiffness(bench.record(2), settings(bench))
    assert off(result.pooled, bench.k_linear, bench.k_quadratic) < 6e-4
    assert not result.temperature.matters


def test_exact_recordings_give_the_exact_law_and_contact_point():
    bench = Bench(hysteresis="none", travel_noise=0.0, force_noise=0.0, temperatures=(22.0,))
    columns = bench.record(3)
    pooled = fit_stiffness(columns, settings(bench)).pooled
    assert pooled.k_linear_N_m2 == pytest.approx(bench.k_linear, rel=1e-8)
    assert pooled.k_quadratic_N_m3 == pytest.approx(bench.k_quadratic, rel=1e-8)
    contact = np.max(columns["displacement_mm"]) - 1e3 * bench.top
    # the last sample before the reversal lies up to a step of 0.17 µm below the top
    assert pooled.contact_offset_mm == pytest.approx(contact, abs=1.8e-4)


def test_a_temperature_effect_is_seen_and_the_pooled_law_is_that_of_the_reference():
    bench = Bench(temperature_slope=-0.002)
    result = fit_stiffness(bench.record(6), settings(bench, reference_temperature_degC=38.0))
    assert result.temperature.matters
    assert result.temperature.f_p_value < 1e-6
    factor = 1.0 - 0.002 * 18.0
    assert off(result.pooled, factor * bench.k_linear, factor * bench.k_quadratic) < 1e-3
    assert any("40 °C alone" in note for note in result.notes)


def test_scatter_between_tests_is_the_yardstick_for_temperatures():
    bench = Bench(tests_per_temperature=3)
    columns = bench.record(7)
    rng = np.random.default_rng(8)
    for rows in each_test(columns):  # segments differ by 2 %, temperatures do not
        columns["force_N"][rows] *= 1.0 + 0.02 * rng.normal()
    result = fit_stiffness(columns, settings(bench))
    assert not result.temperature.matters
    assert "scatter of tests" in result.temperature.statement
    assert abs(result.pooled.k_linear_N_m2 / bench.k_linear - 1.0) < 0.02
    assert result.pooled.k_linear_se_N_m2 > 0.002 * bench.k_linear
    (scatter,) = (f for f in result.pooled.findings if f.check == "scatter of the tests")
    assert scatter.size > 3.0


def test_with_one_test_at_each_temperature_a_segment_may_differ_as_well():
    bench = Bench(dt=0.3)
    columns = bench.record(7)
    for rows, scale in zip(each_test(columns), (0.97, 1.02, 1.0, 1.03), strict=True):
        columns["force_N"][rows] *= scale
    result = fit_stiffness(columns, settings(bench))
    assert result.temperature.matters  # as far as these tests can tell
    assert off(result.pooled) > 0.029
    (found,) = (f for f in result.pooled.findings if f.check == "sole tests")
    assert found.size == pytest.approx(0.03, rel=0.05)  # half of 6 %
    assert found.unseen
    assert found.text in result.notes
    again = Bench(dt=0.3, temperature_slope=-0.002, tests_per_temperature=2)
    pairs = fit_stiffness(again.record(7), settings(again))
    assert pairs.temperature.matters
    assert not any(f.check == "sole tests" for f in pairs.pooled.findings)


def test_without_temperatures_there_is_one_pooled_law():
    columns = Bench(dt=0.3).record(10)
    del columns["temperature_degC"]
    result = fit_stiffness(columns, settings(Bench()))
    assert (result.laws, result.pooled.n_cycles) == ((), 4)
    assert off(result.pooled) < 1e-3
    assert np.isnan(result.temperature.f_p_value)


def test_a_curve_that_softens_a_little_gives_a_linear_law_and_how_far_off_it_is():
    bench = Bench(k_linear=1.6e8, k_quadratic=-4.0e11, temperatures=(22.0,), top_force=1.2e4)
    pooled = fit_stiffness(bench.record(13), settings(bench)).pooled
    assert pooled.k_quadratic_N_m3 == 0.0
    note = next(n for n in pooled.warnings if "clearly negative" in n)
    # best straight line, contact point free, through a parabola over the range of the nodes
    delta = np.linspace(0.0, bench.top, 400)
    line = np.polyval(np.polyfit(delta, bench.force(delta), 1), delta)
    off = 100.0 * np.max(np.abs(bench.force(delta) - line)) / bench.top_force
    told = float(note.split("off by up to ")[1].split(" %")[0])
    assert told == pytest.approx(off, rel=0.25)


def steep(power: float) -> Bench:
    """A bench whose force grows with a power of the penetration."""
    return Bench(powers=((1e4 / 1e-4**power, power),), dt=0.3)


def test_a_cubic_force_gives_the_best_law_without_a_linear_part_and_its_distance():
    bench = steep(3.0)
    pooled = fit_stiffness(bench.record(1), settings(bench)).pooled
    assert pooled.k_linear_N_m2 == 0.0
    # least squares of k (delta - offset)² through the true curve, from where the unloading branch,
    # s³ - 0.24 s (1 - s), carries a hundredth of the force
    s = np.linspace(0.2, 1.0, 8001)
    begin = float(s[s**3 - 0.24 * s * (1.0 - s) < 0.01][-1])
    delta = np.linspace(begin, 1.0, 2000) * bench.top
    force = bench.force(delta)

    def squares(offset: float) -> float:
        column = np.maximum(delta - offset, 0.0) ** 2
        return float(np.sum((force - column * (column @ force) / (column @ column)) ** 2))

    column = (delta - minimize_scalar(squares, (0.0, 0.1 * bench.top)).x) ** 2
    assert pooled.k_quadratic_N_m3 == pytest.approx(column @ force / (column @ column), rel=0.01)
    # a coefficient that would have to be negative is told with its sign
    assert any("k_linear² came out as -" in w and "off by up to" in w for w in pooled.warnings)


def test_a_curve_far_from_the_law_is_refused_with_its_numbers_and_what_other_laws_make_of_it():
    bench = steep(0.4)
    with pytest.raises(FitError, match=r"k_quadratic came out as -\d.*must be >= 0") as refused:
        fit_stiffness(bench.record(13), settings(bench))
    said = refused.value.problems[-1]
    assert "the laws compared" in said
    assert all(law in said for law in ("linear off by", "quadratic off by", "cubic off by"))
    exponent = float(said.split("power (exponent ")[1].split(")")[0])
    assert exponent == pytest.approx(0.4, rel=0.05)


def test_recordings_that_cannot_be_used_are_refused_all_at_once():
    columns = Bench().record(14)
    first, second, *_ = each_test(columns)
    columns["force_N"][first] = np.random.default_rng(1).normal(size=first.size)
    columns["displacement_mm"][second[10:]] = np.nan
    result = fit_stiffness(columns, settings(Bench()))
    (noise, why), (short, few) = result.recording.set_aside
    assert (noise, short) == ("S22-0", "S40-0")
    assert "no contact found" in why
    assert "must be at least 20" in few
    assert off(result.pooled) < 1e-3
    bad = np.concatenate([first, second])
    with pytest.raises(InputError) as error:
        fit_stiffness({k: v[bad] for k, v in columns.items()}, settings(Bench()))
    assert error.value.problems == (why, few)


def test_branches_for_figures_start_at_the_contact_point():
    bench = Bench(temperatures=(22.0,))
    columns = branch_columns(fit_stiffness(bench.record(16), settings(bench)))
    for name in ("loading", "unloading"):
        here = columns["branch"] == name
        penetration, force = columns["penetration_m"][here], columns["line_force_N_m"][here]
        assert 60 < penetration.size <= 130
        assert np.max(np.abs(force[penetration < -1e-6])) < 5.0
        assert penetration.max() == pytest.approx(bench.top, rel=0.01)
