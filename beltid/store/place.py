"""Whether a file may be written where the user wants it; the same answers for every command."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from beltid.errors import ArtifactError, InputError

FOREIGN: Final = "a file that beltid did not write"
OURS: Final = ""


def check_place(
    out: Path,
    endings: tuple[str, ...],
    whose: Callable[[Path], str],
    *,
    inputs: Mapping[str, Path] | None = None,
    force: bool = False,
) -> None:
    """Refuse a place where a file cannot be written, or would replace one that must stay.

    `whose` says what an existing file is: `OURS` may be replaced, anything else only with force;
    `inputs`, by what they are, never.
    """
    for what, path in (inputs or {}).items():
        if _same_file(path, out):
            raise InputError(f"{out}: is the {what}, name another --out")
    if out.is_dir():
        raise ArtifactError(f"{out}: is a folder, name a file in it")
    if out.suffix.lower() not in endings:
        raise InputError(
            f"{out}: ends in {out.suffix or 'nothing'}, must be one of {', '.join(endings)}, such "
            f"as {out.with_suffix(endings[0]).name}"
        )
    if out.exists() and (found := whose(out)) and not force:
        raise InputError(
            f"{out}: is {found}, not replaced; name another --out, or replace it with --force"
        )
    folder = next(above for above in out.absolute().parents if above.exists())
    if not folder.is_dir():
        raise ArtifactError(f"{out}: not written: {folder} is a file, not a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ArtifactError(f"{out}: not written: no permission to write in {folder}")


def anyone_s(path: Path) -> str:
    """Say of any existing file that it is replaced only with force."""
    return "already there"


def _same_file(path: Path, other: Path) -> bool:
    try:
        return os.path.samefile(path, other)
    except OSError:  # one of the files does not exist
        return os.path.realpath(path) == os.path.realpath(other)
