"""Numbers of clean CSV rows, compiled: for recordings too big for comfort.

Exact: the digits of a number are a whole number up to 2**53, divided or multiplied by a power of
ten below 10**23; both are exact in double precision, so that one correctly rounded operation gives
the nearest double, as any exact reader does. Whatever is not that simple (a missing word, a
quotation mark, more digits, a ragged row) is left to the exact reader.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from beltid.rigsim.compiled import kernel

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
    label_start = label_end = -1
    cell_start = np.zeros(slots.size, dtype=np.int64)
    cell_size = np.zeros(slots.size, dtype=np.int64)
    repeats = np.zeros(slots.size, dtype=np.bool_)
    while row < numbers.shape[1] and begin < data.size:
        i = begin
        for column in range(last + 1):
            if column == label_column:
                start = i
                while data[i] != separator and data[i] != _LINE_FEED:
                    if data[i] == _QUOTE:
                        return row, begin, n_changes, NOT_SIMPLE
                    i += 1
                end = i - 1 if i > start and data[i - 1] == _RETURN else i
                same = label_start >= 0 and end - start == label_end - label_start
                k = 0
                while same and k < end - start:
                    same = data[start + k] == data[label_start + k]
                    k += 1
                if not same:
                    if n_changes == changes.shape[0]:
                        return row, begin, n_changes, GOOD
                    changes[n_changes, 0] = row
                    changes[n_changes, 1] = start
                    changes[n_changes, 2] = end
                    n_changes += 1
                label_start, label_end = start, end
            elif slots[column] < 0:
                while data[i] != separator and data[i] != _LINE_FEED:
                    if data[i] == _QUOTE:
                        return row, begin, n_changes, NOT_SIMPLE
                    i += 1
            else:
                # settings and slow channels repeat themselves: comparing is quicker than reading
                start = i
                length = cell_size[column]
                if length > 0 and (repeats[column] or row % TRY_AGAIN == 0):
                    before, k = cell_start[column], 0
                    while k <= length and data[i + k] == data[before + k]:
                        k += 1
                    repeats[column] = k > length
                    if repeats[column]:  # with the separator or line feed after it
                        numbers[slots[column], row] = numbers[slots[column], row - 1]
                        i += length + (column < last)
                        continue
                negative = data[i] == _MINUS
                i += negative
                mantissa, first = np.int64(0), i
                while np.uint8(data[i] - _ZERO) <= _NINE:
                    mantissa = mantissa * 10 + np.uint8(data[i] - _ZERO)
                    i += 1
                figures, power = i - first, 0
                if data[i] == decimal:
                    i += 1
                    first = i
                    while np.uint8(data[i] - _ZERO) <= _NINE:
                        mantissa = mantissa * 10 + np.uint8(data[i] - _ZERO)
                        i += 1
                    power = first - i
                    figures -= power
                if data[i] == _SMALL_E or data[i] == _LARGE_E:
                    i += 1
                    down = data[i] == _MINUS
                    i += data[i] == _MINUS or data[i] == _PLUS
                    exponent: Any = 0
                    first = i
                    while np.uint8(data[i] - _ZERO) <= _NINE and i - first < 4:
                        exponent = exponent * 10 + np.uint8(data[i] - _ZERO)
                        i += 1
                    if i == first:
                        return row, begin, n_changes, NOT_SIMPLE
                    power += -exponent if down else exponent
                simple = 0 < figures <= _MOST_FIGURES and mantissa <= _LARGEST
                if not simple or abs(power) > _MOST_POWER:
                    return row, begin, n_changes, NOT_SIMPLE
                value = float(mantissa)
                if power < 0:
                    value /= powers[-power]
                else:
                    value *= powers[power]
                numbers[slots[column], row] = -value if negative else value
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
