"""An artifact is made when it has to be, and nothing else is ever replaced."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from beltid.artifacts.artifact import read_artifact
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import BeltidError, InputError
from beltid.report.summary import rows_of
from beltid.stages.build_artifact import Build, Built
from beltid.stages.outcome import Outcome, span
from beltid.stages.reporter import Options


class Work:
    """Computes a compare table and counts how often it had to."""

    def __init__(self, mu: float = 0.5) -> None:
        self.calls = 0
        self.mu = mu

    def __call__(self) -> Outcome[None]:
        self.calls += 1
        columns = {
            "run": np.array(["R1"], dtype=object),
            "arc_deg": np.array([82.0]),
            "nominal_tension_N": np.array([270.0]),
            "pulley_speed_rad_s": np.array([0.21]),
            "mu_measured": np.array([self.mu]),
            "mu_simulated": np.array([self.mu]),
            "difference": np.array([0.0]),
            "within_tolerance": np.array([True]),
        }
        return Outcome("compare", columns, None, notes=("a note",), warnings=("a warning",))


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "input.csv"
    path.write_text("1,2,3\n")
    return path


Recipe = Callable[[Path, Options], Build]


def recipe(source: Path, config: Config | None = None, **choices: Any) -> Recipe:
    chosen, uses = ConfigSource(config or Config(), "test"), ("compare", "rig")
    return lambda out, options: Build(
        "compare", chosen, uses, {"in": source}, out, options, choices
    )


def make(
    recipe: Recipe, out: Path, options: Options, compute: Callable[[], Outcome[None]]
) -> Built:
    """As every stage does it."""
    build = recipe(out, options)
    return build.up_to_date() or build.write(compute())


def test_it_is_made_once_and_kept(source: Path, tmp_path: Path) -> None:
    work, out = Work(), tmp_path / "out.parquet"
    first = make(recipe(source), out, Options(), work)
    again = make(recipe(source), out, Options(), work)
    assert (first.up_to_date, again.up_to_date, work.calls) == (False, True, 1)
    assert again.artifact.metadata.notes == ("a note",)
    assert again.artifact.metadata.warnings == ("a warning",)


@pytest.mark.parametrize(
    "change",
    [
        lambda source: (source.write_text("1,2,4\n"), recipe(source))[1],
        lambda source: recipe(source, load_config({"compare": {"max_relative_error": 0.1}})),
        lambda source: recipe(source, load_config({"rig": {"slide": "held"}})),
        lambda source: recipe(source, method="steady"),
    ],
    ids=["input", "section", "other section", "choice"],
)
def test_what_matters_makes_it_again(
    source: Path, tmp_path: Path, change: Callable[[Path], Recipe]
) -> None:
    work, out = Work(), tmp_path / "out.parquet"
    make(recipe(source), out, Options(), work)
    assert not make(change(source), out, Options(), work).up_to_date
    assert work.calls == 2


@pytest.mark.parametrize(
    "config",
    [
        {"press": {"segment_length_cm": 2.0}},
        {"belt": {"name": "other"}},
        {"data": {"rig": "elsewhere.csv"}},
    ],
)
def test_what_does_not_matter_keeps_it(
    source: Path, tmp_path: Path, config: dict[str, Any]
) -> None:
    work, out = Work(), tmp_path / "out.parquet"
    make(recipe(source), out, Options(), work)
    assert make(recipe(source, load_config(config)), out, Options(), work).up_to_date


def test_a_renamed_input_is_the_same_input(source: Path, tmp_path: Path) -> None:
    work, out = Work(), tmp_path / "out.parquet"
    make(recipe(source), out, Options(), work)
    renamed = source.rename(tmp_path / "renamed.csv")
    assert make(recipe(renamed), out, Options(), work).up_to_date


def test_another_version_of_the_software_makes_it_again(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work, out = Work(), tmp_path / "out.parquet"
    make(recipe(source), out, Options(), work)
    monkeypatch.setattr("beltid.stages.build_artifact.__version__", "99.0")
    assert not make(recipe(source), out, Options(), work).up_to_date


def test_other_sources_of_the_same_version_make_it_again(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work, out = Work(), tmp_path / "out.parquet"
    make(recipe(source), out, Options(), work)
    monkeypatch.setattr("beltid.stages.build_artifact.source_sha256", lambda: "0" * 64)
    assert not make(recipe(source), out, Options(), work).up_to_date


def test_force_makes_it_again(source: Path, tmp_path: Path) -> None:
    work, out = Work(), tmp_path / "out.parquet"
    make(recipe(source), out, Options(), work)
    before = out.read_bytes()
    assert not make(recipe(source), out, Options(force=True), work).up_to_date
    assert out.read_bytes() == before


def test_a_failure_leaves_what_was_there(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    make(recipe(source), out, Options(), Work())
    before = out.read_bytes()

    def fails() -> Outcome[None]:
        raise InputError("no")

    with pytest.raises(InputError):
        make(recipe(source), out, Options(force=True), fails)
    assert out.read_bytes() == before


@pytest.mark.parametrize("data", [b"", b"text", b"PAR1 and more"])
def test_a_foreign_file_is_replaced_by_force_only(
    source: Path, tmp_path: Path, data: bytes
) -> None:
    work, out = Work(), tmp_path / "out.parquet"
    out.write_bytes(data)
    with pytest.raises(InputError, match="did not write"):
        make(recipe(source), out, Options(), work)
    assert out.read_bytes() == data
    assert work.calls == 0
    make(recipe(source), out, Options(force=True), work)
    assert read_artifact(out, "compare")


def test_what_reads_back_wrong_is_never_written(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    make(recipe(source), out, Options(), Work())
    before = out.read_bytes()

    def wrong() -> Outcome[None]:
        outcome = Work()()
        outcome.extra["passed"] = ["perhaps"]
        return outcome

    with pytest.raises(ValidationError, match="passed"):
        make(recipe(source), out, Options(force=True), wrong)
    assert out.read_bytes() == before


def test_an_input_is_never_overwritten_not_even_under_another_name(
    source: Path, tmp_path: Path
) -> None:
    link, twin = tmp_path / "link.parquet", tmp_path / "twin.parquet"
    link.symlink_to(source)
    twin.hardlink_to(source)
    for out in (source, link, twin):
        with pytest.raises(InputError, match="is the in input"):
            make(recipe(source), out, Options(force=True), Work())
    assert source.read_text() == "1,2,3\n"


def test_what_cannot_be_kept_is_reported_before_the_work(source: Path, tmp_path: Path) -> None:
    work = Work()
    (tmp_path / "folder").mkdir()
    for out in (tmp_path / "folder", source / "out.parquet"):
        with pytest.raises(BeltidError):
            make(recipe(source), out, Options(force=True), work)
    assert work.calls == 0


def test_metadata_tells_where_it_came_from(source: Path, tmp_path: Path) -> None:
    import hashlib

    out = tmp_path / "out.parquet"
    config = Config()
    make(recipe(source, config, method="steady"), out, Options(), Work())
    metadata = read_artifact(out, "compare").metadata
    assert metadata.inputs == {"in": hashlib.sha256(b"1,2,3\n").hexdigest()}
    assert metadata.config_sha256 == config.sha256
    assert metadata.settings["rig"]["span_length_m"] == 0.10
    assert metadata.settings["method"] == "steady"


def test_rows_and_spans_know_missing_values() -> None:
    columns = {"a": np.array([1.0, np.nan]), "b": np.array(["x", None], dtype=object)}
    assert rows_of(columns, "b", "a", "c") == [{"b": "x", "a": 1.0}, {"b": None, "a": None}]
    assert span(np.array([np.nan, 3.0, 1.0])) == (1.0, 3.0)
    assert span(np.array([np.nan])) is None


@pytest.mark.parametrize("name", ["table.csv", "Table.XLSX", "result.json"])
def test_a_result_is_not_called_what_it_is_not(source: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"results are Parquet files: name it \w+\.parquet"):
        make(recipe(source), tmp_path / name, Options(), Work())
    assert not (tmp_path / name).exists()
