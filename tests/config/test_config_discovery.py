"""Which config belongs to a recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltid.config import find_config, load_config
from beltid.errors import ConfigError


@pytest.fixture(autouse=True)
def _no_config_of_the_user(monkeypatch):
    monkeypatch.delenv("BELTID_CONFIG", raising=False)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    folder = tmp_path / "bench" / "monday"
    folder.mkdir(parents=True)
    (folder / "rig.csv").touch()
    return folder


def ribs(path: Path, number: int) -> Path:
    path.write_text(f"belt: {{ribs: {number}}}\n")
    return path


def test_the_order_of_places(place, monkeypatch):
    recording = place / "rig.csv"
    assert find_config(recording).config == load_config()
    ribs(place.parent.parent / "beltid.yaml", 11)
    assert find_config(recording).config.belt.ribs == 11
    ribs(place.parent / "rig.yaml", 12)
    assert find_config(recording).config.belt.ribs == 12
    ribs(place / "beltid.yaml", 13)
    assert find_config(recording).config.belt.ribs == 13
    beside = ribs(place / "rig.yaml", 14)
    found = find_config(recording)
    assert (found.config.belt.ribs, found.path) == (14, beside)
    assert str(beside) in found.origin
    monkeypatch.setenv("BELTID_CONFIG", str(ribs(place / "other.yaml", 15)))
    assert find_config(recording).config.belt.ribs == 15
    assert "$BELTID_CONFIG" in find_config(recording).origin
    named = ribs(place / "named.yaml", 16)
    assert find_config(recording, named).config.belt.ribs == 16
    assert "--config" in find_config(recording, named).origin


def test_the_config_of_a_packed_recording_is_called_as_that_of_a_plain_one(place):
    beside = ribs(place / "5pk.v2.yaml", 14)
    assert find_config(place / "5pk.v2.csv").path == beside
    assert find_config(place / "5pk.v2.csv.gz").path == beside


def test_the_built_in_rig_says_so():
    found = find_config()
    assert found.path is None
    assert "built-in 5PK" in found.origin


def test_an_empty_variable_counts_as_unset(place, monkeypatch):
    monkeypatch.setenv("BELTID_CONFIG", "")
    assert find_config(place / "rig.csv").path is None


def test_a_relative_recording_finds_the_config_of_its_parents(place, monkeypatch):
    ribs(place.parent / "beltid.yaml", 9)
    monkeypatch.chdir(place)
    assert find_config("rig.csv").config.belt.ribs == 9


def test_the_stem_of_a_packed_recording(place):
    ribs(place / "rig.yaml", 8)
    assert find_config(place / "rig.csv.gz").config.belt.ribs == 8


def test_a_wrong_config_that_was_found_says_why_it_was_taken(place):
    (place / "beltid.yaml").write_text("belt: {ribs: 0}\n")
    with pytest.raises(ConfigError) as caught:
        find_config(place / "rig.csv")
    assert len(caught.value.problems) == 2
    assert caught.value.problems[1].endswith(
        "beltid.yaml: this config was found for rig.csv, --config names another"
    )


def test_a_named_config_that_is_missing_is_an_error(place, monkeypatch):
    with pytest.raises(ConfigError, match="no such config file"):
        find_config(place / "rig.csv", place / "missing.yaml")
    monkeypatch.setenv("BELTID_CONFIG", str(place / "missing.yaml"))
    with pytest.raises(ConfigError, match="no such config file"):
        find_config(place / "rig.csv")


def test_a_folder_of_that_name_is_no_config(place):
    (place / "beltid.yaml").mkdir()
    assert find_config(place / "rig.csv").path is None


def test_a_folder_that_may_not_be_read_is_passed_over(place, monkeypatch):
    def refuse(self: Path) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "is_file", refuse)
    assert find_config(place / "rig.csv").path is None
