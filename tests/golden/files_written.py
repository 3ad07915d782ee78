"""Small recordings, written as the programs of benches write them (synthetic).

A writer takes a folder and returns the name of what it wrote there.
"""

import datetime
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from golden import benches

Writer = Callable[[Path], str]
RIG = benches.Rig(tensions_N=(100.0, 200.0), speeds_rad_s=(0.84,), samples=121).recording()
TRUE: dict[str, pd.DataFrame] = {
    "rig": RIG[benches.CELLS],
    "press": benches.press().iloc[::4].reset_index(drop=True).round(6),
    "speedloss": benches.speed_loss().round(6),
}
"""What the files hold: four runs of the rig, a test of the press, five points of a drive."""
RUNS = {str(k): g.reset_index(drop=True) for k, g in TRUE["rig"].groupby("run")}
R001 = RUNS["R001"]
PRESS = TRUE["press"]
SETTINGS = ["arc_deg", "initial_tension_N"]
CELLS = ["time_s", "tension_tight_N", "tension_slack_N", "pulley_speed_rad_s"]
NAMES = {
    "run": ("Lauf", "Run", "Essai"),
    "test": ("Versuch", "Specimen", "Essai"),
    "time_s": ("Zeit", "Elapsed time", "Temps"),
    "tension_tight_N": ("Trumkraft Zugtrum", "Tight side", "brin tendu"),
    "tension_slack_N": ("Trumkraft Leertrum", "Slack side", "brin mou"),
    "pulley_speed_rad_s": ("Drehzahl", "Pulley speed", "Vitesse de rotation"),
    "arc_deg": ("Umschlingungswinkel", "Wrap angle", "Arc de contact"),
    "initial_tension_N": ("Vorspannkraft", "Initial tension", "Tension initiale"),
    "temperature_degC": ("Temperatur", "Temperature", "Température"),
    "displacement_mm": ("Weg", "Crosshead", "Déplacement"),
    "force_N": ("Kraft", "Load", "Effort"),
    "torque_N_m": ("Drehmoment", "Torque", "Couple"),
    "driver_speed_rad_s": ("Drehzahl Antrieb", "Driver speed", "Vitesse menante"),
    "driven_speed_rad_s": ("Abtriebsdrehzahl", "Driven speed", "Vitesse menée"),
}
"""Our column -> the names that laboratories of three languages give it."""
ENDS = {"_N_m": "N m", "_rad_s": "rad/s", "_degC": "°C", "_deg": "°", "_mm": "mm", "_N": "N"}
UNITS = {c: next((u for end, u in ENDS.items() if c.endswith(end)), "") for c in NAMES}
UNITS["time_s"] = "s"
LBF, INCH = 4.4482216152605, 0.0254
PER: dict[str, float] = {
    "mN": 1e3, "daN": 0.1, "kN": 1e-3, "lbf": 1 / LBF, "kgf": 1 / 9.80665,
    "um": 1e3, "µm": 1e3, "cm": 0.1, "m": 1e-3, "in": 1e-3 / INCH,
    "ms": 1e3, "µs": 1e6, "min": 1 / 60, "h": 1 / 3600,
    "deg/s": 180 / np.pi, "rpm": 30 / np.pi, "1/min": 30 / np.pi, "U/min": 30 / np.pi,
    "rev/s": 0.5 / np.pi, "rad": np.pi / 180, "°F": 1.8,
    "N cm": 1e2, "N mm": 1e3, "kN m": 1e-3,
    "lbf in": 1 / (LBF * INCH), "lbf ft": 1 / (LBF * 12 * INCH),
}  # fmt: skip
"""Unit -> how many of it are one of ours."""
ZERO = {"K": 273.15, "°F": 32.0}


def named(kind: str, units: Mapping[str, str] | None = None, language: int = 0) -> pd.DataFrame:
    """Give a recording under the names of a laboratory, with a unit behind each name."""
    frame, heads = TRUE[kind].copy(), {}
    for name in frame:
        unit = (units or {}).get(name, UNITS[name])
        heads[name] = f"{NAMES[name][language]} [{unit}]" if unit else NAMES[name][language]
        if unit in PER or unit in ZERO:
            frame[name] = frame[name] * PER.get(unit, 1.0) + ZERO.get(unit, 0.0)
    return frame.rename(columns=heads)


