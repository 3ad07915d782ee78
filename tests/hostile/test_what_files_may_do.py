"""What is in a file stays data: no code, no other files, no network, no commands to a terminal."""

import ast
import gzip
import os
import resource
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from beltid.bench.files import sources_of
from beltid.bench.recording import read_recording
from beltid.cli import app
from beltid.errors import LONGEST_LINE, ArtifactError, InputError, printable
from beltid.store import parquet
from beltid.store.artifact import read_artifact

ROOT = Path(__file__).parents[2]
CORPUS = Path(__file__).parent / "corpus"


def rig(n: int = 12) -> dict[str, list[object]]:
    return {
        "run": ["R1"] * n,
        "time_s": [0.1 * i for i in range(n)],
        "tension_tight_N": [120.0] * n,
        "tension_slack_N": [80.0] * n,
        "pulley_speed_rad_s": [0.1] * n,
        "temperature_degC": [22.0] * n,
        "arc_deg": [40.0] * n,
        "initial_tension_N": [100.0] * n,
    }


def written(path: Path, columns: dict[str, object]) -> Path:
    pq.write_table(pa.table(columns), path)
    return path


def test_a_small_parquet_file_that_claims_a_great_many_rows_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(parquet, "MAX_CELLS", 1_000_000)  # the test is to be quick
    n = 2_000_000
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(n, np.int8)), pa.array([1.0]))
    path = written(tmp_path / "rig.parquet", {"time_s": column})
    with pytest.raises(InputError, match=r"it claims 2,000,000 values in [\d,]+ bytes"):
        read_recording(path, "rig")


def test_a_long_text_in_every_row_takes_the_memory_of_one(tmp_path):
    n = 100_000
    label = pa.DictionaryArray.from_arrays(pa.array(np.zeros(n, np.int32)), ["x" * 100_000])
    # 1e5 times 1e5 characters are 10 GB
    path = written(tmp_path / "rig.parquet", {**rig(n), "run": label})
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match="texts of more than 1000 bytes"):
        read_recording(path, "rig")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # KiB


def test_a_long_label_far_down_is_refused(tmp_path):
    n = 9000
    columns = {**rig(n), "run": ["R1"] * (n - 1) + ["x" * 1001]}
    path = tmp_path / "rig.parquet"
    pq.write_table(pa.table(columns), path, row_group_size=2000)
    with pytest.raises(InputError, match="texts of more than 1000 bytes"):
        read_recording(path, "rig")


@pytest.mark.parametrize(
    "column",
    [
        pa.array([[1.0]] * 12),
        pa.array([{"a": 1.0}] * 12),
        pa.ExtensionArray.from_storage(pa.uuid(), pa.array([b"0" * 16] * 12, pa.binary(16))),
    ],
    ids=["list", "struct", "extension"],
)
def test_nested_and_extension_types_are_refused(tmp_path, column):
    path = written(tmp_path / "rig.parquet", {**rig(), "arc_deg": column})
    with pytest.raises(InputError, match="column arc_deg"):
        read_recording(path, "rig")


@pytest.mark.parametrize("name", ["#hidden", "shown"])
def test_links_of_hdf5_by_which_it_may_be_left_are_not_followed(tmp_path, name):
    other, path = tmp_path / "other.h5", tmp_path / "rig.h5"
    with h5py.File(other, "w") as file:
        for column, cells in rig().items():
            if column != "run":
                file[f"secret/{column}"] = np.array(cells, dtype=float)
    with h5py.File(path, "w") as file:
        file.create_group("#refs#")[name] = h5py.ExternalLink(str(other), "/secret")
        file["R1"] = h5py.SoftLink(f"/#refs#/{name}")
    with pytest.raises(InputError, match="R1 is a link, which is not followed"):
        read_recording(path, "rig")


