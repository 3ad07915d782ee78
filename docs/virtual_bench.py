"""A synthetic friction rig: records the runs of a plan, as the bench of a laboratory would.

    python virtual_bench.py PLAN.csv RIG.csv

Appends the runs of the plan to the recording, with noise and with errors that all runs share, drawn
once: an arc that is off at each setting, a belt that is stiffer than stated, load cells that are
off. The friction is known, so that what comes of it can be compared; the data are synthetic.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

import beltid

ARC_ERROR_DEG = {40.0: 0.15, 68.0: -0.25, 82.0: 0.1}
STIFFER = 1.04
CELL_GAIN, CELL_ZERO_N = (1.001, 0.9995), (0.04, -0.03)
NOISE_N = 0.4  # of a sample
RUN_SCATTER = 0.002  # of the friction from run to run
LAW = beltid.NormalLaw(6.5e7, 3.0256e11)


def friction() -> beltid.FrictionSurface:
    """The true friction coefficient over force and sliding speed."""
    f, v = np.geomspace(60.0, 40000.0, 60)[:, None], np.geomspace(0.001, 0.1, 30)
    rise = np.log1p(v / 0.0015) / np.log1p(0.01 / 0.0015) - 1.0
    mu = 0.95 * (f / 5400.0) ** -0.18 * (1.0 + 0.45 * rise)
    return beltid.FrictionSurface(f.ravel(), v, mu)


def record(run: pd.Series, label: str, rng: np.random.Generator) -> pd.DataFrame:
    """One run as the load cells see it."""
    truth = friction()
    level = 1.0 + RUN_SCATTER * rng.standard_normal()
    surface = beltid.FrictionSurface(
        truth.normal_force_N_m, truth.slip_speed_m_s, level * truth.mu_nodes
    )
    config = {"belt": {"bending_stiffness_N_m2": 0.02 * STIFFER}}
    done = beltid.simulate_rig(
        config,
        surface,
        LAW,
        arc_deg=run.arc_deg + ARC_ERROR_DEG[run.arc_deg],
        initial_tension_N=run.initial_tension_N,
        pulley_speed_rad_s=run.pulley_speed_rad_s,
        method="transient",
    ).recording
    for cell, gain, zero in zip(("tight", "slack"), CELL_GAIN, CELL_ZERO_N, strict=True):
        noise = NOISE_N * rng.standard_normal(len(done))
        done[f"tension_{cell}_N"] = gain * done[f"tension_{cell}_N"] + zero + noise
    done["run"] = label
    done["arc_deg"] = run.arc_deg
    done["initial_tension_N"] = run.initial_tension_N
    return done


def main(plan: Path, rig: Path) -> None:
    """Append the runs of a plan to a recording."""
    before = pd.read_csv(rig) if rig.exists() else pd.DataFrame()
    made = before["run"].nunique() if len(before) else 0
    runs = pd.read_csv(plan)
    rng = np.random.default_rng(made)
    new = [record(run, f"R{made + k + 1:03}", rng) for k, run in enumerate(runs.itertuples())]
    pd.concat([before, *new]).to_csv(rig, index=False)
    print(f"{rig}: {made} runs before, {made + len(new)} now")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
