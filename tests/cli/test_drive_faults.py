"""simulate-drive by command: every drive that cannot be, or can hardly be predicted, says why."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from beltid.store.artifact import read_artifact, write_artifact

Predict = Callable[[dict[str, Any]], Any]


def two(apart: float = 0.25, radii: tuple[float, float] = (0.05, 0.05)) -> list[dict[str, Any]]:
    driver, driven = radii
    return [
        {"name": "driver", "x_m": 0.0, "y_m": 0.0, "radius_m": driver},
        {"name": "driven", "x_m": apart, "y_m": 0.0, "radius_m": driven},
    ]


def idler(y: float) -> dict[str, Any]:
    """A pulley between the other two, as large as they are."""
    return {"name": "idler", "x_m": 0.2, "y_m": y, "radius_m": 0.05}


ARM = {
    "pulley": "idler",
    "pivot_m": [0.2, 0.35],
    "arm_m": 0.15,
    "free_angle_deg": 270,
    "preload_N_m": 5.0,
    "rate_N_m_deg": 0.1,
}
ACROSS = {"pivot_m": [0.05, 0.2], "free_angle_deg": 30, "rate_N_m_deg": 0}
SPRUNG = {"installation": "tensioner", "pulleys": [*two(0.4), idler(0.2)], "tensioner": ARM}


@pytest.fixture
def predict(
    finished: Path, tmp_path: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> Predict:
    """Simulate a drive with the laws of the finished folder: exit_code, stderr."""
    monkeypatch.setattr("beltid.stages.drive.TENSIONS", (1.0,))
    monkeypatch.setattr("beltid.drive.limits.TOLERANCE", 0.05)
    monkeypatch.setenv("COLUMNS", "1000")
    laws = [finished / "surface.parquet", finished / "stiffness.parquet"]

    def call(stated: dict[str, Any]) -> Any:
        points = {"driver_speed_rad_s": [62.8], "torque_N_m": {"driven": [8]}}
        drive = {"initial_tension_N": [310], "pulleys": two(), "operating_points": points}
        path, out = tmp_path / "drive.yaml", tmp_path / "drive.parquet"
        path.write_text(yaml.safe_dump({"drive": drive | stated}))
        return beltid("simulate-drive", *laws, "-c", path, "-o", out, "--force")

    return call


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        (
            {"pulleys": [*two(0.4), idler(0.12), {**idler(0.4), "name": "upper"}]},
            "the belt does not reach pulley idler",
        ),
        # the belt presses the arm into its pivot, and no tension holds the spring
        (SPRUNG | {"initial_tension_N": None}, "tensioner: no equilibrium in its mean position"),
        # 5 N m on an arm of 0.15 m push with 33 N; the belt holds 20 N times sqrt(2) at most
        (
            SPRUNG | {"tensioner": ARM | ACROSS, "initial_tension_N": [20]},
            "tensioner: no equilibrium with a belt tension of 20 N at rest",
        ),
        # sqrt(0.02 N m² / 310 N) = 8.03 mm, six of them 48.2 mm; the span is as long as the centres
        ({"pulleys": two(0.045, (0.02, 0.02))}, "0.045 m, must be at least 0.0482 m, six bending"),
        (
            {"pulleys": two(0.09)},
            "pulleys driver and driven overlap: their centres are 0.09 m apart, must be more than "
            "0.1 m",
        ),
    ],
)
def test_a_drive_that_cannot_be_is_refused(
    predict: Predict, stated: dict[str, Any], message: str
) -> None:
    result = predict(stated)
    assert result.exit_code == 2, result.stderr
    assert message in result.stderr


def test_a_string_does_not_bend_in_short_spans(predict: Predict) -> None:
    assert predict({"method": "string", "pulleys": two(0.045, (0.02, 0.02))}).exit_code == 0


def test_a_prediction_beyond_the_laws_is_warned_of(predict: Predict) -> None:
    """Radii 1.6 and 0.6 times that of the rig, a belt twice as tight, a crawling drive."""
    slow = {"driver_speed_rad_s": [5], "torque_N_m": {"driven": [3, 35]}}
    drive = {"pulleys": two(0.3, (0.08, 0.03)), "initial_tension_N": [600]}
    result = predict(drive | {"operating_points": slow})
    assert result.exit_code == 0, result.stderr
    for words in (
        "pulley driver: radius 0.08 m is outside 0.035 to 0.075 m",
        "pulley driven: radius 0.03 m is outside 0.035 to 0.075 m",
        "% of the sliding friction acts below the slowest measured sliding",
        "% of the sliding friction acts outside the measured line forces",
        "1 points cannot be transmitted with the friction that is known: 2",
    ):
        assert words in result.stderr, result.stderr


RADII = (0.075, 0.04)


def recording_of_unequal_pulleys(path: Path, torques: tuple[float, ...], swapped: bool) -> None:
    """Speed losses at 310 N by stretch and seating alone: those of small torques, in closed form.

    Belt and law of the synthetic 5PK bench; sum and difference of the tensions are 2 T0 and M/R.
    """

    def log_of_speed(force: float, radius: float) -> float:
        seating = (np.sqrt(6.5e7**2 + 4.0 * 3.0256e11 * force / radius) - 6.5e7) / (2.0 * 3.0256e11)
        return float(np.log(1.0 + force / 1.0e5) - np.log(radius - seating))

    driver, driven = RADII
    lines = ["run,time_s,initial_tension_N,torque_N_m,driver_speed_rad_s,driven_speed_rad_s"]
    for run, torque in enumerate(torques):
        half = 0.5 * torque / driven
        ratio = log_of_speed(310.0 + half, driver) - log_of_speed(310.0 - half, driven)
        for k in range(8):
            flutter = 0.002 * (-1) ** k
            speeds = [60.0 + flutter, 60.0 / np.exp(ratio) - flutter]
            cells = [310.0, torque, *(speeds[::-1] if swapped else speeds)]
            lines.append(f"{run},{0.1 * k:.1f}," + ",".join(f"{cell:.8g}" for cell in cells))
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(("sign", "swapped"), [(1.0, False), (-1.0, False), (-1.0, True)])
def test_unequal_pulleys_are_compared_at_the_driver(
    bench: Path, beltid: Any, sign: float, swapped: bool
) -> None:
    """Also where the driven pulley drives; swapped speeds contradict the radii."""
    loads = (0.0, 3.0, 4.5, 6.0)
    recording_of_unequal_pulleys(bench / "own.csv", tuple(sign * M for M in loads), swapped)
    config = {
        "drive": {"pulleys": two(0.3, RADII)},
        "compare_drive": {"max_rms_relative_error": 0.06},
    }
    (bench / "own.yaml").write_text(yaml.safe_dump(config))
    common = ("-c", "own.yaml", "--force", "-o")
    assert beltid("fit-slip", "own.csv", *common, "own_slip.parquet").exit_code == 0
    laws = ("surface.parquet", "stiffness.parquet", "--from", "own_slip.parquet")
    simulated = beltid("simulate-drive", *laws, *common, "own_drive.parquet")
    assert simulated.exit_code == 0, simulated.stderr
    found = beltid(
        "compare-drive", "own_slip.parquet", "own_drive.parquet", *common, "own_c.parquet"
    )
    assert found.exit_code == 0, found.stdout
    assert ("or driver and driven are swapped" in simulated.stderr) is swapped
    # Eq. (7) at the driver of the drive, not at the pulley of the rig
    slip = read_artifact(bench / "own_slip.parquet").columns
    assert slip["slip_speed_m_s"][1:] == pytest.approx(RADII[0] * slip["speed_loss_rad_s"][1:])


def test_runs_without_a_prediction_count_against_it(bench: Path, beltid: Any) -> None:
    """Of most runs the drive found no steady state: agreement of the rest is not enough."""
    drive = read_artifact(bench / "drive.parquet", "drive")
    runs = list(dict.fromkeys(drive.columns["run"].tolist()))
    loads = np.abs(read_artifact(bench / "slip.parquet").columns["torque_N_m"])
    kept = np.isin(drive.columns["run"], runs[int(loads.argmax())])
    few = {name: values[kept] for name, values in drive.columns.items()}
    write_artifact(bench / "few.parquet", few, drive.record)
    whole = json.loads(beltid("compare-drive", "slip.parquet", "drive.parquet", "--json").stdout)
    result = beltid("compare-drive", "slip.parquet", "few.parquet", "-o", "c.parquet", "--json")
    assert result.exit_code == 4
    product = json.loads(result.stdout)
    asked = whole["facts"]["points_to_be_judged"]
    assert asked > 2
    assert product["facts"]["points_to_be_judged"] == asked
    assert product["facts"]["points_judged"] == 1
    assert f"{asked - 1} points have no prediction" in product["verdict"]
    assert [row["status"] for row in product["table"]].count("predicted: no steady state") == (
        len(whole["table"]) - 1
    )
