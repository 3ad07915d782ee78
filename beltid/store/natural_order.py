"""The order of names of files as a person counts."""

from __future__ import annotations

import re


def natural(name: str) -> tuple[tuple[int, str], ...]:
    """Key that sorts run2 before run10."""
    parts = re.split(r"([0-9]{1,18})", name)  # int() is for these only
    return tuple((int(p), "") if i % 2 else (-1, p) for i, p in enumerate(parts) if p)
