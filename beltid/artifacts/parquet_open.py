"""Parquet files opened with care: what they claim is checked before anything is read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from beltid.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

MAX_CELLS: Final = 500_000_000
MAX_EXPANSION: Final = 20_000
"""Cells per byte of file; constant columns pack tightly."""

BUFFER: Final = 1 << 20
"""Bytes of a column that are read at a time."""


def open_parquet(
    source: bytes | Path, labels: Sequence[str], name: str, error_type: type[InputError]
) -> Any:
    """A Parquet file, its claims checked.

    Texts are kept as a dictionary, so that a long one in every row takes the memory of one.

    Parameters
    ----------
    source : bytes or Path
        The bytes of the file, or the file: one that is read in blocks may hold any number of rows.
    labels : sequence of str
        Names of columns of texts.
    name : str
        Name of the file in messages.
    error_type : type
        Error to raise.

    Raises
    ------
    InputError
        Of the type asked for, if it is damaged or claims more than it can hold.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    def opened(texts: list[str]) -> Any:
        data = pa.BufferReader(source) if isinstance(source, bytes) else source
        return pq.ParquetFile(
            data,
            page_checksum_verification=True,
            read_dictionary=texts,
            memory_map=False,
            # what was read ahead would stay until the end of the file, and its whole row group
            pre_buffer=False,
            buffer_size=BUFFER,
        )

    try:
        file = opened([])
        about, there = file.metadata, file.schema_arrow
        if isinstance(source, bytes):
            _refuse_claims(about, len(source), name, error_type)
        texts = [
            text
            for text in dict.fromkeys(labels)
            if there.names.count(text) == 1
            and (
                pa.types.is_string(there.field(text).type)
                or pa.types.is_large_string(there.field(text).type)
            )
        ]
        return opened(texts) if texts else file
    except InputError:
        raise
    except Exception as error:  # a damaged file can raise nearly anything
        raise error_type(f"{name}: {damaged(error)}") from None


def _refuse_claims(about: Any, size: int, name: str, error_type: type[InputError]) -> None:
    cells = about.num_rows * max(1, about.num_columns)
    sizes = [about.row_group(i).total_byte_size for i in range(about.num_row_groups)]
    limit = min(MAX_CELLS, MAX_EXPANSION * size)
    if not (0 <= cells <= limit and all(0 <= claimed <= 8 * limit for claimed in sizes)):
        raise error_type(f"{name}: damaged: it claims {cells:,} values in {size:,} bytes")


def is_number(kind: pa.DataType) -> bool:
    """Whether a type is that of plain numbers: a date or a duration would lose its unit."""
    import pyarrow as pa

    of = pa.types
    return bool(
        of.is_integer(kind) or of.is_floating(kind) or of.is_decimal(kind) or of.is_null(kind)
    )


def damaged(error: BaseException) -> str:
    """Why a file cannot be read, in the words of its library, shortened."""
    return "damaged: " + (" ".join(str(error).split())[:120] or type(error).__name__)


def refused_columns(there: pa.Schema, wanted: Sequence[str], label: str, name: str) -> list[str]:
    """What is wrong with columns that are to be read: given twice, nested, of foreign types.

    Parameters
    ----------
    there : Schema
        The columns of the file.
    wanted : sequence of str
        Their names; those that are missing are not spoken of.
    label : str
        The one that may hold texts.
    name : str
        Name of the file in messages.
    """
    import pyarrow as pa

    problems = []
    for column in dict.fromkeys(wanted):
        count = there.names.count(column)
        if count > 1:
            problems.append(f"{name}: column {column} is there {count} times")
        if count != 1:
            continue
        kind = there.field(column).type
        inner = kind.value_type if pa.types.is_dictionary(kind) else kind
        text = pa.types.is_string(inner) or pa.types.is_large_string(inner)
        if not (is_number(inner) or (text and column == label)):
            allowed = "texts or whole numbers" if column == label else "numbers"
            problems.append(f"{name}: column {column} holds {kind}, must hold {allowed}")
    return problems
