"""The command as the shell sees it: streams, signals, exit statuses."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

MAIN = "from beltid.cli import main; main()"
PROGRAM = """
import ctypes, os, signal, sys, time
from beltid.cli.execute import Common, finish, hear_signals
number = signal.Signals[sys.argv[1]]
signal.signal(number, signal.default_int_handler)
hear_signals()
def interrupt(*ignored):
    os.kill(os.getpid(), number)
    time.sleep(20.0)
    return 0
def work():
    {call}
    print("went on")
finish(work, Common())
"""
PLACES = {
    "plain code": "interrupt()",
    # ctypes prints and drops an exception that its callback raises
    "a callback of compiled code": "ctypes.CFUNCTYPE(ctypes.c_int)(interrupt)()",
    "code that takes every exception": (
        "exec('try:\\n interrupt()\\nexcept BaseException:\\n pass', globals())"
    ),
    "an import": (
        "sys.meta_path.insert(0, type('F', (), {'find_spec': interrupt})()); import no_such_module"
    ),
}


def python(code: str, *arguments: str, **settings: Any) -> subprocess.CompletedProcess[bytes]:
    """Run Python code in a process of its own, without a config of the user's."""
    inherited = {k: v for k, v in os.environ.items() if k not in ("BELTID_CONFIG", "COLUMNS")}
    settings = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "timeout": 60} | settings
    settings["env"] = inherited | settings.get("env", {})
    return subprocess.run([sys.executable, "-c", code, *arguments], check=False, **settings)


@pytest.mark.parametrize(
    ("place", "number", "word", "status"),
    [
        *((place, "SIGINT", "interrupted", 130) for place in PLACES),
        ("plain code", "SIGTERM", "terminated", 143),
        ("plain code", "SIGHUP", "hung up", 129),
    ],
)
def test_a_signal_ends_the_program_wherever_it_comes(
    place: str, number: str, word: str, status: int
) -> None:
    done = python(PROGRAM.replace("{call}", PLACES[place]), number)
    assert done.stderr.decode() == f"error: {word}; nothing was written\n"
    assert (done.returncode, done.stdout) == (status, b"")


def test_an_ignored_signal_stays_ignored() -> None:
    code = (
        "import os, signal; from beltid.cli.execute import hear_signals\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN); hear_signals()\n"
        "os.kill(os.getpid(), signal.SIGHUP); print('went on')"
    )
    assert python(code).stdout == b"went on\n"


def test_a_reader_that_has_seen_enough_is_no_error(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    done = python(MAIN, "config", "show", "--all", cwd=tmp_path, stdout=write)
    os.close(write)
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr
    assert b"Exception ignored" not in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize(("stream", "status"), [("stdout", 2), ("stderr", 0)])
def test_a_full_disk_behind_a_stream(tmp_path: Path, stream: str, status: int) -> None:
    with Path("/dev/full").open("w") as full:
        done = python(MAIN, "config", "show", "--all", cwd=tmp_path, **{stream: full})
    assert done.returncode == status
    assert b"error: stdout: " in done.stderr if status else b"axial_stiffness_N" in done.stdout


def test_without_streams_and_in_another_process_and_folder_the_bytes_are_the_same(
    finished: Path, tmp_path: Path
) -> None:
    for name in ("beltid.yaml", "speedloss.csv"):
        shutil.copy(finished / name, tmp_path)
    call = f'"{sys.executable}" -m beltid fit-slip speedloss.csv <&- >&- 2>&-'
    env = {k: v for k, v in os.environ.items() if k != "BELTID_CONFIG"}
    env |= {"PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    done = subprocess.run(
        ["sh", "-c", call], cwd=tmp_path, env=env, capture_output=True, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    assert (tmp_path / "slip.parquet").read_bytes() == (finished / "slip.parquet").read_bytes()


def test_a_bug_ends_with_a_traceback_and_status_1(tmp_path: Path) -> None:
    code = f"import beltid.config as config; config.config_text = lambda *a, **k: 1 / 0; {MAIN}"
    done = python(code, "config", "show", cwd=tmp_path)
    assert done.returncode == 1
    assert b"ZeroDivisionError" in done.stderr
    assert done.stdout == b""


def test_what_a_library_lacks_is_one_line(tmp_path: Path) -> None:
    """As matplotlib without any folder to write to: its error has a text alone."""
    code = "def fail(): raise OSError('set MPLCONFIGDIR')\n"
    code += "import beltid.cli.program as program; program.app = fail; program.main()"
    done = python(code, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, b"error: set MPLCONFIGDIR\n")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads as Linux does")
def test_the_linear_algebra_of_a_command_runs_in_one_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its matrices are so small that threads cost more than they do."""
    for name in [name for name in os.environ if name.endswith("_NUM_THREADS")]:
        monkeypatch.delenv(name)
    code = (
        "import os, sys; from beltid.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "import numpy; a = numpy.ones((500, 500)); a @ a\n"
        "print(len(os.listdir('/proc/self/task')))"
    )
    assert python(code, "--version").stdout.splitlines()[-1] == b"1"
