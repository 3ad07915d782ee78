"""The command as the shell sees it: pipes, terminals, signals, exit statuses."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

BELTID = (sys.executable, "-m", "beltid")


def environment(**settings: str) -> dict[str, str]:
    inherited = {k: v for k, v in os.environ.items() if k not in ("BELTID_CONFIG", "COLUMNS")}
    return {**inherited, **settings}


def run(folder: Path, *arguments: str, **settings: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [*BELTID, *arguments],
        cwd=folder,
        capture_output=True,
        env=environment(**settings),
        check=False,
        timeout=60,
    )


@pytest.fixture
def beside(recordings: Path, tmp_path: Path) -> Path:
    """The recording that is worked on fastest, alone in a folder."""
    shutil.copy(recordings / "speedloss.csv", tmp_path)
    return tmp_path


def test_same_input_same_bytes_in_another_process_and_folder(
    finished: Path, recordings: Path, tmp_path: Path
) -> None:
    for name in ("rig.csv", "beltid.yaml"):
        shutil.copy(recordings / name, tmp_path)
    done = run(tmp_path, "fit-friction", "rig.csv", "--json", PYTHONHASHSEED="7", TZ="Asia/Tokyo")
    assert done.returncode == 0
    made = (tmp_path / "friction.parquet").read_bytes()
    assert made == (finished / "friction.parquet").read_bytes()


@pytest.mark.parametrize("named", ["speedloss.csv", "absolute"])
def test_a_working_folder_that_was_deleted(beside: Path, named: str) -> None:
    gone = beside / "gone"
    gone.mkdir()
    file = str(beside / "speedloss.csv") if named == "absolute" else named
    call = f"import os, sys; os.rmdir({str(gone)!r}); sys.argv[1:] = ['fit-slip', {file!r}]"
    done = subprocess.run(
        [sys.executable, "-c", f"{call}; from beltid.cli import main; main()"],
        cwd=gone,
        capture_output=True,
        env=environment(),
    )
    assert b"Traceback" not in done.stderr
    if named == "absolute":
        assert done.returncode == 0
        assert (beside / "slip.parquet").is_file()
    else:
        assert done.returncode == 2
        assert b"working folder" in done.stderr


def test_a_terminal_without_the_letters_gets_substitutes(beside: Path) -> None:
    done = run(beside, "config", "show", "--all", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()


def small_files_only() -> None:
    """In a new process: no file becomes larger than 2 kB, as on a disk that is nearly full."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))


def test_a_product_that_is_cut_short_on_stdout_is_an_error(tmp_path: Path) -> None:
    with (tmp_path / "shown.yaml").open("wb") as product:
        done = subprocess.run(
            [*BELTID, "config", "show", "--all"],
            cwd=tmp_path,
            stdout=product,
            stderr=subprocess.PIPE,
            env=environment(PYTHONUNBUFFERED=""),
            preexec_fn=small_files_only,
            check=False,
        )
    assert (tmp_path / "shown.yaml").stat().st_size <= 2048
    assert done.returncode == 2
    assert b"error: stdout: File too large" in done.stderr


def test_a_reader_that_has_seen_enough_is_no_error(recordings: Path, tmp_path: Path) -> None:
    shutil.copy(recordings / "speedloss.csv", tmp_path)
    process = subprocess.Popen(
        [*BELTID, "fit-slip", "speedloss.csv", "-v"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment(),
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    talk = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=60) == 0
    assert b"Traceback" not in talk
    assert b"Exception ignored" not in talk
    assert (tmp_path / "slip.parquet").is_file()


def test_a_bug_ends_with_a_traceback_and_status_1(tmp_path: Path) -> None:
    code = (
        "import beltid.config as config; "
        "config.config_text = lambda *a, **k: 1 / 0; "
        "from beltid.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "config", "show"],
        cwd=tmp_path,
        capture_output=True,
        env=environment(),
        check=False,
    )
    assert done.returncode == 1
    assert b"ZeroDivisionError" in done.stderr
    assert done.stdout == b""


needs_full_device = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")


@needs_full_device
def test_a_full_disk_behind_stderr_does_not_stop_the_work(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*BELTID, "config", "show", "--all"],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=full,
            env=environment(),
            check=False,
            timeout=60,
        )
    assert done.returncode == 0
    assert b"axial_stiffness_N" in done.stdout


@pytest.mark.parametrize(
    ("call", "closed"),
    [
        ("--help", ">&-"),
        ("fit-slip speedloss.csv", "<&- >&- 2>&-"),
    ],
)
def test_closed_streams_are_as_good_as_dev_null(beside: Path, call: str, closed: str) -> None:
    done = subprocess.run(
        ["sh", "-c", f'"{sys.executable}" -m beltid {call} {closed}'],
        cwd=beside,
        capture_output=True,
        env=environment(),
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stdout) == (0, b"")
    assert b"Traceback" not in done.stderr
    assert (beside / "slip.parquet").is_file() is call.endswith(".csv")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads as Linux does")
@pytest.mark.parametrize(("stated", "threads"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2)])
def test_the_linear_algebra_of_a_command_runs_in_one_thread(
    stated: dict[str, str], threads: int
) -> None:
    """Its matrices are so small that threads cost more than they do; who states more gets them."""
    code = (
        "import os, sys; from beltid.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "import numpy; a = numpy.ones((500, 500)); a @ a\n"
        "print(len(os.listdir('/proc/self/task')))"
    )
    free = {name: v for name, v in environment().items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-c", code, "--version"], capture_output=True, env={**free, **stated}
    )
    assert int(done.stdout.splitlines()[-1]) == min(threads, len(os.sched_getaffinity(0)))
