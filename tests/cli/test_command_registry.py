"""A line of the table of commands makes a file of the folder a command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import beltid.cli.commands as commands
from beltid.cli import app
from beltid.cli.program import COMMANDS

NEW_COMMAND = """
from beltid.cli.program import Common, command
from beltid.cli.execute import finish

@command("weigh-belt")
def weigh_belt(*, common: Common) -> None:
    "Weigh a belt."
    def work(options):
        from beltid.report.summary import Summary
        options.reporter.report("weighing")
        return Summary(stage="weigh-belt", title="mass", facts={"mass_kg": 0.1}, exit_status=4)
    finish(work, common)
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
