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
from collections.abc import Callable
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
CAMPAIGN = ((40, 82), (100, 270, 411), (0.05, 0.21))
"""Arcs, tensions and speeds of the runs that the tutorial is called with."""
REDUCTIONS = ("fit-stiffness", "fit-friction", "build-surface")


def blocks(language: str, *pages: Path) -> list[str]:
    """Fenced blocks of some pages, in their order."""
    text = "".join(page.read_text() for page in pages)
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.M | re.S)


def commands(*pages: Path) -> list[str]:
    lines = "".join(blocks("console", *pages)).replace("\\\n", " ").splitlines()
    return [line.removeprefix("$ ") for line in lines]


def cut_slip_short(path: Path) -> None:
    """Keep every sixth of the 51 points."""
    header, *lines = path.read_text().splitlines(keepends=True)
    labels = list(dict.fromkeys(line.split(",")[0] for line in lines))[::6]
    path.write_text(header + "".join(line for line in lines if line.split(",")[0] in labels))


def cut_press_short(path: Path) -> None:
    """Keep one of the tests."""
    header, *lines = path.read_text().splitlines(keepends=True)
    path.write_text(header + "".join(line for line in lines if line.startswith("P22,")))


def cut_drive_short(path: Path) -> None:
    """Keep the slowest of the operating points."""
    text, count = re.subn(
        r"(driver_speed_rad_s: \[|A_C: \[)([^,\]]+),.*?\]", r"\1\2]", path.read_text()
    )
    assert count == 2
    path.write_text(text)


def cut_config_short(path: Path) -> None:
    """Simulate the limit only, on a coarse mesh; a drive by strings."""
    rough = "simulation: {method: steady, elements: 20}\ndrive: {method: string}\n"
    path.write_text(f"{path.read_text()}\n{rough}")


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_commands_of_the_tutorial_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part_of_rig: Callable[..., str]
) -> None:
    """With 12 of the 120 runs: the commands are tested here, not the numbers."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BELTID", str(ROOT))
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    # the limits of a drive roughly
    monkeypatch.setattr("beltid.drive.limits.TOLERANCE", 0.05)
    assert len(commands(*ONWARD)) > 10
    for command in commands(*ONWARD):
        if command.startswith("beltid "):
            # in this process where it can be: starting others is most of the time
            alone = ["--jobs", "1"] if command.startswith("beltid run") else []
            done = CliRunner().invoke(app, [*shlex.split(command)[1:], *alone])
            assert done.exit_code == 0, f"{command}\n{done.output}\n{done.exception!r}"
        else:
            python = re.sub(r"^python ", f"{shlex.quote(sys.executable)} ", command)
            subprocess.run(python, shell=True, check=True)
        if "rig.csv" in command and command.startswith("cp "):
            (tmp_path / "rig.csv").write_text(part_of_rig(*CAMPAIGN))
        if "press.csv" in command and command.startswith("cp "):
            cut_press_short(tmp_path / "press.csv")
        if "speedloss.csv" in command and command.startswith("cp "):
            cut_slip_short(tmp_path / "speedloss.csv")
        if "drive_accessory.yaml" in command and command.startswith("cp "):
            cut_drive_short(tmp_path / "drive_accessory.yaml")
        if command.startswith("beltid init"):
            cut_config_short(tmp_path / "5pk.yaml")
    assert (tmp_path / "runs" / "5pk" / "report.html").is_file()
    law = beltid.load_law(tmp_path / "law" / "5pk.beltlaw.json")
    assert law.synthetic
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


def differs_from_readme(shown: list[tuple[str, list[str]]], project: Path) -> list[str]:
    """Run commands of the README; those parts of what it shows that they do not print."""
    wrong = []
    for command, lines in shown:
        done = CliRunner().invoke(app, shlex.split(command)[1:])
        assert done.exit_code == 0, f"{command}\n{done.output}\n{done.exception!r}"
        printed = "\n".join(line.rstrip() for line in (done.stdout + done.stderr).splitlines())
        wrong += [f"$ {command}\n{part}" for part in parts(lines) if part not in printed]
        if command.startswith("beltid run"):  # the same results: the steps find them up to date
            shutil.copytree(project / "runs" / "5pk", project / "tour")
    return wrong


def test_the_recordings_are_reduced_to_what_the_readme_shows(project: Path) -> None:
    quick = [(c, lines) for c, lines in shown_in_readme() if c.split()[1] in REDUCTIONS]
    assert len(quick) == len(REDUCTIONS)
    wrong = differs_from_readme(quick, project)
    assert not wrong, "\n".join(wrong)


@pytest.mark.long
def test_commands_of_the_readme_print_what_it_shows(project: Path) -> None:
    shown = shown_in_readme()
    assert len(shown) >= len(REDUCTIONS)
    wrong = differs_from_readme(shown, project)
    assert not wrong, "\n".join(wrong)
    for block in re.findall(r"^```python\n(.*?)^```$", README.read_text(), re.M | re.S):
        exec(block, {})


def test_links_of_the_readme_lead_to_files() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", README.read_text())
    assert len(links) > 10
    assert [link for link in links if not (ROOT / link).is_file()] == []


def test_the_page_of_the_recordings_says_where_their_truth_is() -> None:
    text = (ROOT / "rigdata" / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(tests/truth/<belt>/\w+\.csv)`", text))
    assert {Path(name).name for name in named} == {"truth.csv", "speedloss_truth.csv"}
    for name in named:
        for belt in ("4pk", "5pk", "6pk"):
            assert (ROOT / name.replace("<belt>", belt)).is_file()


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
