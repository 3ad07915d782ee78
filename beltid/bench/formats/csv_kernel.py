"""Numbers of clean CSV rows, compiled: for recordings too big for comfort.

Exact: the digits of a number are a whole number up to 2**53, divided or multiplied by a power of
ten below 10**23; both are exact in double precision, so that one correctly rounded operation gives
the nearest double, as any exact reader does. Whatever is not that simple (a missing word, a
quotation mark, more digits, a ragged row) is left to the exact reader.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from beltid.rigsim.compiled import kernel, leaf

POWERS_OF_TEN: Final = 10.0 ** np.arange(23)
GOOD: Final = 0
NOT_SIMPLE: Final = 1

TRY_AGAIN: Final = 64
"""Rows after which a cell is compared with an earlier one again."""

_LINE_FEED: Final = 10
_RETURN: Final = 13
_QUOTE: Final = 34
_POINT: Final = 46
_MINUS: Final = 45
_PLUS: Final = 43
_ZERO: Final = np.uint8(48)
_NINE: Final = np.uint8(9)
_LARGE_E: Final = 69
_SMALL_E: Final = 101
_MOST_FIGURES: Final = 18  # fewer than overflow the 64 bits of the mantissa
_LARGEST: Final = 1 << 53
_MOST_POWER: Final = 22


@leaf
def _end_of_cell(data, i, separator):  # type: ignore[no-untyped-def]
    """Offset of the separator or line feed after a cell; -1 if a mark or a lone return is in it."""
    while data[i] != separator and data[i] != _LINE_FEED:
        if data[i] <= _QUOTE and (
            data[i] == _QUOTE or (data[i] == _RETURN and data[i + 1] != _LINE_FEED)
        ):
            return -1
        i += 1
    return i


@leaf
def _are_same(data, start, other, length):  # type: ignore[no-untyped-def]
    """Whether as many bytes are the same in two places."""
    k = 0
    while k < length and data[start + k] == data[other + k]:
        k += 1
    return k == length


@leaf
def _digits(data, i, mantissa):  # type: ignore[no-untyped-def]
    """The digits of a number appended to those before, and the offset after them."""
    while np.uint8(data[i] - _ZERO) <= _NINE:
        mantissa = mantissa * 10 + np.uint8(data[i] - _ZERO)
        i += 1
    return mantissa, i


@leaf
def _number(data, i, decimal, powers):  # type: ignore[no-untyped-def]
    """A number and the offset after it; -1 if it is not simple."""
    negative = data[i] == _MINUS
    i += negative
    mantissa, end = _digits(data, i, np.int64(0))
    figures, power = end - i, 0
    i = end
    if data[i] == decimal:
        mantissa, end = _digits(data, i + 1, mantissa)
        power = i + 1 - end
        figures -= power
        i = end
    if data[i] == _SMALL_E or data[i] == _LARGE_E:
        i += 1
        down = data[i] == _MINUS
        i += data[i] == _MINUS or data[i] == _PLUS
        exponent, end = _digits(data, i, np.int64(0))
        if not 0 < end - i < 4:
            return 0.0, -1
        i = end
        power += -exponent if down else exponent
    simple = 0 < figures <= _MOST_FIGURES and mantissa <= _LARGEST
    if not simple or abs(power) > _MOST_POWER:
        return 0.0, -1
    value = float(mantissa)
    if power < 0:
        value /= powers[-power]
    else:
        value *= powers[power]
    return (-value if negative else value), i


@kernel
def parse_rows(data, marks, slots, label_column, numbers, changes, powers):  # type: ignore[no-untyped-def]
    """Read rows until they end, the arrays are full, or a row is not simple.

    Parameters
    ----------
    data : ndarray of uint8
        Whole rows: a line feed is the last byte, and nothing is read beyond it.
    marks : ndarray of int64, shape (2,)
        Separator and decimal sign.
    slots : ndarray of int64, shape (columns of the file,)
        Row of `numbers` for every column of the file, -1 for one that is not wanted.
    label_column : int
        Column of the file that labels the runs.
    numbers : ndarray of float64, shape (wanted, rows)
        Takes the numbers.
    changes : ndarray of int64, shape (many, 3)
        Takes the rows at which the label changes, with the first byte of the label and the one
        after its last; the first row counts as a change.
    powers : ndarray
        `POWERS_OF_TEN`.

    Returns
    -------
    rows, end, n_changes, status : int
        Rows read, offset after them, changes of the label, `GOOD` or `NOT_SIMPLE`.
    """
    separator, decimal = np.uint8(marks[0]), np.uint8(marks[1])
    last = slots.size - 1
    row = n_changes = begin = 0
    label_start = label_size = -1
    # where the cell of each column began that was read last, and whether cells repeat it
    cell_start = np.zeros(slots.size, dtype=np.int64)
    cell_size = np.zeros(slots.size, dtype=np.int64)
    repeats = np.zeros(slots.size, dtype=np.bool_)
    while row < numbers.shape[1] and begin < data.size:
        i = begin
        for column in range(last + 1):
            start, slot = i, slots[column]
            if slot < 0:
                i = _end_of_cell(data, i, separator)
                if i < 0:
                    return row, begin, n_changes, NOT_SIMPLE
                if column == label_column:
                    size = i - start - (i > start and data[i - 1] == _RETURN)
                    if size != label_size or not _are_same(data, start, label_start, size):
                        if n_changes == changes.shape[0]:
                            return row, begin, n_changes, GOOD
                        changes[n_changes, 0] = row
                        changes[n_changes, 1] = start
                        changes[n_changes, 2] = start + size
                        n_changes += 1
                    label_start, label_size = start, size
            else:
                # settings and slow channels repeat themselves: comparing is quicker than reading;
                # with the byte after the cell, so that a longer one is not taken for it
                length = cell_size[column]
                if length > 0 and (repeats[column] or row % TRY_AGAIN == 0):
                    repeats[column] = _are_same(data, start, cell_start[column], length + 1)
                if repeats[column]:
                    numbers[slot, row] = numbers[slot, row - 1]
                    i += length
                else:
                    numbers[slot, row], i = _number(data, i, decimal, powers)
                    if i < 0:
                        return row, begin, n_changes, NOT_SIMPLE
                    cell_start[column], cell_size[column] = start, i - start
            if column < last:
                if data[i] != separator:
                    return row, begin, n_changes, NOT_SIMPLE
                i += 1
        i += data[i] == _RETURN
        if data[i] != _LINE_FEED:
            return row, begin, n_changes, NOT_SIMPLE
        begin = i + 1
        row += 1
    return row, begin, n_changes, GOOD
