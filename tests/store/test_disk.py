"""A file appears whole or not at all, and a failure leaves the earlier one untouched."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from beltid.errors import ArtifactError
from beltid.store.disk import STALE_AFTER_S, write_bytes, write_text


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_folders_are_made_and_files_replaced(tmp_path):
    path = tmp_path / "runs" / "5pk" / "x.bin"
    write_bytes(path, b"one")
    write_bytes(str(path), b"two")
    assert path.read_bytes() == b"two"
    assert names(path.parent) == ["x.bin"]
    write_text(path, "µ\n")
    assert path.read_bytes() == "µ\n".encode()


def test_the_mode_is_that_of_the_user(tmp_path):
    old = os.umask(0o027)
    try:
        write_bytes(tmp_path / "x", b"")
    finally:
        os.umask(old)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("broken", ["fsync", "replace", "open"])
@pytest.mark.parametrize(
    ("number", "words"),
    [(errno.ENOSPC, "No space left on device"), (errno.EACCES, "no permission to write in")],
)
def test_a_failure_leaves_the_earlier_file(tmp_path, monkeypatch, broken, number, words):
    path = tmp_path / "x.parquet"
    path.write_bytes(b"earlier")

    def fail(*args: object, **kwargs: object) -> None:
        raise OSError(number, os.strerror(number), str(path))

    monkeypatch.setattr(os, broken, fail)
    with pytest.raises(ArtifactError) as caught:
        write_bytes(path, b"new")
    monkeypatch.undo()
    assert words in str(caught.value)
    assert str(caught.value).endswith("; the file that was there is untouched")
    assert path.read_bytes() == b"earlier"
    assert names(tmp_path) == ["x.parquet"]


def test_an_interrupt_leaves_nothing_behind(tmp_path, monkeypatch):
    def interrupt(descriptor: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(tmp_path / "x", b"new")
    assert names(tmp_path) == []


def test_a_full_disk_for_real(tmp_path):
    """The system refuses the bytes after the first 4096."""
    path = tmp_path / "x.bin"
    path.write_bytes(b"earlier")
    code = (
        "import resource, signal, sys\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "from beltid.errors import ArtifactError\n"
        "from beltid.store.disk import write_bytes\n"
        "try:\n    write_bytes(sys.argv[1], b'x' * 100_000)\n"
        "except ArtifactError as error:\n    print(error)\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    assert "not written: File too large; the file that was there is untouched" in run.stdout
    assert path.read_bytes() == b"earlier"
    assert names(tmp_path) == ["x.bin"]


def test_a_killed_writer_leaves_no_half_file_and_its_rest_is_removed(tmp_path):
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
    assert names(tmp_path) == ["x.bin"]


def test_only_stale_files_of_this_name_are_removed(tmp_path):
    old = time.time() - 2 * STALE_AFTER_S
    mine = f"x.bin.otherhost-{os.getpid()}-0123abcd.beltid-tmp"
    kept = [f".y{mine}", ".x.bin.swp", ".x.bin.tmp", f".{mine.replace('0123', '4567')}"]
    for name in [f".{mine}", *kept]:
        (tmp_path / name).write_bytes(b"")
        os.utime(tmp_path / name, (old, old))
    os.utime(tmp_path / kept[-1])  # young, of another machine: its writer may be at work
    write_bytes(tmp_path / "x.bin", b"")
    assert names(tmp_path) == sorted(["x.bin", *kept])


def test_a_link_keeps_pointing_where_it_points(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_bytes(b"earlier")
    link.symlink_to(target)
    write_bytes(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda p: (p / "x").mkdir(), "this is a folder, name a file in it"),
        (lambda p: os.mkfifo(p / "x"), "this is not an ordinary file"),
        (lambda p: (p / "x").symlink_to("/dev/null"), "this is not an ordinary file"),
        (lambda p: (p / "x").symlink_to("x"), "a symbolic link that leads back to itself"),
    ],
)
def test_places_that_take_no_file(tmp_path, make, words):
    make(tmp_path)
    with pytest.raises(ArtifactError, match=words):
        write_bytes(tmp_path / "x", b"new")


def test_a_file_where_a_folder_is_needed(tmp_path):
    (tmp_path / "runs").write_bytes(b"")
    with pytest.raises(ArtifactError, match=r"not written: .*runs is a file, not a folder"):
        write_bytes(tmp_path / "runs" / "x", b"new")
    with pytest.raises(ArtifactError, match="not written"):
        write_bytes(tmp_path / ("n" * 300), b"new")
    with pytest.raises(ArtifactError, match="not written"):
        write_bytes(str(tmp_path) + "/a\0b", b"new")
