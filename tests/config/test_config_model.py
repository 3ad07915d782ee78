"""What a config means: numbers of YAML 1.2, defaults, SI values, hash, text; whose it is."""

import math
from pathlib import Path

import pandas as pd
import pytest
from pydantic import ValidationError

from beltid.config import config_text, find_config, load_config
from beltid.config.model import TensionerSection
from beltid.errors import ConfigError
from beltid.identify.press.recording import StiffnessSettings

ROOT = Path(__file__).parents[2]


def test_the_built_in_rig_is_that_of_the_paper():
    config = load_config()
    belt, rig, contact = config.belt_params(), config.rig_params(), config.contact_params()
    assert (belt.EA, belt.EI, belt.rhoA, belt.damping_time) == (1e5, 0.02, 0.10, 1e-4)
    assert (rig.R, rig.span, rig.supports) == (0.05, 0.10, "pinned")
    assert (contact.C_P, contact.points_per_element, contact.sticking_ratio) == (300.0, 9, 1.0)
    settings = config.rig
    assert settings.arcs_deg == (40, 68, 82)
    assert len(settings.initial_tensions_N) * len(settings.pulley_speeds_rad_s) * 3 == 120
    with pytest.raises(ValidationError):
        config.belt.ribs = 7  # type: ignore[misc]


@pytest.mark.parametrize("belt", ["4pk", "5pk", "6pk"])
def test_the_shipped_configs_state_the_recorded_runs(belt):
    config = load_config(ROOT / "configs" / f"{belt}.yaml")
    assert config.belt.name == belt
    rig = pd.read_csv(config.data.rig, usecols=["arc_deg", "initial_tension_N"])
    assert set(rig["arc_deg"]) == set(config.rig.arcs_deg)
    assert set(rig["initial_tension_N"]) == set(config.rig.initial_tensions_N)
    assert len([path for path in config.data.files.values() if path.is_file()]) == 3
    assert belt != "5pk" or config.sha256 == load_config().sha256


def test_values_in_si_units_have_its_suffix():
    config = load_config({"press": {"segment_length_cm": 4.1, "machine_compliance_mm_N": 2e-6}})
    assert config.press.si() == {
        "segment_length_m": 4.1 / 100,
        "reference_temperature_degC": 22.0,
        "machine_compliance_m_N": 2e-6 / 1000,
        "cycles": "last",
    }
    assert StiffnessSettings(**config.press.si()).segment_length_m == 4.1 / 100
    assert config.rig.si()["arcs_rad"] == tuple(map(math.radians, config.rig.arcs_deg))
    assert config.plan.si()["arcs_rad"] is None
    arm = {"arm_m": 1, "free_angle_deg": 180, "preload_N_m": 2, "rate_N_m_deg": math.pi / 180}
    tensioner = TensionerSection(pulley="a", pivot_m=(0.1, 0.1), **arm).si()
    assert tensioner["free_angle_rad"] == pytest.approx(math.pi)
    assert tensioner["rate_N_m_rad"] == pytest.approx(1.0)
    points = {"driver_speed_rad_s": [22, 22], "torque_N_m": {"driven": [4, 4], "x": 1}}
    found = load_config({"drive": {"operating_points": points}}).drive.operating_points
    assert found.si()["torque_N_m"] == {"driven": (4.0, 4.0), "x": (1.0,)}  # may repeat a number


def test_the_hash_follows_the_values_not_the_writing(tmp_path):
    one, two = tmp_path / "one.yaml", tmp_path / "two.yaml"
    one.write_text("belt: {ribs: 6, axial_stiffness_N: 1.2e5}\nruns: {rig: {table: r.csv}}\n")
    two.write_text(
        "# other words\nruns: {rig: {table: elsewhere/r.csv}}\n"
        "belt: {axial_stiffness_N: 120000, ribs: 6}\ndata: {rig: elsewhere.csv}\n"
    )
    assert load_config(one).sha256 == load_config(two).sha256
    changes = [
        {"press": {"cycles": "first"}},
        {"simulation": {"method": "steady"}},
        {"units": {"rig": {"time_s": "ms"}}},
        {"columns": {"rig": {"time_s": "t"}}},
        {"runs": {"rig": {"values": {"arc_deg": 82}}}},
        {"dialect": {"decimal": ","}},
        {"contact": {"damping_N_s_m": 0}},
    ]
    assert len({load_config(change).sha256 for change in [{}, *changes]}) == len(changes) + 1


@pytest.mark.parametrize("name", ["Reibwert", "null", "1e5", "a: b", "µ 'x' \"y\" \\", "#", " {}"])
@pytest.mark.parametrize("number", [1e2, 1 / 3 * 1e5, 1e8])
def test_a_config_written_out_loads_back(tmp_path, name, number):
    config = load_config(
        {
            "belt": {"axial_stiffness_N": number, "damping_time_s": 1e-7 * number**0.5},
            "rig": {"arcs_deg": [1e-3, 180 / number, 359.9]},
            "dialect": {"separator": "tab", "decimal": ","},
            "columns": {"rig": {"mu": name, "time_s": None}},
            "units": {"press": {"force_N": {"factor": 250}, "time_s": "ms"}},
            "runs": {"rig": {"pattern": "{run}.csv", "values": {"arc_deg": 82}}},
        }
    )
    for complete in (True, False):
        (tmp_path / "c.yaml").write_text(config_text(config, complete=complete), encoding="utf-8")
        assert load_config(tmp_path / "c.yaml") == config


def test_every_key_is_written_with_a_meaning_and_a_number_of_any_yaml():
    text = config_text(load_config({"belt": {"damping_time_s": 1e-5}}))
    assert "damping_time_s: 1.0e-05 " in text
    keys = [line for line in text.splitlines() if line.startswith("  ")]
    assert len(keys) > 80
    assert not [line for line in keys if " # " not in line]


def ribs(path: Path, number: int) -> Path:
    path.write_text(f"belt: {{ribs: {number}}}\n")
    return path


def test_what_is_no_config_and_whose_name_it_may_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BELTID_CONFIG", "")  # counts as unset
    recording = tmp_path / "rig.v2.csv.gz"
    (tmp_path / "beltid.yaml").mkdir()  # a folder of that name is no config
    assert find_config().path is find_config(recording).path is None
    path = ribs(tmp_path / "rig.v2.yaml", 11)
    for found in (find_config(recording), find_config(recording.name)):
        assert (found.config.belt.ribs, found.path) == (11, path)


def test_the_config_that_the_environment_names_is_taken_before_one_beside_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ribs(tmp_path / "beltid.yaml", 11)
    missing = tmp_path / "missing.yaml"
    monkeypatch.setenv("BELTID_CONFIG", str(missing))
    for explicit in (missing, None):
        with pytest.raises(ConfigError, match="missing"):
            find_config(tmp_path / "rig.csv", explicit)
