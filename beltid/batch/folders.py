"""Folders of results: one batch at a time in each of them, and no link leads out of them."""

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
"""Files that a batch has open at the same time beside its locks, at most."""


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


@contextlib.contextmanager
def alone_in(folders: Sequence[Path], reporter: Reporter) -> Iterator[None]:
    """Be the only batch in some folders, and clear away what a killed one left there.

    A second batch waits, then finds all up to date. The system lets a lock go when its holder ends,
    however it ends. Where there are no locks (some network file systems) the batch goes on without:
    files are whole all the same.

    Parameters
    ----------
    folders : sequence of Path
        Folders of results.
    reporter : Reporter
        Hears that another batch is waited for.
    """
    different = sorted(set(folders))  # in one order, so that no two wait for each other
    most = _locks_at_most(len(different))
    with contextlib.ExitStack() as held:
        for place, folder in enumerate(different):
            descriptor = _opened(folder)
            if descriptor is not None and place >= most:
                os.close(descriptor)
            elif descriptor is not None:
                held.callback(os.close, descriptor)
                _lock(descriptor, folder, reporter)
            remove_stale(folder)
        yield


def _locks_at_most(wanted: int) -> int:
    """How many of the wanted locks, each an open file, leave files to work with.

    The system allows more where it is asked; what a sweep of thousands of cases lacks then goes on
    without a lock.
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


def _opened(folder: Path) -> int | None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:  # the first stage will say what is wrong with the folder
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
