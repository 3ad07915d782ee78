"""From a LabVIEW file per run and a Zwick export to the comparison: one config, one command."""

from __future__ import annotations

import pandas as pd
import pytest
import writers
from typer.testing import CliRunner

from beltid.artifacts.artifact import read_artifact
from beltid.bench.files import content_of
from beltid.cli import app

CONFIG = """\
belt: {name: bench}
rig: {arcs_deg: [40, 82], initial_tensions_N: [100, 411], pulley_speeds_rad_s: [0.1, 0.21]}
simulation: {method: steady, elements: 20}
compare: {hold_out: none}
data: {origin: synthetic, press: P22.txt, rig: "rig/*.lvm"}
runs:
  rig: {pattern: "{run}_{arc_deg}deg_{initial_tension_N}N_{speed}.lvm"}
"""


@pytest.mark.long
def test_from_bench_files_to_the_comparison(tmp_path):
    frame = pd.read_csv(writers.DATA / "rig.csv", dtype={"run": str})
    tidy = frame[frame["arc_deg"].isin([40, 82]) & frame["initial_tension_N"].isin([100, 411])]
    speed = tidy.groupby("run")["pulley_speed_rad_s"].quantile(0.9)
    chosen = speed[(speed - 0.1).abs().lt(0.01) | (speed - 0.21).abs().lt(0.02)]
    tidy = tidy[tidy["run"].isin(chosen.index)]
    (tmp_path / "rig").mkdir()
    for label, run in tidy.groupby("run"):
        arc, tension = run["arc_deg"].iloc[0], run["initial_tension_N"].iloc[0]
        name = f"{label}_{arc}deg_{tension}N_{speed[label]:.2f}".replace("0.", "0p")
        writers.write_lvm(tmp_path / "rig" / f"{name}.lvm", run)
    writers.write_zwick(tmp_path / "P22.txt", writers.press_tests()["P22"], "latin-1")
    config = tmp_path / "belt.yaml"
    config.write_text(CONFIG)
    runs = tmp_path / "runs"
    call = ["run", str(config), "-o", str(runs), "-j", "1", "-q", "--no-report"]
    result = CliRunner().invoke(app, call)
    assert result.exit_code == 0, result.stderr
    friction = read_artifact(runs / "bench" / "friction.parquet")
    assert len(friction.columns["run"]) == 8
    assert friction.metadata.inputs["rig"] == content_of(tmp_path / "rig" / "*.lvm").sha256
    assert (runs / "bench" / "compare_refined.parquet").is_file()
    # the same numbers as from the tidy file
    tidy.to_csv(tmp_path / "rig.csv", index=False)
    out = tmp_path / "tidy.parquet"
    call = ["fit-friction", str(tmp_path / "rig.csv"), "-o", str(out), "-q"]
    assert CliRunner().invoke(app, call).exit_code == 0
    mu = dict(zip(friction.columns["run"], friction.columns["mu_sliding"], strict=True))
    expected = read_artifact(out).columns
    assert mu == dict(zip(expected["run"], expected["mu_sliding"], strict=True))
    # a file that changes makes the result stale, and only that
    changed = next((tmp_path / "rig").glob("R*"))
    changed.write_bytes(changed.read_bytes() + b"\r\n")
    assert friction.metadata.inputs["rig"] != content_of(tmp_path / "rig" / "*.lvm").sha256
