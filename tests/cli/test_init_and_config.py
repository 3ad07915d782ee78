"""A config for a new belt; the values that hold and where they come from; what a file is."""

import zipfile
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from beltid.config import load_config


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


PRESS = "test,time_s,displacement_mm,force_N,temperature_degC\n" + "".join(
    f"P1,{k / 10},{k / 100},{k},22\n" for k in range(30)
)


def rig_recording() -> str:
    lines = ["run,time_s,tension_tight_N,tension_slack_N,pulley_speed_rad_s,arc_deg,set_tension_N"]
    for run, (arc, tension, speed) in enumerate(product((35, 90.5), (120, 240), (0.0995, 0.4))):
        for k in range(20):
            noise = 0.002 * (k % 3 - 1)  # of the sensor: the highest samples are not the speed
            turning = speed * (1.001 if run % 2 else 0.999) * (k > 4) + noise
            lines.append(f"R{run},{0.1 * k:.1f},{tension},{tension},{turning:.5f},{arc},{tension}")
    return "\n".join(lines).replace("set_tension", "initial_tension") + "\n"


def test_init_writes_what_the_recordings_state(beltid: Any) -> None:
    Path("benches").mkdir()
    Path("benches/one.csv").write_text(PRESS)
    Path("benches/two.csv").write_text(rig_recording())
    made = beltid("init", "7pk", "benches/two.csv", "benches/one.csv", "-o", "configs/seven.yaml")
    assert made.exit_code == 0, made.stderr
    config = load_config("configs/seven.yaml")
    assert (config.belt.name, config.belt.type, config.belt.ribs) == ("7pk", "7PK", 7)
    assert config.data.files.keys() == {"press", "rig"}
    assert config.data.files["press"].samefile("benches/one.csv")
    assert config.data.files["rig"].samefile("benches/two.csv")
    assert config.rig.arcs_deg == (35.0, 90.5)
    assert config.rig.initial_tensions_N == (120.0, 240.0)
    assert config.rig.pulley_speeds_rad_s == pytest.approx((0.0995, 0.4), rel=2e-3)
    # what nobody stated stays a default: an assumed uncertainty must not turn into a stated one
    assert not config.uncertainty.model_fields_set
    assert config.belt.model_fields_set == {"name", "type", "ribs"}
    assert config.rig.model_fields_set == {
        *("arcs_deg", "initial_tensions_N", "pulley_speeds_rad_s")
    }
    lines = Path("configs/seven.yaml").read_text().splitlines()
    (arcs,) = [line for line in lines if line.strip().startswith("arcs_deg:")]
    assert arcs.endswith("from benches/two.csv")
    refused = beltid("init", "7pk", "-o", "configs/seven.yaml")
    assert refused.exit_code == 2
    assert "--force" in refused.stderr


def test_every_line_of_a_new_config_is_valid_once_its_sign_is_taken_away(beltid: Any) -> None:
    beltid("init", "new")
    Path("all.yaml").write_text(Path("new.yaml").read_text().replace("\n  # ", "\n  "))
    assert load_config("all.yaml").model_dump() == load_config("new.yaml").model_dump()
    assert len(load_config("all.yaml").uncertainty.model_fields_set) > 10


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("a/b",), ["belt.name"]),
        (("c", "none.csv", "words.txt"), ["none.csv", "words.txt"]),
        (("c", "press.csv", "press.csv"), ["press.csv", "data.press"]),
        ((), ["NAME"]),
        (("c", "-o", "press.csv", "--force"), ["press.csv"]),
    ],
)
def test_init_tells_all_that_is_wrong_and_writes_nothing(
    beltid: Any, arguments: tuple[str, ...], named: list[str]
) -> None:
    Path("press.csv").write_text(PRESS)
    Path("words.txt").write_text("the quick brown fox\n" * 20)
    refused = beltid("init", *arguments)
    assert refused.exit_code == 2
    assert all(word in refused.stderr for word in named), refused.stderr
    assert not list(Path().glob("*.yaml"))


@pytest.mark.parametrize("options", [(), ("--all",)])
def test_config_show_prints_yaml_that_is_the_same_config(
    beltid: Any, options: tuple[str, ...]
) -> None:
    Path("beltid.yaml").write_text("belt: {name: mine, ribs: 6}\nrig:\n  arcs_deg: [30]\n")
    shown = beltid("config", "show", "rig.csv", *options)
    assert "config: beltid.yaml (found for rig.csv)" in shown.stderr.replace(f"{Path.cwd()}/", "")
    Path("again.yaml").write_text(shown.stdout)
    assert load_config("again.yaml") == load_config("beltid.yaml")
    refused = beltid("config", "show", "-o", "out.yaml")
    assert refused.exit_code == 2
    assert "--out = out.yaml: this command writes no file" in refused.stderr


@pytest.mark.parametrize(
    ("named", "refused"),
    [
        ("gone.csv", True),
        ("'gone*.csv'", True),
        ("empty", True),
        ("mixed", True),
        ("empty.zip", True),
        ("cut.zip", True),
        ("runs", False),
        ("'runs/R*.csv'", False),
        ("runs.zip", False),
    ],
)
def test_config_check_and_run_judge_recordings_alike(
    beltid: Any, named: str, refused: bool
) -> None:
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
        assert result.exit_code == 2 * refused, result.stderr
        assert (f"c.yaml:3:8: data.rig = {named.strip(chr(39))}" in result.stderr) is refused
