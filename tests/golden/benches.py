"""Recordings of made-up benches with known truth (synthetic), from closed forms.

The rig: a belt without bending stiffness, Eqs. (5) and (8) of the paper. The press: Eq. (3). The
drive: a small loss in proportion to the torque.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from golden.door import configured, done

R = 0.05
ARCS, TENSIONS, SPEEDS = (40.0, 82.0), (100.0, 200.0, 411.0), (0.05, 0.21, 0.84)
BUILD_UP = 60e-6  # travel of the pulley's surface over which friction builds up [m]


def law(force_N_m: float, speed_m_s: float) -> float:
    """Friction coefficient of the made-up belt: falls with the force, rises with the speed."""
    return float(0.9 * (force_N_m / 5000) ** -0.15 * (speed_m_s / 0.01) ** 0.05)


@dataclass(frozen=True)
class Rig:
    """A friction rig: what stays while the pulley turns, its noise, its runs."""

    holds: str = "stretch"  # stretch | weight_tight | weight_slack | hub_force
    arcs_deg: tuple[float, ...] = ARCS
    tensions_N: tuple[float, ...] = TENSIONS
    speeds_rad_s: tuple[float, ...] = SPEEDS
    radius_m: float = R
    mu: Callable[[float, float], float] = law
    noise_N: float = 0.3
    held: float = 0.0  # friction that the belt holds at rest, as a share of T0
    rest_s: float = 1.0
    samples: int = 300
    seed: int = 7

    def runs(self) -> pd.DataFrame:
        """True sliding state of each run."""
        rows = []
        for arc in self.arcs_deg:
            for T0 in self.tensions_N:
                for speed in self.speeds_rad_s:
                    rows.append(self._sliding(arc, T0, speed) | {"run": f"R{len(rows) + 1:03d}"})
        return pd.DataFrame(rows)

    def _sliding(self, arc_deg: float, T0: float, speed_rad_s: float) -> dict[str, float]:
        beta, speed_m_s = np.radians(arc_deg), abs(speed_rad_s) * self.radius_m
        mu, tight, slack = 0.5, T0, T0
        for _ in range(200):
            e = np.exp(mu * beta)
            if self.holds == "weight_tight":
                tight, slack = T0, T0 / e
            elif self.holds == "weight_slack":
                tight, slack = T0 * e, T0
            elif self.holds == "hub_force":
                hub = 2 * T0 * np.sin(beta / 2)
                slack = hub / np.sqrt(1 + e**2 - 2 * e * np.cos(beta))
                tight = e * slack
            else:
                tight, slack = 2 * T0 * e / (1 + e), 2 * T0 / (1 + e)
            force = (tight - slack) / (self.radius_m * mu * beta)
            mu = self.mu(force, speed_m_s)
        return {
            "arc_deg": arc_deg,
            "initial_tension_N": T0,
            "pulley_speed_rad_s": speed_rad_s,
            "tension_tight_N": tight,
            "tension_slack_N": slack,
            "mu": mu,
            "normal_force_N_m": force,
        }

    def recording(self) -> pd.DataFrame:
        """Samples over time of all runs, with every channel that some bench may have."""
        random = np.random.default_rng(self.seed)
        frames = []
        for run in self.runs().itertuples():
            speed = abs(run.pulley_speed_rad_s)
            slide_s = max(2.0, 4e-3 / (speed * self.radius_m))
            time = np.linspace(-self.rest_s, slide_s, self.samples)
            travel = np.clip(time, 0, None) * speed * self.radius_m
            built = 1 - np.exp(-travel / BUILD_UP)
            peak = 0.04 * travel / 2e-4 * np.exp(1 - travel / 2e-4) * (travel > 0)
            tensions = {}
            for span in ("tight", "slack"):
                end = getattr(run, f"tension_{span}_N")
                half = 0.5 * self.held * (1 if span == "tight" else -1)
                rest = run.initial_tension_N * (1 + half)
                rise = (end - rest) * (built + peak)
                tensions[span] = rest + rise + random.normal(0, self.noise_N, time.size)
            tight, slack = tensions["tight"], tensions["slack"]
            cosine = np.cos(np.radians(run.arc_deg))
            frame = {
                "run": run.run,
                "time_s": (time + self.rest_s).round(6),
                "tension_tight_N": tight.round(4),
                "tension_slack_N": slack.round(4),
                "pulley_speed_rad_s": np.where(time > 0, run.pulley_speed_rad_s, 0.0),
                "arc_deg": run.arc_deg,
                "initial_tension_N": run.initial_tension_N,
                "torque_N_m": ((tight - slack) * self.radius_m).round(5),
                "hub_force_N": np.sqrt(tight**2 + slack**2 - 2 * tight * slack * cosine).round(4),
                "weight_N": run.initial_tension_N,
            }
            frames.append(pd.DataFrame(frame))
        return pd.concat(frames, ignore_index=True)


CELLS = [
    "run",
    "time_s",
    "tension_tight_N",
    "tension_slack_N",
    "pulley_speed_rad_s",
    "arc_deg",
    "initial_tension_N",
]
"""Columns of a bench with two load cells."""


def press(
    k_linear: float = 6.5e7,
    k_quadratic: float = 3.0256e11,
    length_cm: float = 4.0,
    compliance_mm_N: float = 0.0,
    temperatures_degC: tuple[float, ...] = (22.0,),
    loop: float = 0.0,
    seed: int = 3,
) -> pd.DataFrame:
    """Record of a press: free travel, loading to 150 N/cm, unloading [mm, N]."""
    random = np.random.default_rng(seed)
    frames = []
    for temperature in temperatures_degC:
        depth = np.concatenate([np.linspace(-40, 140, 400), np.linspace(140, -40, 400)]) * 1e-6
        inside = np.clip(depth, 0, None)
        force = (k_linear * inside + k_quadratic * inside**2) * length_cm / 100
        way = np.sign(np.gradient(depth))
        force = force * (1 + loop * way) + random.normal(0, 0.1, depth.size)
        frame = {
            "test": f"P{temperature:g}",
            "temperature_degC": temperature,
            "time_s": np.arange(depth.size) * 0.05,
            "displacement_mm": (1 + depth * 1e3 + compliance_mm_N * force).round(6),
            "force_N": force.round(4),
        }
        frames.append(pd.DataFrame(frame))
    return pd.concat(frames, ignore_index=True)


def speed_loss(loss_per_N_m: float = 0.004, seed: int = 5) -> pd.DataFrame:
    """Record of a two-pulley drive whose loss goes with the torque [rad/s, N m]."""
    random = np.random.default_rng(seed)
    frames = []
    for k, torque in enumerate((0.0, 2.0, 4.0, 8.0, 12.0)):
        time = np.arange(50) * 0.1
        frame = {
            "run": f"S{k + 1:02d}",
            "time_s": time,
            "initial_tension_N": 310.0,
            "torque_N_m": torque + random.normal(0, 0.01, time.size).round(5),
            "driver_speed_rad_s": 62.8,
            "driven_speed_rad_s": 62.8 - loss_per_N_m * torque + random.normal(0, 1e-3, time.size),
        }
        frames.append(pd.DataFrame(frame))
    return pd.concat(frames, ignore_index=True)


def two_belts(folder: Path) -> None:
    """Fill a folder with four runs, the configs of two belts, and their results in runs/.

    One belt is simulated in time, the other at its limit.
    """
    runs = Rig(tensions_N=(200.0,), speeds_rad_s=(0.05, 0.84)).recording()
    runs[CELLS].to_csv(folder / "rig.csv", index=False)
    press().to_csv(folder / "press.csv", index=False)
    for name, EI, method in (("one", 0.02, "transient"), ("two", 0.01, "steady")):
        config = {
            "belt": {"name": name, "bending_stiffness_N_m2": EI},
            "simulation": {"method": method, "elements": 20},
            "cross_validate": {"by": "none"},
            "compare": {
                "max_rms_relative_error": 0.5,
                "max_mean_relative_error": 0.5,
                "max_relative_error": 0.9,
            },
            "data": {"press": "press.csv", "rig": "rig.csv", "origin": "synthetic"},
        }
        configured(folder, config, f"{name}.yaml")
    done(folder, "run one.yaml two.yaml --no-report --out runs --jobs 1")


def small(folder: Path) -> None:
    """Fill a folder with a small bench: two arcs, three tensions; its results here and in runs/."""
    Rig().recording()[CELLS].to_csv(folder / "rig.csv", index=False)
    press().to_csv(folder / "press.csv", index=False)
    speed_loss().to_csv(folder / "speedloss.csv", index=False)
    config = {
        "belt": {"name": "small", "type": "6PK", "ribs": 6},
        "simulation": {"method": "steady", "elements": 20},
        "data": {kind: f"{kind}.csv" for kind in ("press", "rig", "speedloss")},
    }
    config["data"]["origin"] = "synthetic"
    configured(folder, config)
    done(folder, "run beltid.yaml --no-report --jobs 1")
    for name in ("stiffness", "slip", "friction", "surface", "surface_refined", "simulated"):
        shutil.copy(folder / "runs" / "small" / f"{name}.parquet", folder)
