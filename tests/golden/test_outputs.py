"""What goes out: exports, the report, figures, tables; and that all of it says "synthetic"."""

import re
import shutil
import subprocess
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

import beltid as beltid_api
from golden import kept
from golden.door import beltid, done, refused
from golden.test_chain import true_mu

mpl.use("agg")
POINTS = 200
TARGETS = ["json", "csv", "c", "fortran", "exudyn", "matlab", "modelica", "adams"]


def law_points(law: beltid_api.ContactLaw) -> pd.DataFrame:
    """Penetration, force and friction at points in and far outside the measured range."""
    f = np.geomspace(50, 50_000, POINTS)
    v = np.geomspace(1e-4, 1.0, POINTS)[::-1]
    depth = np.linspace(0, 3e-4, POINTS)
    return pd.DataFrame(
        {
            "penetration_m": depth,
            "force_N_m": law.normal_law.force(depth),
            "normal_force_N_m": f,
            "slip_speed_m_s": v,
            "mu": law.surface.mu(f, v),
        }
    )


@pytest.fixture(scope="module")
def exported(belt_5pk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    for target in TARGETS:
        done(folder, "export", target, belt_5pk, "-o", folder / target)
    return folder


def test_law_file_keeps_its_numbers(exported: Path, tmp_path: Path) -> None:
    """A law file is loaded and exported again: the same numbers."""
    (path,) = (exported / "json").glob("*.json")
    law = beltid_api.load_law(path)
    table = law_points(law)
    nodes = law.surface.normal_force_N_m, law.surface.slip_speed_m_s
    points = table["normal_force_N_m"].to_numpy(), table["slip_speed_m_s"].to_numpy()
    nearest = [np.clip(at, of[0], of[-1]) for at, of in zip(points, nodes, strict=True)]
    error = 100.0 * np.abs(table["mu"] / true_mu("5pk", *nearest) - 1.0)
    found = {"force_N_m": table["force_N_m"].tolist()[::10]}
    at_most = {"largest_percent": float(error.max()), "mean_percent": float(error.mean())}
    kept.check("export/law", {"columns": found, "at_most": at_most})
    done(tmp_path, "export json", path, "-o", tmp_path / "again")
    (again,) = (tmp_path / "again").glob("*.json")
    pd.testing.assert_frame_equal(law_points(beltid_api.load_law(again)), table)


def test_law_file_of_today_is_read(tmp_path: Path) -> None:
    """A law file that the frozen tree wrote (synthetic data), with its checksum."""
    path = Path(__file__).parent / "kept" / "export" / "5pk.beltlaw.json"
    table = law_points(beltid_api.load_law(path))
    found = {name: table[name].tolist()[::10] for name in ("force_N_m", "mu")}
    kept.check("export/law_of_today", {"columns": found})
    done(tmp_path, "export csv", path, "-o", tmp_path / "csv")
    damaged = path.read_text().replace('"k_linear_N_m2": 6', '"k_linear_N_m2": 7')
    assert damaged != path.read_text()
    (tmp_path / "5pk.beltlaw.json").write_text(damaged)
    refused(beltid(tmp_path, "export csv 5pk.beltlaw.json"), "5pk.beltlaw.json")


def test_every_target_says_synthetic_and_its_range(exported: Path) -> None:
    for target in TARGETS:
        texts = [
            p.read_text(errors="replace") for p in (exported / target).rglob("*") if p.is_file()
        ]
        assert texts, target
        assert any("synthetic" in text.lower() for text in texts), target


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_c_law_is_the_law(exported: Path, belt_5pk: Path, tmp_path: Path) -> None:
    """The compiled law at 200 points, most of them outside the measured range."""
    (source,) = (exported / "c").glob("*.c")
    (header,) = (exported / "c").glob("*.h")
    names = re.findall(r"double\s+(\w+)\s*\(", header.read_text())
    force = next(n for n in names if "force" in n)
    mu = next(n for n in names if n.endswith("mu"))
    (json_file,) = (exported / "json").glob("*.json")
    table = law_points(beltid_api.load_law(json_file))
    rows = ",".join(
        "{{{:.17g},{:.17g},{:.17g}}}".format(*row)
        for row in zip(
            table["penetration_m"], table["normal_force_N_m"], table["slip_speed_m_s"], strict=True
        )
    )
    program = f"""#include <stdio.h>
#include "{header.name}"
static const double p[][3] = {{{rows}}};
int main(void) {{
  for (int i = 0; i < {POINTS}; i++)
    printf("%.15g %.15g\\n", {force}(p[i][0]), {mu}(p[i][1], p[i][2]));
  return 0;
}}
"""
    (tmp_path / "main.c").write_text(program)
    build = ["gcc", "-std=c99", "-Wall", "-Werror", "-I", header.parent, "main.c", source, "-lm"]
    subprocess.run([*map(str, build), "-o", "law"], cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "law"], capture_output=True, text=True, check=True)
    found = np.array([line.split() for line in said.stdout.splitlines()], dtype=float)
    np.testing.assert_allclose(found[:, 0], table["force_N_m"], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], table["mu"], rtol=1e-6)