def table(
    frame: pd.DataFrame,
    sep: str = ",",
    decimal: str = ".",
    thousands: str = "",
    quote: str = "",
    end: str = "\n",
    units_row: bool = False,
) -> str:
    """Write a frame as text; with `units_row`, units stand below the names."""

    def cell(value: object) -> str:
        text = str(value)
        if isinstance(value, float):
            text = f"{value:,.9f}" if thousands else repr(value)
            text = text.translate(str.maketrans({",": thousands, ".": decimal}))
        return f"{quote}{text}{quote}"

    heads: list[list[str]] = [list(frame.columns)]
    if units_row:
        parts = [str(name).removesuffix("]").partition(" [") for name in frame.columns]
        heads = [[name for name, _, _ in parts], [unit for _, _, unit in parts]]
    rows = [*heads, *frame.astype(object).to_numpy().tolist()]
    return "".join(sep.join(map(cell, row)) + end for row in rows)


def put(
    name: str, content: str | bytes | Callable[[Path], object], encoding: str = "utf-8"
) -> Writer:
    """Write a file of a content, or by what writes it at a path."""

    def write(folder: Path) -> str:
        if callable(content):
            content(folder / name)
        else:
            data = content if isinstance(content, bytes) else content.encode(encoding)
            (folder / name).write_bytes(data)
        return name

    return write


def spoilt(writer: Writer, keep: float = 1.0, flip: float | None = None) -> Writer:
    """Write a file, cut it off or flip a bit in it."""

    def write(folder: Path) -> str:
        name = writer(folder)
        data = bytearray((folder / name).read_bytes())
        if flip is not None:
            data[int(flip * len(data))] ^= 16
        (folder / name).write_bytes(data[: int(keep * len(data))])
        return name

    return write


def one_each(
    name: str,
    drop: Sequence[str] = (),
    write: Callable[[Path, pd.DataFrame], object] = lambda path, run: path.write_text(table(run)),
    path: str = "rig",
    files: str = "",
) -> Writer:
    """Write a file per run into a folder, its label and settings in its name; a table of them."""

    def fill(folder: Path) -> str:
        (folder / "rig").mkdir()
        for label, run in RUNS.items():
            arc, tension = run["arc_deg"][0], run["initial_tension_N"][0]
            file = folder / "rig" / name.format(run=label, arc=arc, tension=tension)
            write(file, run.drop(columns=list(drop)))
        (folder / "runs.csv").write_text(files)
        return path

    return fill


