"""Universal files: those of another writer, and every layout of the published format."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

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


def dataset(
    label: str, unit: str, x: np.ndarray, y: np.ndarray, layout: tuple[int, int, str], kind: int = 0
) -> bytes:
    """A dataset 58 as the format is published: type of ordinates, spacing, text or byte order."""
    precision, even, order = layout
    head = [
        f"{label:<80}", *["NONE"] * 4,
        f"{1:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{1:10d}{3:4d} {'NONE':<10}{0:10d}{0:4d}",
        f"{kind or precision:10d}{len(y):10d}{even:10d}{x[0]:13.5E}{x[1] - x[0]:13.5E}{0:13.5E}",
        f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':<20} {'s':<20}",
        f"{13:10d}{0:5d}{0:5d}{0:5d} {label:<20} {unit:<20}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}",
    ]  # fmt: skip
    values = y[:, None] if even else np.column_stack([x, y])
    if order:
        signs = ("" if even else "f") + {2: "f", 4: "d"}[precision]
        samples = b"".join(struct.pack(order + signs, *row) for row in values)
        numbers = ("<>".index(order) + 1, 2, 11, len(samples), 0, 0, 0, 0)
        mark = f"{58:6d}b" + "{:6d}{:6d}{:12d}{:12d}{:6d}{:6d}{:12d}{:12d}".format(*numbers)
    else:
        wide = {2: "{:13.5E}", 4: "{:20.12E}"}[precision]
        cells = [
            "".join(
                ("{:13.5E}" if len(row) > 1 and i == 0 else wide).format(v)
                for i, v in enumerate(row)
            )
            for row in values
        ]
        a_line = {(2, 1): 6, (2, 0): 3, (4, 1): 4, (4, 0): 2}[precision, even]
        rows = ["".join(cells[i : i + a_line]) for i in range(0, len(cells), a_line)]
        samples, mark = ("\n".join(rows) + "\n").encode(), f"{58:6d}"
    lines = [f"{-1:6d}", mark, *head]
    return "".join(line + "\n" for line in lines).encode() + samples + f"{-1:6d}\n".encode()


def both(layout: tuple[int, int, str]) -> bytes:
    """Force and travel in one layout; evenly spaced both at the even times."""
    precision, even, order = layout
    travel = np.interp(T, UNEVEN, TRAVEL) if even else TRAVEL
    return dataset("Kraft", "N", T, FORCE, (precision, 1, order)) + dataset(
        "Weg", "mm", T if even else UNEVEN, travel, layout
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d[:-8], r"P1.unv: damaged: the last dataset"),
        (lambda d: d[: len(d) // 4] + d[len(d) // 4 + 4 :], "damaged"),
        (lambda d: d.replace(b"        50", b"        51"), "50 samples found, the header"),
        (lambda d: d.replace(b"        17", b"        18"), "no dataset 58"),
        (lambda d: d.replace(b"         4        50", b"         6        50"), "no dataset 58"),
        (lambda d: b"    -1\n   151\nmodel\n    -1\n", "no dataset 58"),
    ],
)  # fmt: skip
def test_what_is_damaged_or_not_read_is_reported(tmp_path, change, words):
    path = tmp_path / "P1.unv"
    path.write_bytes(change(both((4, 1, ""))))
    with pytest.raises(InputError, match=words):
        read_recording(path, "press")
