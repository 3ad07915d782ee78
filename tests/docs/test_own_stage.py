"""The stage of the page "a stage of your own" is a command, and up to date when it is."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd

import beltid

ROOT = Path(__file__).parents[2]


def test_the_page_is_a_command(tmp_path: Path, part_of_rig: Any) -> None:
    page = (ROOT / "docs" / "own_stage.md").read_text()
    (code,) = re.findall(r"^```python\n(.*?)^```$", page, re.M | re.S)
    assert len(code.splitlines()) <= 60
    (tmp_path / "wear.py").write_text(code)
    (tmp_path / "rig.csv").write_text(part_of_rig((40, 82), (100, 270, 411), (0.05, 0.21)))
    beltid.fit_friction(pd.read_csv(tmp_path / "rig.csv")).save(tmp_path / "friction.parquet")

    def call(*arguments: str) -> Any:
        return subprocess.run(
            [sys.executable, "wear.py", "wear", *arguments],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )

    done = call("friction.parquet", "--json")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert {row["arc_deg"] for row in said["table"]} == {40.0, 82.0}
    assert said["facts"]["pulley_radius_m"] == 0.05
    frame = pd.read_parquet(tmp_path / "wear.parquet")
    assert frame["runs"].tolist() == [6, 6]
    assert json.loads(call("friction.parquet", "--json").stdout)["up_to_date"]
    assert not json.loads(call("friction.parquet", "--json", "--least", "7").stdout)["table"]
