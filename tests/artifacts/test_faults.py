"""Faults done for real, a few of each kind: `make verify` does them by the hundred."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltid.artifacts.artifact import artifact_bytes, read_artifact
from beltid.artifacts.file_bytes import remove_stale, write_bytes
from beltid.artifacts.metadata_models import Metadata
from beltid.batch.folders import alone_in
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import ArtifactError, InputError
from beltid.stages.build_artifact import Build, Built
from beltid.stages.outcome import Outcome
from beltid.stages.reporter import Level, Options, Reporter
from beltid.tables import schemas

ROOT = Path(__file__).parents[2]
GONE = 2**22 - 1  # no process has this number: it is the largest that Linux gives


def make(
    recipe: tuple[Any, ...], out: Path, options: Options, compute: Callable[[], Outcome[Any]]
) -> Built:
    """Build an artifact as every stage does it."""
    build = Build(*recipe, out, options)
    return build.up_to_date() or build.write(compute())


def example(seed: int, rows: int = 1000) -> bytes:
    rng = np.random.default_rng(seed)
    names = [column.name for column in schemas.table("slip").columns if column.required]
    return artifact_bytes("slip", {n: rng.uniform(1.0, 2.0, rows) for n in names}, Metadata())


WRITER = """
import sys
from pathlib import Path
from typing import Any
from beltid.artifacts.file_bytes import write_bytes
path, *versions = (Path(name) for name in sys.argv[1:])
print("at it", flush=True)
while True:
    for version in versions:
        write_bytes(path, version.read_bytes())
"""


def writer(path: Path, versions: list[Path]) -> subprocess.Popen[str]:
    """A process that writes one version over the other, for ever."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), *map(str, versions)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "at it\n"
    return process


@pytest.fixture
def versions(tmp_path: Path) -> list[Path]:
    """Two artifacts to write."""
    paths = [tmp_path / "old.parquet", tmp_path / "new.parquet"]
    for seed, path in enumerate(paths):
        path.write_bytes(example(seed))
    return paths


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs another user")
def test_a_read_only_folder_keeps_the_old_file(tmp_path: Path) -> None:
    place = tmp_path / "locked"
    place.mkdir()
    path = place / "slip.parquet"
    path.write_bytes(b"old")
    place.chmod(0o555)
    code = (
        "import os, sys; from beltid.artifacts.file_bytes import write_bytes\n"
        "from beltid.errors import ArtifactError\n"
        "place = os.open(os.path.dirname(sys.argv[1]), os.O_RDONLY); os.fchdir(place)\n"
        "if os.geteuid() == 0: os.setgid(65534); os.setuid(65534)\n"
        "try: write_bytes('slip.parquet', b'new')\n"
        "except ArtifactError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    place.chmod(0o755)
    assert "not written: no permission to write in" in done.stdout, done.stderr
    assert path.read_bytes() == b"old"
    assert [p.name for p in place.iterdir()] == ["slip.parquet"]


# --- inputs that change under way, batches on one folder -----------------------------------------


def outcome() -> Outcome[None]:
    names = [column.name for column in schemas.table("slip").columns if column.required]
    return Outcome("slip", {name: np.ones(3) for name in names}, None)


@pytest.mark.parametrize("same", [True, False])
def test_an_input_replaced_while_it_is_read_is_noticed(tmp_path: Path, same: bool) -> None:
    source, out = tmp_path / "speedloss.csv", tmp_path / "slip.parquet"
    source.write_text("one")
    recipe = ("slip", ConfigSource(Config(), "test"), ("rig",), {"speedloss": source})

    def meanwhile() -> Outcome[None]:
        write_bytes(source, b"one" if same else b"two")
        return outcome()

    if same:
        assert not make(recipe, out, Options(), meanwhile).up_to_date
        return
    with pytest.raises(InputError, match=r"speedloss\.csv: was changed while it was read"):
        make(recipe, out, Options(), meanwhile)
    assert not out.exists()
    assert make(recipe, out, Options(), outcome).artifact.metadata.inputs
    assert read_artifact(out, "slip").kind == "slip"


@pytest.mark.parametrize("named", ["runs", "runs/*.csv", "**/r2.csv"])
@pytest.mark.parametrize("change", ["written", "added", "removed"])
def test_one_of_many_files_changed_while_they_are_read_is_noticed(
    tmp_path: Path, named: str, change: str
) -> None:
    runs, out = tmp_path / "runs", tmp_path / "slip.parquet"
    (runs / "deeper").mkdir(parents=True)
    for place in (runs / "r1.csv", runs / "r2.csv", runs / "deeper" / "r2.csv"):
        place.write_text("one")
    recipe = ("slip", ConfigSource(Config(), "test"), ("rig",), {"speedloss": tmp_path / named})

    def meanwhile() -> Outcome[None]:
        if change == "written":
            (runs / "r2.csv").write_text("two")
        elif change == "removed":
            (runs / "r2.csv").unlink()
        else:
            (runs / "new").mkdir()
            for place in (runs / "r3.csv", runs / "new" / "r2.csv"):
                place.write_text("one")
        return outcome()

    with pytest.raises(InputError, match="was changed while it was read"):
        make(recipe, out, Options(), meanwhile)
    assert not out.exists()


def test_a_table_of_runs_changed_while_it_is_read_is_noticed(tmp_path: Path) -> None:
    source, table, out = (tmp_path / n for n in ("rig.csv", "runs.csv", "slip.parquet"))
    source.write_text("one")
    table.write_text("one")
    config = load_config({"runs": {"speedloss": {"table": str(table)}}})
    recipe = ("slip", ConfigSource(config, "test"), ("rig",), {"speedloss": source})

    def meanwhile() -> Outcome[None]:
        table.write_text("two")
        return outcome()

    with pytest.raises(InputError, match=r"runs\.csv: was changed while it was read"):
        make(recipe, out, Options(), meanwhile)
    assert not out.exists()


@pytest.mark.parametrize("kind", schemas.ARTIFACTS)
@pytest.mark.parametrize("fault", ["a flipped bit", "an old schema"])
def test_a_result_that_cannot_be_read_is_built_again_whatever_its_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, fault: str
) -> None:
    source, out = tmp_path / "rig.csv", tmp_path / "out.parquet"
    source.write_text("one")
    recipe = (kind, ConfigSource(Config(), "test"), ("rig",), {"rig": source})
    table = {c.name: np.array([]) for c in schemas.table(kind).columns if c.required}
    computed = Outcome(kind, table, None)
    make(recipe, out, Options(), lambda: computed)
    whole = out.read_bytes()
    if fault == "a flipped bit":
        foot = bytearray(whole)
        foot[-20] ^= 1
        out.write_bytes(bytes(foot))
    else:
        older = replace(schemas.table(kind), version=0)
        with monkeypatch.context() as then:
            then.setitem(schemas.TABLES, kind, older)
            make(recipe, out, Options(force=True), lambda: computed)
    with pytest.raises(ArtifactError, match=r"damaged|schema version 0"):
        read_artifact(out, kind)
    assert not make(recipe, out, Options(), lambda: computed).up_to_date
    assert out.read_bytes() == whole


