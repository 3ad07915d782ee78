"""Every target of speed in one table: ``python -m benchmarks.bench`` writes RESULTS.md.

With ``--beside PYTHON`` the interpreter of another version of beltid does the same work in turns;
ratios are ours over theirs. Times are processor times of one core unless the target says wall; the
best of the rounds counts, since other work on the machine only adds.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from benchmarks.tasks import TASKS

RESULTS = Path(__file__).with_name("RESULTS.md")
SCRIPT = str(Path(__file__).with_name("tasks.py"))
Found = dict[str, float]
Measured = dict[str, Found]


class Target(NamedTuple):
    """What is asked of the best rounds of the tasks; `beside` is what another version needs."""

    what: str
    asked: str
    value: Callable[[Measured, Measured], float]
    met: Callable[[float], bool]
    needs: tuple[str, ...]
    beside: bool = False


def at_most(limit: float) -> Callable[[float], bool]:
    """Whether a value is not above a limit."""
    return lambda value: value <= limit


def over(task: str, key: str = "seconds") -> Callable[[Measured, Measured], float]:
    """Ours over theirs."""
    return lambda ours, theirs: ours[task][key] / theirs[task][key]


def own(task: str, key: str = "seconds") -> Callable[[Measured, Measured], float]:
    """A value of a task."""
    return lambda ours, _: ours[task][key]


TARGETS = (
    Target(
        "120 steady runs: Exudyn, each run by itself, over beltid's campaign",
        ">= 10",
        lambda ours, _: ours["exudyn"]["seconds"] / ours["steady"]["seconds"],
        lambda ratio: ratio >= 10.0,
        ("steady", "exudyn"),
    ),
    Target(
        "the same, Exudyn with one lay-on for the runs that differ in speed",
        "said",
        lambda ours, _: ours["exudyn"]["shared"] / ours["steady"]["seconds"],
        lambda _: True,
        ("steady", "exudyn"),
    ),
    Target(
        "worst error of a tension of these runs [%]",
        "<= 0.05",
        own("steady", "worst_percent"),
        at_most(0.05),
        ("steady",),
    ),
    Target("120 steady runs", "<= 2 x", over("steady"), at_most(2.0), ("steady",), True),
    Target("120 runs in time", "<= 2 x", over("transient"), at_most(2.0), ("transient",), True),
    Target("inverse problem", "<= 2 x", over("inverse"), at_most(2.0), ("inverse",), True),
    Target("drive of 51 points, rods", "<= 2 x", over("drive"), at_most(2.0), ("drive",), True),
    Target("compiling all kernels [s]", "<= 15", own("compiling"), at_most(15.0), ("compiling",)),
    Target(
        "reduction of 120 runs of 3,000 samples [s]",
        "<= 2.0",
        own("reduction"),
        at_most(2.0),
        ("reduction",),
    ),
    Target(
        "`beltid --help` over `import typer`",
        "<= 1.5",
        own("help_page", "ratio"),
        at_most(1.5),
        ("help_page",),
    ),
    Target("`beltid run` of a belt", "<= 1.1 x", over("chain"), at_most(1.1), ("chain",), True),
    Target("the same again [s]", "<= 1.5", own("chain", "again"), at_most(1.5), ("chain",)),
    Target(
        "300 MB of CSV over pyarrow alone (wall)",
        "<= 2",
        own("csv", "ratio"),
        at_most(2.0),
        ("csv",),
    ),
    Target(
        "peak memory over the numbers of that file",
        "<= 3",
        own("csv", "memory"),
        at_most(3.0),
        ("csv",),
    ),
    Target("a million columns are refused [s]", "<= 3", own("columns"), at_most(3.0), ("columns",)),
)


def best_of(rounds: int, names: list[str], pythons: list[str]) -> list[Measured]:
    """Smallest values of each task for each interpreter, which take turns."""
    best: list[Measured] = [{} for _ in pythons]
    for _ in range(rounds):
        for name in names:
            for python, found in zip(pythons, best, strict=True):
                if name == "exudyn" and python != pythons[0]:
                    continue
                print(f"{name}: {python}", file=sys.stderr)
                done = subprocess.run([python, SCRIPT, name], capture_output=True, text=True)
                if done.returncode:
                    print(done.stderr, file=sys.stderr)
                    continue
                values = json.loads(done.stdout.splitlines()[-1])
                known = found.setdefault(name, values)
                found[name] = {key: min(known[key], value) for key, value in values.items()}
    return best


def rows(ours: Measured, theirs: Measured) -> list[str]:
    """The table, a line per target whose tasks were done."""
    lines = ["| target | asked | measured | |", "|---|---|---|---|"]
    for target in TARGETS:
        known = [ours, theirs] if target.beside else [ours]
        if not all(name in found for name in target.needs for found in known):
            continue
        value = target.value(ours, theirs)
        verdict = "met" if target.met(value) else "**missed**"
        lines.append(f"| {target.what} | {target.asked} | {value:.3g} | {verdict} |")
    lines += ["", "| task | best of the rounds | beside |", "|---|---|---|"]
    for name, found in ours.items():
        words = (
            ", ".join(f"{key} {value:.4g}" for key, value in of.items())
            for of in (found, theirs.get(name, {}))
        )
        lines.append(f"| {name} | {' | '.join(words)} |")
    return lines


def main() -> int:
    """Measure, print, and write the page if all was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--tasks", nargs="*", choices=list(TASKS), default=list(TASKS))
    parser.add_argument("--beside", help="interpreter with another version of beltid")
    chosen = parser.parse_args()
    pythons = [sys.executable, *filter(None, [chosen.beside])]
    ours, *others = best_of(chosen.rounds, chosen.tasks, pythons)
    versions = ", ".join(f"{of} {metadata.version(of)}" for of in ("numpy", "numba", "scipy"))
    text = "\n".join(
        [
            "# Benchmarks",
            "",
            f"Written by `make bench`; one run on one machine: {os.cpu_count()} cores, "
            f"{platform.system()} {platform.machine()}, Python {platform.python_version()}, "
            f"{versions}.",
            "`benchmarks/tasks.py` has the work, `benchmarks/exudyn_rig.py` the peer. *x* is over "
            "the version named beside. All recordings are synthetic.",
            "",
            *rows(ours, others[0] if others else {}),
        ]
    )
    print(text)
    if chosen.tasks == list(TASKS):
        RESULTS.write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
