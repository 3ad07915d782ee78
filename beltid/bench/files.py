"""Files of a recording: those that a path names, their format by their bytes, what is packed."""

import codecs
import contextlib
import glob
import gzip
import hashlib
import re
import tempfile
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath

from beltid.errors import InputError
from beltid.store.disk import MAX_BYTES, opened, sha256

MAX_FILES = 5000
_SIGNATURES = (
    (rb"PAR1", "parquet"),
    (rb"\x1f\x8b", "gzip"),
    (rb"TDSm", "tdms"),
    (rb"MDF     |UnFinMF ", "mdf"),
    (rb"(?s:.{512})?\x89HDF\r\n\x1a\n", "hdf5"),  # MATLAB 7.3 puts its own header first
    (rb"MATLAB 5.0 MAT-file|(?s:.{124})(?:\x00\x01IM|\x01\x00MI)", "mat"),
    (rb"(?:\xef\xbb\xbf)?LabVIEW Measurement", "lvm"),
    (rb"PK\x03\x04|PK\x05\x06", "zip"),
    (rb"\s*-1[ \t]*\r?\n[ \t]{0,6}\d{1,5}[bB]?[ \t\r\n]", "uff"),  # -1, the number of a dataset
)
_NOT_RECORDINGS = frozenset({".yaml", ".yml", ".md", ".json", ".html", ".pdf", ".png"})
_COMPANIONS = frozenset({".tdms_index", ".lnk", ".db", ".ini"})


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
        path, form, larger = self.path, "zip" if self.member else format_of(self.path), "larger"
        with contextlib.ExitStack() as held:
            if form in ("gzip", "zip"):
                folder = held.enter_context(tempfile.TemporaryDirectory(prefix="beltid-"))
                path, larger = Path(folder) / "recording", "unpacks to more"
                self._unpack(path)
                form = format_of(path)
            if form in ("gzip", "zip"):
                raise InputError(f"{self.name}: is packed twice, unpack it")
            if path.stat().st_size > MAX_BYTES:
                raise InputError(f"{self.name}: {larger} than {MAX_BYTES >> 20} MB, split it")
            yield path, form

    def _unpack(self, out: Path) -> None:
        """Unpack the file in parts, up to a limit."""
        try:
            with opened(self.path) as file, out.open("wb") as target:
                archive = zipfile.ZipFile(file) if self.member else None
                packed = archive.open(self.member) if archive else gzip.GzipFile(fileobj=file)
                while target.tell() <= MAX_BYTES and (part := packed.read(1 << 22)):
                    target.write(part)
        except InputError:
            raise
        except Exception:  # each compression method raises its own errors
            what = f"{self.member} in the zip file" if self.member else "the gzip file"
            raise InputError(f"{self.name}: {what} is damaged or cut off") from None


def is_many(path: Path) -> bool:
    """Return whether a path names several files: a folder or a pattern."""
    return path.is_dir() or (not path.exists() and glob.has_magic(str(path)))


def sources_of(path: Path, besides: Sequence[Path] = ()) -> list[Source]:
    """List the files that a file, zip file, folder or pattern names, without those `besides`."""
    name = _shown(path)
    if is_many(path):
        root = path if path.is_dir() else folder_of(path)
        files = _files(path, {b.absolute() for b in besides})
        return [Source(_shown(f), f, PurePath(_shown(f.relative_to(root)))) for f in files]
    if format_of(path) != "zip":
        return [Source(name, path, PurePath(path.name))]
    packed = _members(path, name)
    inside = "/{}" if len(packed) > 1 else ""
    return [Source(name + inside.format(m), path, PurePosixPath(m), m) for m in packed]


def _shown(path: PurePath) -> str:
    """Return a path as text for messages and labels; bytes that are not UTF-8 become U+FFFD."""
    return str(path).encode(errors="surrogateescape").decode(errors="replace")


def content_of(path: Path, besides: Sequence[Path] = ()) -> str:
    """Return the checksum of a file, or of names and contents of several without `besides`."""
    if is_many(path):
        lines = (
            f"{s.inside.as_posix()}\0{content_of(s.path)}\n" for s in sources_of(path, besides)
        )
        return sha256("".join(lines).encode(errors="surrogateescape"))
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def folder_of(path: Path) -> Path:
    """Return the folder that contains the path; for a pattern, the part before its wildcards."""
    if path.exists():
        return path.parent
    return next((p for p in path.parents if not glob.has_magic(str(p))), Path())


