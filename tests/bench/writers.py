"""Recordings of rigdata in every format that benches write, by that format's own library."""

from __future__ import annotations

import functools
import gzip
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[2]
DATA = ROOT / "rigdata" / "5pk"
UNITS = {
    "time_s": "s",
    "tension_tight_N": "N",
    "tension_slack_N": "N",
    "pulley_speed_rad_s": "rad/s",
    "temperature_degC": "degC",
    "arc_deg": "deg",
    "initial_tension_N": "N",
    "displacement_mm": "mm",
    "force_N": "N",
}
Runs = Mapping[str, pd.DataFrame]


@functools.cache
def recorded(kind: str) -> pd.DataFrame:
    """A recording of rigdata, read once; nobody changes it."""
    return pd.read_csv(DATA / f"{kind}.csv", dtype={"run": str, "test": str})


def first_of(kind: str, label: str, n: int) -> dict[str, pd.DataFrame]:
    frame = recorded(kind)
    labels = frame[label].unique()[:n]
    return {name: frame[frame[label] == name].reset_index(drop=True) for name in labels}


def rig_runs(n: int = 3) -> dict[str, pd.DataFrame]:
    """The first runs of rigdata, by their label."""
    return first_of("rig", "run", n)


def press_tests(n: int = 1) -> dict[str, pd.DataFrame]:
    """The first tests of the press of rigdata, by their label."""
    return first_of("press", "test", n)


def sensors(run: pd.DataFrame) -> pd.DataFrame:
    """Channels of a run without its label and settings."""
    return run.drop(
        columns=[c for c in ("run", "test", "arc_deg", "initial_tension_N") if c in run]
    )


def write_lvm(
    path: Path, run: pd.DataFrame, *, x_columns: str = "No", decimal: str = ",", header: str = ""
) -> Path:
    """A LabVIEW measurement file, as its sample is laid out."""
    channels = sensors(run).drop(columns="time_s")
    time = run["time_s"].to_numpy()
    step = float(np.median(np.diff(time)))
    n = channels.shape[1]

    def number(value: float) -> str:
        return "" if np.isnan(value) else repr(float(value)).replace(".", decimal)

    def line(key: str, *cells: str) -> str:
        return "\t".join([key, *cells, ""])

    names = {
        "tension_tight_N": "Trumkraft Zugtrum",
        "tension_slack_N": "Trumkraft Leertrum",
        "pulley_speed_rad_s": "Winkelgeschwindigkeit",
        "temperature_degC": "Temperatur",
    }
    units = [UNITS[c] for c in channels]
    lines = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        f"Decimal_Separator\t{decimal}",
        "Multi_Headings\tYes",
        f"X_Columns\t{x_columns}",
        "Time_Pref\tAbsolute",
        "Operator\tNN",
        "Date\t2026/11/20",
        "Time\t09:51:39,1970510124996275989",
        *([header] if header else []),
        "***End_of_Header***\t",
        "\t",
        line("Channels", str(n)),
        line("Samples", *[str(len(run))] * n),
        line("Date", *["2026/11/20"] * n),
        line("Time", *["09:51:40,7271890640258789063"] * n),
        line("Y_Unit_Label", *units),
        line("X_Dimension", *["Time"] * n),
        line("X0", *[number(float(time[0]))] * n),
        line("Delta_X", *[number(step)] * n),
        "***End_of_Header***" + "\t" * (n + 1),
    ]
    shown = [names.get(c, c) for c in channels]
    if x_columns == "Multi":
        lines.append("\t".join(cell for name in shown for cell in ("X_Value", name)) + "\tComment")
    else:
        lines.append("\t".join(["X_Value", *shown, "Comment"]))
    for t, row in zip(time, channels.to_numpy(), strict=True):
        cells = [number(v) for v in row]
        if x_columns == "Multi":
            lines.append("\t".join(c for cell in cells for c in (number(t), cell)))
        else:
            lines.append("\t".join(["" if x_columns == "No" else number(t), *cells]))
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode())
    return path


