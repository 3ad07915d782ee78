"""The chain over one belt: what is done, what its report shows, results that fit no others."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from golden.door import configured

BELT = Path("runs/small")
STIFFNESS, FRICTION = BELT / "stiffness.parquet", BELT / "friction.parquet"
SURFACE, REFINED = BELT / "surface.parquet", BELT / "surface_refined.parquet"
QUICK = ("--method", "steady", "--arc", "82", "--tension", "411", "-o", "x.parquet")


def row_of(done: Any) -> dict[str, Any]:
    row: dict[str, Any] = json.loads(done.stdout)["table"][0]
    return row


@pytest.mark.usefixtures("undrawn")
def test_what_can_be_done_without_a_recording_is_done(bench: Path, beltid: Any) -> None:
    (bench / "part.yaml").write_text("belt: {name: part}\ndata: {press: press.csv}\n")
    done = beltid("run", "part.yaml", "--json", "-j", "1")
    assert done.exit_code == 0, done.stderr
    (warning,) = [line for line in done.stderr.splitlines() if line.startswith("warning: part: ")]
    assert "data.rig" in warning
    states, made = row_of(done)["stages"], {"fit-stiffness", "report"}
    assert {stage for stage, state in states.items() if state == "done"} == made
    others = {state for stage, state in states.items() if stage not in made}
    assert others == {"no recording"}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("name", "step"), [("slip.parquet", "fit-slip"), ("report.html", "report")]
)
def test_a_result_that_may_not_be_read_stops_its_step_only(
    name: str, step: str, bench: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (bench / "part.yaml").write_text("data: {press: press.csv, speedloss: speedloss.csv}\n")
    (bench / "runs/5pk").mkdir(parents=True)
    (bench / "slip.parquet").rename(bench / "runs/5pk" / name)
    plain = Path.open

    def locked(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.name == name:
            raise PermissionError(13, "Permission denied", str(path))
        return plain(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", locked)
    done = beltid("run", "part.yaml", "--json", "-j", "1")
    assert done.exit_code == 2, done.exception
    states = row_of(done)["stages"]
    assert (states[step], states["fit-stiffness"]) == ("failed", "done")
    assert f"{name}: no permission to read it" in done.stderr


# --- results that do not belong together, refused by every command that would use them as one ---


@pytest.fixture
def others(ran: Path, beltid: Any) -> Path:
    """Configs of another press segment and of another pulley, beside results of the first."""
    config = json.loads((ran / "beltid.yaml").read_text())
    configured(ran, config | {"press": {"segment_length_cm": 2}}, "segment.yaml")
    configured(ran, config | {"rig": {"pulley_radius_m": 0.052}}, "pulley.yaml")
    return ran


def refused(done: Any, *named: object) -> None:
    """The command says no, and names files, remedies and whatever else."""
    assert done.exit_code == 2, done.stdout
    text = " ".join(done.stderr.split())
    for name in named:
        assert str(name) in text, text


def test_a_law_of_another_segment_is_refused_with_the_surface(others: Path, beltid: Any) -> None:
    """More in the golden corpus; the published surface was made without any stiffness."""
    made = beltid("fit-stiffness", "press.csv", "-c", "segment.yaml", "-o", STIFFNESS)
    assert made.exit_code == 0, made.stderr
    slip = BELT / "slip.parquet"
    drive = ("simulate-drive", REFINED, STIFFNESS, "--from", slip, "-o", "x.parquet")
    for call in (drive, ("plan", REFINED, STIFFNESS, "-o", "x.csv")):
        refused(beltid(*call), REFINED, STIFFNESS, "beltid refine-surface")
    assert not list(others.glob("x.*"))
    assert beltid("export", "c", BELT, "--surface", "published").exit_code == 0
    assert beltid("simulate-rig", SURFACE, STIFFNESS, *QUICK).exit_code == 0


def test_a_friction_table_reduced_again_does_not_fit_what_was_made_before(
    others: Path, beltid: Any
) -> None:
    simulated = BELT / "simulated.parquet"
    made = beltid("fit-friction", "rig.csv", "-c", "pulley.yaml", "-o", FRICTION)
    assert made.exit_code == 0, made.stderr
    refused(beltid("compare", FRICTION, simulated, "-o", "x.parquet"), simulated, "simulate-rig")
    refused(beltid("simulate-rig", SURFACE, STIFFNESS, *QUICK), SURFACE, "build-surface")
    given = ("--from", FRICTION)
    refused(beltid("simulate-rig", SURFACE, STIFFNESS, *given, *QUICK), SURFACE, FRICTION)
    refused(beltid("plan", REFINED, STIFFNESS, *given, "-o", "x.csv"), REFINED, FRICTION)
    refused(beltid("report", BELT), SURFACE, FRICTION)
    refused(beltid("export", "c", BELT), REFINED, FRICTION, "refine-surface")


# --- the report of a run in which something failed, or is not wanted any more -------------------


def verdict(folder: Path) -> str:
    found = re.search(r'id="verdict">([^<]*)<', (folder / "report.html").read_text())
    assert found
    return found[1]


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_a_failed_stage_stands_on_top_and_what_it_left_is_not_shown(ran: Path, beltid: Any) -> None:
    config = json.loads((ran / "beltid.yaml").read_text())
    configured(ran, config | {"contact": {"points_per_element": 4}})
    before = (BELT / "compare_refined.parquet").read_bytes()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("beltid.refine.inverse.MOST_ITERATIONS", 1)
        done = beltid("run", "beltid.yaml", "-j", "1", "--json")
    assert done.exit_code == 3, done.stderr
    text = verdict(BELT)
    assert text.startswith("Incomplete: refine-surface failed (exit status 3): ")
    assert "no convergence" in text
    assert "proven" not in text.replace("not proven", "")
    page = (BELT / "report.html").read_text()
    assert 'id="figure-compare_refined"' not in page
    assert "compare_refined.parquet, crossvalidation.parquet: not shown" in page
    assert (BELT / "compare_refined.parquet").read_bytes() == before


@pytest.mark.usefixtures("undrawn")
def test_results_of_a_recording_that_is_not_named_any_more_are_not_shown(
    ran: Path, beltid: Any
) -> None:
    config = json.loads((ran / "beltid.yaml").read_text())
    del config["data"]["speedloss"]
    configured(ran, config)
    done = beltid("run", "beltid.yaml", "-j", "1")
    assert done.exit_code == 0, done.stderr
    page = (BELT / "report.html").read_text()
    assert "slip.parquet: not shown, left from an earlier run" in page
    assert ": there is no slip.parquet" in page
    assert 'id="figure-slip"' not in page
