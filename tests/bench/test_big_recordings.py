"""A recording read run by run gives what it gives when it is read at once."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from beltid.bench.big_recording import BigRecording, open_big
from beltid.bench.channels.channel_mapping import MappingContext
from beltid.bench.channels.parquet_tables import stream_parquet
from beltid.bench.files import Source
from beltid.bench.formats import csv_table
from beltid.bench.formats import parquet as parquet
from beltid.bench.formats.csv_table import Wanted, read_rows
from beltid.bench.formats.dialect import Layout
from beltid.bench.formats.numbers import NumberSigns
from beltid.bench.options import ReadOptions
from beltid.bench.recording import read_recording, read_rig
from beltid.config import load_config
from beltid.errors import InputError
from beltid.tables import schemas

RIG = Path(__file__).parents[2] / "rigdata" / "5pk" / "rig.csv"


def same_as_read_at_once(path: Path, config: object = None) -> None:
    at_once = read_recording(path, "rig", config).columns
    n = 0
    for run in open_big(path, config):
        size = len(run.columns["time_s"])
        for name, values in run.columns.items():
            assert np.array_equal(values, at_once[name][n : n + size], equal_nan=True), name
        assert set(at_once["run"][n : n + size]) == {run.label}
        for name, word in run.texts.items():
            assert set(at_once[name][n : n + size]) == {word}, name
        n += size
    assert n == len(at_once["run"])


def rig_of(runs: list[str], n: int = 40) -> dict[str, np.ndarray]:
    """Columns of a recording of the friction rig, synthetic."""
    time_s = np.tile(0.05 * np.arange(n), len(runs))
    turns = time_s > 1.0
    return {
        "run": np.repeat(runs, n),
        "time_s": time_s,
        "tension_tight_N": 100.0 + 20.0 * turns + 0.01 * np.repeat(np.arange(len(runs)), n),
        "tension_slack_N": 100.0 - 20.0 * turns,
        "pulley_speed_rad_s": 0.2 * turns,
        "temperature_degC": np.full(time_s.size, 22.0),
        "arc_deg": np.full(time_s.size, 82.0),
        "initial_tension_N": np.full(time_s.size, 100.0),
    }


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks and blocks that end anywhere within rows and runs."""
    monkeypatch.setattr(csv_table, "CHUNK", 9973)
    monkeypatch.setattr(csv_table, "ARROW_BLOCK", 1009)


def some_rows(n: int = 1500) -> list[str]:
    return RIG.read_text().splitlines()[: n + 1]


def parsed(cells: list[str]) -> tuple[list[float], list[str]]:
    """Numbers of cells of a CSV file, and what is wrong with them."""
    body = "".join(f"r,{cell}\n" for cell in cells).encode()
    layout = Layout(("run", "x"), (), ",", NumberSigns(), body, 2, (), 1)
    rows = read_rows(layout, {"run": Wanted(0, True, "run"), "x": Wanted(1, False, "x")}, "a.csv")
    return rows.numbers["x"].tolist(), [text for _, text in rows.problems.found]


def test_the_recordings_of_the_paper_s_rig(small_chunks: None) -> None:
    same_as_read_at_once(RIG)


def test_rows_in_windows_manners_with_a_comma(small_chunks: None, tmp_path: Path) -> None:
    rows = [line.replace(",", ";").replace(".", ",") for line in some_rows()]
    path = tmp_path / "rig.csv"
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(rows).encode())
    same_as_read_at_once(path)


def test_what_rows_say_of_a_run_whatever_its_capitals(tmp_path: Path) -> None:
    head, *rows = some_rows()
    path = tmp_path / "rig.csv"
    said = [f"{row},Wet,RIB" for row in rows]
    path.write_text("\n".join([f"{head},condition,side", *said]) + "\n")
    same_as_read_at_once(path)
    words = {"condition": "wet", "side": "rib"}
    assert all(run.texts == words for run in open_big(path))


