"""Which config belongs to a recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltid.config import find_config
from beltid.errors import ConfigError


def ribs(path: Path, number: int) -> Path:
    path.write_text(f"belt: {{ribs: {number}}}\n")
    return path


def test_the_order_of_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "bench" / "monday"
    place.mkdir(parents=True)
    monkeypatch.chdir(place)
    monkeypatch.setenv("BELTID_CONFIG", "")  # counts as unset
    recording = place / "rig.v2.csv.gz"
    (place / "beltid.yaml").mkdir()  # a folder of that name is no config
    assert find_config().path is find_config(recording).path is None
    (place / "beltid.yaml").rmdir()
    others = [place.parent.parent / "beltid.yaml", place.parent / "rig.v2.yaml"]
    for number, path in enumerate([*others, place / "beltid.yaml", place / "rig.v2.yaml"], 11):
        ribs(path, number)
        for found in (find_config(recording), find_config(recording.name)):
            assert (found.config.belt.ribs, found.path) == (number, path)
            assert str(path) in found.origin
    monkeypatch.setenv("BELTID_CONFIG", str(ribs(place / "other.yaml", 15)))
    assert find_config(recording).config.belt.ribs == 15
    assert "$BELTID_CONFIG" in find_config(recording).origin
    found = find_config(recording, ribs(place / "named.yaml", 16))
    assert (found.config.belt.ribs, "--config" in found.origin) == (16, True)


def test_a_wrong_config_that_was_found_says_why_it_was_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    ribs(tmp_path / "beltid.yaml", 0)
    with pytest.raises(ConfigError) as caught:
        find_config(tmp_path / "rig.csv")
    assert len(caught.value.problems) == 2
    assert all(word in caught.value.problems[1] for word in ("beltid.yaml", "rig.csv", "--config"))
    missing = tmp_path / "missing.yaml"
    monkeypatch.setenv("BELTID_CONFIG", str(missing))
    for explicit in (missing, None):
        with pytest.raises(ConfigError, match="missing"):
            find_config(tmp_path / "rig.csv", explicit)
