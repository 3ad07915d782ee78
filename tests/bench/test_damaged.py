"""A damaged file ends with a message and status 2, whatever its library does with it."""

from __future__ import annotations

import random
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import writers
from typer.testing import CliRunner

from beltid.bench.files.sniff import sniff
from beltid.bench.formats.bench_file import BenchFile
from beltid.bench.formats.isolated import process
from beltid.bench.formats.isolated.process import read_isolated
from beltid.bench.recording import read_recording
from beltid.cli import app
from beltid.errors import InputError

DELICATE = ("tdms", "mf4", "mat5", "mat73", "xlsx")


def lvm(folder: Path) -> Path:
    return writers.write_lvm(folder / "R001.lvm", writers.rig_runs(1)["R001"])


def zwick(folder: Path) -> Path:
    return writers.write_zwick(folder / "P22.txt", writers.press_tests()["P22"])


WRITERS: dict[str, Callable[[Path], Path]] = {**writers.RIG, "lvm": lvm, "zwick": zwick}


@pytest.mark.parametrize("name", [n for n in WRITERS if n not in (*DELICATE, "mdf3", "utf-16")])
def test_a_file_that_is_cut_off(tmp_path, name):
    path = WRITERS[name](tmp_path)
    data = path.read_bytes()
    at = len(data) * 2 // 5
    if name in ("zwick", "lvm", "semicolons", "latin-1"):
        at = data.index(b"\n", at) + 3  # within a row: a cut between two rows looks like an end
    path.write_bytes(data[:at])
    command = "fit-stiffness" if name == "zwick" else "fit-friction"
    result = CliRunner().invoke(app, [command, str(path), "-q"])
    assert result.exit_code == 2, result.output
    assert f"error: {path}" in result.stderr
    assert "Traceback" not in result.stderr
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("name", DELICATE)
def test_flipped_bits_and_cuts_never_end_this_process(tmp_path, name):
    path = WRITERS[name](tmp_path)
    data = path.read_bytes()
    dice = random.Random(7)
    jobs = []
    for number in range(12):
        spoilt = bytearray(data)
        at = dice.randrange(min(len(data), 1500) if number % 2 else len(data))
        spoilt[at] ^= 1 << dice.randrange(8)
        if number >= 8:
            del spoilt[at:]
        file = tmp_path / f"{number}{path.suffix}"
        file.write_bytes(bytes(spoilt))
        jobs.append((sniff(data, path.name), file))
    found = read_isolated(jobs)
    assert len(found) == 12
    assert all(isinstance(one, (BenchFile, InputError)) for one in found)
    # a bit among plain numbers is a number: only cuts and what has checksums must be seen
    must_be_seen = found if name == "xlsx" else found[8:]
    assert sum(isinstance(one, InputError) for one in must_be_seen) >= len(must_be_seen) - 1


@pytest.mark.parametrize("name", ["mat5", "xlsx"])
def test_what_only_begins_like_a_format(tmp_path, name):
    path = WRITERS[name](tmp_path)
    head = path.read_bytes()[:600]
    path.write_bytes(head + bytes(random.Random(3).randbytes(5000)))
    with pytest.raises(InputError, match="damaged"):
        read_recording(path, "rig")


def test_the_content_decides_what_a_file_is_and_not_its_ending(tmp_path):
    path = writers.write_xlsx(tmp_path / "rig.tdms", writers.rig_runs())
    assert len(set(read_recording(path, "rig").columns["run"])) == 3


def test_a_reader_that_crashes_ends_only_its_own_process(tmp_path, monkeypatch):
    good = writers.RIG["tdms"](tmp_path)
    monkeypatch.setattr(process, "BASE_MEMORY", 20 << 20)  # too little for numpy
    (found,) = read_isolated([("tdms", good)])
    assert isinstance(found, InputError)
    monkeypatch.setattr("sys.executable", "/bin/false")
    with pytest.raises(InputError, match="the reader of its format crashed on it"):
        read_recording(good, "rig")


def test_a_reader_that_does_not_end_is_ended(tmp_path, monkeypatch):
    good = writers.RIG["tdms"](tmp_path)
    monkeypatch.setattr(process, "BASE_CPU_S", -2)
    (found,) = read_isolated([("tdms", good)])
    assert isinstance(found, InputError)


def test_after_a_crash_the_other_files_are_read(tmp_path, monkeypatch):
    good = writers.RIG["mat5"](tmp_path)
    real = process._one_child
    calls = []

    def crash_once(jobs):
        calls.append(len(jobs))
        return ([], "crashed") if len(calls) == 1 else real(jobs)

    monkeypatch.setattr(process, "_one_child", crash_once)
    first, second = read_isolated([("mat", good), ("mat", good)])
    assert isinstance(first, InputError)
    assert isinstance(second, BenchFile)


def test_samples_that_stand_in_another_file_are_not_read(tmp_path):
    import h5py

    (tmp_path / "raw.bin").write_bytes(bytes(800))
    path = tmp_path / "external.h5"
    with h5py.File(path, "w") as file:
        raw = str(tmp_path / "raw.bin")
        file.create_dataset("tension_tight_N", (100,), dtype="f8", external=[(raw, 0, 800)])
    with pytest.raises(InputError, match="takes its samples from another file"):
        read_recording(path, "rig")


def test_bombs(tmp_path):
    path = tmp_path / "rig.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("R001.csv", b"0" * (8 << 20))
    with pytest.raises(InputError, match="compressed more than 1000 to 1"):
        read_recording(path, "rig")
    book = tmp_path / "rig.xlsx"
    with zipfile.ZipFile(book, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", "x")
        archive.writestr("xl/workbook.xml", b"0" * (8 << 20))
    with pytest.raises(InputError, match="damaged"):
        read_recording(book, "rig")


@pytest.mark.parametrize("name", ["semicolons", "mat5"])
def test_only_formats_read_by_a_child_need_a_temporary_folder(tmp_path, monkeypatch, name):
    def none_usable() -> str:
        raise FileNotFoundError(2, "No usable temporary directory found")

    path = WRITERS[name](tmp_path)
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("tempfile._get_default_tempdir", none_usable)
    result = CliRunner().invoke(app, ["fit-friction", str(path), "-q"])
    assert "Traceback" not in result.stderr
    if name == "semicolons":
        assert result.exit_code == 0, result.output
    else:
        assert result.exit_code == 2
        assert "TMPDIR" in result.stderr
