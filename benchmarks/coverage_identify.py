"""Do the 95 % intervals of the identification hold? ``python -m benchmarks.coverage_identify``.

Synthetic recordings with a known answer are reduced many times over; docs/coverage.md
tells in which part of them the interval ``value ± 1.96 se`` contains it. ``--cases`` and ``--n``
choose a part, which is printed; only the whole study writes the page.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, chi2

from beltid.identify.friction.reduction import reduce_runs
from beltid.identify.press.stiffness import StiffnessSettings, fit_stiffness

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "identify"))

from press_bench import Bench, read  # noqa: E402
from virtual_rig import CASES, RADIUS_M, Drawn, draw  # noqa: E402

PAGE = ROOT / "docs" / "coverage.md"
NOISE_N = 0.5
"""Noise of the load cells in rigdata [N]."""
BENCHES = {1: 40, 5: 12, 20: 8, 120: 6}
"""Numbers of runs that are reduced together, and benches of so many that are drawn."""
BEYOND = 0.025
"""Chance that a row exactly at a limit is listed as outside."""

Array = NDArray[np.float64]
Columns = dict[str, Any]
Row = tuple[str, list[tuple[Array, Array]]]

INTRODUCTION = """# Coverage of the identification's intervals

Written by `python -m benchmarks.coverage_identify` ({seconds:.0f} s). All recordings
are **synthetic**, with a known answer. *Covered* is the part of the intervals `value ± 1.96 se`
that contain it, 95 % if the standard errors are exact; *z* is the root mean square of error over
standard error, 1 if they are; below 1 they are too large, which is the safe side. Errors and
standard errors are relative to the true value.

What the runs of a bench share (the shape of the tails, the noise, the cells) is known the better,
the more of them are reduced together: *n* is their number. {benches} are
drawn for each case, each with new noise, a new choice of settings and a new draw of what is wrong
with it (sign, phase, size), and reduced by itself. Runs of one bench share errors: all of their
intervals may hold or fail together. With r the correlation of the squares (error / se)² of two runs
of a bench, as the draws show it, R runs in benches of n tell as much about *covered* and *z* as
R/(1 + (n - 1) r) independent ones: *worth*. *Kept* are the runs that were not set aside. The
recordings of `rigdata` are one bench each, so their own noise is drawn only once. A bench whose
fault no recording can show is marked `*`: no interval can allow for it, it has to be stated in
`uncertainty:`.

"""
LIMITS = """Stated limits: for n >= 20, coverage of 90 to 99 % and z from 0.6 to 1.2; for less,
coverage of at least 88 % and z of at most 1.25; a median standard error of at most 2.5 times the
RMS error. A row is listed if what was found is beyond a limit by more than chance allows: a bench
exactly at the limit would be as far beyond it in 2.5 % of such studies (binomial for the coverage,
chi-square for z and the RMS error, with as many degrees of freedom as the row is *worth*).