def test_names_in_files_cannot_command_a_terminal(tmp_path):
    path = tmp_path / "rig.csv"
    path.write_text(",".join(rig()) + "\n\x1b]0;owned\x07[red]\u202e,0,x,1,1,1,1,1\n")
    result = CliRunner().invoke(app, ["fit-friction", str(path)])
    assert result.exit_code == 2
    assert '"x", must be a number' in result.stderr
    shown = CliRunner().invoke(app, ["inspect", str(path)])
    for text in (result.output, result.stderr, shown.output, shown.stderr):
        assert not set("\x1b\x07\u202e") & set(text)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain 5 µm · 20 °C", "plain 5 µm · 20 °C"),
        ("no\u00a0break", "no\u00a0break"),
        ("a\nerror: b", "a\\nerror: b"),
        ("\x1b[31m", "\\x1b[31m"),
        ("\u202etxt.exe", "\\u202etxt.exe"),
        ("\ud800", "\\ud800"),
    ],
)
def test_messages_are_one_printable_line(text, shown):
    assert printable(text) == shown
    assert InputError(text).problems == (shown,)
    assert len(printable(text * LONGEST_LINE)) <= LONGEST_LINE


def test_nothing_in_the_package_unpickles_or_evaluates():
    """Names that run what a file holds; no reader of numpy's own files is called at all."""
    forbidden = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "np.load", "numpy.load"}
    forbidden |= {"eval", "exec", "compile"}
    for path in (ROOT / "beltid").rglob("*.py"):
        text = path.read_text("utf-8")
        if not any(word in text for word in forbidden):
            continue
        for node in ast.walk(ast.parse(text)):
            named = {a.name for a in node.names} if isinstance(node, ast.Import) else set()
            if isinstance(node, ast.ImportFrom):
                named = {node.module}
            elif isinstance(node, ast.Call):
                named = {ast.unparse(node.func)}
            assert not named & forbidden, f"{path}:{node.lineno}: {named & forbidden}"


@pytest.mark.parametrize("command", ["fit-friction", "fit-stiffness", "inspect", "show"])
def test_a_pipe_without_a_writer_and_a_device_without_end_are_not_waited_for(tmp_path, command):
    pipe = tmp_path / "rig.csv"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero")):
        result = CliRunner().invoke(app, [command, str(path)])
        assert result.exit_code == 2, result.output
        assert f"error: {path}: is a pipe or a device, a file is needed" in result.output


@pytest.mark.parametrize(
    ("kind", "name"), [("press", "press.csv"), ("rig", "rig.txt"), ("rig", "rig.xlsx")]
)
def test_a_recording_too_large_for_the_memory_is_refused_before_it_is_read(tmp_path, kind, name):
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(InputError, match="larger than 1024 MB, split"):
        read_recording(path, kind)
    with pytest.raises(ArtifactError, match="larger than 1024 MB"):
        read_artifact(path)
    with pytest.raises(InputError, match="larger than 1024 MB"):  # all files of a folder together
        read_recording(tmp_path, kind)


def test_only_files_are_parts_of_a_parquet_recording(tmp_path):
    written(tmp_path / "a.parquet", rig())
    os.mkfifo(tmp_path / "b.parquet")
    (tmp_path / "c.parquet").mkdir()
    assert [source.path for source in sources_of(tmp_path)] == [tmp_path / "a.parquet"]


@pytest.mark.parametrize("head", ["", "run,time_s\n"], ids=["nothing", "header"])
def test_a_file_of_blank_lines_is_refused(tmp_path, head):
    path = tmp_path / "rig.csv.gz"
    path.write_bytes(gzip.compress(head.encode() + b"\n" * 600_000, 1))
    with pytest.raises(InputError, match=r"holds no (header|samples)"):
        read_recording(path, "rig")


def test_a_line_that_would_fill_the_memory_is_refused_with_its_place(tmp_path):
    path = tmp_path / "rig.csv.gz"
    columns = rig()
    rows = [",".join(str(cell) for cell in cells) for cells in zip(*columns.values(), strict=True)]
    text = "\n".join([",".join(columns), *rows, "0," * (10 << 20), *rows])
    path.write_bytes(gzip.compress(text.encode(), 1))
    with pytest.raises(InputError, match=r"rig\.csv\.gz:14: "):
        read_recording(path, "rig")
