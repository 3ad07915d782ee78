"""One file per run, many runs in one file, and where label and settings of a run may stand."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from golden import files_written as w

from beltid.bench.files import content_of
from beltid.bench.recording import read_recording, recording_in
from beltid.config import load_config
from beltid.errors import InputError

VALUES = {"runs": {"rig": {"values": {"arc_deg": 40, "initial_tension_N": 50}}}}


def per_run(folder: Path) -> Path:
    """Write a file per run without label and settings; return their folder."""
    return folder / w.one_each("{run}.csv", ("run", *w.SETTINGS))(folder)


def problems(path: Path, config: dict[str, object] | None = None, kind: str = "rig") -> list[str]:
    with pytest.raises(InputError) as caught:
        read_recording(path, kind, load_config(config))
    return [p.replace(f"{path}", path.name) for p in caught.value.problems]


def test_a_stated_label_does_not_make_one_run_of_two(tmp_path):
    one, two = w.RUNS["R001"], w.RUNS["R004"]
    (tmp_path / "runs").mkdir()
    later = two.assign(time_s=two["time_s"] + 100)
    both = pd.concat([one.assign(run="a"), later.assign(run="b")])
    both.to_csv(tmp_path / "runs" / "R7.csv", index=False)
    (found,) = problems(tmp_path / "runs", {"runs": {"rig": {"pattern": "{run}.csv"}}})
    assert all(words in found for words in ("runs/R7.csv", "2 labels", "run = R7"))


def test_a_frame_has_no_name_and_no_header_that_tell_its_runs(tmp_path):
    """What holds for every run holds for those of a frame; names of files are none of it."""
    table = tmp_path / "runs.csv"
    table.write_text("file,arc_deg\na.csv,82\n")
    told = {"table": str(table), "pattern": "{run}_{}.csv"}
    config = {"columns": {"rig": {"arc_deg": "Bogen"}}}
    rig = {**told, "values": {"initial_tension_N": 411}}
    frame = w.R001.drop(columns="initial_tension_N")
    columns = recording_in(frame, "rig", load_config({"runs": {"rig": rig}, **config})).columns
    assert set(columns["initial_tension_N"]) == {411.0}
    assert set(columns["arc_deg"]) == set(frame["arc_deg"])


def test_a_table_and_files_that_do_not_belong_together(tmp_path):
    folder = per_run(tmp_path)
    table = folder / "runs.csv"  # beside the recordings: it is not one of them
    table.write_text("file,arc_deg,initial_tension_N\nR001,40,50\nR002.csv,40,50\nR003.csv,68,x\n")
    assert problems(folder, {"runs": {"rig": {"table": str(table)}}}) == [
        'rig/runs.csv:4: initial_tension_N = "x", must be a number'
    ]
    table.write_text("file,arc_deg,initial_tension_N\nR001,40,50\nR002.csv,40,50\nR003.csv,68,50\n")
    found = "\n".join(problems(folder, {"runs": {"rig": {"table": str(table)}}}))
    for words in ("runs.csv: R004.csv", "R004.csv:1: arc_deg", "R004.csv:1: initial"):
        place, _, word = words.partition(": ")
        assert any(place in line and word in line for line in found.splitlines()), words


def test_header_fields_and_values_for_all_runs(tmp_path):
    folder = per_run(tmp_path)
    for label, run in w.RUNS.items():
        arc, tension = (run[name][0] for name in w.SETTINGS)
        head = f"# Wrap angle: {arc} deg\n# Set tension = {tension}\n"
        path = folder / f"{label}.csv"
        path.write_text(head + path.read_text())
    config = {"columns": {"rig": {"initial_tension_N": "Set tension"}}}
    recording, true = read_recording(folder, "rig", load_config(config)), pd.concat(w.RUNS.values())
    assert recording.columns["run"].tolist() == true["run"].tolist()
    for name in w.CELLS + w.SETTINGS:
        np.testing.assert_array_equal(recording.columns[name], true[name].to_numpy(dtype=float))
    assert "read header field Wrap angle as arc_deg" in recording.notes
    # what the config says of all runs comes before a header that is merely recognised
    stated = config | {"runs": {"rig": {"values": {"arc_deg": 77}}}}
    columns = read_recording(folder, "rig", load_config(stated)).columns
    assert set(columns["arc_deg"]) == {77}
    wrong = {"columns": {"rig": {"initial_tension_N": "T nominal"}}}
    assert "T nominal" in problems(folder, wrong)[0]


def test_a_folder_of_several_kinds_is_not_guessed_at(tmp_path):
    folder = per_run(tmp_path)
    (folder / "list.txt").write_text("x")
    (folder / "README.md").write_text("x")
    (found,) = problems(folder)
    assert "holds files of several kinds (" in found
    assert "4 .csv" in found
    assert found.endswith("name only the runs, such as rig/*.csv")
    (folder / "list.txt").unlink()
    assert len(set(read_recording(folder, "rig", load_config(VALUES)).columns["run"])) == 4
    assert problems(tmp_path / "nothing*.csv") == ["nothing*.csv: no file matches this pattern"]


def test_names_that_are_not_utf_8_and_links_that_lead_nowhere(tmp_path):
    """A name unpacked on a computer of another encoding is read, its label is shown."""
    folder = per_run(tmp_path)
    for number, label in enumerate(w.RUNS):
        (folder / f"{label}.csv").rename(folder / os.fsdecode(b"L\xe4uf%d.csv" % number))
    (folder / "Thumbs.db").write_bytes(b"\xd0\xcf\x11\xe0")
    config = load_config(VALUES)
    columns = read_recording(folder, "rig", config).columns
    assert sorted(set(columns["run"])) == [f"L\ufffduf{number}" for number in range(4)]
    assert len(content_of(folder)) == 64
    (folder / "R5.csv").symlink_to(tmp_path / "another disk.csv")
    with pytest.raises(InputError, match=r"R5\.csv: "):
        read_recording(folder, "rig", config)


def test_the_hash_of_a_folder_follows_names_and_contents(tmp_path):
    folder = per_run(tmp_path)
    before = content_of(folder)
    assert content_of(folder / "*.csv") == before
    (folder / "R001.csv").rename(folder / "R001b.csv")
    renamed = content_of(folder)
    with (folder / "R002.csv").open("a") as file:
        file.write("\n")
    assert len({before, renamed, content_of(folder)}) == 3
    (folder / "notes.md").write_text("no recording")
    (folder / ".hidden.csv").write_text("no recording")
    assert content_of(folder) == content_of(folder / "R*.csv")
