"""From the columns of a press recording to the curves of its tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.press.curves import PressCurve, press_curve
from beltid.identify.press.cycles import choose_cycles, find_cycles
from beltid.identify.press.preparation import prepare_test
from beltid.identify.press.result import StiffnessSettings

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PressRecording:
    """Curves of the usable tests and the account of the rest.

    Attributes
    ----------
    curves : tuple of PressCurve
        One per chosen cycle, in the order of the recording.
    set_aside : tuple of (str, str)
        Tests that are not used, with the reason.
    n_missing, n_spikes : int
        Samples left out of the tests used.
    notes : tuple of str
        What the user should know.
    """

    curves: tuple[PressCurve, ...]
    set_aside: tuple[tuple[str, str], ...]
    n_missing: int
    n_spikes: int
    notes: tuple[str, ...]


def read_tests(press: Mapping[str, NDArray], settings: StiffnessSettings) -> PressRecording:
    """Clean the tests of a recording, choose their cycles and bring the branches together.

    Parameters
    ----------
    press : mapping of str to ndarray
        Columns of the recording, see :func:`beltid.identify.press.stiffness.fit_stiffness`.
    settings : StiffnessSettings
        Segment length, machine compliance, choice of cycles.

    Raises
    ------
    InputError
        If columns are missing or no test can be used; every problem is named.
    """
    columns = _columns(press)
    labels = np.asarray(press["test"]).astype(str)
    curves: list[PressCurve] = []
    notes: list[str] = []
    set_aside: list[tuple[str, str]] = []
    n_missing = n_spikes = 0
    for label in dict.fromkeys(labels.tolist()):
        rows = labels == label
        part = {name: values[rows] for name, values in columns.items()}
        try:
            found, said, missing, spikes = _one_test(label, part, settings)
        except InputError as error:
            set_aside.append((label, "; ".join(error.problems)))
            continue
        curves.extend(found)
        notes.extend(said)
        n_missing += missing
        n_spikes += spikes
    if any(c.unloads for c in curves):
        alone = {c.test for c in curves if not c.unloads}
        set_aside += [(t, f"test {t}: never unloaded, while other tests are") for t in alone]
        notes = [n for n in notes if not any(n.startswith(f"test {t}: ") for t in alone)]
        curves = [c for c in curves if c.unloads]
    if not curves:
        raise InputError([reason for _, reason in set_aside] or "press recording: no samples")
    notes += [f"set aside: {reason}" for _, reason in set_aside]
    return PressRecording(tuple(curves), tuple(set_aside), n_missing, n_spikes, _merged(notes))


def _columns(press: Mapping[str, NDArray]) -> dict[str, Array]:
    needed = ("time_s", "displacement_mm", "force_N")
    absent = [name for name in ("test", *needed) if name not in press]
    if absent:
        raise InputError([f"press recording: column {name} is missing" for name in absent])
    columns = {name: np.asarray(press[name], dtype=float) for name in needed}
    n = np.asarray(press["test"]).size
    temperature = press.get("temperature_degC")
    columns["temperature_degC"] = (
        np.full(n, np.nan) if temperature is None else np.asarray(temperature, dtype=float)
    )
    wrong = [f"{name} {v.shape}" for name, v in columns.items() if v.shape != (n,)]
    if wrong:
        raise InputError(f"press recording: columns {', '.join(wrong)}, must be ({n},) as test is")
    return columns


def _one_test(
    label: str, part: dict[str, Array], settings: StiffnessSettings
) -> tuple[list[PressCurve], list[str], int, int]:
    """Curves and notes of one test, with the numbers of missing samples and spikes."""
    clock = part["time_s"][np.isfinite(part["time_s"])]
    if np.any(np.diff(clock) < 0.0):
        at = float(clock[:-1][np.diff(clock) < 0.0][0])
        raise InputError(f"test {label}: time_s falls after {at:g} s, must not run backwards")
    test = prepare_test(
        label,
        part["time_s"],
        settings.displacement_gain * part["displacement_mm"],
        settings.force_gain * part["force_N"],
        part["temperature_degC"],
        settings.machine_compliance_m_N,
    )
    cycles = find_cycles(test)
    chosen, said = choose_cycles(label, cycles, settings.cycles)
    notes = [*test.notes, *said]
    if len(cycles) > 1:
        numbers = ", ".join(str(c.number) for c in chosen)
        notes.append(f"test {label}: {len(cycles)} cycles found, used: {numbers}")
    if not test.free_travel:
        notes.append(
            f"test {label}: too little travel before contact to check the zero of the load cell"
        )
    found = [press_curve(test, cycle, settings.segment_length_m) for cycle in chosen]
    gains = (("force", settings.force_gain), ("displacement", settings.displacement_gain))
    notes += [f"test {label}: {name} gain {gain:g} applied" for name, gain in gains if gain != 1.0]
    return found, notes, test.n_missing, test.n_spikes


def _merged(notes: list[str]) -> tuple[str, ...]:
    """Notes of several tests that say the same, as one note."""
    tests: dict[str, list[str]] = {}
    for note in notes:
        place, colon, text = note.partition(": ")
        if colon and place.startswith("test "):
            tests.setdefault(text, []).append(place.removeprefix("test "))
        else:
            tests.setdefault(note, [])
    return tuple(
        f"test{'s' if len(labels) > 1 else ''} {', '.join(labels)}: {text}" if labels else text
        for text, labels in tests.items()
    )
