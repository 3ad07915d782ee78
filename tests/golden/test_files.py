"""One recording in every format, dialect, unit and clock: the same columns, the same results."""

import gzip
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

import beltid
from golden import files_written as w
from golden.door import beltid as call, configured, done, refused

COMMAND = {"rig": "fit-friction", "press": "fit-stiffness", "speedloss": "fit-slip"}
READ = {"rig": beltid.read_rig, "press": beltid.read_press, "speedloss": beltid.read_speedloss}
RIG, PRESS, SLIP = (w.TRUE[kind] for kind in COMMAND)
DIGITS = 1e-9


@dataclass(frozen=True)
class Case:
    """A file: the kind of recording, what writes it, its config, what it holds and lacks."""

    kind: str
    write: w.Writer
    config: Mapping[str, Any] = field(default_factory=dict)
    true: pd.DataFrame | None = None
    lacks: tuple[str, ...] = ()

    def read(self, folder: Path) -> None:
        """Write and read it; check that every column is as it was written."""
        found = READ[self.kind](folder / self.write(folder), configured(folder, self.config))
        true = (w.TRUE[self.kind] if self.true is None else self.true).drop(columns=[*self.lacks])
        assert len(found) == len(true)
        for name in true:
            if true[name].dtype == float:
                near = DIGITS * float(np.nanmax(np.abs(true[name])))
                np.testing.assert_allclose(found[name], true[name], 0, near, err_msg=str(name))
            else:
                assert found[name].tolist() == true[name].tolist(), name

    def results(self, folder: Path, out: str = "out.parquet") -> pd.DataFrame:
        """Write it and call the command that fits it."""
        path = self.write(folder)
        configured(folder, self.config)
        assert done(folder, COMMAND[self.kind], path, "--json -o", out).json["exit_status"] == 0
        return pq.read_table(folder / out).to_pandas()


def text(kind: str, content: str, encoding: str = "utf-8", **more: Any) -> Case:
    return Case(kind, w.put("rec.csv", content, encoding), **more)


def of_runs(write: w.Writer, true: pd.DataFrame | None = None, **runs: Any) -> Case:
    return Case("rig", write, {"runs": {"rig": runs}}, true)


def lvm(*segments: pd.DataFrame, **how: Any) -> Case:
    return of_runs(w.put("R001.lvm", w.lvm(*segments, **how)), w.R001, **VALUES)


def rig_by(write: Callable[[Path], object], name: str, true: pd.DataFrame | None = None) -> Case:
    return Case("rig", w.put(name, write), true=true)


def machine(name: str, content: Any, *lacks: str, encoding: str = "utf-8") -> Case:
    return Case("press", w.put(name, content, encoding), lacks=("test", *lacks))


def parquet(columns: Mapping[str, Any]) -> w.Writer:
    return w.put("rec.parquet", lambda path: w.parquet(path, columns))


