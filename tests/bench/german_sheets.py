"""The sheets of a small laboratory (synthetic): workbooks per arc, a sheet per run, German signs.

The belt is that of the golden benches, Eqs. (5) and (8): a weight on the slack span, the torque and
the speed of the pulley over time.
"""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd
from golden import benches
from openpyxl import Workbook

G = 9.80665
ARCS_DEG = (40.0, 68.0, 82.0)
WEIGHTS_KG = (5.0, 10.0, 20.0, 40.0)
SPEEDS_RAD_S = tuple(0.02 * 1.6**k for k in range(10))


def bench(samples: int = 300, speeds: int = 10) -> benches.Rig:
    """The 120 runs: three arcs, four weights, ten speeds; or some of the speeds."""
    weights_N = tuple(mass * G for mass in WEIGHTS_KG)
    return benches.Rig("weight_slack", ARCS_DEG, weights_N, SPEEDS_RAD_S[:speeds], samples=samples)


def german(value: float, digits: int) -> str:
    """Write a number with a decimal comma."""
    return f"{value:.{digits}f}".replace(".", ",")


def write_rig(
    folder: Path, channel: str = "torque_N_m", samples: int = 300, speeds: int = 10
) -> pd.DataFrame:
    """Write a workbook per arc with a sheet per run; return what they hold, run by run.

    The weight is in the head; `channel` is the torque, or the force of a cell in the tight span.
    """
    recording = bench(samples, speeds).recording()
    folder.mkdir(parents=True)
    recording["book"] = [f"Umschlingung_{arc:.0f}Grad" for arc in recording["arc_deg"]]
    labels: dict[str, str] = {}
    name, unit = {"torque_N_m": ("Drehmoment", "Nm"), "tension_tight_N": ("Kraft Zugtrum", "N")}[
        channel
    ]
    for book_name, of_arc in recording.groupby("book", sort=False):
        book = Workbook(write_only=True)
        overview = book.create_sheet("Übersicht")
        overview.append(["Riemen", "5PK"])
        overview.append(["Prüfer", "NN"])
        for number, (run, frame) in enumerate(of_arc.groupby("run", sort=False), start=1):
            sheet = book.create_sheet(f"Lauf {number}")
            labels[str(run)] = f"{book_name}/Lauf {number}"
            sheet.append(["Prüfstand", "3"])
            sheet.append(["Gewicht am Leertrum", f"{german(frame['weight_N'].iloc[0] / G, 1)} kg"])
            sheet.append([])
            sheet.append(["Zeit", name, "Drehzahl"])
            sheet.append(["s", unit, "1/min"])
            turns = frame["pulley_speed_rad_s"] * 30 / math.pi
            for time, force, speed in zip(frame["time_s"], frame[channel], turns, strict=True):
                sheet.append([german(time, 4), german(force, 4), german(speed, 5)])
        book.save(folder / f"{book_name}.xlsx")
    return recording.assign(run=recording["run"].map(labels))


def write_press(path: Path) -> pd.DataFrame:
    """Write the record of the press as a workbook; return what it holds."""
    record = benches.press()
    book = Workbook(write_only=True)
    sheet = book.create_sheet("P22")
    sheet.append(["Probenbreite", "40 mm"])
    sheet.append(["Temperatur", "22 °C"])
    sheet.append(["Zeit [s]", "Weg [mm]", "Kraft [N]"])
    for row in record.itertuples():
        sheet.append([row.time_s, row.displacement_mm, row.force_N])
    book.save(path)
    return record
