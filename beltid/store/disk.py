"""Read files with clear errors, write them whole or not at all, and only where they may stand.

A file is written under a temporary name, synced and renamed. The hash of our own sources tells a
modified installation from the original of the same version.
"""

import contextlib
import functools
import os
import stat
from collections.abc import Callable, Iterator, Mapping
from io import BufferedReader
from pathlib import Path

from beltid.errors import ArtifactError, InputError

MAX_BYTES = 1 << 30
FOREIGN = "a file that beltid did not write"
OURS = ""
ONLY_SHOW = ("cli", "report", "__main__.py")  # parts that cannot change a result
REASONS: dict[type[BaseException], str] = {
    FileNotFoundError: "there is no such file",
    IsADirectoryError: "is a folder, a file is needed",
    PermissionError: "no permission to read it",
}


@contextlib.contextmanager
def opened(path: Path, error_type: type[InputError] = InputError) -> Iterator[BufferedReader]:
    """Open a file for reading; turn errors of opening and reading into an `error_type`."""
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # reading may block or never end
            raise error_type(f"{path}: is a pipe or a device, a file is needed")
        with path.open("rb") as file:
            yield file
    except (OSError, ValueError) as error:
        reason = REASONS.get(type(error)) or f"cannot be read: {_reason(error)}"
        raise error_type(f"{path}: {reason}") from None


def read_bytes(path: Path, error_type: type[InputError] = InputError) -> bytes:
    """Read all bytes of a file."""
    with opened(path, error_type) as file:
        if os.fstat(file.fileno()).st_size > MAX_BYTES:
            raise error_type(f"{path}: larger than {MAX_BYTES >> 20} MB, split the recording")
        data = file.read()
    if not data:
        raise error_type(f"{path}: the file is empty")
    return data


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file: no reader ever sees a part of it, and on a failure an earlier one stays."""
    target = Path(os.path.realpath(path))  # a link keeps pointing where it points
    temporary = target.with_name(f".{target.name}.{os.urandom(8).hex()}.beltid-tmp")
    try:
        if os.path.lexists(target) and not target.is_file():
            raise ArtifactError(f"{path}: not written: this is not an ordinary file")
        target.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except (OSError, ValueError) as error:
        raise ArtifactError(f"{path}: not written: {_reason(error)}") from None
    finally:  # an interrupt must not leave the temporary file either
        with contextlib.suppress(OSError, ValueError):
            temporary.unlink(missing_ok=True)


def _reason(error: OSError | ValueError) -> str:
    return getattr(error, "strerror", None) or str(error)


def check_place(
    out: Path,
    endings: tuple[str, ...],
    whose: Callable[[Path], str] | None = None,
    *,
    inputs: Mapping[str, Path] | None = None,
    force: bool = False,
) -> None:
    """Refuse a place where a file cannot be written, or would replace one that must stay.

    `whose` says what an existing file is: `OURS` may be replaced, all else, by default any file,
    only with force; `inputs`, by what they are, never.
    """
    for what, path in (inputs or {}).items():
        there = os.path.exists(out) and os.path.exists(path)
        if (
            os.path.samefile(path, out)
            if there
            else os.path.realpath(path) == os.path.realpath(out)
        ):
            raise InputError(f"{out}: is the {what}, name another --out")
    if out.is_dir():
        raise ArtifactError(f"{out}: is a folder, name a file in it")
    if out.suffix.lower() not in endings:
        raise InputError(
            f"{out}: ends in {out.suffix or 'nothing'}, must be one of {', '.join(endings)}, such "
            f"as {out.with_suffix(endings[0]).name}"
        )
    found = (whose(out) if whose else "already there") if out.exists() else OURS
    if found and not force:
        raise InputError(
            f"{out}: is {found}, not replaced; name another --out, or replace it with --force"
        )
    folder = next(above for above in out.absolute().parents if above.exists())
    if not folder.is_dir():
        raise ArtifactError(f"{out}: not written: {folder} is a file, not a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ArtifactError(f"{out}: not written: no permission to write in {folder}")


def sha256(data: bytes | memoryview) -> str:
    """Compute the SHA-256 of some bytes, as 64 hexadecimal digits."""
    import hashlib

    return hashlib.sha256(data).hexdigest()


@functools.cache
def source_sha256(*, of_page: bool = False) -> str:
    """Return the SHA-256 of all sources here that can change a result, or a report page."""
    suffixes, but = ((".py", ".j2", ".css", ".js"), ("cli",)) if of_page else ((".py",), ONLY_SHOW)
    package, found = Path(__file__).resolve().parents[1], list[bytes]()
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package)
        if path.suffix in suffixes and name.parts[0] not in but:
            content = path.read_bytes().replace(b"\r\n", b"\n")
            found.append(f"{name.as_posix()}\0{len(content)}\0".encode() + content)
    return sha256(b"".join(found))
