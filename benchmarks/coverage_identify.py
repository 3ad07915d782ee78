"""Do the 95 % intervals of the identification hold? ``python -m benchmarks.coverage_identify``.

Synthetic recordings with a known answer are reduced many times over; docs/coverage_identify.md
tells in which part of them the interval ``value ± 1.96 se`` contains it. ``--cases`` and ``--n``
choose a part, which is printed; only the whole study writes the page.
"""

from __future__ import annotations

import argparse
import csv
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

from beltid.identify.friction.reduction import reduce_runs
from beltid.identify.press.stiffness import StiffnessSettings, fit_stiffness

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "identify"))

from press_bench import Bench  # noqa: E402
from virtual_rig import CASES, RADIUS_M, Drawn, draw  # noqa: E402

PAGE = ROOT / "docs" / "coverage_identify.md"
NOISE_N = 0.5
"""Noise of the load cells in rigdata [N]."""
TOGETHER = (1, 5, 20, 120)
"""Numbers of runs that are reduced together."""

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
the more of them are reduced together: *n* is their number, at least {runs} runs in all for each
case and n. *Kept* are those that were not set aside. A bench whose fault no recording can show is
marked `*`: no interval can allow for it, it has to be stated in `uncertainty:`.

"""
LIMITS = """Stated limits: for n >= 20, coverage of 90 to 99 % and z from 0.6 to 1.2; for less,
coverage of at least 88 % and z of at most 1.25; a median standard error of at most 2.5 times the
RMS error.

"""


@dataclass(frozen=True)
class Measured:
    """Errors of mu_sliding of the runs of a bench that were kept, relative to the truth."""

    name: str
    n: int
    error: Array
    se: Array
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

    def outside(self) -> list[str]:
        """What exceeds the stated limits."""
        if not self.error.size:
            return []
        low, high, least, most = (0.9, 0.99, 0.6, 1.2) if self.n >= 20 else (0.88, 1.0, 0.0, 1.25)
        if self.error.size < 100:
            high = 1.0  # fewer exact intervals than that may all hold by chance
        found = []
        if not low <= self.coverage <= high:
            found.append(f"covered {100 * self.coverage:.1f} %")
        if not least <= self.z <= most:
            found.append(f"z {self.z:.2f}")
        if np.median(self.se) > 2.5 * self.rms:
            found.append(f"se {np.median(self.se) / self.rms:.1f} times the error")
        return found


@cache
def benches() -> dict[str, Callable[[int, int], Drawn]]:
    """Draws n runs with a seed, for every bench by its name."""
    found: dict[str, Callable[[int, int], Drawn]] = {}
    for name, case in CASES.items():
        found[name + ("" if case.visible else " *")] = partial(draw, case)
    for belt in ("4pk", "5pk", "6pk"):
        for factor in (1, 2, 4):
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
    return _read(ROOT / "rigdata" / belt / "rig.csv")


@cache
def _truth(belt: str) -> Columns:
    return _read(ROOT / "tests" / "truth" / belt / "truth.csv")


def _read(path: Path) -> Columns:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        name: np.array([r[name] if name == "run" else float(r[name] or "nan") for r in rows])
        for name in rows[0]
    }


def measure(task: tuple[str, int, int]) -> Measured:
    """Reduce a bench by name, n runs at a time, until it has had so many runs."""
    name, n, n_runs = task
    parts = []
    for seed in range(-(-n_runs // n)):
        drawn = benches()[name](n, seed)
        runs = reduce_runs(drawn.columns, RADIUS_M)
        found = [(run.mu_sliding, run.mu_sliding_se, run.ok) for run in runs]
        parts.append(np.column_stack([drawn.mu, np.array(found, dtype=float)]))
    true, mu, se, ok = np.concatenate(parts).T
    real, ok = np.isfinite(true), ok.astype(bool)
    kept = real & ok
    return Measured(
        name,
        n,
        (mu / true - 1.0)[kept],
        (se / true)[kept],
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
    head = ["case", "covered [%]", "z", "RMS error [%]", "median se [%]", "kept"]
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
    parser.add_argument("--runs", type=int, help="least runs for each case and n")
    parser.add_argument("--tests", type=int, default=150, help="repetitions of each press")
    parser.add_argument(
        "--quick", action="store_true", help="the hard benches at n = 1 and 20, 40 runs"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--out", type=Path, help=f"page to write, default {PAGE.name} if all is run"
    )
    chosen = parser.parse_args()
    begin = time.perf_counter()
    names = list(benches())
    if chosen.quick:
        names = [name for name in names if name.rstrip(" *") in CASES]
        names = [name for name in names if CASES[name.rstrip(" *")].group == "hard"]
    together = chosen.n or ((1, 20) if chosen.quick else TOGETHER)
    n_runs = chosen.runs or (40 if chosen.quick else 120)
    if chosen.cases:
        names = [name for name in names if any(part in name for part in chosen.cases)]
    tasks = [(name, n, n_runs) for name in names for n in together]
    parts = [
        "## mu_sliding, n runs of one bench reduced together\n\n"
        + friction_tables(measure_all(tasks, chosen.jobs))
    ]
    whole = tasks == [(name, n, n_runs) for name in benches() for n in TOGETHER]
    if whole:
        parts.append(
            "## Stiffness, pooled law\n\n"
            + table(press_rows(chosen.tests), ("k_linear", "k_quadratic"))
        )
    seconds = time.perf_counter() - begin
    text = INTRODUCTION.format(seconds=seconds, runs=n_runs) + "\n".join(parts)
    page = chosen.out or (PAGE if whole else None)
    if page is None:
        print(text)
    else:
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
