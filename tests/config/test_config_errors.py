"""Everything wrong with a config is told with its place, in the user's words, all at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltid.config import Config, load_config
from beltid.errors import EXIT_INPUT, ConfigError


def problems(tmp_path: Path, text: str | bytes) -> list[str]:
    path = tmp_path / "5pk.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert caught.value.exit_status == EXIT_INPUT
    prefix = f"{tmp_path}/"
    return [p.removeprefix(prefix) for p in caught.value.problems]


def test_all_problems_at_once_in_the_order_of_the_file(tmp_path):
    text = """\
belt: {name: ../5pk, ribs: 5.5}
press:
  segment_length_cm: -4
  cycles: middle
contact: 7
rig:
  arcs_deg: [40, 40, 400]
  pulley_radius_m: 50 mm
  span_lenght_m: 0.1
"""
    found = problems(tmp_path, text)
    places = [tuple(int(n) for n in p.split(":")[1:3]) for p in found]
    assert places == [
        (1, 14),
        (1, 28),
        (3, 22),
        (4, 11),
        (5, 10),
        (7, 18),
        (7, 22),
        (8, 20),
        (9, 3),
    ]
    assert "belt.name" in found[0]
    assert found[1].endswith("belt.ribs = 5.5, must be a whole number in [1, 100]")
    assert found[2].endswith("press.segment_length_cm = -4, must be in [0.1, 100] cm")
    assert found[3].endswith("press.cycles = middle, must be last, first or all")
    assert "contact = 7, must be a section with the keys damping_N_s_m" in found[4]
    assert found[5].endswith("rig.arcs_deg[1] = 40, must be given once only")
    assert found[6].endswith("rig.arcs_deg[2] = 400, must be in (0, 360)")
    assert found[7].endswith("(the number alone; its unit is in the key)")
    assert found[8].endswith("rig.span_lenght_m is not a known key, did you mean span_length_m?")


def test_lists_in_step_and_coordinates_may_repeat_a_number():
    """A drive is asked for several torques at one speed; a pivot may stand on a diagonal."""
    arm = {"pulley": "t", "arm_m": 0.1, "free_angle_deg": 0, "preload_N_m": 1, "rate_N_m_deg": 1}
    points = {"driver_speed_rad_s": [22, 22, 62.8], "torque_N_m": {"driven": [4, 8, 4]}}
    drive = {"operating_points": points, "tensioner": {**arm, "pivot_m": [0.1, 0.1]}}
    config = load_config({"drive": drive})
    assert config.drive.operating_points.driver_speed_rad_s == (22.0, 22.0, 62.8)
    assert config.drive.tensioner.pivot_m == (0.1, 0.1)


def test_a_key_that_is_missing_has_the_place_of_its_section(tmp_path):
    found = problems(tmp_path, "belt: {ribs: 0}\nbelt: 3\ndrive:\n  pulleys: [{name: a}]\n")
    assert found == [
        "5pk.yaml:1:14: belt.ribs = 0, must be in [1, 100]",
        "5pk.yaml:2:1: belt is given twice, first in line 1",
        *(
            f"5pk.yaml:4:13: drive.pulleys[0].{key} is missing"
            for key in ("x_m", "y_m", "radius_m")
        ),
    ]


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("belt: {ribs: 5}\nbelt: {ribs: 6}\n", "2:1", "belt is given twice, first in line 1"),
        ("belt:\n  ribs: 5\n  ribs: 5\n", "3:3", "belt.ribs is given twice, first in line 2"),
        ("rig:\n  # three\n  arcs_deg:\n    - 400\n", "4:7", "rig.arcs_deg[0] = 400, must be in"),
        ("belt: &a {ribs: *a}\n", "1:7", "contains itself"),
        ("belt: {<<: {ribs: 5}}\n", "1:8", "merge keys"),
        ("belt: !!python/object/apply:os.system [ls]\n", "1:7", "tag"),
        ("- belt\n", "1:1", "found a list"),
        ("belt\n", "1:1", "found a single value"),
        ("a: 1\n---\nb: 2\n", "2:1", "second document"),
        ("belt:\n\tribs: 5\n", "2:1", "tab"),
        ("belt:\n\u00a0\u00a0ribs: 5\n", "2:1", "blanks that YAML does not count as such"),
        ("belt: {ribs: 5\n", "2:1", "not valid YAML"),
        ("belt: {ribs: ~}\n", "1:14", "belt.ribs = ~, must be a whole number"),
        ("belt: {name: 5}\n", "1:14", "put it in quotes"),
        ("belt: {ribs: '5'}\n", "1:14", 'belt.ribs = "5"'),
        ("belt: {ribs: true}\n", "1:14", "whole number"),
        ("belt: {ribs: " + "9" * 9999 + "}\n", "1:14", "belt.ribs"),
        ("belt: {axial_stiffness_N: .inf}\n", "1:27", "must be in [100, 1e+08] N"),
        ("belt: {axial_stiffness_N: .nan}\n", "1:27", "must be in [100, 1e+08] N"),
        ("belt: {axial_stiffness_N: 1e999}\n", "1:27", "must be in [100, 1e+08] N"),
        ("rig:\n  span_length_m: 0,1\n", "2:18", "the decimal sign is a point: 0.1"),
        ("press: {segment_length_cm: 4,5}\n", "1:30", "the decimal sign is a point"),
        ("press: {segment_length_cm: 0}\n", "1:28", "must be in [0.1, 100] cm"),
        ("press: {segment_length_cm: 1e-300}\n", "1:28", "must be in [0.1, 100] cm"),
        ("rig: {arcs_deg: [0]}\n", "1:18", "must be in (0, 360)"),
        ("rig: {arcs_deg: [360]}\n", "1:18", "must be in (0, 360)"),
        ("rig: {arcs_deg: []}\n", "1:17", "a list of 1 to 200 contact arcs, it has 0"),
        ("rig: {kind: webbing}\n", "1:13", "two_cells, dead_weight, torque, torque_hub or running"),
        ("conditions: {surface: oily}\n", "1:23", "must be dry, wet or dusty"),
        ("conditions: {humidity_percent: 45}\n", "1:14", "is not a known key"),
        ("rig: {arcs_deg: 40}\n", "1:17", "a list of contact arcs, such as [40, 68, 82]"),
        ("tension_tight_gain: 5\n", "1:1", "did you mean friction.tension_tight_gain?"),
        ("units: {rig: {tension_tight_N: kPa}}\n", "1:32", "one of N, mN, daN, kN, lbf, kgf"),
        ("units: {rig: {run: s}}\n", "1:15", "units.rig.run is not a known key"),
        ("columns: {rig: {tension_tight: F1}}\n", "1:17", "did you mean tension_tight_N?"),
        ("dialect: {encoding: klingon}\n", "1:21", "the name of an encoding"),
        ("dialect: {encoding: base64}\n", "1:21", "the name of an encoding"),
        ("dialect: {separator: ab}\n", "1:22", "one character"),
        ("data: {rig: 7}\n", "1:13", "the path of a file"),
    ],
)
def test_one_problem_with_its_place_and_words(tmp_path, text, place, words):
    found = problems(tmp_path, text)
    assert found[0].startswith(f"5pk.yaml:{place}: ")
    assert words in found[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"", "the config is empty"),
        (b"# only a comment\n", "the config is empty"),
        (b"\0\0\0", "not valid YAML"),
        (b'belt: "\\U99999999"', "not valid YAML"),
        (b"belt: {type: \xe9}", ":1: byte 0xE9 is not UTF-8"),
        (b"\xef\xbb\xbfbelt: {type: \xb5}", ":1: byte 0xB5 is not UTF-8"),
        (b"#" * 1_000_001, "larger than"),
        (b"[" * 100_000, "nested deeper than"),
        (b"".join(b" " * i + b"a:\n" for i in range(400)), "nested deeper than"),
        (b"a: [" + b"1," * 21_000 + b"1]", "too many values"),
    ],
)
def test_what_is_no_config_at_all(tmp_path, text, words):
    (found,) = problems(tmp_path, text)
    assert words in found


def test_aliases_cannot_multiply(tmp_path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    (found,) = problems(tmp_path, "\n".join(lines))
    assert "too many values" in found


def test_thousands_of_problems_are_counted(tmp_path):
    found = problems(tmp_path, "".join(f"k{i}: 1\n" for i in range(500)))
    assert len(found) == 41
    assert found[-1] == "and 460 more"


@pytest.mark.parametrize("make", ["missing", "folder"])
def test_a_config_that_is_not_there(tmp_path, make):
    path = tmp_path / "x.yaml"
    if make == "folder":
        path.mkdir()
    with pytest.raises(ConfigError, match=r"x\.yaml: (there is no such config|is a folder)"):
        load_config(path)


def test_a_dict_has_key_paths_but_no_places():
    with pytest.raises(ConfigError) as caught:
        load_config({"rig": {"arcs_deg": [40, 400]}, "belt": {"name": "a/b"}, 5: 3})
    found = caught.value.problems
    assert "rig.arcs_deg[1] = 400, must be in (0, 360)" in found
    assert any(p.startswith('belt.name = "a/b", must be 1 to 40') for p in found)
    assert any(p.startswith("5 is not a known key") for p in found)


@pytest.mark.parametrize("source", [5, ["configs/5pk.yaml"], object()])
def test_what_cannot_be_a_config(source):
    with pytest.raises(ConfigError, match="must be the path of a YAML file or a dict"):
        load_config(source)


@pytest.mark.parametrize(
    "name",
    [
        "..",
        ".hidden",
        "a/b",
        "a\\b",
        "",
        "a" * 65,
        "a b",
        "-rf",
        "con\n",
        "ä",
        "=1+1",
        "<b>",
        "[red]a",
    ],
)
def test_the_name_cannot_leave_its_folder(name):
    with pytest.raises(ConfigError, match=r"belt\.name"):
        load_config({"belt": {"name": name}})


def test_no_word_of_the_library_reaches_the_user():
    for section, field in Config.model_fields.items():
        for value in (3, "x", [1], {"a": 1}):
            for key in field.annotation.model_fields:
                try:
                    load_config({section: {key: value}})
                except ConfigError as error:
                    text = str(error)
                    assert not any(
                        word in text
                        for word in ("Input should", "pydantic", "http", "another value")
                    )
