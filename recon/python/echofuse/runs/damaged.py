# SPDX-License-Identifier: MIT
"""Converts errors caused by damaged files to ValueErrors that include the path."""
from __future__ import annotations

import functools
import sqlite3
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from .grid import RowsError

__all__ = ["errors_with_path"]

F = TypeVar("F", bound=Callable[..., Any])
FAULTS = (sqlite3.Error, ValueError, TypeError, KeyError, IndexError, AttributeError,
          OverflowError, MemoryError, ZeroDivisionError)


def errors_with_path(read: F) -> F:
    """Decorates a method that reads the file self.path. Converts any error caused by a damaged file
    to a ValueError that starts with the path."""
    @functools.wraps(read)
    def wrapped(self: Any, *values: Any, **more: Any) -> Any:
        try:
            with np.errstate(all="ignore"):
                return read(self, *values, **more)
        except RowsError:
            raise
        except FAULTS as error:
            if isinstance(error, ValueError) and str(self.path) in str(error):
                raise
            raise ValueError(f"{self.path}: damaged: {error}") from None
    return wrapped  # type: ignore[return-value]
