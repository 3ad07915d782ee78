"""Files of variables: MATLAB 5 and 7.3, HDF5, Parquet; and tables in memory.

A vector is a column, a number or text a header field, a struct or group of vectors a table.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import types

from beltid.bench.numbers import word_of
from beltid.bench.raw import UNITS, Field, Raw, Written, plain, tables_of, written
from beltid.errors import InputError
from beltid.store.parquet import damaged, open_parquet

LONGEST_TEXT: Final = 1000  # bytes of a text; a file can repeat a long one in every row at no cost


Variables = Mapping[str, "Written | Variables"]


def read_matlab(path: Path, place: str) -> Iterator[Raw]:
    """Read a MATLAB file of version 5."""
    from scipy.io import loadmat

    with path.open("rb") as stream:
        content = loadmat(stream, squeeze_me=True, simplify_cells=True)
    members = {k: v for k, v in content.items() if not k.startswith("__")}
    yield from _tables(_struct(members), place, "MATLAB, version 5")


def _struct(members: Mapping[str, Any]) -> Variables:
    """Return the members of a struct; one named units may hold those of the others."""
    units: Any = next((members[n] for n in UNITS if isinstance(members.get(n), dict)), {})
    return {
        name: _struct(of) if isinstance(of, dict) else Written(name, of, units.get(name, ""))
        for name, of in members.items()
        if of is not units
    }


def read_hdf5(path: Path, place: str) -> Iterator[Raw]:
    """Read HDF5 or a MATLAB file of version 7.3; links, which may leave the file, are refused."""
    import h5py

    with path.open("rb") as stream:
        form = "MATLAB, version 7.3" if stream.read(10) == b"MATLAB 7.3" else "HDF5"
    with h5py.File(path, "r") as file:
        yield from _tables(_group(file, place), place, form)


def _group(group: Any, place: str) -> Variables:
    """Return the members of a group of HDF5, and its attributes, which may be settings."""
    import h5py

    about = {n: v for n, v in group.attrs.items() if not n.startswith("MATLAB") and np.size(v) == 1}
    members: dict[str, Any] = {name: Written(name, plain(value)) for name, value in about.items()}
    for name in (name for name in group if not name.startswith("#")):
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise InputError(f"{place}: {name} is a link, which is not followed")
        item = group[name]
        is_group = isinstance(item, h5py.Group)
        members[name] = _group(item, place) if is_group else _dataset(name, item)
    return members


def _dataset(name: str, item: Any) -> Written:
    """Return a dataset: numbers or texts; None for one in another file, and for any other."""
    import h5py

    about = dict(item.attrs)
    is_elsewhere = item.is_virtual or bool(item.external)
    if is_elsewhere or item.dtype == h5py.ref_dtype or about.get("MATLAB_empty", 0):
        return Written(name, None)
    values = np.squeeze(np.asarray(item[()]))
    if about.get("MATLAB_class", b"") == b"char":
        return Written(name, "".join(chr(code) for code in np.ravel(values)))
    if values.dtype.kind in "OS":
        values = np.array([plain(v) for v in np.ravel(values)], dtype=object)
    return written(name, values, about)


def _tables(members: Variables, place: str, form: str) -> Iterator[Raw]:
    """Yield the tables in variables; InputError if there is none."""
    left_out = list[str]()
    tables = list(_of_struct("", members, (), left_out, place, form))
    if not tables:
        held = ", ".join(left_out) or ", ".join(members) or "nothing"
        raise InputError(
            f"{place}: holds no vector of samples (found: {held}); save vectors, or a struct of "
            "vectors"
        )
    yield from tables


def _of_struct(
    name: str,
    members: Variables,
    above: Sequence[Field],
    left_out: list[str],
    place: str,
    form: str,
) -> Iterator[Raw]:
    """Yield the table of a struct, then those of the structs in it."""
    fields, found, structs = [*above], list[Written](), dict[str, Variables]()
    for key, member in members.items():
        if not isinstance(member, Written):
            structs[f"{name}.{key}" if name else key] = member
            continue
        array = np.asarray(member.values)
        is_text = array.dtype.kind in "SU" or all(isinstance(v, str) for v in array.flat)
        if array.size == 1 and array.dtype.kind in "biufOSU" and member.values is not None:
            fields.append(Field(key, str(plain(array)), member.unit))
        elif array.ndim == 1 and array.size and (array.dtype.kind in "biuf" or is_text):
            found.append(member)
        elif array.size:
            left_out.append(f"{key} left out: no list of numbers or texts")
    yield from tables_of(place, name, form, found, fields, left_out)
    for inner, struct in structs.items():
        yield from _of_struct(inner, struct, fields, left_out, place, form)


# --- Parquet and tables in memory ----------------------------------------------------------------


def read_parquet(path: Path, place: str) -> Iterator[Raw]:
    """Read a Parquet file."""
    file = open_parquet(path.read_bytes(), place, InputError)
    try:
        table = file.read()
        table.validate(full=True)
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{place}: {damaged(error)}") from None
    yield table_of(table, place)


def table_of(table: pa.Table, place: str) -> Raw:
    """Return an Arrow table as written; a column that is neither numbers nor texts is left out."""
    columns, units, left_out = {}, {}, []
    for field, values in zip(table.schema, table.columns, strict=True):
        name, kind = field.name, values.type
        if name in columns:
            raise InputError(f"{place}: column {name} occurs several times, must be once")
        if unit := (field.metadata or {}).get(b"unit", b"").decode(errors="replace"):
            units[name] = unit
        if types.is_duration(kind):
            nanoseconds = values.cast(pa.duration("ns")).cast(pa.int64()).to_numpy()
            columns[name], units[name] = nanoseconds / 1e9, "s"
        elif (
            types.is_null(kind)
            or types.is_decimal(kind)
            or types.is_integer(kind)
            or types.is_floating(kind)
        ):
            columns[name] = values.cast(pa.float64(), safe=False).to_numpy()
        elif (
            types.is_nested(kind) or types.is_binary(kind) or isinstance(kind, pa.BaseExtensionType)
        ):
            left_out.append(f"column {name} holds {kind}, left out")
        else:  # texts; times and true or false as texts
            columns[name] = _texts(values, f"{place}: column {name}")
    frame = pd.DataFrame(columns, copy=False)
    return Raw(place, frame, format="Parquet", units=units, notes=tuple(left_out))


def _texts(values: pa.ChunkedArray, place: str) -> Any:
    """Return a column as texts, none of them long."""
    for chunk in values.chunks:
        words = chunk.dictionary if types.is_dictionary(chunk.type) else chunk
        is_text = types.is_string(words.type) or types.is_large_string(words.type)
        if is_text and (pc.max(pc.binary_length(words)).as_py() or 0) > LONGEST_TEXT:
            raise InputError(f"{place} holds texts of more than {LONGEST_TEXT} bytes")
    return pd.array(values.cast(pa.large_string()), dtype="str")


def frame_of(frame: Any, place: str) -> Raw:
    """Return a DataFrame, pyarrow Table or mapping as written; what is no list is left out."""
    if not (isinstance(frame, Mapping) or hasattr(frame, "columns")):
        raise InputError(
            f"{place}: is a {type(frame).__name__}, must be a DataFrame, an Arrow table or a dict "
            "of columns"
        )
    names = getattr(frame, "column_names", getattr(frame, "columns", frame))
    columns = {str(name): frame[name] for name in dict.fromkeys(names)}
    lists = {name: _arrow(values) for name, values in columns.items() if np.ndim(values) == 1}
    lengths = sorted({len(values) for values in lists.values()})
    if len(lengths) > 1:
        raise InputError(f"{place}: the columns have different lengths {lengths}")
    if lengths in ([], [0]):
        raise InputError(f"{place}: holds no samples")
    return table_of(pa.table(lists), place)


def _arrow(values: Any) -> Any:
    """Return a list as an Arrow array, of texts if its values are of several types."""
    if isinstance(values, (pa.Array, pa.ChunkedArray)):
        return values
    try:
        return pa.array(values, from_pandas=True)
    except (pa.ArrowException, ValueError, TypeError):
        return pa.array([word_of(value) for value in values], pa.string())