"""


@dataclass(frozen=True)
class Measured:
    """Errors of mu_sliding of the runs of a bench that were kept, relative to the truth."""

    name: str
    n: int
    error: Array
    se: Array
    bench: Array
    """Number of the bench of every run."""
    n_runs: int
    """Runs that have a sliding value."""
    n_false: int
    """Runs kept that have none."""

    @property
    def coverage(self) -> float:
        return float(np.mean(np.abs(self.error) < 1.96 * self.se))

    @property
    def z(self) -> float:
        return float(np.sqrt(np.mean((self.error / self.se) ** 2)))

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def worth(self) -> float:
        """Independent intervals that tell as much, by the correlation within benches."""
        away = (self.error / self.se) ** 2
        away = away - np.mean(away)
        squares, count = (
            np.bincount(self.bench, weight) for weight in (away**2, np.ones(away.size))
        )
        pairs = np.sum(count * (count - 1.0))
        if not pairs:
            return float(away.size)
        if np.count_nonzero(count) == 1:
            return 1.0  # one bench does not tell
        between = np.sum(np.bincount(self.bench, away) ** 2 - squares) / pairs
        r = float(np.clip(between / np.mean(away**2), 0.0, 1.0))
        # runs of benches of unlike sizes count by the mean size of the bench of a run
        return away.size / (1.0 + (np.sum(count**2) / away.size - 1.0) * r)

    def outside(self) -> list[str]:
        """What exceeds the stated limits by more than its sampling error allows."""
        if not self.error.size:
            return []
        low, high, least, most = (0.9, 0.99, 0.6, 1.2) if self.n >= 20 else (0.88, 1.0, 0.0, 1.25)
        worth, held = self.worth, self.coverage * self.worth
        # bounds of what may be the true coverage (Clopper and Pearson), z and RMS error
        at_least = beta.ppf(BEYOND, held, worth - held + 1.0) if held > 0.0 else 0.0
        at_most = beta.isf(BEYOND, held + 1.0, worth - held) if held < worth else 1.0
        smaller, larger = (np.sqrt(worth / chi2.ppf(p, worth)) for p in (1.0 - BEYOND, BEYOND))
        found = []
        if at_most < low or at_least > high:
            found.append(f"covered {100 * self.coverage:.1f} %")
        if self.z * larger < least or self.z * smaller > most:
            found.append(f"z {self.z:.2f}")
        if np.median(self.se) > 2.5 * self.rms * larger:
            found.append(f"se {np.median(self.se) / self.rms:.1f} times the error")
        return found


@cache
def benches() -> dict[str, Callable[[int, int], Drawn]]:
    """Draws n runs with a seed, for every bench by its name."""
    found: dict[str, Callable[[int, int], Drawn]] = {}
    for name, case in CASES.items():
        found[name + ("" if case.visible else " *")] = partial(draw, case)
    for belt in ("4pk", "5pk", "6pk"):
        for factor in (1, 4):
            found[f"rigdata/{belt}, noise x {factor}"] = partial(_draw_rigdata, belt, factor)
    return found


def _draw_rigdata(belt: str, factor: int, n: int, seed: int) -> Drawn:
    """n runs of a virtual bench recording, with noise added."""
    recorded, true = _recording(belt), _truth(belt)
    rng = np.random.default_rng([seed, factor])
    chosen = np.sort(rng.permutation(true["mu_app"].size)[:n])
    rows = np.isin(recorded["run"], true["run"][chosen])
    columns = {name: values[rows].copy() for name, values in recorded.items()}
    for name in ("tension_tight_N", "tension_slack_N"):
        more = NOISE_N * np.sqrt(factor**2 - 1.0)
        columns[name] += more * rng.normal(size=columns[name].size)
    mu, initial, arc, omega = (true[name][chosen] for name in ("mu_app", "T0", "arc_deg", "omega"))
    return Drawn(columns, mu, initial, arc, omega)


@cache
def _recording(belt: str) -> Columns:
    return read(ROOT / "rigdata" / belt / "rig.csv")


@cache
def _truth(belt: str) -> Columns:
    return read(ROOT / "tests" / "truth" / belt / "truth.csv")


def measure(task: tuple[str, int, int]) -> Measured:
    """Reduce so many benches of n runs of a case."""
    name, n, n_benches = task
    if name.endswith("noise x 1"):
        n_benches = max(min(n_benches, 120 // n), 1)  # one recording of 120 runs
    parts = []
    for seed in range(n_benches):
        drawn = benches()[name](n, seed)
        runs = reduce_runs(drawn.columns, RADIUS_M)
        found = [(run.mu_sliding, run.mu_sliding_se, run.ok, seed) for run in runs]
        parts.append(np.column_stack([drawn.mu, np.array(found, dtype=float)]))
    true, mu, se, ok, bench = np.concatenate(parts).T
    real, ok = np.isfinite(true), ok.astype(bool)
    kept = real & ok
    return Measured(
        name,
        n,
        (mu / true - 1.0)[kept],
        (se / true)[kept],
        bench[kept].astype(int),
        int(np.count_nonzero(real)),
        int(np.count_nonzero(ok & ~real)),
    )


def measure_all(tasks: list[tuple[str, int, int]], jobs: int) -> Iterator[Measured]:
    """The tasks' results in their order, on so many processes."""
    if jobs == 1:
        yield from map(measure, tasks)
        return
    with get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap(measure, tasks)


def friction_tables(results: Iterable[Measured]) -> str:
    """One table for every n and one of what is outside the limits, printed while it is made."""
    head = ["case", "covered [%]", "z", "RMS error [%]", "median se [%]", "kept", "worth"]
    tables: dict[int, list[str]] = {}
    outside = []
    for m in results:
        lines = tables.setdefault(m.n, [f"| {' | '.join(head)} |", "|---" * len(head) + "|"])
        cells = [m.name]
        if m.error.size:
            numbers = (100 * m.coverage, m.z, 100 * m.rms, 100 * float(np.median(m.se)))
            cells += [
                f"{x:{f}}" for x, f in zip(numbers, (".1f", ".2f", ".3g", ".3g"), strict=True)
            ]
        else:
            cells += ["", "", "", ""]
        cells.append(f"{m.error.size} of {m.n_runs}")
        if m.n_false:
            cells[-1] += f", {m.n_false} without a sliding value"
        cells.append(f"{m.worth:.0f}" if m.error.size else "")
        lines.append(f"| {' | '.join(cells)} |")
        print(f"n = {m.n:3d} {lines[-1]}", flush=True)
        if m.outside():
            outside.append(f"| {m.name} | {m.n} | {', '.join(m.outside())} |")
    text = "### Outside the limits\n\n" + LIMITS
    text += "\n".join(["| case | n | found |", "|---|---|---|", *outside]) + "\n"
    for n, lines in sorted(tables.items()):
        text += f"\n### n = {n}\n\n" + "\n".join(lines) + "\n"
    return text


