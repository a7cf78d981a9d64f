# SPDX-License-Identifier: MIT
"""The files of a run: one, or its parts (acquire/record/run_parts.hpp); each is opened to be read only."""
from __future__ import annotations

import json
import pathlib
import re
import sqlite3
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

APPLICATION_ID, FORMAT_VERSION = 0x4543464D, 2
NULL_INTEGER = -1 << 63
KINDS: dict[str, tuple[str, Any]] = {"INTEGER": ("ifnull(CAST({} AS INTEGER), -9223372036854775807 - 1)", np.int64),
                                     "REAL": ("CAST({} AS REAL)", float), "TEXT": ("ifnull(CAST({} AS BLOB), x'')", "S")}
COPIED = {"antenna", "axis", "calibration", "device"}  # tables that a part copies from the one before


def parts_of(whole: pathlib.Path) -> dict[int, pathlib.Path]:
    """Files that are named like parts of a run, NAME-001.sqlite and so on, by their numbers."""
    ends = ((path.stem[len(whole.stem) + 1:], path) for path in whole.parent.glob("*")
            if path.suffix == whole.suffix and path.stem.startswith(whole.stem + "-"))
    return dict(sorted((int(end), path) for end, path in ends if end.isdecimal() and end == f"{int(end):03}" != "000"))


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
                             "scripts/convert_run makes a run of this format"))
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


def files_of(whole: pathlib.Path) -> tuple[list[pathlib.Path], list[str]]:
    """The file of this name, or the parts of the run in order; and a line for each gap. What is named like a part and
    cannot be read, or is of another run than the first one, is missing."""
    parts = {} if whole.is_file() else parts_of(whole)
    files: list[pathlib.Path] = []
    missing: list[str] = []
    before, uuid, end = 0, None, 0

    def absent(first: int, last: int) -> str:
        names = [str(whole.with_name(f"{whole.stem}-{n:03}{whole.suffix}")) for n in {first: 0, last: 0}]
        return f"{' to '.join(names)}: not there, or not of this run"

    for number, path in parts.items():
        try:
            with closing(connect(path)) as db:
                own, *texts = db.execute("SELECT uuid, meta, part FROM run").fetchone()
                meta, (begun, *_) = map(json.loads, texts)
                first = begun["first_idx"]
        except (ValueError, TypeError, sqlite3.DatabaseError):
            continue
        if meta.get("part") != str(number) or own != (uuid or own):
            continue
        behind = number - int(meta.get("part_skipped", 0))  # the numbers between were never the run's
        if behind > before + 1:
            missing.append(f"{absent(before + 1, behind - 1)}; records {end} to {first - 1} are missing")
        files.append(path)
        before, uuid, end = number, own, first + int(meta["part_records"])
    if parts and before < max(parts):
        missing.append(absent(before + 1, max(parts)))
    return files or [whole], missing


def table(files: list[pathlib.Path], name: str) -> dict[str, NDArray[Any]]:
    """All columns of a table but blobs: int64 (NULL: NULL_INTEGER), float64 (NULL: NaN) or UTF-8 (kind S). Rows of all
    files, but those that each part copies from the one before."""
    joined: dict[str, list[NDArray[Any]]] = {}
    for path in files[-1:] if name in COPIED else files:
        with closing(connect(path)) as db:
            columns = db.execute("SELECT name, type FROM pragma_table_info(?) WHERE type != 'BLOB'", (name,)).fetchall()
            if not columns:
                continue
            reads, kinds = zip(*((read.format(f'"{column}"'), array) for column, kind in columns
                                  for read, array in [KINDS.get(kind, KINDS["TEXT"])]))
            cursor = db.execute(f'SELECT {", ".join(reads)} FROM "{name}" ORDER BY rowid')
            blocks = [[np.array(values, kind) for values, kind in zip(zip(*rows), kinds)]
                      for rows in iter(lambda: cursor.fetchmany(4096), [])]
        if joined and list(joined) != [column for column, _ in columns]:
            raise ValueError(f"{path}: its parts have other columns of the table {name}, as of another version; "
                             "export them one by one")
        for (column, _), kind, *values in zip(columns, kinds, *blocks):
            joined.setdefault(column, [np.array([], kind)]).extend(values)
    return {column: np.concatenate(values) for column, values in joined.items()}
