"""List the files of a recording: one file, or one per run in a folder, pattern or zip file."""

from __future__ import annotations

import contextlib
import glob
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath, PurePosixPath
from typing import Final, NamedTuple

from beltid.artifacts.file_bytes import MAX_BYTES, opened, read_bytes, sha256
from beltid.bench.files.archives import MAX_FILES, member_bytes, members, natural
from beltid.bench.files.sniff import ZIP, sniff
from beltid.errors import InputError

_NOT_RECORDINGS: Final = frozenset({".yaml", ".yml", ".md", ".json", ".html", ".pdf", ".png"})
_COMPANIONS: Final = frozenset({".tdms_index", ".lnk"})
_OF_WINDOWS: Final = frozenset({"thumbs.db", "desktop.ini"})


@dataclass(frozen=True, slots=True)
class Source:
    """One file of a recording.

    Attributes
    ----------
    name : str
        Name for messages.
    path : Path
        The file, or the zip file that holds it.
    inside : PurePath
        Path within the folder or zip file; for a single file its name.
    data : bytes
        Bytes of the file, or of the zip file, if already read.
    is_member : bool
        Whether it is in a zip file.
    """

    name: str
    path: Path
    inside: PurePath
    data: bytes = field(default=b"", repr=False)
    is_member: bool = False

    def read(self) -> bytes:
        """Return the bytes of the file."""
        if self.is_member:
            return member_bytes(self.data, self.path, str(self.inside))
        return self.data or read_bytes(self.path)

    def first_bytes(self, count: int = 4) -> bytes:
        """Return the first bytes of the file."""
        if self.data:
            return self.read()[:count]
        with opened(self.path) as file:
            return file.read(count)

    def loaded(self) -> Source:
        """Return a copy with its bytes in memory, unpacked from the zip file."""
        return replace(self, data=self.read(), is_member=False)


def is_many(path: Path) -> bool:
    """Whether a path names several files: a folder or a pattern."""
    return path.is_dir() or (not path.exists() and glob.has_magic(str(path)))


def exists(path: Path) -> bool:
    """Whether the file or folder exists, or any file matches the pattern."""
    return path.exists() or (glob.has_magic(str(path)) and any(glob.iglob(str(path))))


def sources_of(path: Path, besides: Sequence[Path] = ()) -> list[Source]:
    """List the files that a path names.

    Parameters
    ----------
    path : Path
        A file, a zip file, a folder, or a pattern with ``*`` and ``?``.
    besides : sequence of Path
        Files that are not recordings and are skipped, such as a table of the runs.

    Raises
    ------
    InputError
        If there is no file, or a folder holds files of several kinds.
    """
    if not is_many(path):
        return sources_in(read_bytes(path), path)
    root = path if path.is_dir() else _root(path)
    files = _files(path, {b.absolute() for b in besides})
    return [Source(_shown(file), file, file.relative_to(root)) for file in files]


def unread_sources(path: Path) -> list[Source]:
    """List the same files, but neither read nor unpack a single file, which may be large."""
    return sources_of(path) if is_many(path) else [Source(_shown(path), path, PurePath(path.name))]


def sources_in(data: bytes, path: Path) -> list[Source]:
    """List the file itself, or the files in it if the bytes are a zip file."""
    if data[:2] != b"PK" or sniff(data) != ZIP:
        return [Source(_shown(path), path, PurePath(path.name), data)]
    packed = list(members(data, path))
    names = [f"{path}/{member}" if len(packed) > 1 else str(path) for member in packed]
    return [
        Source(name, path, PurePosixPath(member), data, is_member=True)
        for name, member in zip(names, packed, strict=True)
    ]


def _shown(path: Path) -> str:
    """Return a path as text for messages and labels; bytes that are not UTF-8 become U+FFFD."""
    return str(path).encode(errors="surrogateescape").decode(errors="replace")


def refuse_large(path: Path, sources: Sequence[Source]) -> None:
    """Refuse a recording whose files together are too large to be read at once.

    Raises
    ------
    InputError
        If the files are too large.
    """
    if size_of(sources) > MAX_BYTES:
        raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MB, split the recording")