class Hearing(Reporter):
    def __init__(self) -> None:
        self.heard: list[str] = []

    def line(self, level: Level, text: str) -> None:
        self.heard.append(text)


def test_a_second_batch_in_a_folder_waits_for_the_first(tmp_path: Path) -> None:
    folders = [tmp_path / "b", tmp_path / "a"]
    talk, order = Hearing(), []

    def second() -> None:
        with alone_in(folders[::-1], talk):
            order.append("second")

    with alone_in(folders, Reporter()):
        waiting = threading.Thread(target=second)
        waiting.start()
        waiting.join(timeout=0.3)
        order.append("first")
    waiting.join(timeout=10)
    assert order == ["first", "second"]
    assert talk.heard == [f"{tmp_path / 'a'}: another beltid run is at work there, waiting for it"]


def test_the_lock_of_a_killed_batch_is_gone(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from beltid.batch.folders import alone_in\n"
        "from beltid.stages.reporter import Reporter\n"
        "with alone_in([Path(sys.argv[1])], Reporter()): print('in', flush=True); time.sleep(60)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "in\n"
    process.kill()
    process.communicate()
    talk = Hearing()
    with alone_in([tmp_path], talk):
        assert talk.heard == []


def test_what_dead_writers_left_is_cleared_and_nothing_else(tmp_path: Path) -> None:
    import socket

    host = "".join(c for c in socket.gethostname() if c.isalnum())[:32] or "host"
    dead = f".slip.parquet.{host}-{GONE}-0123abcd.beltid-tmp"
    kept = {f".slip.parquet.{host}-{os.getpid()}-0123abcd.beltid-tmp", "slip.parquet", ".hidden"}
    for name in (dead, *kept):
        (tmp_path / name).write_bytes(b"")
    remove_stale(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == kept
    remove_stale(tmp_path / "missing")


def test_parts_of_a_parquet_folder_changed_while_they_are_read_are_noticed(tmp_path: Path) -> None:
    part, out = tmp_path / "rig" / "a.parquet", tmp_path / "slip.parquet"
    write_bytes(part, b"one")
    recipe = ("slip", ConfigSource(Config(), "test"), ("rig",), {"speedloss": tmp_path / "rig"})

    def meanwhile() -> Outcome[None]:
        write_bytes(part, b"two")
        return outcome()

    with pytest.raises(InputError, match="was changed while it was read"):
        make(recipe, out, Options(), meanwhile)
