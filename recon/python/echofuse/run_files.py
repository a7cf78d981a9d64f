# SPDX-License-Identifier: MIT
"""A run file, opened to be read only."""
from __future__ import annotations

import pathlib
import re
import sqlite3
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

APPLICATION_ID, FORMAT_VERSION = 0x4543464D, 3
NULL_INTEGER = -1 << 63
KINDS: dict[str, tuple[str, Any]] = {"INTEGER": ("ifnull(CAST({} AS INTEGER), -9223372036854775807 - 1)", np.int64),
                                     "REAL": ("CAST({} AS REAL)", float), "TEXT": ("ifnull(CAST({} AS BLOB), x'')", "S")}


def connect(path: pathlib.Path) -> sqlite3.Connection:
    """To read a run file. Of one that was closed nothing is written beside it, where that is not allowed. Raises
    ValueError for a file that is no run."""
    address = path.resolve().as_uri()
    for how in ("mode=ro", "immutable=1"):
        db = sqlite3.connect(f"{address}?{how}", uri=True)
        try:
            identity = db.execute("PRAGMA application_id").fetchone()[0]
            version = db.execute("PRAGMA user_version").fetchone()[0]
        except sqlite3.DatabaseError as error:
            db.close()
            if error.sqlite_errorcode & 255 not in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN):
                raise ValueError(f"{path}: not a run of echofuse: {error}") from None
            for beside in ("-wal", "-journal"):
                rest = path.with_name(path.name + beside)
                if rest.is_file() and rest.stat().st_size:
                    raise ValueError(f"{path}: was not closed, and its last records are in {rest}; copy both to a folder "
                                     "that can be written") from None
            continue
        if identity == APPLICATION_ID and version == FORMAT_VERSION:
            guard(db, path)
            return db
        db.close()
        raise ValueError(f"{path}: not a run of echofuse" if identity != APPLICATION_ID else
                         f"{path}: run format {version}, expected {FORMAT_VERSION}; " + (
                             "use a newer echofuse" if version > FORMAT_VERSION else
                             "use the echofuse that recorded it"))
    raise ValueError(f"{path}: cannot be read")


def guard(db: sqlite3.Connection, path: pathlib.Path) -> None:
    """Guards against files of strangers (acquire/README.md, threat model, 1): nothing in them runs by itself, and a statement
    ends. Raises ValueError."""
    left = iter(range(200 + path.stat().st_size * 4 // 10_000))  # steps of 10 000 instructions; less than one a byte is needed
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(max(path.stat().st_size, 16 << 20), 128 << 20))
    db.text_factory = lambda text: text.decode("utf-8", "backslashreplace")
    db.set_progress_handler(lambda: next(left, None) is None, 10_000)
    db.execute("PRAGMA trusted_schema = OFF")
    for kind, name, sql, page in db.execute("SELECT type, name, sql, rootpage FROM sqlite_schema WHERE sql IS NOT NULL"):
        if kind != "table" or page == 0 or re.search(r"\bAS\s*\(", sql, re.IGNORECASE):  # virtual, or with computed columns
            raise ValueError(f"{path}: holds the {kind} {name!r}; expected the tables of a run only")


def table(path: pathlib.Path, name: str) -> dict[str, NDArray[Any]]:
    """All columns of a table but blobs: int64 (NULL: NULL_INTEGER), float64 (NULL: NaN) or UTF-8 (kind S)."""
    with closing(connect(path)) as db:
        columns = db.execute("SELECT name, type FROM pragma_table_info(?) WHERE type != 'BLOB'", (name,)).fetchall()
        if not columns:
            return {}
        reads, kinds = zip(*((read.format(f'"{column}"'), array) for column, kind in columns
                              for read, array in [KINDS.get(kind, KINDS["TEXT"])]))
        cursor = db.execute(f'SELECT {", ".join(reads)} FROM "{name}" ORDER BY rowid')
        blocks = [[np.array(values, kind) for values, kind in zip(zip(*rows), kinds)]
                  for rows in iter(lambda: cursor.fetchmany(4096), [])]
    return {column: np.concatenate([np.array([], kind), *values])
            for (column, _), kind, *values in zip(columns, kinds, *blocks)}