def press_cases() -> dict[str, Bench]:
    """Synthetic presses."""
    return {
        "as rigdata": Bench(),
        "no hysteresis": Bench(hysteresis="none"),
        "hysteresis in proportion to the force": Bench(hysteresis="relative"),
        "hysteresis at low force": Bench(hysteresis="skew"),
        "ten times the noise": Bench(force_noise=1.5, travel_noise=2e-7),
        "a tenth of the noise": Bench(force_noise=0.015, travel_noise=2e-9),
        "long way to contact": Bench(toe=6e-5),
        "zero of the load cell off by 3 N": Bench(zero=3.0),
        "compliance of the machine, known": Bench(compliance=1.5e-8),
        "three cycles, one test": Bench(cycles=3, temperatures=(22.0,)),
        "nearly linear": Bench(k_linear=2e8, k_quadratic=1e10),
        "nearly pure quadratic": Bench(k_linear=5e6, k_quadratic=5e11),
    }


def press_rows(n_tests: int) -> Iterator[Row]:
    """Errors and standard errors of both coefficients, relative, for every case."""
    for name, press in press_cases().items():
        settings = StiffnessSettings(press.length, 22.0, press.compliance)
        laws = [fit_stiffness(press.record(seed), settings).pooled for seed in range(n_tests)]
        linear = np.array([(a.k_linear_N_m2, a.k_linear_se_N_m2) for a in laws]).T
        quadratic = np.array([(a.k_quadratic_N_m3, a.k_quadratic_se_N_m3) for a in laws]).T
        yield (
            name,
            [
                (value / true - 1.0, se / true)
                for (value, se), true in (
                    (linear, press.k_linear),
                    (quadratic, press.k_quadratic),
                )
            ],
        )


def table(rows: Iterator[Row], quantities: tuple[str, ...]) -> str:
    """A table of the coverage, printed while it is made."""
    head = ["case", "repetitions"]
    for quantity in quantities:
        head += [f"{quantity} covered [%]", "z", "RMS error [%]"]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for name, found in rows:
        cells = [name, f"{found[0][0].size}"]
        for error, se in found:
            z = error / se
            cells += [
                f"{100 * np.mean(np.abs(z) < 1.96):.1f}",
                f"{np.sqrt(np.mean(z**2)):.2f}",
                f"{100 * np.sqrt(np.mean(error**2)):.3g}",
            ]
        lines.append(f"| {' | '.join(cells)} |")
        print(lines[-1], flush=True)
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the study and write the page, or print a part of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--cases", nargs="*", help="only benches of friction with one of these in their name"
    )
    parser.add_argument("--n", type=int, nargs="*", help="runs reduced together")
    parser.add_argument("--benches", type=int, help="benches for each case and n")
    parser.add_argument("--tests", type=int, default=150, help="repetitions of each press")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--out", type=Path, help=f"page to write, default {PAGE.name} if all is run"
    )
    chosen = parser.parse_args()
    begin = time.perf_counter()
    names = list(benches())
    if chosen.cases:
        names = [name for name in names if any(part in name for part in chosen.cases)]
    tasks = [
        (name, n, chosen.benches or BENCHES.get(n, 8))
        for name in names
        for n in chosen.n or BENCHES
    ]
    whole = tasks == [(name, n, k) for name in benches() for n, k in BENCHES.items()]
    parts = [
        "## mu_sliding, n runs of one bench reduced together\n\n"
        + friction_tables(measure_all(tasks, chosen.jobs))
    ]
    if whole:
        parts.append(
            "## Stiffness, pooled law\n\n"
            + table(press_rows(chosen.tests), ("k_linear", "k_quadratic"))
        )
    seconds = time.perf_counter() - begin
    drawn = ", ".join(f"{k} benches of {n}" for n, k in BENCHES.items())
    text = INTRODUCTION.format(seconds=seconds, benches=drawn) + "\n".join(parts)
    page = chosen.out or (PAGE if whole else None)
    if page is None:
        print(text)
    else:
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
