"""The simulated rig and the drives, against independent solutions and closed forms."""

import copy
import math
from typing import Any

import numpy as np
import pandas as pd
import pytest

import beltid
from golden import kept
from golden.door import ROOT
from golden.test_chain import true_mu

BEDS = {"4pk": (5.6e7, 2.20e11), "5pk": (6.5e7, 3.0256e11), "6pk": (7.1e7, 3.90e11)}
LAW_5PK = beltid.NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)


def true_surface(belt: str, slowest: float = 0.0025) -> beltid.FrictionSurface:
    """True law of a synthetic belt on a fine grid; below the speeds of the rig its value there."""
    f = np.geomspace(20, 30000, 70)
    v = np.concatenate([[1e-7, 1e-5], np.geomspace(slowest, 0.042, 25)])
    mu = true_mu(belt, f[:, None], np.clip(v, slowest, 0.042))
    return beltid.FrictionSurface(normal_force_N_m=f, slip_speed_m_s=v, mu=mu)


def belt_config(belt: str, **sections: Any) -> Any:
    """Config of a synthetic belt (rigdata/README.md)."""
    EA, EI = {"4pk": (0.8e5, 0.016), "5pk": (1e5, 0.02), "6pk": (1.2e5, 0.024)}[belt]
    section = {"axial_stiffness_N": EA, "bending_stiffness_N_m2": EI, "mass_per_length_kg_m": 0.1}
    return beltid.load_config({"belt": section, **sections})


def steady(
    config: Any, surface: Any, law: Any, arc_deg: float, T0: float, speed: float
) -> np.ndarray:
    """Sliding tensions of the tight and the slack span."""
    run = beltid.simulate_rig(
        config,
        surface,
        law,
        arc_deg=arc_deg,
        initial_tension_N=T0,
        pulley_speed_rad_s=speed,
        method="steady",
    )
    return np.array([run.tension_tight_N, run.tension_slack_N])


@pytest.mark.parametrize("belt", BEDS)
def test_120_runs_of_an_independent_rod(belt: str) -> None:
    """Sliding tensions of the virtual bench without noise; every third run where it is quick."""
    config = belt_config(belt)
    law = beltid.NormalLaw(*BEDS[belt])
    surface = true_surface(belt)
    truth = pd.read_csv(ROOT / f"tests/truth/{belt}/truth.csv")
    errors = []
    for row in truth.iloc[:: 1 if belt == "5pk" else 3].itertuples():
        found = steady(config, surface, law, row.arc_deg, row.T0, row.omega)
        errors += [*(found / [row.Td, row.Tj] - 1)]
    percent = 100 * np.abs(errors)
    kept.check(f"mechanics/{belt}", {"at_most": {"largest_percent": float(percent.max())}})
    assert percent.max() < 0.05


REFERENCE = [
    (0.02, 270, (6.5e7, 3.0256e11), 371.09, 182.01),
    (0.02, 100, (1e8, 0.0), 143.41, 70.50),
    (0.02, 270, (1e8, 0.0), 370.97, 181.94),
    (0.02, 450, (1e8, 0.0), 614.69, 301.12),
    (0.0005, 270, (1e8, 0.0), 367.81, 179.81),
]


@pytest.mark.parametrize(("EI", "T0", "law", "tight", "slack"), REFERENCE)
def test_discrete_rod(
    EI: float, T0: float, law: tuple[float, float], tight: float, slack: float
) -> None:
    """Static limit of a discrete elastic rod, Richardson extrapolated; constant mu 0.5, 82 deg."""
    config = beltid.load_config({"belt": {"bending_stiffness_N_m2": EI}})
    found = steady(config, 0.5, beltid.NormalLaw(*law), 82, T0, 0.21)
    assert found == pytest.approx((tight, slack), rel=2e-4)


def test_build_up_of_friction() -> None:
    """Tensions over the travel of the pulley, of the same rod with the exact Coulomb law."""
    config = beltid.load_config({})
    run = beltid.simulate_rig(
        config,
        0.5,
        beltid.NormalLaw(1e8, 0.0),
        arc_deg=82,
        initial_tension_N=270,
        pulley_speed_rad_s=0.05,
        method="transient",
    )
    record = run.recording
    turning = (record["pulley_speed_rad_s"] > 0).to_numpy()
    start = record["time_s"][~turning].max()
    travel = (record["time_s"] - start) * 0.05 * 0.05
    rise = 370.97 - 270
    table = ((50e-6, 311.6, 230.4), (100e-6, 350.1, 197.8), (150e-6, 370.97, 181.94))
    for at, tight, slack in table:
        found = [np.interp(at, travel, record[f"tension_{span}_N"]) for span in ("tight", "slack")]
        assert found == pytest.approx((tight, slack), abs=0.0075 * rise), at


