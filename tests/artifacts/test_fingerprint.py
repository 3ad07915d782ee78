"""The hash of our own sources: sees every edit that can change a result, and costs little."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from beltid.artifacts.file_bytes import hash_of_sources, source_sha256

PACKAGE = Path(__file__).parents[2] / "beltid"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    copy = tmp_path / "beltid"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


def test_it_is_that_of_this_installation(package: Path) -> None:
    assert len(source_sha256()) == 64
    assert hash_of_sources(package) == hash_of_sources(package)


@pytest.mark.parametrize(
    "file",
    [
        "laws/capstan.py",
        "identify/friction/campaign.py",
        "rig/steady.py",
        "bench/recording.py",
        "params.py",
    ],
)
def test_an_edit_of_what_computes_changes_it(package: Path, file: str) -> None:
    before = hash_of_sources(package)
    source = package / file
    source.write_bytes(source.read_bytes() + b"\n")
    assert hash_of_sources(package) != before
    source.unlink()
    assert hash_of_sources(package) != before


def test_a_renamed_module_changes_it(package: Path) -> None:
    before = hash_of_sources(package)
    (package / "tables/units.py").rename(package / "tables/unitz.py")
    assert hash_of_sources(package) != before


def test_what_only_shows_results_does_not_matter(package: Path) -> None:
    before = hash_of_sources(package)
    for file in ("cli/program.py", "report/terminal.py", "__main__.py"):
        (package / file).write_text("# another\n")
    (package / "laws" / "notes.txt").write_text("no source")
    assert hash_of_sources(package) == before


def test_line_ends_of_another_system_do_not_matter(package: Path) -> None:
    before = hash_of_sources(package)
    for source in package.rglob("*.py"):
        source.write_bytes(source.read_bytes().replace(b"\n", b"\r\n"))
    assert hash_of_sources(package) == before


def test_without_sources_the_version_has_to_do(tmp_path: Path) -> None:
    assert hash_of_sources(tmp_path) == ""
