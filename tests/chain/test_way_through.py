"""The way of a tidy CSV file through the program: how many of our files it enters, how often the
recording is opened.

Both are counted in a process of its own, from the start of the command line to its end. A file is
entered when one of its functions is called; what runs while modules are imported does not count.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

RIGDATA = Path(__file__).parents[2] / "rigdata"
MOST_FILES = 60
MOST_OPENS = 5
"""To hash it, to recognise it (format, encoding, header, clock) and to read it block by block."""
COUNTER = """
import inspect, json, os, sys, threading
from pathlib import Path

recording, counts = os.path.realpath(sys.argv[2]), sys.argv.pop()
import numpy, pyarrow.csv, pyarrow.parquet, pydantic, rich.console, scipy.signal, typer  # uncounted
import beltid
house = str(Path(beltid.__file__).parent) + os.sep
opens, entered, importing = [], set(), "<module>"

def opened(event, arguments):
    if event == "open" and isinstance(arguments[0], (str, bytes)):
        if os.path.realpath(os.fsdecode(arguments[0])) == recording:
            opens.append(arguments[1])

def called(frame, event, argument):
    code = frame.f_code
    if event != "call" or not code.co_filename.startswith(house) or code.co_filename in entered:
        return
    while frame is not None:
        if frame.f_code.co_name == importing and frame.f_code.co_filename.startswith(house):
            return
        frame = frame.f_back
    entered.add(code.co_filename)

sys.addaudithook(opened)
threading.setprofile(called)
sys.setprofile(called)
from beltid.__main__ import main
try:
    main()
finally:
    sys.setprofile(None)
    found = {"files": sorted(name[len(house):] for name in entered), "opens": len(opens)}
    Path(counts).write_text(json.dumps(found), "utf-8")
"""


@pytest.fixture(scope="module")
def counts(tmp_path_factory, part_of_rig):
    folder = tmp_path_factory.mktemp("way")
    rig, counts = folder / "rig.csv", folder / "counts.json"
    rig.write_text(part_of_rig((40, 82), (100, 411), (0.05, 0.10)))
    shutil.copy(RIGDATA / "beltid.yaml", folder)  # found for the recording
    called = [sys.executable, "-c", COUNTER, "fit-friction", str(rig), str(counts)]
    ended = subprocess.run(
        called, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, capture_output=True
    )
    assert ended.returncode == 0, ended.stderr.decode()
    assert (folder / "friction.parquet").exists()
    return json.loads(counts.read_text("utf-8"))


def test_few_of_our_files_are_entered(counts):
    assert len(counts["files"]) <= MOST_FILES, counts["files"]


def test_the_recording_is_opened_to_hash_recognise_and_read_it(counts):
    assert counts["opens"] <= MOST_OPENS
