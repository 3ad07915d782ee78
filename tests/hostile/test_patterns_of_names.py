"""Patterns of file names come from a config: whatever they are, matching them ends soon."""

from __future__ import annotations

import time

import pytest

from beltid.config import load_config
from beltid.config.checks import name_pattern
from beltid.errors import ConfigError

NAME = "x" * 250 + ".csv"  # as long as a file system allows, and no pattern below fits


@pytest.mark.parametrize(
    "pattern",
    [
        "(?P<run>(?:x+x+)+y)",
        "(?P<run>(?:x|x|x)*y)",
        "(?P<run>(?:.*)*)" + "(?:.*)*" * 60 + "y",
        "(?P<run>x*)" + "x*" * 200 + "y",
        "(?P<run>(?:(?:x{1,9}){1,9}){1,9})y",
        "{run}" + "{}" * 200 + "y",
        "{run}" + "{}x" * 100 + "y",
    ],
    ids=range(7),
)
def test_a_pattern_takes_time_in_proportion_to_the_name(pattern):
    start = time.process_time()
    assert name_pattern(pattern).values(NAME) is None
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        (r"(?P<run>.)\1", "invalid escape sequence"),
        ("(?P<run>x)(?=y)", "invalid perl operator"),
        ("(?P<run>(x))", "unnamed groups"),
        ("(?P<run>" + "(?:" * 120, "missing )"),
        ("(?P<run>((?:a{1000}){1000}){1000})", "invalid repetition size"),
        ("(?P<run>[b-a])", "invalid character class range"),
        ("{run}_{run}.csv", "run"),
    ],
)
def test_a_pattern_that_is_none_is_refused_with_its_reason(pattern, words):
    with pytest.raises(ConfigError) as caught:
        load_config({"runs": {"rig": {"pattern": pattern}}})
    (line,) = caught.value.problems
    assert line.startswith("runs.rig.pattern = ")
    assert words in line


def test_names_that_are_no_text_are_matched_without_their_odd_bytes():
    assert name_pattern("{run}_{arc_deg}.csv").values("R\udcff_40.csv") == {
        "run": "R?",
        "arc_deg": "40",
    }
