"""Whether a file may be written where the user wants it; the same answers for every command."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from beltid.errors import ArtifactError, InputError
from beltid.store.disk import no_folder

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

    Parameters
    ----------
    out : Path
        The file to write.
    endings : tuple of str
        Endings that such files have.
    whose : callable
        Says what an existing file is: `OURS` if it may be replaced; `FOREIGN`, which is replaced
        only with force; or something else, which is, too, whatever its ending.
    inputs : mapping of str to Path, optional
        Files that are read, by what they are: never replaced.
    force : bool
        Whether to replace another file of these endings.

    Raises
    ------
    InputError, ArtifactError
        Names the file, what is there and what to do.
    """
    for what, path in (inputs or {}).items():
        if same_file(path, out):
            raise InputError(f"{out}: is the {what}, name another --out")
    if out.is_dir():
        raise ArtifactError(f"{out}: is a folder, name a file in it")
    fits = out.suffix.lower() in endings
    if not fits:
        name = out.with_suffix(endings[0]).name
        raise InputError(
            f"{out}: ends in {out.suffix or 'nothing'}, must be one of {', '.join(endings)}, such "
            f"as {name}"
        )
    if out.exists():
        found = whose(out)
        if found and not force:
            raise InputError(
                f"{out}: is {found}, not replaced; name another --out, or replace it with --force"
            )
    if problem := no_folder(out):
        raise ArtifactError(f"{out}: not written: {problem}")


def anyone_s(path: Path) -> str:
    """Say of any existing file that it is replaced only with force."""
    return "already there"


def same_file(path: Path, other: Path) -> bool:
    """Return whether two paths lead to the same file."""
    if os.path.realpath(path) == os.path.realpath(other):
        return True
    try:
        return os.path.samefile(path, other)
    except (OSError, ValueError):  # one of the files does not exist
        return False