GIVEN = {
    "weight_tight": {"holds": "weight_tight"},
    "weight_slack": {"holds": "weight_slack"},
    "hub_force": {"holds": "hub_force"},
    "clamped": {"supports": "clamped"},
    "radius_20_mm": {"pulley_radius_m": 0.02},
    "radius_80_mm": {"pulley_radius_m": 0.08},
}


@pytest.mark.parametrize("name", GIVEN)
def test_given_forces_supports_and_radii(name: str) -> None:
    config = belt_config("5pk", rig=GIVEN[name])
    found: dict[str, list[float]] = {"tension_tight_N": [], "tension_slack_N": []}
    for arc in (25, 82, 170):
        tensions = steady(config, 0.7, LAW_5PK, arc, 200, 0.21)
        for values, tension in zip(found.values(), tensions, strict=True):
            values.append(float(tension))
        if name.startswith("weight"):  # the weight stays
            assert tensions[int(name == "weight_slack")] == pytest.approx(200, rel=1e-6)
    kept.check(f"mechanics/{name}", found)


def test_sensitivities_as_differences() -> None:
    """What the tensions do when a parameter grows by 1 %: differences of public results."""
    base: dict[str, Any] = {
        "belt": {"bending_stiffness_N_m2": 0.02, "axial_stiffness_N": 1e5},
        "rig": {"pulley_radius_m": 0.05, "span_length_m": 0.1},
    }

    def tensions(values: dict[str, Any], factor: float = 1.0) -> np.ndarray:
        surface = beltid.FrictionSurface(
            normal_force_N_m=[1000, 10000],
            slip_speed_m_s=[0.001, 0.1],
            mu=factor * np.array([[0.9, 1.1], [0.6, 0.8]]),
        )
        return np.log(steady(beltid.load_config(values), surface, LAW_5PK, 68, 270, 0.21))

    start = tensions(base)
    found = {"mu": (tensions(base, 1.01) - start) / 0.01}
    for section, key in [(s, k) for s, keys in base.items() for k in keys]:
        changed = copy.deepcopy(base)
        changed[section][key] *= 1.05
        found[key] = (tensions(changed) - start) / 0.05
    rounded = {key: [round(float(x), 3) for x in value] for key, value in found.items()}
    kept.check("mechanics/sensitivities", {"difference": rounded})


def drive(belt: dict[str, float], law: Any, surface: Any, **section: Any) -> pd.DataFrame:
    """Simulate a drive."""
    config = beltid.load_config({"belt": belt, "drive": section})
    return beltid.simulate_drive(config, surface, law).to_frame()


def two_pulleys(radius: float, centres: float) -> list[dict[str, Any]]:
    """Two equal pulleys."""
    names = (("driver", 0.0), ("driven", centres))
    return [{"name": n, "x_m": x, "y_m": 0.0, "radius_m": radius} for n, x in names]


def section_of(radius: float = 0.05, centres: float = 0.25, **more: Any) -> dict[str, Any]:
    """Two equal pulleys on fixed centres, strings."""
    return {"method": "string", "pulleys": two_pulleys(radius, centres)} | more


def points(speed: float, torque: float, pulley: str = "driven") -> dict[str, Any]:
    """One operating point."""
    return {"driver_speed_rad_s": [speed], "torque_N_m": {pulley: [torque]}}


@pytest.mark.parametrize(
    ("EA", "T0", "speed", "torque", "tight", "slack", "driven", "arc"),
    [
        (1e5, 310.0, 62.8, 8.0, 350.1629596, 270.1598264, 62.7499333, 30.1078088),
        (1e4, 300.0, 300.0, 10.0, 351.2478746, 250.4008025, 297.0772488, 54.4752881),
    ],
)
def test_strings_on_rigid_pulleys(
    EA: float,
    T0: float,
    speed: float,
    torque: float,
    tight: float,
    slack: float,
    driven: float,
    arc: float,
) -> None:
    """T1: closed forms with the stretching acceleration (Bechtel et al. 2000)."""
    belt = {"axial_stiffness_N": EA, "mass_per_length_kg_m": 0.1}
    rigid = beltid.NormalLaw(1e16, 0.0)
    frame = drive(
        belt,
        rigid,
        0.5,
        **section_of(
            0.1, 0.1 * math.pi, initial_tension_N=[T0], operating_points=points(speed, torque)
        ),
    )
    row = frame.set_index("pulley").loc["driven"]
    found = sorted([row["tension_in_N"], row["tension_out_N"]])
    assert found == pytest.approx([slack, tight], rel=1e-8)
    assert row["speed_rad_s"] == pytest.approx(driven, rel=1e-8)
    assert row["arc_used_deg"] == pytest.approx(arc, rel=1e-7)


