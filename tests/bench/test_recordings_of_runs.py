"""One file per run, many runs in one file, and where label and settings of a run may stand."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from beltid.bench.files import content_of
from beltid.bench.recording import read_recording, recording_in
from beltid.config import load_config
from beltid.errors import InputError

RIGDATA = Path(__file__).parents[2] / "rigdata" / "5pk"
LABELS = ("R001", "R002", "R042", "R100")


@pytest.fixture(scope="module")
def runs() -> dict[str, pd.DataFrame]:
    frame = pd.read_csv(RIGDATA / "rig.csv", dtype={"run": str})
    return {label: frame[frame["run"] == label] for label in LABELS}


def sensors(run: pd.DataFrame) -> pd.DataFrame:
    return run.drop(columns=["run", "arc_deg", "initial_tension_N"])


def per_run(folder: Path, runs: dict[str, pd.DataFrame], name: str = "{label}.csv") -> Path:
    folder.mkdir()
    for label, run in runs.items():
        arc, tension = run["arc_deg"].iloc[0], run["initial_tension_N"].iloc[0]
        file = folder / name.format(label=label, arc=arc, tension=tension)
        sensors(run).to_csv(file, index=False)
    return folder


def expect(columns: dict[str, np.ndarray], runs: dict[str, pd.DataFrame]) -> None:
    frame = pd.concat(runs.values())
    assert columns["run"].tolist() == frame["run"].tolist()
    for name, values in columns.items():
        if name != "run":
            np.testing.assert_array_equal(values, frame[name].to_numpy(dtype=float))


def problems(path: Path, config: dict[str, object] | None = None, kind: str = "rig") -> list[str]:
    with pytest.raises(InputError) as caught:
        read_recording(path, kind, load_config(config))
    return [p.replace(f"{path}", path.name) for p in caught.value.problems]


def test_a_stated_label_does_not_make_one_run_of_two(tmp_path, runs):
    one, two = runs["R001"], runs["R100"]
    (tmp_path / "runs").mkdir()
    later = two.assign(time_s=two["time_s"] + 100)
    both = pd.concat([one.assign(run="a"), later.assign(run="b")])
    both.to_csv(tmp_path / "runs" / "R7.csv", index=False)
    (found,) = problems(tmp_path / "runs", {"runs": {"rig": {"pattern": "{run}.csv"}}})
    assert all(words in found for words in ("runs/R7.csv", "2 labels", "run = R7"))


def test_a_frame_has_no_name_and_no_header_that_tell_its_runs(tmp_path, runs):
    """What holds for every run holds for those of a frame; names of files are none of it."""
    table = tmp_path / "runs.csv"
    table.write_text("file,arc_deg\na.csv,82\n")
    told = {"table": str(table), "pattern": "{run}_{}.csv"}
    config = {"columns": {"rig": {"arc_deg": "Bogen"}}}
    rig = {**told, "values": {"initial_tension_N": 411}}
    frame = runs["R001"].drop(columns="initial_tension_N")
    columns = recording_in(frame, "rig", load_config({"runs": {"rig": rig}, **config})).columns
    assert set(columns["initial_tension_N"]) == {411.0}
    assert set(columns["arc_deg"]) == set(frame["arc_deg"])


def test_a_table_and_files_that_do_not_belong_together(tmp_path, runs):
    folder = per_run(tmp_path / "runs", runs)
    table = folder / "runs.csv"  # beside the recordings: it is not one of them
    table.write_text("file,arc_deg,initial_tension_N\nR001,40,50\nR002.csv,40,50\nR042.csv,68,x\n")
    assert problems(folder, {"runs": {"rig": {"table": str(table)}}}) == [
        'runs/runs.csv:4: initial_tension_N = "x", must be a number'
    ]
    table.write_text("file,arc_deg,initial_tension_N\nR001,40,50\nR002.csv,40,50\nR042.csv,68,50\n")
    found = "\n".join(problems(folder, {"runs": {"rig": {"table": str(table)}}}))
    for words in ("runs.csv: R100.csv", "R100.csv:1: arc_deg", "R100.csv:1: initial"):
        place, _, word = words.partition(": ")
        assert any(place in line and word in line for line in found.splitlines()), words


def test_header_fields_and_values_for_all_runs(tmp_path, runs):
    (tmp_path / "runs").mkdir()
    for label, run in runs.items():
        arc, tension = run["arc_deg"].iloc[0], run["initial_tension_N"].iloc[0]
        head = f"# Wrap angle: {arc} deg\n# Set tension = {tension}\n"
        (tmp_path / "runs" / f"{label}.csv").write_text(head + sensors(run).to_csv(index=False))
    config = {"columns": {"rig": {"initial_tension_N": "Set tension"}}}
    recording = read_recording(tmp_path / "runs", "rig", load_config(config))
    expect(recording.columns, runs)
    assert "read header field Wrap angle as arc_deg" in recording.notes
    # what the config says of all runs comes before a header that is merely recognised
    config["runs"] = {"rig": {"values": {"arc_deg": 77}}}
    assert set(
        read_recording(tmp_path / "runs", "rig", load_config(config)).columns["arc_deg"]
    ) == {77}
    wrong = {"columns": {"rig": {"initial_tension_N": "T nominal"}}}
    assert "T nominal" in problems(tmp_path / "runs", wrong)[0]


def test_a_folder_of_several_kinds_is_not_guessed_at(tmp_path, runs):
    folder = per_run(tmp_path / "runs", runs)
    (folder / "list.txt").write_text("x")
    (folder / "README.md").write_text("x")
    (found,) = problems(folder)
    assert "holds files of several kinds (" in found
    assert "4 .csv" in found
    assert found.endswith("name only the runs, such as runs/*.csv")
    (folder / "list.txt").unlink()
    values = {"arc_deg": 40, "initial_tension_N": 50}
    config = load_config({"runs": {"rig": {"values": values}}})
    assert len(set(read_recording(folder, "rig", config).columns["run"])) == 4
    assert problems(tmp_path / "nothing*.csv") == ["nothing*.csv: no file matches this pattern"]


def test_names_that_are_not_utf_8_and_links_that_lead_nowhere(tmp_path, runs):
    """A name unpacked on a computer of another encoding is read, its label is shown."""
    folder = per_run(tmp_path / "runs", runs)
    for number, label in enumerate(LABELS):
        (folder / f"{label}.csv").rename(folder / os.fsdecode(b"L\xe4uf%d.csv" % number))
    (folder / "Thumbs.db").write_bytes(b"\xd0\xcf\x11\xe0")
    config = load_config({"runs": {"rig": {"values": {"arc_deg": 40, "initial_tension_N": 50}}}})
    columns = read_recording(folder, "rig", config).columns
    assert sorted(set(columns["run"])) == [f"L\ufffduf{number}" for number in range(4)]
    assert len(content_of(folder)) == 64
    (folder / "R5.csv").symlink_to(tmp_path / "another disk.csv")
    with pytest.raises(InputError, match=r"R5\.csv: "):
        read_recording(folder, "rig", config)


# --- hashes ----------------------------------------------------------------------------------


def test_the_hash_of_a_folder_follows_names_and_contents(tmp_path, runs):
    folder = per_run(tmp_path / "runs", runs)
    before = content_of(folder)
    assert content_of(tmp_path / "runs" / "*.csv") == before
    (folder / "R001.csv").rename(folder / "R001b.csv")
    renamed = content_of(folder)
    with (folder / "R002.csv").open("a") as file:
        file.write("\n")
    assert len({before, renamed, content_of(folder)}) == 3
    (folder / "notes.md").write_text("no recording")
    (folder / ".hidden.csv").write_text("no recording")
    assert content_of(folder) == content_of(tmp_path / "runs" / "R*.csv")