def zipped(path: Path) -> None:
    """Write a zip file with a CSV file per run."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for label, run in RUNS.items():
            archive.writestr(f"{label}.csv", table(run.drop(columns="run")))


# --- testing machines and LabVIEW ----------------------------------------------------------------


def zwick() -> str:
    """A text export of testXpert: quoted fields, names, units, samples between tabs."""
    fields = [
        '"Prüfinstitut"\t"institute_1"',
        '"Datum/Uhrzeit"\t44335.4\t""',
        '"Messlänge Standardweg"\t80\t"mm"',
        f'"Temperatur"\t{PRESS.temperature_degC[0]}\t"°C"',
        '"Bemerkung"\t""',
        '"Prüfzeit"\t"Standardkraft"\t"Standardweg"',
        '"s"\t"N"\t"mm"',
    ]
    rows = PRESS[["time_s", "force_N", "displacement_mm"]].to_numpy().tolist()
    return "\n".join([*fields, *("\t".join(map(repr, row)) for row in rows)]) + "\n"


def lvm(
    *segments: pd.DataFrame, x: str = "No", sep: str = "\t", decimal: str = ",", clock: bool = False
) -> str:
    """A LabVIEW measurement: a head, then segments with their own; with `clock`, each from 0."""

    def number(value: float) -> str:
        return f"{value:.9f}".replace(".", decimal)

    def each(*cells: str) -> list[str]:
        return [c for cell in cells for c in ((cell, "") if x == "Multi" else (cell,))]

    word = {"\t": "Tab", ",": "Comma"}[sep]
    rows = [["LabVIEW Measurement", ""], ["Separator", word], ["Decimal_Separator", decimal]]
    rows += [["Multi_Headings", "Yes"], ["X_Columns", x], ["***End_of_Header***", ""]]
    shown = [NAMES[name][0] for name in CELLS[1:]]
    for segment in segments:
        time = segment["time_s"].to_numpy()
        rows += [
            ["", ""],
            ["Channels", "3", ""],
            ["Date", *each(*["2026/11/20"] * 3), ""],
            ["Time", *each(*[f"09:51:{number(40 + clock * time[0])}"] * 3), ""],
            ["Y_Unit_Label", *each(*[UNITS[name] for name in CELLS[1:]]), ""],
            ["X_Dimension", *each(*["Time"] * 3), ""],
            ["X0", *each(*[number(0.0 if clock else time[0])] * 3), ""],
            ["Delta_X", *each(*[number(time[1] - time[0])] * 3), ""],
            ["***End_of_Header***", "", "", "", ""],
        ]
        multi = x == "Multi"
        heads = [c for n in shown for c in ("X_Value", n)] if multi else ["X_Value", *shown]
        rows.append([*heads, "Comment"])
        for at, *values in segment[CELLS].to_numpy().tolist():
            cells = [number(value) for value in values]
            own = [c for cell in cells for c in (number(at), cell)]
            rows.append(own if multi else [number(at) if x == "One" else "", *cells])
    return "\r\n".join(map(sep.join, rows)) + "\r\n"


# --- containers of channels ----------------------------------------------------------------------


def tdms(path: Path, groups: Mapping[str, tuple[dict[str, float], list[tuple[Any, ...]]]]) -> None:
    """Write NI TDMS: group -> its properties, and its channels: column, values, step."""
    from nptdms import ChannelObject, GroupObject, TdmsWriter

    with TdmsWriter(path) as writer:
        for group, (said, channels) in groups.items():
            objects = [GroupObject(group, properties=said)]
            for name, values, step in channels:
                wave = {"unit_string": UNITS[name], "wf_increment": step, "wf_start_offset": 0.0}
                numbers = np.asarray(values, dtype=float)
                objects.append(ChannelObject(group, NAMES[name][0], numbers, properties=wave))
            writer.write_segment(objects)


def tdms_of_runs(path: Path) -> None:
    """Write TDMS with a group per run."""
    groups = {}
    for label, run in RUNS.items():
        said = {f"{NAMES[c][0]} [{UNITS[c]}]": float(run[c][0]) for c in SETTINGS}
        groups[label] = (said, [(c, run[c], 0.025) for c in CELLS[1:]])
    tdms(path, groups)


def tdms_of_two_rates(path: Path) -> None:
    """Write TDMS with the force in two groups and a temperature at half the rate."""
    machine = [(c, PRESS[c], 0.2) for c in ("force_N", "displacement_mm")]
    line = 22 + 0.01 * PRESS["time_s"][::2]
    check = [("force_N", 2 * PRESS["force_N"], 0.2), ("temperature_degC", line, 0.4)]
    tdms(path, {"Maschine": ({}, machine), "Kontrolle": ({}, check)})


def mdf(path: Path, *starts: float, version: str = "4.10") -> None:
    """Write ASAM MDF: a run in a group for every start, a slow temperature in another."""
    from asammdf import MDF, Signal

    def signal(name: str, values: Any, at: Any) -> Any:
        numbers, shown = np.asarray(values, dtype=float), NAMES[name][0]
        return Signal(numbers, np.asarray(at), unit=UNITS[name], name=shown)

    time = R001["time_s"]
    with MDF(version=version) as file:
        for start in starts:
            columns = (*CELLS[1:], *SETTINGS)
            file.append([signal(c, R001[c], start + time) for c in columns], acq_name="rig")
        file.append([signal("temperature_degC", 22 + 0.1 * time[::8], time[::8])], acq_name="slow")
        file.save(path, overwrite=True)


def structs() -> dict[str, dict[str, Any]]:
    """Give the channels and settings of each run."""
    return {
        label: {c: run[c].to_numpy() for c in CELLS} | {c: float(run[c][0]) for c in SETTINGS}
        for label, run in RUNS.items()
    }


def mat73(path: Path) -> None:
    """Write MATLAB 7.3: HDF5 behind a head of 512 bytes, a group per struct."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for label, run in structs().items():
            group = file.create_group(label)
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            for name, value in run.items():
                data = group.create_dataset(name, data=np.atleast_2d(np.asarray(value)))
                data.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64 HDF5 schema 1.00 ."
    with path.open("r+b") as stream:
        stream.write(head.ljust(124) + b"\x00\x02IM")