@pytest.mark.parametrize("packed", [False, True], ids=["csv", "parquet"])
def test_what_rows_say_of_a_run_is_one_word(tmp_path: Path, packed: bool) -> None:
    """Said in some rows, it holds for all; a run that says two things is two runs."""
    columns: dict[str, object] = rig_of(["1", "2", "3"])
    dry, wet = ["dry"] * 40, [None, "WET", *["wet"] * 38]
    path = tmp_path / ("rig.parquet" if packed else "rig.csv")

    def write(words: list[str | None]) -> None:
        frame = pa.table(columns | {"condition": words})
        pq.write_table(frame, path) if packed else pc.write_csv(frame, path)

    write([*dry, *wet, *[None] * 40])
    same_as_read_at_once(path)
    assert [run.texts for run in open_big(path)] == [{"condition": "dry"}, {"condition": "wet"}, {}]
    write([*dry, "wet", *dry[1:], *dry[:-1], "foggy"])
    for read in (lambda: read_recording(path, "rig"), lambda: list(open_big(path))):
        with pytest.raises(InputError) as caught:
            read()
        second, last = (f"{path}, row 42", f"{path}, row 120")
        if not packed:
            second, last = f"{path}:43", f"{path}:121"
        why = "within run {} (is the label used twice?)".format
        assert caught.value.problems == (
            f"{second}: condition = dry, must stay wet {why(2)}",
            f"{last}: condition = foggy, must be dry, wet or dusty",
            f"{last}: condition = foggy, must stay dry {why(3)}",
        )


def test_rows_that_only_the_exact_reader_takes(small_chunks: None, tmp_path: Path) -> None:
    rows = some_rows()
    cells = [row.split(",") for row in rows]
    cells[200][2] = "NaN"
    cells[333] = [f'"{cell}"' for cell in cells[333]]
    cells[700][2] = f"{float(cells[700][2]):.17f}"
    path = tmp_path / "rig.csv"
    path.write_text("\n".join(",".join(row) for row in cells) + "\n\n")
    same_as_read_at_once(path)


def test_other_names_and_units(small_chunks: None, tmp_path: Path) -> None:
    rows = some_rows()
    rows[0] = rows[0].replace("tension_tight_N", "Zugtrum").replace("arc_deg", "Bogen")
    path = tmp_path / "rig.csv"
    path.write_text("\n".join(rows) + "\n")
    config = load_config(
        {
            "columns": {"rig": {"tension_tight_N": "Zugtrum", "arc_deg": "Bogen"}},
            "units": {"rig": {"pulley_speed_rad_s": "rpm"}},
        }
    )
    same_as_read_at_once(path, config)


def test_packed_with_gzip(small_chunks: None, tmp_path: Path) -> None:
    path = tmp_path / "rig.csv.gz"
    path.write_bytes(gzip.compress("\n".join(some_rows(5000)).encode() + b"\n", mtime=0))
    same_as_read_at_once(path)
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(InputError, match=r"rig\.csv\.gz: the gzip file is damaged or cut off"):
        list(open_big(path))


def test_parquet_in_a_file_of_many_row_groups(tmp_path: Path) -> None:
    import pandas as pd

    path = tmp_path / "rig.parquet"
    pd.read_csv(RIG, dtype={"run": str}, nrows=5000).to_parquet(path, row_group_size=700)
    same_as_read_at_once(path)


def test_a_damaged_parquet_file_is_refused(tmp_path: Path) -> None:
    import pandas as pd

    path = tmp_path / "rig.parquet"
    pd.read_csv(RIG, dtype={"run": str}).to_parquet(path, index=False)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"rig\.parquet: damaged"):
        list(open_big(path))


def test_a_run_that_goes_on_after_others_is_refused_with_both_places(
    small_chunks: None, tmp_path: Path
) -> None:
    rows = some_rows()
    labels = [row.split(",")[0] for row in rows]
    second = next(i for i in range(2, len(labels)) if labels[i] != labels[1])
    rows.append(rows[1])
    path = tmp_path / "rig.csv"
    path.write_text("\n".join(rows) + "\n")
    message = rf"rig\.csv:{len(rows)}: run {labels[1]} continues here .* it began in line 2:"
    with pytest.raises(InputError, match=message):
        list(open_big(path))
    assert second > 2