LABEL = ("run",)
SETTINGS = (*LABEL, *w.SETTINGS)
BARE = RIG.drop(columns="run")
FIRST = w.R001.drop(columns="run")
VALUES = {"values": {"arc_deg": 40, "initial_tension_N": 100}}
KN = {"tension_tight_N": "kN", "tension_slack_N": "daN", "pulley_speed_rad_s": "1/min"}
GERMAN = "Prüfstand;3\r\nPrüfer;NN\r\n\r\n" + w.table(w.named("rig", KN), ";", ",", end="\r\n")
MACHINE = w.named("press")
DRIVE = w.named("speedloss", language=1)
IN_MM = w.named("speedloss", {"torque_N_m": "N mm"})
IN_MN = w.named("press", {"force_N": "mN"})
IN_FRONT = IN_MN.rename(columns=lambda name: re.sub(r"^(.+) (\[.+\])$", r"\2 \1", name))
LINES = w.table(RIG).splitlines()
REMARKS = "\n".join(["# bench 3", *LINES[:90], "# cycle 2", *LINES[90:], ""])
ANOTHER = "time_s,displacement_mm,force_N\n0,1,2\n1,2,3\n"
WITH_HEAD = "Riemen;5PK\nUmschlingungswinkel;40;°\nVorspannkraft;0,1;kN\n\n"
MISSING = {7: "", 21: "NaN", 60: "-", 99: "#NV"}
GAPS = PRESS.astype(object)
GAPS.loc[[*MISSING], "force_N"] = [*MISSING.values()]
GAPPED = PRESS.assign(force_N=PRESS["force_N"].where(~PRESS.index.isin([*MISSING])))
SPECIMEN = PRESS.drop(columns=["test", "temperature_degC"])
SECOND = SPECIMEN.assign(force_N=1.5 * SPECIMEN["force_N"])
BESIDE = pd.concat([SPECIMEN, SECOND], axis=1)
BESIDE.columns = pd.Index(["Zeit [s]", "Weg [mm]", "Kraft [N]"] * 2)
TURNED = PRESS.assign(force_N=-PRESS["force_N"])
TURNED = TURNED.rename(columns={"force_N": "K1", "displacement_mm": "s2"})
VOLTS = RIG.assign(
    tension_tight_N=RIG["tension_tight_N"] / 250,
    tension_slack_N=(RIG["tension_slack_N"] + 4.25) / 251.5,
    pulley_speed_rad_s=RIG["pulley_speed_rad_s"] * 0.05,
).set_axis(
    ["run", "Zeit [s]", "Zugtrum [V]", "Leertrum [V]", "Drehzahl [m/s]", *SETTINGS[1:]], axis=1
)
CALIBRATED = {
    "tension_tight_N": "0.25 N/mV",
    "tension_slack_N": {"factor": 251.5, "offset": -4.25},
    "pulley_speed_rad_s": {"factor": 20},
}
FILES = [f"{k}.csv,{k},{r.arc_deg[0]},{r.initial_tension_N[0]}" for k, r in w.RUNS.items()]
RIG_FILES = "\n".join(["file,run,arc_deg,initial_tension_N", *FILES, ""])
WARM = w.R001.assign(temperature_degC=22 + 0.1 * w.R001["time_s"])  # read at a slower rate
DRIFT = PRESS.drop(columns="test").assign(temperature_degC=22 + 0.01 * PRESS["time_s"])
DRIFT.loc[199, "temperature_degC"] = np.nan  # after its last sample: nothing is extrapolated
TWO_FORCES = {"columns": {"press": {"force_N": "Maschine/Kraft"}}}
NAMED = "{run}_{arc:.0f}deg_{tension:.0f}N_0p84."
PATTERN = "{run}_{arc_deg}deg_{initial_tension_N}N_{}."
TENFOLD = RIG.assign(initial_tension_N=10 * RIG["initial_tension_N"])

K1 = {"columns": {"press": {"force_N": "-K1", "displacement_mm": "s2"}}}
TRA = w.table(MACHINE.iloc[:, 1:], ";", ",", end="\r\n", units_row=True)
HEAD_AND_CELLS = WITH_HEAD + w.table(w.named("rig").iloc[:121, 1:5], ";", ",")
EURO = "Preis;5 €\n" + w.table(MACHINE, ";")
ENCODED, SKIPPED, SIGNS = (
    {"dialect": keys}
    for keys in ({"encoding": "cp1252"}, {"skip_lines": 3}, {"separator": ";", "decimal": ","})
)
HALVES = (w.R001[:50], w.R001[50:])

