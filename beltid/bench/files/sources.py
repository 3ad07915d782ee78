"""The files of a recording: one file, or one per run in a folder, a pattern or a zip file."""

from __future__ import annotations

import contextlib
import glob
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from beltid.artifacts.file_bytes import opened, read_bytes
from beltid.artifacts.hashing import sha256
from beltid.bench.files.archives import MAX_FILES, member_bytes, members
from beltid.bench.files.folders import natural, parquet_files
from beltid.bench.files.sniff import ZIP, sniff
from beltid.errors import InputError

_NOT_RECORDINGS: Final = frozenset({".yaml", ".yml", ".md", ".json", ".html", ".pdf", ".png"})
_COMPANIONS: Final = frozenset({".tdms_index"})


@dataclass(frozen=True, slots=True)
class Source:
    """One file of a recording.

    Attributes
    ----------
    name : str
        Its name for messages.
    path : Path
        The file, or the zip file that holds it.
    member : str
        Its name in the zip file, "" outside of one.
    packed : bytes
        The zip file.
    """

    name: str
    path: Path
    member: str = ""
    packed: bytes = field(default=b"", repr=False)

    def read(self) -> bytes:
        """Its bytes."""
        if self.member:
            return member_bytes(self.packed, self.path, self.member)
        return read_bytes(self.path)


def is_many(path: Path) -> bool:
    """Whether a path stands for several files: a folder or a pattern."""
    return path.is_dir() or (not path.exists() and glob.has_magic(str(path)))


def exists(path: Path) -> bool:
    """Whether there is a file, a folder or something that matches a pattern."""
    return path.exists() or (glob.has_magic(str(path)) and any(glob.iglob(str(path))))


def sources_of(path: Path, besides: Sequence[Path] = ()) -> list[Source]:
    """Files that a path stands for.

    Parameters
    ----------
    path : Path
        A file, a zip file, a folder, or a pattern with ``*`` and ``?``.
    besides : sequence of Path
        Files that are no recordings even if they are found: a table of the runs.

    Raises
    ------
    InputError
        If there is none, or a folder holds files of several kinds.
    """
    if is_many(path):
        files = _files(path, {b.absolute() for b in besides})
        return [Source(str(file), file) for file in files]
    with opened(path) as head:
        first = head.read(4)
    if first[:2] == b"PK":
        data = read_bytes(path)
        if sniff(data) == ZIP:
            found = list(members(data, path))
            names = [f"{path}/{m}" if len(found) > 1 else str(path) for m in found]
            return [Source(n, path, m, data) for n, m in zip(names, found, strict=True)]
    return [Source(str(path), path)]


def content_sha256(path: Path, besides: Sequence[Path] = ()) -> str:
    """SHA-256 of a file; of the names and contents of the files where there are several."""
    if not is_many(path):
        return _file_sha256(path)
    lines = []
    for source in sources_of(path, besides):
        root = path if path.is_dir() else _root(path)
        name = source.path.relative_to(root).as_posix()
        lines.append(f"{name}\0{_file_sha256(source.path)}\n")
    return sha256("".join(lines).encode())


@dataclass(frozen=True, slots=True)
class FileState:
    """What the file system says of a file; it changes when the file is replaced or written.

    Attributes
    ----------
    name : str
        Where it stands.
    modified_ns : int
        Time of its last change [ns].
    size : int
        Bytes in it.
    number : int
        Its number on the disk.
    """

    name: str
    modified_ns: int
    size: int
    number: int


Signature = tuple[FileState, ...]


def signature_of(path: Path) -> Signature:
    """What the file system says of a file, or of each of the files that a path may stand for.

    What is not there is left out: what is wrong with it is said by the one who reads it.
    """
    states = []
    with contextlib.suppress(OSError):
        files = _found(path) if is_many(path) else [path]
        if path.is_dir() and all(_is_parquet(file) for file in files):  # a table in parts
            files += parquet_files(path)
        for file in files:
            found = file.stat()
            states.append(FileState(str(file), found.st_mtime_ns, found.st_size, found.st_ino))
    return tuple(sorted(states, key=lambda state: state.name))


def _file_sha256(path: Path) -> str:
    """SHA-256 of a file of any size, read in parts."""
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def folder_of(path: Path) -> Path:
    """Folder beside which results belong: of a pattern the part before its first sign."""
    if not path.exists() and glob.has_magic(str(path)):
        return _root(path)
    return path.parent


def _root(path: Path) -> Path:
    parts = []
    for part in path.parts:
        if glob.has_magic(part):
            break
        parts.append(part)
    return Path(*parts) if parts else Path()


def _files(path: Path, besides: set[Path]) -> list[Path]:
    """Files of a folder or pattern in the order of their names; those of one kind only."""
    if path.parts.count("**") > 1 and not path.is_dir():
        raise InputError(
            f"{path}: ** stands in it more than once, which finds the same files again"
        )
    try:
        found = _found(path)
    except PermissionError:
        raise InputError(f"{path}: no permission to look into it") from None
    files = [f for f in found if f.absolute() not in besides and not _is_artifact(f)]
    if path.is_dir() and not files:  # folders in it: a table in parts
        files = parquet_files(path)
    elif path.is_dir():
        files = [f for f in files if f.suffix.lower() not in _NOT_RECORDINGS]
        _refuse_kinds(files, path)
    if not files:
        what = "holds no recording" if path.is_dir() else "no file matches this pattern"
        raise InputError(f"{path}: {what}")
    if len(files) > MAX_FILES:
        raise InputError(f"{path}: {len(files)} files, at most {MAX_FILES} are read")
    return sorted(files, key=lambda f: natural(f.as_posix()))


def _found(path: Path) -> list[Path]:
    """Files of a folder or pattern that recordings may be among."""
    if path.is_dir():
        found = [f for f in path.iterdir() if f.is_file()]
    else:
        found = [Path(f) for f in glob.glob(str(path), recursive=True) if Path(f).is_file()]
    return [
        f
        for f in found
        if not f.name.startswith((".", "~$")) and f.suffix.lower() not in _COMPANIONS
    ]


def _is_parquet(file: Path) -> bool:
    return file.suffix.lower() == ".parquet"


def _is_artifact(file: Path) -> bool:
    """Whether it is a result: these stand beside what they were made from."""
    if not _is_parquet(file):
        return False
    from beltid.artifacts.artifact import read_artifact
    from beltid.errors import ArtifactError

    try:
        read_artifact(file)
    except ArtifactError:
        return False
    return True


def _refuse_kinds(files: Sequence[Path], path: Path) -> None:
    kinds: dict[str, int] = {}
    for file in files:
        ending = "".join(file.suffixes[-2:] if file.suffix == ".gz" else file.suffixes[-1:]).lower()
        kinds[ending] = kinds.get(ending, 0) + 1
    if len(kinds) > 1:
        shown = ", ".join(f"{n} {ending or 'without ending'}" for ending, n in kinds.items())
        most = max(kinds, key=lambda ending: kinds[ending])
        raise InputError(
            f"{path}: holds files of several kinds ({shown}); "
            f"name those that are runs, such as {path / f'*{most}'}"
        )
