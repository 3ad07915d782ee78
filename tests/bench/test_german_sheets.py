"""The sheets of a small laboratory: workbooks per arc, a sheet per run, German signs (synthetic).

The belt is that of the golden benches: a weight on the slack span, the torque and the speed of the
pulley over time. They are read without a line that has to be pasted.
"""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from golden import benches, files_written as w
from golden.door import beltid as call, done

from beltid.bench.recording import read_recording
from beltid.config import load_config

G = 9.80665
WEIGHTS_N = (5.0 * G, 10.0 * G, 20.0 * G, 40.0 * G)
SPEEDS_RAD_S = tuple(0.02 * 1.6**k for k in range(10))
CHANNELS = ["time_s", "torque_N_m", "pulley_speed_rad_s", "weight_N", "arc_deg"]
HEADS = {"torque_N_m": ("Drehmoment", "Nm"), "tension_tight_N": ("Kraft Zugtrum", "N")}


def german(value: float, digits: int) -> str:
    """Write a number with a decimal comma."""
    return f"{value:.{digits}f}".replace(".", ",")


def write_rig(
    folder: Path, channel: str = "torque_N_m", samples: int = 300, speeds: int = 10
) -> tuple[benches.Rig, pd.DataFrame]:
    """Write a workbook per arc with a sheet per run; return the rig and the samples, run by run."""
    rig = benches.Rig(
        "weight_slack", (40.0, 68.0, 82.0), WEIGHTS_N, SPEEDS_RAD_S[:speeds], samples=samples
    )
    recording, labels = rig.recording(), dict[str, str]()
    folder.mkdir(parents=True)
    for arc, of_arc in recording.groupby("arc_deg", sort=False):
        book, sheets = f"Umschlingung_{arc:.0f}Grad", {"Übersicht": [["Riemen", "5PK"]]}
        for number, (run, frame) in enumerate(of_arc.groupby("run", sort=False), start=1):
            labels[str(run)] = f"{book}/Lauf {number}"
            weight = f"{german(frame['weight_N'].iloc[0] / G, 1)} kg"
            rows = [["Prüfstand", "3"], ["Gewicht am Leertrum", weight], []]
            rows += [["Zeit", HEADS[channel][0], "Drehzahl"], ["s", HEADS[channel][1], "1/min"]]
            turns = frame["pulley_speed_rad_s"] * 30 / math.pi
            for time, force, speed in zip(frame["time_s"], frame[channel], turns, strict=True):
                rows.append([german(time, 4), german(force, 4), german(speed, 5)])
            sheets[f"Lauf {number}"] = rows
        w.workbook(folder / f"{book}.xlsx", sheets)
    return rig, recording.assign(run=recording["run"].map(labels))


def write_press(path: Path) -> None:
    """Write the record of the press as a workbook."""
    head = [
        ["Probenbreite", "40 mm"],
        ["Temperatur", "22 °C"],
        ["Zeit [s]", "Weg [mm]", "Kraft [N]"],
    ]
    rows = benches.press()[["time_s", "displacement_mm", "force_N"]].to_numpy().tolist()
    w.workbook(path, {"P22": [*head, *rows]})


def test_init_states_all_that_the_sheets_of_weight_and_torque_hold(tmp_path: Path) -> None:
    """Columns, units, runs, arcs, weights and speeds; what is guessed has a comment."""
    _, truth = write_rig(tmp_path / "versuche", samples=60, speeds=2)
    write_press(tmp_path / "presse.xlsx")
    call(tmp_path, "init", "5pk", "versuche", "presse.xlsx")
    config, text = load_config(tmp_path / "5pk.yaml"), (tmp_path / "5pk.yaml").read_text()
    assert {kind: path.name for kind, path in config.data.files.items()} == {
        "rig": "versuche",
        "press": "presse.xlsx",
    }
    assert [*config.rig.arcs_deg] == [40.0, 68.0, 82.0]
    assert config.rig.holds == "weight_slack"  # by the name of the field
    np.testing.assert_allclose(config.rig.initial_tensions_N, WEIGHTS_N, 1e-3)
    np.testing.assert_allclose(config.rig.pulley_speeds_rad_s, SPEEDS_RAD_S[:2], 1e-3)
    assert 'Grad.xlsx"  # guessed' in text
    assert "Zeit  # recognised by its name" in text
    read = read_recording(tmp_path / "versuche", "rig", config)
    assert len(set(read.columns["run"])) == 24
    assert any("sheet Übersicht left out" in note for note in read.notes)
    found = pd.DataFrame({name: read.columns[name] for name in ("run", *CHANNELS)})
    found = found.set_index(["run", "time_s"]).sort_index()
    true = truth[["run", *CHANNELS]].set_index(["run", "time_s"]).sort_index()
    for name in CHANNELS[1:]:
        np.testing.assert_allclose(found[name], true[name], 1e-4, 1e-4, err_msg=name)


@pytest.mark.long
@pytest.mark.parametrize("channel", HEADS)
def test_from_sheets_to_a_refined_surface_and_a_report_in_four_commands(
    channel: str, tmp_path: Path
) -> None:
    rig, truth = write_rig(tmp_path / "versuche", channel, 150)
    write_press(tmp_path / "presse.xlsx")
    done(tmp_path, "inspect", "presse.xlsx")
    done(tmp_path, "init", "5pk", "versuche", "presse.xlsx")
    said = call(tmp_path, "run", "5pk.yaml")
    assert said.status not in (1, 2), said.stderr  # the verdict is not the subject
    done(tmp_path, "report", "runs/5pk")
    results = tmp_path / "runs" / "5pk"
    assert {"surface_refined.parquet", "report.html"} <= {path.name for path in results.iterdir()}
    found = pd.read_parquet(results / "friction.parquet").set_index("run")
    assert set(found["status"]) == {"ok"}
    mu = pd.Series(rig.runs()["mu"].to_numpy(), truth["run"].unique())
    np.testing.assert_allclose(found["mu_sliding"][mu.index], mu, 2e-3)
