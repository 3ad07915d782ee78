"""The day on which a recording was made, as the files of benches tell it."""

from __future__ import annotations

import datetime
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from beltid.bench.formats.clock import day_in
from beltid.bench.recorded_date import recorded_on
from beltid.config import load_config

DATA = Path(__file__).parent / "data"
CONFIG = load_config({})
STAMPS = [datetime.datetime(2024, 5, 17, 13, 45, second) for second in (2, 3)]


@pytest.mark.parametrize(
    ("text", "day"),
    [
        ("2024-05-17T13:45:02+02:00", "2024-05-17"),
        ("2013/2/9", "2013-02-09"),
        ("am 7.5.2024 um 13:45", "2024-05-07"),
        ("05/27/2024", "2024-05-27"),
        ("27/05/2024", "2024-05-27"),
        ("04/04/2024", "2024-04-04"),
        ("05/07/2024", None),  # May or July
        ("2024-13-01", None),
        ("31.02.2024", None),
        ("13:45:02", None),
        ("1.2345", None),
    ],
)
def test_a_day_is_read_as_it_can_only_be_meant(text: str, day: str | None) -> None:
    assert day_in(text) == day


def test_real_files_tell_their_day() -> None:
    # as their headers say: Date 2013/02/19; Datum/Uhrzeit 44335.4, days of Excel
    assert recorded_on(DATA / "labview-two-channels.lvm", CONFIG, "rig") == "2013-02-19"
    assert recorded_on(DATA / "zwick-testxpert-export.txt", CONFIG, "press") == "2021-05-19"


@pytest.mark.parametrize(
    ("text", "day"),
    [
        ("# Test date: 17.05.2024\ntime_s,force_N\n0,1\n", "2024-05-17"),
        ("Kalibriert;12.03.2019\nPrüfdatum;17.05.2024\nZeit;Kraft\n0;1\n", "2024-05-17"),
        ("time,force_N\n2024-05-17 23:59:59.5,1\n2024-05-18 00:00:00.5,1\n", "2024-05-17"),
        ("run,time\nR1,17.05.2024 13:45:02\n", "2024-05-17"),
        ("Kalibriert;12.03.2019\nZeit;Kraft\n0;1\n", None),
        ("time_s,force_N\n0.1,20240517\n", None),
        ("Zeit;45000\nZeit;Kraft\n0;1\n", None),
    ],
)
def test_text_files_tell_it_in_a_header_or_by_their_first_sample(
    tmp_path: Path, text: str, day: str | None
) -> None:
    path = tmp_path / "rig.csv"
    path.write_text(text)
    assert recorded_on(path, CONFIG, "rig") == day


def test_several_files_tell_the_first_and_the_last_day(tmp_path: Path) -> None:
    for name, day in (("a.csv", "18"), ("b.csv", "11"), ("c.csv", "17")):
        (tmp_path / name).write_text(f"date;2024-05-{day}\ntime_s;force_N\n0;1\n")
    with zipfile.ZipFile(tmp_path / "runs.zip", "w") as archive:
        archive.write(tmp_path / "c.csv", "c.csv")
    assert recorded_on(tmp_path / "runs.zip", CONFIG, "rig") == "2024-05-17"
    (tmp_path / "runs.zip").unlink()
    assert recorded_on(tmp_path, CONFIG, "rig") == "2024-05-17 to 2024-05-18"


def test_formats_of_measuring_programs_tell_it_in_a_field(tmp_path: Path) -> None:
    from nptdms import ChannelObject, RootObject, TdmsWriter
    from openpyxl import Workbook

    with TdmsWriter(tmp_path / "rig.tdms") as writer:
        root = RootObject(properties={"Date": "2024-05-17", "Bench": "rig 3"})
        writer.write_segment([root, ChannelObject("g", "force", [1.0, 2.0])])
    assert recorded_on(tmp_path / "rig.tdms", CONFIG, "rig") == "2024-05-17"
    book = Workbook()
    date = ["Datum", datetime.datetime(2024, 5, 17)]
    for row in (date, [], ["time_s", "force_N"], [0, 1], [1, 2]):
        book.active.append(row)
    book.save(tmp_path / "rig.xlsx")
    assert recorded_on(tmp_path / "rig.xlsx", CONFIG, "rig") == "2024-05-17"


@pytest.mark.parametrize(
    "columns",
    [
        {"time_s": pa.array(STAMPS, pa.timestamp("ns"))},
        {"time_s": pa.array(STAMPS, pa.timestamp("us", tz="UTC"))},
        {"time_s": ["17.05.2024 13:45:02", "17.05.2024 13:45:03"]},
        {"time_s": [t.time() for t in STAMPS], "Datum": [t.date() for t in STAMPS]},
    ],
)
def test_parquet_tells_it_by_its_first_stamp(tmp_path: Path, columns: dict[str, Any]) -> None:
    pq.write_table(pa.table({**columns, "force_N": [1.0, 2.0]}), tmp_path / "rig.parquet")
    assert recorded_on(tmp_path / "rig.parquet", CONFIG, "rig") == "2024-05-17"


def test_formats_of_measuring_programs_tell_it_by_their_start(tmp_path: Path) -> None:
    from asammdf import MDF, Signal
    from nptdms import ChannelObject, TdmsWriter

    file = MDF(version="4.10")
    file.append([Signal(np.arange(3.0), np.arange(3.0), unit="N", name="force_N")])
    file.start_time = STAMPS[0].replace(tzinfo=datetime.UTC)
    file.save(tmp_path / "rig.mf4")
    file.close()
    assert recorded_on(tmp_path / "rig.mf4", CONFIG, "rig") == "2024-05-17"
    start = {"wf_start_time": np.datetime64(STAMPS[0]), "wf_increment": 0.1}
    with TdmsWriter(tmp_path / "rig.tdms") as writer:
        writer.write_segment([ChannelObject("g", "force", [1.0, 2.0], properties=start)])
    assert recorded_on(tmp_path / "rig.tdms", CONFIG, "rig") == "2024-05-17"


def test_what_cannot_be_read_tells_nothing(tmp_path: Path) -> None:
    (tmp_path / "rig.parquet").write_bytes(b"PAR1 and no more")
    (tmp_path / "rig.zip").write_bytes(b"PK and no more")
    for name in ("rig.parquet", "rig.zip", "gone.csv"):
        assert recorded_on(tmp_path / name, CONFIG, "rig") is None
