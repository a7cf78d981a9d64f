# SPDX-License-Identifier: MIT
"""A run file, opened to be read only."""
from __future__ import annotations

import json
import os
import pathlib
import re
import sqlite3
import threading
from collections import Counter
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

APPLICATION_ID, FORMAT_VERSION = 0x4543464D, 3
NULL_INTEGER = -1 << 63
TABLES = {"run", "axis", "record", "device", "calibration", "antenna", "anchor", "counter", "event",
          "late", "zone"}
STATISTICS = {f"sqlite_stat{n}" for n in range(1, 5)}  # of ANALYZE
KINDS: dict[str, tuple[str, Any]] = {"INTEGER":
                                     ("ifnull(CAST({} AS INTEGER), -9223372036854775807 - 1)",
                                      np.int64),
                                     "REAL": ("CAST({} AS REAL)", float),
                                     "TEXT": ("ifnull(CAST({} AS BLOB), x'')", "S")}


def printable(text: str) -> str:
    """Text from outside in one line; control characters and what reorders text are escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode()
                   for c in text)


_lock = threading.Lock()
_descriptors: dict[tuple[int, int], list[int]] = {}  # by device and inode
_connections: Counter[tuple[int, int]] = Counter()


class Connection(sqlite3.Connection):
    """Connection to a run with a descriptor of the same file. Closing any descriptor of a file ends
    all locks that SQLite has on it in this process, so the descriptor stays open as long as a
    connection to that file."""

    inode: tuple[int, int] | None = None

    def close(self) -> None:
        super().close()
        inode, self.inode = self.inode, None
        release(inode)

    def is_closed(self) -> bool:
        return header_is_closed(self.inode)


def hold(path: pathlib.Path) -> tuple[int, int]:
    """Keeps a descriptor of this file open until release(). Returns its device and inode."""
    with _lock:
        found = path.stat()
        if (found.st_dev, found.st_ino) not in _descriptors:
            descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
            found = os.fstat(descriptor)
            _descriptors.setdefault((found.st_dev, found.st_ino), []).append(descriptor)
        _connections[found.st_dev, found.st_ino] += 1
        return found.st_dev, found.st_ino


def release(inode: tuple[int, int] | None) -> None:
    with _lock:
        if inode is None:
            return
        _connections[inode] -= 1
        if not _connections[inode]:
            del _connections[inode]
            for descriptor in _descriptors.pop(inode):
                os.close(descriptor)


def header_is_closed(inode: tuple[int, int] | None) -> bool:
    """Whether bytes 18 and 19 of a held file are 1, as in every closed run. Such a run is
    immutable."""
    return inode is not None and os.pread(_descriptors[inode][0], 2, 18) == b"\1\1"


def is_closed(path: pathlib.Path) -> bool:
    inode = hold(path)
    try:
        return header_is_closed(inode)
    finally:
        release(inode)


def leftovers(path: pathlib.Path) -> list[pathlib.Path]:
    """Files of SQLite next to a closed run. They are not part of it and are not read."""
    found = [file for suffix in ("-wal", "-shm", "-journal")
             if (file := path.with_name(path.name + suffix)).exists()]
    return found if found and is_closed(path) else []


def opened(path: pathlib.Path, inode: tuple[int, int], how: str) -> Connection:
    try:
        db = sqlite3.connect(f"{path.resolve().as_uri()}?{how}", uri=True, factory=Connection)
    except BaseException:
        release(inode)
        raise
    db.inode = inode
    return db


def connect(path: pathlib.Path) -> sqlite3.Connection:
    """Opens a run file for reading. Nothing next to a closed run is read or written. Raises
    ValueError for a file that is no run."""
    for how in ("mode=ro", "mode=ro&immutable=1"):
        inode = hold(path)
        closed = header_is_closed(inode)
        db = opened(path, inode, "mode=ro&immutable=1" if closed else how)
        try:
            identity = db.execute("PRAGMA application_id").fetchone()[0]
            version = db.execute("PRAGMA user_version").fetchone()[0]
        except sqlite3.DatabaseError as error:
            db.close()
            if error.sqlite_errorcode & 255 not in (sqlite3.SQLITE_READONLY,
                                                    sqlite3.SQLITE_CANTOPEN):
                raise ValueError(f"{path}: not a run of echofuse: {error}") from None
            for beside in ("-wal", "-journal"):
                rest = path.with_name(path.name + beside)
                if rest.is_file() and rest.stat().st_size:
                    raise ValueError(
                        f"{path}: was not closed, and its last records are in {rest}; copy both to "
                        "a folder "
                                     "that can be written") from None
            continue
        if db.is_closed() and not closed:  # its writer closed it meanwhile
            db.close()
            return connect(path)
        if identity == APPLICATION_ID and version == FORMAT_VERSION:
            try:
                guard(db, path)
            except BaseException:
                db.close()
                raise
            return db
        db.close()
        raise ValueError(f"{path}: not a run of echofuse" if identity != APPLICATION_ID else
                         f"{path}: run format {version}, expected {FORMAT_VERSION}; " + (
                             "use a newer echofuse" if version > FORMAT_VERSION else
                             "use the echofuse that recorded it"))
    raise ValueError(f"{path}: cannot be read")


def guard(db: sqlite3.Connection, path: pathlib.Path) -> None:
    """Guards against files of strangers (acquire/README.md, threat model, 1): nothing in them runs
    by itself, and a statement ends. Raises ValueError."""
    # steps of 10 000 instructions; less than one a byte is needed
    left = iter(range(200 + path.stat().st_size * 4 // 10_000))
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(max(path.stat().st_size, 16 << 20), 128 << 20))
    db.text_factory = lambda text: text.decode("utf-8", "backslashreplace")
    db.set_progress_handler(lambda: next(left, None) is None, 10_000)
    db.execute("PRAGMA trusted_schema = OFF")
    for kind, name, sql, page in db.execute(
        "SELECT type, name, sql, rootpage FROM sqlite_schema WHERE sql IS NOT NULL"):
        # a virtual table, or computed columns
        computed = page == 0 or re.search(r"\bAS\s*\(", sql, re.IGNORECASE)
        if kind != "table" or name not in TABLES | STATISTICS or computed:
            shown, quoted = printable(name), printable(name.replace('"', '""'))
            raise ValueError(
                f'{path}: holds the {kind} "{shown}"; expected the tables of a run only; '
                f'remove it by: DROP {kind.upper()} "{quoted}"')


def meta_of(path: pathlib.Path, text: Any) -> dict[str, str]:
    try:
        if isinstance(meta := json.loads(text), dict):
            return meta
    except (TypeError, ValueError, RecursionError):
        pass
    raise ValueError(f"{path}: meta is not a JSON object of texts")


def table(path: pathlib.Path, name: str) -> dict[str, NDArray[Any]]:
    """All columns of a table but blobs: int64 (NULL: NULL_INTEGER), float64 (NULL: NaN) or UTF-8
    (kind S)."""
    with closing(connect(path)) as db:
        columns = db.execute("SELECT name, type FROM pragma_table_info(?) WHERE type != 'BLOB'",
                             (name,)).fetchall()
        if not columns:
            return {}
        reads, kinds = zip(*((read.format(f'"{column}"'), array) for column, kind in columns
                              for read, array in [KINDS.get(kind, KINDS["TEXT"])]))
        cursor = db.execute(f'SELECT {", ".join(reads)} FROM "{name}" ORDER BY rowid')
        blocks = [[np.array(values, kind) for values, kind in zip(zip(*rows), kinds)]
                  for rows in iter(lambda: cursor.fetchmany(4096), [])]
    return {column: np.concatenate([np.array([], kind), *values])
            for (column, _), kind, *values in zip(columns, kinds, *blocks)}