@pytest.mark.parametrize(
    ("row", "column", "cell"),
    [(700, 2, "-3.1"), (901, 3, "0"), (40, 6, "400"), (41, 1, "-1"), (42, 4, "inf"), (43, 3, "x")],
)
def test_faults_are_reported_as_when_read_at_once(
    small_chunks: None, tmp_path: Path, row: int, column: int, cell: str
) -> None:
    cells = [line.split(",") for line in some_rows()]
    cells[row][column] = cell
    path = tmp_path / "rig.csv"
    path.write_text("\n".join(",".join(line) for line in cells) + "\n")
    with pytest.raises(InputError) as at_once:
        read_recording(path, "rig")
    with pytest.raises(InputError) as streamed:
        list(open_big(path))
    assert streamed.value.problems == at_once.value.problems
    assert f"rig.csv:{row + 1}: " in str(streamed.value)


def streamed(path: Path, data: bytes) -> tuple[list[str], tuple[str, ...]]:
    """Labels of the runs and the notes of a recording read run by run."""
    path.write_bytes(data)
    recording = open_big(path)
    return [run.label for run in recording], recording.notes


def relabelled(old: bytes, new: bytes) -> bytes:
    return RIG.read_bytes().replace(b"\n" + old + b",", b"\n" + new + b",")


@pytest.mark.parametrize(
    ("label", "words"),
    [
        (b"R\xfc1", "byte 0xFC is not UTF-8; if the file is in another encoding, say which"),
        (b"R\x001", "contains a zero byte: damaged, or not a text file"),
        (b"R\r1", "1 cells, must be 8"),
    ],
)
def test_a_label_that_is_no_text_is_refused_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, label: bytes, words: str
) -> None:
    monkeypatch.setattr("beltid.bench.big_recording.HEAD", 1000)
    data = relabelled(b"R019", label)
    line = 1 + data[: data.index(b"\n" + label)].count(b"\n") + 1
    with pytest.raises(InputError, match=rf"rig\.csv:{line}: {words}"):
        streamed(tmp_path / "rig.csv", data)


def test_a_last_line_that_does_not_end_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("beltid.bench.big_recording.HEAD", 1000)
    path, data = tmp_path / "rig.csv", RIG.read_bytes()
    assert not any("does not end" in note for note in streamed(path, data)[1])
    _, notes = streamed(path, data[:-1])
    assert notes == read_recording(path, "rig").notes
    assert "the last line does not end" in notes[0]


@pytest.mark.parametrize("feed", ["\n", "\r\n"])
@pytest.mark.parametrize("gap", [0, 40])
def test_the_first_and_the_last_row_count_wherever_a_block_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, feed: str, gap: int
) -> None:
    header, *rows = (line.replace(",", ";").replace(".", ",") for line in some_rows(3))
    path = tmp_path / "rig.csv"
    for body in (rows, rows[:1]):
        data = (header + feed * gap + feed + feed.join(body)).encode()
        path.write_bytes(data)
        for size in range(len(header) + 3, len(data) + 2, 3):
            monkeypatch.setattr(csv_table, "CHUNK", size)
            monkeypatch.setattr("beltid.bench.big_recording.HEAD", len(header) + 2 + size % 5)
            same_as_read_at_once(path)
    cut = path.with_name("cut.csv")
    cut.write_bytes(data[: data.rindex(b";")])
    with pytest.raises(InputError, match=rf"cut\.csv:{gap + 2}: 7 cells, must be 8"):
        list(open_big(cut))


def test_the_only_row_behind_megabytes_of_blank_lines(tmp_path: Path) -> None:
    header, row = (line.replace(",", ";").replace(".", ",") for line in some_rows(1))
    path = tmp_path / "rig.csv"
    path.write_text(header + "\n" * (3 << 20) + row)
    same_as_read_at_once(path)
    (run,) = open_big(path)
    assert run.columns["tension_tight_N"].tolist() == [float(row.split(";")[2].replace(",", "."))]


def test_cells_over_several_lines_end_anywhere_in_a_chunk(
    small_chunks: None, tmp_path: Path
) -> None:
    header, *rows = some_rows()
    noted = [('"one\ntwo",' if i % 7 == 0 else "one,") + row for i, row in enumerate(rows)]
    path = tmp_path / "rig.csv"
    path.write_text("\n".join(["note," + header, *noted]) + "\n")
    same_as_read_at_once(path)
    inches = ['5" pulley,' + row for row in rows]  # marks that pair with nothing
    path.write_text("\n".join(["note," + header, *inches]) + "\n")
    same_as_read_at_once(path)


