"""Belts and rigs that no config of the project knows, against an independent model of the rig."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from discrete_rod import Array, DiscreteRod, Friction, constant

import beltid

F_LOW, F_HIGH = 20.0, 4.0e4


def falling_with_force(mu_0: float, a: float) -> Friction:
    """mu_0 (f/5400)**-a, constant below F_LOW."""

    def mu(f: Array) -> tuple[Array, Array]:
        m = mu_0 * (np.maximum(f, F_LOW) / 5400.0) ** -a
        return m, np.where(f > F_LOW, -a * m / np.maximum(f, F_LOW), 0.0)

    return mu


def saturating(mu_0: float, floor: float, f_s: float) -> Friction:
    """mu_0 (floor + (1 - floor)/(1 + f/f_s)): not a power of the force."""

    def mu(f: Array) -> tuple[Array, Array]:
        m = mu_0 * (floor + (1.0 - floor) / (1.0 + f / f_s))
        return m, -mu_0 * (1.0 - floor) / f_s / (1.0 + f / f_s) ** 2

    return mu


def surface_of(mu: Friction) -> beltid.FrictionSurface:
    f = np.geomspace(F_LOW, F_HIGH, 100)
    return beltid.FrictionSurface(
        normal_force_N_m=f, slip_speed_m_s=[1e-3, 1e-1], mu=np.column_stack([mu(f)[0]] * 2)
    )


@pytest.mark.parametrize(
    ("EI", "T_0", "k_1", "k_2", "tight", "slack"),
    [
        (0.02, 270.0, 6.5e7, 3.0256e11, 371.09, 182.01),
        (0.02, 100.0, 1.0e8, 0.0, 143.41, 70.50),
        (0.0005, 270.0, 1.0e8, 0.0, 367.81, 179.81),
    ],
)
def test_the_independent_model_gives_the_published_reference_tensions(
    EI: float, T_0: float, k_1: float, k_2: float, tight: float, slack: float
) -> None:
    rod = DiscreteRod(1.0e5, EI, 0.05, 0.10, math.radians(82), k_1, k_2)
    found = rod.tensions(rod.lay_on(T_0), constant(0.5))
    # 600 elements; its error falls with the square of their length
    assert found == pytest.approx((tight, slack), rel=5e-5)


UNSEEN = {
    "wide arc, short span": (1.8e5, 0.012, 0.04, 0.07, 150, 4.0e7, 3.5e11, 220.0),
    "narrow arc": (0.6e5, 0.008, 0.06, 0.15, 25, 8.0e7, 1.5e11, 300.0),
    "small pulley, stiff belt, slack": (2.1e5, 0.030, 0.03, 0.12, 90, 5.0e7, 2.0e11, 60.0),
    "large pulley": (1.0e5, 0.020, 0.08, 0.20, 60, 7.0e7, 4.0e11, 150.0),
}
LAWS = {"power": falling_with_force(0.8, 0.2), "saturating": saturating(1.1, 0.5, 3000.0)}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("bench", UNSEEN)
def test_the_simulated_rig_gives_the_tensions_of_the_independent_model(
    bench: str, law: str
) -> None:
    EA, EI, R, span, arc, k_1, k_2, T_0 = UNSEEN[bench]
    rod = DiscreteRod(EA, EI, R, span, math.radians(arc), k_1, k_2)
    tight, slack = rod.tensions(rod.lay_on(T_0), LAWS[law])
    config = beltid.load_config(
        {
            "belt": {"axial_stiffness_N": EA, "bending_stiffness_N_m2": EI},
            "rig": {"pulley_radius_m": R, "span_length_m": span},
        }
    )
    run = beltid.simulate_rig(
        config,
        surface_of(LAWS[law]),
        beltid.NormalLaw(k_linear_N_m2=k_1, k_quadratic_N_m3=k_2),
        arc_deg=arc,
        initial_tension_N=T_0,
        pulley_speed_rad_s=0.2,
        method="steady",
    )
    # the bounds the simulated rig is held to with a surface that is known
    assert run.tension_tight_N == pytest.approx(tight, rel=2e-3)
    assert run.tension_slack_N == pytest.approx(slack, rel=2e-3)
    assert run.mu == pytest.approx(math.log(tight / slack) / math.radians(arc), rel=3e-3)


def bench_recording() -> tuple[dict[str, Array], dict[str, tuple[float, float]]]:
    """Recordings of a rig nobody has built, and (mu_sliding, mu_sticking) of each run.

    Odd labels, no temperature, one run with exchanged cells, one turned backwards.
    """
    rng = np.random.default_rng(11)
    EA, R, span = 0.9e5, 0.045, 0.12
    columns: dict[str, list[Array]] = {}
    truth = {}
    settings = product((50, 110), (120.0, 300.0), (0.06, 0.25, 0.7))
    rods = {
        arc: DiscreteRod(EA, 0.012, R, span, math.radians(arc), 5e7, 2.6e11) for arc in (50, 110)
    }
    for k, (arc, T_0, omega) in enumerate(settings):
        beta, v = math.radians(arc), omega * R
        mu_0 = 0.6 * (1.0 + 0.1 * math.log(v / 0.01))
        laid = rods[arc].lay_on(T_0)
        level = np.array(rods[arc].tensions(laid, falling_with_force(mu_0, 0.22)))
        top = np.array(rods[arc].tensions(laid, falling_with_force(1.06 * mu_0, 0.22)))
        t = np.arange(0.0, 1.0 + max(3.0, 0.03 / v), 0.02)
        travel = np.maximum(t - 1.0, 0.0) * v
        reach = 1.1 * (top[0] - T_0) * (span + R * beta / 3.0) / EA
        tail = np.exp(-np.maximum(travel - reach, 0.0) / 0.005)[:, None]
        rise = np.clip(travel / reach, 0.0, 1.0)[:, None]
        T = T_0 + (level + (top - level) * tail - T_0) * rise
        T *= 1.0 + 0.004 * np.sin(60.0 * travel / R + 0.3 * k)[:, None] * [1.0, -0.6] * (rise > 0.0)
        T += 0.6 * rng.normal(size=T.shape)
        label = f"Lauf {k + 1}"
        mu_sliding, mu_sticking = (math.log(a[0] / a[1]) / beta for a in (level, top))
        truth[label] = (mu_sliding, mu_sticking)
        speed = (t > 1.0) * omega * (1.0 + 3e-3 * rng.normal(size=t.size))
        part = {
            "run": np.full(t.size, label, dtype=object),
            "time_s": t,
            "tension_tight_N": T[:, 1 if k == 3 else 0],
            "tension_slack_N": T[:, 0 if k == 3 else 1],
            "pulley_speed_rad_s": -speed if k == 5 else speed,
            "arc_deg": np.full(t.size, float(arc)),
            "initial_tension_N": np.full(t.size, T_0),
        }
        for name, values in part.items():
            columns.setdefault(name, []).append(values)
    return {name: np.concatenate(parts) for name, parts in columns.items()}, truth


def test_a_bench_nobody_has_seen_is_reduced_to_the_friction_that_made_it() -> None:
    columns, truth = bench_recording()
    config = beltid.load_config({"rig": {"pulley_radius_m": 0.045, "span_length_m": 0.12}})
    table = beltid.fit_friction(columns, config).to_frame().set_index("run")
    assert list(table.index) == list(truth)
    assert set(table["status"]) == {"ok"}
    sliding, sticking = np.array(list(truth.values())).T
    error = table["mu_sliding"].to_numpy() / sliding - 1.0
    assert math.sqrt(np.mean(error**2)) < 2.5e-3
    assert np.max(np.abs(error)) < 1e-2
    slow = table["pulley_speed_rad_s"].to_numpy() < 0.5
    peak = table["mu_sticking"].to_numpy(dtype=float)[slow] / sticking[slow] - 1.0
    resolved = np.isfinite(peak)
    assert np.count_nonzero(resolved) > 0.8 * peak.size
    assert math.sqrt(np.mean(peak[resolved] ** 2)) < 0.03
    # honest errors: three in four within two standard errors is far from what chance allows
    uncertainty = table["mu_sliding_se"].to_numpy()
    assert np.mean(np.abs(error * sliding) < 2.0 * uncertainty) > 0.75
