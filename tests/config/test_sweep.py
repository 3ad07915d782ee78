"""Sweeps: the cases that a config makes, their names, and what is wrong with it at its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltid.config import Config, load_cases, load_config
from beltid.config.sweep import MOST_CASES, case_name, sweep_keys
from beltid.errors import ConfigError


def written(folder: Path, text: str) -> Path:
    path = folder / "belt.yaml"
    path.write_text(text)
    return path


def problems(folder: Path, text: str) -> list[str]:
    path = written(folder, text)
    with pytest.raises(ConfigError) as caught:
        load_cases(path)
    return [line.removeprefix(f"{path}:") for line in caught.value.problems]


def test_all_combinations_in_the_order_of_the_lists(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        "belt: {ribs: 6, bending_stiffness_N_m2: 0.3}\n"
        "sweep:\n"
        "  belt.bending_stiffness_N_m2: [0.01, 2.0e-2]\n"
        "  rig.supports: [pinned, clamped]\n",
    )
    cases = load_cases(path)
    assert [name for name, _, _ in cases] == [
        "bending_stiffness_N_m2-0.01_supports-pinned",
        "bending_stiffness_N_m2-0.01_supports-clamped",
        "bending_stiffness_N_m2-0.02_supports-pinned",
        "bending_stiffness_N_m2-0.02_supports-clamped",
    ]
    for _, values, config in cases:
        assert config.belt.bending_stiffness_N_m2 == values["belt.bending_stiffness_N_m2"]
        assert config.rig.supports == values["rig.supports"]
        assert config.belt.ribs == 6
    plain = load_config({"belt": {"ribs": 6, "bending_stiffness_N_m2": 0.02}})
    assert cases[2][2].sha256 == plain.sha256


def test_keys_of_one_name_in_two_sections_are_distinguished(tmp_path: Path) -> None:
    path = written(tmp_path, "sweep: {simulation.method: [steady], drive.method: [string, rod]}\n")
    assert [
        (name, config.simulation.method, config.drive.method)
        for name, _, config in (load_cases(path))
    ] == [
        ("simulation.method-steady_drive.method-string", "steady", "string"),
        ("simulation.method-steady_drive.method-rod", "steady", "rod"),
    ]


def test_without_a_sweep_there_is_one_case_without_a_name(tmp_path: Path) -> None:
    path = written(tmp_path, "belt: {ribs: 6}\n")
    ((name, values, config),) = load_cases(path)
    assert (name, values, config) == ("", {}, load_config(path))


def test_a_single_stage_works_on_the_config_without_its_sweep(tmp_path: Path) -> None:
    text = "belt: {bending_stiffness_N_m2: 0.3}\n"
    swept = written(tmp_path, text + "sweep: {belt.bending_stiffness_N_m2: [0.01]}\n")
    assert load_config(swept) == load_config({"belt": {"bending_stiffness_N_m2": 0.3}})


def test_what_is_wrong_is_reported_at_its_place_in_the_sweep(tmp_path: Path) -> None:
    found = problems(
        tmp_path,
        "sweep:\n"
        "  rig.pulley_radius_m: [0.05, 9, wide]\n"
        "  rig.pulley_radus_m: [0.05]\n"
        "  data.rig: [a.csv, b.csv]\n"
        "  belt.stiff: [1, 2]\n"
        "  belt.ribs: 5\n"
        "  press.cycles: []\n"
        "  contact.points_per_element: [5, 6, 5]\n",
    )
    assert found == [
        "2:31: rig.pulley_radius_m = 9, must be in [0.002, 5] m",
        "2:34: rig.pulley_radius_m = wide, must be a number in [0.002, 5] m",
        "3:3: sweep.rig.pulley_radus_m is not a key that can be swept, "
        "did you mean pulley_radius_m?",
        "4:3: sweep.data.rig is not a key that can be swept, such as belt.ribs can",
        "5:3: sweep.belt.stiff is not a key that can be swept, belt has ribs, width_m, "
        "axial_stiffness_N, bending_stiffness_N_m2, mass_per_length_kg_m, damping_time_s, "
        "shear_stiffness_N_m2",
        "6:14: sweep.belt.ribs = 5, must be a list of values",
        "7:17: sweep.press.cycles = [], must be a list of values",
        "8:38: sweep.contact.points_per_element[2] = 5 is given twice",
    ]


def test_what_is_wrong_in_every_case_is_counted_once(tmp_path: Path) -> None:
    unknown = "".join(f"k{i}: 1\n" for i in range(60))
    found = problems(tmp_path, f"sweep: {{belt.ribs: [5, 6]}}\n{unknown}")
    assert len(found) == 41
    assert found[-1] == "and 20 more"


def test_lists_are_swept_as_a_whole(tmp_path: Path) -> None:
    path = written(tmp_path, "sweep: {rig.arcs_deg: [[40, 68], [82]]}\n")
    assert [config.rig.arcs_deg for _, _, config in load_cases(path)] == [(40.0, 68.0), (82.0,)]
    assert problems(tmp_path, "sweep: {rig.arcs_deg: [[40, 400]]}\n") == [
        "1:29: rig.arcs_deg[1] = 400, must be in (0, 360)"
    ]


@pytest.mark.parametrize("text", ["sweep: 3\n", "sweep: [1, 2]\n"])
def test_a_sweep_is_a_section(tmp_path: Path, text: str) -> None:
    assert problems(tmp_path, text) == ["1:8: sweep must be a section of keys with lists of values"]


def test_more_cases_than_anybody_means_are_refused(tmp_path: Path) -> None:
    values = ", ".join(str(k) for k in range(1, 60))
    text = f"sweep:\n  press.segment_length_cm: [{values}]\n  rig.pulley_radius_m: [{values}]\n"
    assert problems(tmp_path, text) == [
        f"2:3: sweep makes 3,481 cases, must be at most {MOST_CASES:,}"
    ]


def test_every_swept_key_is_one_of_the_config() -> None:
    keys = sweep_keys()
    values = Config().model_dump()
    assert "belt.bending_stiffness_N_m2" in keys
    for key in keys:
        section, _, name = key.partition(".")
        assert name in values[section]
    for refused in ("belt.name", "data.rig", "dialect.separator", "sweep"):
        assert refused not in keys


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"a_m": 1.0}, "a_m-1"),
        ({"a_m": 1e-5}, "a_m-1e-05"),
        ({"on": True, "off": None}, "on-true_off-null"),
    ],
)
def test_names_of_cases_are_their_values(values: dict[str, object], name: str) -> None:
    assert case_name(values) == name


@pytest.mark.parametrize("value", ["../../etc", "a/b", "a" * 80, [40.0, 82.0], "", "a\nb"])
def test_what_cannot_name_a_folder_is_named_by_its_hash(value: object) -> None:
    name = case_name({"key": value})
    assert name.startswith("case-") or value == ""
    assert "/" not in name
    assert name == case_name({"key": value}) != case_name({"key": "other"})
