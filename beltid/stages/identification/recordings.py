"""Read recordings of any format as tables in memory, for the Python functions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beltid.bench.recording import as_frame, read_recording
from beltid.config import Config, load_config

if TYPE_CHECKING:
    import pandas as pd

ConfigLike = Config | Mapping[str, Any] | str | Path | None


def read_press(path: str | Path, config: ConfigLike = None) -> pd.DataFrame:
    """Read a recording of the press, in any format that ``beltid inspect`` knows.

    Parameters
    ----------
    path : path
        A file; or a folder, a pattern such as ``"press/*.csv"`` or a zip file with a file per test.
    config : Config, dict, path or None
        Names, units and dialect of the file, where they are not recognised automatically.

    Returns
    -------
    DataFrame
        The columns of press.csv, in their units; ``.attrs["notes"]`` says how it was read.

    Raises
    ------
    InputError
        With all problems, each with its line.
    """
    return _frame(path, "press", config)


def read_rig(path: str | Path, config: ConfigLike = None) -> pd.DataFrame:
    """Read a recording of the friction rig; see `read_press`. The columns are those of rig.csv."""
    return _frame(path, "rig", config)


def read_speedloss(path: str | Path, config: ConfigLike = None) -> pd.DataFrame:
    """Read a recording of the speed-loss bench; see `read_press`. Columns of speedloss.csv."""
    return _frame(path, "speedloss", config)


def _frame(path: str | Path, kind: str, config: ConfigLike) -> pd.DataFrame:
    recording = read_recording(path, kind, load_config(config))
    return as_frame(recording.columns, recording.notes)
