"""Where the data behind a result come from: a real bench, a virtual one, or nobody said.

The config states the origin of recordings; artifacts hand it on. One synthetic input makes the
result synthetic.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Final, Literal

from beltid.artifacts.artifact import may_be_artifact, read_artifact
from beltid.errors import ArtifactError
from beltid.tables.schemas import RECORDINGS

Origin = Literal["measured", "synthetic"]
MEASURED: Final = "measured"
SYNTHETIC: Final = "synthetic"


def origin_of(inputs: Mapping[str, Path], stated: str | None) -> str | None:
    """Origin of what is made from some inputs.

    Parameters
    ----------
    inputs : mapping of str to Path
        Files by their role.
    stated : {"measured", "synthetic"} or None
        What the config says about its recordings.

    Returns
    -------
    {"measured", "synthetic"} or None
        "synthetic" if any input is, "measured" if all are; None if nobody said so.
    """
    return combined_origin([_origin(role, path, stated) for role, path in inputs.items()])


def combined_origin(origins: Collection[str | None]) -> Origin | None:
    """Origin of what is made from data of some origins; None if nobody said, or of no data."""
    if SYNTHETIC in origins:
        return SYNTHETIC
    return MEASURED if set(origins) == {MEASURED} else None


def _origin(role: str, path: Path, stated: str | None) -> str | None:
    try:
        artifact = read_artifact(path) if may_be_artifact(path) else None
    except ArtifactError:
        artifact = None
    if artifact is None:  # a recording as the bench wrote it, of any size
        # a simulation that is brought along as a table adds no data of a bench
        return stated if role in RECORDINGS else MEASURED
    if role in RECORDINGS:
        return SYNTHETIC  # a simulated recording in the place of a measured one
    return artifact.metadata.origin
