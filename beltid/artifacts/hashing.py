"""SHA-256 of bytes and of tables."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np


def sha256(data: bytes | memoryview) -> str:
    """SHA-256 of some bytes, as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def columns_sha256(columns: Mapping[str, np.ndarray]) -> str:
    """SHA-256 of the names, types and values of the columns of a table, in their order.

    Missing numbers hash alike whatever kind of nan stands for them; numbers hash by their bits in
    little-endian order, so the hash is the same on every machine.

    Parameters
    ----------
    columns : mapping of str to ndarray
        float64, int64 or bool arrays, 1-D or 2-D, or object arrays of str or None.
    """
    digest = hashlib.sha256()
    for name, values in columns.items():
        digest.update(f"{name}\0{values.dtype.kind}{values.shape}\0".encode())
        digest.update(_bytes(values))
    return digest.hexdigest()


def _bytes(values: np.ndarray[Any, Any]) -> bytes:
    if values.dtype.kind == "O":
        cells = [b"\0" if cell is None else b"\1" + str(cell).encode() for cell in values]
        return b"".join(len(cell).to_bytes(8, "little") + cell for cell in cells)
    if values.dtype.kind == "f":
        clean = np.where(np.isnan(values), np.nan, values)
        return clean.astype("<f8").tobytes()
    if values.dtype.kind == "b":
        return values.astype("u1").tobytes()
    return values.astype("<i8").tobytes()
