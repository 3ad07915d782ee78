"""Results stay in the folder of the results: no symbolic link leads them elsewhere."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from beltid.errors import InputError


def refuse_links_out(folder: Path, belts: Sequence[str]) -> None:
    """Refuse folders of belts, and files in them, that are links out of the folder of the results.

    The folder of the results itself may be a link: the user names it.

    Parameters
    ----------
    folder : Path
        Folder of the results.
    belts : sequence of str
        Names of belts or of cases, such as ``5pk`` or ``5pk/case``.

    Raises
    ------
    InputError
        With every link that leads out.
    """
    root = os.path.realpath(folder)
    problems = []
    for place in dict.fromkeys(p for belt in belts for p in (*Path(belt).parents, Path(belt))):
        here = folder / place
        for path in (here, *_links_in(here)):
            target = os.path.realpath(path)
            if os.path.commonpath([root, target]) != root:
                problems.append(
                    f"{path}: is a link to {target}, out of the folder of the results {folder}; "
                    "remove the link, or name another --runs-dir"
                )
    if problems:
        raise InputError(list(dict.fromkeys(problems)))


def _links_in(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if path.is_symlink())
    except OSError:  # it is not there yet, or the first step will say what is wrong with it
        return []