def _files(path: Path, excluded: set[Path]) -> list[Path]:
    """List the files of a folder or pattern in natural order; those of a folder are of one kind."""
    from beltid.store.artifact import may_be_artifact  # results may lie among recordings

    ignored = _COMPANIONS | _NOT_RECORDINGS if path.is_dir() else _COMPANIONS
    what = "holds no recording" if path.is_dir() else "no file matches this pattern"
    try:
        files = [
            f
            for f in (path.iterdir() if path.is_dir() else map(Path, glob.glob(str(path))))
            if not f.is_dir()
            and (f.is_file() or f.is_symlink())  # the reader reports a dead link
            and not f.name.startswith((".", "~$"))
            and f.suffix.lower() not in ignored
            and f.absolute() not in excluded
            and not may_be_artifact(f)
        ]
    except PermissionError:
        raise InputError(f"{path}: no permission to open the folder") from None
    if not files:
        raise InputError(f"{path}: {what}")
    if path.is_dir():
        _refuse_kinds(files, str(path))
    return sorted(files, key=lambda f: _natural(f.as_posix()))


def _members(path: Path, shown: str) -> list[str]:
    """Return the names of the files in a zip file in natural order; they are of one kind."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [e.filename for e in archive.infolist() if not e.is_dir()]
    except Exception:  # a damaged file can raise nearly anything
        raise InputError(f"{shown}: the zip file is damaged or cut off") from None
    own = [n for n in names if PurePosixPath(n).name[0] != "." and not n.startswith("__MACOSX/")]
    if not own:
        raise InputError(f"{shown}: the zip file is empty")
    _refuse_kinds([PurePosixPath(name) for name in own], shown)
    return sorted(own, key=_natural)


def _refuse_kinds(files: Sequence[PurePath], place: str) -> None:
    """Refuse files that are too many, or of several kinds."""
    endings = ("".join(f.suffixes[-2:]) if f.suffix == ".gz" else f.suffix for f in files)
    if len(kinds := Counter(map(str.lower, endings))) > 1:
        shown = ", ".join(f"{n} {ending or 'without ending'}" for ending, n in kinds.items())
        raise InputError(
            f"{place}: holds files of several kinds ({shown}); name only the runs, such as "
            f"{PurePath(place, '*' + kinds.most_common(1)[0][0])}"
        )
    if len(files) > MAX_FILES:
        raise InputError(f"{place}: {len(files)} files, must be at most {MAX_FILES}")


def _natural(name: str) -> tuple[tuple[int, str], ...]:
    """Return a sort key that puts run2 before run10."""
    parts = re.split(r"([0-9]{1,18})", name)  # int() sees digits only
    return tuple((int(p), "") if i % 2 else (-1, p) for i, p in enumerate(parts) if p)


# --- bytes ----------------------------------------------------------------------------------------


def format_of(path: Path) -> str:
    """Return the format of a file, from its bytes: "text", "parquet", "gzip", "zip", "lvm", ..."""
    with opened(path) as file:
        head = file.read(1024)
    form = next((form for sign, form in _SIGNATURES if re.match(sign, head)), "text")
    data = path.read_bytes() if form == "zip" else b""  # also of a damaged archive
    return "excel" if b"xl/workbook" in data or b"xl/worksheets" in data else form


def as_utf8(data: bytearray, place: str, stated: str | None) -> tuple[bytearray, str, list[str]]:
    """Return a text as UTF-8 with single line feeds, its encoding, and notes."""
    notes, encoding = list[str](), (stated or "utf-8").lower()
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif data.startswith(codecs.BOM_UTF8):  # the mark overrides the config
        encoding, data = "utf-8", data[3:]
    if encoding != "utf-8" or not data.isascii():
        try:
            data = bytearray(data.decode(encoding).encode())
        except UnicodeDecodeError as error:
            if stated or re.search(rb"[\x80-\x9f]", data) or b"\0" in data:
                is_no = stated or "UTF-8; if it is of Windows, set dialect: {encoding: cp1252}"
                line, byte = data.count(b"\n", 0, error.start) + 1, data[error.start]
                raise InputError(
                    f"{place}:{line}: byte 0x{byte:02X} is not {is_no}; if it is no text, export "
                    "it to CSV"
                ) from None
            # of which cp1252 gives the same text
            data, encoding = bytearray(data.decode("latin-1").encode()), "latin-1"
            notes.append("not UTF-8, read as latin-1")
    if (zero := data.find(0)) >= 0:
        line = data.count(b"\n", 0, zero) + 1
        raise InputError(f"{place}:{line}: holds a zero byte: damaged, or no text")
    if data and data[-1:] not in b"\r\n":
        notes.append("the last line does not end: if the file was cut off, its number is wrong")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data, encoding, notes
