"""Results folders: one batch at a time in each, and no links out of them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from beltid.errors import InputError
from beltid.notes import log
from beltid.store.disk import remove_stale

LOCK: Final = ".beltid-lock"


def refuse_links_out(folder: Path, belts: Sequence[str]) -> None:
    """Reject belt folders, and files in them, that are links out of the results folder.

    The results folder itself may be a link, since the user names it.

    Parameters
    ----------
    folder : Path
        Results folder.
    belts : sequence of str
        Names of belts, such as ``5pk``.

    Raises
    ------
    InputError
        With every such link.
    """
    root = os.path.realpath(folder)
    problems = []
    for here in (folder, *(folder / belt for belt in belts)):
        for path in (here, *_links_in(here)):
            target = os.path.realpath(path)
            if os.path.commonpath([root, target]) != root:
                problems.append(
                    f"{path}: is a link to {target}, outside the results folder {folder}; "
                    "remove the link, or name another --out"
                )
    if problems:
        raise InputError(list(dict.fromkeys(problems)))


def _links_in(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if path.is_symlink())
    except OSError:  # missing, or the first step will report the problem
        return []


@contextlib.contextmanager
def alone_in(folders: Sequence[Path]) -> Iterator[None]:
    """Lock some folders against other batches, and remove temporary files of killed ones.

    A second batch waits, then finds everything up to date. The system releases a lock when its
    process ends for any reason. On file systems without locks (some network ones) the batch runs
    without; files are still written atomically.

    Parameters
    ----------
    folders : sequence of Path
        Results folders.
    """
    unique = sorted(set(folders))  # always in the same order, to prevent a deadlock
    with contextlib.ExitStack() as locks:
        for folder in unique:
            descriptor = _open_lock(folder)
            if descriptor is not None:
                locks.callback(os.close, descriptor)
                _lock(descriptor, folder)
            remove_stale(folder)
        yield


def _open_lock(folder: Path) -> int | None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:  # the first stage will report what is wrong with the folder
        return None


def _lock(descriptor: int, folder: Path) -> None:
    try:
        import fcntl
    except ImportError:  # not a POSIX system
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        log.info("%s: another beltid run is at work there, waiting for it", folder)
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
    except OSError:
        return
