"""Compiled kernels are kept for exactly the sources that they come from."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from beltid.rig import compiler


@pytest.fixture
def rooms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for room in compiler.ROOMS:
        (tmp_path / "beltid" / room).mkdir(parents=True)
    (tmp_path / "beltid/rig/belt.py").write_text("@kernel\ndef one(): ...\n")
    (tmp_path / "beltid/rig/runs.py").write_text("def two(): ...\n")
    (tmp_path / "beltid/laws/penalty.py").write_text("def three(): ...\n")
    monkeypatch.setattr(compiler, "PACKAGE", tmp_path / "beltid")
    monkeypatch.setenv("BELTID_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "beltid"


def folder() -> Path:
    compiler.cache_folder.cache_clear()
    try:
        return compiler.cache_folder()
    finally:
        compiler.cache_folder.cache_clear()


@pytest.mark.parametrize(
    ("file", "another"),
    [("rig/belt.py", True), ("laws/penalty.py", True), ("rig/runs.py", False)],
)
def test_an_edit_of_a_source_with_kernels_opens_another_folder(
    rooms: Path, file: str, another: bool
) -> None:
    before = folder()
    with (rooms / file).open("a") as source:
        source.write("# edited\n")
    assert (folder() != before) is another


def test_who_starts_the_compilation_loads_no_compiler() -> None:
    code = "import sys, beltid.rig.compiler; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_nothing_is_started_for_a_folder_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("BELTID_CACHE_DIR", str(tmp_path / "file"))
    for cached in (compiler.cache_folder, compiler._writable):
        cached.cache_clear()
    try:
        assert not compiler.compile_ahead(["rig"])
    finally:
        for cached in (compiler.cache_folder, compiler._writable):
            cached.cache_clear()


def test_compiling_ahead_leaves_what_the_next_process_needs() -> None:
    """The kernels of this machine are there after the tests before: nothing is started."""
    from beltid.rig.first_call import compiled

    compiled()
    assert not compiler.compile_ahead(["rig"])
    assert any(compiler.cache_folder().rglob("*.nbi")) or not os.access(
        compiler.cache_folder(), os.W_OK
    )
