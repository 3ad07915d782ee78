"""Read files in a child process, so that a damaged file cannot crash this process.

The child receives a folder for its results and its limits as arguments, and the files as JSON on
stdin: a list of ``[format, path]``. For file number i it writes ``i.npz`` (arrays and JSON, never
pickled objects), or ``i.json`` with the reason of the failure.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.formats.bench_file import BenchFile, Channel, Field, Group
from beltid.errors import InputError

READERS: Final = {
    "tdms": "beltid.bench.formats.isolated.tdms",
    "mdf": "beltid.bench.formats.isolated.mdf",
    "mat": "beltid.bench.formats.isolated.matlab",
    "hdf5": "beltid.bench.formats.isolated.hdf5",
    "xlsx": "beltid.bench.formats.isolated.xlsx",
}
BASE_MEMORY: Final = 3 << 30
MEMORY_PER_BYTE: Final = 12
BASE_CPU_S: Final = 20
CPU_S_PER_MB: Final = 3
CRASHES: Final = 5
_META: Final = "meta"


def read_isolated(jobs: Sequence[tuple[str, Path]]) -> list[BenchFile | InputError]:
    """Read files in a child process with limits on memory and time.

    Parameters
    ----------
    jobs : sequence of (str, Path)
        Format, one of `sniff.ISOLATED`, and path of every file.

    Returns
    -------
    list
        Content of every file, or why it cannot be read. After `CRASHES` files that ended the
        child, the remaining ones are not tried.
    """
    results: list[BenchFile | InputError] = []
    crashes = 0
    while len(results) < len(jobs) and crashes < CRASHES:
        rest = jobs[len(results) :]
        read, failure = _one_child(rest)
        results += read
        if len(read) < len(rest):
            results.append(InputError(f"damaged: {failure}"))
            crashes += 1
    untried = InputError("not tried, because too many files before it are damaged")
    return results + [untried] * (len(jobs) - len(results))


@contextlib.contextmanager
def temporary_folder() -> Iterator[str]:
    """Create a temporary folder; `InputError` if no folder for temporary files is usable."""
    try:
        folder = tempfile.TemporaryDirectory(prefix="beltid-")
    except OSError as error:
        raise InputError(
            "TDMS, MDF, MATLAB, HDF5 and Excel files need a temporary folder: "
            f"{error.strerror or error}; name one that can be written as TMPDIR"
        ) from None
    with folder as name:
        yield name


def _one_child(jobs: Sequence[tuple[str, Path]]) -> tuple[list[BenchFile | InputError], str]:
    """Read files in one child; return the results up to a file that ended it, and how it ended."""
    sizes = [path.stat().st_size for _, path in jobs]
    memory = BASE_MEMORY + MEMORY_PER_BYTE * max(sizes)
    cpu_s = BASE_CPU_S + CPU_S_PER_MB * (sum(sizes) >> 20) + 2 * len(jobs)
    one_thread = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "ARROW_IO_THREADS")
    with temporary_folder() as folder:
        # -P: nothing is imported from the folder of the recordings
        command = [sys.executable, "-P", "-m", __name__, folder, str(memory), str(cpu_s)]
        request = json.dumps([[name, str(path.absolute())] for name, path in jobs])
        try:
            status = subprocess.run(
                command,
                input=request.encode(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=3 * cpu_s,
                env={**os.environ, **dict.fromkeys(one_thread, "1")},
                check=False,
            ).returncode
            failure = f"the reader of its format crashed on it (status {status})"
        except subprocess.TimeoutExpired:
            failure = f"the reader of its format did not finish within {3 * cpu_s} s"
        results: list[BenchFile | InputError] = []
        for number in range(len(jobs)):
            done, refused = (Path(folder, f"{number}.{ending}") for ending in ("npz", "json"))
            if done.exists():
                results.append(load(done))
            elif refused.exists():
                results.append(InputError(json.loads(refused.read_text(encoding="utf-8"))))
            else:
                break
    return results, failure


def read_format(format_name: str, path: Path) -> BenchFile:
    """Read one file with the reader of its format, in this process."""
    file: BenchFile = import_module(READERS[format_name]).read(path)
    return file


def read_all(folder: Path, jobs: Sequence[tuple[str, str]]) -> None:
    """Read the files one after the other; write a reason for each that cannot be read."""
    for number, (format_name, path) in enumerate(jobs):
        try:
            file = read_format(format_name, Path(path))
            if not file.groups:
                raise InputError("holds no channel with samples")
            save(file, folder / f"{number}.part")
            os.replace(folder / f"{number}.part", folder / f"{number}.npz")
        except InputError as error:
            reason = str(error)
        except ImportError as error:
            reason = f"the library that reads its format cannot be loaded: {error}"
        except MemoryError:
            reason = "damaged: it requests more memory than a file of its size can need"
        except Exception as error:  # a damaged file can raise nearly anything
            message = " ".join(str(error).split())[:160] or "unreadable"
            reason = f"damaged: {type(error).__name__}: {message}"
        else:
            continue
        (folder / f"{number}.json").write_text(json.dumps(reason), encoding="utf-8")


def limit(memory_bytes: int, cpu_s: int) -> None:
    """Limit memory and CPU time of this process, if the system supports it."""
    try:
        import resource
    except ImportError:  # Windows: the parent still enforces its timeout
        return
    for what, value in (
        (resource.RLIMIT_AS, memory_bytes),
        (resource.RLIMIT_CPU, cpu_s),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(what)[1]
        allowed = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(what, (allowed, hard))


def save(file: BenchFile, path: Path) -> None:
    """Write the content of a file; an array shared by several channels is written once."""
    arrays: dict[str, np.ndarray] = {}

    def as_json(value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return {field.name: getattr(value, field.name) for field in fields(value)}
        key = f"array {id(value)}"
        arrays[key] = _writable(value)
        return key

    meta = json.dumps(file, default=as_json)
    arrays[_META] = np.frombuffer(meta.encode(), dtype=np.uint8)
    with path.open("wb") as target:
        np.savez(target, **arrays)  # type: ignore[arg-type]


def load(path: Path) -> BenchFile:
    """Load a content written by `save`."""
    with np.load(path, allow_pickle=False) as arrays:
        meta = json.loads(arrays[_META].tobytes())
        by_key = {key: _readable(arrays[key]) for key in arrays.files if key != _META}
    groups = tuple(
        Group(
            group["name"],
            tuple(
                Channel(
                    c["name"], c["unit"], by_key[c["values"]], by_key.get(c["time_s"]), c["scaling"]
                )
                for c in group["channels"]
            ),
            tuple(Field(**field) for field in group["fields"]),
            group["first_row"],
        )
        for group in meta["groups"]
    )
    header = tuple(Field(**field) for field in meta["fields"])
    return BenchFile(meta["format"], groups, header, tuple(meta["notes"]))


def _writable(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind == "O":
        return np.array(["" if v is None else str(v) for v in values], dtype=np.str_)
    return np.asarray(values, dtype=float)


def _readable(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind != "U":
        return values
    texts = np.empty(len(values), dtype=object)
    texts[:] = [str(v) or None for v in values]
    return texts


if __name__ == "__main__":
    limit(int(sys.argv[2]), int(sys.argv[3]))
    warnings.simplefilter("ignore")
    read_all(Path(sys.argv[1]), json.load(sys.stdin))
