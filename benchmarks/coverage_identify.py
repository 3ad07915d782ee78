"""Do the 95 % intervals of the identification hold? ``python -m benchmarks.coverage_identify``.

Synthetic recordings with a known answer are reduced many times over; docs/coverage_identify.md
tells in which part of them the interval ``value ± 1.96 se`` contains it.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.reduction import reduce_runs
from beltid.identify.press.stiffness import StiffnessSettings, fit_stiffness

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "identify"))

from press_bench import Bench  # noqa: E402
from synthetic_rig import Recipe, bench  # noqa: E402

PAGE = ROOT / "docs" / "coverage_identify.md"
RADIUS_M = 0.05
NOISE_N = 0.5
"""Noise of the load cells in rigdata [N]."""

Array = NDArray[np.float64]
Columns = dict[str, Any]
Row = tuple[str, list[tuple[Array, Array]]]

INTRODUCTION = """# Coverage of the identification's intervals

Written by `python -m benchmarks.coverage_identify` ({seconds:.0f} s on one core,
with other work on the machine). All recordings
are **synthetic**, with a known answer. *Covered* is the part of the intervals `value ± 1.96 se`
that contain it, 95 % if the standard errors are exact; *z* is the root mean square of error over
standard error, 1 if they are; below 1 they are too large, which is the safe side. The errors are
relative to the true value.

A zero that drifts by so little that the noise of a run hides it (0.3 N within a run in the table)
is not allowed for: state it as an uncertainty of the cells.

