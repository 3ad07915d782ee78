"""Every target of speed in one table: ``python -m benchmarks.bench`` writes RESULTS.md.

With ``--beside PYTHON`` the interpreter of another version of beltid does the same work in turns;
ratios are ours over theirs. Times are processor times of one core unless the target says wall; the
best of the rounds counts, since other work on the machine only adds.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from benchmarks import table
from benchmarks.tasks import TASKS

RESULTS = Path(__file__).with_name("RESULTS.md")
SCRIPT = str(Path(__file__).with_name("tasks.py"))
BESIDE = "beside"
Measured = dict[str, dict[str, float]]


class Target(NamedTuple):
    """What is asked of a value of a task, or of its ratio over another or the version beside."""

    what: str
    asked: str
    of: str
    """Task and value."""
    over: str = ""
    """Task and value, or `BESIDE`: the same of another version."""

    def measured(self, ours: Measured, theirs: Measured) -> float | None:
        """The value; None where a task was not done."""
        below = theirs if self.over == BESIDE else ours
        try:
            value = _value(ours, self.of)
            return value / _value(below, self.over.replace(BESIDE, self.of)) if self.over else value
        except KeyError:
            return None

    def row(self, value: float) -> tuple[str, ...]:
        """A row of the table."""
        sign, *limit = self.asked.split()
        met = not limit or (value >= float(limit[0]) if sign == ">=" else value <= float(limit[0]))
        verdict = "met" if met else "**missed**"
        return self.what, self.asked + " x" * (self.over == BESIDE), f"{value:.3g}", verdict


def _value(measured: Measured, place: str) -> float:
    task, key = place.split()
    return measured[task][key]


EXUDYN = "120 steady runs: Exudyn, each run by itself, over beltid's campaign"
SHARED = "the same, Exudyn with one lay-on for the runs that differ in speed"
TARGETS = (
    Target(EXUDYN, ">= 10", "exudyn seconds", "steady seconds"),
    Target(SHARED, "said", "exudyn shared", "steady seconds"),
    Target("worst error of a tension of these runs [%]", "<= 0.05", "steady worst_percent"),
    Target("120 steady runs", "<= 2", "steady seconds", BESIDE),
    Target("120 runs in time", "<= 2", "transient seconds", BESIDE),
    Target("inverse problem", "<= 2", "inverse seconds", BESIDE),
    Target("drive of 51 points, rods", "<= 2", "drive seconds", BESIDE),
    Target("compiling all kernels [s]", "<= 15", "compiling seconds"),
    Target("reduction of 120 runs of 3,000 samples [s]", "<= 2.0", "reduction seconds"),
    Target("`beltid --help` over `import typer`", "<= 1.5", "help_page ratio"),
    Target("`beltid run` of a belt", "<= 1.1", "chain seconds", BESIDE),
    Target("the same again [s]", "<= 1.5", "chain again"),
    Target("300 MB of CSV over pyarrow alone (wall)", "<= 2", "csv ratio"),
    Target("peak memory over the numbers of that file", "<= 3", "csv memory"),
    Target("a million columns are refused [s]", "<= 3", "columns seconds"),
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


def words(measured: Measured, task: str) -> str:
    """All values of a task."""
    return ", ".join(f"{key} {value:.4g}" for key, value in measured.get(task, {}).items())


def main() -> int:
    """Measure, print, and write the page if all was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--tasks", nargs="*", choices=list(TASKS), default=list(TASKS))
    parser.add_argument("--beside", help="interpreter with another version of beltid")
    chosen = parser.parse_args()
    pythons = [sys.executable, *filter(None, [chosen.beside])]
    ours, theirs, *_ = [*best_of(chosen.rounds, chosen.tasks, pythons), {}]
    versions = ", ".join(f"{of} {metadata.version(of)}" for of in ("numpy", "numba", "scipy"))
    values = [(target, target.measured(ours, theirs)) for target in TARGETS]
    targets = [target.row(value) for target, value in values if value is not None]
    tasks = [(task, words(ours, task), words(theirs, task)) for task in ours]
    text = f"""# Benchmarks

Written by `make bench`; one run on one machine: {os.cpu_count()} cores, {platform.system()} \
{platform.machine()}, Python {platform.python_version()}, {versions}.
`benchmarks/tasks.py` has the work, `benchmarks/exudyn_rig.py` the peer. *x* is over the version \
named beside. All recordings are synthetic.

{table(("target", "asked", "measured", ""), targets)}
{table(("task", "best of the rounds", "beside"), tasks)}"""
    print(text)
    if chosen.tasks == list(TASKS):
        RESULTS.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
