"""What there is to touch for a new column: its table, and whatever computes it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from beltid.artifacts.metadata_models import METADATA
from beltid.config import Config
from beltid.tables import schemas
from beltid.tables.units import CONVERSIONS

NEW_COLUMNS = """
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from beltid.tables import schemas
from beltid.tables.columns import optional, real, text

folder = Path(sys.argv[1])
new = optional(real("wrap_force_N", "N", "force of the wrap"), text("operator", "who ran it"))
for kind in ("rig", "friction"):
    table = schemas.TABLES[kind]
    schemas.TABLES[kind] = replace(table, columns=(*table.columns, *new))

from beltid.artifacts.artifact import read_artifact, write_artifact
from beltid.artifacts.metadata_models import Metadata
from beltid.bench.recording import read_recording
from beltid.config import load_config

# the config knows its name and unit in the files
config = load_config(
    {
        "columns": {"rig": {"wrap_force_N": "Wrap"}},
        "units": {"rig": {"wrap_force_N": "kN"}},
    }
)
# a recording is read with it, converted
names = "run,time_s,tension_tight_N,tension_slack_N,pulley_speed_rad_s,arc_deg,initial_tension_N"
rows = [f"R1,{0.01 * i},110,90,0.2,82,100,{0.002 * i}" for i in range(20)]
(folder / "rig.csv").write_text("\\n".join([names + ",Wrap", *rows]))
read = read_recording(folder / "rig.csv", "rig", config).columns["wrap_force_N"]
np.testing.assert_allclose(read, 2.0 * np.arange(20), rtol=1e-12)

# an artifact takes it, tells its unit and gives it back
columns = {}
for column in schemas.table("friction").columns:
    if column.dtype == "string":
        columns[column.name] = ["ok"]
    elif column.dtype in ("int64", "float64"):
        columns[column.name] = [7]
    elif column.dtype == "bool":
        columns[column.name] = [True]
write_artifact(folder / "friction.parquet", "friction", columns, Metadata())
artifact = read_artifact(folder / "friction.parquet", "friction")
assert artifact.columns["wrap_force_N"].tolist() == [7.0]
assert artifact.units["wrap_force_N"] == "N"
assert artifact.columns["operator"].tolist() == ["ok"]
"""


def test_a_new_column_is_read_configured_and_stored_by_its_table_alone(tmp_path: Path) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", NEW_COLUMNS, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr


def test_the_registries_by_kind_hold_the_same_kinds() -> None:
    config = Config()
    by_recording = {
        "columns": config.columns,
        "units": config.units,
        "runs": config.runs,
        # a table of plateaus is named to the command, the chain begins with recordings
        "data": [
            *(k for k in type(config.data).model_fields if k != "origin"),
            "points",
        ],
    }
    assert {name: tuple(kinds) for name, kinds in by_recording.items()} == dict.fromkeys(
        by_recording, schemas.RECORDINGS
    )
    assert tuple(METADATA) == schemas.ARTIFACTS
    assert {*schemas.RECORDINGS, *schemas.ARTIFACTS} == set(schemas.TABLES)


def test_every_number_of_a_recording_has_a_unit_that_others_convert_to() -> None:
    for kind in schemas.RECORDINGS:
        for column in schemas.table(kind).columns:
            if column.dtype == "float64":
                assert column.unit in CONVERSIONS, f"{kind}.{column.name}"


def test_the_settings_of_a_run_are_columns_of_recordings() -> None:
    known = {c.name for kind in schemas.RECORDINGS for c in schemas.table(kind).columns}
    assert set(schemas.SETTINGS) <= known
