"""Measure everything, print it and write RESULTS.md: ``python -m benchmarks.bench``."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from benchmarks import report
from benchmarks.inverse_problem import measure_inverse
from benchmarks.start_up import measure_start_up
from benchmarks.steady_state import compare_steady
from benchmarks.streaming import measure_streaming, table_of
from benchmarks.transient_runs import compare_transient, measure_growth, peak_memory

SEASON_MB = 2000.0
"""Size of a CSV recording: what is done once counts little."""
RESULTS = Path(__file__).with_name("RESULTS.md")

INTRODUCTION = """# Benchmarks

Written by `make bench`; every figure comes from one run on one machine.

{machine}- one thread unless said otherwise, its processor time; {rounds} rounds in which all take
  turns, the best time of each counts; after warm-up; other work on the machine in the meantime is
  possible

## Work

EA 1e5 N, EI 0.02 N m², 0.10 kg/m, ends pinned, span 0.10 m, R 0.05 m, linear normal law 1e8 N/m²,
mu 0.5; arcs 40, 68, 82°, T0 in 8 steps 100 to 450 N, omega 0.1, 0.2, 0.5, 1, 2 rad/s: 120 runs.
Building the model and tightening to T0 are counted. The worst error of the apparent mu over all
runs is taken against beltid with 200 elements (constant mu and surface each against their own).

- *alone*: each run by itself; model built, belt laid on, tightened, slid
- *shared*: as one works through 120 runs; runs that differ only in speed share the belt laid on
  (beltid: `campaign`; Exudyn: one model for each arc, its parameters changed)
- *surface*: a mu(f_N, v) of 8 x 5 nodes in place of the constant (beltid only; Exudyn's time is
  that with constant mu)
- The ratios take the coarsest mesh of beltid that is as accurate as asked. *Alone / alone* and
  *shared / shared* compare like with like; *Exudyn alone / shared* sets a campaign of beltid
  against Exudyn with each run by itself.
- *plain* Exudyn: uniform mesh, full Newton, tolerance 1e-8, as in the comparison that the targets
  were set for (quoted, not measured here: 0.46 s and 0.10 %, 0.98 s and 0.017 %).
- *tuned* Exudyn: graded mesh, modified Newton, tolerance 1e-4, among the fastest of some 120
  settings tried.
- Exudyn in both: EigenSparse, the build without range checks, initial contact seeded from the
  elastic-bed length, contact segments only where the belt can touch, iterations of the contact
  set raised from 5 to 15 (with the default some runs of the fine mesh are wrong by 0.7 %).

The models differ in one point: in Exudyn the belt is tightened by moving support A under the load
T0 and locking it, in beltid the supports stay in place and the stress-free length is found.
"""

STREAMING = """Synthetic recordings, all cores for both. pyarrow reads the whole file into memory;
fit-friction hashes it, reads it run by run, reduces every run and writes the artifact; the time of
an empty call is taken off. What a run costs beyond its samples shows in the shorter runs.

"""


def main() -> int:
    """Run all benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=8, help="rounds of each comparison")
    rounds = parser.parse_args().rounds
    start = time.perf_counter()
    steady = compare_steady(rounds)
    transient = compare_transient(max(2, rounds // 3))
    growth = measure_growth(max(2, rounds // 3))
    peaks = peak_memory()
    start_up = measure_start_up(2 * rounds + 1)
    inverse = measure_inverse(rounds)
    streamed = measure_streaming(SEASON_MB)
    targets = [
        *report.steady_targets(steady),
        *report.transient_targets(transient),
        *report.growth_targets(growth, peaks),
        *report.start_up_targets(start_up),
        *report.inverse_targets(inverse),
        *report.streaming_targets(streamed),
    ]
    memory = report.table(
        ("time steps", "peak memory"), [(str(n), f"{kB:.0f} kB") for n, kB in peaks.items()]
    )
    parts = [
        INTRODUCTION.format(machine=report.machine(), rounds=rounds),
        "## Targets\n\n" + report.targets_table(targets),
        "## Limit of full sliding\n\n" + report.steady_section(steady),
        "## Runs in time\n\n" + report.transient_section(transient),
        "## Growth with the mesh\n\n" + report.growth_section(growth),
        "## Memory of a run in time\n\n" + memory,
        "## First call\n\n" + report.start_up_section(start_up),
        "## Inverse problem\n\n" + report.inverse_section(inverse),
        "## Big recordings\n\n" + STREAMING + table_of(streamed),
    ]
    text = "\n".join(parts)
    RESULTS.write_text(text.rstrip() + "\n", encoding="utf-8")
    print(text)
    print(f"{time.perf_counter() - start:.0f} s; written to {RESULTS.name}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
