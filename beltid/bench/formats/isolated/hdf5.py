"""Read MATLAB .mat files of version 7.3 and plain HDF5. Runs in the child process.

References to other files (external links, external or virtual datasets) are refused: a recording
is the named file and nothing else.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.formats.bench_file import SCALING, BenchFile, unapplied_scaling
from beltid.bench.formats.isolated.matlab import MAX_DEPTH, Variables
from beltid.errors import InputError

MAX_OBJECTS: Final = 100_000


def read(path: Path) -> BenchFile:
    """Read a MATLAB 7.3 or HDF5 file."""
    import h5py

    with path.open("rb") as stream:
        is_matlab = stream.read(10) == b"MATLAB 7.3"
    with h5py.File(path, "r") as file:
        content = _Content(file).group(file, 0)
    name = "MATLAB, version 7.3" if is_matlab else "HDF5"
    return Variables().bench_file(name, content)


class _Content:
    """Converter of the groups and datasets of a file to nested dicts of plain values."""

    def __init__(self, file: Any) -> None:
        import h5py

        self.file_number = h5py.h5o.get_info(file.id).fileno
        self.object_count = 0

    def group(self, group: Any, depth: int) -> dict[str, Any]:
        """Convert the members of a group."""
        import h5py

        members: dict[str, Any] = {}
        if depth > MAX_DEPTH:
            return members
        for name in group:
            if isinstance(group.get(name, getlink=True), h5py.ExternalLink):
                raise InputError(f"{name} is a link to another file, which is not followed")
            if name.startswith("#"):  # targets of MATLAB references
                continue
            item = group[name]
            if h5py.h5o.get_info(item.id).fileno != self.file_number:  # an indirect link
                raise InputError(f"{name} is a link to another file, which is not followed")
            members[name] = self._value(item, depth)
        for name, value in group.attrs.items():  # plain HDF5 stores settings as attributes
            if not name.startswith("MATLAB") and np.size(value) == 1:
                members.setdefault(name, _text_or_number(value))
        return members

    def _value(self, item: Any, depth: int) -> Any:
        import h5py

        self.object_count += 1
        if self.object_count > MAX_OBJECTS:
            raise InputError(f"holds more than {MAX_OBJECTS} variables")
        if isinstance(item, h5py.Group):
            return self.group(item, depth + 1)
        if not isinstance(item, h5py.Dataset):
            return None
        if item.is_virtual or item.external:
            raise InputError(
                f"{item.name} takes its samples from another file, which is not followed"
            )
        kind = item.attrs.get("MATLAB_class", b"")
        if item.dtype == h5py.ref_dtype:  # a cell array, an array of structs
            return []
        if item.attrs.get("MATLAB_empty", 0):
            return ""
        values = item[()]
        if kind == b"char":
            return "".join(chr(code) for code in np.ravel(values, order="F"))
        if h5py.check_string_dtype(item.dtype) is not None:
            return _texts(values)
        if values.dtype.kind == "V":
            return _table(values)
        unit = next(
            (item.attrs[n] for n in ("unit", "units", "Unit", "Units") if n in item.attrs), None
        )
        for mark in ("_FillValue", "missing_value"):
            if np.isin(item.attrs.get(mark, np.nan), values).any():
                raise InputError(f"{item.name} marks missing samples by a {mark}: export it to CSV")
        array = np.squeeze(np.asarray(values))
        scaling = {n: item.attrs[n] for n in item.attrs if n.lower() in SCALING}
        if array.ndim == 1 and (unit is not None or unapplied_scaling(array, scaling)):
            channel = {"data": array, "unit": "" if unit is None else _text_or_number(unit)}
            return {**scaling, **channel}
        return array


def _texts(values: Any) -> Any:
    """Convert to a text or a list of texts."""
    if np.ndim(values) == 0:
        return _text_or_number(values)
    return [_text_or_number(v) for v in np.ravel(values)]


def _text_or_number(value: Any) -> Any:
    value = value.item() if hasattr(value, "item") else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _table(values: np.ndarray) -> dict[str, Any]:
    """Split a dataset of records into columns."""
    return {
        name: np.ravel(values[name]) if values[name].dtype.kind in "biuf" else _texts(values[name])
        for name in values.dtype.names or ()
    }
