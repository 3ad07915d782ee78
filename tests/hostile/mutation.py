"""Changes to a file that keep most of its structure, so that they get past its first bytes."""

import io
import json
import random
import re
import struct
from collections.abc import Callable, Sequence

NASTY: tuple[str, ...] = (
    "", "0", "-1", "1e999", "-1e308", "nan", "inf", ".inf", "1_000", "²", "٣", "1²3", "=1+1",
    "9" * 400, "9" * 5000, "0x" + "f" * 300, "\0", "\x1b[31m", "\ud7ff\ufffe", "\u2028", "\r",
    '"', "'", "***End_of_Header***", "{[", "&a", "*a", "<<", "? ", "---", "%YAML 9.9", "null",
    "!!python/object/apply:os.system [true]", "true", "[]", "{}", "1,5", "../../x", "kN", "degC",
    " " * 3000 + "x", "a / " * 500, "((((" * 200,
)  # fmt: skip
EXTREMES = (0, 1, -1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1)
SIGNS = (b",", b";", b"\t", b"\r", b"\r\n", b" ", b"", b"\0", b"\xff", b"\xc2\xa0")
_WORD = re.compile(rb"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?|\w+")

Mutator = Callable[[bytes, random.Random, Sequence[bytes]], bytes]


def bytes_changed(data: bytes, dice: random.Random, others: Sequence[bytes] = ()) -> bytes:
    """Bits, fields of 2, 4 and 8 bytes, cuts, repeats, pieces of another file."""
    out = bytearray(data)
    for _ in range(dice.choice((1, 1, 2, 4, 8))):
        if not out:
            return bytes(out)
        # heads of files hold their structure
        at = dice.randrange(min(len(out), dice.choice((64, 1024, 1 << 30))))
        kind = dice.randrange(7)
        if kind == 0:
            out[at] ^= 1 << dice.randrange(8)
        elif kind in (1, 2):
            width = dice.choice("BHIQ")
            size = struct.calcsize(width)
            value = dice.choice(EXTREMES) & (256**size - 1)
            out[at : at + size] = struct.pack(dice.choice("<>") + width, value)
        elif kind == 3:
            del out[at : at + dice.choice((1, 4, 64, len(out)))]
        elif kind == 4:
            out[at:at] = out[at : at + dice.choice((4, 64, 512))]
        elif kind == 5 and others:
            other = dice.choice(others)
            start = dice.randrange(len(other) or 1)
            out[at : at + 32] = other[start : start + 32]
        else:
            out[at : at + 4] = dice.randbytes(4)
    return bytes(out)


def text_changed(data: bytes, dice: random.Random, others: Sequence[bytes] = ()) -> bytes:
    """Words, cells and lines of a text, exchanged for nasty ones, repeated, left out."""
    for _ in range(dice.choice((1, 1, 2, 3))):
        kind = dice.randrange(9)
        words = list(_WORD.finditer(data))
        lines = data.split(b"\n")
        if kind <= 3 and words:
            word = dice.choice(words)
            new = dice.choice(NASTY).encode("utf-8", "surrogatepass")
            data = data[: word.start()] + new + data[word.end() :]
        elif kind == 4:
            i, j = dice.randrange(len(lines)), dice.randrange(len(lines))
            lines[i], lines[j] = lines[j], lines[i]
            data = b"\n".join(lines)
        elif kind == 5:
            i = dice.randrange(len(lines))
            lines[i : i + 1] = [lines[i]] * dice.choice((0, 0, 2, 50))
            data = b"\n".join(lines)
        elif kind == 6:
            old, new = dice.choice(b", ; \t \n : - .".split(b" ")), dice.choice(SIGNS)
            data = data.replace(old, new, dice.choice((1, -1)))
        elif kind == 7:
            at = dice.randrange(len(data) + 1)
            new = dice.choice(NASTY).encode("utf-8", "surrogatepass")
            data = data[:at] + new * dice.choice((1, 1, 30)) + data[at:]
        else:
            data = bytes_changed(data, dice, others)
        data = data[: 1 << 18]
    return data


def parquet_changed(data: bytes, dice: random.Random, others: Sequence[bytes] = ()) -> bytes:
    """Columns, types and metadata of a Parquet file, sealed again; or the file itself."""
    if dice.random() < 0.6:
        try:
            return _rewritten(data, dice)
        except Exception:  # what was changed before is no file of its kind any more
            pass
    return bytes_changed(data, dice, others)


def _rewritten(data: bytes, dice: random.Random) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    from beltid.store.artifact import RECORD_KEY, SEAL_KEY
    from beltid.store.disk import sha256

    table = pq.read_table(pa.BufferReader(data))
    metadata = dict(table.schema.metadata or {})
    name = dice.choice(table.column_names)
    index = table.column_names.index(name)
    kind = dice.randrange(6)
    if kind == 0:
        n = table.num_rows
        cell, form = dice.choice((
            (None, None), ("x", None), (b"\xff", None), (float("inf"), None), (float("nan"), None),
            ([1.0], None), ({"a": 1}, None), (2**63, pa.uint64()), (0, pa.timestamp("ns")),
            (0, pa.date32()), (0, pa.duration("s")), ("x", pa.dictionary(pa.int32(), pa.string())),
            (True, None), (None, pa.decimal128(38, 2)),
        ))  # fmt: skip
        table = table.set_column(index, name, pa.array([cell] * n, form))
    elif kind == 1:
        table = table.remove_column(index)
    elif kind == 2:
        table = table.append_column(name, table.column(name))  # a name twice
    elif kind == 3:
        table = table.slice(0, dice.choice((0, 1)))
    elif RECORD_KEY in metadata:
        text = metadata[RECORD_KEY].decode()
        if kind == 4:
            record = json.loads(text)
            key = dice.choice(list(record))
            record[key] = dice.choice((None, 1, "x", [], {}, [[1]], {"x": {"y": None}}, 1e400))
            text = json.dumps(record)
        else:
            text = text_changed(text.encode(), dice).decode("utf-8", "replace")
        metadata[RECORD_KEY] = text.encode()
        metadata[SEAL_KEY] = sha256(text.encode()).encode()
    out = io.BytesIO()
    pq.write_table(table.replace_schema_metadata(metadata), out, write_page_checksum=True)
    return out.getvalue()


MUTATORS: dict[str, Mutator] = {
    **dict.fromkeys(("artifact", "parquet"), parquet_changed),
    **dict.fromkeys(("yaml", "law", "csv", "press", "speedloss", "lvm", "zwick"), text_changed),
    **dict.fromkeys(("gzip", "zip", "xlsx", "tdms", "mdf", "mat", "hdf5", "uff"), bytes_changed),
}
"""Reader -> how its files are changed."""
