"""Sensitivities against differences; the contact along the arc at given times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, sensitivity_of, true_surface_5pk

from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.rigsim.rig import SimulationSettings, simulate

STEADY = SimulationSettings("steady")
OMEGA = 0.21
V = OMEGA * 0.05


@pytest.mark.parametrize(
    ("supports", "span"),
    # on the shortest span the belt touches right up to the supports
    [("pinned", 0.1), ("clamped", 0.1), ("pinned", 0.002), ("clamped", 0.002)],
)
@pytest.mark.parametrize("shape", [lambda f: np.ones_like(f), lambda f: np.log(f / 5400.0)])
def test_sensitivities_are_differences_of_the_tensions(supports, span, shape) -> None:
    surface = true_surface_5pk(40, 5)
    rig = bench(law=LAW_5PK, mu=surface, supports=supports, span=span)
    f, v = surface.normal_force_N_m, surface.slip_speed_m_s
    step = 1e-4

    def shifted(sign: float) -> FrictionSurface:
        return FrictionSurface(f, v, surface.mu_nodes + sign * step * shape(f)[:, None])

    found = sensitivity_of(rig, at(82, 270, OMEGA))
    up, down = (
        simulate(replace(rig, surface=shifted(sign)), at(82, 270, OMEGA), STEADY)
        for sign in (1.0, -1.0)
    )
    looked_up = found.normal_force_N_m
    change = (shifted(1.0).mu(looked_up, V) - shifted(-1.0).mu(looked_up, V)) / (2 * step)
    for name in ("tension_tight_N", "tension_slack_N"):
        by_difference = (getattr(up, name) - getattr(down, name)) / (2 * step)
        assert getattr(found, name) @ change == pytest.approx(by_difference, rel=1e-4)


def test_the_slip_front_moves_through_the_snapshots() -> None:
    """Reference model: 64 % of the contact sticks after 50 µm of travel, 22 % after 100 µm."""
    rig = bench(mu=0.5)
    speed = 0.02 * 0.05
    times = tuple(travel / speed for travel in (25e-6, 50e-6, 100e-6, 140e-6))
    run = simulate(rig, at(82, 270, 0.02), SimulationSettings(profile_times_s=times))
    start = run.recording["time_s"][np.flatnonzero(run.recording["pulley_speed_rad_s"])[0] - 1]
    assert len(run.snapshots) == 4
    sticking = []
    for wanted, (time, contact) in zip(times, run.snapshots, strict=True):
        # the end of the step that holds the time
        assert 0.0 <= time - start - wanted <= 3e-6 / speed
        profile = contact.profile()
        sticking.append(profile["sticks"].mean())
        moving = profile["slip_speed_m_s"][~profile["sticks"]]
        assert np.all(moving > -1e-9)
        assert np.all(moving < 1.01 * speed)
    assert np.all(np.diff(sticking) < 0.0)
    assert sticking[1] == pytest.approx(0.64, abs=0.06)  # patches of 6 % of the contact
    assert sticking[2] == pytest.approx(0.22, abs=0.06)
    # at the end everything slides with the pulley's speed
    assert not run.profile["sticks"].any()
    np.testing.assert_allclose(run.profile["slip_speed_m_s"], speed, rtol=2e-3)


def test_profile_shows_the_peaks_where_the_belt_enters_and_leaves() -> None:
    rig = bench(law=LAW_5PK, mu=0.5)
    run = simulate(rig, at(82, 270, OMEGA), SimulationSettings("steady", elements=60))
    p = run.profile
    f, s = p["normal_force_N_m"], p["arc_position_m"]
    assert np.all(np.diff(s) > 0)
    assert f.max() == pytest.approx(9695, rel=2e-3)  # reference table (docs/verification.md)
    # a second peak at the exit, above its surroundings, and (8) between the two
    leaving = s > 0.75 * s.max()
    assert f[leaving].max() > 1.2 * f[np.abs(s - 0.6 * s.max()).argmin()]
    middle = np.abs(s - s.mean()) < 0.1 * s.mean()
    np.testing.assert_allclose(f[middle], p["capstan_force_N_m"][middle], rtol=0.03)
    # the axial force falls from the tight to the slack tension, without ripple
    assert np.all(np.diff(p["tension_N"]) < 0.2)
    assert p["tension_N"][0] == pytest.approx(run.tension_tight_N, rel=5e-3)
    assert p["tension_N"][-1] == pytest.approx(run.tension_slack_N, rel=1e-2)


def test_settings_tell_what_is_wrong_all_at_once() -> None:
    with pytest.raises(InputError) as caught:
        SimulationSettings(method="static", elements=7, steps=3)  # type: ignore[arg-type]
    assert len(caught.value.problems) == 3
