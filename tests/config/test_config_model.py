"""What a config means: numbers of YAML 1.2, defaults, hashes, the values for the science."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from beltid.config import config_text, load_config
from beltid.errors import ConfigError
from beltid.tables import schemas

ROOT = Path(__file__).parents[2]


def test_the_built_in_rig_is_that_of_the_paper():
    config = load_config()
    belt, rig, contact = config.belt_params(), config.rig_params(), config.contact_params()
    assert (belt.EA, belt.EI, belt.rhoA, belt.damping_time) == (1e5, 0.02, 0.10, 1e-4)
    assert (rig.R, rig.span, rig.supports) == (0.05, 0.10, "pinned")
    assert (contact.C_P, contact.points_per_element, contact.sticking_ratio) == (300.0, 5, 1.0)
    assert config.rig.arcs_deg == (40, 68, 82)
    assert len(config.rig.initial_tensions_N) * len(config.rig.pulley_speeds_rad_s) * 3 == 120


@pytest.mark.parametrize("belt", ["4pk", "5pk", "6pk"])
def test_the_shipped_configs_state_the_recorded_runs(belt):
    config = load_config(ROOT / "configs" / f"{belt}.yaml")
    assert config.belt.name == belt
    lines = (ROOT / "rigdata" / belt / "rig.csv").read_text().split()
    cells = [line.split(",") for line in lines[1:]]
    assert {float(c[6]) for c in cells} == set(config.rig.arcs_deg)
    assert {float(c[7]) for c in cells} == set(config.rig.initial_tensions_N)
    for path in (config.data.press, config.data.rig, config.data.speedloss):
        assert path is not None
        assert path.is_file()


def test_the_shipped_5pk_config_is_the_built_in_one():
    # but for the drive, which is predicted with the bending stiffness of the belt
    built_in = load_config({"drive": {"method": "rod"}})
    assert load_config(ROOT / "configs/5pk.yaml").sha256 == built_in.sha256


@pytest.mark.parametrize(
    ("text", "value"),
    [("3025.6e1", 30256.0), ("1e5", 1e5), ("0.8e5", 8e4), ("+2E+3", 2e3), ("9000", 9000.0)],
)
def test_numbers_are_those_of_yaml_1_2(tmp_path, text, value):
    path = tmp_path / "c.yaml"
    path.write_text(f"belt: {{axial_stiffness_N: {text}}}\n")
    assert load_config(path).belt.axial_stiffness_N == value


def test_an_empty_section_means_its_defaults(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("belt: {ribs: 4}\ncompare:\n  # max_relative_error: 0.3\n")
    assert load_config(path).compare == load_config().compare


def test_bom_and_windows_line_ends_are_no_matter(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_bytes(b"\xef\xbb\xbfbelt:\r\n  ribs: 4\r\n")
    assert load_config(path).belt.ribs == 4


def test_numpy_values_are_welcome():
    rig = {"arcs_deg": np.array([40, 68]), "pulley_radius_m": np.float32(0.5)}
    config = load_config({"rig": rig, "belt": {"ribs": np.int64(4)}})
    assert config.rig.arcs_deg == (40.0, 68.0)
    assert config.rig.pulley_radius_m == 0.5
    assert config.belt.ribs == 4


def test_a_config_cannot_be_changed():
    config = load_config()
    with pytest.raises(ValidationError):
        config.belt.ribs = 7  # type: ignore[misc]


def test_paths_count_from_the_folder_of_the_config(tmp_path, monkeypatch):
    (tmp_path / "configs").mkdir()
    path = tmp_path / "configs" / "c.yaml"
    path.write_text(
        f"data: {{rig: ../data/rig.csv, press: {tmp_path}/p.csv, speedloss: ~/s.csv}}\n"
    )
    monkeypatch.setenv("HOME", "/home/of/somebody")
    data = load_config(path).data
    assert data.rig == tmp_path / "data" / "rig.csv"
    assert data.press == tmp_path / "p.csv"
    assert data.speedloss == Path("/home/of/somebody/s.csv")


def test_the_hash_follows_the_values_not_the_writing(tmp_path):
    one, two = tmp_path / "one.yaml", tmp_path / "two.yaml"
    one.write_text("belt: {ribs: 6, axial_stiffness_N: 1.2e5}\nrig: {arcs_deg: [40, 68]}\n")
    two.write_text(
        "# other words\nrig:\n  arcs_deg: [40.0, 68]\nbelt: {axial_stiffness_N: 120000, ribs: 6}\n"
        "data: {rig: elsewhere.csv}\n"
    )
    assert load_config(one).sha256 == load_config(two).sha256
    assert load_config(one).sha256 != load_config().sha256


def test_the_hash_of_sections_sees_those_sections_only():
    base = load_config()
    other = load_config({"compare": {"max_relative_error": 0.5}})
    assert other.sha256 != base.sha256
    assert other.section_sha256("belt", "rig") == base.section_sha256("rig", "belt")
    assert other.section_sha256("compare") != base.section_sha256("compare")
    with pytest.raises(KeyError):
        base.section_sha256("belts")


def test_every_value_that_changes_a_result_changes_the_hash():
    base = load_config()
    seen = {base.sha256}
    changes: list[dict[str, dict[str, object]]] = [
        {"press": {"cycles": "first"}},
        {"friction": {"tension_tight_gain": 1.1}},
        {"simulation": {"method": "steady"}},
        {"units": {"rig": {"time_s": "ms"}}},
        {"columns": {"rig": {"time_s": "t"}}},
        {"dialect": {"decimal": ","}},
        {"contact": {"damping_N_s_m": 0}},
    ]
    seen.update(load_config(change).sha256 for change in changes)
    assert len(seen) == len(changes) + 1


@pytest.mark.parametrize("kind", schemas.RECORDINGS)
def test_every_number_of_a_recording_may_come_in_the_unit_of_its_table(kind):
    for column in schemas.table(kind).columns:
        if column.dtype == "float64":
            stated = load_config({"units": {kind: {column.name: column.unit}}})
            assert stated.units.of(kind) == {column.name: column.unit}


def test_settings_of_all_runs_have_the_range_of_their_column():
    values = {"arc_deg": 359.9, "initial_tension_N": 1e-3, "temperature_degC": -90}
    assert load_config({"runs": {"rig": {"values": values}}}).runs.rig.values.arc_deg == 359.9
    for name, value, allowed in (
        ("arc_deg", 3601, r"in \(0, 3600\] °"),
        ("initial_tension_N", 0, "> 0 N"),
        ("temperature_degC", 200.1, r"in \[-90, 200\] °C"),
    ):
        wrong = rf"^runs\.rig\.values\.{name} = {value}, must be {allowed}$"
        with pytest.raises(ConfigError, match=wrong):
            load_config({"runs": {"rig": {"values": {name: value}}}})


names = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Zl", "Zp"]), min_size=1)


@settings(max_examples=20, deadline=None)
@given(
    name=names.filter(lambda s: s.isprintable() and len(s) < 200),
    stiffness=st.floats(1e2, 1e8),
    damping=st.floats(0, 1),
    arcs=st.lists(st.floats(1e-3, 359.9), min_size=1, max_size=5, unique=True),
)
def test_a_config_written_out_loads_back(tmp_path_factory, name, stiffness, damping, arcs):
    config = load_config(
        {
            "belt": {"axial_stiffness_N": stiffness, "damping_time_s": damping},
            "rig": {"arcs_deg": arcs},
            "columns": {"press": {"force_N": name}},
            "units": {"rig": {"pulley_speed_rad_s": "1/min"}},
            "dialect": {"separator": "tab", "decimal": ","},
        }
    )
    path = tmp_path_factory.mktemp("c") / "c.yaml"
    path.write_text(config_text(config), encoding="utf-8")
    assert load_config(path) == config


def test_importing_the_config_does_not_import_the_heavy_libraries():
    heavy = ("pandas", "pyarrow", "scipy", "numba")
    code = f"import sys, beltid.config; print([m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_small_numbers_are_written_so_that_every_yaml_reader_takes_them_as_numbers():
    assert "damping_time_s: 1.0e-05 " in config_text(
        load_config({"belt": {"damping_time_s": 1e-5}})
    )


def test_a_config_comes_back_from_a_worker_as_it_was() -> None:
    stated = {
        "columns": {"rig": {"arc_deg": "wrap"}, "points": {"temperature_degC": "t"}},
        "units": {"speedloss": {"torque_N_m": "N mm"}},
        "runs": {"rig": {"pattern": "{run}.csv", "values": {"arc_deg": 82}}},
    }
    config = load_config(stated)
    again = pickle.loads(pickle.dumps(config))
    assert again == config
    assert again.columns.of("rig") == {"arc_deg": "wrap"}
    assert again.sha256 == config.sha256
