# SPDX-License-Identifier: MIT
"""One kind of error for damaged files: ValueError with the file's name."""
from __future__ import annotations

import functools
import sqlite3
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])
FAULTS = (sqlite3.Error, ValueError, TypeError, KeyError, IndexError, AttributeError,
          OverflowError, MemoryError, ZeroDivisionError)


def names_its_file(read: F) -> F:
    """A method of an object with a path: what it meets in a damaged file becomes a ValueError that
    begins with the path."""
    @functools.wraps(read)
    def wrapped(self: Any, *values: Any, **more: Any) -> Any:
        try:
            with np.errstate(all="ignore"):
                return read(self, *values, **more)
        except FAULTS as error:
            if isinstance(error, ValueError) and str(self.path) in str(error):
                raise
            raise ValueError(f"{self.path}: damaged: {error}") from None
    return wrapped  # type: ignore[return-value]
