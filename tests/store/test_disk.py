"""A file appears whole or not at all, and a failure leaves the earlier one untouched."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from beltid.errors import ArtifactError, InputError
from beltid.store.disk import OURS, check_place, write_bytes


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_folders_are_made_files_replaced_and_links_followed(tmp_path: Path) -> None:
    path, link = tmp_path / "runs" / "5pk" / "x.bin", tmp_path / "link"
    write_bytes(path, b"one")
    link.symlink_to(path)
    write_bytes(str(link), "µ\n".encode())
    assert path.read_bytes() == "µ\n".encode()
    assert link.is_symlink()
    assert names(path.parent) == ["x.bin"]


@pytest.mark.parametrize("broken", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "no space"), KeyboardInterrupt()])
def test_a_failure_leaves_the_earlier_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: str, error: BaseException
) -> None:
    path = tmp_path / "x.parquet"
    path.write_bytes(b"earlier")

    def fail(*args: object) -> None:
        raise error

    monkeypatch.setattr(os, broken, fail)
    with pytest.raises((ArtifactError, KeyboardInterrupt)):
        write_bytes(path, b"new")
    monkeypatch.undo()
    assert path.read_bytes() == b"earlier"
    assert names(tmp_path) == ["x.parquet"]


def test_a_killed_writer_leaves_no_half_file(tmp_path: Path) -> None:
    path = tmp_path / "x.bin"
    path.write_bytes(b"earlier")
    code = (
        "import os, signal, sys\n"
        "from beltid.store import disk\n"
        "os.fsync = lambda d: os.kill(os.getpid(), signal.SIGKILL)\n"
        "disk.write_bytes(sys.argv[1], b'new')\n"
    )
    run = subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    assert run.returncode == -signal.SIGKILL
    assert path.read_bytes() == b"earlier"
    assert len(names(tmp_path)) == 2
    write_bytes(path, b"later")
    assert path.read_bytes() == b"later"


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda p: (p / "x").mkdir(), "x"),
        (lambda p: os.mkfifo(p / "x"), "x"),
        (lambda p: (p / "x").symlink_to("/dev/null"), "x"),
        (lambda p: (p / "x").symlink_to("x"), "x"),
        (lambda p: (p / "x").write_bytes(b""), "x/y"),
        (lambda p: None, "n" * 300),
    ],
)
def test_places_that_take_no_file(
    tmp_path: Path, make: Callable[[Path], object], name: str
) -> None:
    make(tmp_path)
    with pytest.raises(ArtifactError, match=name[:200]):
        write_bytes(tmp_path / name, b"new")


@pytest.mark.parametrize(
    ("name", "force", "allowed"),
    [
        ("new.csv", False, True),
        ("deep/er/new.csv", False, True),
        ("mine.csv", False, False),
        ("mine.csv", True, True),
        ("ours.csv", False, True),
        ("input.csv", True, False),
        ("linked.csv", True, False),
        ("new.txt", True, False),
        ("folder.csv", True, False),
        ("mine.csv/new.csv", True, False),
    ],
)
def test_what_may_stand_where(tmp_path: Path, name: str, force: bool, allowed: bool) -> None:
    for file in ("mine.csv", "ours.csv", "input.csv"):
        (tmp_path / file).write_bytes(b"")
    os.link(tmp_path / "input.csv", tmp_path / "linked.csv")
    (tmp_path / "folder.csv").mkdir()

    def check() -> None:
        check_place(
            tmp_path / name,
            (".csv",),
            lambda path: OURS if path.name == "ours.csv" else "mine",
            inputs={"input": tmp_path / "input.csv"},
            force=force,
        )

    if allowed:
        check()
    else:
        with pytest.raises(InputError, match=name):
            check()
