"""The chain over one belt: what decides, what is done without a recording, what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest


def row_of(done: Any) -> dict[str, Any]:
    row: dict[str, Any] = json.loads(done.stdout)["table"][0]
    return row


@pytest.mark.usefixtures("undrawn")
def test_what_can_be_done_without_a_recording_is_done(bench: Path, beltid: Any) -> None:
    (bench / "part.yaml").write_text("belt: {name: part}\ndata: {press: press.csv}\n")
    done = beltid("run", "part.yaml", "--json", "-j", "1")
    assert done.exit_code == 0, done.stderr
    (warning,) = [line for line in done.stderr.splitlines() if line.startswith("warning: part: ")]
    assert "data.rig" in warning
    states, made = row_of(done)["stages"], {"fit-stiffness", "report"}
    assert {stage for stage, state in states.items() if state == "done"} == made
    others = {state for stage, state in states.items() if stage not in made}
    assert others == {"no recording"}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("name", "step"), [("slip.parquet", "fit-slip"), ("report.html", "report")]
)
def test_a_result_that_may_not_be_read_stops_its_step_only(
    name: str, step: str, bench: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (bench / "part.yaml").write_text("data: {press: press.csv, speedloss: speedloss.csv}\n")
    (bench / "runs/5pk").mkdir(parents=True)
    (bench / "slip.parquet").rename(bench / "runs/5pk" / name)
    plain = Path.open

    def locked(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.name == name:
            raise PermissionError(13, "Permission denied", str(path))
        return plain(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", locked)
    done = beltid("run", "part.yaml", "--json", "-j", "1")
    assert done.exit_code == 2, done.exception
    states = row_of(done)["stages"]
    assert (states[step], states["fit-stiffness"]) == ("failed", "done")
    assert f"{name}: no permission to read it" in done.stderr
