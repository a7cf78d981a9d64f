# SPDX-License-Identifier: MIT
"""Checks arguments, and converts errors caused by damaged files to ValueErrors that include the
path."""
from __future__ import annotations

import functools
import math
import sqlite3
from collections.abc import Callable, Mapping, Set
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["RANGE_OFFSET_M", "ArgumentError", "ComparedByValue", "entries", "errors_with_path",
           "is_single", "listed", "number", "plain", "refused", "rows_of", "text_of"]

F = TypeVar("F", bound=Callable[..., Any])
FAULTS = (sqlite3.Error, ValueError, TypeError, LookupError, AttributeError, ArithmeticError,
          MemoryError)
RANGE_OFFSET_M = -10, 10  # same limits as in recon/cli/commands.cpp
ma: Any = np.ma  # NumPy does not declare types of masked arrays


class ArgumentError(ValueError, IndexError):
    """An argument of the caller is invalid, or rows do not exist; the file is not damaged."""


class ComparedByValue:
    """Base of data classes (eq=False) with arrays: compares all fields. NaN in arrays is equal to
    NaN."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = [field.name for field in fields(self)]
        pairs = ((getattr(self, name), getattr(other, name)) for name in names)
        return all(np.array_equal(mine, theirs, equal_nan=mine.dtype.kind == "f")
                   if isinstance(mine, np.ndarray) else bool(mine == theirs)
                   for mine, theirs in pairs)

    __hash__ = None  # type: ignore[assignment]


def is_missing(value: Any) -> bool:
    """Returns whether a value is NaN, None or a missing value of pandas."""
    return value is None or not isinstance(value, str) and str(value) in ("nan", "NaT", "<NA>")


def refused(name: str, value: Any, expected: str) -> ArgumentError:
    return ArgumentError(f"{name}: {value!r} (expected {expected})")


def text_of(name: str, value: Any) -> str:
    """Returns text or a number as text; missing values become "". Raises ValueError for other
    values and for text that is not valid Unicode."""
    is_time = getattr(value, "dtype", np.dtype(str)).kind in "mM"
    value = value.tolist() if hasattr(value, "tolist") else value
    if is_missing(value):
        return ""
    if is_time or not isinstance(value, (str, int, float)):
        raise refused(name, value, "text or a number")
    if any("\ud800" <= character <= "\udfff" for character in str(value)):
        raise refused(name, value, "valid Unicode text")
    return str(value)


def number(name: str, value: Any, kind: type = float, limits: Any = None) -> Any:
    """Returns a value as a number. Raises ArgumentError if it is not of this kind, or masked."""
    try:
        if isinstance(value, (str, bytes)) or ma.is_masked(value):
            raise TypeError
        found = kind(value)
        if kind is int and (found != value or abs(found) >= 1 << 63):
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise refused(name, value, "an integer" if kind is int else "a number") from None
    if limits and not limits[0] <= found <= limits[1]:
        raise refused(name, value, f"{limits[0]} to {limits[1]}")
    return found


def listed(name: str, values: Any) -> list[Any]:
    """Returns the items of a sequence. Raises ValueError if it is not a sequence."""
    if (isinstance(values, (str, bytes, Set, Mapping)) or not hasattr(values, "__iter__")
            or getattr(values, "ndim", 1) == 0):
        raise refused(name, values, "a sequence")
    inner = getattr(values, "values", values)  # of pandas and xarray; a method of torch tensors
    return list(values if callable(inner) else inner)


def entries(name: str, values: Any) -> list[tuple[Any, Any]]:
    """Returns the items of a dict or of None. Raises ValueError for other values."""
    if values is not None and not isinstance(values, Mapping):
        raise refused(name, values, "a dict")
    return list((values or {}).items())


def is_single(rows: Any) -> bool:
    """Returns whether the rows are the number of one row, which is not a bool."""
    return isinstance(rows, (int, np.integer)) and not isinstance(rows, bool)


def rows_of(count: int, rows: Any) -> NDArray[np.int64]:
    """Converts a slice, a mask or a list to row numbers from 0 to count - 1. Raises ArgumentError
    if a row is outside this range, or masked."""
    if ma.is_masked(rows):
        raise ArgumentError("expected rows that are not masked")
    try:
        selected: slice | NDArray[Any] = rows if isinstance(rows, slice) else np.asarray(rows)
        if isinstance(selected, np.ndarray) and not selected.size:
            selected = selected.astype(int)  # NumPy converts an empty list to floats
        if isinstance(selected, np.ndarray) and selected.ndim != 1:
            raise ArgumentError("expected a slice, a mask or a list of rows, not an array of "
                                f"{selected.ndim} dimensions")
        return np.asarray(np.arange(count)[selected])
    except (IndexError, ValueError) as error:
        raise ArgumentError(str(error)) from None


def plain(name: str, values: Any) -> tuple[NDArray[Any], bool]:
    """Returns an array in which masked values and None are NaN, and whether the given numbers are
    integers. Raises ValueError if the values are not numbers, or if a row that is not a depth image
    is masked in part."""
    try:
        if isinstance(values, (list, tuple)):  # replaces None with a masked row
            missing = [row is None or row is ma.masked for row in values]
            of_row = ma.masked_all_like(ma.asarray([*values, ()][(*missing, False).index(0)]))
            values = [of_row if lost else row for row, lost in zip(values, missing)]
        found = ma.asarray(values)
        table, masked = found.data, ma.getmaskarray(found)
        if table.dtype == object:  # contains None or the missing value of pandas
            masked = masked | np.array([*map(is_missing, table.flat)], bool).reshape(table.shape)
            numbers = np.array(table[~masked].tolist())
            table = np.zeros(table.shape, numbers.dtype)
            table[~masked] = numbers
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: expected an array of numbers: {error}") from None
    if not table.ndim or table.dtype.kind not in "biuf":
        raise ValueError(f"{name}: expected an array of numbers, not {table.dtype} {table.shape}")
    is_integer = table.dtype.kind in "biu"
    if masked.any():
        rows = masked.reshape(len(masked), math.prod(masked.shape[1:]))
        partly = np.flatnonzero(rows.any(1) & ~rows.all(1))
        if name in ("spd", "radar", "array", "lags") and partly.size:
            raise ValueError(f"{name}: row {partly[0]} is masked in part; expected a whole row")
        table = np.where(masked, np.nan, table.astype(float))
    if table.dtype.kind == "f":
        return np.ascontiguousarray(table, "<f8" if name == "spd" else "<f4"), is_integer
    return np.ascontiguousarray(table, table.dtype.newbyteorder("<")), is_integer


def errors_with_path(read: F) -> F:
    """Decorates a method that reads the file self.path. Converts any error caused by a damaged file
    to a ValueError that starts with the path."""
    @functools.wraps(read)
    def wrapped(self: Any, *values: Any, **more: Any) -> Any:
        try:
            with np.errstate(all="ignore"):
                return read(self, *values, **more)
        except ArgumentError:
            raise
        except FAULTS as error:
            if isinstance(error, ValueError) and str(self.path) in str(error):
                raise
            raise ValueError(f"{self.path}: damaged: {error}") from None
    return wrapped  # type: ignore[return-value]
