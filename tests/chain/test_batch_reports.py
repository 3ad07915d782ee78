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
from beltid.errors import BeltidError
from beltid.report.summary import Summary
from beltid.stages.reporter import Level, Options, Reporter
from beltid.stages.workers import Workers


class Notes(Reporter):
    """Reporter that is kept."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.wrong: list[str] = []

    def line(self, level: Level, text: str) -> None:
        (self.wrong if level == "error" else self.said).append(text)


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
def ended(by_one: Path, recordings: Path, tmp_path: Path) -> Callable[[str, Reporter], list[Chain]]:
    """Chains of two belts that have come to their normal law: a page with few drawings."""

    def chains(name: str, reporter: Reporter) -> list[Chain]:
        made = []
        for source in config_sources([recordings / "one.yaml", recordings / "two.yaml"]):
            belt = source.name
            folder = tmp_path / name / belt
            folder.mkdir(parents=True)
            shutil.copy(by_one / belt / "stiffness.parquet", folder)
            chain = Chain(source, folder, (), reporter)
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
            write_reports(ended(name, Reporter()), tmp_path / name, Options(), who)
    finally:
        workers.close()
    here, there = contents(tmp_path / "here"), contents(tmp_path / "there")
    assert {"report.html", "one/report.html", "two/report.html"} < set(here)
    assert there == here


@pytest.mark.usefixtures("undrawn")
def test_only_pages_that_are_not_up_to_date_are_given_away(ended: Any, tmp_path: Path) -> None:
    notes, workers = Notes(), Counted()
    chains = ended("runs", notes)
    write_reports(chains, tmp_path / "runs", Options(), workers)
    assert workers.calls == 2
    assert [chain.run.states["report"] for chain in chains] == ["done", "done"]
    made = contents(tmp_path / "runs")
    write_reports(chains, tmp_path / "runs", Options(), workers)
    assert workers.calls == 2
    assert [chain.run.states["report"] for chain in chains] == ["up to date", "up to date"]
    assert contents(tmp_path / "runs") == made
    assert f"one: report: up to date, {chains[0].folder / 'report.html'}" in notes.said


@pytest.mark.usefixtures("undrawn")
def test_the_page_of_all_belts_keeps_those_of_earlier_calls(ended: Any, tmp_path: Path) -> None:
    one, two = ended("runs", Reporter())
    page = tmp_path / "runs" / "report.html"
    write_reports([one], tmp_path / "runs", Options(), Workers())
    assert not page.exists()  # of a single belt
    write_reports([two], tmp_path / "runs", Options(), Workers())
    text = page.read_text()
    assert 'href="one/report.html"' in text
    assert 'href="two/report.html"' in text


@pytest.mark.usefixtures("undrawn")
def test_a_page_that_fails_does_not_stop_the_others(ended: Any, tmp_path: Path) -> None:
    notes = Notes()
    chains = ended("runs", notes)
    mine = chains[0].folder / "report.html"
    mine.write_text("my own notes\n")
    write_reports(chains, tmp_path / "runs", Options(reporter=notes), Counted())
    assert mine.read_text() == "my own notes\n"
    assert [chain.run.states["report"] for chain in chains] == ["failed", "done"]
    assert [chain.run.exit_status for chain in chains] == [2, 0]
    assert any("a file that beltid did not write" in line for line in notes.wrong)
    assert not (tmp_path / "runs" / "report.html").exists()


class Lost(Counted):
    """Workers who are killed at the page of the second belt."""

    def as_ended(
        self, function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Any]]:
        if any(source.name == "two" for _, source, *_ in calls):
            raise BeltidError("workers were killed 4 times")
        return super().as_ended(function, calls)


@pytest.mark.usefixtures("undrawn")
def test_workers_that_are_lost_fail_the_pages_that_they_had(ended: Any, tmp_path: Path) -> None:
    reporter = Notes()
    chains = ended("lost", reporter)
    write_reports(chains, tmp_path / "lost", Options(reporter=reporter), Lost())
    assert [chain.run.states["report"] for chain in chains] == ["done", "failed"]
    assert reporter.wrong == ["two: report: workers were killed 4 times"]
    assert (tmp_path / "lost" / "one" / "report.html").is_file()


class Remote(Counted):
    """Workers of a cluster, who do not see the results."""

    share_files = False


def test_threads_of_one_process_draw_no_pages(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn_by = []

    def of_chain(
        source: ConfigSource, inputs: Any, out: Path, options: Options, failures: Any
    ) -> Summary:
        drawn_by.append(threading.current_thread())
        return Summary(stage="report", title="", out=out)

    monkeypatch.setattr("beltid.stages.results.report_belt.of_chain", of_chain)
    chains = []
    for source in config_sources([recordings / "one.yaml", recordings / "two.yaml"]):
        chain = Chain(source, tmp_path / source.name, (), Reporter())
        chain.run.summaries["fit-friction"] = Summary(stage="fit-friction", title="")
        chains.append(chain)
    monkeypatch.setattr("beltid.stages.results.report_belt.of_belts", lambda *_: None)
    write_reports(chains, tmp_path, Options(), Remote())
    assert drawn_by == [threading.main_thread()] * 2