FORMATS: dict[str, Case] = {
    "csv": text("rig", w.table(RIG)),
    "csv of the press": text("press", w.table(PRESS)),
    "csv of the drive": text("speedloss", w.table(SLIP)),
    "semicolons": text("rig", GERMAN),
    "byte-order mark": text("rig", GERMAN, "utf-8-sig"),
    "latin-1": text("rig", GERMAN, "latin-1"),
    "utf-16": text("rig", GERMAN, "utf-16"),
    "cp1252": text("press", EURO, "cp1252", config=ENCODED),
    "English names": text("rig", w.table(w.named("rig", KN, language=1))),
    "French names": text("rig", w.table(w.named("rig", KN, language=2), ";", ",")),
    "French press": text("press", w.table(w.named("press", language=2), ";", ",")),
    "tabs, units below": text("rig", w.table(w.named("rig", KN), "\t", ",", units_row=True)),
    "bars": text("speedloss", w.table(DRIVE, "|")),
    "quoted": text("speedloss", w.table(DRIVE, quote='"')),
    "decimal comma in quotes": text("speedloss", w.table(DRIVE, decimal=",", quote='"')),
    "1.234,5": text("press", w.table(IN_MN, ";", ",", ".")),
    "1 234.5": text("speedloss", w.table(IN_MM, ";", ".", " ")),
    "1'234.5": text("speedloss", w.table(IN_MM, ",", ".", "'")),
    "remarks": text("rig", REMARKS),
    "lines to skip": text("press", ANOTHER + w.table(PRESS), config=SKIPPED),
    "dialect": text("press", w.table(MACHINE, ";", ","), config=SIGNS),
    "titles of more cells": text("press", "a,b,c,d,e,f,g\n" * 2 + w.table(MACHINE)),
    "units in front": text("press", w.table(IN_FRONT)),
    "missing numbers": text("press", w.table(GAPS), true=GAPPED),
    "side by side": text("press", w.table(BESIDE, ";"), true=pd.concat([SPECIMEN, SECOND])),
    "names stated, sign turned": text("press", w.table(TURNED), config=K1),
    "calibrations": text("rig", w.table(VOLTS), config={"units": {"rig": CALIBRATED}}),
    "no label": text("rig", w.table(BARE), true=BARE),
    "values for all runs": of_runs(w.put("R001.csv", w.table(w.R001[w.CELLS])), w.R001, **VALUES),
    "fields of the head": text("rig", HEAD_AND_CELLS, true=FIRST),
    "testXpert": machine("P22.txt", w.zwick()),
    "testXpert, latin-1": machine("P22.txt", w.zwick(), encoding="latin-1"),
    "TRA": machine("P22.TRA", TRA, encoding="latin-1"),
    "LVM": lvm(w.R001),
    "LVM, times": lvm(w.R001, x="One", sep=",", decimal="."),
    "LVM, times of each": lvm(w.R001, x="Multi"),
    "LVM, segments": lvm(*HALVES),
    "LVM, segments by their clock": lvm(*HALVES, clock=True),
    "TDMS": rig_by(w.tdms_of_runs, "rig.tdms"),
    "TDMS, two rates": Case("press", w.put("P.tdms", w.tdms_of_two_rates), TWO_FORCES, DRIFT),
    "MDF 4": rig_by(lambda path: w.mdf(path, 0.0), "R001.mf4", WARM),
    "MDF 3": rig_by(lambda path: w.mdf(path, 0.0, version="3.30"), "R001.mdf", WARM),
    "MATLAB 5, structs": rig_by(lambda path: savemat(path, w.structs()), "rig.mat"),
    "MATLAB 5, arrays": rig_by(lambda path: savemat(path, w.structs()["R001"]), "a.mat", FIRST),
    "MATLAB 7.3": rig_by(w.mat73, "rig.mat"),
    "HDF5": Case("press", w.put("P.h5", w.hdf5), lacks=("temperature_degC",)),
    "Excel": rig_by(w.sheets_of_runs, "rig.xlsx"),
    "UFF 58": machine("P22.unv", w.uff(even=True), "temperature_degC"),
    "UFF 58, uneven": machine("P22.uff", w.uff(even=False), "temperature_degC"),
    "Parquet": Case("rig", parquet(RIG)),
    "Parquet, units in names": Case("press", parquet(w.named("press", {"force_N": "kN"}))),
    "gzip": Case("rig", w.put("rig.csv.gz", gzip.compress(w.table(RIG).encode()))),
    "zip": rig_by(w.zipped, "rig.zip"),
    "folder": Case("rig", w.one_each("{run}.csv", LABEL)),
    "folder of Parquet": Case(
        "rig", w.one_each("{run}.parquet", LABEL, lambda path, run: run.to_parquet(path))
    ),
    "folder of LVM": of_runs(
        w.one_each(NAMED + "lvm", write=lambda path, run: path.write_text(w.lvm(run))),
        pattern=PATTERN + "lvm",
    ),
    "pattern of names": of_runs(
        w.one_each(NAMED + "csv", SETTINGS, path="rig/R*.csv"), pattern=PATTERN + "csv"
    ),
    "unit in the pattern": of_runs(
        w.one_each("{run}-T{tension:.0f}-B{arc:.0f}.csv", SETTINGS),
        TENFOLD,
        pattern="{run}-T{initial_tension_N:daN}-B{arc_deg}.csv",
    ),
    "names with blanks": of_runs(
        w.one_each("{run} {arc:.0f} {tension:.0f}.csv", SETTINGS),
        pattern="{run} {arc_deg} {initial_tension_N}.csv",
    ),
    "table of files": of_runs(w.one_each("{run}.csv", SETTINGS, files=RIG_FILES), table="runs.csv"),
}


SLOW = {"MDF 3", "MATLAB 5, arrays", "MDF that overlaps"}


def each(table: Mapping[str, object]) -> list[Any]:
    """Give the names of a table; the slow ones are marked."""
    return [pytest.param(name, marks=[pytest.mark.long] * (name in SLOW)) for name in table]


@pytest.mark.parametrize("name", each(FORMATS))
def test_a_file_is_read_as_it_was_written(name: str, tmp_path: Path) -> None:
    FORMATS[name].read(tmp_path)


# --- units ---------------------------------------------------------------------------------------

