# SPDX-License-Identifier: MIT
"""The files of a run: one, or its parts (acquire/record/run_parts.hpp); each is opened to be read only."""
from __future__ import annotations

import json
import pathlib
import sqlite3
from contextlib import closing

APPLICATION_ID, FORMAT_VERSION = 0x4543464D, 2


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
            return db
        db.close()
        raise ValueError(f"{path}: not a run of echofuse" if identity != APPLICATION_ID else
                         f"{path}: run format {version}, expected {FORMAT_VERSION}; " + (
                             "use a newer echofuse" if version > FORMAT_VERSION else
                             "scripts/convert_run makes a run of this format"))
    raise ValueError(f"{path}: cannot be read")


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