def write_zwick(path: Path, test: pd.DataFrame, encoding: str = "utf-8") -> Path:
    """A text export of testXpert, as its sample is laid out."""
    temperature = float(test["temperature_degC"].mean())
    head = (ROOT / "tests/bench/data/zwick-testxpert-export.txt").read_text(encoding="utf-8")
    fields = [line for line in head.split("\n")[:20] if not line.startswith('"Temperatur"')]
    lines = [
        *fields,
        f'"Temperatur"\t{temperature!r}\t"°C"',
        '"Prüfzeit"\t"Standardkraft"\t"Standardweg"',
        '"s"\t"N"\t"mm"',
    ]
    columns = test[["time_s", "force_N", "displacement_mm"]].to_numpy()
    lines += ["\t".join("" if np.isnan(v) else repr(float(v)) for v in row) for row in columns]
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def write_tra(path: Path, test: pd.DataFrame) -> Path:
    """A TRA export of Zwick: semicolons, names, units, decimal commas, latin-1."""
    lines = ["Prüfzeit;Standardkraft;Standardweg;Prüfraumtemperatur", "s;N;µm;°C"]
    for row in test.itertuples():
        values = [row.time_s, row.force_N, row.displacement_mm * 1000.0, row.temperature_degC]
        lines.append(
            ";".join("" if np.isnan(v) else repr(float(v)).replace(".", ",") for v in values)
        )
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode("latin-1"))
    return path


def write_tdms(path: Path, runs: Runs) -> Path:
    """NI TDMS: a group per run, its settings in the group's properties, waveforms."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject(properties={"Bench": "rig 3"})])
        for label, run in runs.items():
            time = run["time_s"].to_numpy()
            settings = {
                "Umschlingungswinkel [°]": float(run["arc_deg"].iloc[0]),
                "Vorspannkraft [N]": float(run["initial_tension_N"].iloc[0]),
            }
            channels = [
                ChannelObject(
                    label,
                    name,
                    run[name].to_numpy(dtype=float),
                    properties={
                        "unit_string": UNITS[name],
                        "wf_start_offset": float(time[0]),
                        "wf_increment": float(np.median(np.diff(time))),
                        "wf_samples": 1,
                    },
                )
                for name in sensors(run)
                if name != "time_s"
            ]
            writer.write_segment([GroupObject(label, properties=settings), *channels])
    return path


def write_mdf(path: Path, run: pd.DataFrame, version: str = "4.10") -> Path:
    """ASAM MDF: the sensors in one channel group, the slow temperature in another."""
    from asammdf import MDF, Signal

    time = run["time_s"].to_numpy()
    names = [c for c in sensors(run) if c not in ("time_s", "temperature_degC")]
    file = MDF(version=version)
    file.append(
        [Signal(run[n].to_numpy(dtype=float), time, unit=UNITS[n], name=n) for n in names]
        + [
            Signal(run[n].to_numpy(dtype=float), time, unit=UNITS[n], name=n)
            for n in ("arc_deg", "initial_tension_N")
        ],
        acq_name="rig",
    )
    slow = slice(None, None, 10)
    values = run["temperature_degC"].to_numpy(dtype=float)[slow]
    file.append([Signal(values, time[slow], unit="°C", name="Temperatur")], acq_name="slow")
    file.save(path, overwrite=True)
    file.close()
    return path


def _struct(run: pd.DataFrame) -> dict[str, object]:
    return {
        **{name: run[name].to_numpy(dtype=float) for name in sensors(run)},
        "arc_deg": float(run["arc_deg"].iloc[0]),
        "initial_tension_N": float(run["initial_tension_N"].iloc[0]),
    }


def write_mat5(path: Path, runs: Runs) -> Path:
    """MATLAB, version 5: a struct per run."""
    from scipy.io import savemat

    savemat(path, {label: _struct(run) for label, run in runs.items()})
    return path


def write_mat73(path: Path, runs: Runs) -> Path:
    """MATLAB, version 7.3: HDF5 behind a header of 512 bytes, a group per struct."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for label, run in runs.items():
            group = file.create_group(label)
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            for name, value in _struct(run).items():
                data = group.create_dataset(
                    name, data=np.atleast_2d(np.asarray(value, dtype=float))
                )
                data.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Fri Nov 20 2026 HDF5 schema 1.00 ."
    with path.open("r+b") as stream:
        stream.write(head.ljust(124) + b"\x00\x02IM")
    return path