IN_UNITS = {
    "rig tension_tight_N": ("mN", "daN", "kN", "lbf", "kgf"),
    "rig pulley_speed_rad_s": ("deg/s", "rpm", "1/min", "U/min", "rev/s"),
    "rig arc_deg": ("rad",),
    "rig initial_tension_N": ("kN",),
    "press time_s": ("ms", "µs", "min", "h"),
    "press displacement_mm": ("um", "µm", "cm", "m", "in"),
    "press force_N": ("kN", "lbf"),
    "press temperature_degC": ("K", "°F"),
    "speedloss torque_N_m": ("N cm", "N mm", "kN m", "lbf in", "lbf ft"),
    "speedloss driver_speed_rad_s": ("rpm",),
}


@pytest.mark.parametrize(
    ("where", "unit"), [(k, u) for k, units in IN_UNITS.items() for u in units]
)
def test_a_unit_is_converted_whoever_states_it(where: str, unit: str, tmp_path: Path) -> None:
    """Behind the name; for the first unit of a column, below it or in the config as well."""
    kind, column = where.split()
    written = w.named(kind, {column: unit})
    plain = written.rename(columns={f"{w.NAMES[column][0]} [{unit}]": "Kanal 7"})
    config = {"columns": {kind: {column: "Kanal 7"}}, "units": {kind: {column: unit}}}
    text(kind, w.table(written)).read(tmp_path)
    if unit == IN_UNITS[where][0]:
        text(kind, w.table(written, ";", units_row=True)).read(tmp_path)
        text(kind, w.table(plain), config=config).read(tmp_path)


# --- clocks --------------------------------------------------------------------------------------

REST = PRESS.drop(columns="time_s")
SAMPLES = MACHINE.drop(columns="Zeit [s]")
DAYS, TIMES = [t.date() for t in w.AT], [t.time() for t in w.AT]


def sheet(**clock: list[Any]) -> w.Writer:
    """Write the press as a workbook whose first columns are a clock."""
    rows = zip(*clock.values(), SAMPLES.to_numpy().tolist(), strict=True)
    sheets = {"P22": [[*clock, *SAMPLES], *([*row[:-1], *row[-1]] for row in rows)]}
    return w.put("P.xlsx", lambda path: w.workbook(path, sheets))


CLOCKS: dict[str, w.Writer] = {
    "13:45:02.125": w.clocked("%H:%M:%S.%f"),
    "13:45:02,125": w.clocked("%H:%M:%S,%f", "time_s"),
    "ISO": w.clocked("%Y-%m-%dT%H:%M:%S.%f", "Zeitstempel"),
    "ISO with a blank": w.clocked("%Y-%m-%d %H:%M:%S.%f", "Timestamp"),
    "ISO, Z": w.clocked("%Y-%m-%dT%H:%M:%S.%fZ"),
    "ISO, UTC": w.clocked("%Y-%m-%d %H:%M:%S.%f UTC"),
    "ISO, +02:00": w.clocked("%Y-%m-%dT%H:%M:%S.%f+02:00"),
    "20.11.2026": w.clocked("%d.%m.%Y %H:%M:%S,%f"),
    "11/20/2026": w.clocked("%m/%d/%Y %H:%M:%S.%f"),
    "date beside": w.clocked("%d.%m.%Y;%H:%M:%S,%f", "Datum;Uhrzeit"),
    "ISO date beside": w.clocked("%Y-%m-%d,%H:%M:%S.%f", "Date,Time", ","),
    "Excel stamps": sheet(Zeit=w.AT),
    "Excel date and time": sheet(Datum=DAYS, Zeit=TIMES),
    "Parquet stamps": parquet({**REST, "time_s": pa.array(w.AT, pa.timestamp("ns"))}),
    "Parquet, UTC": parquet({**REST, "time_s": pa.array(w.AT, pa.timestamp("us", tz="UTC"))}),
    "Parquet time of day": parquet({**REST, "time_s": TIMES}),
    "Parquet text": parquet({**REST, "time_s": [t.isoformat() for t in w.AT]}),
    "Parquet date beside": parquet({**REST, "Datum": DAYS, "time_s": TIMES}),
}


@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_counts_seconds_from_the_first_sample_past_midnight(
    name: str, tmp_path: Path
) -> None:
    Case("press", CLOCKS[name]).read(tmp_path)


# --- commands ------------------------------------------------------------------------------------

RESULTS = {
    "rig": ["tension_tight_N", "tension_slack_N", "mu_sliding", "normal_force_N_m"],
    "press": ["k_linear_N_m2", "k_quadratic_N_m3"],
    "speedloss": ["torque_N_m", "speed_loss_rad_s", "slip_speed_m_s"],
}
BY_COMMAND = ["semicolons", "1 234.5", "testXpert", "TRA", "zip", "table of files"]
PLAIN = {"rig": "csv", "press": "csv of the press", "speedloss": "csv of the drive"}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, pd.DataFrame]:
    """Results of the plain CSV files."""
    folder = tmp_path_factory.mktemp("plain")
    return {kind: FORMATS[name].results(folder, f"{kind}.parquet") for kind, name in PLAIN.items()}