def hdf5(path: Path, counts_per_N: float = 0, **said: float) -> None:
    """Write HDF5: a dataset per channel; the force in whole numbers, if it says how many."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, unit in (("time_s", "s"), ("displacement_mm", "um"), ("force_N", "N")):
            values = PRESS[name].to_numpy() * PER.get(unit, 1.0)
            if counts_per_N and name == "force_N":
                values = (counts_per_N * values).astype(np.int16)
            file.create_dataset(NAMES[name][0], data=values).attrs["units"] = unit
        file[NAMES["test"][0]] = PRESS["test"].tolist()
        file[NAMES["force_N"][0]].attrs.update(said)


def workbook(path: Path, sheets: Mapping[str, Iterable[Sequence[Any]]]) -> None:
    """Write an Excel workbook."""
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(list(row))
    book.save(path)


def sheets_of_runs(path: Path) -> None:
    """Write a workbook with a sheet per run: its settings, names, units, samples."""
    book = {}
    for label, run in RUNS.items():
        top = [["Prüfstand", "rig 3"]]
        top += [[NAMES[c][0], float(run[c][0]), UNITS[c]] for c in SETTINGS]
        heads = [[], [NAMES[c][0] for c in CELLS], [UNITS[c] for c in CELLS]]
        book[label] = [*top, *heads, *run[CELLS].to_numpy().tolist()]
    workbook(path, book)


def uff(even: bool) -> bytes:
    """A universal file: datasets 58 in text, evenly spaced or with their times."""
    content = ""
    for name in ("force_N", "displacement_mm"):
        x, y = (PRESS[c].to_numpy() for c in ("time_s", name))
        label, unit = NAMES[name][0], UNITS[name]
        none = f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}"
        head = [
            f"{-1:6d}\n{58:6d}\n{label:<80}",
            *["NONE"] * 4,
            f"{1:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{1:10d}{3:4d} {'NONE':<10}{0:10d}{0:4d}",
            f"{4:10d}{len(y):10d}{int(even):10d}{x[0]:13.5E}{x[1] - x[0]:13.5E}{0:13.5E}",
            f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':<20} {'s':<20}",
            f"{13:10d}{0:5d}{0:5d}{0:5d} {label:<20} {unit:<20}",
            none,
            none,
        ]
        times = [""] * len(x) if even else [f"{t:13.5E}" for t in x]
        cells = [f"{t}{v:20.12E}" for t, v in zip(times, y, strict=True)]
        wide = 4 if even else 2
        rows = ["".join(cells[i : i + wide]) for i in range(0, len(cells), wide)]
        content += "\n".join([*head, *rows, f"{-1:6d}", ""])
    return content.encode()


def parquet(path: Path, columns: Mapping[str, Any]) -> None:
    """Write a Parquet file."""
    pq.write_table(pa.table({name: pa.array(values) for name, values in columns.items()}), path)


# --- clocks --------------------------------------------------------------------------------------

AT = [
    datetime.datetime(2026, 11, 20, 23, 59, 50, 125000) + datetime.timedelta(seconds=t)
    for t in PRESS["time_s"].tolist()
]
"""Times of the samples of the press on a clock that passes midnight."""


def clocked(form: str, head: str = "Uhrzeit", sep: str = ";") -> Writer:
    """Write the press with clock times of a form."""
    lines = table(named("press").drop(columns="Zeit [s]"), sep).splitlines()
    times = [head, *(t.strftime(form) for t in AT)]
    return put("P.csv", "".join(f"{a}{sep}{b}\n" for a, b in zip(times, lines, strict=True)))
