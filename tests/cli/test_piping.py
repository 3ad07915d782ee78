"""- in the place of a file: a recording from stdin, an artifact to stdout."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from beltid.artifacts.artifact import artifact_from_bytes
from beltid.artifacts.parquet_table import columns_sha256
from beltid.cli import app
from beltid.cli.execute import piped


def call(*arguments: str, stdin: bytes = b"") -> Any:
    return CliRunner().invoke(app, list(arguments), input=stdin)


def test_recording_from_stdin_gives_the_same_artifact_in_the_current_folder(bench: Path) -> None:
    whole = (bench / "friction.parquet").read_bytes()
    (bench / "friction.parquet").unlink()
    done = call("fit-friction", "-", stdin=(bench / "rig.csv").read_bytes())
    assert done.exit_code == 0, done.stderr
    assert (bench / "friction.parquet").read_bytes() == whole
    assert "beltid.yaml" in done.stderr  # the config of the current folder
    assert "beltid-" not in done.stderr


def test_a_simulated_recording_from_stdin_brings_its_uncertainty_along(bench: Path) -> None:
    whole = (bench / "compare.parquet").read_bytes()
    (bench / "compare.parquet").unlink()
    done = call(
        "compare", "friction.parquet", "-", stdin=(bench / "simulated.parquet").read_bytes()
    )
    assert done.exit_code == 0, done.stderr
    assert (bench / "compare.parquet").read_bytes() == whole


def test_a_recording_from_stdin_need_not_fit_into_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class InPieces(io.BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            assert size is not None
            assert 0 < size <= 1 << 20
            return super().read(size)

    data = bytes(range(256)) * (3 << 12)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=InPieces(data)))
    with piped({"rig": Path("-")}, tmp_path / "out.parquet", json=False) as files:
        assert files.inputs["rig"].read_bytes() == data


def test_artifact_to_stdout_is_nothing_but_the_artifact(bench: Path) -> None:
    before = sorted(path.name for path in bench.iterdir())
    done = call("build-surface", "friction.parquet", "-o", "-")
    assert done.exit_code == 0, done.stderr
    assert done.stdout_bytes == (bench / "surface.parquet").read_bytes()
    assert "stdout written" in done.stderr
    assert sorted(path.name for path in bench.iterdir()) == before


@pytest.mark.long
def test_commands_can_be_chained_by_pipes(bench: Path) -> None:
    beltid = f'"{sys.executable}" -m beltid'
    first = f"{beltid} fit-slip - -q -o - < speedloss.csv"
    line = f"{first} | {beltid} compare-drive - drive.parquet -q -o -"
    done = subprocess.run(line, shell=True, capture_output=True, cwd=bench, check=True)
    assert done.stderr == b""
    made = artifact_from_bytes(done.stdout, Path("piped"), "compare_drive")
    standing = artifact_from_bytes((bench / "compare_drive.parquet").read_bytes(), Path("file"))
    assert columns_sha256(made.columns) == columns_sha256(standing.columns)


def test_an_error_in_stdin_is_placed_there(bench: Path) -> None:
    text = (bench / "rig.csv").read_text().replace("\nR", "\nR,", 1)
    done = call("fit-friction", "-", stdin=text.encode())
    assert done.exit_code == 2
    assert "error: stdin:2: " in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("compare", "-", "-"), "- (stdin) can be one input only, not friction and simulated"),
        (("fit-friction", "-"), "stdin: nothing came in"),
        (("build-surface", "friction.parquet", "-o", "-", "--json"), "both want stdout"),
    ],
)
def test_what_cannot_be_piped_is_named(bench: Path, arguments: tuple[str, ...], said: str) -> None:
    done = call(*arguments)
    assert done.exit_code == 2
    assert said in done.stderr
    assert done.stdout == ""


def test_the_verdict_stays_the_exit_status(bench: Path) -> None:
    (bench / "beltid.yaml").write_text("compare: {max_relative_error: 1e-6}\n")
    done = call("compare", "friction.parquet", "simulated.parquet", "-o", "-")
    assert done.exit_code == 4
    assert artifact_from_bytes(done.stdout_bytes, Path("piped")).kind == "compare"


def test_no_colour_if_nobody_wants_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """NO_COLOR (no-color.org) holds on a terminal, too; FORCE_COLOR brings none into a file."""
    from beltid.cli.reporter import console_for

    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert console_for("stdout").color_system is not None
    monkeypatch.setenv("NO_COLOR", "1")
    assert console_for("stdout").no_color
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: False, raising=False)
    assert console_for("stdout").color_system is None
