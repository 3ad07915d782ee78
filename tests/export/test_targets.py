"""Every target read back by a reader that knows the format, not our writer."""

from __future__ import annotations

import csv
import io
import re
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import Akima1DInterpolator, RegularGridInterpolator
from scipy.io import loadmat

import beltid
from beltid.export.choices import MM, SI, Choices
from beltid.export.law import ContactLaw, Contribution, Provenance, friction_part
from beltid.export.reduction import ReferencePoint
from beltid.export.targets import TARGETS

POINT = ReferencePoint(3000.0, 0.01)
FORCES = np.array([400.0, 700.0, 3000.0, 6500.0, 12000.0])
SPEEDS = np.array([0.0025, 0.004, 0.01, 0.023, 0.04])
HOSTILE = "x\nraise A\rraise B\x0craise C\x1draise D\x00raise E\u2028raise F*/ coding=utf_7 ??/ \\"


def written(law: ContactLaw, target: str, units: Any = SI) -> dict[str, bytes]:
    return TARGETS[target].write(law, Choices(POINT, units)).files


def text_of(law: ContactLaw, target: str, ending: str, units: Any = SI) -> str:
    (data,) = (d for name, d in written(law, target, units).items() if name.endswith(ending))
    return data.decode("ascii")


def assert_is_surface(law: ContactLaw, f: Any, v: Any, mu: Any) -> None:
    """Bilinear between the nodes of the table, to the thousandth that is stated."""
    table = RegularGridInterpolator((f, v), mu, bounds_error=False, fill_value=None)
    grid = np.stack(np.meshgrid(FORCES, SPEEDS, indexing="ij"), axis=-1)
    np.testing.assert_allclose(table(grid), law.surface.mu(FORCES[:, None], SPEEDS), rtol=1.1e-3)
    assert (f[0], v[0]) == pytest.approx((400.0, 0.0025))
    assert (f[-1], v[-1]) == pytest.approx((12000.0, 0.04))


def assert_is_normal_law(delta: Any, force: Any) -> None:
    """Eq. (3) of the paper: 49.9 µm under 40 N/cm, 87.5 µm under 80 N/cm."""
    assert delta[0] == 0.0
    assert force[0] == 0.0
    assert np.interp(49.9e-6, delta, force) == pytest.approx(4000.0, rel=2e-3)
    assert np.interp(87.5e-6, delta, force) == pytest.approx(8000.0, rel=2e-3)


@pytest.mark.parametrize("target", TARGETS)
def test_every_file_says_what_it_is_and_depends_on_the_law_only(
    law: ContactLaw, target: str
) -> None:
    files = written(law, target)
    assert files == written(law, target)
    for name, data in files.items():
        text = re.sub(r"\n(#|!|//) ", " ", data.decode("latin-1"))
        assert "synthetic" in text.lower(), name
        assert "beltid 0.0" in text, name
        if target != "json":
            for word in ("400 to 12000 N/m", "never extrapolate", "Use", "Standard "):
                assert word in re.sub(r"\s+", " ", text), (name, word)


def test_a_reduced_law_states_how_far_it_is_from_the_law(law: ContactLaw) -> None:
    export = TARGETS["exudyn"].write(law, Choices(POINT))
    assert export.reductions
    stated = " ".join(data.decode("ascii") for data in export.files.values())
    for deviation in export.reductions.values():
        assert f"{100 * deviation.worst:.2g} % at worst" in re.sub(r"\n\W*", " ", stated)


def test_no_text_of_a_law_leaves_the_comment(law: ContactLaw) -> None:
    """A law file from elsewhere must not bring code into the files made of it."""
    hostile = hostile_law(law, HOSTILE)
    for target in set(TARGETS) - {"json", "matlab"}:
        for data in written(hostile, target).values():
            lines = re.split("[\n\r\x0b\x0c\x1c-\x1e]", data.decode("ascii"))
            for line in lines:
                if "raise" in line or "coding=" in line:
                    assert line.startswith(("# ", "! ", "// ")), (target, line)
                    assert not re.search(r"[\x00-\x1f\\\\]|\?\?", line)


