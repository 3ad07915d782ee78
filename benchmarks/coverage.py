"""Do the stated intervals hold the truth? Many virtual campaigns, refined and compared.

    python -m benchmarks.coverage [REPETITIONS]

Each repetition draws errors of the bench (shared by all its runs) and noise of each run, reads the
sliding limit of the simulated rig on its finer mesh with a known surface that is no power law, and
refines the surface from what was read. Table: share of nodes within the forces of the runs, over
all repetitions, whose 95 % interval holds the truth. The same for the coefficients of the press.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS / "uncertainty"), str(TESTS / "identify")]

from press_bench import Bench  # noqa: E402
from virtual_bench import NO_ERRORS, SMALL, Design, repetition  # noqa: E402

from beltid.identify.press.stiffness import StiffnessSettings, fit_stiffness  # noqa: E402

MIDDLE = Design((40.0, 68.0, 82.0), (60.0, 130.0, 220.0, 310.0, 400.0), (0.1, 0.21, 0.42))
CASES = {
    "16 runs, noise 0.3 %, errors of the bench": SMALL,
    "16 runs, noise 0.3 %, noise alone": replace(SMALL, given=NO_ERRORS),
    "45 runs, noise 0.3 %, errors of the bench": MIDDLE,
    "45 runs, noise 0.3 %, noise alone": replace(MIDDLE, given=NO_ERRORS),
    "45 runs, noise 1.2 %, noise alone": replace(MIDDLE, given=NO_ERRORS, noise=0.012),
}
FACTOR = 1.96


def surfaces(repetitions: int) -> Iterator[str]:
    """A row per case."""
    for name, design in CASES.items():
        start = time.perf_counter()
        found = [repetition(design, seed) for seed in range(repetitions)]
        z = np.array([r.error / r.combined for r in found])
        u = 100.0 * np.median([r.combined for r in found])
        rms = 100.0 * np.sqrt(np.mean([r.error**2 for r in found]))
        each = (time.perf_counter() - start) / repetitions
        yield (
            f"| {name} | {repetitions} | {u:.2f} % | {rms:.2f} % "
            f"| {100 * np.mean(np.abs(z) < FACTOR):.0f} % | {each:.1f} s |"
        )


def press(repetitions: int) -> Iterator[str]:
    """The coefficients of the contact law, by the scatter of the press."""
    bench = Bench(dt=0.4)
    truth = np.array([bench.k_linear, bench.k_quadratic])
    settings = StiffnessSettings(segment_length_m=bench.length)
    start, z = time.perf_counter(), []
    for seed in range(repetitions):
        law = fit_stiffness(bench.record(seed), settings).pooled
        k = np.array([law.k_linear_N_m2, law.k_quadratic_N_m3])
        z.append((k - truth) / [law.k_linear_se_N_m2, law.k_quadratic_se_N_m3])
    each = (time.perf_counter() - start) / repetitions
    inside = 100.0 * np.mean(np.abs(np.array(z)) < FACTOR)
    yield f"| coefficients of the press | {repetitions} | | | {inside:.0f} % | {each:.1f} s |"


def main() -> None:
    """Print the table."""
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    print("| case | campaigns | stated u | RMS error | 95 % intervals hold | time each |")
    print("|---|---|---|---|---|---|")
    for row in chain(press(repetitions), surfaces(repetitions)):
        print(row, flush=True)


if __name__ == "__main__":
    main()
