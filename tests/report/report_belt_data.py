"""Results of a small belt that was never measured: numbers that a test knows beforehand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from beltid.report.results import ArcProfile, BeltResults, Sheet
from beltid.store.artifact import Record, write_artifact

ARCS = (40.0, 82.0)
TENSIONS = (100.0, 300.0, 410.0)
SPEEDS = (0.05, 0.21)
RADIUS = 0.05
ORIGIN = {"origin": "synthetic", "notes": [], "warnings": []}
MEASURED = {"normal_force_N_m": (2500.0, 7000.0), "slip_speed_m_s": (0.0025, 0.0105)}
NAUGHTY = '<script>alert("1")</script>&<b>$\\frac{$'


def stiffness() -> dict[str, Any]:
    laws = np.array([[6.4e7, 3.0e11], [6.6e7, 3.1e11], [6.5e7, 3.05e11]])
    covariance = np.array([[1e8, -1e11, -1e11, 1e15]] * 3)
    return {
        "temperature_degC": np.array([22.0, 60.0, np.nan]),
        "k_linear_N_m2": laws[:, 0],
        "k_quadratic_N_m3": laws[:, 1],
        "k_linear_se_N_m2": np.full(3, 1e4),
        "k_quadratic_se_N_m3": np.full(3, 3e7),
        "covariance": covariance,
        "contact_offset_mm": np.zeros(3),
        "rms_residual_N_m": np.full(3, 300.0),
        "hysteresis_ratio": np.full(3, 0.12),
        "max_penetration_m": np.full(3, 1e-4),
        "max_force_N_m": np.full(3, 9500.0),
        "n_samples": np.array([100, 100, 200]),
    }


def press_curves() -> dict[str, Any]:
    depth = np.linspace(-1e-5, 1e-4, 12)
    parts = []
    for test, at in (("P22", 22.0), ("P60", 60.0)):
        for branch, factor in (("loading", 1.05), ("unloading", 0.95)):
            force = factor * np.where(depth > 0, 6.5e7 * depth + 3.05e11 * depth**2, 0.0)
            parts.append((test, at, branch, depth, force))
    return {
        "test": np.array([p[0] for p in parts for _ in depth], dtype=object),
        "temperature_degC": np.array([p[1] for p in parts for _ in depth]),
        "cycle": np.ones(len(parts) * depth.size, dtype=np.int64),
        "branch": np.array([p[2] for p in parts for _ in depth], dtype=object),
        "penetration_m": np.concatenate([p[3] for p in parts]),
        "line_force_N_m": np.concatenate([p[4] for p in parts]),
    }


def friction() -> dict[str, Any]:
    rows = [(a, t, w) for a in ARCS for t in TENSIONS for w in SPEEDS]
    arc, tension, omega = (np.array(column) for column in zip(*rows, strict=True))
    mu = 1.2 - 1e-3 * tension + 0.5 * omega
    status = np.array(["ok"] * len(rows), dtype=object)
    status[-1] = "never turned"
    labels = np.array([f"R{k:02d}" for k in range(len(rows))], dtype=object)
    ratio = np.exp(mu * np.radians(arc))
    return {
        "run": labels,
        "arc_deg": arc,
        "initial_tension_N": tension,
        "nominal_tension_N": tension,
        "pulley_speed_rad_s": omega,
        "slip_speed_m_s": omega * RADIUS,
        "tension_tight_N": tension * np.sqrt(ratio),
        "tension_slack_N": tension / np.sqrt(ratio),
        "mu_sliding": mu,
        "mu_sliding_se": np.full(mu.size, 0.002),
        "mu_sticking": mu + 0.05,
        "normal_force_N_m": tension / RADIUS,
        "temperature_degC": np.full(mu.size, 22.0),
        "n_samples": np.full(mu.size, 50),
        "status": status,
        "start_time_s": np.full(mu.size, 1.0),
        "peak_time_s": np.full(mu.size, 1.2),
        "plateau_start_s": np.full(mu.size, 2.0),
        "plateau_end_s": np.full(mu.size, 4.0),
    }


def rig_curves() -> dict[str, Any]:
    table, t = friction(), np.linspace(0.0, 4.0, 41)
    chosen = (2, 8, 11)
    tight = np.concatenate(
        [
            np.where(t < 1.0, table["initial_tension_N"][k], table["tension_tight_N"][k])
            for k in chosen
        ]
    )
    slack = np.concatenate(
        [
            np.where(t < 1.0, table["initial_tension_N"][k], table["tension_slack_N"][k])
            for k in chosen
        ]
    )
    arcs = np.repeat(table["arc_deg"][list(chosen)], t.size)
    return {
        "run": np.repeat(table["run"][list(chosen)], t.size),
        "time_s": np.tile(t, len(chosen)),
        "tension_tight_N": tight,
        "tension_slack_N": slack,
        "mu": np.log(tight / slack) / np.radians(arcs),
        "pulley_speed_rad_s": np.tile(np.where(t < 1.0, 0.0, 0.21), len(chosen)),
    }


def slip() -> dict[str, Any]:
    torque = np.tile([0.0, 4.0, 8.0], 2)
    return {
        "driver_speed_rad_s": np.repeat([22.0, 76.8], 3),
        "initial_tension_N": np.full(6, 310.0),
        "torque_N_m": torque,
        "speed_loss_rad_s": 0.02 * torque,
        "slip_speed_m_s": 0.001 * torque,
        "slip_speed_se_m_s": np.full(6, 1e-4),
    }


def surface(scale: float = 1.0) -> dict[str, Any]:
    force, speed = np.array([2000.0, 4000.0, 6000.0, 8000.0]), np.array([0.0025, 0.0105])
    f, v = np.meshgrid(force, speed, indexing="ij")
    return {
        "arc_deg": np.full(f.size, np.nan),
        "normal_force_N_m": f.ravel(),
        "slip_speed_m_s": v.ravel(),
        "mu": scale * (1.2 - 5e-5 * f.ravel() + 10.0 * v.ravel()),
        "mu_se": np.full(f.size, 0.004),
        "n_arcs": np.full(f.size, 2),
    }


def compare(factor: float) -> dict[str, Any]:
    table = friction()
    good = table["status"] == "ok"
    mu = table["mu_sliding"][good]
    return {
        **{
            name: table[name][good]
            for name in ("run", "arc_deg", "nominal_tension_N", "pulley_speed_rad_s")
        },
        "mu_measured": mu,
        "mu_simulated": factor * mu,
        "difference": (factor - 1.0) * mu,
        "within_tolerance": np.ones(mu.size, dtype=bool),
        "normal_force_N_m": table["normal_force_N_m"][good],
    }


def statistics(factor: float, passed: bool) -> dict[str, Any]:
    percent = 100.0 * abs(factor - 1.0)
    group = {
        "group": "all points",
        "n_points": 11,
        "rms_percent": percent,
        "mean_percent": percent,
        "largest_percent": percent,
        "force_low_N_m": 2000.0,
        "force_high_N_m": 8200.0,
    }
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
    return {**ORIGIN, "passed": passed, "groups": [group], "averaged": averaged}


def predicted(over_u: float) -> dict[str, Any]:
    validation = {"n": 11, "within_2u": 11, "rms_e_over_u": over_u, "inputs_known": True}
    return {**statistics(1.004, True), "hold_out": "arc", "validation": validation}


def simulated_extra() -> dict[str, Any]:
    table = friction()
    runs = [
        {
            "run": f"S{k:02d}",
            "arc_deg": float(table["arc_deg"][k]),
            "pulley_speed_rad_s": float(table["pulley_speed_rad_s"][k]),
            "normal_force_N_m": float(table["normal_force_N_m"][k]),
            "mu": float(table["mu_sliding"][k]) * 0.97,
            "status": "ok",
        }
        for k in range(len(table["run"]))
    ]
    return {**ORIGIN, "simulated_runs": runs, "notes": ["12 % of the points lie outside the range"]}


def budget() -> list[dict[str, Any]]:
    def row(source: str, basis: str, percent: float) -> dict[str, Any]:
        return {
            "quantity": "surface",
            "source": source,
            "acts_on": "all together",
            "basis": basis,
            "standard_uncertainty": 0.1,
            "unit": "%",
            "contribution_percent": percent,
            "largest_percent": 2 * percent,
            "share_percent": percent,
            "degrees_of_freedom": None,
        }

    return [
        row("contact arc", "assumed", 0.4),
        row("scatter", "fitted", 0.3),
        row("combined", "", 0.5),
    ]


def tables() -> dict[str, tuple[str, dict[str, Any], dict[str, Any]]]:
    """Kind, columns and statements of every artifact of the belt."""
    recording = {
        "run": np.array(["S00"], dtype=object),
        "time_s": np.zeros(1),
        "tension_tight_N": np.ones(1),
        "tension_slack_N": np.ones(1),
        "pulley_speed_rad_s": np.zeros(1),
        "arc_deg": np.array([40.0]),
        "initial_tension_N": np.ones(1),
    }
    refined = {**ORIGIN, "budget": budget(), "measured": MEASURED}
    return {
        "stiffness": ("stiffness", stiffness(), ORIGIN),
        "slip": ("slip", slip(), ORIGIN),
        "friction": ("friction", friction(), ORIGIN),
        "surface": ("surface", surface(), {**ORIGIN, "method": "published"}),
        "surface_refined": ("surface", surface(1.05), refined),
        "simulated": ("simulated", recording, simulated_extra()),
        "compare": ("compare", compare(0.97), statistics(0.97, False)),
        "simulated_refined": ("simulated", recording, simulated_extra()),
        "compare_refined": ("compare", compare(1.001), statistics(1.001, True)),
        "crossvalidation": ("crossvalidation", compare(1.004), predicted(0.9)),
        "press_curves": ("press_curves", press_curves(), ORIGIN),
        "rig_curves": ("rig_curves", rig_curves(), ORIGIN),
    }


SETTINGS = {"rig": {"pulley_radius_m": RADIUS, "pulley_speeds_rad_s": list(SPEEDS)}}


def sheets() -> dict[str, Sheet]:
    """Every artifact of the belt as the report reads it."""
    return {
        name: stating(Sheet(name, kind, columns, settings=SETTINGS, sha256="ab" * 32), **extra)
        for name, (kind, columns, extra) in tables().items()
    }


def stating(sheet: Sheet, **said: Any) -> Sheet:
    """A sheet that says something else about itself."""
    own = {name: said.pop(name) for name in list(said) if name in Sheet.__dataclass_fields__}
    rows = {n: v for n, v in said.items() if isinstance(v, list) and v and isinstance(v[0], dict)}
    facts = {name: value for name, value in said.items() if name not in rows}
    return replace(sheet, facts={**sheet.facts, **facts}, tables={**sheet.tables, **rows}, **own)


def changed(sheet: Sheet, **columns: Any) -> Sheet:
    """A sheet with some of its columns others."""
    return replace(sheet, columns={**sheet.columns, **columns})


def results(belt: str = "testbelt") -> BeltResults:
    """Everything about the belt, with a profile along each arc."""
    x = np.linspace(0.0, 0.05, 9)
    profile = {
        "arc_position_m": x,
        "normal_force_N_m": np.sin(np.pi * x / 0.05) * 9000.0,
        "capstan_force_N_m": 6000.0 * np.exp(-10.0 * x),
        "slip_speed_m_s": np.full(x.size, 0.01),
    }
    profiles = tuple(ArcProfile(arc, 300.0, 0.0105, profile, 5000.0) for arc in ARCS)
    return BeltResults(belt, sheets(), profiles)


def without(*names: str) -> BeltResults:
    """The belt without some artifacts."""
    whole = results()
    return replace(whole, sheets={k: v for k, v in whole.sheets.items() if k not in names})


def write(folder: Path, *names: str) -> Path:
    """A folder with the artifacts of the belt, or some of them."""
    for name, (kind, columns, extra) in tables().items():
        if not names or name in names:
            said = stating(Sheet(name, kind, columns), **extra)
            facts = {k: v for k, v in said.facts.items() if k != "passed"}
            record = Record(
                kind,
                settings=SETTINGS,
                facts=facts,
                tables=dict(said.tables),
                origin=said.origin,
                notes=list(said.notes),
                warnings=list(said.warnings),
                passed=extra.get("passed"),
            )
            write_artifact(folder / f"{name}.parquet", columns, record)
    return folder
