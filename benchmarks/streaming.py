"""Big recordings: time of fit-friction over that of pyarrow reading the same file, peak memory.

``python -m benchmarks.streaming [--megabytes N]`` prints the table of `make bench`;
``python -m benchmarks.streaming --gigabytes N`` takes a recording of N GB as CSV, the same as one
Parquet file and as a folder of Parquet files, and writes its table to HUGE_RECORDINGS.md. The
recordings are synthetic.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ARCS_DEG = (40, 68, 82)
TENSIONS_N = (50, 100, 160, 220, 270, 310, 360, 411)
SPEEDS_RAD_S = (0.05, 0.10, 0.21, 0.42, 0.84)
ROUNDS = 3
BYTES_PER_SAMPLE = 51.0
"""Of a row of the CSV file."""
HUGE_RUN = 1_000_000
"""Samples of a run of a huge recording."""
HUGE = Path(__file__).with_name("HUGE_RECORDINGS.md")
HUGE_HEAD = """# Huge recordings

Made by `python -m benchmarks.streaming --gigabytes 10`; {cores} cores. Synthetic recordings, each
reduced once. pyarrow reads them in blocks; fit-friction hashes them, reads them run by run, reduces
every run and writes the artifact; the time of an empty call is taken off. Peak: proportional set
sizes of the program and its workers together, looked at four times a second.

"""
LOOK_S = 0.25
"""Time between two looks at the memory of a program [s]."""


@dataclass(frozen=True, slots=True)
class Streamed:
    """One recording."""

    kind: str
    megabytes: float
    samples: int
    samples_per_run: int
    read_s: float
    """pyarrow alone."""
    reduced_s: float
    """beltid fit-friction, from the start of the process to its end, less that of an empty call."""
    peak_mb: float
    """Most memory of the program and its workers together, see `memory_mb`."""

    @property
    def ratio(self) -> float:
        return self.reduced_s / self.read_s


def write_recording(path: Path, runs: int, samples: int, seed: int = 0) -> None:
    """Synthetic runs of the friction rig: rest, sticking peak, sliding, correlated noise."""
    import pyarrow as pa
    import pyarrow.csv as pc
    import pyarrow.parquet as pq

    rng = np.random.default_rng(seed)
    time_s = np.linspace(0.0, 12.0, samples)
    since = np.clip(time_s - 1.0, 0.0, None)
    build_up = (1.0 - np.exp(-since / 0.1)) * (1.0 + 0.25 * np.exp(-since / 0.6))
    parquet = None
    with path.open("wb") as file:
        for run in range(runs):
            arc = ARCS_DEG[run % 3]
            tension = TENSIONS_N[run // 3 % 8]
            speed = SPEEDS_RAD_S[run // 24 % 5]
            mu = 0.5 * (tension / 200.0) ** -0.1
            half = tension * np.tanh(0.5 * mu * np.radians(arc) * build_up)
            noise = 0.5 * rng.standard_normal((2, samples))
            noise = 0.5 * (noise + np.roll(noise, 1, axis=1))
            turning = speed * (since > 0.0) + 1e-3 * rng.standard_normal(samples)
            table = pa.table(
                {
                    "run": pa.array(np.full(samples, f"r{run:05d}")),
                    "time_s": np.round(time_s, 6),
                    "tension_tight_N": np.round(tension + half + noise[0], 3),
                    "tension_slack_N": np.round(tension - half + noise[1], 3),
                    "pulley_speed_rad_s": np.round(turning, 5),
                    "temperature_degC": np.full(samples, 22.5),
                    "arc_deg": np.full(samples, float(arc)),
                    "initial_tension_N": np.full(samples, float(tension)),
                }
            )
            if path.suffix == ".csv":
                options = pc.WriteOptions(include_header=run == 0, quoting_style="none")
                pc.write_csv(table, file, options)
            else:
                parquet = parquet or pq.ParquetWriter(file, table.schema, write_page_checksum=True)
                parquet.write_table(table)
        if parquet is not None:
            parquet.close()


READ = """
import sys, time
import pyarrow.csv, pyarrow.parquet
start = time.perf_counter()
(pyarrow.csv.read_csv if sys.argv[1].endswith(".csv") else pyarrow.parquet.read_table)(sys.argv[1])
print(time.perf_counter() - start)
"""

READ_IN_BLOCKS = """
import pathlib, sys, time
import pyarrow.csv, pyarrow.parquet
start, path = time.perf_counter(), pathlib.Path(sys.argv[1])
if path.suffix == ".csv":
    for batch in pyarrow.csv.open_csv(path):
        pass
for file in sorted(path.rglob("*.parquet")) if path.is_dir() else [path]:
    if file.suffix == ".parquet":
        for batch in pyarrow.parquet.ParquetFile(file, pre_buffer=False).iter_batches():
            pass
