"""Every target, compiled, run or read back by its format, is the law at 200 points and outside."""

import csv
import ctypes
import io
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.interpolate import Akima1DInterpolator, RegularGridInterpolator
from scipy.io import loadmat

import beltid
from beltid.export.law import BeltFacts, ContactLaw, Contribution, Provenance, friction_part
from beltid.export.targets import (
    TARGETS,
    deviations,
    export,
    friction_table,
    penetration_nodes,
    reference_point,
)

Function = Callable[..., Any]
FLAGS = {
    "gcc": ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"),
    "gfortran": ("-std=f2003", "-pedantic", "-Wall", "-Werror"),
}


class Read(NamedTuple):
    """Line force and mu as an export gives them, and whether they are the law to rounding."""

    line_force: Function
    mu: Function
    exact: bool = False


def files_of(law: ContactLaw, target: str) -> dict[str, bytes]:
    return export(law, target, reference_point(law)).files


def text_of(law: ContactLaw, target: str, ending: str) -> str:
    (data,) = (d for name, d in files_of(law, target).items() if name.endswith(ending))
    return data.decode("ascii")


def module(target: str) -> Function:
    def read(law: ContactLaw, folder: Path) -> Read:
        names: dict[str, Any] = {}
        exec(text_of(law, target, ".py"), names)
        force = np.linspace(0.0, 2e4, 50)
        np.testing.assert_allclose(names["line_force"](names["penetration"](force)), force)
        return Read(names["line_force"], names["mu"], exact=True)

    return read


