"""Results folders: one batch at a time in each, and no links out of them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from beltid.artifacts.file_bytes import remove_stale
from beltid.errors import InputError
from beltid.stages.reporter import Reporter

LOCK: Final = ".beltid-lock"
WORKING: Final = 256
"""Largest number of files that a batch has open in addition to its locks."""


def refuse_links_out(folder: Path, belts: Sequence[str]) -> None:
    """Reject belt folders, and files in them, that are links out of the results folder.

    The results folder itself may be a link, since the user names it.

    Parameters
    ----------
    folder : Path
        Results folder.
    belts : sequence of str
        Names of belts or of cases, such as ``5pk`` or ``5pk/case``.

    Raises
    ------
    InputError
        With every such link.
    """
    root = os.path.realpath(folder)
    problems = []
    for place in dict.fromkeys(p for belt in belts for p in (*Path(belt).parents, Path(belt))):
        here = folder / place
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
def alone_in(folders: Sequence[Path], reporter: Reporter) -> Iterator[None]:
    """Lock some folders against other batches, and remove temporary files of killed ones.

    A second batch waits, then finds everything up to date. The system releases a lock when its
    process ends for any reason. On file systems without locks (some network ones) the batch runs
    without; files are still written atomically.

    Parameters
    ----------
    folders : sequence of Path
        Results folders.
    reporter : Reporter
        Receives a message when another batch must be awaited.
    """
    unique = sorted(set(folders))  # always in the same order, to prevent a deadlock
    most = _max_locks(len(unique))
    with contextlib.ExitStack() as locks:
        for index, folder in enumerate(unique):
            descriptor = _open_lock(folder)
            if descriptor is not None and index >= most:
                os.close(descriptor)
            elif descriptor is not None:
                locks.callback(os.close, descriptor)
                _lock(descriptor, folder, reporter)
            remove_stale(folder)
        yield


def _max_locks(wanted: int) -> int:
    """Return how many locks, each an open file, fit in the limit of open files.

    Raises the limit if the system allows it. Cases of a very large sweep beyond it run without a
    lock.
    """
    try:
        import resource
    except ImportError:  # not a POSIX system
        return wanted
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limits = [limit for limit in (hard, wanted + WORKING) if limit != resource.RLIM_INFINITY]
    if soft != resource.RLIM_INFINITY and soft < min(limits):
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (min(limits), hard))
            soft = min(limits)
    return wanted if soft == resource.RLIM_INFINITY else min(wanted, max(0, soft - WORKING))


def _open_lock(folder: Path) -> int | None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:  # the first stage will report what is wrong with the folder
        return None


def _lock(descriptor: int, folder: Path, reporter: Reporter) -> None:
    try:
        import fcntl
    except ImportError:  # not a POSIX system
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        reporter.report(f"{folder}: another beltid run is at work there, waiting for it")
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
    except OSError:
        return
