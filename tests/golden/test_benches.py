"""From a recording to its results, for every bench that stays: columns, facts, errors (synthetic).

The truth of the made-up benches is `benches.law`; that of rigdata lies in `tests/truth`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from golden import benches, kept
from golden.door import ROOT, Said, beltid, configured, done, refused

FRICTION = (
    "run arc_deg initial_tension_N nominal_tension_N pulley_speed_rad_s slip_speed_m_s "
    "tension_tight_N tension_slack_N mu_sliding mu_sliding_se mu_sliding_u mu_sticking "
    "normal_force_N_m n_samples status"
)
GEOMETRY = ["run", "pulley_speed_rad_s", "arc_deg", "initial_tension_N"]
CELL = {"tight": "tension_tight_N", "slack": "tension_slack_N"}
Rows = Sequence[int] | slice


def friction(folder: Path, frame: pd.DataFrame, config: Mapping[str, Any] | None = None) -> Said:
    """Reduce a recording of the rig with a config beside it."""
    frame.to_csv(folder / "rig.csv", index=False)
    configured(folder, config or {})
    return beltid(folder, "fit-friction rig.csv --json")


def columns(path: Path, names: str, rows: Rows = slice(None)) -> dict[str, list[Any]]:
    """Columns of an artifact as lists; an empty cell is None."""
    frame = pd.read_parquet(path).iloc[rows]
    return {
        name: [None if pd.isna(x) else x for x in frame[name].tolist()]
        for name in names.split()
        if name in frame
    }


def errors(found: pd.DataFrame, mu: Sequence[float]) -> dict[str, float]:
    """Errors of the sliding friction against the truth, and over the stated uncertainty."""
    error = found["mu_sliding"].to_numpy() - np.asarray(mu)
    return {
        "rms_percent": float(100 * np.sqrt(np.mean((error / mu) ** 2))),
        "largest_percent": float(100 * np.abs(error / mu).max()),
        "rms_over_u": float(np.sqrt(np.mean((error / found["mu_sliding_u"]) ** 2))),
    }


def keep(name: str, said: Said, folder: Path, mu: Sequence[float], rows: Rows) -> None:
    """Keep columns, facts and errors of a reduction."""
    assert said.status == 0, said.stderr
    found = pd.read_parquet(folder / "friction.parquet")
    facts = {k: said.facts[k] for k in ("runs", "runs_set_aside", "normal_force_range_N_m")}
    kept.check(
        f"friction/{name}",
        {
            "columns": columns(folder / "friction.parquet", FRICTION, rows),
            "facts": facts,
            "warnings": len(said.warnings),
            "at_most": errors(found, mu),
        },
    )


def check_friction(belt: str, config: Path, results: Path) -> None:
    """Check the friction among the results of a belt of rigdata."""
    out = results / "friction.parquet"
    said = done(ROOT, f"fit-friction rigdata/{belt}/rig.csv --json -c", config, "-o", out)
    assert said.json["up_to_date"]
    assert said.json["origin"] == "synthetic"
    truth = pd.read_csv(ROOT / f"tests/truth/{belt}/truth.csv")
    keep(belt, said, results, truth["mu_app"].tolist(), slice(None, None, 7))


def test_friction_of_the_5pk_belt(belt_5pk: Path) -> None:
    check_friction("5pk", belt_5pk.parents[1] / "5pk.yaml", belt_5pk)


@pytest.mark.parametrize("belt", ["4pk", "6pk"])
def test_friction_of_the_other_belts(belt: str, tmp_path: Path) -> None:
    config = ROOT / f"configs/{belt}.yaml"
    done(
        ROOT, f"fit-friction rigdata/{belt}/rig.csv -c", config, "-o", tmp_path / "friction.parquet"
    )
    check_friction(belt, config, tmp_path)


BENCHES = {
    "cells": ({}, {}, [*CELL.values()]),
    "weight_tight": (
        {"holds": "weight_tight"},
        {"rig": {"holds": "weight_tight"}},
        ["weight_N", CELL["slack"]],
    ),
    "weight_slack": (
        {"holds": "weight_slack"},
        {"rig": {"holds": "weight_slack"}},
        ["weight_N", CELL["tight"]],
    ),
    "torque_and_slack_cell": ({}, {}, ["torque_N_m", CELL["slack"]]),
    "torque_and_tight_cell": ({}, {}, ["torque_N_m", CELL["tight"]]),
    # the bending of the spans is corrected with EI: this belt has none
    "hub_force_free": (
        {"holds": "hub_force", "arcs_deg": (110.0, 170.0)},
        {"belt": {"bending_stiffness_N_m2": 1e-6}, "rig": {"holds": "hub_force"}},
        ["torque_N_m", "hub_force_N"],
    ),
    "hub_force_held": (
        {"arcs_deg": (110.0, 170.0)},
        {"belt": {"bending_stiffness_N_m2": 1e-6}, "rig": {"holds": "stretch"}},
        ["torque_N_m", "hub_force_N"],
    ),
    "arcs_25_to_170": ({"arcs_deg": (25.0, 110.0, 170.0)}, {}, [*CELL.values()]),
    "radius_20_mm": ({"radius_m": 0.02}, {"rig": {"pulley_radius_m": 0.02}}, [*CELL.values()]),
    "radius_80_mm": ({"radius_m": 0.08}, {"rig": {"pulley_radius_m": 0.08}}, [*CELL.values()]),
    "one_run": (
        {"arcs_deg": (82.0,), "tensions_N": (200.0,), "speeds_rad_s": (0.21,)},
        {},
        [*CELL.values()],
    ),
}


@pytest.mark.parametrize("name", BENCHES)
def test_what_a_bench_measures(name: str, tmp_path: Path) -> None:
    bench, config, channels = BENCHES[name]
    rig = benches.Rig(**bench)
    said = friction(tmp_path, rig.recording()[["time_s", *GEOMETRY, *channels]], config)
    keep(name, said, tmp_path, rig.runs()["mu"].tolist(), slice(None, None, 4))


def test_runs_in_the_other_direction(tmp_path: Path) -> None:
    """The spans change places with the sense of turning: the same friction, said once."""
    rig = benches.Rig(arcs_deg=(82.0,))
    frame = rig.recording()[benches.CELLS]
    back = frame["run"].isin(["R002", "R005", "R008"])
    frame.loc[back, "pulley_speed_rad_s"] *= -1
    swapped = frame.loc[back, [CELL["slack"], CELL["tight"]]].to_numpy()
    frame.loc[back, [CELL["tight"], CELL["slack"]]] = swapped
    said = friction(tmp_path, frame)
    keep("reversed", said, tmp_path, rig.runs()["mu"].tolist(), slice(None))
    assert "R002" in said.stderr


def test_spikes_dropouts_and_runs_set_aside(tmp_path: Path) -> None:
    rig = benches.Rig(arcs_deg=(40.0, 82.0), speeds_rad_s=(0.21,))
    frame = rig.recording()[benches.CELLS]
    random = np.random.default_rng(1)
    spikes = random.choice(len(frame), 20, replace=False)
    frame.loc[spikes, CELL["tight"]] += 150.0
    frame = frame.drop(index=random.choice(len(frame), 40, replace=False))
    never_turns = frame["run"] == "R003"
    frame.loc[never_turns, "pulley_speed_rad_s"] = 0.0
    said = friction(tmp_path, frame)
    assert said.status == 0, said.stderr
    found = pd.read_parquet(tmp_path / "friction.parquet")
    used = found["status"] == "ok"
    assert found.loc[~used, "run"].tolist() == ["R003"]
    truth = rig.runs().loc[used.to_numpy(), "mu"].tolist()
    facts = {"runs": said.facts["runs"], "runs_set_aside": said.facts["runs_set_aside"]}
    kept.check("friction/damaged", {"facts": facts, "at_most": errors(found[used], truth)})
    assert "R003" in said.stderr


@pytest.mark.parametrize("column", ["condition", "side"])
def test_what_must_not_be_mixed(column: str, tmp_path: Path) -> None:
    one, other = {"condition": ("dry", "wet"), "side": ("rib", "back")}[column]
    frame = benches.Rig(tensions_N=(200.0,)).recording()[benches.CELLS]
    half = frame["run"] <= "R003"
    said = friction(tmp_path, frame.assign(**{column: np.where(half, one, other)}))
    assert said.status == 0, said.stderr
    assert set(pd.read_parquet(tmp_path / "friction.parquet")[column]) == {one, other}
    refused(beltid(tmp_path, "build-surface friction.parquet"), one, other, f"--{column}")
    chosen = done(tmp_path, "build-surface friction.parquet", f"--{column}", other, "--json")
    assert chosen.facts["points"] == 3


def test_table_that_others_measured(tmp_path: Path) -> None:
    """The flat belt of a student laboratory (source: rigdata/measured_by_others/README.md)."""
    table = ROOT / "rigdata/measured_by_others/flat_belt.csv"
    said = done(tmp_path, "fit-friction", table, "-o friction.parquet --json")
    assert said.json["origin"] == "measured"
    names = "run arc_deg tension_slack_N mu_sliding mu_sliding_se status normal_force_N_m"
    found = {
        "columns": columns(tmp_path / "friction.parquet", names),
        "facts": said.facts["runs"],
    }
    kept.check("friction/flat_belt", found)


def test_table_of_forces_and_friction(tmp_path: Path) -> None:
    """Silicone on PLA of another laboratory: mu and the normal force themselves."""
    measured = pd.read_csv(ROOT / "rigdata/measured_by_others/silicone.csv")
    chosen = measured[(measured["material"] == "DragonSkin10")]
    table = pd.DataFrame(
        {
            "run": [f"M{k}" for k in range(len(chosen))],
            "arc_deg": 90.0,
            "mu": chosen["mu"].to_numpy(),
            "normal_force_N_m": chosen["normal_force_N"].to_numpy() * 1000,
            "slip_speed_m_s": chosen["slip_speed_m_s"].to_numpy(),
        }
    )
    table.to_csv(tmp_path / "points.csv", index=False)
    done(tmp_path, "fit-friction points.csv -o friction.parquet")
    found = pd.read_parquet(tmp_path / "friction.parquet")
    assert found["mu_sliding"].tolist() == chosen["mu"].tolist()
    assert found["normal_force_N_m"].tolist() == pytest.approx(table["normal_force_N_m"].tolist())


STIFFNESS = (
    "temperature_degC k_linear_se_N_m2 k_quadratic_se_N_m3 k_linear_u_N_m2 k_quadratic_u_N_m3 "
    "hysteresis_ratio max_force_N_m n_samples"
)
LAWS = {"4pk": (5.6e7, 2.20e11), "5pk": (6.5e7, 3.0256e11), "6pk": (7.1e7, 3.90e11)}


def press_error(path: Path, law: tuple[float, float]) -> float:
    """Largest error of the force over the range that was measured [%]."""
    row = pd.read_parquet(path).query("temperature_degC.isna()").iloc[0]
    depth = np.linspace(0.1, 1, 20) * 1.4e-4
    force = law[0] * depth + law[1] * depth**2
    found = row["k_linear_N_m2"] * depth + row["k_quadratic_N_m3"] * depth**2
    return float(100 * np.abs(found / force - 1).max())


@pytest.mark.parametrize("belt", LAWS)
def test_press_of_three_belts(belt: str, tmp_path: Path) -> None:
    out = tmp_path / "stiffness.parquet"
    record, config = f"rigdata/{belt}/press.csv", f"configs/{belt}.yaml"
    said = done(ROOT, f"fit-stiffness {record} -c {config} -o {out} --json")
    wanted = ("temperature_matters", "quadratic_law_supported")
    found = {
        "columns": columns(out, STIFFNESS),
        "facts": {name: said.facts[name] for name in wanted},
        "at_most": {"force_percent": press_error(out, LAWS[belt])},
    }
    kept.check(f"stiffness/{belt}", found)


PRESSES = {
    "plain": ({}, {}),
    "short_segment": ({"length_cm": 2.0}, {"segment_length_cm": 2.0}),
    "soft_machine": ({"compliance_mm_N": 1e-5}, {"machine_compliance_mm_N": 1e-5}),
    "four_temperatures": (
        {"temperatures_degC": (22.0, 40.0, 60.0, 80.0)},
        {"reference_temperature_degC": 40},
    ),
    "loop": ({"loop": 0.05}, {}),
    "linear": ({"k_linear": 1e8, "k_quadratic": 0.0}, {}),
}


@pytest.mark.parametrize("name", PRESSES)
def test_press(name: str, tmp_path: Path) -> None:
    record, section = PRESSES[name]
    benches.press(**record).to_csv(tmp_path / "press.csv", index=False)
    configured(tmp_path, {"press": section})
    said = done(tmp_path, "fit-stiffness press.csv --json")
    law = (record.get("k_linear", 6.5e7), record.get("k_quadratic", 3.0256e11))
    found = {
        "columns": columns(tmp_path / "stiffness.parquet", STIFFNESS),
        "temperature_matters": said.facts["temperature_matters"],
        "at_most": {"force_percent": press_error(tmp_path / "stiffness.parquet", law)},
    }
    kept.check(f"stiffness/{name}", found)


def test_sliding_speeds_of_a_drive(small: Path) -> None:
    """A loss of 0.004 rad/s per N m at R = 0.05 m: Eq. (7)."""
    frame = pd.read_parquet(small / "slip.parquet")
    torque = frame["torque_N_m"].to_numpy()
    loss = 0.004 * (torque - torque[0])
    bound = 4 * frame["slip_speed_se_m_s"].to_numpy()
    assert (np.abs(frame["slip_speed_m_s"] - 0.05 * loss) < bound).all()
    names = "run driver_speed_rad_s initial_tension_N torque_N_m slip_speed_se_m_s"
    kept.check("slip/small", {"columns": columns(small / "slip.parquet", names)})


@pytest.mark.parametrize("belt", LAWS)
def test_sliding_speeds_of_three_belts(belt: str, tmp_path: Path) -> None:
    out = tmp_path / "slip.parquet"
    said = done(ROOT, f"fit-slip rigdata/{belt}/speedloss.csv -o {out} --json")
    truth = pd.read_csv(ROOT / f"tests/truth/{belt}/speedloss_truth.csv").set_index("run")
    found = pd.read_parquet(out).set_index("run")
    error = found["slip_speed_m_s"] - truth["slip_speed_m_s"].reindex(found.index)
    ratio = float(np.sqrt(np.mean((error / found["slip_speed_se_m_s"]) ** 2)))
    names = ("runs", "largest_slip_speed_m_s", "rig_speeds_proposed_rad_s")
    facts = {name: said.facts[name] for name in names}
    kept.check(f"slip/{belt}", {"facts": facts, "at_most": {"rms_over_se": ratio}})
