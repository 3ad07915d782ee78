"""The files that a path names: one file, or one per run in a folder, pattern or zip file."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath
from typing import Final

from beltid.bench.packed import format_of, members, natural, refuse_kinds, unpack
from beltid.errors import InputError
from beltid.store.disk import MAX_BYTES, opened, sha256

_NOT_RECORDINGS: Final = frozenset({".yaml", ".yml", ".md", ".json", ".html", ".pdf", ".png"})
_COMPANIONS: Final = frozenset({".tdms_index", ".lnk", ".db", ".ini"})


@dataclass(frozen=True, slots=True)
class Source:
    """One file of a recording."""

    name: str  # for messages
    path: Path  # the file, or the zip file that holds it
    inside: PurePath  # path within the folder or zip file; for a single file its name
    member: str = ""  # its name in the zip file, "" if it is in none

    @contextlib.contextmanager
    def plain(self) -> Iterator[tuple[Path, str]]:
        """Give the file and its format; a packed one is unpacked to a temporary file."""
        path, member = self.path, self.member
        form = "zip" if member else format_of(path, self.inside.name)
        packed = tempfile.TemporaryDirectory(prefix="beltid-") if form in ("gzip", "zip") else None
        with packed or contextlib.nullcontext("") as folder:  # a plain file needs none
            if packed:
                path = Path(folder) / "recording"
                unpack(self.path, path, self.name, member)
                form = format_of(path, self.inside.name.removesuffix(".gz"))
            if form in ("gzip", "zip"):
                raise InputError(f"{self.name}: is packed twice, unpack it")
            if path.stat().st_size > MAX_BYTES:
                raise InputError(f"{self.name}: larger than {MAX_BYTES >> 20} MB, split it")
            if not path.stat().st_size:
                raise InputError(f"{self.name}: the file is empty")
            yield path, form


def is_many(path: Path) -> bool:
    """Return whether a path names several files: a folder or a pattern."""
    return path.is_dir() or (not path.exists() and glob.has_magic(str(path)))


def exists(path: Path) -> bool:
    """Return whether the file or folder exists, or any file matches the pattern."""
    return path.exists() or (glob.has_magic(str(path)) and any(glob.iglob(str(path))))


def sources_of(path: Path, besides: Sequence[Path] = ()) -> list[Source]:
    """List the files that a file, zip file, folder or pattern names, without those `besides`."""
    if is_many(path):
        root = path if path.is_dir() else folder_of(path)
        files = _files(path, {b.absolute() for b in besides})
        return [Source(_shown(f), f, PurePath(_shown(f.relative_to(root)))) for f in files]
    name = _shown(path)
    if format_of(path) != "zip":
        return [Source(name, path, PurePath(path.name))]
    packed = members(path, name)
    shown = [f"{name}/{member}" if len(packed) > 1 else name for member in packed]
    return [Source(s, path, PurePosixPath(m), m) for s, m in zip(shown, packed, strict=True)]


def _shown(path: PurePath) -> str:
    """Return a path as text for messages and labels; bytes that are not UTF-8 become U+FFFD."""
    return str(path).encode(errors="surrogateescape").decode(errors="replace")


def content_of(path: Path, besides: Sequence[Path] = ()) -> str:
    """Return the checksum of a file, or of names and contents of several without `besides`."""
    if not is_many(path):
        with opened(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    sources = sources_of(path, besides)
    lines = [f"{s.inside.as_posix()}\0{content_of(s.path)}\n" for s in sources]
    return sha256("".join(lines).encode(errors="surrogateescape"))


def folder_of(path: Path) -> Path:
    """Return the folder that contains the path; for a pattern, the part before its wildcards."""
    if path.exists():
        return path.parent
    return next((p for p in path.parents if not glob.has_magic(str(p))), Path())


def _files(path: Path, excluded: set[Path]) -> list[Path]:
    """List the files of a folder or pattern in natural order; those of a folder are of one kind."""
    from beltid.store.artifact import may_be_artifact  # results may lie among recordings

    try:
        candidates = _candidates(path)
    except PermissionError:
        raise InputError(f"{path}: no permission to open the folder") from None
    files = [f for f in candidates if f.absolute() not in excluded and not may_be_artifact(f)]
    if path.is_dir():
        files = [f for f in files if f.suffix.lower() not in _NOT_RECORDINGS]
        refuse_kinds(files, str(path))
    if not files:
        what = "holds no recording" if path.is_dir() else "no file matches this pattern"
        raise InputError(f"{path}: {what}")
    return sorted(files, key=lambda f: natural(f.as_posix()))


def _candidates(path: Path) -> list[Path]:
    """List the files of a folder or pattern that may be recordings."""
    found = path.iterdir() if path.is_dir() else map(Path, glob.glob(str(path)))
    return [
        f
        for f in found
        if (f.is_file() or (f.is_symlink() and not f.is_dir()))  # the reader reports a dead link
        and not f.name.startswith((".", "~$"))
        and f.suffix.lower() not in _COMPANIONS
    ]