def write_xlsx(path: Path, runs: Runs) -> Path:
    """A workbook: a sheet per run, title lines above the header, a row of units below it."""
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    for label, run in runs.items():
        sheet = book.create_sheet(label)
        sheet.append(["Prüfstand", "rig 3"])
        sheet.append(["Umschlingungswinkel", float(run["arc_deg"].iloc[0]), "°"])
        sheet.append(["Vorspannkraft", float(run["initial_tension_N"].iloc[0]), "N"])
        sheet.append([])
        table = sensors(run)
        sheet.append(list(table.columns))
        sheet.append([UNITS[name] for name in table])
        for row in table.to_numpy():
            sheet.append([None if np.isnan(v) else float(v) for v in row])
    book.save(path)
    return path


def write_semicolons(path: Path, runs: Runs, encoding: str = "utf-8-sig") -> Path:
    """CSV as a German spreadsheet saves it, title lines on top, units in the names."""
    frame = pd.concat(runs.values())
    names = {
        "run": "Lauf",
        "time_s": "Zeit [s]",
        "tension_tight_N": "Zugkraft ziehend [kN]",
        "tension_slack_N": "Zugkraft leer [kN]",
        "pulley_speed_rad_s": "Drehzahl [1/min]",
        "temperature_degC": "Temperatur [°C]",
        "arc_deg": "Umschlingungswinkel [°]",
        "initial_tension_N": "Vorspannkraft [N]",
    }
    frame = frame.assign(
        tension_tight_N=frame["tension_tight_N"] / 1000.0,
        tension_slack_N=frame["tension_slack_N"] / 1000.0,
        pulley_speed_rad_s=frame["pulley_speed_rad_s"] * 60.0 / (2.0 * np.pi),
    ).rename(columns=names)
    body = frame.to_csv(index=False, sep=";", decimal=",")
    path.write_bytes(("Prüfstand;3\r\nPrüfer;NN\r\n\r\n" + body).encode(encoding))
    return path


def write_zip(path: Path, runs: Runs) -> Path:
    """A zip file with a CSV file per run."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for label, run in runs.items():
            archive.writestr(f"{label}.csv", run.drop(columns="run").to_csv(index=False))
    return path


def write_gzip(path: Path, runs: Runs) -> Path:
    """A tidy CSV file, packed."""
    path.write_bytes(gzip.compress(pd.concat(runs.values()).to_csv(index=False).encode()))
    return path


RIG: dict[str, Callable[[Path], Path]] = {
    "tdms": lambda f: write_tdms(f / "rig.tdms", rig_runs()),
    "mf4": lambda f: write_mdf(f / "R001.mf4", rig_runs(1)["R001"]),
    "mdf3": lambda f: write_mdf(f / "R001.mdf", rig_runs(1)["R001"], "3.30"),
    "mat5": lambda f: write_mat5(f / "rig.mat", rig_runs()),
    "mat73": lambda f: write_mat73(f / "rig.mat", rig_runs()),
    "xlsx": lambda f: write_xlsx(f / "rig.xlsx", rig_runs()),
    "semicolons": lambda f: write_semicolons(f / "rig.csv", rig_runs()),
    "latin-1": lambda f: write_semicolons(f / "rig.csv", rig_runs(), "latin-1"),
    "utf-16": lambda f: write_semicolons(f / "rig.csv", rig_runs(), "utf-16"),
    "zip": lambda f: write_zip(f / "rig.zip", rig_runs()),
    "gzip": lambda f: write_gzip(f / "rig.csv.gz", rig_runs()),
}
"""Format -> writes the first runs of rigdata into a folder."""
