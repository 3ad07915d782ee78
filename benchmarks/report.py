"""The measured figures as tables of Markdown."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from benchmarks.inverse_problem import Inverse
from benchmarks.start_up import StartUp
from benchmarks.steady_state import ACCURACIES, OwnMesh, PeerMesh, SteadyComparison
from benchmarks.streaming import Streamed
from benchmarks.transient_runs import (
    EQUAL_ELEMENTS,
    PEER_MORE_STEPS,
    PEER_STEPS,
    PEER_TRAVEL_M,
    Growth,
    TransientComparison,
)


@dataclass(frozen=True, slots=True)
class Target:
    """What was asked, and what was measured."""

    what: str
    asked: str
    measured: str
    met: bool


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [" | ".join(head), " | ".join("---" for _ in head), *(" | ".join(r) for r in rows)]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


def machine() -> str:
    """Processor and versions, in one line each."""
    cpu = platform.processor() or platform.machine()
    facts = Path("/proc/cpuinfo")
    if facts.exists():
        names = [line for line in facts.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].partition(":")[2].strip() if names else cpu
    packages = ("numpy", "numba", "scipy", "exudyn")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in packages)
    return (
        f"- {cpu}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}\n"
        f"- Python {platform.python_version()}, {versions}\n"
    )


def _ms(seconds: float) -> str:
    return "no solution" if seconds != seconds else f"{1e3 * seconds:.3f} ms"


def _peer_row(peer: PeerMesh) -> list[str]:
    errors = [f"{peer.error:.3f} %", f"{peer.tension_error:.2f} %"]
    return [f"{peer.settings}", *errors, f"{peer.alone:.3f} s", f"{peer.shared:.3f} s"]


def _own_row(own: OwnMesh) -> list[str]:
    return [
        "default" if own.elements is None else str(own.elements),
        f"{own.error:.4f} %",
        f"{own.iterations:.1f}",
        f"{own.alone:.3f} s",
        f"{own.shared:.3f} s",
        f"{own.surface_error:.3f} %",
        f"{own.surface_alone:.3f} s",
        f"{own.surface_shared:.3f} s",
    ]


def steady_section(result: SteadyComparison) -> str:
    """Times and errors of the 120 runs, and the ratios."""
    own_head = ["elements", "worst error of mu", "Newton steps per run", "alone", "shared"]
    own_head += ["worst error, surface", "surface alone", "surface shared"]
    peer_head = ("Exudyn, static solver", "worst error of mu", "of T_tight", "alone", "shared")
    peers = (*result.plain.values(), *result.hard.values())
    ratios = []
    for key, accuracy in ACCURACIES.items():
        own, varied = result.own_for(accuracy), result.own_for_surface(accuracy)
        for name, peer in (("plain", result.plain[key]), ("tuned", result.hard[key])):
            ratios.append(
                [
                    f"{accuracy:g} %",
                    f"{own.elements}, {varied.elements}",
                    name,
                    f"{peer.alone / own.alone:.1f}",
                    f"{peer.shared / own.shared:.1f}",
                    f"{peer.alone / own.shared:.1f}",
                    f"{peer.alone / varied.surface_alone:.1f}",
                    f"{peer.shared / varied.surface_shared:.1f}",
                    f"{peer.alone / varied.surface_shared:.1f}",
                ]
            )
    head = [
        "accuracy",
        "elements of beltid: constant, surface",
        "Exudyn",
        "alone / alone",
        "shared / shared",
    ]
    head += ["Exudyn alone / shared", "surface: alone / alone", "shared / shared"]
    head += ["Exudyn alone / shared"]
    return (
        "### beltid, steady method\n\n"
        + table(own_head, map(_own_row, result.own))
        + "\n### Exudyn\n\n"
        + table(peer_head, map(_peer_row, peers))
        + "\n### Ratios: Exudyn's time over beltid's\n\n"
        + table(head, ratios)
    )


def steady_targets(result: SteadyComparison) -> list[Target]:
    """Ten times faster at two accuracies, five times with a surface."""
    targets = []
    for key, accuracy in ACCURACIES.items():
        own, varied = result.own_for(accuracy), result.own_for_surface(accuracy)
        peer, hard = result.plain[key], result.hard[key]
        for way, asked_of, ours, ours_surface in (
            ("each run by itself in both", "alone", own.alone, varied.surface_alone),
            ("shared lay-on in both", "shared", own.shared, varied.surface_shared),
            (
                "campaign against Exudyn's runs by themselves",
                "alone",
                own.shared,
                varied.surface_shared,
            ),
        ):
            theirs, best = getattr(peer, asked_of), getattr(hard, asked_of)
            for what, time, asked in (
                ("steady", ours, 10.0),
                ("steady with a surface", ours_surface, 5.0),
            ):
                ratio = theirs / time
                targets.append(
                    Target(
                        f"{what}, {accuracy:g} %, {way}",
                        f">= {asked:g}",
                        f"{ratio:.1f} (tuned Exudyn: {best / time:.1f})",
                        ratio >= asked,
                    )
                )
    return targets


def transient_section(result: TransientComparison) -> str:
    """Runs in time."""
    return table(
        ("what", "measured"),
        [
            (f"120 runs of {result.steps} steps, two threads", f"{result.two_threads:.2f} s"),
            (f"120 runs of {result.steps} steps, one thread", f"{result.one_thread:.2f} s"),
            ("Newton iterations per step", f"{result.iterations_per_step:.2f}"),
            (f"beltid, a step, {EQUAL_ELEMENTS} elements", _ms(result.own_step)),
            (
                f"Exudyn, a step, {EQUAL_ELEMENTS} elements x 6 segments, {PEER_STEPS} steps",
                _ms(result.peer_step),
            ),
            (f"the same in {PEER_MORE_STEPS} steps", _ms(result.peer_small_step)),
            ("mu of that run: beltid, Exudyn", f"{result.own_mu:.5f}, {result.peer_mu:.5f}"),
        ],
    ) + (
        f"\nExudyn: generalised-alpha (spectral radius 0.6) over {1e6 * PEER_TRAVEL_M:g} µm of "
        "travel, modified\nNewton, bristle 1e6 N/m and 100 N s/m a segment. Its friction is "
        "regularised; beltid certifies stick and\nslip in each step.\n"
    )


def transient_targets(result: TransientComparison) -> list[Target]:
    """Time of the 120 runs, cost of a step at equal elements."""
    ratio = result.peer_step / result.own_step
    seconds = result.two_threads
    return [
        Target("transient, 120 runs, two cores", "< 6 s", f"{seconds:.2f} s", seconds < 6.0),
        Target("Exudyn's step over beltid's", ">= 1", f"{ratio:.2f}", ratio >= 1.0),
    ]


def growth_section(growth: Growth) -> str:
    """Cost against the number of elements."""
    columns = (growth.newton_step, growth.time_iteration, growth.time_step)
    rows = [[str(n), *map(_ms, times)] for n, *times in zip(growth.elements, *columns, strict=True)]
    rows.append(["exponent", *(f"{growth.exponent(column):.2f}" for column in columns)])
    head = ("elements", "steady, a Newton step", "transient, a Newton step", "a time step")
    failures = "".join(f"- no solution: {failure}\n" for failure in growth.failures)
    return table(head, rows) + ("\n" + failures if failures else "")


def growth_targets(growth: Growth, peaks: dict[int, float]) -> list[Target]:
    """Linear growth with the mesh, flat memory over time."""
    exponents = [growth.exponent(t) for t in (growth.newton_step, growth.time_step)]
    worst = max(exponents)
    found = f"{exponents[0]:.2f}, {exponents[1]:.2f}"
    if growth.failures:
        found += f"; {len(growth.failures)} without a solution"
    few, many = min(peaks), max(peaks)
    per_step = 1000.0 * (peaks[many] - peaks[few]) / (many - few)
    return [
        Target(
            "exponent of the cost per step, 20 to 640 elements (steady, transient)",
            "about 1",
            found,
            worst <= 1.15 and not growth.failures,
        ),
        Target(
            "memory over time steps, beyond the recording's rows",
            "flat",
            f"{per_step:.0f} bytes a step",
            per_step <= 400.0,
        ),
    ]


def start_up_section(result: StartUp) -> str:
    """First call and the command."""
    head = ("cache of compiled kernels", "import", "first steady run", "first transient run")
    rows = [
        [name, *(f"{seconds:.2f} s" for seconds in times)]
        for name, times in (("empty", result.cold), ("full", result.warm))
    ]
    command = (
        f"`beltid --help` {result.help:.3f} s, `python -c 'import typer'` {result.typer:.3f} s"
    )
    return table(head, rows) + f"\n{command} (medians)\n"


def start_up_targets(result: StartUp) -> list[Target]:
    """The command against its library."""
    ratio = result.help / result.typer
    return [Target("`beltid --help` over `import typer`", "<= 2", f"{ratio:.2f}", ratio <= 2.0)]


def inverse_section(result: Inverse) -> str:
    """The inverse problem and the sensitivities of its solution."""
    rows = [
        ("inverse problem, 120 runs, surface of 5 speeds", f"{result.solution:.2f} s"),
        ("its sensitivities to all inputs of the rig", f"{result.sensitivities:.2f} s"),
    ]
    return table(("one core, after warm-up", "best time"), rows)


def inverse_targets(result: Inverse) -> list[Target]:
    """The inverse problem in a second."""
    return [
        Target(
            "inverse problem on 120 runs",
            "< 1 s",
            f"{result.solution:.2f} s",
            result.solution < 1.0,
        ),
    ]


def streaming_targets(results: Sequence[Streamed]) -> list[Target]:
    """A big CSV file in 1.5 times the bare reading of it, in less than 1 GiB."""
    peak = max(result.peak_mb for result in results)
    return [
        *(
            Target(
                f"fit-friction over reading, CSV, {result.samples_per_run:,} samples a run",
                "<= 1.5",
                f"{result.ratio:.2f}",
                result.ratio <= 1.5,
            )
            for result in results
            if result.kind == "csv"
        ),
        Target("peak memory of fit-friction", "< 1024 MB", f"{peak:.0f} MB", peak < 1024.0),
    ]


def targets_table(targets: Sequence[Target]) -> str:
    """Verdicts."""
    rows = [(t.what, t.asked, t.measured, "met" if t.met else "**missed**") for t in targets]
    return table(("target", "asked", "measured", ""), rows)