def folders_left_out(path: Path, sources: Sequence[Source]) -> list[str]:
    """Note the subfolders that hold files of the same kind but are not read."""
    from beltid.artifacts.artifact import may_be_artifact  # results may lie among recordings

    if not path.is_dir():
        return []
    read = {source.inside.parts[0] for source in sources}
    ending = sources[0].path.suffix
    folders = [
        folder.name
        for folder in sorted(path.iterdir())
        if folder.is_dir() and folder.name not in read and not folder.name.startswith((".", "_"))
        if any(not may_be_artifact(file) for file in folder.rglob(f"*{glob.escape(ending)}"))
    ]
    return [f"folders with further files left out: {', '.join(folders[:12])}"] if folders else []


def size_of(sources: Sequence[Source]) -> int:
    """Return the total size of the files on disk [byte]."""
    with contextlib.suppress(OSError):  # the reader reports missing files
        return sum(source.path.stat().st_size for source in sources)
    return 0


@dataclass(frozen=True, slots=True)
class Content:
    """Checksum and kind of a file, or of all files that a path names.

    Attributes
    ----------
    sha256 : str
        SHA-256 of the file; for several files, of their names and contents.
    is_parquet : bool
        Whether it is a single Parquet file, as artifacts are.
    """

    sha256: str
    is_parquet: bool


def content_of(path: Path, besides: Sequence[Path] = ()) -> Content:
    """Return the content of one or several files, without those in `besides`."""
    if not is_many(path):
        return _file_content(path)
    sources = sources_of(path, besides)
    lines = [f"{s.inside.as_posix()}\0{_file_content(s.path).sha256}\n" for s in sources]
    return Content(sha256("".join(lines).encode(errors="surrogateescape")), is_parquet=False)


def are_parquet(sources: Sequence[Source]) -> bool:
    """Whether the first bytes of all files are those of Parquet."""
    return all(source.first_bytes() == b"PAR1" for source in sources)


class FileState(NamedTuple):
    """State of a file in the file system; changes when the file is replaced or written."""

    name: str
    """Path of the file."""
    modified_ns: int
    """Time of the last change [ns]."""
    size: int
    """Size [byte]."""
    number: int
    """Inode number."""


Signature = tuple[FileState, ...]


def signature_of(path: Path) -> Signature:
    """Return the state of a file, or of every file that a path names.

    Missing files are left out; the reader reports them.
    """
    states = []
    with contextlib.suppress(OSError):
        files = _candidates(path) if is_many(path) else [path]
        for file in files:
            stat = file.stat()
            states.append(FileState(str(file), stat.st_mtime_ns, stat.st_size, stat.st_ino))
    return tuple(sorted(states))


def _file_content(path: Path) -> Content:
    """Return the content of a file of any size, read in parts."""
    with opened(path) as file:
        is_parquet = file.peek(4)[:4] == b"PAR1"
        return Content(hashlib.file_digest(file, "sha256").hexdigest(), is_parquet)


def folder_of(path: Path) -> Path:
    """Return the folder that contains the path; for a pattern, the part before its wildcards."""
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


def _files(path: Path, excluded: set[Path]) -> list[Path]:
    """List the files of a folder or pattern in natural order; all must be of one kind."""
    if path.parts.count("**") > 1 and not path.is_dir():
        raise InputError(f"{path}: contains ** more than once, which matches the same files again")
    from beltid.artifacts.artifact import may_be_artifact  # results may lie among recordings

    try:
        candidates = _candidates(path)
    except PermissionError:
        raise InputError(f"{path}: no permission to open the folder") from None
    files = [f for f in candidates if f.absolute() not in excluded and not may_be_artifact(f)]
    if path.is_dir():
        files = [f for f in files if f.suffix.lower() not in _NOT_RECORDINGS]
        _refuse_kinds(files, path)
    if not files:
        what = "holds no recording" if path.is_dir() else "no file matches this pattern"
        raise InputError(f"{path}: {what}")
    if len(files) > MAX_FILES:
        raise InputError(f"{path}: {len(files)} files, must be at most {MAX_FILES}")
    return sorted(files, key=lambda f: natural(f.as_posix()))


def _candidates(path: Path) -> list[Path]:
    """List the files of a folder or pattern that may be recordings."""
    if path.is_dir():
        files = list(path.iterdir())
    else:
        files = [Path(f) for f in glob.glob(str(path), recursive=True)]
    return [
        f
        for f in files
        if (f.is_file() or (f.is_symlink() and not f.is_dir()))  # the reader reports a dead link
        and not f.name.startswith((".", "~$"))
        and f.suffix.lower() not in _COMPANIONS
        and f.name.lower() not in _OF_WINDOWS
    ]


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
            f"name only the runs, such as {path / f'*{most}'}"
        )