@pytest.mark.parametrize("name", BY_COMMAND)
def test_the_command_gives_the_results_of_the_plain_file(
    name: str, tmp_path: Path, plain: dict[str, pd.DataFrame]
) -> None:
    found, expected = FORMATS[name].results(tmp_path), plain[FORMATS[name].kind]
    for column in RESULTS[FORMATS[name].kind]:
        np.testing.assert_allclose(found[column], expected[column], 1e-6, err_msg=column)


# --- refusals ------------------------------------------------------------------------------------


class Refused(NamedTuple):
    """A recording that is refused: what the message must name, what writes it, its config."""

    names: str
    kind: str
    write: w.Writer
    config: Mapping[str, Any] = {}


def press(names: str, write: w.Writer | Callable[[Path], object], name: str = "") -> Refused:
    return Refused(names, "press", w.put(name, write) if name else cast(w.Writer, write))


def rig(names: str, frame: pd.DataFrame, **columns: Any) -> Refused:
    return Refused(names, "rig", w.put("rec.csv", w.table(frame.assign(**columns))))


def renamed(names: str, **heads: str) -> Refused:
    return rig(names, RIG.rename(columns=heads))


def rows(head: str, *lines: str) -> w.Writer:
    return w.put("P.csv", "\n".join([head, *lines, ""]))


def clock(names: str, *times: str) -> Refused:
    lines = (f"{time};0.{i:02d};{i}" for i, time in enumerate(times))
    return press(names, rows("Uhrzeit;Weg [mm];Kraft [N]", *lines))


def forces(names: str, *numbers: str) -> Refused:
    return press(names, rows(H + " [N]", *(f"{i};{i};{n}" for i, n in enumerate(numbers))))


def headed(names: str, head: str, **config: Any) -> Refused:
    """Refuse the press under another row of names."""
    write = rows(head, *w.table(PRESS.iloc[:, 2:], ";").splitlines()[1:])
    return Refused(names, "press", write, {k: {"press": v} for k, v in config.items()})


def changed(names: str, kind: str, row: int, column: str, value: Any) -> Refused:
    frame = w.TRUE[kind].astype(object)
    frame.loc[row, column] = value
    return Refused(names, kind, w.put("rec.csv", w.table(frame)))


def sheet_of(*lines: Sequence[Any]) -> Callable[[Path], None]:
    return lambda path: w.workbook(path, {"P22": lines})


H = "Zeit [s];Weg [mm];Kraft"
WAY = "Zeit [s];Standardweg [mm];Traversenweg [mm];Kraft [N]"
TIGHT, SLACK = RIG["tension_tight_N"], RIG["tension_slack_N"]
ONE_IN_kN = TIGHT.where(RIG["run"] != "R002", TIGHT / 1000)
TWICE = pd.concat([FIRST, FIRST.assign(time_s=FIRST["time_s"] + 3.025)])
AGAIN = pd.concat([RIG, w.R001])
FORCES = w.put("rec.csv", w.table(MACHINE.assign(**{"Kraft 2 [N]": 1.0})))
FORMULAS = sheet_of(H.split(";"), *([i, i, f"=0.01*A{i + 2}"] for i in range(30)))
BOOK = w.put("P.xlsx", sheet_of([*PRESS], *PRESS.to_numpy().tolist()))
PACKED = w.put("P.csv.gz", gzip.compress(w.table(PRESS).encode()))
HDF5 = w.put("P.h5", w.hdf5)
PLAIN_FILES = w.one_each("{run}.csv", SETTINGS, files="\n".join(RIG_FILES.splitlines()[:2]))
BY_NAME, BY_TABLE = ({"runs": {"rig": by}} for by in ({"pattern": PATTERN}, {"table": "runs.csv"}))
DAY_OR_MONTH = ("03/04/2026 10:00:00", "04/04/2026 10:00:00")
OMEGA = "Winkelgeschwindigkeit"

