"""Recordings of rigdata in every format that benches write, by that format's own library."""

from __future__ import annotations

import functools
from collections.abc import Mapping
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