def test_table_of_the_law(exported: Path) -> None:
    """The CSV holds the surface at its nodes."""
    tables = {p.name: pd.read_csv(p, comment="#") for p in (exported / "csv").glob("*.csv")}
    (json_file,) = (exported / "json").glob("*.json")
    law = beltid_api.load_law(json_file)
    (surface,) = (t for t in tables.values() if "mu" in t)
    f, v = surface["normal_force_N_m"].to_numpy(), surface["slip_speed_m_s"].to_numpy()
    np.testing.assert_allclose(surface["mu"], law.surface.mu(f, v), rtol=1e-6)


def test_export_of_what_is_missing(tmp_path: Path) -> None:
    refused(beltid(tmp_path, "export c", tmp_path), str(tmp_path.name))
    refused(beltid(tmp_path, "export cobol", tmp_path), "cobol", "modelica")


SECTIONS = "stiffness slip friction surface proof drive uncertainty set-aside provenance"
FIGURES = (
    "press-law press-temperature slip friction arc map-surface_refined map-surface compare "
    "compare_refined differences drawing loss"
)


def test_report(belt_5pk: Path) -> None:
    """Verdict, sections and pictures are there, and where the data come from."""
    page = (belt_5pk / "report.html").read_text()
    (verdict,) = re.findall(r'<p class="verdict[^>]*id="verdict">(.*?)</p>', page, re.S)
    assert "within tolerance" in verdict
    assert re.search(r"0\.\d+ % RMS", verdict)
    assert "synthetic" in page
    missing = [name for name in SECTIONS.split() if f'id="{name}"' not in page]
    missing += [name for name in FIGURES.split() if f'id="figure-{name}"' not in page]
    assert not missing
    assert page.count("<svg") >= 30
    assert not re.search(r'(?:src|href)="https?://', page)  # needs no network


@pytest.mark.long
def test_report_of_two_belts(small: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        shutil.copytree(small, tmp_path / name)
    done(tmp_path, "report one two")
    page = (tmp_path / "report.html").read_text()
    assert "one" in page
    assert "two" in page
    assert (tmp_path / "one" / "report.html").exists()


PICTURES = ["stiffness", "slip", "friction", "surface_refined", "compare", "drive", "simulated"]


@pytest.mark.parametrize("name", PICTURES)
def test_picture_of_an_artifact(name: str, belt_5pk: Path, tmp_path: Path) -> None:
    figure = tmp_path / "picture.png"
    said = beltid(tmp_path, "show", belt_5pk / f"{name}.parquet", "-o", figure)
    if said.status == 2:  # several: one is asked for, by name
        names = re.findall(r"[a-z][\w-]+", said.stderr.partition("--figure")[2])
        wanted = next(n for n in names if n in said.stderr and ("-" in n or n == name))
        done(tmp_path, "show", belt_5pk / f"{name}.parquet", "-o", figure, "--figure", wanted)
    assert figure.stat().st_size > 10_000


def test_table_of_an_artifact(belt_5pk: Path, tmp_path: Path) -> None:
    done(tmp_path, "show", belt_5pk / "friction.parquet", "-o friction.csv")
    written = pd.read_csv(tmp_path / "friction.csv", comment="#")
    frame = pd.read_parquet(belt_5pk / "friction.parquet")
    np.testing.assert_allclose(written["mu_sliding"], frame["mu_sliding"], rtol=1e-9)


def test_figures_in_python(small: Path) -> None:
    config = beltid_api.load_config({})
    press = beltid_api.fit_stiffness(beltid_api.read_press(small / "press.csv", config), config)
    friction = beltid_api.fit_friction(beltid_api.read_rig(small / "rig.csv", config), config)
    surface = beltid_api.build_surface(friction, config)
    for result in (press, friction, surface):
        assert result.plot().axes
        assert len(result.to_frame())
