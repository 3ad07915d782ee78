"""Reports at the end of a batch: the same pages whoever draws them, one after the other or not."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from small_bench import contents

from beltid.batch.chain import write_reports
from beltid.batch.local import ProcessWorkers
from beltid.batch.schedule import Chain
from beltid.batch.sources import config_sources
from beltid.config import ConfigSource
from beltid.notes import Kept, heard_by
from beltid.report.summary import Summary
from beltid.stages.workers import Workers


class Counted(Workers):
    """Two workers, who count what they are given; one after the other, in this process."""

    jobs = 2

    def __init__(self) -> None:
        self.calls = 0
        self.lock = threading.Lock()

    def as_ended(
        self, function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Any]]:
        with self.lock:
            self.calls += len(calls)
            return iter(list(super().as_ended(function, calls)))


@pytest.fixture
def ended(by_one: Path, recordings: Path, tmp_path: Path) -> Callable[[str], list[Chain]]:
    """Chains of two belts that have come to their normal law: a page with few drawings."""

    def chains(name: str) -> list[Chain]:
        made = []
        for source in config_sources([recordings / "one.yaml", recordings / "two.yaml"]):
            belt = source.name
            folder = tmp_path / name / belt
            folder.mkdir(parents=True)
            shutil.copy(by_one / belt / "stiffness.parquet", folder)
            chain = Chain(source, folder, ())
            chain.files["stiffness"] = folder / "stiffness.parquet"
            chain.run.summaries["fit-stiffness"] = Summary(
                stage="fit-stiffness", title="", out=folder
            )
            made.append(chain)
        return made

    return chains


@pytest.mark.long
def test_pages_do_not_depend_on_who_draws_them(ended: Any, tmp_path: Path) -> None:
    workers = ProcessWorkers(2)
    try:
        for name, who in (("here", Workers()), ("there", workers)):
            write_reports(ended(name), tmp_path / name, who)
    finally:
        workers.close()
    here, there = contents(tmp_path / "here"), contents(tmp_path / "there")
    assert {"report.html", "one/report.html", "two/report.html"} < set(here)
    assert there == here


@pytest.mark.usefixtures("undrawn")
def test_only_pages_that_are_not_up_to_date_are_given_away(ended: Any, tmp_path: Path) -> None:
    notes, workers = Kept(), Counted()
    chains = ended("runs")
    write_reports(chains, tmp_path / "runs", workers)
    assert workers.calls == 2
    assert [chain.run.states["report"] for chain in chains] == ["done", "done"]
    made = contents(tmp_path / "runs")
    with heard_by(notes):
        write_reports(chains, tmp_path / "runs", workers)
    assert [chain.run.states["report"] for chain in chains] == ["up to date", "up to date"]
    assert contents(tmp_path / "runs") == made
    said = [text for _, text in notes.lines]
    assert f"one: report: up to date, {chains[0].folder / 'report.html'}" in said


@pytest.mark.usefixtures("undrawn")
def test_the_page_of_all_belts_keeps_those_of_earlier_calls(ended: Any, tmp_path: Path) -> None:
    one, two = ended("runs")
    page = tmp_path / "runs" / "report.html"
    write_reports([one], tmp_path / "runs", Workers())
    assert not page.exists()  # of a single belt
    write_reports([two], tmp_path / "runs", Workers())
    text = page.read_text()
    assert 'href="one/report.html"' in text
    assert 'href="two/report.html"' in text


@pytest.mark.usefixtures("undrawn")
def test_a_page_that_fails_does_not_stop_the_others(ended: Any, tmp_path: Path) -> None:
    notes = Kept()
    chains = ended("runs")
    mine = chains[0].folder / "report.html"
    mine.write_text("my own notes\n")
    with heard_by(notes):
        write_reports(chains, tmp_path / "runs", Counted())
    assert mine.read_text() == "my own notes\n"
    assert [chain.run.states["report"] for chain in chains] == ["failed", "done"]
    assert [chain.run.exit_status for chain in chains] == [2, 0]
    assert any("a file that beltid did not write" in line for _, line in notes.lines)
    assert not (tmp_path / "runs" / "report.html").exists()


class Remote(Counted):
    """Workers of a cluster, who do not see the results."""

    share_files = False


def test_threads_of_one_process_draw_no_pages(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn_by = []

    def of_chain(source: ConfigSource, made: Any, folder: Path, *_: Any, **__: Any) -> Summary:
        drawn_by.append(threading.current_thread())
        return Summary(stage="report", title="", out=folder)

    monkeypatch.setattr("beltid.stages.report_belt.of_chain", of_chain)
    chains = []
    for source in config_sources([recordings / "one.yaml", recordings / "two.yaml"]):
        chain = Chain(source, tmp_path / source.name, ())
        chain.run.summaries["fit-friction"] = Summary(stage="fit-friction", title="")
        chains.append(chain)
    monkeypatch.setattr("beltid.stages.report_belt.of_belts", lambda *_, **__: None)
    write_reports(chains, tmp_path, Remote())
    assert drawn_by == [threading.main_thread()] * 2
