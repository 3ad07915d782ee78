"""Faults done for real, and what they lost: kills, full disks, two at once, flipped bits.

    python -m benchmarks.faults [--quick]

A fault counts as survived if every result in the folder is afterwards the old one or the new one,
whole, and the next run makes the rest; else as lost, and the exit status is 1.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from beltid.errors import EXIT_DONE, EXIT_INPUT, EXIT_OUT_OF_TOLERANCE, ArtifactError
from beltid.store.artifact import Record, artifact_bytes, artifact_from_bytes, read_artifact
from beltid.store.disk import write_bytes
from beltid.store.parquet import seal
from beltid.tables import schemas
from benchmarks import table

ROOT = Path(__file__).parents[1]
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
STIFFNESSES = (0.01, 0.02)
Losses = Iterator[str]
"""What each fault of a kind lost; empty where it was survived."""


def example(rows: int, seed: int) -> bytes:
    """An artifact of some size."""
    rng = np.random.default_rng(seed)
    names = [column.name for column in schemas.table("slip").columns if column.required]
    return artifact_bytes({n: rng.uniform(1.0, 2.0, rows) for n in names}, Record("slip"))


def kills_of_a_writer(count: int, folder: Path) -> Losses:
    """A process that writes one artifact over the other is killed at a random moment."""
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
        yield "" if path.read_bytes() in versions else "neither the old nor the new file"
    write_bytes(path, versions[1])
    yield "" if path.read_bytes() == versions[1] else "a file left by a killed writer hinders"


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """A file system of 192 KiB: only root may make one."""
    mount = ["mount", "-t", "tmpfs", "-o", "size=192k", "none", str(folder)]
    subprocess.run(mount, check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def full_disk(count: int, folder: Path) -> Losses:
    """Artifacts of all sizes on a disk that is full at another byte each time."""
    with small_disk(folder) as place:
        path, filler = place / "slip.parquet", place / "filler"
        old, new = example(200, 1), example(1_500, 2)
        for k in range(count):
            filler.unlink(missing_ok=True)
            write_bytes(path, old)
            disk = os.statvfs(place)
            size = disk.f_bavail * disk.f_bsize - int(len(new) * k / count)
            filler.write_bytes(b"x" * max(size, 0))
            yield replaced_or_kept(path, old, new)


def replaced_or_kept(path: Path, old: bytes, new: bytes) -> str:
    """Write an artifact over another; say what is wrong with the outcome."""
    try:
        write_bytes(path, new)
    except ArtifactError:
        whole = path.read_bytes() == old
        left = [p.name for p in path.parent.iterdir() if p.name.endswith(".beltid-tmp")]
        return "" if whole and not left else f"the old file is not whole, or {left} stays"
    return "" if path.read_bytes() == new else "no error, and not the new file"


def flipped_bits(count: int, folder: Path) -> Losses:
    """Bits of real artifacts flipped one at a time, anywhere in the file."""
    truth_of(STIFFNESSES[0], folder)
    files = {path: path.read_bytes() for path in sorted(folder.rglob("*.parquet"))}
    truth = {path: seal(b"", read_artifact(path).columns) for path in files}
    rng = random.Random(2)
    for _ in range(count):
        path = rng.choice(list(files))
        damaged = bytearray(files[path])
        place, bit = rng.randrange(len(damaged)), rng.randrange(8)
        damaged[place] ^= 1 << bit
        try:
            read = artifact_from_bytes(bytes(damaged), path)
        except ArtifactError:
            yield ""
            continue
        same = seal(b"", read.columns) == truth[path]
        yield "" if same else f"{path.name}: other numbers, byte {place} bit {bit}"


def started(stiffness: float, runs: Path) -> subprocess.Popen[bytes]:
    """A run of the chain in a process group of its own, with a given bending stiffness."""
    path = runs.with_name(f"belt-{stiffness:g}.yaml")
    path.write_text(CONFIG.format(stiffness=stiffness, data=ROOT / "rigdata" / "5pk"))
    return subprocess.Popen(
        [sys.executable, "-m", "beltid", "run", str(path), "-o", str(runs), "--no-report"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        start_new_session=True,
    )


def results(runs: Path) -> dict[str, bytes]:
    """Hash of the numbers of every artifact of a folder by its name.

    Not of its bytes: what two configs have in common names the one that it was made with.
    """
    files = (runs / "belt").glob("*.parquet")
    return {path.name: seal(b"", read_artifact(path).columns) for path in files}


def truth_of(stiffness: float, folder: Path) -> dict[str, bytes]:
    """Results of an undisturbed run; a part of the runs is simulated, compare says so."""
    runs = folder / f"truth-{stiffness:g}"
    if started(stiffness, runs).wait() not in (EXIT_DONE, EXIT_OUT_OF_TOLERANCE):
        raise SystemExit("the undisturbed run failed")
    return results(runs)


def lost(stiffness: float, runs: Path, truth: dict[str, bytes]) -> str:
    """Read what stands, and run the chain once more: the results are those undisturbed."""
    try:
        results(runs)
    except ArtifactError as error:
        return str(error)
    if started(stiffness, runs).wait() not in (EXIT_DONE, EXIT_OUT_OF_TOLERANCE):
        return "the next run failed"
    return "" if results(runs) == truth else "not the results of an undisturbed run"


def kills_of_the_chain(count: int, folder: Path) -> Losses:
    """Configs alternate."""
    truth = [truth_of(stiffness, folder) for stiffness in STIFFNESSES]
    runs, rng = folder / "killed", random.Random(3)
    for k in range(count):
        stiffness = STIFFNESSES[k % 2]
        process = started(stiffness, runs)
        time.sleep(rng.uniform(0.5, 5.0))
        with suppress(ProcessLookupError):  # it was faster
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        yield lost(stiffness, runs, truth[k % 2])


def two_at_once(count: int, folder: Path) -> Losses:
    """There is no lock: what the other run has changed is refused by its content."""
    truth = truth_of(STIFFNESSES[0], folder)
    for k in range(count):
        runs = folder / f"two-{k}"
        states = {process.wait() for process in [started(s, runs) for s in STIFFNESSES]}
        unlike = states - {EXIT_DONE, EXIT_OUT_OF_TOLERANCE, EXIT_INPUT}
        yield f"status {unlike}" if unlike else lost(STIFFNESSES[0], runs, truth)


FAULTS = {
    "writer of an artifact killed (SIGKILL) at a random moment": (kills_of_a_writer, 200),
    "disk full (a file system of 192 KiB) while an artifact is written": (full_disk, 200),
    "one bit of an artifact flipped, and the artifact read": (flipped_bits, 2000),
    "`beltid run` with its workers killed (SIGKILL), then run again": (kills_of_the_chain, 30),
    "two `beltid run` of different configs on one folder at the same time": (two_at_once, 5),
}


def main() -> int:
    """Do all faults, print the table, and fail if anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the faults")
    share = 0.1 if parser.parse_args().quick else 1.0
    rows, found = [], 0
    for name, (fault, count) in FAULTS.items():
        with tempfile.TemporaryDirectory(prefix="beltid-faults-") as folder:
            losses = list(fault(max(1, round(share * count)), Path(folder)))
        told = [loss for loss in losses if loss]
        print(f"{name}: {len(losses)} tried", *told[:5], sep="\n  ", flush=True)
        rows.append((name, f"{len(losses):,}", str(len(told))))
        found += len(told)
    print(table(("fault", "tried", "lost"), rows))
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
