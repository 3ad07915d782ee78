"""Big recordings: time of fit-friction over that of pyarrow reading the same file, peak memory.

``python -m benchmarks.streaming [--megabytes N]``. The recordings are synthetic.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ARCS_DEG = (40, 68, 82)
TENSIONS_N = (50, 100, 160, 220, 270, 310, 360, 411)
SPEEDS_RAD_S = (0.05, 0.10, 0.21, 0.42, 0.84)
ROUNDS = 3


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


def read_time_s(path: Path) -> float:
    """Time in which pyarrow alone reads a file, both with all cores.

    In a process of its own: the memory of this one would count as that of the programs it starts.
    """
    call = [sys.executable, "-c", READ, str(path)]
    return float(subprocess.run(call, check=True, capture_output=True, text=True).stdout)


def command_cost(*arguments: str) -> tuple[float, float]:
    """Time [s] of a call of the program, and the most memory [MB] of it or one of its workers."""
    start = time.perf_counter()
    program = subprocess.Popen(
        [sys.executable, "-m", "beltid", *arguments], stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(program.pid, 0)
    program.returncode = os.waitstatus_to_exitcode(status)
    if program.returncode:
        raise RuntimeError(f"beltid {' '.join(arguments)}: exit status {program.returncode}")
    return time.perf_counter() - start, usage.ru_maxrss / 1e3


def measure(kind: str, megabytes: float, samples_per_run: int) -> Streamed:
    """Write a recording, read it with pyarrow, reduce it with beltid."""
    runs = max(3, round(megabytes * 1e6 / (51.0 * samples_per_run)))
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
    size = parser.parse_args().megabytes
    print(f"{os.cpu_count()} cores; synthetic recordings")
    print(table_of(measure_streaming(size)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