REFUSED: dict[str, Refused] = {
    # channels
    "a column is missing": rig("rec.csv:1 tension_tight_N", RIG.drop(columns="tension_tight_N")),
    "a name is misspelt": renamed("rec.csv:1 arc_deg arc_dge columns:", arc_deg="arc_dge"),
    "a stated column is missing": headed("P.csv:1 K7", H + " [N]", columns={"force_N": "K7"}),
    "another bench": rig("rec.csv:1 press data.press", PRESS),
    "no settings": rig("arc_deg initial_tension_N values pattern table", FIRST[w.CELLS]),
    "two travels": headed("P.csv:1 Standardweg Traversenweg displacement_mm columns:", WAY),
    "two forces": press("rec.csv:1 Kraft force_N tension_tight_N columns:", FORCES),
    "missing beside two labels": headed("P.csv:1 test force_N missing", "Probe;Versuch;E [MPa]"),
    # units
    "no unit": headed("P.csv:1 Kraft force_N units:", H),
    "an unknown unit": headed("P.csv:1 kip kN lbf", H + " [kip]"),
    "a unit near to ours": renamed("rad.s rad/s}} factor", pulley_speed_rad_s=f"{OMEGA} [rad.s]"),
    "two units": headed("P.csv:2 force_N kN units:", H + " [N]\ns;mm;kN"),
    "volts": headed("P.csv:1 force_N V N/V factor offset", H + " [V]"),
    "volts of newtons": headed("P.csv:1 force_N V", H + " [N]", units={"force_N": "250 N/V"}),
    "a unit at the end of a name": headed(
        "P.csv:1 displacement_mm weg_m units:",
        "time_s;weg_m;force_N",
        columns={"displacement_mm": "weg_m"},
    ),
    "turns or radians": renamed("1/s rev/s rad/s units:", pulley_speed_rad_s=f"{OMEGA} [1/s]"),
    "a surface speed": renamed("m/s factor radius", pulley_speed_rad_s=f"{OMEGA} [m/s]"),
    "kN as N": rig("tension_tight_N kN units:", RIG, tension_tight_N=TIGHT / 1000),
    "a run in kN": rig("R002 tension_tight_N kN", RIG, tension_tight_N=ONE_IN_kN),
    "radians as degrees": rig("arc_deg rad units:", RIG, arc_deg=np.radians(RIG["arc_deg"])),
    "whole numbers with a slope": press(
        "P.h5 force_N slope 0.02 offset -1 factor",
        lambda path: w.hdf5(path, 50, slope=0.02, offset=-1.0),
        "P.h5",
    ),
    # numbers
    "formulas": press("P.xlsx formulas", FORMULAS, "P.xlsx"),
    "a word": changed("rec.csv:7 force_N overload", "press", 5, "force_N", "overload"),
    "a cell too few": press("P.csv:3 2 3", rows(H + " [N]", "0;1;2", "1;2")),
    "1,250": forces("P.csv:3 1,250 1250 decimal thousands", "950", "1,250", "2,100"),
    "950 beside 1.250": forces("P.csv:1 950 1.250 decimal thousands", "950", "1.250", "2.100"),
    "a sign": rig("tension_slack_N -tension_slack_N", RIG, tension_slack_N=-SLACK),
    # times and runs
    "day or month": clock("P.csv:3 04/04/2026 day month", *DAY_OR_MONTH),
    "25:00:00": clock("P.csv:3 25:00:00", "10:00:00", "25:00:00"),
    "29 February": clock("P.csv:3 2026-02-29", "2026-02-28T10:00:00", "2026-02-29T10:00:00"),
    "mixed zones": clock("P.csv:3 zone", "2026-02-28T10:00:00Z", "2026-02-28T10:00:01"),
    "a date at times": clock("P.csv:3 date", "10:00:00", "2026-02-28T10:00:01"),
    "a clock that goes back": clock("P.csv:4 13:44:00", "13:45:02", "13:45:03", "13:44:00"),
    "a clock too coarse": clock("P.csv:2 Uhrzeit", *["10:00:00"] * 20, *["10:00:01"] * 20),
    "time that goes back": changed("rec.csv:9 time_s 0.2", "press", 7, "time_s", 0.2),
    "an arc that changes": changed("rec.csv:32 41 40 R001", "rig", 30, "arc_deg", 41.0),
    "a label used twice": rig("rec.csv:486 time_s R001", AGAIN),
    "two runs without a label": rig("rec.csv label", TWICE),
    "MDF that overlaps": Refused(
        "R001.mf4 time_s", "rig", w.put("R001.mf4", lambda path: w.mdf(path, 0.0, 1.0))
    ),
    "a name that does not fit": Refused(f"R001.csv {PATTERN}", "rig", PLAIN_FILES, BY_NAME),
    "a file not in the table": Refused("runs.csv R002.csv", "rig", PLAIN_FILES, BY_TABLE),
    # files
    "no file": press("nothing.csv", lambda folder: "nothing.csv"),
    "an empty file": press("P.csv empty", w.put("P.csv", "")),
    "only names": press("P.csv header 1", w.put("P.csv", H + " [N]\n")),
    "no rows": press("rec.parquet", parquet(PRESS[:0])),
    "a program": press("P.csv", w.put("P.csv", b"\x7fELF" + bytes(range(256)))),
    "gzip cut off": press("P.csv.gz damaged", w.spoilt(PACKED, keep=0.5)),
    "gzip with a wrong bit": press("P.csv.gz damaged", w.spoilt(PACKED, flip=0.5)),
    "Excel cut off": press("P.xlsx damaged", w.spoilt(BOOK, keep=0.5)),
    "Excel with a wrong bit": press("P.xlsx damaged", w.spoilt(BOOK, flip=0.3)),
    "Parquet cut off": press("rec.parquet damaged", w.spoilt(parquet(PRESS), keep=0.5)),
    "HDF5 cut off": press("P.h5 damaged", w.spoilt(HDF5, keep=0.6)),
}


