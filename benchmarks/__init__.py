"""Benchmarks: the simulated rig against Exudyn and against its own targets, one core per claim."""

import os
from collections.abc import Iterable, Sequence

# before numpy is imported: a claim for one core must not be helped by a threaded library
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = (head, ["---"] * len(head), *rows)
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
