"""The documentation: its pages build without a warning, README and tutorial do what they say."""

from __future__ import annotations

import doctest
import pydoc
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import beltid
from beltid.cli import app
from beltid.store.artifact import read_artifact

ROOT = Path(__file__).parents[2]
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


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_commands_of_the_tutorial_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BELTID", str(ROOT))
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    assert len(commands(*ONWARD)) > 10
    for command in commands(*ONWARD):
        if command.startswith("beltid "):
            done = CliRunner().invoke(app, shlex.split(command)[1:])
            assert done.exit_code == 0, f"{command}\n{done.output}\n{done.exception!r}"
        else:
            python = re.sub(r"^python ", f"{shlex.quote(sys.executable)} ", command)
            subprocess.run(python, shell=True, check=True)
    assert (tmp_path / "runs" / "5pk" / "report.html").is_file()
    law = beltid.load_law(tmp_path / "law" / "5pk.beltlaw.json")
    assert law.origin == "synthetic"
    assert (law.belt.name, law.belt.ribs) == ("5pk", 5)
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


def test_the_tables_that_others_measured_are_reduced_as_their_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BELTID", str(ROOT))
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    said = ""
    for command in commands(OTHERS):
        if command.startswith("beltid "):
            done = CliRunner().invoke(app, shlex.split(command)[1:])
            assert done.exit_code == 0, f"{command}\n{done.output}\n{done.exception!r}"
            said += done.output
        else:
            subprocess.run(command, shell=True, check=True)
    page = OTHERS.read_text()
    for number in ("0.2145 to 0.4846", "5.29 %"):
        assert number in " ".join(said.split())
        assert number in page


def shown_in_readme() -> list[tuple[str, list[str]]]:
    """Commands of the README, each with the lines that it is said to print."""
    shown: list[tuple[str, list[str]]] = []
    for line in README.read_text().splitlines():
        if line.startswith("    $ "):
            shown.append((line.removeprefix("    $ "), []))
        elif shown and (line.startswith("    ") or not line):
            shown[-1][1].append(line.removeprefix("    ").rstrip())
        elif shown:
            shown.append(("", []))  # text ends the block of a command
    return [(command, lines) for command, lines in shown if command]


def parts(lines: list[str]) -> list[str]:
    """What stands between the dots of a block, each part in one piece."""
    text = "\n".join(lines).strip("\n")
    return [part.strip("\n") for part in re.split(r"^\.\.\.$", text, flags=re.M)]


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with the recordings and configs of the project, as the current one."""
    for name in ("configs", "rigdata"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    monkeypatch.delenv("COLUMNS", raising=False)
    return tmp_path


@pytest.mark.long
def test_commands_of_the_readme_print_what_it_shows(project: Path) -> None:
    shown, wrong = shown_in_readme(), []
    assert len(shown) > 3
    for command, lines in shown:
        done = CliRunner().invoke(app, shlex.split(command)[1:])
        assert done.exit_code == 0, f"{command}\n{done.output}\n{done.exception!r}"
        printed = "\n".join(line.rstrip() for line in (done.stdout + done.stderr).splitlines())
        wrong += [f"$ {command}\n{part}" for part in parts(lines) if part not in printed]
        if command.startswith("beltid run"):  # the same results: the steps find them up to date
            shutil.copytree(project / "runs" / "5pk", project / "tour")
    assert not wrong, "\n".join(wrong)
    for block in re.findall(r"^```python\n(.*?)^```$", README.read_text(), re.M | re.S):
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


def test_every_target_and_every_command_is_documented() -> None:
    from beltid.export.targets import TARGETS

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
    told = {int(number) for number in re.findall(r"\((\d+)\)", page)}
    assert told == set(range(1, 13))