def hostile_law(law: ContactLaw, text: str) -> ContactLaw:
    """The law with a text in every place that takes any text."""
    budget = (Contribution(source=text, contribution_percent=9.0),)
    part = law.friction.model_copy(
        update={"method": text, "budget": budget, "mu_u": law.friction.mu}
    )
    provenance = Provenance(software=text, recordings={text: "a" * 64}, config=text, notes=(text,))
    return law.model_copy(
        update={
            "about": text,
            "conditions": {text: text},
            "friction": part,
            "provenance": provenance,
        }
    )


def test_measured_data_are_not_called_synthetic(law: ContactLaw) -> None:
    measured = law.model_copy(update={"origin": "measured"})
    for target in TARGETS:
        for name, data in written(measured, target).items():
            text = data.replace(b"SYNTHETIC = False", b"").decode("latin-1").lower()
            assert "synthetic" not in text, name


# ---------------------------------------------------------------- Modelica


def modelica_tables(text: str) -> dict[str, np.ndarray]:
    """Reader by the specification of Modelica.Blocks.Tables: text files."""
    lines = text.splitlines()
    assert lines[0] == "#1"
    words = " ".join(line.split("#")[0] for line in lines[1:])
    tables = {}
    for match in re.finditer(
        r"double\s+(\w+)\s*\(\s*(\d+)\s*,\s*(\d+)\s*\)([^a-df-zA-DF-Z]*)", words
    ):
        shape = int(match[2]), int(match[3])
        numbers = [float(word) for word in re.split(r"[\s,;]+", match[4].strip())]
        assert len(numbers) == shape[0] * shape[1]
        tables[match[1]] = np.reshape(numbers, shape)
    return tables


def test_modelica_tables(law: ContactLaw) -> None:
    tables = modelica_tables(text_of(law, "modelica", ".txt"))
    assert set(tables) == {"line_force", "mu"}
    assert_is_normal_law(*tables["line_force"].T)
    mu = tables["mu"]
    assert mu[0, 0] == 0.0
    assert_is_surface(law, mu[1:, 0], mu[0, 1:], mu[1:, 1:])


# ---------------------------------------------------------------- MATLAB


def test_matlab_file(law: ContactLaw) -> None:
    (data,) = written(law, "matlab").values()
    assert data[:19] == b"MATLAB 5.0 MAT-file"
    assert b"Created on" not in data
    read = loadmat(io.BytesIO(data), squeeze_me=True)
    np.testing.assert_array_equal(read["mu"], law.surface.mu_nodes)
    np.testing.assert_array_equal(read["mu_se"], law.surface.mu_se_nodes)
    np.testing.assert_array_equal(read["patches"], law.surface.tables().C)
    np.testing.assert_array_equal(read["covariance"], np.array(law.normal.covariance))
    assert float(read["k_linear_N_m2"]) == law.normal.k_linear_N_m2
    assert str(read["origin"]) == "synthetic"
    assert "SYNTHETIC" in str(read["readme"])
    assert_is_normal_law(read["penetration_m"], read["force_N_m"])
    assert_is_surface(
        law, read["table_normal_force_N_m"], read["table_slip_speed_m_s"], read["table_mu"]
    )


# ---------------------------------------------------------------- Adams


def adm_splines(text: str) -> dict[int, dict[str, list[list[float]]]]:
    """SPLINE statements of a solver dataset; a comma in the first column continues."""
    kept = [line for line in text.splitlines() if not line.startswith("!")]
    statements = re.sub(r"\n,", ",", "\n".join(kept)).splitlines()
    splines = {}
    for statement in statements:
        head, _, rest = statement.partition(",")
        number = int(re.fullmatch(r"SPLINE/(\d+)", head)[1])  # type: ignore[index]
        fields: dict[str, list[list[float]]] = {"X": [], "Y": []}
        for key, values in re.findall(r"([XY])=([^XY]*)", rest):
            fields[key].append([float(cell) for cell in values.strip(" ,").split(",")])
        splines[number] = fields
    return splines


