"""Universal files: those of another writer, and every layout of the published format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from golden import files_written as w

from beltid.bench.recording import Recording, read_recording
from beltid.errors import InputError

DATA = Path(__file__).parent / "data"
N = 50
T = np.arange(N) * 0.02
FORCE = np.round(100 * np.sin(3 * T) ** 2 + 950 * T, 3)
TRAVEL = np.round(0.5 * T + 0.01 * np.sin(T), 5)
UNEVEN = np.round(T + 0.003 * np.sin(np.arange(N)), 5)


def check(recording: Recording, digits: float) -> None:
    """The force at its own times; the travel, uneven in time, brought to them."""
    time = recording.columns["time_s"]
    force, travel = recording.columns["force_N"], recording.columns["displacement_mm"]
    np.testing.assert_allclose(force, np.interp(time, T, FORCE), rtol=digits, atol=1e-9)
    np.testing.assert_allclose(travel, np.interp(time, UNEVEN, TRAVEL), rtol=digits, atol=1e-9)
    assert len(time) >= N - 2
    assert "read Kraft [N] as force_N" in recording.notes


PYUFF = {"single": 1e-5, "double": 1e-11, "binary": 1e-12}


@pytest.mark.parametrize(("kind", "digits"), PYUFF.items())
def test_files_that_pyuff_wrote(kind, digits):
    check(read_recording(DATA / f"uff58-{kind}.unv", "press"), digits)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d[:-8], r"P1.unv: damaged: the last dataset"),
        (lambda d: d[: len(d) // 4] + d[len(d) // 4 + 4 :], "damaged"),
        (lambda d: d.replace(b"       200", b"       201"), "200 samples found, the header"),
        (lambda d: d.replace(b"        17", b"        18"), "no dataset 58"),
        (lambda d: d.replace(b"         4       200", b"         6       200"), "no dataset 58"),
        (lambda d: b"    -1\n   151\nmodel\n    -1\n", "no dataset 58"),
    ],
)  # fmt: skip
def test_what_is_damaged_or_not_read_is_reported(tmp_path, change, words):
    path = tmp_path / "P1.unv"
    path.write_bytes(change(w.uff(even=True)))
    with pytest.raises(InputError, match=words):
        read_recording(path, "press")
