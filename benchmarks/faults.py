"""Faults done for real, and what they lost: kills, full disks, locked folders, two at once, flips.

    python -m benchmarks.faults [--quick]

Writes docs/faults.md. A fault counts as survived if every result in the folder is afterwards the
old one or the new one, whole, and the next run makes the rest; else as lost.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from beltid.errors import EXIT_DONE, EXIT_INPUT, EXIT_OUT_OF_TOLERANCE, ArtifactError
from beltid.store.artifact import Record, artifact_bytes, artifact_from_bytes, read_artifact
from beltid.store.disk import write_bytes
from beltid.store.parquet import columns_sha256
from beltid.tables import schemas

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "docs" / "faults.md"
BELTID = (sys.executable, "-m", "beltid")
CONFIG = """\
belt: {{name: belt, bending_stiffness_N_m2: {stiffness}}}
rig:
  arcs_deg: [40, 68, 82]
  initial_tensions_N: [100, 220, 310, 411]
  pulley_speeds_rad_s: [0.05, 0.42]
simulation: {{method: steady, elements: 20}}
compare: {{max_rms_relative_error: 0.2, max_mean_relative_error: 0.2, max_relative_error: 0.9}}
data: {{press: {data}/press.csv, rig: {data}/rig.csv, speedloss: {data}/speedloss.csv}}
"""


@dataclass(slots=True)
class Row:
    """One kind of fault.

    Attributes
    ----------
    fault : str
        What was done.
    tried, survived : int
        How often, and how often nothing was lost.
    losses : list of str
        What was lost.
    """

    fault: str
    tried: int = 0
    survived: int = 0
    losses: list[str] = field(default_factory=list)

    def note(self, loss: str) -> None:
        """Count a fault; `loss` is empty where it was survived."""
        self.tried += 1
        if loss:
            self.losses.append(loss)
        else:
            self.survived += 1


# --- one file -----------------------------------------------------------------------------------


def example(rows: int, seed: int) -> bytes:
    """An artifact of some size."""
    rng = np.random.default_rng(seed)
    names = [column.name for column in schemas.table("slip").columns if column.required]
    return artifact_bytes({n: rng.uniform(1.0, 2.0, rows) for n in names}, Record("slip"))


def kills_of_a_writer(count: int, folder: Path) -> Row:
    """A process that writes one artifact over the other is killed at a random moment."""
    row = Row("writer of an artifact killed (SIGKILL) at a random moment")
    versions = (example(2_000, 1), example(2_000, 2))
    path = folder / "slip.parquet"
    write_bytes(path, versions[0])
    rng = random.Random(1)
    for _ in range(count):
        child = os.fork()
        if child == 0:
            while True:
                for data in versions:
                    write_bytes(path, data)
        time.sleep(rng.uniform(0.0, 0.03))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        row.note("" if path.read_bytes() in versions else "neither the old nor the new file")
    write_bytes(path, versions[1])
    if [p.name for p in folder.iterdir()] != [path.name]:
        row.note("temporary files stay")
    return row


@contextmanager
def small_disk(folder: Path) -> Iterator[Path | None]:
    """A file system of 192 KiB, where this user may make one."""
    place = folder / "small"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=192k", "none", str(place)]
    made = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    try:
        yield place if made else None
    finally:
        if made:
            subprocess.run(["umount", "-l", str(place)], check=False)


def full_disk(count: int, folder: Path) -> Row:
    """Artifacts of all sizes on a disk that is full at another byte each time."""
    with small_disk(folder) as place:
        if place is None:
            return _limited_size(count, folder)
        row = Row("disk full (a file system of 192 KiB) while an artifact is written")
        path, filler = place / "slip.parquet", place / "filler"
        old, new = example(200, 1), example(1_500, 2)
        for k in range(count):
            filler.unlink(missing_ok=True)
            write_bytes(path, old)
            room = int(len(new) * k / count)
            with filler.open("wb") as file:
                disk = os.statvfs(place)
                fill(file.fileno(), disk.f_bavail * disk.f_bsize - room)
            row.note(replaced_or_kept(path, old, new))
    return row


def fill(descriptor: int, size: int) -> None:
    """Write until nothing more, or this much, fits."""
    try:
        while size > 0:
            size -= os.write(descriptor, b"x" * min(size, 4096))
    except OSError:
        pass


def replaced_or_kept(path: Path, old: bytes, new: bytes) -> str:
    """Write an artifact over another; say what is wrong with the outcome."""
    try:
        write_bytes(path, new)
    except ArtifactError:
        whole = path.read_bytes() == old
        left = [p.name for p in path.parent.iterdir() if p.name.endswith(".beltid-tmp")]
        return "" if whole and not left else f"the old file is not whole, or {left} stays"
    return "" if path.read_bytes() == new else "no error, and not the new file"


def _limited_size(count: int, folder: Path) -> Row:
    """The same by a limit of the size of files, where no file system can be made."""
    row = Row("file size limit (RLIMIT_FSIZE) reached while an artifact is written")
    path = folder / "limited.parquet"
    old, new = example(200, 1), example(1_500, 2)
    for k in range(count):
        write_bytes(path, old)
        child = os.fork()
        if child == 0:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            size = int(len(new) * k / count)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
            os._exit(bool(replaced_or_kept(path, old, new)))
        row.note("lost" if os.waitpid(child, 0)[1] else "")
    return row


def read_only_folder(folder: Path) -> Row:
    """A user without the right to write in the folder of the results."""
    row = Row("folder of the results is read-only")
    place = folder / "locked"
    place.mkdir()
    path = place / "slip.parquet"
    old, new = example(200, 1), example(200, 2)
    write_bytes(path, old)
    place.chmod(0o555)
    for parent in (place, *place.parents):
        if parent == Path(tempfile.gettempdir()):
            break
        parent.chmod(parent.stat().st_mode | 0o055)
    child = os.fork()
    if child == 0:
        if os.geteuid() == 0:  # root may write anywhere
            os.setgid(65534)
            os.setuid(65534)
        os._exit(bool(replaced_or_kept(path, old, new)) or path.read_bytes() != old)
    row.note("written, or half" if os.waitpid(child, 0)[1] else "")
    place.chmod(0o755)
    return row


def flipped_bits(count: int, runs: Path) -> Row:
    """Bits of real artifacts flipped one at a time, anywhere in the file."""
    row = Row("one bit of an artifact flipped, and the artifact read")
    files = {path: path.read_bytes() for path in sorted(runs.rglob("*.parquet"))}
    truth = {path: columns_sha256(read_artifact(path).columns) for path in files}
    rng = random.Random(2)
    for _ in range(count):
        path = rng.choice(list(files))
        damaged = bytearray(files[path])
        place, bit = rng.randrange(len(damaged)), rng.randrange(8)
        damaged[place] ^= 1 << bit
        try:
            read = artifact_from_bytes(bytes(damaged), path)
        except ArtifactError:
            row.note("")
            continue
        same = columns_sha256(read.columns) == truth[path]
        row.note("" if same else f"{path.name}: other numbers, byte {place} bit {bit}")
    return row


# --- whole chains -------------------------------------------------------------------------------


def config(folder: Path, stiffness: float) -> Path:
    """A config with a given bending stiffness."""
    path = folder / f"belt-{stiffness:g}.yaml"
    path.write_text(CONFIG.format(stiffness=stiffness, data=ROOT / "rigdata" / "5pk"))
    return path


def started(path: Path, runs: Path) -> subprocess.Popen[bytes]:
    """A run of the chain in a process group of its own."""
    return subprocess.Popen(
        [*BELTID, "run", str(path), "-o", str(runs), "--no-report"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        start_new_session=True,
    )


def failed(process: subprocess.Popen[bytes]) -> bool:
    """Wait for a run; whether it failed. A part of the runs is simulated, compare says so."""
    return process.wait() not in (EXIT_DONE, EXIT_OUT_OF_TOLERANCE)


def results(runs: Path) -> dict[str, str]:
    """Hash of the numbers of every artifact of a folder by its name.

    Not of its bytes: what two configs have in common names the one that it was made with.
    """
    return {
        path.name: columns_sha256(read_artifact(path).columns)
        for path in (runs / "belt").glob("*.parquet")
    }


def broken(runs: Path) -> str:
    """What is not whole in a folder of results."""
    for path in (runs / "belt").glob("*.parquet"):
        try:
            read_artifact(path)
        except ArtifactError as error:
            return str(error)
    return ""


def repaired(path: Path, runs: Path, truth: dict[str, str]) -> str:
    """Run the chain once more: all results must be those of an undisturbed run."""
    status = failed(started(path, runs))
    left = [p.name for p in (runs / "belt").iterdir() if p.name.endswith(".beltid-tmp")]
    if status or left:
        return f"failed: {status}, left over {left}"
    return "" if results(runs) == truth else "not the results of an undisturbed run"


def kills_of_the_chain(count: int, folder: Path, truth: Callable[[float], dict[str, str]]) -> Row:
    """`beltid run` and its workers killed at a random moment, then run again; configs alternate."""
    row = Row("`beltid run` with its workers killed (SIGKILL) at a random moment, then run again")
    runs, rng = folder / "killed", random.Random(3)
    for k in range(count):
        stiffness = (0.01, 0.02)[k % 2]
        process = started(config(folder, stiffness), runs)
        time.sleep(rng.uniform(0.5, 5.0))
        with suppress(ProcessLookupError):  # it was faster
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        loss = broken(runs) if (runs / "belt").is_dir() else ""
        row.note(loss or repaired(config(folder, stiffness), runs, truth(stiffness)))
    return row


def two_at_once(count: int, folder: Path, truth: Callable[[float], dict[str, str]]) -> Row:
    """Two runs with different configs on one folder at the same time."""
    row = Row("two `beltid run` of different configs on one folder at the same time")
    for k in range(count):
        runs = folder / f"two-{k}"
        paths = config(folder, 0.01), config(folder, 0.02)
        states = {process.wait() for process in [started(path, runs) for path in paths]}
        # there is no lock: what the other run has changed is refused by its content
        unlike = states - {EXIT_DONE, EXIT_OUT_OF_TOLERANCE, EXIT_INPUT}
        loss = broken(runs) or (f"status {unlike}" if unlike else "")
        row.note(loss or repaired(paths[0], runs, truth(0.01)))
    return row


# --- the table ----------------------------------------------------------------------------------


def all_faults(folder: Path, quick: bool) -> Iterator[Row]:
    """Every fault, the cheap ones first."""
    share = 0.1 if quick else 1.0
    known: dict[float, dict[str, str]] = {}

    def truth(stiffness: float) -> dict[str, str]:
        if stiffness not in known:
            runs = folder / f"truth-{stiffness:g}"
            if failed(started(config(folder, stiffness), runs)):
                raise SystemExit("the undisturbed run failed")
            known[stiffness] = results(runs)
        return known[stiffness]

    (folder / "writer").mkdir()
    yield kills_of_a_writer(round(200 * share), folder / "writer")
    yield full_disk(round(200 * share), folder)
    yield read_only_folder(folder)
    truth(0.02)
    yield flipped_bits(round(2000 * share), folder / "truth-0.02")
    yield kills_of_the_chain(round(30 * share), folder, truth)
    yield two_at_once(max(1, round(5 * share)), folder, truth)


def text_of(rows: list[Row], quick: bool) -> str:
    """The page with the table."""
    lines = [
        "# Faults",
        "",
        "`make verify` (`python -m benchmarks.faults`) causes these faults. After each, every",
        "result must be either the old one or the new one, complete, and the next run must compute "
        "the rest.",
        "",
        "| fault | tried | survived | lost |",
        "|---|---:|---:|---:|",
        *(f"| {r.fault} | {r.tried:,} | {r.survived:,} | {len(r.losses)} |" for r in rows),
        "",
        f"Lost in all: {sum(len(row.losses) for row in rows)}.",
    ]
    if quick:
        lines += ["", "A quick pass: a tenth of the usual number."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Do all faults, write the table, and fail if anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the faults, no page")
    quick = parser.parse_args().quick
    folder = Path(tempfile.mkdtemp(prefix="beltid-faults-"))
    rows = []
    try:
        for row in all_faults(folder, quick):
            rows.append(row)
            print(f"{row.fault}: {row.survived} of {row.tried}", *row.losses[:5], sep="\n  ")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    text = text_of(rows, quick)
    print(text)
    if not quick:
        TABLE.write_text(text)
    sys.exit(any(row.losses for row in rows))


if __name__ == "__main__":
    main()
