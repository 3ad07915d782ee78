"""A config for a new belt; the values that hold and where they come from; what a file is."""

from __future__ import annotations

import hashlib
import json
import zipfile
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from beltid.config import Config, load_config
from beltid.config.template import MEANINGS, SECTIONS, template_text


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_every_key_that_a_new_config_writes_out_has_a_meaning() -> None:
    keys = {
        f"{section}.{name}"
        for section in SECTIONS
        for name in type(getattr(Config(), section)).model_fields
    }
    assert set(MEANINGS) == keys


def test_init_writes_a_config_that_states_the_answers(beltid: Any) -> None:
    Path("benches").mkdir()
    Path("benches/press.csv").touch()
    made = beltid(
        *("init", "7pk", "--press", "benches/press.csv", "--rig", "benches/rig.csv"),
        *("--pulley-radius", "0.06", "--arcs", "40,68", "-o", "configs/seven.yaml"),
    )
    assert made.exit_code == 0, made.stderr
    config = load_config("configs/seven.yaml")
    assert (config.belt.name, config.belt.type, config.belt.ribs) == ("7pk", "7PK", 7)
    assert config.rig.pulley_radius_m == 0.06
    assert config.rig.arcs_deg == (40.0, 68.0)
    assert config.data.press is not None
    assert config.data.press.samefile("benches/press.csv")
    assert "data.rig: there is no" in made.stderr
    assert "data.press: there is no" not in made.stderr
    # what nobody stated stays a default: an assumed uncertainty must not turn into a stated one
    assert not config.uncertainty.model_fields_set
    assert config.belt.model_fields_set == {"name", "type", "ribs"}
    assert config.rig.model_fields_set == {"pulley_radius_m", "arcs_deg"}


def test_every_line_of_a_new_config_is_valid_once_its_sign_is_taken_away(beltid: Any) -> None:
    beltid("init", "new")
    text = Path("new.yaml").read_text()
    Path("all.yaml").write_text(text.replace("\n  # ", "\n  "))
    assert load_config("all.yaml").model_dump() == load_config("new.yaml").model_dump()
    assert len(load_config("all.yaml").uncertainty.model_fields_set) > 10


@settings(max_examples=12, deadline=None)
@given(
    name=st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,20}", fullmatch=True),
    belt_type=st.text(st.characters(categories=("L", "N", "P", "Zs")), min_size=1, max_size=40),
    radius=st.floats(0.002, 5.0),
    arcs=st.lists(st.floats(0.1, 359.0), min_size=1, max_size=4, unique=True),
)
def test_any_values_come_back(name: str, belt_type: str, radius: float, arcs: list[float]) -> None:
    if not belt_type.isprintable():
        return
    config = Config.model_validate(
        {
            "belt": {"name": name, "type": belt_type},
            "rig": {"pulley_radius_m": radius, "arcs_deg": arcs},
        }
    )
    stated = frozenset({"belt.name", "belt.type", "rig.pulley_radius_m", "rig.arcs_deg"})
    Path("any.yaml").write_text(template_text(config, stated), encoding="utf-8")
    assert load_config("any.yaml") == config


def test_init_replaces_nothing_without_force(beltid: Any) -> None:
    Path("a.yaml").write_text("belt: {name: mine}\n")
    refused = beltid("init", "a")
    assert refused.exit_code == 2
    assert "a.yaml: already exists; use --force to overwrite" in refused.stderr
    assert Path("a.yaml").read_text() == "belt: {name: mine}\n"
    assert beltid("init", "a", "--force").exit_code == 0
    assert beltid("init", "a", "-o", "press.csv").exit_code == 2


def test_init_tells_all_that_is_wrong_and_writes_nothing(beltid: Any) -> None:
    refused = beltid(
        "init", "a/b", "--ribs", "0", "--arcs", "40,400,x", "--origin", "guess", "--speeds", ""
    )
    assert refused.exit_code == 2
    for key in ("belt.name", "belt.ribs = 0", "rig.arcs_deg[1] = 400", "data.origin", "rig.pull"):
        assert key in refused.stderr
    assert list(Path().iterdir()) == []