"""


def _spikes(columns: Columns, rng: np.random.Generator) -> None:
    for name in ("tension_tight_N", "tension_slack_N"):
        hit = rng.random(columns[name].size) < 0.01
        columns[name][hit] += rng.choice([-60.0, 60.0], np.count_nonzero(hit))


def _wandering_tare(columns: Columns, rng: np.random.Generator) -> None:
    runs = columns["run"].astype(int)
    columns["tension_tight_N"] += (1.0 + 0.5 * rng.normal(size=runs.max() + 1))[runs]


def _drifting_zeros(tight: float, slack: float) -> Callable[[Columns, np.random.Generator], None]:
    """Zeros of the cells that move by so many N within the 6 s of a run."""

    def spoil(columns: Columns, rng: np.random.Generator) -> None:
        columns["tension_tight_N"] += tight * columns["time_s"] / 6.0
        columns["tension_slack_N"] += slack * columns["time_s"] / 6.0

    return spoil


def _second_ripple(period_s: float) -> Callable[[Columns, np.random.Generator], None]:
    """Another ripple, of 0.3 % and any phase."""

    def spoil(columns: Columns, rng: np.random.Generator) -> None:
        runs = columns["run"].astype(int)
        phase = rng.uniform(0.0, 2.0 * np.pi, runs.max() + 1)[runs]
        turned = np.maximum(columns["time_s"] - 1.0, 0.0)
        wave = 0.003 * np.sin(2.0 * np.pi * turned / period_s + phase) * (turned > 0.0)
        columns["tension_tight_N"] *= 1.0 + wave
        columns["tension_slack_N"] *= 1.0 + 0.75 * wave

    return spoil


def rig_cases() -> dict[str, tuple[Recipe, Callable[[Columns, np.random.Generator], None] | None]]:
    """Synthetic benches, and what is done to their recordings."""
    base = Recipe()
    slow = base.but(ripple=0.004, ripple_period=1.0 / 0.35)
    return {
        "one exponential": (base, None),
        "one exponential, four times the noise": (base.but(noise=4 * NOISE_N), None),
        "two exponentials": (base.but(shape="two exponentials"), None),
        "two exponentials, four times the noise": (
            base.but(shape="two exponentials", noise=4 * NOISE_N),
            None,
        ),
        "stretched exponential": (base.but(shape="stretched"), None),
        "stretched exponential, a quarter of the noise": (
            base.but(shape="stretched", noise=NOISE_N / 4),
            None,
        ),
        "power law": (base.but(shape="power law"), None),
        "power law, a quarter of the noise": (base.but(shape="power law", noise=NOISE_N / 4), None),
        "power law, long tail": (base.but(shape="power law", tail=1.0), None),
        "no peak": (base.but(peak=0.0), None),
        "correlated noise, 2 samples": (base.but(memory=0.5), None),
        "correlated noise, 5 samples": (base.but(memory=0.8), None),
        "correlated noise, 5 samples, two exponentials": (
            base.but(memory=0.8, shape="two exponentials"),
            None,
        ),
        "correlated noise, 20 samples (0.4 s)": (base.but(memory=0.95), None),
        "slow ripple": (slow, None),
        "strong ripple": (base.but(ripple=0.03), None),
        "spikes in 1 % of the samples": (base, _spikes),
        "tare that wanders from run to run, 1 ± 0.5 N": (base, _wandering_tare),
        "short plateau (1.8 s, tail 0.6 s)": (base.but(duration=3.0), None),
        "short plateau, two exponentials": (
            base.but(duration=3.0, tail=0.3, shape="two exponentials"),
            None,
        ),
        "long plateau (18.8 s), two exponentials": (
            base.but(duration=20.0, shape="two exponentials"),
            None,
        ),
        "low tension (60 N)": (base.but(initial=60.0), None),
        "zero of the tight cell drifts by 1 N in a run": (base, _drifting_zeros(1.0, 0.0)),
        "zero of the tight cell drifts by -1 N in a run": (base, _drifting_zeros(-1.0, 0.0)),
        "zero of the slack cell drifts by 1 N in a run": (base, _drifting_zeros(0.0, 1.0)),
        "zero of the slack cell drifts by -1 N in a run": (base, _drifting_zeros(0.0, -1.0)),
        "both zeros drift by 1 N in a run": (base, _drifting_zeros(1.0, 1.0)),
        "zero of the slack cell drifts by 1 N, no peak": (
            base.but(peak=0.0),
            _drifting_zeros(0.0, 1.0),
        ),
        "zero of the slack cell drifts by 0.3 N in a run": (base, _drifting_zeros(0.0, 0.3)),
        "two ripples, second of 2.1 s": (base, _second_ripple(2.1)),
        "two ripples, second of 4.5 s": (base, _second_ripple(4.5)),
        "ripple of 8 s, longer than the sliding": (base.but(ripple_period=8.0), None),
        "1000 samples per second, quick build-up": (base.but(rate=1000.0, build_up=0.05), None),
    }


def rig_rows(n_runs: int) -> Iterator[Row]:
    """Errors and standard errors of mu_sliding, relative, for every case."""
    for name, (recipe, spoil) in rig_cases().items():
        columns = bench(recipe, n_runs)
        if spoil is not None:
            spoil(columns, np.random.default_rng(1))
        runs = [run for run in reduce_runs(columns, RADIUS_M) if run.ok]
        mu, se = np.array([(run.mu_sliding, run.mu_sliding_se) for run in runs]).T
        yield name, [(mu / recipe.mu - 1.0, se / recipe.mu)]


def rigdata_rows() -> Iterator[Row]:
    """The same for the virtual bench recordings, with noise added."""
    for belt in ("4pk", "5pk", "6pk"):
        recorded = _read(ROOT / "rigdata" / belt / "rig.csv")
        true = _read(ROOT / "tests" / "truth" / belt / "truth.csv")["mu_app"]
        for factor in (1, 2, 4):
            rng = np.random.default_rng(factor)
            columns = dict(recorded)
            for name in ("tension_tight_N", "tension_slack_N"):
                more = NOISE_N * np.sqrt(factor**2 - 1.0)
                columns[name] = recorded[name] + more * rng.normal(size=recorded[name].size)
            runs = reduce_runs(columns, RADIUS_M)
            mu, se = np.array([(run.mu_sliding, run.mu_sliding_se) for run in runs]).T
            good = np.array([run.ok for run in runs])
            yield (
                f"rigdata/{belt}, noise x {factor}",
                [((mu / true - 1.0)[good], (se / true)[good])],
            )


def _read(path: Path) -> Columns:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        name: np.array([r[name] if name == "run" else float(r[name] or "nan") for r in rows])
        for name in rows[0]
    }


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
    """Run the study and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300, help="runs of each synthetic rig")
    parser.add_argument("--tests", type=int, default=150, help="repetitions of each press")
    parser.add_argument("--out", type=Path, default=PAGE)
    chosen = parser.parse_args()
    begin = time.perf_counter()
    parts = [
        "## mu_sliding, the runs of one bench reduced together\n\n"
        + table(rig_rows(chosen.runs), ("mu_sliding",)),
        "## mu_sliding, virtual bench recordings\n\n" + table(rigdata_rows(), ("mu_sliding",)),
        "## Stiffness, pooled law\n\n"
        + table(press_rows(chosen.tests), ("k_linear", "k_quadratic")),
    ]
    text = INTRODUCTION.format(seconds=time.perf_counter() - begin) + "\n".join(parts)
    chosen.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
