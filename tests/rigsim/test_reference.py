"""The simulated rig against other models: the reference table, the elastic rod, the virtual bench.

The reference numbers come from a discrete elastic rod, Richardson extrapolated; the rod of
``rod.py`` is a third model, in strong form. The bench data are synthetic.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from rig_bench import LAW_5PK, LINEAR_LAW, at, bench, start, true_surface_5pk
from rod import Rod

from beltid.laws.capstan import mean_normal_force
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Contact
from beltid.rigsim.rig import Method, SimulationSettings, simulate

ROOT = Path(__file__).parents[2]
STEADY = SimulationSettings(method="steady")

# EI, T_0, law, T_tight, T_slack, mu, last digit of mu
TABLE = [
    (0.02, 270.0, LAW_5PK, 371.09, 182.01, 0.49777, 1e-5),
    (0.02, 100.0, LINEAR_LAW, 143.41, 70.50, 0.4962, 1e-4),
    (0.02, 270.0, LINEAR_LAW, 370.97, 181.94, 0.4978, 1e-4),
    (0.02, 450.0, LINEAR_LAW, 614.69, 301.12, 0.4986, 1e-4),
    (0.0005, 270.0, LINEAR_LAW, 367.81, 179.81, 0.5000, 1e-4),
]


@pytest.mark.parametrize("method", ["steady", "transient"])
@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"EI{row[0]:g}-T{row[1]:g}")
@pytest.mark.parametrize(
    ("elements", "tension", "mu"),
    [(None, 2e-3, 1e-3), (100, 5e-4, 2e-4)],
    ids=["default mesh", "refined"],
)
def test_reference_table(
    method: Method,
    row: tuple[float, float, NormalLaw, float, float, float, float],
    elements: int | None,
    tension: float,
    mu: float,
) -> None:
    EI, T_0, law, T_tight, T_slack, apparent, digit = row
    run = simulate(bench(EI, law=law), at(82, T_0), SimulationSettings(method, elements))
    assert run.tension_tight_N == pytest.approx(T_tight, rel=tension)
    assert run.tension_slack_N == pytest.approx(T_slack, rel=tension)
    # the table has four digits in some rows: half a unit of the last one comes on top
    assert run.mu == pytest.approx(apparent, abs=mu * apparent + digit / 2)
    assert run.mu == pytest.approx(
        math.log(run.tension_tight_N / run.tension_slack_N) / math.radians(82), rel=1e-14
    )


def test_profile_of_the_first_row() -> None:
    run = simulate(bench(law=LAW_5PK), at(82, 270), SimulationSettings("steady", 200))
    # 0.05 % as for the tensions, or half a unit of the digits given
    assert run.profile["normal_force_N_m"].max() == pytest.approx(9695, rel=5e-4)
    assert run.normal_force_N_m == pytest.approx(5308, abs=1)
    assert run.normal_force_N_m == pytest.approx(
        mean_normal_force(run.tension_tight_N, run.tension_slack_N, 0.05), rel=1e-14
    )
    # a contact point stands for a part of the belt, 1/5 of an element, that touches in part
    part = (2 * 0.1 + 0.05 * math.radians(82)) / 200 / 5
    position = run.profile["arc_position_m"]
    assert position[-1] - position[0] == pytest.approx(65.8e-3, abs=2 * part)
    deepest = LAW_5PK.penetration(run.profile["normal_force_N_m"].max())
    assert float(deepest) == pytest.approx(101e-6, abs=0.5e-6)


@pytest.fixture(scope="module")
def build_up() -> dict[float, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Tensions and sticking share over 0.2 mm of travel at two speeds, no Kelvin-Voigt damping."""
    curves = {}
    for omega in (0.02, 0.1):
        rig = bench(law=LINEAR_LAW, damping_time=0.0, contact=Contact(C_P=0.0))
        march = start(rig, at(82, 270, omega), elements=100)
        steps = 200
        travel = 2e-4 / steps
        assert march.go(travel / (0.05 * omega), omega, steps) == steps
        share = march.record["sticking"] / march.record["touching"]
        curves[omega] = (march.T_A.copy(), march.T_B.copy(), share)
    return curves


