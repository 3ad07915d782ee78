"""The command that plans the next runs."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def results(ran: Path) -> tuple[Path, Path, str, Path]:
    """What a plan goes on from, as the command takes it."""
    runs = ran / "runs" / "5pk"
    return (
        runs / "surface_refined.parquet",
        runs / "stiffness.parquet",
        "--from",
        runs / "friction.parquet",
    )


def test_a_plan_goes_on_from_results(ran: Path, results: Any, beltid: Any) -> None:
    # slower than what was measured: there runs are needed
    config = (ran / "beltid.yaml").read_text()
    (ran / "slow.yaml").write_text(f"{config}\nplan: {{speed_rad_s: [0.01, 0.05, 0.21]}}\n")
    options = ("--runs", "5", "--goal-u", "0", "-c", "slow.yaml", "-o", "plan.csv", "--json")
    call = ("plan", *results, *options)
    result = beltid(*call)
    assert result.exit_code == 0, result.stderr
    product = json.loads(result.stdout)
    facts, rows = product["facts"], product["table"]
    assert facts["candidates"] == 24
    with (ran / "plan.csv").open() as file:
        written = list(csv.DictReader(file))
    assert [row["order"] for row in written] == [str(row["order"]) for row in rows]
    assert len(rows) == 5
    for row in written:
        assert row["arc_deg"] in ("40", "82")
        assert row["initial_tension_N"] in ("100", "220", "310", "411")
    assert [row["pulley_speed_rad_s"] for row in written].count("0.01") >= 2
    assert {row["arc_deg"] for row in written} == {"40", "82"}
    assert max(int(row["repeats"]) for row in written) >= 2
    assert facts["uncertainty_after_percent"] < facts["uncertainty_before_percent"] < 30.0
    slow, *_, fast = product["details"]["standard uncertainty by region, in percent of mu"]
    assert slow["after_percent"] < 0.5 * slow["before_percent"]
    assert fast["before_percent"] < 1.5
    # the same call the same bytes, and nothing is replaced unasked
    first = (ran / "plan.csv").read_bytes()
    again = beltid(*call)
    assert again.exit_code == 2
    assert "use --force to overwrite" in again.stderr
    assert beltid(*call, "--force").exit_code == 0
    assert (ran / "plan.csv").read_bytes() == first


def test_without_data_it_plans_from_what_is_usual_and_says_so(bench: Path, beltid: Any) -> None:
    result = beltid("plan", "-c", "beltid.yaml", "--goal-u", "0.03", "--json")
    assert result.exit_code == 0, result.stderr
    product = json.loads(result.stdout)
    assert 4 <= product["facts"]["runs"] < 12
    assert product["facts"]["uncertainty_before_percent"] > 30.0
    assert product["facts"]["uncertainty_after_percent"] <= 3.0
    assert any("no data" in note for note in product["notes"])
    assert "goal 3 % reached" in product["verdict"]
    assert (bench / "plan.csv").read_text().count("usual values") == product["facts"]["runs"]


def test_every_statement_has_its_size_or_says_that_it_is_by_the_data(
    ran: Path, results: Any, beltid: Any
) -> None:
    call = ("plan", *results, "--goal-u", "0", "-c", "beltid.yaml", "-o", "stated.csv", "--json")
    result = beltid(*call)
    assert result.exit_code == 0, result.stderr
    product = json.loads(result.stdout)
    rows = product["details"]["if it were known twice as well"]
    assert rows
    for row in rows:
        number, _, unit = row["uncertainty"].partition(" ")
        assert row["uncertainty"] == "by the data" or (float(number) > 0.0 and unit), row
    assert not product["warnings"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("surface.parquet",), "SURFACE and STIFFNESS go together"),
        (("--from", "friction.parquet"), "--from goes with them"),
        (("--goal-u", "2"), "must be in [0, 1)"),
        (("-c", "light.yaml"), "a setting of plan: (without it of rig:) cannot be simulated"),
        (("stiffness.parquet", "surface.parquet"), "is a stiffness artifact"),
        (("-o", "runs.png"), "runs.png: the table of a plan ends in .csv"),
    ],
)
def test_a_wrong_call_is_refused(
    bench: Path, beltid: Any, arguments: tuple[str, ...], said: str
) -> None:
    config = (bench / "beltid.yaml").read_text()
    (bench / "light.yaml").write_text(f"{config}\nplan: {{tension_N: [0.01]}}\n")
    result = beltid("plan", *arguments)
    assert result.exit_code in (2, 3)  # 3: of the simulated rig
    assert said in " ".join(result.stderr.replace("│", " ").split())
    assert not (bench / "plan.csv").exists()
    assert not (bench / "runs.png").exists()


def test_results_of_another_belt_or_bench_are_named(ran: Path, results: Any, beltid: Any) -> None:
    config = (ran / "beltid.yaml").read_text()
    (ran / "own.yaml").write_text(config)
    other = config.replace("rig:", "rig:\n  pulley_radius_m: 0.031", 1)
    assert "pulley_radius_m: 0.05" not in config
    assert other != config
    (ran / "other.yaml").write_text(other)
    surface, stiffness, _, friction = results
    for call in (
        ("plan", *results, "-o", "told.csv"),
        ("refine-surface", friction, stiffness, "-o", "told.parquet"),
        ("build-surface", friction, "-o", "told.parquet"),
    ):
        told = beltid(*call, "--force", "-c", "other.yaml")
        name = surface.name if call[0] == "plan" else friction.name
        line = f"{name}: made with rig.pulley_radius_m = 0.05 (now 0.031): if it is not of this"
        assert line in " ".join(told.stderr.split()), call
        assert "made with rig" not in beltid(*call, "--force", "-c", "own.yaml").stderr
