"""The bytes of an input file, with a message for everything that can be wrong with it."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from io import BufferedReader
from pathlib import Path
from typing import Final

from beltid.errors import InputError

MAX_BYTES: Final = 1 << 30


@contextlib.contextmanager
def opened(path: Path, error_type: type[InputError] = InputError) -> Iterator[BufferedReader]:
    """Open a file to be read; whatever is wrong then or while it is read is an `error_type`."""
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # it may wait, or never end
            raise error_type(
                f"{path}: is a pipe or a device, a file is needed; - in its place is stdin"
            )
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
    """All bytes of a file.

    Parameters
    ----------
    path : Path
        The file.
    error_type : type
        Error to raise.

    Raises
    ------
    InputError
        If the file is missing, a folder, may not be read, or is too large.
    """
    with opened(path, error_type) as file:
        size = os.fstat(file.fileno()).st_size  # 0 for what the system makes up, as in /proc
        if size > MAX_BYTES:
            raise error_type(_too_large(path))
        data = file.read((size or MAX_BYTES) + 1)
    if len(data) > MAX_BYTES:
        raise error_type(_too_large(path))
    if not data:
        raise error_type(f"{path}: the file is empty")
    return data