def cmd_splines(text: str) -> dict[str, dict[str, Any]]:
    """``data_element create spline`` commands of Adams View; & continues a line."""
    kept = "\n".join(line for line in text.splitlines() if not line.startswith("!"))
    splines = {}
    for command in kept.replace("&\n", " ").splitlines():
        assert command.startswith("data_element create spline ")
        fields = dict(re.findall(r"(\w+) = (.*?)(?=\s+\w+ = |$)", command[27:]))
        splines[fields["spline_name"]] = fields
    return splines


def numbers(text: str) -> np.ndarray:
    return np.array([float(cell) for cell in text.split(",")])


def test_adams_splines(law: ContactLaw) -> None:
    text = text_of(law, "adams", ".adm", MM)
    assert max(map(len, text.splitlines())) < 120
    splines = adm_splines(text)
    ((x,), (y,)) = splines[1001]["X"], splines[1001]["Y"]
    assert_is_normal_law(np.array(x) / 1e3, np.array(y) * 1e3)
    # Akima's spline, which Adams draws through them, is the parabola itself
    akima = Akima1DInterpolator(np.array(x) / 1e3, np.array(y) * 1e3)
    inner = np.linspace(x[2] / 1e3, x[-3] / 1e3, 77)
    np.testing.assert_allclose(akima(inner), law.normal_law.force(inner), rtol=1e-6)
    (speeds,) = splines[1002]["X"]
    family = np.array(splines[1002]["Y"])  # each begins with its z
    assert_is_surface(law, family[:, 0] * 1e3, np.array(speeds) / 1e3, family[:, 1:])


def test_adams_commands_hold_the_same_splines(law: ContactLaw) -> None:
    splines = cmd_splines(text_of(law, "adams", ".cmd"))
    force, friction = splines[".MODEL_1.belt_5pk_line_force"], splines[".MODEL_1.belt_5pk_mu"]
    assert_is_normal_law(numbers(force["x"]), numbers(force["y"]))
    x, z = numbers(friction["x"]), numbers(friction["z"])
    assert_is_surface(law, z, x, numbers(friction["y"]).reshape(z.size, x.size))
    assert friction["linear_extrapolate"] == "no"


def test_splines_have_four_points_even_where_the_surface_has_fewer(law: ContactLaw) -> None:
    surface = beltid.FrictionSurface([1000.0, 4000.0], [0.01], [[1.0], [0.8]])
    short = law.model_copy(update={"friction": friction_part(surface, "published")})
    (speeds,) = adm_splines(text_of(short, "adams", ".adm"))[1002]["X"]
    family = np.array(adm_splines(text_of(short, "adams", ".adm"))[1002]["Y"])
    assert len(speeds) == 4
    assert np.all(np.diff(speeds) > 0)
    assert np.all(family[:, 1:] == family[:, 1:2])  # the nearest value holds
    assert family[0, 1] == 1.0
    assert family[-1, 1] == 0.8
    # griddedInterpolant takes no axis of a single point
    (data,) = written(short, "matlab").values()
    assert min(loadmat(io.BytesIO(data))["table_mu"].shape) == 2


# ---------------------------------------------------------------- Python


def test_python_module(law: ContactLaw) -> None:
    names: dict[str, Any] = {}
    exec(text_of(law, "python", ".py"), names)
    rng = np.random.default_rng(5)
    forces, speeds = rng.uniform(0.0, 20000.0, 200), rng.uniform(-0.08, 0.08, 200)
    expected = law.surface.mu(forces, speeds)
    np.testing.assert_allclose(names["mu"](forces, speeds), expected, rtol=1e-13)
    gap, slip = np.array([1e-5, -5e-5, -5e-5, -5e-5]), np.array([0.01, 0.01, -0.01, 1e-5])
    normal, friction = names["contact_force"](gap, slip, 0.002, 1e-4)
    force = law.normal_law.force(5e-5)
    np.testing.assert_allclose(normal, [0.0, *[0.002 * force] * 3])
    full = 0.002 * force * law.surface.mu(force, 0.01)
    small = 0.1 * 0.002 * force * law.surface.mu(force, 0.0)
    np.testing.assert_allclose(friction, [0.0, full, -full, small], rtol=1e-12)