@pytest.mark.parametrize(
    ("travel_um", "T_tight", "T_slack", "sticks"),
    [(50, 311.6, 230.4, 0.64), (100, 350.1, 197.8, 0.22), (150, 370.97, 181.94, 0.0)],
)
def test_reference_build_up(
    build_up: dict[float, tuple[np.ndarray, np.ndarray, np.ndarray]],
    travel_um: int,
    T_tight: float,
    T_slack: float,
    sticks: float,
) -> None:
    """Exactly at the steps of 50, 100 and 150 um; 0.05 % of the tension."""
    T_A, T_B, share = build_up[0.02]
    k = travel_um - 1
    assert T_A[k] == pytest.approx(T_tight, rel=5e-4)
    assert T_B[k] == pytest.approx(T_slack, rel=5e-4)
    # a patch is 1.7 % of the contact; the front may stand one patch further at either end
    assert share[k] == pytest.approx(sticks, abs=0.034)


def test_build_up_over_travel_does_not_depend_on_the_speed(
    build_up: dict[float, tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> None:
    """The sudden start sends axial waves of sqrt(EA rhoA) v through the belt: they remain."""
    slow, fast = build_up[0.02], build_up[0.1]
    wave = math.sqrt(1.0e5 * 0.10) * 0.1 * 0.05
    assert np.abs(slow[0] - fast[0]).max() < wave
    assert np.abs(slow[1] - fast[1]).max() < wave
    assert wave < 0.002 * 270


@pytest.mark.parametrize(
    ("arc", "EI", "T_0", "mu", "R", "span", "clamped"),
    [
        (82, 0.02, 270, 0.5, 0.05, 0.10, True),
        (170, 0.01, 200, 1.0, 0.03, 0.15, False),
        (25, 0.03, 100, 1.5, 0.08, 0.12, False),
        (40, 0.02, 50, None, 0.05, 0.10, False),
        (150, 0.004, 450, None, 0.03, 0.08, False),
    ],
)
def test_tensions_agree_with_the_elastic_rod_in_strong_form(
    arc: float, EI: float, T_0: float, mu: float | None, R: float, span: float, clamped: bool
) -> None:
    surface = FrictionSurface.constant(mu) if mu else true_surface_5pk()
    rod = Rod(
        1e5, EI, R, span, math.radians(arc), LAW_5PK, lambda f: surface.mu(f, 0.21 * R), clamped
    )
    tight, slack = rod.solve(T_0, 1e-4)
    rig = bench(
        EI, R=R, span=span, law=LAW_5PK, mu=surface, supports="clamped" if clamped else "pinned"
    )
    for elements, tolerance in ((None, 2e-3), (200, 5e-5)):
        run = simulate(rig, at(arc, T_0), SimulationSettings("steady", elements))
        assert run.tension_tight_N == pytest.approx(tight, rel=tolerance)
        assert run.tension_slack_N == pytest.approx(slack, rel=tolerance)


def test_tensions_converge_with_the_mesh_to_the_rod() -> None:
    rod = Rod(1e5, 0.02, 0.05, 0.1, math.radians(82), LINEAR_LAW, lambda f: 0.5 + 0 * f)
    exact = rod.solve(100, 1e-5)
    n = np.array([20, 40, 80, 160])
    errors = []
    for elements in n:
        run = simulate(bench(), at(82, 100), SimulationSettings("steady", int(elements)))
        errors.append(
            max(abs(run.tension_tight_N / exact[0] - 1), abs(run.tension_slack_N / exact[1] - 1))
        )
    rate = -np.polyfit(np.log(n), np.log(errors), 1)[0]
    assert rate > 2.5
    assert errors[-1] < 1e-6


def truth() -> list[dict[str, float]]:
    with open(ROOT / "tests" / "truth" / "5pk" / "truth.csv", newline="") as file:
        return [{k: float(v) for k, v in row.items() if k != "run"} for row in csv.DictReader(file)]


def test_true_surface_gives_the_apparent_friction_of_the_virtual_bench() -> None:
    rig = bench(law=LAW_5PK, mu=true_surface_5pk())
    rows = truth()
    assert len(rows) == 120
    errors = []
    for row in rows:
        run = simulate(rig, at(row["arc_deg"], row["T0"], row["omega"]), STEADY)
        assert run.record.clamped_lookups == 0
        errors.append(run.mu / row["mu_app"] - 1)
    assert np.abs(errors).max() < 3e-3
    # every tenth in time, at all arcs and speeds
    errors = []
    for row in rows[3::11]:
        run = simulate(rig, at(row["arc_deg"], row["T0"], row["omega"]))
        errors.append(run.mu / row["mu_app"] - 1)
    assert np.abs(errors).max() < 3e-3