@pytest.mark.parametrize("name", each(REFUSED))
def test_a_recording_is_refused_and_the_message_names_what_helps(name: str, tmp_path: Path) -> None:
    names, kind, write, config = REFUSED[name]
    path = write(tmp_path)
    configured(tmp_path, config)
    there = sorted(tmp_path.rglob("*"))
    refused(call(tmp_path, COMMAND[kind], path, "-o", "out.parquet"), *names.split())
    assert sorted(tmp_path.rglob("*")) == there


def test_swapped_cells_are_named_and_do_no_harm(
    tmp_path: Path, plain: dict[str, pd.DataFrame]
) -> None:
    names = {"tension_tight_N": "tension_slack_N", "tension_slack_N": "tension_tight_N"}
    (tmp_path / "rig.csv").write_text(w.table(RIG.rename(columns=names)))
    said = call(tmp_path, "fit-friction", "rig.csv", "-o", "out.parquet")
    assert all(name in said.stderr for name in ("swapped", *w.RUNS))
    if said.status != 2:
        found = pq.read_table(tmp_path / "out.parquet").to_pandas()["mu_sliding"]
        np.testing.assert_allclose(found, plain["rig"]["mu_sliding"], 1e-6)


# --- configs -------------------------------------------------------------------------------------

WRONG = [
    ("belt:\n  ribbs: 5\n", "2:3 belt.ribbs ribs !axial_stiffness_N"),
    ("rigs: {arcs_deg: [40]}\n", "1:1 rigs rig !contact"),
    ("arcs_deg: [40]\n", "1:1 rig.arcs_deg"),
    ("belt: {ribs: 5}\nbelt: {ribs: 6}\n", "2:1 belt 1"),
    ("belt:\n  ribs: 5\n  ribs: 5\n", "3:3 ribs"),
    ("belt: 7\n", "1:7 belt name ribs"),
    ("belt: {ribs: five}\n", "1:14 belt.ribs five [1, 100]"),
    ("rig:\n  arcs_deg: [40, 400]\n", "2:18 rig.arcs_deg[1] 400 (0, 360)"),
    ("rig: {arcs_deg: 40}\n", "1:17 rig.arcs_deg 40 [40, 68, 82]"),
    ("rig:\n  span_length_m: 0,1\n", "2:18 rig.span_length_m 0,1 0.1"),
    ("press: {segment_length_cm: 1e5}\n", "1:28 press.segment_length_cm 1e5 [0.1, 100] cm"),
    ("conditions: {surface: oily}\n", "1:23 conditions.surface oily dry wet dusty"),
    ("units: {rig: {tension_tight_N: kPa}}\n", "1:32 units.rig.tension_tight_N kPa N kN lbf N/V"),
    ("columns: {rig: {tension_tight: F1}}\n", "1:17 columns.rig.tension_tight tension_tight_N"),
    ("runs: {rig: {pattern: 5}}\n", "1:23 runs.rig.pattern {run}"),
    ("dialect: {separator: ab}\n", "1:22 dialect.separator ab"),
    ("belt:\n\tribs: 5\n", "2:1 tab"),
    ("- belt\n", "1:1 list"),
    ("", "empty"),
    ("data: {rig: nothing.csv}\n", "1:13 data.rig nothing.csv"),
    (
        "belt: {ribs: 5.5}\npress:\n  cycles: middle\nrig: {span_lenght_m: 0.1}\n",
        "1:14 belt.ribs 5.5 3:11 press.cycles last first all 4:7 span_length_m",
    ),
]


@pytest.mark.parametrize(("content", "words"), WRONG)
def test_a_config_is_refused_at_its_place(content: str, words: str, tmp_path: Path) -> None:
    """A word behind `!` is not named: the nearest key is, not every key."""
    (tmp_path / "belt.yaml").write_text(content)
    said, names = call(tmp_path, "config", "check", "belt.yaml"), words.split()
    refused(said, "belt.yaml", *(name for name in names if name[0] != "!"))
    assert not [name for name in names if name[0] == "!" and name[1:] in said.stderr]


