"""Everything wrong with a config is told with its place, what was found and what is allowed."""

from pathlib import Path

import pytest

from beltid.config import Config, load_config
from beltid.config.checks import ListOf, Number, Section, check_of
from beltid.errors import EXIT_INPUT, ConfigError

SEVERAL = """\
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

# text, then a tuple for each problem: place, and what must be named; more in the golden corpus
WRONG = [
    (
        SEVERAL,
        ("1:14", "belt.name", "../5pk"),
        ("1:28", "belt.ribs = 5.5", "whole", "[1, 100]"),
        ("3:22", "press.segment_length_cm = -4", "[0.1, 100] cm"),
        ("4:11", "press.cycles", "middle", "last, first or all"),
        ("5:10", "contact = 7", "section", "damping_N_s_m"),
        ("7:18", "rig.arcs_deg[1] = 40", "once"),
        ("7:22", "rig.arcs_deg[2] = 400", "(0, 360)"),
        ("8:20", "rig.pulley_radius_m", "50 mm", "unit, in [0.002, 5] m"),
        ("9:3", "rig.span_lenght_m", "did you mean span_length_m?"),
    ),
    (
        "belt: {ribs: 0}\ndrive:\n  pulleys: [{name: a}]\n",
        ("1:14", "belt.ribs = 0"),
        *(("3:13", f"drive.pulleys[0].{key}", "missing") for key in ("x_m", "y_m", "radius_m")),
    ),
    ("rig:\n  # three\n  arcs_deg:\n    - 400\n", ("4:7", "rig.arcs_deg[0] = 400")),
    ("belt: !!python/object/apply:os.system [ls]\n", ("1:7", "os.system")),
    ("belt: &a {ribs: *a}\n", ("1:7", "belt.ribs", "whole number")),
    ("a: 1\n---\nb: 2\n", ("2:1", "another document")),
    ("belt: ribs: 5\n", ("1:11", "':'")),
    ("belt: {ribs: 5\n", ("2:1", "not valid YAML")),
    ("belt: {ribs: '5'}\n", ("1:14", 'belt.ribs = "5"', "whole number in [1, 100]")),
    ("belt: {axial_stiffness_N: " + "9" * 400 + "}\n", ("1:27", "[100, 1e+08] N")),
    ("belt: {ribs: " + "9" * 9999 + "}\n", ("", "5pk.yaml")),
    ("rig: {kind: torque}\n", ("1:7", "rig.kind is not a known key")),
    ("tension_tight_gain: 5\n", ("1:1", "friction.tension_tight_gain")),
    ("units: {rig: {time_s: {factor: x}}}\n", ("1:32", "units.rig.time_s.factor", "number")),
    ("columns: {rig: 7}\n", ("1:16", "columns.rig = 7", "section", "tension_tight_N")),
    ("runs: {rig: {pattern: '(?P<run>.+)'}}\n", ("1:23", "{run}")),
    ("runs: {rig: {pattern: '{run}_{run}'}}\n", ("1:23", "{run}", "each once")),
    ("belt: {ribs: 5, type: X, ribs: 6}\n", ("1:26", 'duplicate key "ribs"')),
    ("runs: {rig: {values: {arc_deg: 3601}}}\n", ("1:32", "3601", "in (0, 3600] °")),
    ("runs: {rig: {values: {side: left}}}\n", ("1:29", "rib or back")),
    ("runs: {rig: {patern: x}}\n", ("1:14", "did you mean pattern?")),
    ("dialect: {encoding: klingon}\n", ("1:21", "encoding")),
    ("drive: {operating_points: {power_W: {a: [1, x]}}}\n", ("1:45", "power_W.a[1]", "number")),
    (b"# only a comment\n", ("", "empty")),
    (b"\0\0\0", ("", "not valid YAML")),
    (b"belt: {type: \xe9}", ("1", "0xE9", "UTF-8")),
    (b"\xef\xbb\xbfbelt: {type: \xb5}", ("1", "0xB5", "UTF-8")),
    (b"#" * 1_000_001, ("", "larger")),
]


@pytest.mark.parametrize("case", WRONG, ids=lambda case: repr(case[0][:40]))
def test_problems_have_their_place_and_name_what_is_wrong(tmp_path: Path, case) -> None:
    text, *named = case
    path = tmp_path / "5pk.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert caught.value.exit_status == EXIT_INPUT
    assert len(caught.value.problems) == len(named), caught.value.problems
    for problem, (place, *words) in zip(caught.value.problems, named, strict=True):
        assert problem.startswith(f"{path}:{place}:" if place else str(path))
        assert not [word for word in words if word not in problem], problem


def test_aliases_cannot_multiply_the_message(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    (tmp_path / "c.yaml").write_text("\n".join([*lines, "rig: {arcs_deg: *a11}"]))
    with pytest.raises(ConfigError) as caught:
        load_config(tmp_path / "c.yaml")
    assert len(str(caught.value)) < 10_000


def test_the_name_cannot_leave_its_folder() -> None:
    for name in ("..", ".hidden", "a/b", "a\\b", "", "a" * 65, "a b", "-rf", "con\n", "ä", "=1"):
        with pytest.raises(ConfigError, match=r"belt\.name"):
            load_config({"belt": {"name": name}})


def sections() -> dict[str, type[Section]]:
    found = {name: type(field.default) for name, field in Config.model_fields.items()}
    return {name: of for name, of in found.items() if issubclass(of, Section)}


NUMBERS = [
    (name, key, check.check if isinstance(check, ListOf) else check, isinstance(check, ListOf))
    for name, of in sections().items()
    for key in of.model_fields
    for check in [check_of(of, key)]
    if isinstance(check, Number) or (isinstance(check, ListOf) and isinstance(check.check, Number))
]


@pytest.mark.parametrize(("section", "key", "bounds", "is_list"), NUMBERS)
def test_bounds_hold_and_are_named(section: str, key: str, bounds: Number, is_list: bool) -> None:
    assert len(NUMBERS) > 50
    step = 2 if bounds.even else 1 if bounds.whole else 1e-9 * (bounds.high - bounds.low)
    low = bounds.low + step * bounds.open_low
    high = bounds.high - step * bounds.open_high
    for value in (low, high):
        loaded = getattr(
            getattr(load_config({section: {key: [value] if is_list else value}}), section), key
        )
        assert loaded == ((value,) if is_list else value)
    for value in (low - step, high + step):
        with pytest.raises(ConfigError, match=rf"{section}\.{key}") as caught:
            load_config({section: {key: [value] if is_list else value}})
        assert bounds.allowed in str(caught.value)
