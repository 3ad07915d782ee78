"""Which config belongs to a recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltid.config import find_config
from beltid.errors import ConfigError


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
