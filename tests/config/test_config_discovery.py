"""Which config belongs to a recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltid.config import find_config, load_config
from beltid.errors import ConfigError


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    folder = tmp_path / "bench" / "monday"
    folder.mkdir(parents=True)
    return folder


def ribs(path: Path, number: int) -> Path:
    path.write_text(f"belt: {{ribs: {number}}}\n")
    return path


def test_the_order_of_places(place, monkeypatch):
    recording = place / "rig.csv"
    assert find_config(recording).config == load_config()
    assert find_config().path is None
    assert "built-in 5PK" in find_config().origin
    (place / "beltid.yaml").mkdir()  # a folder of that name is no config
    assert find_config(recording).path is None
    (place / "beltid.yaml").rmdir()
    others = [place.parent.parent / "beltid.yaml", place.parent / "rig.yaml"]
    for number, path in enumerate([*others, place / "beltid.yaml", place / "rig.yaml"], 11):
        ribs(path, number)
        monkeypatch.setenv("BELTID_CONFIG", "")  # counts as unset
        found = find_config(recording)
        assert (found.config.belt.ribs, found.path) == (number, path)
        assert str(path) in found.origin
        monkeypatch.chdir(place)
        assert find_config("rig.csv").config.belt.ribs == number
    monkeypatch.setenv("BELTID_CONFIG", str(ribs(place / "other.yaml", 15)))
    assert find_config(recording).config.belt.ribs == 15
    assert "$BELTID_CONFIG" in find_config(recording).origin
    named = ribs(place / "named.yaml", 16)
    assert find_config(recording, named).config.belt.ribs == 16
    assert "--config" in find_config(recording, named).origin


@pytest.mark.parametrize("name", ["5pk.v2.csv", "5pk.v2.csv.gz"])
def test_the_stem_of_a_recording(place, name):
    assert find_config(place / name).path is None
    assert find_config(ribs(place / "5pk.v2.yaml", 14).with_name(name)).config.belt.ribs == 14


def test_a_wrong_config_that_was_found_says_why_it_was_taken(place):
    ribs(place / "beltid.yaml", 0)
    with pytest.raises(ConfigError) as caught:
        find_config(place / "rig.csv")
    assert len(caught.value.problems) == 2
    assert all(word in caught.value.problems[1] for word in ("beltid.yaml", "rig.csv", "--config"))


def test_a_named_config_that_is_missing_is_an_error(place, monkeypatch):
    with pytest.raises(ConfigError, match="no such config file"):
        find_config(place / "rig.csv", place / "missing.yaml")
    monkeypatch.setenv("BELTID_CONFIG", str(place / "missing.yaml"))
    with pytest.raises(ConfigError, match="no such config file"):
        find_config(place / "rig.csv")