@pytest.mark.parametrize(
    ("mu", "load", "tight", "slack", "elements"),
    [
        (0.5, 25.0, 662.80, 186.47, (664.52, 186.27)),
        (0.5, 0.0, 519.77, 286.59, (520.57, 286.21)),
        (1.0, 25.0, 654.27, 177.97, None),
    ],
)
def test_a_published_finite_element_drive(
    mu: float, load: float, tight: float, slack: float, elements: tuple[float, float] | None
) -> None:
    """T2: THREAD-2-3/beltDriveSimulation, whose strain counts from a reference length.

    Its stress-free length is 0.95 of that. The string was solved independently; theirs, with 480
    nodes, differs by its gravity and numerical creep. The load is `load` + 2 omega of the driven.
    """
    R, span = 0.1, 0.1 * math.pi
    omega_2 = 12.0
    for _ in range(12):
        section = section_of(R, span, operating_points=points(12.0, load + 2.0 * omega_2))
        section["belt_length_m"] = 0.95 * (2.0 * span + 2.0 * math.pi * R)
        belt = {"axial_stiffness_N": 7600.0, "mass_per_length_kg_m": 0.8288 / 0.95}
        row = drive(belt, beltid.NormalLaw(3.2e8 / 0.95, 0.0), mu, **section)
        row = row.set_index("pulley").loc["driven"]
        omega_2 = row["speed_rad_s"]
    found = sorted([row["tension_in_N"], row["tension_out_N"]])
    assert found == pytest.approx([slack, tight], rel=2e-4)
    if elements is not None:
        assert found == pytest.approx(sorted(elements), rel=3e-3)
    if load and mu == 0.5:
        assert omega_2 / 12.0 == pytest.approx(0.94221, rel=1e-5)
        assert row["arc_used_deg"] == pytest.approx(145.8, abs=0.05)


@pytest.mark.parametrize(
    ("speed", "T0", "torque", "tight", "slack", "loss"),
    [
        (22.0, 310.0, 8.0, 391.162, 230.932, 0.048255),
        (22.0, 310.0, 16.0, 476.497, 156.035, 0.096533),
        (22.0, 310.0, 29.5, 642.989, 52.092, 0.177687),
        (62.8, 310.0, 16.0, 475.711, 155.249, 0.275689),
        (76.8, 411.0, 16.0, 574.822, 254.246, 0.328767),
        (62.8, 160.0, 14.0, 313.217, 32.974, 0.254106),
    ],
)
def test_strings_with_the_true_law(
    speed: float, T0: float, torque: float, tight: float, slack: float, loss: float
) -> None:
    """T3: the 5PK belt, below full slip, where the friction at low speeds does not count."""
    frame = drive(
        {},
        LAW_5PK,
        true_surface("5pk"),
        **section_of(initial_tension_N=[T0], operating_points=points(speed, torque)),
    )
    row = frame.set_index("pulley").loc["driven"]
    found = sorted([row["tension_in_N"], row["tension_out_N"]])
    assert found == pytest.approx([slack, tight], rel=3e-5)
    assert row["speed_loss_rad_s"] == pytest.approx(loss, rel=2e-5)
    total = sum(row[f"loss_{part}_rad_s"] for part in ("creep", "seating", "slip"))
    assert total == pytest.approx(row["speed_loss_rad_s"], rel=1e-6)


