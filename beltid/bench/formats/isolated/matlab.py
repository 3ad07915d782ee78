"""Read MATLAB .mat files of version 5 (and 4): vectors and structs.

Runs in the child process. `Variables` converts nested variables of this version or 7.3 to groups
of channels: a vector becomes a channel, a number or text a header field, a struct a group; a
struct with samples in ``data`` or ``values`` and a ``unit`` becomes a channel.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.formats.bench_file import BenchFile, Channel, Field, Group, unapplied_scaling
from beltid.errors import InputError

MAX_DEPTH: Final = 6
SAMPLES: Final = ("data", "values", "value", "y")
UNITS: Final = ("unit", "units", "Unit", "Units", "unit_string")
TIMES: Final = ("time", "t", "x", "Time")


def read(path: Path) -> BenchFile:
    """Read a MATLAB file of version 5 or 4."""
    from scipy.io import loadmat

    with path.open("rb") as stream:
        content = loadmat(stream, squeeze_me=True, struct_as_record=False, chars_as_strings=True)
    variables = {k: _plain(v) for k, v in content.items() if not k.startswith("__")}
    return Variables().bench_file("MATLAB, version 5", variables)


def _plain(value: Any) -> Any:
    """Convert scipy structs to dicts, and cell arrays to lists."""
    if hasattr(value, "_fieldnames"):
        return {name: _plain(getattr(value, name)) for name in value._fieldnames}
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        if type(value).__name__ == "MatlabOpaque":
            return None
        return value.ravel().tolist()
    if isinstance(value, np.ndarray) and value.dtype.kind == "V":
        return None
    return value


class Variables:
    """Converter of nested variables to groups of channels and header fields."""

    def __init__(self) -> None:
        self.groups: list[Group] = []
        self.notes: list[str] = []

    def bench_file(self, format_name: str, variables: Mapping[str, Any]) -> BenchFile:
        """Convert the variables of a file."""
        fields = self._struct("", variables, 0)
        if not self.groups:
            held = ", ".join(self.notes) or ", ".join(variables) or "nothing"
            raise InputError(
                f"holds no vector of samples (found: {held}); save vectors, or a struct of vectors"
            )
        return BenchFile(format_name, tuple(self.groups), fields, tuple(self.notes))

    def _struct(self, name: str, members: Mapping[str, Any], depth: int) -> tuple[Field, ...]:
        """Add the channels of a struct as a group; return its header fields."""
        if depth > MAX_DEPTH:
            self.notes.append(f"{name} left out: structs nested more than {MAX_DEPTH} deep")
            return ()
        units = _units_of(members)
        unit_of = {key: str(text) for key, text in units.items()}
        channels: list[Channel] = []
        fields: list[Field] = []
        inner: list[tuple[str, Mapping[str, Any]]] = []
        for key, value in members.items():
            if isinstance(value, Mapping):
                channel = _channel_struct(key, value)
                if channel is not None:
                    channels.append(channel)
                elif value is not units:
                    inner.append((f"{name}.{key}" if name else key, value))
            elif not isinstance(value, list):
                self._leaf(key, value, unit_of, channels, fields)
            elif len(value) > 1 and all(isinstance(item, str) for item in value):
                channels.append(Channel(key, "", np.array(value, dtype=object)))
            else:
                self.notes.append(f"{key} left out: cells or an array of structs, name each struct")
        place = len(self.groups)
        group_fields = tuple(fields)
        for inner_name, value in inner:
            before = len(self.groups)
            inner_fields = self._struct(inner_name, value, depth + 1)
            if len(self.groups) == before:  # a struct of settings only
                group_fields += inner_fields
        if channels:
            self.groups.insert(place, Group(name, tuple(channels), group_fields if name else ()))
        return group_fields

    def _leaf(
        self,
        key: str,
        value: Any,
        units: Mapping[str, str],
        channels: list[Channel],
        fields: list[Field],
    ) -> None:
        if value is None:
            self.notes.append(f"{key} left out: a MATLAB object (a table?), save it as a struct")
            return
        array = np.asarray(value)
        if array.dtype.kind in "US":
            if array.ndim == 0:
                fields.append(Field(key, str(array)))
            elif array.ndim == 1 and array.size > 1:
                texts = np.empty(array.size, dtype=object)
                texts[:] = [str(text).strip() or None for text in array]
                channels.append(Channel(key, "", texts))
            return
        if array.dtype.kind not in "biuf":
            self.notes.append(f"{key} left out: not real numbers")
        elif array.size == 1:
            fields.append(Field(key, repr(float(array.ravel()[0])), units.get(key, "")))
        elif array.ndim > 1 and sum(n > 1 for n in array.shape) > 1:
            shape = " x ".join(str(n) for n in array.shape)
            self.notes.append(f"{key} left out: a {shape} matrix, its columns have no names")
        elif array.size:
            channels.append(Channel(key, units.get(key, ""), array.ravel().astype(float)))


def _units_of(members: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the struct ``units`` with the units of the vectors; empty if there is none."""
    for name in UNITS:
        units = members.get(name)
        if isinstance(units, Mapping) and all(_is_text(text) for text in units.values()):
            return units
    return {}


def _is_text(value: Any) -> bool:
    return np.ndim(value) == 0 and np.asarray(value).dtype.kind in "US"


def _channel_struct(key: str, members: Mapping[str, Any]) -> Channel | None:
    """Convert a struct of samples with a unit to a channel; None for any other struct."""
    samples = next((members[n] for n in SAMPLES if n in members), None)
    unit = next((members[n] for n in UNITS if n in members), None)
    if samples is None or unit is None or isinstance(samples, (Mapping, list)):
        return None
    values = np.asarray(samples)
    if values.dtype.kind not in "biuf" or values.size < 2:
        return None
    time = next((members[n] for n in TIMES if n in members), None)
    clock = None if time is None else np.asarray(time)
    if clock is not None and (clock.dtype.kind not in "biuf" or clock.size != values.size):
        clock = None
    return Channel(
        key,
        str(unit),
        values.ravel().astype(float),
        None if clock is None else clock.ravel().astype(float),
        unapplied_scaling(values, members),
    )
