"""The files of a folder: in the order a person counts, and Parquet files of folders in it."""

from __future__ import annotations

import re
from pathlib import Path


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Key that sorts run2 before run10."""
    parts = re.split(r"([0-9]{1,18})", name)  # int() is for these only
    return tuple((int(p), "") if i % 2 else (-1, p) for i, p in enumerate(parts) if p)


def parquet_files(folder: Path) -> list[Path]:
    """Parquet files of a folder and of the folders in it, in the order of their names."""
    found = (
        path
        for path in folder.rglob("*.parquet")
        if path.is_file()
        and not any(part.startswith((".", "_")) for part in path.relative_to(folder).parts)
    )
    return sorted(found, key=lambda path: natural(path.as_posix()))