def test_accessory_drive_of_a_vendor() -> None:
    """T4: Gates AG00686 (as cited in kaydgn/MFSim), an inextensible belt without mass."""
    arm = math.radians(42 + 33.1)
    pulleys = [
        {"name": "CRK", "x_m": 0.0, "y_m": 0.0, "radius_m": 0.0812},
        {
            "name": "TEN",
            "x_m": -0.18 + 0.09 * math.cos(arm),
            "y_m": 0.1 + 0.09 * math.sin(arm),
            "radius_m": 0.0386,
            "side": "back",
        },
        {"name": "A_C", "x_m": -0.224, "y_m": 0.448, "radius_m": 0.0647},
        {"name": "IDR", "x_m": -0.072, "y_m": 0.267, "radius_m": 0.0386, "side": "back"},
    ]
    spring = {
        "pulley": "TEN",
        "pivot_m": [-0.18, 0.1],
        "arm_m": 0.09,
        "free_angle_deg": 42,
        "preload_N_m": 8.59,
        "rate_N_m_deg": 0.482,
    }
    rpm = np.array([800, 1000, 1250, 1500, 1750, 2000])
    loads = {
        "driver_speed_rad_s": (rpm * math.pi / 30).tolist(),
        "power_W": {"A_C": [3000, 4000, 5000, 5500, 6800, 8200]},
    }
    belt = {"axial_stiffness_N": 1e8, "mass_per_length_kg_m": 1e-4}
    frame = drive(
        belt,
        beltid.NormalLaw(1e12, 0.0),
        0.5,
        method="string",
        driver="CRK",
        installation="tensioner",
        pulleys=pulleys,
        tensioner=spring,
        operating_points=loads,
    )
    hub = frame.pivot(index="point", columns="pulley", values="hub_force_N")
    assert hub["CRK"].tolist() == pytest.approx([1911, 1939, 1939, 1900, 1925, 1949], rel=4e-3)
    assert hub["A_C"].tolist() == pytest.approx([1938, 1967, 1966, 1927, 1952, 1977], rel=4e-3)
    assert hub["IDR"].tolist() == pytest.approx([557, 571, 571, 552, 564, 576], rel=4e-3)
    tight = frame[frame["pulley"] == "CRK"]["tension_in_N"]
    assert tight.tolist() == pytest.approx([1208, 1237, 1237, 1198, 1223, 1248], rel=4e-3)


IDLER = {"name": "idler", "x_m": 0.12, "y_m": -0.02, "radius_m": 0.03, "side": "back"}
DRIVES = {
    "fixed_centres": section_of(initial_tension_N=[160, 310], operating_points=points(62.8, 10)),
    "slack_force": section_of(
        installation="slack_force", initial_tension_N=[150], operating_points=points(62.8, 10)
    ),
    "negative_speed": section_of(initial_tension_N=[310], operating_points=points(-62.8, -10)),
    "full_slip": section_of(initial_tension_N=[310], operating_points=points(22.0, 33.0)),
    "unequal": {
        "method": "string",
        "initial_tension_N": [310],
        "pulleys": [
            *two_pulleys(0.05, 0.25)[:1],
            {"name": "driven", "x_m": 0.25, "y_m": 0.0, "radius_m": 0.03},
        ],
        "operating_points": points(62.8, 5),
    },
    "back_idler": {
        "method": "string",
        "initial_tension_N": [310],
        "pulleys": [*two_pulleys(0.05, 0.25), IDLER],
        "operating_points": points(62.8, 8.0),
        "back_friction": 0.4,
        "idler_torque_N_m": 0.1,
    },
    "rod": section_of(method="rod", initial_tension_N=[310], operating_points=points(62.8, 10)),
    "rod_unequal": {
        "method": "rod",
        "initial_tension_N": [310],
        "pulleys": [
            *two_pulleys(0.05, 0.25)[:1],
            {"name": "driven", "x_m": 0.25, "y_m": 0.0, "radius_m": 0.03},
        ],
        "operating_points": points(62.8, 5),
    },
    "gross_slip": section_of(initial_tension_N=[310], operating_points=points(22.0, 43.0)),
    "slack_span": section_of(initial_tension_N=[30], operating_points=points(450.0, 1.0)),
}
DRIVE = (
    "pulley speed_rad_s speed_loss_rad_s loss_creep_rad_s loss_seating_rad_s loss_slip_rad_s "
    "tension_in_N tension_out_N hub_force_N hub_angle_deg wrap_deg arc_used_deg reserve "
    "friction_power_W status"
)


@pytest.mark.filterwarnings("ignore::beltid.BeltidWarning")
@pytest.mark.parametrize("name", DRIVES)
def test_drives(name: str) -> None:
    frame = drive({}, LAW_5PK, true_surface("5pk", 0.0005), **copy.deepcopy(DRIVES[name]))
    found = {c: [None if pd.isna(x) else x for x in frame[c].tolist()] for c in DRIVE.split()}
    kept.check(f"drive/{name}", found)


def test_identities_of_a_drive() -> None:
    """T5: what the axes lose is what friction takes; idling loses nothing."""
    operating = {"driver_speed_rad_s": [62.8, 62.8], "torque_N_m": {"driven": [0.0, 12.0]}}
    frame = drive(
        {},
        LAW_5PK,
        true_surface("5pk"),
        **section_of(initial_tension_N=[310], operating_points=operating),
    )
    for _, point in frame.groupby("point"):
        driver, driven = (point["torque_N_m"] * point["speed_rad_s"]).abs()
        power = point["friction_power_W"].sum()
        assert driver - driven == pytest.approx(power, rel=1e-6, abs=1e-6)
    idle = frame[frame["point"] == frame["point"].iloc[0]]
    assert idle["speed_loss_rad_s"].abs().max() < 1e-9
