"""What hangs on a prior: each is doubled in turn, on six rows of the study of coverage.

    python -m benchmarks.priors [--n 20] [--first SEED]

Writes PRIORS.md. A constant of `beltid.identify.friction` is doubled where it stands, the size of a
term of the model of a bench where it is built; the table of docs/theory.md has both, and why.
"""

import argparse
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from beltid.identify.friction import bench_model, prepare, reduction
from beltid.mixed import Own, Shared, Size
from benchmarks import table
from benchmarks.coverage import DRAWS, friction

PAGE = Path(__file__).with_name("PRIORS.md")
ROWS = (
    "one exponential",
    "power law, long tail",
    "AR noise 0.2 s, 0.5 N",
    "zero of the slack cell drifts by 1 N in a run",
    "mu drifts within a run, +1 %",
    "held at rest, 2 %, half reversed",
)
MODULES = (bench_model, prepare, reduction)
CONSTANTS = (
    *("USUAL_M", "POWER", "ZEROS", "RELEASE", "RELAXATION", "DRIFT", "DECAY", "FREE", "FREEDOM"),
    *("CELL_ZEROS", "HELD", "OWN_SIZE", "GAINS", "SETTINGS", "SCATTER", "OUTLIER", "SPIKE"),
    *("MAX_ERROR", "MAX_DRIFT", "MAX_TAIL", "MAX_WAVE", "MAX_MISFIT", "MAX_NOISE_RATIO"),
)
TERMS = (
    *("tail", "white", *(f"memory {tau:g} s" for tau in bench_model.MEMORIES_S[:-1])),
    *("walk", "turn", "own decay", "height", "length", "rest"),
)
INTRODUCTION = """# Priors, doubled

Written by `python -m benchmarks.priors` in {minutes:.0f} minutes; **synthetic** benches of {n}
runs, seed {first}. Of each prior or threshold that is doubled: the RMS error of `mu_sliding` over
that without, the geometric mean of six rows and the row that changes most, and the least share of
intervals that hold the truth. As they stand the errors are, in percent, {errors};
at least {covered:.0f} % of the intervals hold.

"""


def twice(value: Any) -> Any:
    """A prior or threshold of twice the size; its probabilities and its width stay."""
    if isinstance(value, Size):
        return replace(value, median=2.0 * value.median)
    if isinstance(value, tuple):
        return tuple((2.0 * size, chance) for size, chance in value)
    return 2.0 * value


def doubled(name: str) -> Any:
    """A context in which a constant, or the size of a term, is doubled."""
    if name in CONSTANTS:
        (module,) = [one for one in MODULES if hasattr(one, name)]
        return patch.object(module, name, twice(getattr(module, name)))

    def larger(of: type, term: str, *rest: Any, **shape: Any) -> Any:
        more = (twice(x) if term == name and isinstance(x, Size) else x for x in rest)
        return of(term, *more, **shape)

    return patch.multiple(bench_model, **{of.__name__: partial(larger, of) for of in (Own, Shared)})


def study(n: int, first: int) -> np.ndarray:
    """RMS errors of the rows, and shares of intervals that hold [%], (2, rows)."""
    found = [friction(row, n, first) for row in ROWS]
    return np.array([(one.rms, one.covered) for one in found]).T


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=20, choices=list(DRAWS), help="runs of a bench")
    parser.add_argument("--first", type=int, default=100, help="seed of the draws")
    asked, begin = parser.parse_args(), time.perf_counter()
    usual, covered = study(asked.n, asked.first)
    rows = []
    for name in (*CONSTANTS, *TERMS):
        with doubled(name):
            rms, held = study(asked.n, asked.first)
        ratio = rms / usual
        most = int(np.argmax(np.abs(np.log(ratio))))
        mean, worst = np.exp(np.mean(np.log(ratio))), f"{ratio[most]:.2f} {ROWS[most]}"
        rows.append((f"`{name}`", f"{mean:.2f}", worst, f"{held.min():.0f}"))
        print(*rows[-1], flush=True)
    introduction = INTRODUCTION.format(
        minutes=(time.perf_counter() - begin) / 60.0,
        n=asked.n,
        first=asked.first,
        errors=", ".join(f"{error:.3g}" for error in usual),
        covered=covered.min(),
    )
    PAGE.write_text(
        introduction + table(("doubled", "mean", "most", "covered %"), rows), encoding="utf-8"
    )


if __name__ == "__main__":
    main()