def compiled(target: str, compiler: str, ending: str) -> Function:
    def read(law: ContactLaw, folder: Path) -> Read:
        path = shutil.which(compiler)
        if path is None:
            pytest.skip(f"{compiler} is not installed: what it would compile is not tested")
        for name, data in files_of(law, target).items():
            (folder / name).write_bytes(data)
        (source,) = folder.glob(f"*.{ending}")
        library = folder / "law.so"
        command = [path, *FLAGS[compiler], "-O2", "-shared", "-fPIC", source, "-o", library, "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
        assert done.returncode == 0, done.stderr
        name = source.name.removesuffix(f"_law.{ending}")
        loaded = ctypes.CDLL(str(library))
        found = {}
        for of, arguments in (("line_force", 1), ("mu", 2), ("friction", 2)):
            found[of] = loaded[f"{name}_{of}"]
            found[of].restype, found[of].argtypes = ctypes.c_double, [ctypes.c_double] * arguments
        for speed in (0.01, 0.0, -0.01):
            friction = -np.sign(speed) * 3000.0 * found["mu"](3000.0, 0.01)
            assert found["friction"](3000.0, speed) == pytest.approx(friction)
            assert found["friction"](-1.0, speed) == 0.0
        return Read(np.vectorize(found["line_force"]), np.vectorize(found["mu"]), exact=True)

    return read


def gridded(delta: Any, force: Any, f: Any, v: Any, mu: Any) -> Read:
    """Straight lines between nodes, the nearest value outside, as the files say."""
    lines = RegularGridInterpolator((f, v), mu)

    def nearest(force: Any, speed: Any) -> Any:
        return lines((np.clip(force, f[0], f[-1]), np.clip(np.abs(speed), v[0], v[-1])))

    return Read(lambda depth: np.interp(depth, delta, force), nearest)


def from_modelica(law: ContactLaw, folder: Path) -> Read:
    """Reader by the specification of Modelica.Blocks.Tables: text files."""
    text = text_of(law, "modelica", ".txt")
    assert text.startswith("#1\n")
    words = " ".join(line.partition("#")[0] for line in text.splitlines())
    found = re.findall(r"double\s+(\w+)\((\d+),(\d+)\)([^a-df-z]*)", words)
    shaped = {n: np.array(cells.split(), float).reshape(int(r), int(c)) for n, r, c, cells in found}
    mu = shaped["mu"]
    return gridded(*shaped["line_force"].T, mu[1:, 0], mu[0, 1:], mu[1:, 1:])


def from_matlab(law: ContactLaw, folder: Path) -> Read:
    (data,) = files_of(law, "matlab").values()
    assert b"Created on" not in data
    read = loadmat(io.BytesIO(data), squeeze_me=True)
    np.testing.assert_array_equal(read["patches"], np.squeeze(law.surface.tables().C))
    np.testing.assert_array_equal(read["mu"], np.squeeze(law.surface.mu_nodes))
    grid = (read[f"table_{name}"] for name in ("normal_force_N_m", "slip_speed_m_s", "mu"))
    return gridded(read["penetration_m"], read["force_N_m"], *grid)


def csv_rows(law: ContactLaw, ending: str) -> list[dict[str, str]]:
    lines = text_of(law, "csv", ending).splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def from_csv(law: ContactLaw, folder: Path) -> Read:
    normal, table = (csv_rows(law, f"{of}.csv") for of in ("normal", "table"))
    delta, force = (np.array([float(r[k]) for r in normal]) for k in ("penetration_m", "force_N_m"))
    grid = np.array([[float(cell) for cell in row.values()] for row in table])
    speeds = np.array([float(name[6:-4]) for name in list(table[0])[1:]])
    return gridded(delta, force, grid[:, 0], speeds, grid[:, 1:])


def adams(law: ContactLaw, ending: str) -> str:
    """A file for Adams without its comments."""
    (data,) = (d for n, d in files_of(law, "adams").items() if re.fullmatch(f"[^m]*{ending}", n))
    lines = [line for line in data.decode().splitlines() if not line.startswith("!")]
    assert max(map(len, lines)) < 120
    return "\n".join(lines)


def from_adams(ending: str, metre: float) -> Function:
    """Reader of SPLINE statements: a comma in the first column continues a line."""

    def read(law: ContactLaw, folder: Path) -> Read:
        parts = adams(law, ending).replace("\n,", ",").split("SPLINE/")[1:]
        (x, y), (v, *rows) = (
            [np.array(cells.strip(" ,").split(","), float) for cells in re.split("[XY]=", part)[1:]]
            for part in parts
        )
        table = np.array(rows)  # each begins with its force
        force = Akima1DInterpolator(x / metre, y * metre)  # as Adams draws it
        mu = gridded(x, y, table[:, 0] * metre, v / metre, table[:, 1:]).mu
        return Read(force, mu)

    return read


READERS: dict[str, Function] = {
    "python": module("python"),
    "exudyn": module("exudyn"),
    "c": compiled("c", "gcc", "c"),
    "fortran": compiled("fortran", "gfortran", "f90"),
    "modelica": from_modelica,
    "matlab": from_matlab,
    "csv": from_csv,
    "adm": from_adams(r"\.adm", 1.0),
    "adm_mm": from_adams(r"_mm\.adm", 1e3),
}
RNG = np.random.default_rng(3)
SURFACES = {
    "noisy": beltid.FrictionSurface(
        np.geomspace(300.0, 2e4, 14), np.geomspace(1e-3, 0.1, 9), RNG.uniform(0.5, 1.5, (14, 9))
    ),
    "constant": beltid.FrictionSurface.constant(0.7),
    "by_force": beltid.FrictionSurface([500.0, 2000.0, 9000.0], [0.01], [[1.3], [1.0], [0.8]]),
    "from_zero": beltid.FrictionSurface([0.0, 2000.0], [0.0, 0.02], [[1.3, 1.2], [1.0, 0.8]]),
}


@pytest.mark.parametrize("of", ["known", *SURFACES])
@pytest.mark.parametrize("reader", READERS)
def test_an_export_is_the_law_inside_and_outside_its_range(
    law: ContactLaw, reader: str, of: str, tmp_path: Path
) -> None:
    if of != "known":
        friction = friction_part(SURFACES[of], "published")
        belt = BeltFacts(name="5pk" if "mm" in reader else "x" * 40)
        law = law.model_copy(update={"friction": friction, "belt": belt})
    read = READERS[reader](law, tmp_path)
    rng = np.random.default_rng(5)
    force, speed = np.r_[0.0, rng.uniform(-1e3, 4e4, 199)], np.r_[0.0, rng.uniform(-0.2, 0.2, 199)]
    tolerance = 1e-12 if read.exact else 1.3 * friction_table(law.surface)[-1].worst + 1e-8
    np.testing.assert_allclose(read.mu(force, speed), law.surface.mu(force, speed), rtol=tolerance)
    nodes = penetration_nodes(law)
    depth = rng.uniform(-1e-4, 3e-4, 200) if read.exact else rng.uniform(nodes[2], nodes[-3], 200)
    expected = law.normal_law.force(depth)
    above = 0.0 if read.exact else law.normal_law.k_quadratic_N_m3 * nodes[1] ** 2 / 4.0
    np.testing.assert_allclose(read.line_force(depth), expected, rtol=1e-7, atol=1.01 * above)


@pytest.mark.parametrize("unit", ["", "_mm"])
def test_the_splines_of_adams_view_are_those_of_the_solver(law: ContactLaw, unit: str) -> None:
    number = re.compile(r"-?\d+\.?\d*(?:e[-+]\d+)?\b")
    solver, view = (
        sorted(map(float, number.findall(adams(law, rf"{unit}\.{ending}").replace("MODEL_1", ""))))
        for ending in ("adm", "cmd")
    )
    assert solver == view


@pytest.mark.parametrize("target", TARGETS)
def test_every_file_says_what_it_is_and_depends_on_the_law_only(
    law: ContactLaw, target: str
) -> None:
    measured = files_of(law.model_copy(update={"origin": "measured"}), target)
    assert files_of(law, target) == files_of(law, target)
    for name, data in files_of(law, target).items():
        text = re.sub(r"\s+", " ", re.sub(r"\n(#|!|//) ", " ", data.decode("latin-1")))
        assert "synthetic" in text.lower(), name
        other = measured[name].replace(b"SYNTHETIC = False", b"").decode("latin-1")
        assert "synthetic" not in other.lower(), name
        assert "beltid 0.0" in text, name
        for words in ("900 to 8000 N/m", "400 to 12000 N/m", "10000 N/m"):
            assert target == "json" or words in text, (name, words)


def test_measured_inferred_and_extrapolated_are_distinguished(law: ContactLaw) -> None:
    for target in ("python", "exudyn"):
        names: dict[str, Any] = {}
        exec(text_of(law, target, ".py"), names)
        assert (names["FORCE_RANGE"], names["SPEED_RANGE"]) == ((900.0, 8000.0), (0.0025, 0.04))
    ranges = {float(r["normal_force_N_m"]): r["range"] for r in csv_rows(law, "nodes.csv")}
    assert set(ranges.values()) == {"measured", "inferred"}
    assert ranges == {f: "measured" if 900 <= f <= 8000 else "inferred" for f in ranges}
    normal = csv_rows(law, "normal.csv")
    measured = [float(row["force_N_m"]) <= 1e4 for row in normal]  # there the press ended
    assert [row["range"] != "extrapolated" for row in normal] == measured
    assert len(set(measured)) == 2
    d = float(normal[-1]["penetration_m"])
    by_hand = np.sqrt(1.4e8 * d**2 - 2 * 1.0e12 * d**3 + 8.2e15 * d**4)
    assert float(normal[-1]["force_se_N_m"]) == pytest.approx(by_hand, rel=1e-5)
    unknown = law.validity.model_copy(update={"measured_force_N_m": None})
    law = law.model_copy(update={"validity": unknown})
    assert {row["range"] for row in csv_rows(law, "nodes.csv")} == {""}
    assert "FORCE_RANGE = None" in text_of(law, "python", ".py")


HOSTILE = "x\nraise A\rraise B\x0craise C\x1draise D\x00raise E\u2028raise F*/ coding=utf_7 ??/ \\"


def test_no_text_of_a_law_leaves_the_comment(law: ContactLaw) -> None:
    """A law file from elsewhere must not bring code into the files made of it."""
    of = HOSTILE
    budget = (Contribution(source=of, contribution_percent=9.0),)
    own = {"method": of, "budget": budget, "mu_u": law.friction.mu}
    made = Provenance(software=of, recordings={of: "a" * 64}, config=of, notes=(of,))
    friction = law.friction.model_copy(update=own)
    text = {"about": of, "conditions": {of: of}, "friction": friction, "provenance": made}
    for target in set(TARGETS) - {"json", "matlab"}:
        for data in files_of(law.model_copy(update=text), target).values():
            lines = re.split("[\n\r\x0b\x0c\x1c-\x1e]", data.decode("ascii"))
            if target in ("python", "exudyn"):
                assert lines[0] == "# -*- coding: utf-8 -*-"  # no comment below can name another
            for line in lines:
                if "raise" in line or "coding=" in line:
                    assert line.startswith(("# ", "! ", "// ")), (target, line)
                    assert not re.search(r"[\x00-\x1f\\]|\?\?", line)


def test_deviations_of_a_power_law_are_those_of_its_closed_form(law: ContactLaw) -> None:
    """mu = 0.9 f^-a v^b on many nodes: the surface is that law to five digits."""
    a, b = 0.17, 0.16
    f, v = np.geomspace(500.0, 8000.0, 33), np.geomspace(0.002, 0.032, 33)
    surface = beltid.FrictionSurface(f, v, 0.9 * f[:, None] ** -a * v[None, :] ** b)
    law = law.model_copy(update={"friction": friction_part(surface, "published")})
    linear, constant = deviations(law, reference_point(law, 2000.0, 0.008)).values()
    # mu(2000, 0.008)/mu(f, v) = (f/2000)^a (v/0.008)^-b: at 8000 N/m, 0.002 m/s
    assert constant.worst == pytest.approx(4 ** (a + b) - 1, rel=1e-3)
    assert constant.where == "at 8000 N/m, 0.002 m/s"
    # even in ln(1 + f/500) and ln(1 + v/0.002)
    x = np.linspace(*np.log([2.0, 17.0]), 2001)
    ratio = (0.25 * np.expm1(x[:, None])) ** a * (0.25 * np.expm1(x)) ** -b
    assert constant.rms == pytest.approx(np.sqrt(np.mean((ratio - 1.0) ** 2)), rel=0.01)
    # Eq. (3): the secant at 2000 N/m, against the law at 8000 N/m
    delta = (-6.5e7 + np.sqrt(6.5e7**2 + 4 * 3.0256e11 * np.array([2000.0, 8000.0]))) / 6.0512e11
    assert linear.worst == pytest.approx(1 - 0.25 * delta[1] / delta[0], rel=1e-9)
    assert linear.where == "at 8000 N/m"
    stated = re.sub(r"\n\W*", " ", text_of(law, "exudyn", ".py"))
    for deviation in export(law, "exudyn", reference_point(law)).reductions.values():
        assert f"{100 * deviation.worst:.2g} % at worst" in stated


@pytest.mark.parametrize(
    ("force", "speed", "said"),
    [
        (100.0, None, "--normal-force = 100, must be in the range of mu, 400 to 12000 N/m"),
        (None, 1.0, "--speed = 1, must be in the range of mu, 0.0025 to 0.04 m/s"),
        (np.nan, -1.0, "--speed = -1"),
    ],
)
def test_a_reference_point_outside_is_refused(
    law: ContactLaw, force: Any, speed: Any, said: str
) -> None:
    with pytest.raises(beltid.InputError) as error:
        reference_point(law, force, speed)
    assert said in str(error.value)
