"""Adding a command touches its stage, its command file and one line of the table of commands."""

from __future__ import annotations

import ast
import json
from functools import cache
from pathlib import Path

import pytest
from typer.testing import CliRunner

import beltid.cli.commands as commands
from beltid.cli import app
from beltid.cli.program import COMMANDS

PACKAGE = Path(__file__).parents[2] / "beltid"
REGISTRIES = {
    "cli/program.py": "the commands in the order of the help",
    "tables/schemas.py": "the command that writes a kind of artifact",
    "batch/chain.py": "the steps of `beltid run`",
}
COLUMNS_OF_A_BATCH = "batch/belts.py"  # figures of two steps stand in its table
KINDS_OF_RECORDINGS = (
    "stages/setup/inspect_file.py"  # the command that reads each of the three kinds
)
NEW_COMMAND = """
from beltid.cli.program import Common, command
from beltid.cli.execute import finish

@command("weigh-belt")
def weigh_belt(*, common: Common) -> None:
    "Weigh a belt."
    def work(reporter):
        from beltid.report.summary import Summary
        reporter.report("weighing")
        return Summary(stage="weigh-belt", title="mass", facts={"mass_kg": 0.1}, exit_status=4)
    finish(work, common, kept="")
"""


def test_a_line_of_the_table_makes_a_file_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "weigh.py").write_text(NEW_COMMAND)
    monkeypatch.setattr(commands, "__path__", [*commands.__path__, str(tmp_path)])
    monkeypatch.setattr(app, "registered_commands", list(app.registered_commands))
    monkeypatch.setitem(COMMANDS, "weigh-belt", ("weigh", "nothing -> how heavy a belt is"))
    listed = CliRunner().invoke(app, ["--help"]).stdout
    assert "weigh-belt      nothing -> how heavy a belt is" in listed
    done = CliRunner().invoke(app, ["weigh-belt", "--json"])
    assert done.exit_code == 4, done.stderr
    assert json.loads(done.stdout)["facts"] == {"mass_kg": 0.1}
    assert "weighing" in done.stderr
    assert "weighing" not in CliRunner().invoke(app, ["weigh-belt", "-q"]).stderr
    assert "--config" in CliRunner().invoke(app, ["weigh-belt", "--help"]).stdout


@cache
def texts_of_the_package() -> list[tuple[str, str]]:
    """File and value of every text in the code of the package."""
    return [
        (path.relative_to(PACKAGE).as_posix(), node.value)
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


def mentions(name: str) -> set[str]:
    """Files of the package in whose code a text begins with the name of a command."""
    begin = (f"{name} --", f"{name} refined")
    return {
        file
        for file, value in texts_of_the_package()
        if (text := value.removeprefix("beltid ")) == name or text.startswith(begin)
    }


@pytest.mark.parametrize("name", [name for name in COMMANDS if "-" in name])
def test_a_command_is_named_in_its_stage_its_file_and_the_registries_only(name: str) -> None:
    module = COMMANDS[name][0]
    (stage,) = PACKAGE.glob(f"stages/*/{name.replace('-', '_')}.py")
    own = {f"cli/commands/{module}.py", stage.relative_to(PACKAGE).as_posix()}
    found = mentions(name)
    assert own <= found
    assert "cli/program.py" in found
    known = own | set(REGISTRIES) | {COLUMNS_OF_A_BATCH, KINDS_OF_RECORDINGS}
    assert found <= known