def test_a_setting_that_no_column_holds_is_asked_for_once(tmp_path: Path) -> None:
    path = tmp_path / "rig.csv"
    rows = [row.split(",") for row in some_rows()]
    path.write_text("\n".join(",".join(row[:6] + row[7:]) for row in rows) + "\n")
    with pytest.raises(InputError) as at_once:
        read_recording(path, "rig")
    with pytest.raises(InputError) as in_a_stream:
        open_big(path)
    assert in_a_stream.value.problems == at_once.value.problems


def test_a_header_that_does_not_end_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("beltid.bench.big_recording.HEAD", 1000)
    with pytest.raises(InputError, match=r"rig\.csv:1: no line feed in the first 1,000 bytes"):
        streamed(tmp_path / "rig.csv", RIG.read_bytes().replace(b"\n", b"\r"))


def rig_with(path: Path, tight: Callable[[str, float], float | None]) -> Path:
    """A recording whose tight cell reads otherwise."""
    header, *rows = some_rows()
    cells = [row.split(",") for row in rows]
    for row in cells:
        found = tight(row[0], float(row[2] or "nan"))
        row[2] = "" if found is None else repr(found)
    path.write_text("\n".join([header, *(",".join(row) for row in cells)]) + "\n")
    return path


def test_a_cell_that_is_dead_in_the_first_run_refuses_no_recording(tmp_path: Path) -> None:
    path = rig_with(tmp_path / "rig.csv", lambda run, f: None if run == "R001" else f)
    same_as_read_at_once(path)


def test_a_cell_that_is_dead_everywhere_is_reported_at_the_end(tmp_path: Path) -> None:
    path = rig_with(tmp_path / "rig.csv", lambda run, f: None)
    with pytest.raises(InputError) as at_once:
        read_recording(path, "rig")
    with pytest.raises(InputError) as in_a_stream:
        list(open_big(path))
    assert in_a_stream.value.problems == at_once.value.problems


def test_a_unit_is_doubted_in_the_first_run_that_shows_it(tmp_path: Path) -> None:
    path = rig_with(tmp_path / "rig.csv", lambda run, f: None if run == "R001" else f / 1000)
    with pytest.raises(InputError, match=r"tension_tight_N lies between .* if it is in kN"):
        list(open_big(path))


def test_a_sign_is_doubted_once(tmp_path: Path) -> None:
    path = rig_with(tmp_path / "rig.csv", lambda run, f: -f)
    with pytest.raises(InputError) as error:
        list(open_big(path))
    assert len(error.value.problems) == 1
    assert "tension_tight_N is negative nearly everywhere" in error.value.problems[0]
    path = rig_with(path, lambda run, f: -f if run == "R002" else f)
    with pytest.raises(InputError) as at_once:
        read_recording(path, "rig")
    with pytest.raises(InputError) as in_a_stream:
        list(open_big(path))
    assert in_a_stream.value.problems == at_once.value.problems


@given(st.lists(st.floats(-9e6, 9e6, allow_nan=False), min_size=1, max_size=20), st.integers(0, 17))
def test_numbers_are_the_nearest_doubles(values: list[float], places: int) -> None:
    cells = [f"{value:.{places}f}" for value in values]
    assert parsed(cells) == ([float(cell) for cell in cells], [])


@given(st.from_regex(r"-?[0-9]{1,20}(\.[0-9]{0,8})?([eE][-+]?[0-9]{1,2})?", fullmatch=True))
def test_exponents_and_long_numbers_are_read_to_the_last_bit(cell: str) -> None:
    assert parsed([cell]) == ([float(cell)], [])


@pytest.mark.parametrize("cell", [".", "1e", "1,5", "0x1", "1.2.3", "1_0", "1 0", "--1", "١"])
def test_what_is_no_plain_number_is_refused_with_its_line(cell: str) -> None:
    problems = parsed(["1.0", f'"{cell}"'])[1]
    assert problems == [f'a.csv:3: x = "{cell}", must be a number']


