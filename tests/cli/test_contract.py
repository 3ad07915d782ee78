"""What every command that writes a result keeps to: one test of each promise for all of them.

A result depends on the sections of the config that its stage names: no other can be read here.
"""

import functools
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from beltid.config import Config, find_config
from beltid.stage import RECORDINGS, STAGES, Stage
from beltid.stages import steps  # noqa: F401  (registers the stages)
from beltid.stages.report_belt import keep_curves

CALLS = {
    "fit-stiffness": ("press.csv",),
    "fit-slip": ("speedloss.csv",),
    "fit-friction": ("rig.csv",),
    "build-surface": ("friction.parquet",),
    "refine-surface": ("friction.parquet", "stiffness.parquet"),
    "simulate-rig": ("surface.parquet", "stiffness.parquet", "--jobs", "1"),
    "compare": ("friction.parquet", "simulated.parquet"),
    "cross-validate": ("friction.parquet", "stiffness.parquet", "--jobs", "1"),
    "simulate-drive": (
        *("surface.parquet", "stiffness.parquet", "--from", "slip.parquet", "-c", "drive.yaml"),
    ),
    "compare-drive": ("slip.parquet", "drive.parquet"),
    "plan": ("surface.parquet", "stiffness.parquet", "--runs", "1"),
}
JUDGING = ("compare", "cross-validate", "compare-drive")
FILES = {name: stage.file_name({"arc": 0, "tension": 0, "speed": 0}) for name, stage in
         STAGES.items()}  # fmt: skip


@pytest.fixture(autouse=True)
def rough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits of a drive roughly."""
    monkeypatch.setattr("beltid.drive.simulator.LIMIT_TOLERANCE", 0.05)


def poisoned(config: Config, uses: tuple[str, ...]) -> Config:
    """A config that no other section than these can be read of."""

    class Poisoned(Config):
        def __getattribute__(self, name: str) -> Any:
            if name in Config.model_fields and name not in uses:
                raise AssertionError(f"the section {name} is read, but not among {uses}")
            return super().__getattribute__(name)

    return Poisoned.model_construct(config.model_fields_set, **dict(config))


@pytest.fixture(autouse=True)
def computed(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Names of the stages that have computed, of a config without what they do not name."""
    names: set[str] = set()

    def guarded(compute: Callable[..., Any], stage: Stage) -> Any:
        # of a recording, how it is read counts, too
        recorded = any(kind in RECORDINGS or "rig" in kind for kind in stage.reads.values())
        uses = (*stage.uses, *(("units",) if recorded else ()))

        @functools.wraps(compute)  # the command is made from its docstring
        def call(**given: Any) -> Any:
            names.add(stage.name)
            return compute(**{**given, "config": poisoned(given["config"], uses)})

        return call

    for stage in STAGES.values():
        monkeypatch.setattr(stage, "compute", guarded(stage.compute, stage))
    return names


def test_the_poison_is_noticed() -> None:
    config = poisoned(Config(), ("rig",))
    assert config.rig_params().R > 0.0
    with pytest.raises(AssertionError, match="the section belt is read"):
        config.belt_params()


def test_a_second_bench_and_the_curves_of_the_report_need_no_other_section(
    bench: Path, beltid: Any, computed: set[str]
) -> None:
    assert beltid("compare", "friction.parquet", "rig.csv", "-o", "benches.parquet").exit_code == 0
    keep_curves(find_config(None, bench / "beltid.yaml"), bench)
    assert computed == {"compare", "press-curves", "rig-curves"}


def state(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_every_step_is_a_command_with_a_contract() -> None:
    assert set(CALLS) == {name for name, stage in STAGES.items() if stage.is_command}


@pytest.mark.parametrize("name", CALLS)
def test_a_command_writes_its_file_and_says_what_it_wrote(
    name: str, bench: Path, beltid: Any, computed: set[str]
) -> None:
    (bench / FILES[name]).unlink(missing_ok=True)
    done = beltid(name, *CALLS[name], "--json")
    assert computed == {name}
    assert done.exit_code in ((0, 4) if name in JUDGING else (0,)), done.stderr
    said = json.loads(done.stdout)
    assert said["command"] == name
    assert Path(said["out"]).name == FILES[name]
    assert said["exit_status"] == done.exit_code
    assert (bench / FILES[name]).is_file()
    assert said["facts"]
    assert said["table"] or name == "plan"
    assert (said["verdict"] or "").startswith(("PASS", "FAIL")) == (name in JUDGING)
    if name == "plan":
        return
    before = (bench / FILES[name]).read_bytes()
    again = beltid(name, *CALLS[name])
    assert again.exit_code == done.exit_code
    assert "up to date" in again.stderr
    assert (bench / FILES[name]).read_bytes() == before
    assert FILES[name] in again.stdout


@pytest.mark.parametrize("name", CALLS)
def test_nothing_is_replaced_that_must_stay(name: str, bench: Path, beltid: Any) -> None:
    """A foreign file, a file of another ending, an input, even with --force: status 2."""
    mine = f"mine{Path(FILES[name]).suffix}"
    for file in (mine, "mine.txt"):
        (bench / file).write_text("my own file")
    before = state(bench)
    for out, *force in ((mine,), ("mine.txt", "--force"), (CALLS[name][0], "--force")):
        done = beltid(name, *CALLS[name], "-o", out, *force)
        assert done.exit_code == 2, (out, done.stdout, done.stderr)
        (line,) = [x for x in done.stderr.splitlines() if x.startswith("error: ")]
        assert out in line
    assert state(bench) == before


@pytest.mark.parametrize("name", CALLS)
def test_an_input_that_is_missing_or_of_another_kind_is_named(
    name: str, bench: Path, beltid: Any
) -> None:
    first, *rest = CALLS[name]
    out = f"new{Path(FILES[name]).suffix}"
    wrong = "other.parquet" if first.endswith(".parquet") else "beltid.yaml"
    shutil.copy(bench / "compare.parquet", bench / "other.parquet")
    for file in ("nothing.here", wrong):
        done = beltid(name, file, *rest, "-o", out)
        assert done.exit_code == 2
        assert file in done.stderr
    assert not (bench / out).exists()


@pytest.mark.parametrize("changed", ["speedloss.csv", "runs.csv"])
def test_an_input_that_changes_while_it_is_read_is_noticed(
    changed: str, bench: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = STAGES["fit-slip"]
    compute = stage.compute

    def meanwhile(**given: Any) -> Any:
        with (bench / changed).open("a") as file:
            file.write("\n")
        return compute(**given)

    (bench / "slip.parquet").unlink()
    (bench / "runs.csv").write_text("file,initial_tension_N\nspeedloss.csv,300\n")
    (bench / "other.yaml").write_text("runs: {speedloss: {table: runs.csv}}\n")
    monkeypatch.setattr(stage, "compute", meanwhile)
    done = beltid("fit-slip", "speedloss.csv", "-c", "other.yaml")
    assert done.exit_code == 2
    assert f"{changed}: was changed while it was read" in done.stderr
    assert not (bench / "slip.parquet").exists()


def test_the_content_of_an_input_makes_it_again_and_not_its_time(bench: Path, beltid: Any) -> None:
    call = ("fit-slip", "speedloss.csv", "--json")
    text = (bench / "speedloss.csv").read_text()
    for content, options in ((text, ()), (text, ("--force",)), (text + "\n", ())):
        (bench / "speedloss.csv").write_text(content)
        done = beltid(*call, *options)
        assert done.exit_code == 0, done.stderr
        assert json.loads(done.stdout)["up_to_date"] == ((content, options) == (text, ()))
