"""The child process that reads formats whose libraries can crash or hang on damaged input.

It is given a folder for its results as its argument and the files as JSON on stdin: a list of
``[format, path]``. For file number i it writes ``i.npz``, or ``i.txt`` with the reason why not.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from importlib import import_module
from pathlib import Path
from typing import Final

from beltid.bench.formats.bench_file import BenchFile, DamagedFile, FormatError
from beltid.bench.formats.isolated.exchange import save

READERS: Final = {
    "tdms": "beltid.bench.formats.isolated.tdms",
    "mdf": "beltid.bench.formats.isolated.mdf",
    "mat": "beltid.bench.formats.isolated.matlab",
    "hdf5": "beltid.bench.formats.isolated.hdf5",
    "xlsx": "beltid.bench.formats.isolated.xlsx",
}
REFUSED: Final = "refused: "


def read_format(format_name: str, path: Path) -> BenchFile:
    """Read one file with the reader of its format, in this process."""
    file: BenchFile = import_module(READERS[format_name]).read(path)
    return file


def main(folder: Path, jobs: list[tuple[str, str]]) -> None:
    """Read the files one after the other; a file that cannot be read leaves its reason."""
    for number, (format_name, path) in enumerate(jobs):
        try:
            found = read_format(format_name, Path(path))
            if not found.groups:
                raise FormatError("holds no channel with samples")
            save(found, folder / f"{number}.part")
            os.replace(folder / f"{number}.part", folder / f"{number}.npz")
        except DamagedFile as error:
            reason = str(error)
        except FormatError as error:
            reason = f"{REFUSED}{error}"
        except ImportError as error:
            reason = f"{REFUSED}the library that reads its format cannot be loaded: {error}"
        except MemoryError:
            reason = str(DamagedFile("it asks for more memory than a file of its size can need"))
        except Exception as error:  # a damaged file can raise nearly anything
            said = " ".join(str(error).split())[:160] or "unreadable"
            reason = str(DamagedFile(f"{type(error).__name__}: {said}"))
        else:
            continue
        (folder / f"{number}.txt").write_text(reason, encoding="utf-8")


def limit(memory_bytes: int, cpu_s: int) -> None:
    """Limit memory and computing time of this process, where the system can."""
    try:
        import resource
    except ImportError:  # Windows: the parent still ends what takes too long
        return
    for what, value in (
        (resource.RLIMIT_AS, memory_bytes),
        (resource.RLIMIT_CPU, cpu_s),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(what)[1]
        allowed = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(what, (allowed, hard))


if __name__ == "__main__":
    limit(int(sys.argv[2]), int(sys.argv[3]))
    warnings.simplefilter("ignore")
    main(Path(sys.argv[1]), [tuple(job) for job in json.load(sys.stdin)])
