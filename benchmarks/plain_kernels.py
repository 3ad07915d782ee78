"""A plugin of pytest that leaves the kernels uncompiled, so that their branches can be followed.

python -m pytest -p benchmarks.plain_kernels tests/rigsim/test_coarse_mesh.py
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from beltid.rigsim import compiled


def _as_it_is(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


# before any module with kernels is imported
compiled.kernel = _as_it_is  # type: ignore[assignment]
compiled.leaf = compiled.shared_leaf = compiled.part = _as_it_is  # type: ignore[assignment]
