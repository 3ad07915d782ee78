"""Intervals of the stiffness coefficients over many synthetic presses with a known law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from press_bench import Bench

from beltid.errors import InputError
from beltid.identify.press.stiffness import StiffnessSettings, fit_stiffness

ONE = Bench(temperatures=(22.0,), tests_per_temperature=3, dt=0.2)


@pytest.mark.parametrize(
    "press",
    [
        pytest.param(
            replace(ONE, hysteresis="skew", force_noise=1.5, travel_noise=2e-7), id="loud"
        ),
        pytest.param(
            replace(ONE, zero=3.0, toe=6e-5, hysteresis="relative"),
            id="zero and way to contact",
            marks=pytest.mark.long,
        ),
        pytest.param(
            replace(ONE, k_linear=2e7, k_quadratic=6e11, compliance=1.5e-8),
            id="softer, compliant machine",
            marks=pytest.mark.long,
        ),
    ],
)
def test_intervals_hold_for_noise_hysteresis_contact_and_zero(press: Bench) -> None:
    settings = StiffnessSettings(press.length, 22.0, press.compliance)
    z = []
    for seed in range(30):
        law = fit_stiffness(press.record(seed), settings).pooled
        z.append(
            (
                (law.k_linear_N_m2 - press.k_linear) / law.k_linear_se_N_m2,
                (law.k_quadratic_N_m3 - press.k_quadratic) / law.k_quadratic_se_N_m3,
            )
        )
    # binomial: 0.95 of 30, standard deviation 0.04
    assert np.all(np.mean(np.abs(z) < 1.96, axis=0) >= 0.86)
    assert np.all(np.std(z, axis=0) > 0.55)


def test_known_gains_of_the_press_give_the_law_of_the_undistorted_record() -> None:
    columns = ONE.record()
    settings = StiffnessSettings(ONE.length, 22.0, 1e-9)
    read = {
        **columns,
        "force_N": columns["force_N"] / 1.04,
        "displacement_mm": columns["displacement_mm"] / 0.97,
    }
    gains = replace(settings, force_gain=1.04, displacement_gain=0.97)
    true, found = (fit_stiffness(c, s) for c, s in ((columns, settings), (read, gains)))
    assert found.pooled.k_linear_N_m2 == pytest.approx(true.pooled.k_linear_N_m2, rel=1e-9)
    assert found.pooled.k_quadratic_N_m3 == pytest.approx(true.pooled.k_quadratic_N_m3, rel=1e-9)
    assert any("force gain 1.04 applied" in note for note in found.notes)
    # F = a x + b x² with x' = x/0.97, F' = F/1.04: the coefficients are a 0.97/1.04, b 0.97²/1.04
    plain = fit_stiffness(read, replace(settings, machine_compliance_m_N=0.0)).pooled
    free = fit_stiffness(columns, replace(settings, machine_compliance_m_N=0.0)).pooled
    assert plain.k_linear_N_m2 / free.k_linear_N_m2 == pytest.approx(0.97 / 1.04, rel=1e-3)
    assert plain.k_quadratic_N_m3 / free.k_quadratic_N_m3 == pytest.approx(0.97**2 / 1.04, rel=1e-3)
    with pytest.raises(InputError, match=r"press.force_gain = 0.0, must be in \[0.1, 10\]"):
        replace(settings, force_gain=0.0)