def test_penetration_of_a_law_without_linear_part(law: ContactLaw) -> None:
    quadratic = law.normal.model_copy(update={"k_linear_N_m2": 0.0})
    names: dict[str, Any] = {}
    exec(text_of(law.model_copy(update={"normal": quadratic}), "python", ".py"), names)
    found = names["penetration"](np.array([0.0, 3025.6]))
    np.testing.assert_allclose(found, [0.0, 1e-4], rtol=1e-12)


# ---------------------------------------------------------------- CSV


def csv_rows(data: bytes) -> list[dict[str, str]]:
    lines = [line for line in data.decode().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def test_measured_inferred_and_extrapolated_are_distinguished(law: ContactLaw) -> None:
    ranges = law.validity.model_copy(update={"measured_force_N_m": (900.0, 8000.0)})
    law = law.model_copy(update={"validity": ranges})
    for target, ending in (("adams", ".adm"), ("modelica", ".txt")):
        text = re.sub(r" [#!*]+ ", " ", " ".join(text_of(law, target, ending).split()))
        assert "mean line force of the runs 900 to 8000 N/m" in text, target
        assert "mu is inferred by the refined surface for line forces of 400 to 12000 N/m" in text
        assert "Extrapolated: line forces of the normal law beyond 10000 N/m" in text
    for target in ("python", "exudyn"):
        names: dict[str, Any] = {}
        exec(text_of(law, target, ".py"), names)
        assert (names["FORCE_RANGE"], names["SPEED_RANGE"]) == ((900.0, 8000.0), (0.0025, 0.04))
    nodes = csv_rows(written(law, "csv")["belt_5pk_friction_nodes.csv"])
    of_force = {float(row["normal_force_N_m"]): row["range"] for row in nodes}
    inside = {force: "measured" if 900 <= force <= 8000 else "inferred" for force in of_force}
    assert of_force == inside
    assert set(of_force.values()) == {"measured", "inferred"}
    unknown = law.validity.model_copy(update={"measured_force_N_m": None})
    law = law.model_copy(update={"validity": unknown})
    nodes = csv_rows(written(law, "csv")["belt_5pk_friction_nodes.csv"])
    assert {row["range"] for row in nodes} == {""}


def test_csv_grids(law: ContactLaw) -> None:
    files = written(law, "csv")
    nodes = csv_rows(files["belt_5pk_friction_nodes.csv"])
    mu = np.array([float(row["mu"]) for row in nodes]).reshape(8, 5)
    np.testing.assert_array_equal(mu, law.surface.mu_nodes)
    normal = csv_rows(files["belt_5pk_normal.csv"])
    ranges = [row.pop("range") for row in normal]
    column = {key: np.array([float(row[key]) for row in normal]) for key in normal[0]}
    # the press went to 10 kN/m, the friction surface to 12
    last = ranges.index("extrapolated") - 1
    assert column["force_N_m"][last] == pytest.approx(1.0e4, rel=1e-9)
    assert set(ranges[: last + 1]) == {"measured"}
    assert set(ranges[last + 1 :]) == {"extrapolated"}
    assert column["force_N_m"][-1] == pytest.approx(12000.0, rel=0.02)
    assert_is_normal_law(column["penetration_m"], column["force_N_m"])
    # error propagation by hand at the last node
    d = column["penetration_m"][-1]
    expected = np.sqrt(1.4e8 * d**2 - 2 * 1.0e12 * d**3 + 8.2e15 * d**4)
    assert column["force_se_N_m"][-1] == pytest.approx(expected, rel=1e-5)
    table = csv_rows(files["belt_5pk_friction_table.csv"])
    speeds = [float(name[6:-4]) for name in list(table[0])[1:]]
    values = np.array([[float(cell) for cell in row.values()] for row in table])
    assert_is_surface(law, values[:, 0], np.array(speeds), values[:, 1:])
