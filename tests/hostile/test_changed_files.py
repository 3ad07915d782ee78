"""Whatever is done to a file, its reader takes it or refuses it with status 2, and soon."""

import random
import time

import pytest
from mutation import MUTATORS
from readers import CORPUS, READERS, read, seeds

from beltid.config.checks import name_pattern

OF_LIBRARIES = ("tdms", "mdf", "mat", "hdf5", "xlsx")  # they read damaged files as they like
OURS = [reader for reader in READERS if reader not in OF_LIBRARIES]
RIG = (
    "run,time_s,tension_tight_N,tension_slack_N,pulley_speed_rad_s,temperature_degC,arc_deg,"
    "initial_tension_N\n"
)


@pytest.mark.parametrize("reader", READERS)
def test_files_of_the_corpus_are_taken_or_refused_and_whole_ones_are_not_damaged(reader):
    for path in (CORPUS / reader).iterdir():
        whole = reader in OURS and not path.name.startswith("found")
        # the short tables are of too few runs or samples for some checks, but are read to their end
        assert not ("damaged" in str(read(reader, path.read_bytes())) and whole), path.name


def test_a_law_with_an_infinite_number_is_refused():
    (law,) = seeds("law")
    assert read("law", law.replace(b"-1.910980075099135e-06", b"1e999", 1)) is not None


@pytest.mark.parametrize("reader", OURS)
def test_changed_files_are_taken_or_refused(reader):
    files = seeds(reader)
    for number in range(12):
        dice = random.Random(number)
        data = dice.choice(files)
        for _ in range(dice.choice((1, 1, 2, 3))):
            data = MUTATORS[reader](data, dice, files)
        read(reader, data)


@pytest.mark.parametrize(
    ("reader", "data"),
    [
        ("csv", RIG + "R1," + "1" * 200_000 + "x,1,1,1,1,1,1\n"),
        ("csv", ",".join(["a" + " " * 250 + "b"] * 400) + "\n" + "1," * 399 + "1\n"),
        ("csv", RIG + '"' * 200_000),
        ("csv", "#\n" * 200_000),
        ("zwick", "a;b\n" + "9" * 120_000 + ".;x\n"),
        ("yaml", "units: {rig: {tension_tight_N: " + "1 " + " /" * 50_000 + "}}"),
        ("yaml", "a: [" + "1," * 140_000 + "]"),
        ("yaml", "[" * 250_000),
        ("yaml", "".join(f"k{i}: 1\n" for i in range(20_000))),
        ("lvm", "LabVIEW Measurement\t\n" + "***End_of_Header***\nX_Value\ta\n" * 9000),
    ],
    ids=lambda value: value[:12].strip() if isinstance(value, str) else None,
)
def test_long_files_are_refused_in_little_time(reader, data):
    start = time.process_time()
    assert read(reader, data.encode()) is not None
    assert time.process_time() - start < 3.0


NAME = "x" * 250 + ".csv"  # as long as a file system allows, and no pattern below fits


@pytest.mark.parametrize(
    "pattern",
    [
        "{run}" + "{}" * 200 + "y",
        "{run}" + "{}x" * 100 + "y",
    ],
    ids=range(2),
)
def test_a_pattern_takes_time_in_proportion_to_the_name(pattern):
    start = time.process_time()
    assert name_pattern(pattern).values(NAME) is None
    assert time.process_time() - start < 1.0


def test_names_that_are_no_text_are_matched_without_their_odd_bytes():
    assert name_pattern("{run}_{arc_deg}.csv").values("R\udcff_40.csv") == {
        "run": "R?",
        "arc_deg": "40",
    }