print(time.perf_counter() - start)
"""


def all_cores() -> dict[str, str]:
    """The environment without what holds the other benchmarks to one core."""
    return {name: v for name, v in os.environ.items() if not name.endswith("_NUM_THREADS")}


def read_time_s(path: Path, program: str = READ) -> float:
    """Time in which pyarrow alone reads a file, both with all cores.

    In a process of its own: the memory of this one would count as that of the programs it starts.
    """
    call = [sys.executable, "-c", program, str(path)]
    done = subprocess.run(call, check=True, capture_output=True, text=True, env=all_cores())
    return float(done.stdout)


def memory_mb(process: int) -> float:
    """Memory of a process and of all that it has started: sum of the proportional set sizes [MB].

    A page that several of them share counts once, in parts. Linux alone tells it.
    """
    family, total = [process], 0.0
    for member in family:
        with contextlib.suppress(OSError):  # it may have ended
            for task in Path(f"/proc/{member}/task").iterdir():
                family += [int(child) for child in (task / "children").read_text().split()]
            for line in Path(f"/proc/{member}/smaps_rollup").read_text().splitlines():
                if line.startswith("Pss:"):
                    total += int(line.split()[1]) * 1.024e-3
    return total


def command_cost(*arguments: str) -> tuple[float, float]:
    """Time [s] of a call of the program, and the most memory [MB] of it and its workers."""
    start = time.perf_counter()
    program = subprocess.Popen(
        [sys.executable, "-m", "beltid", *arguments], stdout=subprocess.DEVNULL, env=all_cores()
    )
    looks, ended = [0.0], threading.Event()

    def look() -> None:
        while not ended.wait(LOOK_S):
            looks.append(memory_mb(program.pid))

    watcher = threading.Thread(target=look)
    watcher.start()
    status = program.wait()
    spent = time.perf_counter() - start
    ended.set()
    watcher.join()
    if status:
        raise RuntimeError(f"beltid {' '.join(arguments)}: exit status {status}")
    return spent, max(looks)


def measure(kind: str, megabytes: float, samples_per_run: int) -> Streamed:
    """Write a recording, read it with pyarrow, reduce it with beltid."""
    runs = max(3, round(megabytes * 1e6 / (BYTES_PER_SAMPLE * samples_per_run)))
    with tempfile.TemporaryDirectory() as folder:
        path, small = Path(folder) / f"rig.{kind}", Path(folder) / "small.csv"
        write_recording(path, runs, samples_per_run)
        write_recording(small, 3, 200)
        out = str(Path(folder) / "friction.parquet")
        reading, reducing, empty, peaks = [], [], [], []
        for _ in range(ROUNDS):
            reading.append(read_time_s(path))
            spent, peak = command_cost("fit-friction", str(path), "-o", out, "-q", "--force")
            reducing.append(spent)
            peaks.append(peak)
            empty.append(command_cost("fit-friction", str(small), "-o", out, "-q", "--force")[0])
        return Streamed(
            kind,
            path.stat().st_size / 1e6,
            runs * samples_per_run,
            samples_per_run,
            min(reading),
            min(reducing) - min(empty),
            max(peaks),
        )


def measure_streaming(megabytes: float) -> list[Streamed]:
    """Long and very long runs as CSV, long ones as Parquet."""
    cases = [("csv", 100_000), ("csv", 1_000_000), ("parquet", 100_000)]
    return [measure(kind, megabytes, samples) for kind, samples in cases]


def huge_recordings(folder: Path, runs: int) -> Iterator[Path]:
    """A recording as CSV, as one Parquet file and as a folder; what is there is used again."""
    import pyarrow.parquet as pq

    for path in (folder / "rig.csv", folder / "rig.parquet"):
        if not path.exists():
            write_recording(path, runs, HUGE_RUN)
        yield path
    season = folder / "season"
    if not season.exists():
        file = pq.ParquetFile(path, pre_buffer=False)
        for group in range(file.num_row_groups):
            table = file.read_row_group(group)
            arc, run = (table[name][0].as_py() for name in ("arc_deg", "run"))
            part = season / f"arc_deg={arc:g}" / f"run={run}"
            part.mkdir(parents=True)
            pq.write_table(table.drop_columns(["arc_deg", "run"]), part / "0.parquet")
    yield season


def measure_huge(gigabytes: float, folder: Path) -> list[Streamed]:
    """One recording in all its forms, once each: pyarrow reads it in blocks, too."""
    runs = max(3, round(gigabytes * 1e9 / (BYTES_PER_SAMPLE * HUGE_RUN)))
    results = []
    small, out = folder / "small.csv", str(folder / "friction.parquet")
    write_recording(small, 3, 200)
    call = ("fit-friction", str(small), "-o", out, "-q", "--force")
    empty = min(command_cost(*call)[0] for _ in range(2))  # the first one may compile
    for path in huge_recordings(folder, runs):
        reading = read_time_s(path, READ_IN_BLOCKS)
        spent, peak = command_cost("fit-friction", str(path), "-o", out, "-q", "--force")
        files = path.rglob("*.parquet") if path.is_dir() else [path]
        size = sum(file.stat().st_size for file in files) / 1e6
        kind = path.suffix[1:] or "folder of parquet"
        results.append(
            Streamed(kind, size, runs * HUGE_RUN, HUGE_RUN, reading, spent - empty, peak)
        )
        print(results[-1], file=sys.stderr)
    return results


def table_of(results: list[Streamed]) -> str:
    """Markdown table of results."""
    head = (
        "recording",
        "MB",
        "samples",
        "samples a run",
        "pyarrow [s]",
        "fit-friction [s]",
        "ratio",
        "peak [MB]",
    )
    rows = [
        (
            r.kind,
            f"{r.megabytes:.0f}",
            f"{r.samples:.2g}",
            f"{r.samples_per_run:,}",
            f"{r.read_s:.2f}",
            f"{r.reduced_s:.2f}",
            f"{r.ratio:.2f}",
            f"{r.peak_mb:.0f}",
        )
        for r in results
    ]
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ["---"] * 8, *rows)) + "\n"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=1000.0, help="size of a CSV file")
    parser.add_argument("--gigabytes", type=float, help="size of the one huge recording")
    parser.add_argument("--folder", type=Path, help="where the huge ones are, or are written")
    sizes = parser.parse_args()
    if sizes.gigabytes is None:
        print(f"{os.cpu_count()} cores; synthetic recordings")
        print(table_of(measure_streaming(sizes.megabytes)))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        table = table_of(measure_huge(sizes.gigabytes, sizes.folder or Path(folder)))
    HUGE.write_text(HUGE_HEAD.format(cores=os.cpu_count()) + table, encoding="utf-8")
    print(table)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
