"""Compile the kernels of the rig by a first call; ``python -m`` may do it ahead of use."""

from __future__ import annotations

import functools


@functools.cache
def compiled() -> None:
    """Compile the kernels unless the cache has them."""