def test_a_parquet_file_takes_a_part_of_its_size_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither the file nor a row group of it is held at once, and nothing of it stays."""
    monkeypatch.setattr(parquet, "ROWS", 1 << 14)
    rng = np.random.default_rng(4)
    n = 1_500_000
    columns = {"run": np.full(n, "a")}
    columns |= {
        column.name: rng.uniform(20.0, 30.0, n)
        for column in schemas.table("rig").columns
        if column.dtype == "float64"
    }
    path = tmp_path / "rig.parquet"
    pq.write_table(pa.table(columns), path, row_group_size=n)
    del columns
    source = Source(str(path), path, Path(path.name))
    before, most, read = pa.total_allocated_bytes(), 0, 0
    _, _, blocks = stream_parquet([source], MappingContext(schemas.table("rig"), ReadOptions()))
    for block in blocks:
        most = max(most, pa.total_allocated_bytes() - before)
        read += len(block)
    assert read == n
    assert most < path.stat().st_size / 3


def parts(folder: Path, name: str, changed: dict[str, pa.Array | None]) -> Path:
    """A folder of Parquet files with one run in which columns are changed or left out."""
    import pandas as pd

    frame = pd.read_csv(RIG, dtype={"run": str}).iloc[:300]
    table = pa.Table.from_pandas(frame, preserve_index=False)
    for column, values in changed.items():
        table = table.drop_columns([column])
        table = table if values is None else table.append_column(column, values)
    (folder / name).parent.mkdir(parents=True)
    pq.write_table(table, folder / name)
    return folder


def refused_by_both(folder: Path) -> tuple[str, ...]:
    file = next(folder.rglob("*.parquet"))
    with pytest.raises(InputError) as at_once:
        read_recording(file, "rig")
    with pytest.raises(InputError) as in_a_stream:
        list(open_big(file))
    assert in_a_stream.value.problems == at_once.value.problems
    return at_once.value.problems


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("tension_slack_N", pa.array(range(300), pa.duration("ms"))),
        ("tension_tight_N", pa.array([True] * 300)),
        ("run", pa.array(range(300), pa.date32())),
    ],
)
def test_columns_of_dates_durations_and_truths_are_no_numbers(
    tmp_path: Path, column: str, values: pa.Array
) -> None:
    problems = refused_by_both(parts(tmp_path, "x/a.parquet", {column: values}))
    assert f"column {column} holds {values.type}, must hold " in problems[0]


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("temperature_degC", pa.nulls(300)),
        ("tension_tight_N", pa.array([50] * 300).cast(pa.decimal128(21, 2))),
        ("time_s", pa.array([2**60 + 1000 * i for i in range(300)])),
        ("time_s", pa.array(range(0, 6000, 20), pa.duration("ms"))),
    ],
)
def test_all_types_of_numbers_are_read_alike(tmp_path: Path, column: str, values: pa.Array) -> None:
    folder = parts(tmp_path, "x/a.parquet", {column: values})
    same_as_read_at_once(next(folder.rglob("*.parquet")))


def test_a_folder_of_folders_holds_no_recording(tmp_path: Path) -> None:
    folder = parts(tmp_path, "arc_deg=99/a.parquet", {"arc_deg": None})
    with pytest.raises(InputError, match="holds no recording"):
        open_big(folder)
    with pytest.raises(InputError, match="arc_deg"):
        open_big(folder / "*" / "*.parquet")


def test_a_unit_in_other_bytes_than_utf_8_is_reported(tmp_path: Path) -> None:
    columns = pa.table(rig_of(["1"]))
    about = pa.field("temperature_degC", pa.float64(), metadata={b"unit": "°C".encode("latin-1")})
    at = columns.schema.get_field_index("temperature_degC")
    path = tmp_path / "rig.parquet"
    pq.write_table(columns.set_column(at, about, columns.column(at)), path)
    with pytest.raises(InputError, match=r"temperature_degC is in \ufffdC, must be one of degC"):
        read_recording(path, "rig")


def test_a_parquet_file_is_opened_once_for_its_names_and_once_for_its_texts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, footers = tmp_path / "rig.parquet", []
    pq.write_table(pa.table(rig_of(["1", "2"])), path)
    opened = pq.ParquetFile
    monkeypatch.setattr(
        pq, "ParquetFile", lambda *a, **k: footers.append(k["metadata"]) or opened(*a, **k)
    )
    assert len(list(open_big(path))) == 2
    assert [footer is None for footer in footers] == [True, False]  # the footer is read once


def test_a_recording_without_samples_is_refused(tmp_path: Path) -> None:
    file = parts(tmp_path, "x/a.parquet", {}) / "x" / "a.parquet"
    pq.write_table(pq.read_table(file).slice(0, 0), file)
    assert refused_by_both(tmp_path) == (f"{file}: holds no samples",)


def test_numbered_parts_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    import pandas as pd

    frame = pd.read_csv(RIG, dtype={"run": str}).iloc[:1200]
    (tmp_path / "x").mkdir()
    for k in range(12):  # as pyarrow.parquet.write_to_dataset names them
        part = frame.iloc[100 * k : 100 * (k + 1)]
        part.to_parquet(tmp_path / "x" / f"part-{k}.parquet", index=False)
    runs = list(open_big(tmp_path / "x"))
    assert [run.label for run in runs] == list(dict.fromkeys(frame["run"]))
    assert np.array_equal(
        np.concatenate([run.columns["time_s"] for run in runs]), frame["time_s"].to_numpy()
    )


def season(folder: Path) -> tuple[Path, dict[str, np.ndarray]]:
    """A flat folder with a small Parquet file per run, and the columns in it."""
    import pandas as pd

    frame = pd.read_csv(RIG, dtype={"run": str}).iloc[:1500]
    folder.mkdir()
    for run, part in frame.groupby("run"):
        part.to_parquet(folder / f"{run}.parquet", index=False)
    return folder, {name: frame[name].to_numpy() for name in frame.columns}


def test_a_flat_folder_of_small_parquet_files_is_read_as_a_large_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, wanted = season(tmp_path / "season")
    for path in (folder, folder / "*.parquet"):
        at_once = read_rig(path)
        assert not isinstance(at_once, BigRecording)
        for name, values in at_once.columns.items():
            assert np.array_equal(values, wanted[name]), name
    with monkeypatch.context() as patched:
        patched.setattr("beltid.bench.recording.BIG", 1000)
        assert isinstance(read_rig(folder), BigRecording)
        assert isinstance(read_rig(folder / "*.parquet"), BigRecording)
    same_as_read_at_once(folder)


def test_a_folder_of_parquet_files_of_another_bench(tmp_path: Path) -> None:
    import pandas as pd

    frame = pd.read_csv(RIG.parent / "press.csv", dtype={"test": str})
    for test, part in frame.groupby("test"):
        part.to_parquet(tmp_path / f"{test}.parquet", index=False)
    recording = read_recording(tmp_path, "press")
    assert np.array_equal(recording.columns["force_N"], frame["force_N"].to_numpy())


@pytest.mark.parametrize("name", ["rig.csv", "rig.txt", "rig.dat", "rig", "rig.xlsx", "rig.lvm"])
@pytest.mark.parametrize("packed", [False, True])
def test_no_ending_decides_how_a_big_file_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, packed: bool
) -> None:
    monkeypatch.setattr("beltid.bench.recording.BIG", 10_000)
    path = tmp_path / name
    data = "\n".join(some_rows()).encode() + b"\n"
    path.write_bytes(gzip.compress(data) if packed else data)
    assert isinstance(read_rig(path), BigRecording)


def test_a_big_file_of_another_format_called_csv_is_read_by_its_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import writers

    path = writers.write_xlsx(tmp_path / "rig.csv", writers.rig_runs(1))
    monkeypatch.setattr("beltid.bench.recording.BIG", 1000)
    recording = read_rig(path)
    assert not isinstance(recording, BigRecording)
    assert len(recording.columns["time_s"]) == len(writers.rig_runs(1)["R001"])


def test_a_packed_file_is_as_big_as_what_is_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "rig.csv.gz"
    path.write_bytes(gzip.compress(RIG.read_bytes()))
    size = path.stat().st_size
    monkeypatch.setattr("beltid.bench.files.archives.MAX_BYTES", 2 * size)
    for limit in (size - 1000, size + 1000):  # packed just above and just below it
        monkeypatch.setattr("beltid.bench.recording.BIG", limit)
        recording = read_rig(path)
        assert isinstance(recording, BigRecording)
        assert len(list(recording)) == 120
    monkeypatch.setattr("beltid.bench.recording.BIG", RIG.stat().st_size + 1)
    with pytest.raises(InputError, match="unpacks to more than"):
        read_rig(path)
