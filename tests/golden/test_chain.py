"""From reduced runs to surfaces, simulated runs, verdicts and plans (synthetic data)."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import beltid as beltid_api
from golden import kept
from golden.door import ROOT, beltid, configured, done, refused
from golden.test_benches import check_friction, columns

LAWS = {
    "4pk": (1.05, 0.20, 0.50, 0.0020),
    "5pk": (0.95, 0.18, 0.45, 0.0015),
    "6pk": (0.88, 0.14, 0.38, 0.0012),
}
"""True friction of the belts of rigdata: mu0, a, c, v0 (rigdata/README.md)."""


def true_mu(belt: str, f: np.ndarray, v: np.ndarray) -> np.ndarray:
    mu0, a, c, v0 = LAWS[belt]
    return mu0 * (f / 5400) ** -a * (1 + c * (np.log1p(v / v0) / np.log1p(0.01 / v0) - 1))


def surface_error(path: Path, belt: str) -> dict[str, float]:
    """Error of a surface at force and speed of the 120 runs, and over the stated uncertainty."""
    runs = pd.read_csv(ROOT / f"tests/truth/{belt}/truth.csv")
    f, v = runs["f_ref"].to_numpy(), runs["v"].to_numpy()
    surface = beltid_api.load_surface(path)
    truth = true_mu(belt, f, v)
    error = surface.mu(f, v) - truth
    nodes = pd.read_parquet(path).query("arc_deg.isna()")
    at_nodes = true_mu(belt, *(nodes[c].to_numpy() for c in ("normal_force_N_m", "slip_speed_m_s")))
    return {
        "rms_percent": float(100 * np.sqrt(np.mean((error / truth) ** 2))),
        "largest_percent": float(100 * np.abs(error / truth).max()),
        "rms_over_u": float(np.sqrt(np.mean(((nodes["mu"] - at_nodes) / nodes["mu_u"]) ** 2))),
    }


SURFACE = "arc_deg normal_force_N_m slip_speed_m_s mu mu_se mu_u n_arcs"
COMPARE = "run mu_measured mu_simulated difference u_validation within_tolerance"


def test_surfaces_of_the_5pk_belt(belt_5pk: Path) -> None:
    for name in ("surface", "surface_refined"):
        path = belt_5pk / f"{name}.parquet"
        found = {
            "columns": columns(path, SURFACE, slice(None, None, 3)),
            "at_most": surface_error(path, "5pk"),
        }
        kept.check(f"chain/5pk_{name}", found)


def check_verdict(path: Path) -> None:
    frame = pd.read_parquet(path)
    relative = (frame["mu_simulated"] / frame["mu_measured"] - 1) * 100
    found = {
        "columns": columns(path, COMPARE, slice(None, None, 5)),
        "at_most": {
            "rms_percent": float(np.sqrt(np.mean(relative**2))),
            "largest_percent": float(relative.abs().max()),
        },
    }
    kept.check(f"chain/5pk_{path.stem}", found)


@pytest.mark.parametrize("name", ["compare", "compare_refined"])
def test_verdicts_of_the_5pk_belt(name: str, belt_5pk: Path) -> None:
    check_verdict(belt_5pk / f"{name}.parquet")


def check_speed_loss(results: Path) -> None:
    frame = pd.read_parquet(results / "drive.parquet")
    driven = frame[frame["pulley"] == "driven"].set_index("run")
    truth = pd.read_csv(ROOT / "tests/truth/5pk/speedloss_truth.csv").set_index("run")
    truth = truth.loc[driven.index]
    judged = truth.index[truth["torque_N_m"] > 0.2 * truth["torque_N_m"].max()]
    loss = driven.loc[judged, "speed_loss_rad_s"] / truth.loc[judged, "speed_loss_rad_s"] - 1
    tight = driven.loc[judged, ["tension_in_N", "tension_out_N"]].max(axis=1)
    error = tight / truth.loc[judged, "tension_tight_N"] - 1
    u = driven.loc[judged, "speed_loss_u_rad_s"] / truth.loc[judged, "speed_loss_rad_s"]
    found = {
        "loss_rms_percent": float(100 * np.sqrt((loss**2).mean())),
        "loss_over_u": float(np.sqrt(((loss / u) ** 2).mean())),
        "tension_rms_percent": float(100 * np.sqrt((error**2).mean())),
    }
    kept.check("drive/5pk_bench", {"at_most": found})


def test_speed_loss_of_the_5pk_bench(belt_5pk: Path) -> None:
    """T7: predicted from the identified laws, against the noise-free truth (synthetic)."""
    check_speed_loss(belt_5pk)


@pytest.mark.long
@pytest.mark.parametrize("belt", LAWS)
def test_belts_as_they_are_delivered(belt: str, tmp_path: Path) -> None:
    """All recordings and steps of the configs: friction, surfaces, runs left out, the drive."""
    done(ROOT, f"run configs/{belt}.yaml --out {tmp_path} --jobs 2 --no-report")
    errors = {
        name: surface_error(tmp_path / belt / f"{name}.parquet", belt)
        for name in ("surface", "surface_refined")
    }
    kept.check(f"chain/{belt}", {"at_most": errors})
    check_friction(belt, ROOT / f"configs/{belt}.yaml", tmp_path / belt)
    if belt == "5pk":
        check_verdict(tmp_path / "5pk/crossvalidation.parquet")
        check_speed_loss(tmp_path / "5pk")


def test_artifacts_of_a_chain(belt_5pk: Path) -> None:
    """What `run` leaves, by name."""
    names = (
        "stiffness slip friction surface surface_refined simulated simulated_refined compare "
        "compare_refined drive compare_drive"
    )
    wanted = set(names.split())
    there = {path.stem for path in belt_5pk.glob("*.parquet")}
    assert wanted <= there
    assert (belt_5pk / "report.html").exists()


def test_simulated_runs(belt_5pk: Path) -> None:
    """A simulated recording has the columns of a measured one, over time."""
    frame = pd.read_parquet(belt_5pk / "simulated_refined.parquet")
    measured = pd.read_csv(ROOT / "rigdata/5pk/rig.csv", nrows=1)
    assert set(measured.columns) <= set(frame.columns)
    last = frame.groupby("run", sort=False).last().iloc[::4]
    names = ["arc_deg", "pulley_speed_rad_s", "tension_tight_N", "tension_slack_N"]
    found = {name: last[name].tolist() for name in names}
    kept.check("chain/5pk_simulated", {"columns": found, "runs": frame["run"].nunique()})


def test_small_bench(small: Path) -> None:
    for name in ("surface", "surface_refined"):
        path = small / f"{name}.parquet"
        kept.check(f"chain/small_{name}", {"columns": columns(path, SURFACE)})


def test_compare_says_whether_it_agrees(bench: Path) -> None:
    compare = "compare friction.parquet simulated.parquet --json"
    passed = done(bench, compare)
    groups = {g["group"]: g for g in passed.facts["groups"]}
    facts = {name: groups[name]["rms_percent"] for name in groups}
    kept.check("chain/small_compare", {"rms_percent": facts, "runs": passed.facts["runs_compared"]})
    tight = {"compare": {"max_rms_relative_error": 1e-4}}
    configured(bench, {"belt": {"name": "small"}, **tight}, "tight.yaml")
    failed = beltid(bench, compare, "-c tight.yaml -o tight.parquet")
    assert failed.status == 4
    assert failed.json["verdict"].startswith("FAIL")
    assert (bench / "tight.parquet").exists()


def test_runs_left_out_are_predicted(small: Path) -> None:
    found = columns(small / "runs/small/crossvalidation.parquet", "run mu_measured mu_simulated")
    kept.check("chain/small_hold_out", {"columns": found})


def test_selected_runs_of_the_rig(bench: Path) -> None:
    """Runs that are selected go to a file of their own."""
    before = (bench / "simulated.parquet").read_bytes()
    simulate = "simulate-rig surface.parquet stiffness.parquet"
    done(bench, simulate, "--arc 82 --tension 200 --speed 0.21 --method transient --jobs 1")
    part = bench / "simulated_part.parquet"
    assert (bench / "simulated.parquet").read_bytes() == before
    names = "time_s tension_tight_N tension_slack_N"
    kept.check("chain/one_run", {"columns": columns(part, names, slice(None, None, 10))})
    assert pd.read_parquet(part)["run"].nunique() == 1
    refused(beltid(bench, simulate, "--arc 60"), "60", "40", "82")


RIGS = {
    "weight": {"rig": {"holds": "weight_tight"}},
    "hub_free": {"rig": {"holds": "hub_force"}},
    "clamped": {"rig": {"supports": "clamped"}},
}


@pytest.mark.parametrize("name", RIGS)
def test_simulated_rigs(name: str, bench: Path) -> None:
    """What stays while the pulley turns, and how the ends are held."""
    rig = {"arcs_deg": [40, 82], "initial_tensions_N": [200], "pulley_speeds_rad_s": [0.05, 0.84]}
    config = {"simulation": {"method": "steady", "elements": 20}, **RIGS[name]}
    config["rig"] = rig | config["rig"]
    configured(bench, config, "rig.yaml")
    done(bench, "simulate-rig surface.parquet stiffness.parquet -c rig.yaml -o other.parquet")
    last = pd.read_parquet(bench / "other.parquet").groupby("run", sort=False).last()
    found = {name: last[name].tolist() for name in ("tension_tight_N", "tension_slack_N")}
    kept.check(f"chain/simulated_{name}", {"columns": found})


def test_temperature_of_the_runs_is_taken_out(tmp_path: Path) -> None:
    """Half of the runs 18 K warmer, with 0.82 of the friction: the surface is that at 22 °C."""
    frame = pd.read_csv(ROOT / "rigdata/5pk/rig.csv")
    chosen = frame[frame["initial_tension_N"].isin([100, 220, 311, 310, 411])]
    chosen = chosen[chosen["arc_deg"].isin([40, 82])]
    labels = list(dict.fromkeys(chosen["run"]))
    warm = chosen["run"].isin(labels[1::2])
    tight, slack = chosen["tension_tight_N"].to_numpy(), chosen["tension_slack_N"].to_numpy()
    turning = warm.to_numpy() & (chosen["pulley_speed_rad_s"] != 0).to_numpy()
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(
            turning & (tight > 0) & (slack > 0), (tight / slack) ** 0.82, tight / slack
        )
    total = tight + slack
    chosen = chosen.assign(
        tension_tight_N=np.where(turning, total * ratio / (1 + ratio), tight),
        tension_slack_N=np.where(turning, total / (1 + ratio), slack),
        temperature_degC=np.where(warm, 40.0, 22.0),
    )
    chosen.to_csv(tmp_path / "rig.csv", index=False)
    shutil.copy(ROOT / "rigdata/5pk/press.csv", tmp_path)
    asked = {"correct_temperature": True, "reference_temperature_degC": 22}
    configured(tmp_path, {"friction": asked, "simulation": {"method": "steady"}})
    done(tmp_path, "fit-stiffness press.csv")
    done(tmp_path, "fit-friction rig.csv")
    said = done(tmp_path, "refine-surface friction.parquet stiffness.parquet")
    error = surface_error(tmp_path / "surface_refined.parquet", "5pk")
    kept.check("chain/temperature", {"at_most": error, "warnings": len(said.warnings)})
    assert error["rms_percent"] < 2.0


def test_plan_of_the_first_runs(tmp_path: Path) -> None:
    """A plan is the same for the same input, and says what each run is worth."""
    candidates = {"arcs_deg": [40, 82], "tension_N": [100, 200, 411], "speed_rad_s": [0.05, 0.84]}
    configured(tmp_path, {"plan": candidates}, "plan.yaml")
    done(tmp_path, "plan -c plan.yaml --runs 4 --goal-u 0.02")
    first = (tmp_path / "plan.csv").read_bytes()
    done(tmp_path, "plan -c plan.yaml --runs 4 --goal-u 0.02 --force")
    assert (tmp_path / "plan.csv").read_bytes() == first
    plan = pd.read_csv(tmp_path / "plan.csv")
    numbers = plan.select_dtypes("number")
    kept.check("chain/plan", {"columns": {name: numbers[name].tolist() for name in numbers}})
    assert set(plan["arc_deg"]) <= {40, 82}


def test_plan_says_stop(small: Path, tmp_path: Path) -> None:
    """Where more runs do not help, none are proposed."""
    out = tmp_path / "plan.csv"
    results = "surface_refined.parquet stiffness.parquet --from friction.parquet"
    done(small, f"plan {results} -o {out}")
    assert pd.read_csv(out).empty
