"""Read files in a child process, so that a damaged one cannot take this process with it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from beltid.bench.formats.bench_file import BenchFile, DamagedFile, FormatError
from beltid.bench.formats.isolated.child import REFUSED
from beltid.bench.formats.isolated.exchange import load

BASE_MEMORY: Final = 3 << 30
MEMORY_PER_BYTE: Final = 12
BASE_CPU_S: Final = 20
CPU_S_PER_MB: Final = 3
CRASHES: Final = 5


def read_isolated(jobs: Sequence[tuple[str, Path]]) -> list[BenchFile | FormatError]:
    """Read files in a child process with limits on memory and time.

    Parameters
    ----------
    jobs : sequence of (str, Path)
        Format, one of `sniff.ISOLATED`, and the file.

    Returns
    -------
    list
        For every file what was found in it, or why it cannot be read. After `CRASHES` files that
        end the child the others are not tried.
    """
    results: list[BenchFile | FormatError] = []
    crashes = 0
    while len(results) < len(jobs):
        if crashes == CRASHES:
            results += [FormatError("not tried after the damaged files")] * (
                len(jobs) - len(results)
            )
            break
        rest = jobs[len(results) :]
        read, ended = _one_child(rest)
        results += read
        if len(read) < len(rest):
            results.append(DamagedFile(ended))
            crashes += 1
    return results


def _one_child(jobs: Sequence[tuple[str, Path]]) -> tuple[list[BenchFile | FormatError], str]:
    """Results up to the file that ended the child, and how it ended."""
    size = max(path.stat().st_size for _, path in jobs)
    total = sum(path.stat().st_size for _, path in jobs)
    cpu_s = BASE_CPU_S + CPU_S_PER_MB * (total >> 20) + 2 * len(jobs)
    environment = {
        **os.environ,
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        "ARROW_IO_THREADS": "1",
    }
    with tempfile.TemporaryDirectory(prefix="beltid-") as folder:
        limits = [str(BASE_MEMORY + MEMORY_PER_BYTE * size), str(cpu_s)]
        # -P: nothing is imported from the folder of the recordings
        command = [
            sys.executable,
            "-P",
            "-m",
            "beltid.bench.formats.isolated.child",
            folder,
            *limits,
        ]
        asked = json.dumps([[name, str(path.absolute())] for name, path in jobs])
        try:
            status = subprocess.run(
                command,
                input=asked.encode(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=3 * cpu_s,
                env=environment,
                check=False,
            ).returncode
            ended = f"the reader of its format crashed on it (status {status})"
        except subprocess.TimeoutExpired:
            ended = f"the reader of its format did not end within {3 * cpu_s} s"
        results: list[BenchFile | FormatError] = []
        for number in range(len(jobs)):
            done = Path(folder, f"{number}.npz")
            refused = Path(folder, f"{number}.txt")
            if done.exists():
                results.append(load(done))
            elif refused.exists():
                results.append(_reason(refused.read_text(encoding="utf-8")))
            else:
                break
    return results, ended


def _reason(text: str) -> FormatError:
    if text.startswith(DamagedFile.mark):
        return DamagedFile(text.removeprefix(DamagedFile.mark))
    return FormatError(text.removeprefix(REFUSED))
