"""Recordings that a config names: those of another bench are told before anything runs."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from beltid.config import ConfigSource, load_config
from beltid.stages.setup.named_recordings import wrong_recordings

RIGDATA = Path(__file__).parents[2] / "rigdata" / "5pk"
LAB = {
    "Druck.txt": "Probe;Zeit [s];Kraft [N];Weg [mm]\nP1;0;0;0\nP1;1;5,2;0,1\n",
    "weight.csv": "run,time_s,tension_slack_N,pulley_speed_rad_s,arc_deg,weight_N\n1,0,5,0,180,5\n",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for kind in ("press", "rig", "speedloss"):
        shutil.copy(RIGDATA / f"{kind}.csv", tmp_path)
    for name, text in LAB.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def wrong(folder: Path, *lines: str) -> list[str]:
    path = folder / "belt.yaml"
    path.write_text("\n".join(["data:", *(f"  {line}" for line in lines), ""]))
    found = wrong_recordings(ConfigSource(load_config(path), str(path), path))
    return [line.replace(f"{folder}/", "") for line in found]


def test_swapped_recordings_are_one_problem(folder: Path) -> None:
    assert wrong(folder, "press: rig.csv", "rig: press.csv") == [
        "belt.yaml:2:10: data.press and data.rig are swapped: rig.csv holds the columns of a rig "
        "recording, press.csv those of a press recording"
    ]


def test_swapped_recordings_in_the_words_of_a_laboratory(folder: Path) -> None:
    (found,) = wrong(folder, "rig: Druck.txt", "press: weight.csv")
    assert "data.press and data.rig are swapped: weight.csv holds" in found


def test_a_recording_of_another_bench_is_named_with_its_own(folder: Path) -> None:
    assert wrong(folder, "press: speedloss.csv", "rig: rig.csv") == [
        "belt.yaml:2:10: data.press = speedloss.csv, holds the columns of a speedloss recording"
    ]


def test_recordings_in_their_places_are_no_problem(folder: Path) -> None:
    assert wrong(folder, "press: press.csv", "rig: rig.csv", "speedloss: speedloss.csv") == []
    assert wrong(folder, "press: Druck.txt", "rig: weight.csv") == []
