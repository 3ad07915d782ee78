"""The help is for somebody who knows belts and not the code."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

from beltid import __version__
from beltid.cli import app
from beltid.cli.program import COMMANDS as LISTED

COMMANDS = {
    "fit-stiffness": ("PRESS", "stiffness.parquet"),
    "fit-slip": ("SPEEDLOSS", "slip.parquet"),
    "fit-friction": ("RIG", "friction.parquet"),
    "build-surface": ("FRICTION", "surface.parquet"),
    "refine-surface": ("FRICTION", "surface_refined.parquet"),
    "simulate-rig": ("SURFACE", "simulated.parquet"),
    "compare": ("FRICTION", "compare.parquet"),
    "simulate-drive": ("SURFACE", "drive.parquet"),
    "compare-drive": ("SLIP", "compare_drive.parquet"),
    "plan": ("SURFACE", "plan.csv"),
    "run": ("CONFIG", "runs/<belt>/"),
    "report": ("FOLDER", "report.html"),
    "export": ("TARGET", "export/ in the folder of the law"),
    "init": ("NAME", "<NAME>.yaml"),
}
OPTIONS = ("--config", "-c", "--out", "-o", "--json", "-q", "-v", "--force", "--version")


def test_main_help_lists_the_commands_and_the_exit_statuses() -> None:
    result = CliRunner().invoke(app, ["--help"])
    assert result.exit_code == 0
    for command in COMMANDS:
        assert re.search(rf"^  {command} ", result.stdout, re.M)
    found = re.findall(r"^ +(\d+) {2,}\S", result.stdout.split("Exit status:")[1], re.M)
    assert found == ["0", "1", "2", "3", "4", "5", "130", "143"]
    assert "..." not in result.stdout.split("Commands:")[1]  # no sentence is cut off


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_says_input_output_and_example(command: str) -> None:
    result = CliRunner().invoke(app, [command, "--help"])
    assert result.exit_code == 0
    text = " ".join(result.stdout.split())
    argument, output = COMMANDS[command]
    usage = result.stdout.split("\n\n")[0]
    assert "{" not in usage
    assert argument in usage
    assert output in text
    assert f"Example: beltid {command}" in text
    for option in OPTIONS:
        assert re.search(rf"(?<![\w-]){option}\b", text), option
    # words of the code have no place here
    assert not re.search(r"\b(dict|ndarray|None|callable|Path|DataFrame|list\[)", text)


def test_the_list_of_the_help_is_what_the_commands_say_of_themselves() -> None:
    """The list is a table, so that the help need not import the commands."""
    group = get_command(app)
    for name, (_, short) in LISTED.items():
        command = group.get_command(None, name)  # type: ignore[attr-defined]
        assert command.short_help == short


def test_a_misspelt_command_is_corrected() -> None:
    assert "fit-friction" in CliRunner().invoke(app, ["fit-frictoin"]).stderr


@pytest.mark.parametrize("arguments", [["--version"], ["fit-friction", "--version"]])
def test_every_command_reports_the_version(arguments: list[str]) -> None:
    result = CliRunner().invoke(app, arguments)
    assert (result.exit_code, result.stdout) == (0, f"beltid {__version__}\n")
    for order in (["-v", *arguments], [*arguments, "-v"])[len(arguments) - 1 :]:
        result = CliRunner().invoke(app, order)
        assert result.exit_code == 0
        first, *lines = result.stdout.splitlines()
        assert first == f"beltid {__version__}"
        told = dict(line.split() for line in lines if len(line.split()) == 2)
        assert told["numpy"] == np.__version__
        assert {"scipy", "h5py", "BELTID_CONFIG"} <= set(" ".join(lines).split())


@pytest.mark.parametrize(
    "arguments",
    [
        ["fit-frictoin"],
        ["fit-friction"],
        ["compare", "a"],
        ["fit-slip", "x", "--what"],
        ["-v", "run"],
        *([command, "x", "-o", "-"] for command in ("fit-slip", "run", "show", "init")),
    ],
)
def test_a_wrong_call_is_status_2_and_says_so_on_stderr(arguments: list[str]) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "Error" in result.stderr


def test_the_help_imports_nothing_heavy() -> None:
    code = (
        "import atexit, sys; from beltid.cli import main; sys.argv[1:] = ['fit-friction', '--help']"
        "\natexit.register(lambda: print([m for m in ('numpy', 'scipy', 'pandas', 'pyarrow',"
        " 'numba', 'rich') if m in sys.modules]))\nmain()"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]"


def help_of(command: str) -> str:
    return " ".join(CliRunner().invoke(app, [command, "--help"]).stdout.split())


@pytest.mark.parametrize(
    ("command", "kind"),
    [("fit-stiffness", "press"), ("fit-slip", "speedloss"), ("fit-friction", "rig")],
)
def test_the_help_of_a_fit_names_every_column_with_its_unit(command: str, kind: str) -> None:
    from beltid.tables import schemas

    text = help_of(command)
    for column in schemas.table(kind).columns:
        assert re.search(rf"\b{column.name}\b", text), column.name
        word = {"degC": "°C", "deg": "°", "": "text"}.get(column.unit, column.unit)
        assert re.search(rf"\b{column.name} +{re.escape(word)} ", text), column.name
    for section in ("columns:", "units:", "dialect:"):
        assert section in text


def test_the_help_states_the_defaults_of_the_config() -> None:
    from beltid.config import load_config

    config = load_config(None)
    compare, press = config.compare, config.press
    shares = (
        compare.max_rms_relative_error,
        compare.max_mean_relative_error,
        compare.max_relative_error,
    )
    rms, mean, largest = (f"{100.0 * share:g} %" for share in shares)
    for command, said in (
        ("compare", f"RMS {rms}, mean magnitude {mean}, largest {largest}"),
        ("compare-drive", f"RMS {100.0 * config.compare_drive.max_rms_relative_error:g} %"),
        ("fit-friction", f"{config.rig.pulley_radius_m:g} m"),
        ("fit-stiffness", f"press.segment_length_cm, default {press.segment_length_cm:g}"),
    ):
        assert said in help_of(command), command
