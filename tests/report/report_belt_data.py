"""Results of a small belt that was never measured: numbers that a test knows beforehand."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from beltid.report.results import BeltResults, Sheet
from beltid.store.artifact import Record, write_artifact

ARCS = (40.0, 82.0)
TENSIONS = (100.0, 300.0, 410.0)
SPEEDS = (0.05, 0.21)
RADIUS = 0.05
NAUGHTY = '<script>alert("1")</script>&<b>$\\frac{$'
OF_RECORD = {field.name for field in fields(Record)}
ARC, TENSION, OMEGA = (x.ravel() for x in np.meshgrid(ARCS, TENSIONS, SPEEDS, indexing="ij"))
N = ARC.size
MU = 1.2 - 1e-3 * TENSION + 0.5 * OMEGA
STATUS = np.array(["ok"] * (N - 1) + ["never turned"], dtype=object)
RUNS = np.array([f"R{k:02d}" for k in range(N)], dtype=object)
TIGHT, SLACK = (
    TENSION * np.exp(0.5 * MU * np.radians([ARC])),
    TENSION / np.exp(0.5 * MU * np.radians([ARC])),
)
STIFFNESS = {
    "temperature_degC": np.array([22.0, 60.0, np.nan]),
    "k_linear_N_m2": np.array([6.4e7, 6.6e7, 6.5e7]),
    "k_quadratic_N_m3": np.array([3.0e11, 3.1e11, 3.05e11]),
    "k_linear_se_N_m2": np.full(3, 1e4),
    "k_quadratic_se_N_m3": np.full(3, 3e7),
    "covariance": np.array([[1e8, -1e11, -1e11, 1e15]] * 3),
    "contact_offset_mm": np.zeros(3),
    "rms_residual_N_m": np.full(3, 300.0),
    "hysteresis_ratio": np.full(3, 0.12),
    "max_penetration_m": np.full(3, 1e-4),
    "max_force_N_m": np.full(3, 9500.0),
    "n_samples": np.array([100, 100, 200]),
}
FRICTION = {
    "run": RUNS,
    "arc_deg": ARC,
    "initial_tension_N": TENSION,
    "nominal_tension_N": TENSION,
    "pulley_speed_rad_s": OMEGA,
    "slip_speed_m_s": OMEGA * RADIUS,
    "tension_tight_N": TIGHT[0],
    "tension_slack_N": SLACK[0],
    "mu_sliding": MU,
    "mu_sliding_se": np.full(N, 0.002),
    "mu_sticking": MU + 0.05,
    "normal_force_N_m": TENSION / RADIUS,
    "temperature_degC": np.full(N, 22.0),
    "n_samples": np.full(N, 50),
    "status": STATUS,
    "start_time_s": np.full(N, 1.0),
    "peak_time_s": np.full(N, 1.2),
    "plateau_start_s": np.full(N, 2.0),
    "plateau_end_s": np.full(N, 4.0),
}
SLIP = {
    "driver_speed_rad_s": np.repeat([22.0, 76.8], 3),
    "initial_tension_N": np.full(6, 310.0),
    "torque_N_m": np.tile([0.0, 4.0, 8.0], 2),
    "speed_loss_rad_s": 0.02 * np.tile([0.0, 4.0, 8.0], 2),
    "slip_speed_m_s": 0.001 * np.tile([0.0, 4.0, 8.0], 2),
    "slip_speed_se_m_s": np.full(6, 1e-4),
}


def press_curves() -> dict[str, Any]:
    depth = np.linspace(-1e-5, 1e-4, 12)
    force = np.where(depth > 0, 6.5e7 * depth + 3.05e11 * depth**2, 0.0)
    return {
        "test": np.repeat(np.array(["P22", "P60"], dtype=object), 24),
        "temperature_degC": np.repeat([22.0, 60.0], 24),
        "cycle": np.ones(48, dtype=np.int64),
        "branch": np.tile(np.repeat(np.array(["loading", "unloading"], dtype=object), 12), 2),
        "penetration_m": np.tile(depth, 4),
        "line_force_N_m": np.concatenate([1.05 * force, 0.95 * force] * 2),
    }


def rig_curves() -> dict[str, Any]:
    t, chosen = np.linspace(0.0, 4.0, 41), np.array([2, 8, 11])
    rest = np.tile(t < 1.0, chosen.size)
    rows = np.repeat(chosen, t.size)
    tight, slack = (np.where(rest, TENSION[rows], of[0][rows]) for of in (TIGHT, SLACK))
    return {
        "run": RUNS[rows],
        "time_s": np.tile(t, chosen.size),
        "tension_tight_N": tight,
        "tension_slack_N": slack,
        "mu": np.log(tight / slack) / np.radians(ARC[rows]),
        "pulley_speed_rad_s": np.where(rest, 0.0, 0.21),
    }


def surface(scale: float = 1.0) -> dict[str, Any]:
    f, v = np.meshgrid([2000.0, 4000.0, 6000.0, 8000.0], [0.0025, 0.0105], indexing="ij")
    return {
        "arc_deg": np.full(f.size, np.nan),
        "normal_force_N_m": f.ravel(),
        "slip_speed_m_s": v.ravel(),
        "mu": scale * (1.2 - 5e-5 * f.ravel() + 10.0 * v.ravel()),
        "mu_se": np.full(f.size, 0.004),
        "n_arcs": np.full(f.size, 2),
    }


def compared(factor: float, passed: bool, **said: Any) -> dict[str, Any]:
    """Columns and statements of a comparison."""
    good = STATUS == "ok"
    names = ("run", "arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m")
    columns = {name: FRICTION[name][good] for name in names}
    columns |= {"mu_measured": MU[good], "mu_simulated": factor * MU[good]}
    columns |= {"difference": (factor - 1.0) * MU[good]}
    columns |= {"within_tolerance": np.ones(good.sum(), dtype=bool)}
    group = dict.fromkeys(("rms_percent", "mean_percent", "largest_percent"), 100 * abs(factor - 1))
    group |= {"group": "all points", "n_points": 11}
    group |= {"force_low_N_m": 2000.0, "force_high_N_m": 8200.0}
    averaged = [
        {
            "nominal_tension_N": t,
            "pulley_speed_rad_s": w,
            "normal_force_N_m": t / RADIUS,
            "mu_measured": 1.2 - 1e-3 * t + 0.5 * w,
            "mu_simulated": factor * (1.2 - 1e-3 * t + 0.5 * w),
        }
        for t in TENSIONS
        for w in SPEEDS
    ]
    return {"columns": columns, "passed": passed, "groups": [group], "averaged": averaged} | said


def validation(over_u: float) -> dict[str, Any]:
    return {"n": 11, "within_2u": 11, "rms_e_over_u": over_u, "inputs_known": True}


def simulated() -> dict[str, Any]:
    columns = {
        "run": np.array(["S00"], dtype=object),
        "time_s": np.zeros(1),
        "tension_tight_N": np.ones(1),
        "tension_slack_N": np.ones(1),
        "pulley_speed_rad_s": np.zeros(1),
        "arc_deg": np.array([40.0]),
        "initial_tension_N": np.ones(1),
    }
    names = ("arc_deg", "pulley_speed_rad_s", "normal_force_N_m")
    runs = [
        {name: float(FRICTION[name][k]) for name in names}
        | {"run": f"S{k:02d}", "mu": 0.97 * float(MU[k]), "status": "ok"}
        for k in range(N)
    ]
    return {"columns": columns, "simulated_runs": runs}


def source(name: str, basis: str, percent: float) -> dict[str, Any]:
    words = {"quantity": "surface", "source": name, "acts_on": "all together", "basis": basis}
    sizes = dict.fromkeys(("contribution_percent", "largest_percent", "share_percent"), percent)
    return words | sizes | {"standard_uncertainty": 0.1, "unit": "%"}


BUDGET = [source("contact arc", "assumed", 0.4), source("scatter", "fitted", 0.3)]
BUDGET += [source("combined", "", 0.5)]
MEASURED = {"normal_force_N_m": (2500.0, 7000.0), "slip_speed_m_s": (0.0025, 0.0105)}
SETTINGS = {"rig": {"pulley_radius_m": RADIUS, "pulley_speeds_rad_s": list(SPEEDS)}}


def stating(sheet: Sheet, **said: Any) -> Sheet:
    """A sheet that says something else about itself: a field, a further table or a fact."""
    record = sheet.record
    own = {name: said.pop(name) for name in list(said) if name in OF_RECORD}
    rows = {n: v for n, v in said.items() if isinstance(v, list)}
    facts = {name: value for name, value in said.items() if name not in rows}
    more = {"facts": {**record.facts, **facts}, "tables": {**record.tables, **rows}}
    return replace(sheet, record=replace(record, **more, **own))


def changed(sheet: Sheet, **columns: Any) -> Sheet:
    """A sheet with some of its columns others."""
    return replace(sheet, columns={**sheet.columns, **columns})


def sheets() -> dict[str, Sheet]:
    """Every artifact of the belt as the report reads it."""
    refined = {"columns": surface(1.05), "budget": BUDGET, "measured": MEASURED}
    left_out = {"hold_out": "arc", "validation": validation(0.9)}
    every: dict[str, dict[str, Any]] = {
        "stiffness": {"columns": STIFFNESS},
        "slip": {"columns": SLIP},
        "friction": {"columns": FRICTION},
        "surface": {"columns": surface(), "method": "published"},
        "surface_refined": refined,
        "simulated": simulated(),
        "compare": compared(0.97, False),
        "simulated_refined": simulated(),
        "compare_refined": compared(1.001, True),
        "crossvalidation": compared(1.004, True, **left_out),
        "press_curves": {"columns": press_curves()},
        "rig_curves": {"columns": rig_curves()},
    }
    found = {}
    for name, said in every.items():
        columns = said.pop("columns")
        kind, refined, _ = name.partition("_refined")
        from_refined = {"surface_refined": "ab" * 32} if refined else {}
        record = Record(kind, settings=SETTINGS, origin="synthetic", ancestors=from_refined)
        found[name] = stating(Sheet(columns, record, Path(name), "ab" * 32), **said)
    return found


def results(belt: str = "testbelt", **others: Sheet | None) -> BeltResults:
    """Everything about the belt, with a profile along each arc; some sheets others, or None."""
    x = np.linspace(0.0, 0.05, 9)
    profile = {
        "arc_position_m": x,
        "normal_force_N_m": np.sin(np.pi * x / 0.05) * 9000.0,
        "capstan_force_N_m": 6000.0 * np.exp(-10.0 * x),
        "initial_tension_N": 300.0,
        "slip_speed_m_s": 0.0105,
        "mean_force_N_m": 5000.0,
    }
    profiles = tuple({**profile, "arc_deg": arc} for arc in ARCS)
    whole = {**sheets(), **others}
    return BeltResults(belt, {k: v for k, v in whole.items() if v is not None}, profiles)


def write(folder: Path, *names: str) -> Path:
    """A folder with the artifacts of the belt, or some of them."""
    for name, sheet in sheets().items():
        if not names or name in names:
            write_artifact(folder / f"{name}.parquet", sheet.columns, sheet.record)
    return folder
