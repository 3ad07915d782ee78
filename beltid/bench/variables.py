"""Files of variables: MATLAB 4, 5 and 7.3, HDF5.

A vector is a column, a number or text a header field, a struct or group of vectors a table; a
struct of samples (``data``) with a ``unit`` is a column.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.raw import SCALING, UNITS, Field, Rasters, Raw, unapplied_scaling
from beltid.errors import InputError

SAMPLES: Final = ("data", "values", "value", "y")
TIMES: Final = ("time", "t", "x", "Time")


def read_matlab(path: Path, place: str) -> Iterator[Raw]:
    """Read a MATLAB file of version 5 or 4."""
    from scipy.io import loadmat

    with path.open("rb") as stream:
        content = loadmat(stream, squeeze_me=True, simplify_cells=True)
    members = {k: v for k, v in content.items() if not k.startswith("__")}
    yield from _tables(members, place, "MATLAB, version 5")


def read_hdf5(path: Path, place: str) -> Iterator[Raw]:
    """Read HDF5 or a MATLAB file of version 7.3; links, which may leave the file, are refused."""
    import h5py

    with path.open("rb") as stream:
        form = "MATLAB, version 7.3" if stream.read(10) == b"MATLAB 7.3" else "HDF5"
    with h5py.File(path, "r") as file:
        yield from _tables(_group(file, place), place, form)


def _group(group: Any, place: str) -> dict[str, Any]:
    """Convert the members of a group of HDF5, and its attributes, to nested dicts."""
    import h5py

    members: dict[str, Any] = {}
    for name in (name for name in group if not name.startswith("#")):
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise InputError(f"{place}: {name} is a link, which is not followed")
        item = group[name]
        members[name] = _group(item, place) if isinstance(item, h5py.Group) else _dataset(item)
    for name, value in group.attrs.items():  # plain HDF5 stores settings as attributes
        if not name.startswith("MATLAB") and np.size(value) == 1:
            members.setdefault(name, _plain(value))
    return members


def _dataset(item: Any) -> Any:
    """Convert a dataset: an array, a text, or a struct with a unit; None for any other."""
    import h5py

    attributes = dict(item.attrs)
    # in other files, cells and arrays of structs, records, no numbers at all
    if item.is_virtual or item.external or item.dtype == h5py.ref_dtype or item.dtype.names:
        return None
    if attributes.get("MATLAB_empty", 0):
        return None
    values = np.squeeze(np.asarray(item[()]))
    if attributes.get("MATLAB_class", b"") == b"char":
        return "".join(chr(code) for code in np.ravel(values))
    if values.dtype.kind in "OS":
        return np.array([_plain(v) for v in np.ravel(values)], dtype=object)
    scaling = {n: v for n, v in attributes.items() if n.lower() in SCALING}
    unit = next((_plain(v) for n, v in attributes.items() if n in UNITS), None)
    if values.ndim == 1 and (unit is not None or unapplied_scaling(values, scaling)):
        return {**scaling, "unit": unit or "", "data": values}
    return values


def _plain(value: Any) -> Any:
    value = np.ravel(value)[0] if np.size(value) == 1 and not isinstance(value, str) else value
    value = value.item() if hasattr(value, "item") else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _tables(members: Mapping[str, Any], place: str, form: str) -> Iterator[Raw]:
    """Yield the tables in variables; InputError if there is none."""
    left_out: list[str] = []
    tables = list(_struct("", members, place, form, left_out, ()))
    if not tables:
        held = ", ".join(left_out) or ", ".join(members) or "nothing"
        raise InputError(
            f"{place}: holds no vector of samples (found: {held}); save vectors, or a struct of "
            "vectors"
        )
    yield from tables


def _struct(
    name: str,
    members: Mapping[str, Any],
    place: str,
    form: str,
    left_out: list[str],
    above: tuple[Field, ...],
) -> Iterator[Raw]:
    """Yield the table of a struct, then those of the structs in it."""
    units: Any = next((members[n] for n in UNITS if isinstance(members.get(n), Mapping)), {})
    rasters, fields, inner = Rasters(place, name, form), [*above], dict[str, Mapping[str, Any]]()
    for key, value in members.items():
        array, unit = np.asarray(value), str(units.get(key, ""))
        is_text = array.dtype.kind in "SU" or all(isinstance(v, str) for v in array.flat)
        if isinstance(value, Mapping):
            if value is not units and not _channel(key, value, rasters):
                inner[f"{name}.{key}" if name else key] = value
        elif array.size == 1 and array.dtype.kind in "biufOSU" and value is not None:
            fields.append(Field(key, str(_plain(array)), unit))
        elif array.ndim == 1 and array.size and (array.dtype.kind in "biuf" or is_text):
            rasters.add(key, array, unit)
        elif array.size:
            left_out.append(f"{key} left out: no list of numbers or texts")
    rasters.fields, rasters.notes = tuple(fields), [*left_out]
    yield from rasters.tables()
    for inner_name, struct in inner.items():
        yield from _struct(inner_name, struct, place, form, left_out, tuple(fields))


def _channel(key: str, members: Mapping[str, Any], rasters: Rasters) -> bool:
    """Add a struct of samples with a unit as a channel; return whether it is one."""
    samples = next((members[n] for n in SAMPLES if n in members), None)
    unit = next((members[n] for n in UNITS if n in members), None)
    values = np.squeeze(np.asarray(samples))
    if unit is None or values.dtype.kind not in "biuf" or values.ndim != 1 or values.size < 2:
        return False
    time = np.squeeze(np.asarray(next((members[n] for n in TIMES if n in members), np.nan)))
    clock = time.astype(float) if time.shape == values.shape and time.dtype.kind in "iuf" else None
    rasters.add(key, values, str(unit), clock, unapplied_scaling(values, members))
    return True