def test_init_asks_on_a_terminal(beltid: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter(["eight", "8PJ", "", "9e4", *[""] * 6, "measured"])
    asked = []

    def prompt(question: str, **options: Any) -> str:
        asked.append(question)
        return next(answers)

    monkeypatch.setattr("typer.prompt", prompt)
    monkeypatch.setattr("beltid.cli.commands.init.on_terminal", lambda: True)
    made = beltid("init", "--bending-stiffness", "0.01")
    assert made.exit_code == 0, made.stderr
    config = load_config("eight.yaml")
    assert (config.belt.type, config.belt.ribs) == ("8PJ", 8)
    assert config.belt.axial_stiffness_N == 9e4
    assert config.belt.bending_stiffness_N_m2 == 0.01
    assert config.data.origin == "measured"
    assert not any("EI" in question for question in asked)  # a flag said it
    assert beltid("init", "nine", "--no-input").exit_code == 0


def test_init_checks_each_answer_at_once_and_shows_the_defaults(
    beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(["a/b", "6pk", "", "0", "-1", "", "", "", "", "", ""])
    files = iter(["gone.csv", "gone.csv", "", "", ""])
    asked: list[str] = []

    def prompt(question: str, **options: Any) -> str:
        asked.append(question)
        return next(files if question.startswith(("Recording", "Where")) else answers)

    monkeypatch.setattr("typer.prompt", prompt)
    monkeypatch.setattr("beltid.cli.commands.init.on_terminal", lambda: True)
    made = beltid("init")
    assert made.exit_code == 0, made.stderr
    assert asked[:6] == [
        "Name of the belt (folder of the results) [5pk]",
        "Name of the belt (folder of the results) [5pk]",
        "Type, such as 5PK [6PK]",
        *["Number of ribs [6]"] * 3,
    ]
    assert "Axial stiffness EA [N] [100000]" in asked
    for wrong in ("belt.name", "belt.ribs = 0, must be", "belt.ribs = -1", "there is no such file"):
        assert wrong in made.stderr
    assert sum("press" in question and "file" in question for question in asked) == 2
    config = load_config("6pk.yaml")
    assert (config.belt.ribs, str(config.data.press)) == (6, "gone.csv")
    assert config.belt.model_fields_set == {"name", "type", "ribs"}


def test_init_reads_the_settings_of_the_rig_from_its_recording(beltid: Any) -> None:
    lines = ["run,time_s,tension_tight_N,tension_slack_N,pulley_speed_rad_s,arc_deg,set_tension_N"]
    for run, (arc, tension, speed) in enumerate(product((35, 90.5), (120, 240), (0.0995, 0.4))):
        for k in range(20):
            noise = 0.002 * (k % 3 - 1)  # of the sensor: the highest samples are not the speed
            turning = speed * (1.001 if run % 2 else 0.999) * (k > 4) + noise
            lines.append(f"R{run},{0.1 * k:.1f},{tension},{tension},{turning:.5f},{arc},{tension}")
    Path("rig.csv").write_text("\n".join(lines).replace("set_tension", "initial_tension") + "\n")
    made = beltid("init", "new", "--rig", "rig.csv", "--tensions", "120,240,300", "--json")
    assert made.exit_code == 0, made.stderr
    rig = load_config("new.yaml").rig
    assert rig.arcs_deg == (35.0, 90.5)
    assert rig.initial_tensions_N == (120.0, 240.0, 300.0)  # what a flag says holds
    assert rig.pulley_speeds_rad_s == pytest.approx((0.0995, 0.4), rel=2e-3)
    rows = {row["key"]: row["origin"] for row in json.loads(made.stdout)["table"]}
    assert rows["rig.arcs_deg"] == rows["rig.pulley_speeds_rad_s"] == "recording"
    assert rows["rig.initial_tensions_N"] == "stated"


def test_init_names_the_command_that_tells_how_to_read_a_recording(beltid: Any) -> None:
    Path("rig.csv").write_text("run;Zeit;Umschlingung\nA;0,0;40\nA;0,1;40\n")
    said = beltid("init", "6pk", "--rig", "rig.csv")
    assert said.exit_code == 0
    assert "`beltid inspect rig.csv` lists everything that must be stated" in said.stderr


@pytest.mark.parametrize("options", [(), ("--all",)])
def test_config_show_prints_yaml_that_is_the_same_config(
    beltid: Any, options: tuple[str, ...]
) -> None:
    Path("beltid.yaml").write_text("belt: {name: mine, ribs: 6}\nrig:\n  arcs_deg: [30]\n")
    shown = beltid("config", "show", "rig.csv", *options)
    assert "config: beltid.yaml (found for rig.csv)" in shown.stderr.replace(f"{Path.cwd()}/", "")
    Path("again.yaml").write_text(shown.stdout)
    assert load_config("again.yaml") == load_config("beltid.yaml")
    assert beltid("config", "show", "rig.csv", *options, "-o", "out.yaml").stdout == ""
    assert Path("out.yaml").read_text() == shown.stdout
    refused = beltid("config", "show", "-o", "beltid.yaml")
    assert refused.exit_code == 2
    assert "beltid.yaml: already exists" in refused.stderr


def test_config_show_tells_what_is_stated_and_with_all_what_is_in_effect(beltid: Any) -> None:
    text = "belt: {name: mine}\nrig:\n  arcs_deg: [30]\ndata: {rig: rig.csv}\n"
    Path("my.yaml").write_text(text + "columns: {rig: {time_s: t}}\n")
    call = ("config", "show", "-c", "my.yaml", "--json")
    stated = [row["key"] for row in json.loads(beltid(*call).stdout)["table"]]
    assert stated == ["belt.name", "rig.arcs_deg", "data.rig", "columns.rig.time_s"]
    shown = [line.split(":")[0].strip() for line in beltid(*call[:-1]).stdout.splitlines()]
    assert [key for key in shown if key] == [
        *("belt", "name", "rig", "arcs_deg", "data", "rig", "columns", "rig", "time_s")
    ]
    rows = {r["key"]: r["value"] for r in json.loads(beltid(*call, "--all").stdout)["table"]}
    assert rows["belt.name"] == "mine"
    assert rows["rig.supports"] == "pinned"
    assert rows["drive.pulleys"][0]["name"] == "driver"  # not the text of an object
    nothing = beltid("config", "show").stdout
    Path("nothing.yaml").write_text(nothing)
    assert load_config("nothing.yaml") == Config()


def test_config_check_tells_what_is_wrong_in_all_of_them(beltid: Any) -> None:
    Path("press.csv").write_text("time_s\n")
    Path("good.yaml").write_text("belt: {name: good}\ndata: {press: press.csv}\n")
    Path("bad.yaml").write_text("belt: {ribs: 0}\n")
    Path("worse.yaml").write_text("rig: {radius: 1}\n")
    good = beltid("config", "check", "good.yaml")
    assert good.exit_code == 0
    assert "warning: good.yaml: no recording of the friction rig (data.rig)" in good.stderr
    bad = beltid("config", "check", "bad.yaml", "good.yaml", "worse.yaml")
    assert bad.exit_code == 2
    assert "bad.yaml:1:14: belt.ribs = 0" in bad.stderr
    assert "worse.yaml:1:7: rig.radius is not a known key" in bad.stderr


def test_config_check_warns_of_columns_that_the_recordings_do_not_have(beltid: Any) -> None:
    Path("press.csv").write_text("Zeit [s];Weg [mm];Kraft [N]\n0;0,5;1\n1;0,6;2\n2;0,7;3\n")
    Path("c.yaml").write_text("data: {press: press.csv}\ncolumns: {press: {force_N: Load}}\n")
    wrong = beltid("config", "check", "c.yaml")
    assert wrong.exit_code == 0
    line = "warning: c.yaml: cannot be read with these settings: press.csv:1: column Load (which "
    assert line + "the config" in wrong.stderr
    Path("c.yaml").write_text("data: {press: press.csv}\n")
    assert "cannot be read" not in beltid("config", "check", "c.yaml").stderr


@pytest.mark.parametrize(
    ("named", "told"),
    [
        ("gone.csv", "data.rig = gone.csv, there is no such file"),
        ("'gone*.csv'", "data.rig = gone*.csv, there is no such file"),
        ("empty", "data.rig = empty: holds no recording"),
        ("mixed", "data.rig = mixed: holds files of several kinds"),
        ("empty.zip", "data.rig = empty.zip: the zip file is empty"),
        ("cut.zip", "data.rig = cut.zip: the zip file is damaged or cut off"),
        ("runs", ""),
        ("'runs/R*.csv'", ""),
        ("runs.zip", ""),
    ],
)
def test_config_check_and_run_judge_recordings_alike(beltid: Any, named: str, told: str) -> None:
    for name in ("runs/R1.csv", "runs/R2.csv", "mixed/a.csv", "mixed/b.lvm"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text("no recording yet\n")
    Path("empty").mkdir()
    for name, members in (("empty.zip", ()), ("runs.zip", ("R1.csv", "R2.csv"))):
        with zipfile.ZipFile(name, "w") as archive:
            for member in members:
                archive.write(f"runs/{member}", member)
    Path("cut.zip").write_bytes(Path("runs.zip").read_bytes()[:-40])
    Path("c.yaml").write_text(f"belt: {{name: c}}\ndata:\n  rig: {named}\n")
    checked, planned = beltid("config", "check", "c.yaml"), beltid("run", "c.yaml", "--dry-run")
    for result in (checked, planned):
        assert bool(result.exit_code) == bool(told), result.stderr
        assert f"c.yaml:3:8: {told}" in result.stderr if told else True


def test_a_config_without_recordings_can_neither_be_run_nor_checked(beltid: Any) -> None:
    Path("c.yaml").write_text("belt: {name: c}\n")
    for call in (("config", "check"), ("run",)):
        result = beltid(*call, "c.yaml")
        assert result.exit_code == 2
        assert "data names no recording, must be at least one of press, rig" in result.stderr


@pytest.mark.parametrize(
    "call", [("config", "show", "--json"), ("config", "check", "c"), ("inspect", "c")]
)
def test_a_command_that_writes_no_file_says_so(beltid: Any, call: tuple[str, ...]) -> None:
    refused = beltid(*call, "-o", "product.txt")
    assert refused.exit_code == 2
    assert "--out = product.txt: this command writes no file" in refused.stderr
    assert refused.stdout == ""


def test_show_in_full_tells_what_every_artifact_was_made_from(bench: Path, beltid: Any) -> None:
    artifacts = sorted(bench.glob("*.parquet"))
    assert len(artifacts) >= 8
    for artifact in artifacts:
        result = beltid("show", "-v", artifact)
        assert result.exit_code == 0, (artifact.name, result.exception)
        assert "made from" in result.stdout


def test_show_tells_what_an_artifact_is(bench: Path, beltid: Any) -> None:
    product = json.loads(beltid("show", bench / "friction.parquet", "--json").stdout)
    facts = product["facts"]
    assert (facts["kind"], facts["rows"]) == ("friction", 16)
    assert len(product["table"]) == 16
    sha256 = hashlib.sha256((bench / "friction.parquet").read_bytes()).hexdigest()
    assert facts["file_sha256"] == sha256
    low, high = facts["valid normal_force_N_m"]
    forces = [row["normal_force_N_m"] for row in product["table"]]
    assert (low, high) == (min(forces), max(forces))
    (made_from,) = product["details"]["made from"]
    assert made_from["input"] == "rig"
    assert made_from["sha256"] == hashlib.sha256((bench / "rig.csv").read_bytes()).hexdigest()
    refused = beltid("show", bench / "rig.csv")
    assert refused.exit_code == 2
    assert "not an artifact" in refused.stderr


def test_show_tells_what_a_law_file_is(bench: Path, beltid: Any) -> None:
    assert beltid("export", "json", bench, "-o", "law").exit_code == 0
    (law,) = Path("law").glob("*.json")
    product = json.loads(beltid("show", law, "--json").stdout)
    assert product["facts"]["belt"] == "5PK"
    assert {row["made from"] for row in product["table"]} >= {"stiffness", "rig"}
    assert "--out" in beltid("show", law, "-o", "law.csv").stderr
