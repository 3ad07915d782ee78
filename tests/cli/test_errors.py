"""Wrong inputs: the message names place, found and allowed; status 2; artifacts stay untouched."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


def replaced(path: Path, line: int, column: int, value: str) -> None:
    """Put another value into a cell of a CSV file; lines from 1, columns from 0."""
    lines = path.read_text().splitlines(keepends=True)
    cells = lines[line - 1].rstrip("\n").split(",")
    cells[column] = value
    lines[line - 1] = ",".join(cells) + "\n"
    path.write_text("".join(lines))


def config_text(text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "beltid.yaml").write_text(text) and None


# name: what is spoiled, the call, what must be said; every wrong file at every command is in
# tests/hostile/test_wrong_files.py, places for results in tests/stages/test_build_artifact.py, the
# words of the readers and of the config in their own tests
CASES: dict[str, tuple[Callable[[Path], Any], list[str], list[str]]] = {
    "several wrong cells": (
        lambda f: [replaced(f / "rig.csv", n, 2, "much") for n in (10, 20)],
        ["fit-friction", "rig.csv"],
        [r"rig\.csv:10: tension_tight_N", r"rig\.csv:20: tension_tight_N"],
    ),
    "folder as recording": (
        lambda f: None,
        ["fit-friction", "."],
        [r"speedloss\.csv:1: these are the columns of a recording of the speed-loss bench"],
    ),
    "forced onto a recording of the config": (
        lambda f: (
            (f / "simulated.parquet").rename(f / "rig.parquet"),
            (f / "beltid.yaml").write_text("data: {rig: rig.parquet}\n"),
        ),
        ["build-surface", "friction.parquet", "-o", "rig.parquet", "--force"],
        [r"rig\.parquet: is the rig recording of the config, name another --out"],
    ),
    "a dash for a recording": (lambda f: None, ["fit-friction", "-"], ["-: there is no such"]),
    "unknown method": (
        lambda f: None,
        ["simulate-rig", "surface.parquet", "stiffness.parquet", "--method", "quick"],
        [r"method = 'quick', must be transient or steady"],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_wrong_input_is_status_2_and_leaves_everything_as_it_was(
    bench: Path, beltid: Any, case: str
) -> None:
    spoil, call, messages = CASES[case]
    spoil(bench)
    before = {f: f.read_bytes() for f in bench.rglob("*") if f.is_file()}
    for extra in ([], ["--json"]):
        result = beltid(*call, *extra)
        assert result.exit_code == 2, result.stderr
        assert result.stdout == ""
        for message in messages:
            assert re.search(message, result.stderr), result.stderr
        assert "Traceback" not in result.stderr
        errors = [line for line in result.stderr.splitlines() if not line.startswith("config: ")]
        assert all(re.match(r"error: |warning: |note: |\S+: \d+ |\d+ runs", e) for e in errors)
    assert {f: f.read_bytes() for f in bench.rglob("*") if f.is_file()} == before


def test_runs_set_aside_are_counted_and_reported(bench: Path, beltid: Any) -> None:
    lines = (bench / "rig.csv").read_text().splitlines(keepends=True)
    first = lines[1].split(",")[0]
    still = [
        ",".join([*line.split(",")[:4], "0.0", *line.split(",")[5:]])
        if line.startswith(first + ",")
        else line
        for line in lines
    ]
    (bench / "rig.csv").write_text("".join(still))
    result = beltid("fit-friction", "rig.csv")
    assert result.exit_code == 0
    assert f"warning: run {first} set aside: " in result.stderr
    assert re.search(r"runs set aside\s+1\b", result.stdout)


def test_failed_runs_are_status_3_and_the_others_are_kept(
    bench: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from beltid.errors import ConvergenceError
    from beltid.rig import runs as rig

    lay_on = rig.lay_on

    def fails_at_82_degrees_and_411_N(model: Any, *room: Any) -> Any:
        if model.point.beta > 1.4 and model.point.T_0 > 410:
            raise ConvergenceError("no equilibrium")
        return lay_on(model, *room)

    monkeypatch.setattr(rig, "lay_on", fails_at_82_degrees_and_411_N)
    call = ("simulate-rig", "surface.parquet", "stiffness.parquet")
    result = beltid(*call, "--force")
    assert result.exit_code == 3
    assert "warning: run S015: no equilibrium" in result.stderr
    assert "2 of 16 runs failed" in result.stdout
    from beltid.store.artifact import read_artifact

    artifact = read_artifact(bench / "simulated.parquet", "simulated")
    assert len(set(artifact.columns["run"])) == 14
    assert {row["run"] for row in artifact.record.set_aside} == {"S015", "S016"}
    compared = beltid("compare", "friction.parquet", "simulated.parquet")
    assert compared.exit_code == 0
    assert "2 runs not compared: no simulated run with these settings" in compared.stderr


def test_all_runs_failed_is_status_3_and_nothing_is_written(
    bench: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from beltid.errors import ConvergenceError
    from beltid.rig import runs as rig

    def fails(*_: Any) -> Any:
        raise ConvergenceError("no equilibrium")

    monkeypatch.setattr(rig, "lay_on", fails)
    before = (bench / "simulated.parquet").read_bytes()
    result = beltid("simulate-rig", "surface.parquet", "stiffness.parquet", "--force")
    assert result.exit_code == 3
    assert result.stdout == ""
    assert "error: run S001: no equilibrium" in result.stderr
    assert (bench / "simulated.parquet").read_bytes() == before