def test_numbers_of_a_config_are_those_of_yaml_1_2(tmp_path: Path) -> None:
    content = "belt: {axial_stiffness_N: 1e5, shear_stiffness_N_m2: 3025.6e6}\n"
    (tmp_path / "belt.yaml").write_text(content)
    table = done(tmp_path, "config show belt.yaml --json").json["table"]
    found = {row["key"]: row["value"] for row in table}
    assert found["belt.axial_stiffness_N"] == 1e5
    assert found["belt.shear_stiffness_N_m2"] == 3025.6e6


def test_the_nearest_config_is_found_and_named(tmp_path: Path) -> None:
    """The speed of sliding goes with the radius of the pulley that the config states."""
    folder = tmp_path / "bench" / "monday"
    folder.mkdir(parents=True)
    (folder / "loss.csv").write_text(w.table(SLIP))
    places = [tmp_path / "beltid.yaml", folder.parent / "loss.yaml", folder / "beltid.yaml"]
    places += [folder / f"{name}.yaml" for name in ("loss", "shell", "named")]
    for number, path in enumerate([None, *places]):
        radius = 0.05 + 0.01 * number
        if path is not None:
            path.write_text(f"rig: {{pulley_radius_m: {radius}}}\n")
        shell = {"BELTID_CONFIG": "shell.yaml"} if number >= 5 else {}
        named = ["-c", "named.yaml"] if number >= 6 else []
        said = done(folder, "fit-slip loss.csv --json -o out.parquet", *named, **shell)
        assert (path.name if path else "built-in") in said.stderr.splitlines()[0]
        last = said.json["table"][-1]
        assert last["slip_speed_m_s"] == pytest.approx(radius * last["speed_loss_rad_s"])


def test_relative_paths_begin_at_the_folder_of_the_config(tmp_path: Path) -> None:
    (tmp_path / "configs" / "data").mkdir(parents=True)
    (tmp_path / "configs" / "belt.yaml").write_text("data: {rig: data/rig.csv, press: ../P.csv}\n")
    lacking = call(tmp_path, "config", "check", "configs/belt.yaml")
    refused(lacking, "belt.yaml:1:13", "data.rig", "belt.yaml:1:34", "data.press", "rig.csv")
    (tmp_path / "configs" / "data" / "rig.csv").write_text(w.table(RIG))
    (tmp_path / "P.csv").write_text(w.table(PRESS))
    done(tmp_path, "config check configs/belt.yaml")


# --- inspect -------------------------------------------------------------------------------------

ZWICK = ("Prüfzeit", "Standardkraft", "Standardweg")
INSPECTED = {
    "semicolons": ("CSV", KN),
    "bars": ("CSV", {}),
    "testXpert": ("testXpert", {}),
    "LVM": ("LabVIEW", {}),
    "TDMS": ("TDMS", {}),
    "Excel": ("Excel", {}),
    "pattern of names": ("CSV", dict.fromkeys(w.UNITS)),
}


@pytest.mark.parametrize("name", INSPECTED)
def test_inspect_tells_what_the_command_reads(name: str, tmp_path: Path) -> None:
    (form, stated), case = INSPECTED[name], FORMATS[name]
    path = case.write(tmp_path)
    configured(tmp_path, case.config)
    found = done(tmp_path, "inspect", path, "--json").json
    true = w.TRUE[case.kind] if case.true is None else case.true
    runs = 1 if case.kind == "press" else true["run"].nunique()
    facts = found["facts"]
    assert form in facts["format"]
    assert (facts["kind"], facts["runs"], facts["samples"]) == (case.kind, runs, len(true))
    for column in {"arc_deg", "initial_tension_N"} & set(true):
        assert facts[column] == sorted(set(true[column]))
    channels = {row["read_as"]: row for row in found["table"]}
    assert set(w.CELLS[1:]) <= set(channels) or case.kind != "rig"
    for column, row in channels.items():
        assert row["unit"] == (stated.get(column, w.UNITS[column]) or None), column
        assert row["channel"].partition(" [")[0] in (*w.NAMES[column], *ZWICK, column)


def test_inspect_tells_what_is_missing(tmp_path: Path) -> None:
    names, _, write, _ = REFUSED["no unit"]
    said = call(tmp_path, "inspect", write(tmp_path), "--json")
    assert said.status == 2
    assert said.facts["kind"] == "press"
    assert all(word in "\n".join(said.json["warnings"]) for word in names.split())
    row = next(row for row in said.json["table"] if row["channel"] == "Kraft")
    assert (row["unit"], row["read_as"]) == (None, "force_N")
