"""Read files with clear errors, write them atomically, hash them.

A file is written under a temporary name, synced to disk (fsync) and renamed, and its folder is
synced: it appears whole or not at all. The hash of our own sources distinguishes a modified
installation from the original of the same version.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import secrets
import socket
import stat
import time
from collections.abc import Container, Iterator
from io import BufferedReader
from pathlib import Path
from typing import Final

from beltid.errors import ArtifactError, InputError

MAX_BYTES: Final = 1 << 30


@contextlib.contextmanager
def opened(path: Path, error_type: type[InputError] = InputError) -> Iterator[BufferedReader]:
    """Open a file for reading; turn errors of opening and reading into an `error_type`."""
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # reading may block or never end
            raise error_type(f"{path}: is a pipe or a device, a file is needed")
        with path.open("rb") as file:
            yield file
    except FileNotFoundError:
        raise error_type(f"{path}: there is no such file") from None
    except IsADirectoryError:
        raise error_type(f"{path}: is a folder, a file is needed") from None
    except PermissionError:
        raise error_type(f"{path}: no permission to read it") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise error_type(f"{path}: cannot be read: {reason}") from None


def _too_large(path: Path) -> str:
    return f"{path}: larger than {MAX_BYTES >> 20} MB, split the recording"


def read_bytes(path: Path, error_type: type[InputError] = InputError) -> bytes:
    """Read all bytes of a file."""
    with opened(path, error_type) as file:
        size = os.fstat(file.fileno()).st_size  # 0 for virtual files, as in /proc
        if size > MAX_BYTES:
            raise error_type(_too_large(path))
        data = file.read((size or MAX_BYTES) + 1)
    if len(data) > MAX_BYTES:
        raise error_type(_too_large(path))
    if not data:
        raise error_type(f"{path}: the file is empty")
    return data


STALE_AFTER_S: Final = 3600.0
ONLY_SHOW: Final = ("cli", "report", "__main__.py")
"""Parts of the package that display results and cannot change them."""
PAGES: Final = (".j2", ".css", ".js")
"""Suffixes of page sources other than modules."""


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file atomically: no reader ever sees a part of it.

    Missing folders are created. An existing file is replaced only when the new one is safely on
    disk; on any failure it stays unchanged. Temporary files of the same name left by a killed
    process are removed.
    """
    stated = Path(path)
    target = stated
    try:
        target = Path(os.path.realpath(stated))
        _check_target(stated, target)
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale(target.parent, re.escape(target.name))
        _replace(target, data)
    except (OSError, ValueError) as error:
        text = f"{stated}: not written: {_reason(error)}{_kept_note(target)}"
        raise ArtifactError(text) from None


def no_folder(out: Path) -> str:
    """Return why a file cannot be created in its folder, or one above that exists; "" if it can."""
    folder = out.parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir():
        return f"{folder} is a file, not a folder"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"no permission to write in {folder}"
    return ""


def write_text(path: str | Path, text: str) -> None:
    """Write a text as UTF-8 with `write_bytes`."""
    write_bytes(path, text.encode("utf-8"))


def _check_target(stated: Path, target: Path) -> None:
    if target.is_dir():
        what = "this is a folder, name a file in it"
    elif target.is_symlink():
        what = "this is a symbolic link that leads back to itself"
    elif target.exists() and not target.is_file():
        what = "this is not an ordinary file"
    else:
        return
    raise ArtifactError(f"{stated}: not written: {what}")


def _kept_note(target: Path) -> str:
    with contextlib.suppress(OSError, ValueError):
        if target.is_file():
            return "; the file that was there is untouched"
    return ""


def _reason(error: OSError | ValueError) -> str:
    if isinstance(error, PermissionError):
        return f"no permission to write in {Path(error.filename or '').parent}"
    if isinstance(error, (FileExistsError, NotADirectoryError)):
        return f"{error.filename} is a file, not a folder"
    return getattr(error, "strerror", None) or str(error)


def _owner() -> str:
    host = re.sub(r"[^A-Za-z0-9]+", "", socket.gethostname())[:32] or "host"
    return f"{host}-{os.getpid()}"


def _replace(target: Path, data: bytes) -> None:
    temporary = target.parent / f".{target.name}.{_owner()}-{secrets.token_hex(4)}.beltid-tmp"
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException:  # an interrupt must not leave the temporary file either
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    _sync_folder(target.parent)


def _sync_folder(folder: Path) -> None:
    """Make the rename durable, if the file system supports it."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def remove_stale(folder: Path) -> None:
    """Remove temporary files of ended processes from a folder, which may be missing."""
    with contextlib.suppress(OSError):
        _remove_stale(folder, r".+")


def _remove_stale(folder: Path, names: str) -> None:
    """Remove temporary files of ended processes whose target names match a regex."""
    pattern = re.compile(
        rf"\.(?:{names})\.(?P<host>[A-Za-z0-9]+)-(?P<pid>\d+)-[0-9a-f]{{8}}\.beltid-tmp"
    )
    this_host = _owner().rsplit("-", 1)[0]
    for name in os.listdir(folder):
        match = pattern.fullmatch(name)
        if match is None:
            continue
        temporary = folder / name
        with contextlib.suppress(OSError):
            age = time.time() - temporary.stat().st_mtime
            ended = match["host"] == this_host and not _alive(int(match["pid"]))
            if ended or age > STALE_AFTER_S:
                temporary.unlink()


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def sha256(data: bytes | memoryview) -> str:
    """Compute the SHA-256 of some bytes, as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


@functools.cache
def source_sha256() -> str:
    """Return the SHA-256 of the sources of this installation; see `hash_of_sources`."""
    return hash_of_sources(Path(__file__).resolve().parents[1])


@functools.cache
def page_source_sha256() -> str:
    """Return the SHA-256 of all sources that can change a report page."""
    return hash_of_sources(Path(__file__).resolve().parents[1], but=("cli",), more=PAGES)


def hash_of_sources(
    package: Path, but: Container[str] = ONLY_SHOW, more: tuple[str, ...] = ()
) -> str:
    """Compute the SHA-256 of the names and contents of all modules that can change a result.

    Line endings do not matter. Returns "" if there are no sources to read (a packed installation).
    """
    sources = sorted(
        (path.relative_to(package).as_posix(), path)
        for path in package.rglob("*")
        if path.suffix in (".py", *more) and path.relative_to(package).parts[0] not in but
    )
    if not sources:
        return ""
    digest = hashlib.sha256()
    for name, path in sources:
        content = path.read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()
