"""The documentation: its pages build without a warning, README and tutorial do what they say."""

import doctest
import json
import os
import pydoc
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from golden.door import ROOT, done

import beltid
from beltid.export.targets import TARGETS
from beltid.store.artifact import read_artifact

# everything but the writing of pages
SPHINX = (sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "dummy")
TUTORIAL = ROOT / "docs" / "tutorial.md"
ONWARD = (TUTORIAL, ROOT / "docs" / "drive.md", ROOT / "docs" / "plan.md")
"""The tutorial and the pages that go on from it, in their order."""
OTHERS = ROOT / "docs" / "verification.md"
README = ROOT / "README.md"


def blocks(language: str, *pages: Path) -> list[str]:
    """Fenced blocks of some pages, in their order."""
    text = "".join(page.read_text() for page in pages)
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.M | re.S)


def commands(*pages: Path) -> list[str]:
    lines = "".join(blocks("console", *pages)).replace("\\\n", " ").splitlines()
    return [line.removeprefix("$ ") for line in lines]


def follow(folder: Path, *pages: Path) -> str:
    """Give the commands of some pages in a folder, one after the other; what they say."""
    said, environment = "", os.environ | {"BELTID": str(ROOT)}
    for command in commands(*pages):
        if command.startswith("beltid "):
            said += done(folder, command.removeprefix("beltid ")).stdout
        else:
            python = re.sub(r"^python ", f"{shlex.quote(sys.executable)} ", command)
            subprocess.run(python, shell=True, check=True, cwd=folder, env=environment)
    return said


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_commands_of_the_tutorial_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(commands(*ONWARD)) > 10
    follow(tmp_path, *ONWARD)
    assert (tmp_path / "runs" / "5pk" / "report.html").is_file()
    law = beltid.load_law(tmp_path / "law" / "5pk.beltlaw.json")
    assert law.origin == "synthetic"
    assert (law.belt.name, law.belt.ribs) == ("5pk", 5)
    monkeypatch.chdir(tmp_path)
    for block in blocks("python", *ONWARD):
        exec(block, {})


@pytest.mark.long
def test_the_session_in_python_runs(project: Path) -> None:
    parsed = doctest.DocTestParser().get_doctest(
        (ROOT / "docs" / "python.md").read_text().replace("```", ""), {}, "python.md", None, 0
    )
    told: list[str] = []
    failed = doctest.DocTestRunner().run(parsed, out=told.append).failed
    assert len(parsed.examples) >= 20
    assert not failed, "".join(told)
    assert "<svg" in Path("friction.svg").read_text()
    saved = beltid.build_surface(read_artifact("friction.parquet"))
    assert saved.columns["mu"].size
    assert read_artifact("friction.parquet").origin == "synthetic"


def test_the_tables_that_others_measured_are_reduced_as_their_page_says(tmp_path: Path) -> None:
    said = " ".join(follow(tmp_path, OTHERS).split())
    for number in ("0.2145 to 0.4846", "5.29 %"):
        assert number in said
        assert number in OTHERS.read_text()


def shown_in_readme() -> list[tuple[str, list[str]]]:
    """Commands of the README, each with what it is said to print, the pieces between dots."""
    shown = re.findall(r"^    \$ (.+)\n((?:    (?!\$ ).*\n|\n)*)", README.read_text(), re.M)
    pieces = (re.split(r"^\.\.\.$", textwrap.dedent(text), flags=re.M) for _, text in shown)
    return [
        (command, [piece.strip("\n") for piece in told])
        for (command, _), told in zip(shown, pieces, strict=True)
    ]


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with the recordings and configs of the project, as the current one."""
    for name in ("configs", "rigdata"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    return tmp_path


@pytest.mark.long
def test_commands_of_the_readme_print_what_it_shows(project: Path) -> None:
    shown, wrong = shown_in_readme(), []
    assert len(shown) > 3
    for command, pieces in shown:
        said = done(project, command.removeprefix("beltid "), COLUMNS="80")
        printed = "\n".join(line.rstrip() for line in (said.stdout + said.stderr).splitlines())
        wrong += [f"$ {command}\n{piece}" for piece in pieces if piece not in printed]
        if command.startswith("beltid run"):  # the same results: the steps find them up to date
            shutil.copytree(project / "runs" / "5pk", project / "tour")
    assert not wrong, "\n".join(wrong)
    for block in blocks("python", README):
        exec(block, {})


def test_links_of_the_readme_lead_to_files() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", README.read_text())
    assert len(links) > 10
    assert [link for link in links if not (ROOT / link).is_file()] == []


def test_the_citation_names_this_version() -> None:
    stated = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert stated is not None
    assert stated[1] == beltid.__version__


def test_pages_build_without_a_warning(tmp_path: Path) -> None:
    done = subprocess.run(
        [*SPHINX, "-d", tmp_path / "doctrees", ROOT / "docs", tmp_path / "html"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert b"beltid.simulate_rig" in (tmp_path / "doctrees" / "python.doctree").read_bytes()


def test_every_target_is_documented() -> None:
    told = (ROOT / "docs" / "export.md").read_text()
    assert all(f"`{name}`" in told or f"export {name}" in told for name in TARGETS)


def test_the_page_of_columns_and_keys_is_that_of_this_program() -> None:
    written = runpy.run_path(str(ROOT / "docs" / "reference.py"))["text"]()
    page = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    assert page == written, "write it again: python docs/reference.py"
    for name in ("momentum_N", "skip_lines", "mass_per_length_rel", "torque_with"):
        assert f"`{name}`" in page


def test_every_equation_is_where_its_page_says() -> None:
    theory = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    page = theory.partition("## Where the equations are")[2]
    names = re.findall(r"`(beltid[.\w]+)`", page)
    assert len(names) > 20
    assert [name for name in names if pydoc.locate(name) is None] == []
    assert {int(number) for number in re.findall(r"\((\d+)\)", page)} == set(range(1, 13))


def test_a_stage_of_ones_own_is_a_command_and_up_to_date_when_it_is(
    tmp_path: Path, part_of_rig: Any
) -> None:
    (code,) = blocks("python", ROOT / "docs" / "own_stage.md")
    assert len(code.splitlines()) <= 60
    (tmp_path / "wear.py").write_text(code)
    (tmp_path / "rig.csv").write_text(part_of_rig((40, 82), (100, 270, 411), (0.05, 0.21)))
    beltid.fit_friction(pd.read_csv(tmp_path / "rig.csv")).save(tmp_path / "friction.parquet")

    def call(*arguments: str) -> Any:
        return subprocess.run(
            [sys.executable, "wear.py", "wear", *arguments],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )

    first = call("friction.parquet", "--json")
    assert first.returncode == 0, first.stderr
    said = json.loads(first.stdout)
    assert {row["arc_deg"] for row in said["table"]} == {40.0, 82.0}
    assert said["facts"]["pulley_radius_m"] == 0.05
    frame = pd.read_parquet(tmp_path / "wear.parquet")
    assert frame["runs"].tolist() == [6, 6]
    assert json.loads(call("friction.parquet", "--json").stdout)["up_to_date"]
    assert not json.loads(call("friction.parquet", "--json", "--least", "7").stdout)["table"]
