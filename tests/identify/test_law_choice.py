"""Choice of the normal law: a known law in, the same law out; what a wrong law costs is seen."""

from __future__ import annotations

import math

import numpy as np
import pytest
from press_bench import Bench, joined

from beltid.errors import InputError
from beltid.identify.press.curves import read_recording
from beltid.identify.press.dissipation import estimate_dissipation
from beltid.identify.press.laws import choose_normal_law
from beltid.identify.press.stiffness import StiffnessSettings, fit_stiffness

SETTINGS = StiffnessSettings(0.04)
POWER = Bench(powers=((1e4 / 1.2e-4**1.6, 1.6),), dt=0.2)
CUBIC = Bench(powers=((5e7, 1), (0.5e11, 2), (2.5e15, 3)))


def curves_of(record, settings=SETTINGS):
    return read_recording(record, settings).curves


def candidate(choice, law):
    return next(c for c in choice.laws if c.law == law)


@pytest.mark.parametrize(
    ("record", "law", "truth", "share", "verdict"),
    [
        (Bench().record(1), "quadratic", [6.5e7, 3.0256e11], 0.05, "The quadratic law is supp"),
        (POWER.record(4), "power", [1e4 / 1.2e-4**1.6, 1.6], 0.05, "A power (exponent 1.6"),
        (CUBIC.record(5), "cubic", [5e7, 0.5e11, 2.5e15], 1.0, "A cubic law predicts better by "),
    ],
    ids=["quadratic", "power", "cubic"],
)
def test_the_law_of_the_bench_is_recognised(record, law, truth, share, verdict):
    choice = choose_normal_law(curves_of(record))
    assert choice.quadratic_supported == (law == "quadratic")
    assert choice.verdict.startswith(verdict)
    found = candidate(choice, law)
    for p, value in zip(found.parameters, truth, strict=True):
        assert abs(p.value - value) < 4.0 * p.se, p.name
        assert p.se < share * abs(value), p.name
    if law != "quadratic":
        gain = f"predicts better by {100 * (1 - found.cv_ratio):.2g} %"
        assert gain in choice.verdict
        return
    linear, power, cubic = (candidate(choice, n) for n in ("linear", "power", "cubic"))
    assert min(linear.criterion, power.criterion) > 100.0
    assert linear.cv_ratio > 10.0
    # one coefficient too many is found to be nothing
    k_cubic = cubic.parameters[2]
    assert k_cubic.value <= 4.0 * k_cubic.se
    assert cubic.criterion > -6.0


def test_noise_free_laws_come_out_exactly_and_the_simplest_wins():
    exact = {"travel_noise": 0.0, "force_noise": 0.0, "hysteresis": "none"}
    for bench, law, truth in (
        (Bench(k_linear=9e7, k_quadratic=0.0, **exact), "linear", [9e7]),
        (Bench(**exact), "quadratic", [6.5e7, 3.0256e11]),
        (Bench(powers=CUBIC.powers, **exact), "cubic", [5e7, 0.5e11, 2.5e15]),
    ):
        best = min(choose_normal_law(curves_of(bench.record(0))).laws, key=lambda c: c.criterion)
        assert best.law == law
        # the nodes are means over bins of the curve: exact to the curvature within them
        assert list(best.values.values()) == pytest.approx(truth, rel=2e-3)


@pytest.mark.parametrize("power", [0.8, None])
def test_the_quadratic_law_that_is_judged_is_the_one_that_is_handed_on(power):
    """Where a coefficient would be negative, too."""
    powers = ((1e4 / 1.2e-4**power, power),) if power else ()
    record = Bench(powers=powers, dt=0.3).record(4)
    pooled = fit_stiffness(record, SETTINGS).pooled
    choice = choose_normal_law(curves_of(record))
    quadratic = candidate(choice, "quadratic")
    values = [pooled.k_linear_N_m2, pooled.k_quadratic_N_m3]
    assert list(quadratic.values.values()) == pytest.approx(values, rel=1e-6)
    held = [p for p in quadratic.parameters if not p.value]
    assert len(held) == (power is not None)
    assert ("held at zero" in quadratic.note) == bool(held)
    assert bool(held) == (f"A power (exponent {power}" in choice.verdict)
    for p in quadratic.parameters:
        # the residuals of a law that does not hold are correlated: its errors are no measure
        assert 0.0 < p.se < (math.inf if power else 0.1 * p.value)


