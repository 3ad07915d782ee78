"""Every reader as a function of bytes: it returns, or raises a `BeltidError`."""

import atexit
import shutil
import tempfile
import unicodedata
import warnings
from collections.abc import Callable
from pathlib import Path

from beltid import load_law
from beltid.bench.recording import read_recording
from beltid.config.loading import load_config
from beltid.errors import LONGEST_LINE, BeltidError
from beltid.report.page import main_results, provenance, set_aside, tabulated, verdict_of
from beltid.report.results import BeltResults, Sheet, shown_of
from beltid.stages.inputs import press_law, surface_from
from beltid.store.artifact import read_artifact
from beltid.uncertainty.simulated import runs_uncertainty_of

CONFIG = load_config()
SETTINGS = load_config({"runs": {"rig": {"values": {"arc_deg": 82, "initial_tension_N": 270}}}})
"""For files that do not tell the settings of their run."""
CORPUS = Path(__file__).parent / "corpus"
_SHM = Path("/dev/shm")
_FOLDER = Path(tempfile.mkdtemp(prefix="beltid-hostile-", dir=_SHM if _SHM.is_dir() else None))


def _recording(kind: str) -> Callable[[Path], object]:
    return lambda path: read_recording(path, kind, CONFIG)


def _artifact(path: Path) -> object:
    """An artifact, and what stages and the report make of it before they compute or draw."""
    artifact = read_artifact(path)
    sheet = Sheet.of(artifact)
    if artifact.kind == "surface":
        surface_from(artifact)
    elif artifact.kind == "stiffness":
        press_law(artifact, CONFIG)
    elif artifact.kind == "simulated":
        runs_uncertainty_of(artifact.facts)
    results = BeltResults("x", {sheet.name: sheet})
    verdict_of(results)
    main_results(results)
    set_aside(results)
    provenance(results)
    tabulated(sheet, "budget")
    return shown_of(artifact, []).as_json()


@atexit.register
def clean() -> None:
    """Remove the folder of the files that were tried."""
    shutil.rmtree(_FOLDER, ignore_errors=True)


READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "yaml": ("x.yaml", load_config),
    "csv": ("x.csv", _recording("rig")),
    "press": ("x.csv", _recording("press")),
    "speedloss": ("x.csv", _recording("speedloss")),
    "zwick": ("x.txt", _recording("press")),
    "lvm": ("x.lvm", lambda path: read_recording(path, "rig", SETTINGS)),
    "uff": ("x.unv", _recording("press")),
    "gzip": ("x.csv.gz", _recording("rig")),
    "zip": ("x.zip", _recording("rig")),
    "artifact": ("x.parquet", _artifact),
    "parquet": ("x.parquet", _recording("rig")),
    "law": ("x.beltlaw.json", load_law),
    "tdms": ("x.tdms", _recording("rig")),
    "mdf": ("x.mf4", _recording("rig")),
    "mat": ("x.mat", _recording("rig")),
    "hdf5": ("x.h5", _recording("rig")),
    "xlsx": ("x.xlsx", _recording("rig")),
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
