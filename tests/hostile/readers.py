"""Every reader as a function of bytes: it returns, or raises a `BeltidError`."""

from __future__ import annotations

import tempfile
import unicodedata
import warnings
from collections.abc import Callable
from pathlib import Path

from beltid.config.loading import load_cases
from beltid.errors import LONGEST_LINE, BeltidError
from beltid.export.law_file import law_from_text
from beltid.formats.child import read_format
from beltid.formats.exchange import load, save
from beltid.store.artifacts import read_artifact
from beltid.store.big_recordings import open_big
from beltid.store.dialect import ReadOptions
from beltid.store.opening import Opened
from beltid.store.recordings import read_recording, recording_of

CORPUS = Path(__file__).parent / "corpus"
ISOLATED = ("tdms", "mdf", "mat", "hdf5", "xlsx")
"""Readers that run in a child process, where they may raise anything but must end."""

_SHM = Path("/dev/shm")
_FOLDER = Path(tempfile.mkdtemp(prefix="beltid-hostile-", dir=_SHM if _SHM.is_dir() else None))


def _recording(kind: str) -> Callable[[Path], object]:
    return lambda path: read_recording(path, kind)


def _stream(path: Path) -> object:
    return [run.label for run in open_big(path)]


def _law(path: Path) -> object:
    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        return None
    return law_from_text(text, path.name)


def _isolated(format_name: str) -> Callable[[Path], object]:
    """The reader of the child process, and what this process makes of its result."""

    def read(path: Path) -> object:
        try:
            found = read_format(format_name, path)
            if not found.groups:
                return None
            save(found, path.with_suffix(".npz"))
        except Exception:  # the child tells it: see formats.child
            return None
        opened = Opened(path.name, found.format, channels=load(path.with_suffix(".npz")))
        return recording_of([opened], path, "rig", ReadOptions(), "")

    return read


READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "yaml": ("x.yaml", load_cases),
    "csv": ("x.csv", _recording("rig")),
    "press": ("x.csv", _recording("press")),
    "speedloss": ("x.csv", _recording("speedloss")),
    "csv_stream": ("x.csv", _stream),
    "zwick": ("x.txt", _recording("press")),
    "lvm": ("x.lvm", _recording("rig")),
    "gzip": ("x.csv.gz", _recording("rig")),
    "zip": ("x.zip", _recording("rig")),
    "artifact": ("x.parquet", read_artifact),
    "parquet": ("x.parquet", _recording("rig")),
    "parquet_stream": ("x.parquet", _stream),
    "law": ("x.beltlaw.json", _law),
    "tdms": ("x.tdms", _isolated("tdms")),
    "mdf": ("x.mf4", _isolated("mdf")),
    "mat": ("x.mat", _isolated("mat")),
    "hdf5": ("x.h5", _isolated("hdf5")),
    "xlsx": ("x.xlsx", _isolated("xlsx")),
}
"""Reader -> name of its file, and the call."""


def seeds(reader: str) -> list[bytes]:
    """Files from which the changes start, and those that once were findings."""
    return [path.read_bytes() for path in sorted((CORPUS / reader).iterdir())]


def read(reader: str, data: bytes) -> BeltidError | None:
    """Let a reader read bytes; its refusal, or None if it took them. Anything else is raised."""
    name, call = READERS[reader]
    path = _FOLDER / name
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            call(path)
        except BeltidError as error:
            refused = error
        else:
            return None
    if refused.exit_status != 2 or not all(map(_is_tame, refused.problems)):
        raise AssertionError(f"status {refused.exit_status}: {refused!r}")
    return refused


def _is_tame(line: str) -> bool:
    """Whether a line commands no terminal, and is not endless."""
    return len(line) <= LONGEST_LINE and all(unicodedata.category(c)[0] != "C" for c in line)