def test_single_test_is_judged_by_blocks_of_force():
    choice = choose_normal_law(curves_of(POWER.record(8))[1:2])
    assert 0.0 < candidate(choice, "power").cv_ratio < 1.0
    assert "power" in choice.verdict


def test_loss_at_several_speeds_tells_a_damper_from_hysteresis():
    def recording(scale):
        speeds = {k: {"speed": 1.7e-6 * k, "unloading_speed": 1.7e-6 * k} for k in (1, 2, 4)}
        benches = [
            Bench(temperatures=(22.0,), hysteresis_scale=scale(k), **both)
            for k, both in speeds.items()
        ]
        return joined(*(bench.record(k) for k, bench in enumerate(benches)), labels="TUV")

    flat = estimate_dissipation(curves_of(recording(lambda f: 1.0)))
    viscous = estimate_dissipation(curves_of(recording(lambda f: 0.4 * f)))
    assert flat.rate_exponent == pytest.approx(0.0, abs=0.02)
    assert viscous.rate_exponent == pytest.approx(1.0, abs=0.03)
    assert "speed^1" in viscous.statement


def test_criterion_is_aicc_of_the_independent_nodes():
    curves = curves_of(Bench().record(12))
    choice = choose_normal_law(curves)
    m, tests = choice.n_effective, len(curves)

    def aicc(law, coefficients):
        k = coefficients + tests + 1
        return m * np.log(candidate(choice, law).rms_residual_N_m ** 2) + 2 * k * m / (m - k - 1)

    reference = aicc("quadratic", 2)
    for law, coefficients in (("linear", 1), ("power", 2), ("cubic", 3)):
        expected = aicc(law, coefficients) - reference
        assert candidate(choice, law).criterion == pytest.approx(expected, abs=1e-6)


def test_prediction_does_not_know_the_test_that_it_predicts():
    """Two tests, one 10 % stiffer: half of that is left by one law, all of it in prediction."""
    bench = Bench(temperatures=(22.0, 42.0), temperature_slope=0.005, hysteresis="none")
    quadratic = candidate(choose_normal_law(curves_of(bench.record(13))), "quadratic")
    assert quadratic.cv_error_N_m / quadratic.rms_residual_N_m == pytest.approx(2.0, rel=0.05)


def test_loss_of_branches_in_proportion_to_the_law():
    """Branches f (1 ± 0.12): the loop over the work of loading is 0.24 / 1.12."""
    silent = {"travel_noise": 0.0, "force_noise": 0.0, "temperatures": (22.0,)}
    bench = Bench(hysteresis="relative", tests_per_temperature=2, **silent)
    found = estimate_dissipation(curves_of(bench.record(1)))
    assert found.loss_ratio == pytest.approx(0.24 / 1.12, rel=2e-3)
    top = bench.top
    law = bench.k_linear * top**2 / 2 + bench.k_quadratic * top**3 / 3
    assert found.energy_J_m == pytest.approx(0.24 * law, rel=2e-3)
    assert found.approach_speed_m_s == pytest.approx(1.7e-6, rel=0.01)
    # a damper at the speed of the press over the depth of the contact, of a millimetre of belt
    assert found.C_P_N_s_m == pytest.approx(1e-3 * 0.24 * law / (1.7e-6 * top), rel=0.02)
    equal = 1e3 * found.approach_speed_m_s * found.C_P_N_s_m / 300.0
    assert f"300 N s/m loses as much at {equal:.3g} mm/s" in found.statement
    assert math.isnan(found.rate_exponent)
    assert "no single C_P" in found.statement
    pooled = fit_stiffness(bench.record(1), SETTINGS).pooled
    assert pooled.hysteresis_ratio == pytest.approx(0.24 / 1.12, rel=2e-3)


def test_a_clock_that_stands_is_refused():
    record = Bench(temperatures=(22.0,), dt=0.3).record(0)
    record["time_s"] = np.zeros_like(record["time_s"])
    with pytest.raises(InputError, match="test S22-0: the clock does not run"):
        estimate_dissipation(curves_of(record))
