# SPDX-License-Identifier: MIT
"""Opens run files for reading."""
from __future__ import annotations

import functools
import json
import math
import os
import pathlib
import re
import sqlite3
import stat
import struct
import threading
from collections import Counter
from contextlib import closing
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .axis import Axis

try:
    import fcntl
except ImportError:  # Windows
    pass

__all__ = ["NULL_INTEGER", "SCHEMA", "STATISTICS", "Connection", "antennas_of", "axes_of",
           "connect", "is_closed", "leftovers", "meta_of", "numbers_in", "offsets_of", "printable",
           "reals", "status_of", "table", "wal_key"]

APPLICATION_ID, FORMAT_VERSION = 0x4543464D, 4
NULL_INTEGER = -1 << 63
WAL_KEY = "wal_key"  # key in the JSON object run.meta of an open run
MIN_AXIS_LIMIT, MAX_AXES, MAX_ANTENNAS = 1 << 16, 16, 12  # first: lower bound of the axis limit
MAX_OFFSET_M = 1000  # same value as in acquire/record/run_reader.cpp
NONZERO = re.compile(r"[-+.0]*[1-9]")
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
MAX_RESTARTS = 1 << 16  # maximum difference between the stored key and the key of the -wal file
# Definition of each table of a run, and of SQLite's statistics; written by the program `fixture`.
SCHEMA = {line.split()[2].split("(")[0]: line for line in resources.files(__package__).joinpath(
    "schema.sql").read_text("utf-8").splitlines()}
STATISTICS = {f"sqlite_stat{n}" for n in range(1, 5)}  # tables created by ANALYZE in SQLite
KINDS: dict[str, tuple[str, Any]] = {
    "INTEGER": ("ifnull(CAST({} AS INTEGER), -9223372036854775807 - 1)", np.int64),
    "REAL": ("CAST({} AS REAL)", float), "TEXT": ("ifnull(CAST({} AS BLOB), x'')", "S")}


def printable(text: str) -> str:
    """Escapes line breaks and other control characters, so that the text is one line."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode()
                   for c in text)


# Flags of os.open(); Windows has the last one only.
READ = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_NONBLOCK", "O_BINARY"))

_lock = threading.Lock()
_descriptors: dict[tuple[int, int], list[int]] = {}  # open file descriptors by device and inode
_connections: Counter[tuple[int, int]] = Counter()


class Connection(sqlite3.Connection):
    """Connection to a run, with an additional descriptor of the file. When a process closes any
    descriptor of a file, it loses all SQLite locks on this file. The descriptor therefore stays
    open until the last connection to the file is closed."""

    inode: tuple[int, int] | None = None
    lacks_wal = False  # True: the run was not closed, is not being recorded, and has no -wal file

    def close(self) -> None:
        super().close()
        inode, self.inode = self.inode, None
        release(inode)

    def is_closed(self) -> bool:
        return header_is_closed(self.inode)


def hold(path: pathlib.Path) -> tuple[int, int]:
    """Opens a descriptor of the file, and keeps it open until release(). Returns the device and the
    inode of the file."""
    with _lock:
        found = path.stat()
        if (found.st_dev, found.st_ino) not in _descriptors:
            descriptor = os.open(path, READ)
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
    """Returns whether the file is a closed (immutable) run, in which bytes 18 and 19 are 1."""
    if inode is None:
        return False
    if hasattr(os, "pread"):
        return os.pread(_descriptors[inode][0], 2, 18) == b"\1\1"
    with _lock:  # Windows; threads share the position in the file
        os.lseek(_descriptors[inode][0], 18, os.SEEK_SET)
        return os.read(_descriptors[inode][0], 2) == b"\1\1"


def is_closed(path: pathlib.Path) -> bool:
    inode = hold(path)
    try:
        return header_is_closed(inode)
    finally:
        release(inode)


def side_file(path: pathlib.Path, suffix: str) -> pathlib.Path:
    """Returns the path of the file with the given suffix next to a run, after resolving links."""
    real = path.resolve()
    return real.with_name(real.name + suffix)


def leftovers(path: pathlib.Path) -> list[pathlib.Path]:
    """Returns the SQLite files next to a closed run. These files do not belong to the run and are
    not read."""
    found = [file for suffix in ("-wal", "-shm", "-journal")
             if (file := side_file(path, suffix)).exists()]
    return found if found and is_closed(path) and not is_written(path) else []


def is_written(path: pathlib.Path) -> bool:
    """Returns whether a process is writing the run, i.e. holds the lock on RUN-lock. Does not take
    the lock. Returns False on systems that cannot record."""
    try:
        descriptor = os.open(side_file(path, "-lock"), READ | getattr(os, "O_NOFOLLOW", 0))
    except OSError:
        return False
    try:
        query = struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
        found = fcntl.fcntl(descriptor, fcntl.F_OFD_GETLK, query)
        return bool(struct.unpack_from("h", found)[0] != fcntl.F_UNLCK)
    except (OSError, NameError, AttributeError):  # Windows lacks fcntl, macOS F_OFD_GETLK
        return False
    finally:
        os.close(descriptor)


def wal_header(path: pathlib.Path) -> bytes:
    """Returns the first 32 bytes of the -wal file next to a run, padded with zeros."""
    try:
        descriptor = os.open(side_file(path, "-wal"), READ)
    except FileNotFoundError:
        return bytes(32)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise ValueError(f"{side_file(path, '-wal')}: is not a regular file")
        return os.read(descriptor, 32).ljust(32, b"\0")
    finally:
        os.close(descriptor)


def wal_key(path: pathlib.Path) -> int | None:
    """Returns the key of the -wal file (acquire/record/side_files.hpp); None if the header of the
    file is invalid."""
    magic, *_, number, salt, _ = struct.unpack(">6I8x", wal_header(path))
    return (salt - number) % (1 << 32) if magic & ~1 == 0x377F0682 else None


def stored_in(path: pathlib.Path) -> tuple[str | None, bool] | None:
    """Returns the key of the -wal file as stored in the run, and whether the run contains records.
    Reads only the run file, as in acquire/record/side_files.cpp. Returns None if the file is
    damaged or is not a run."""
    with closing(opened(path, "mode=ro&immutable=1")) as db:
        try:
            guard(db, path)
            key = json.loads(db.execute("SELECT meta FROM run").fetchone()[0]).get(WAL_KEY)
            records, = db.execute("SELECT EXISTS(SELECT 1 FROM record)").fetchone()
        except (sqlite3.Error, ValueError, LookupError, TypeError, AttributeError, RecursionError):
            return None
    return key, bool(records)


def refuse_foreign_wal(path: pathlib.Path) -> None:
    """Raises ValueError if the key of the -wal file differs from the key stored in the open run."""
    if (found := wal_key(path)) is None or (stored := stored_in(path)) is None:
        return
    try:
        expected = int(stored[0] or "", 16)
    except (ValueError, TypeError):
        return  # the run has no key
    difference = (found - expected) % (1 << 32)
    if min(difference, (1 << 32) - difference) > MAX_RESTARTS:
        raise ValueError(f"{path}: was not closed, and {side_file(path, '-wal')} belongs to "
                         f"another run (key {found:08x}, expected {expected:08x}); move it away")


def opened(path: pathlib.Path, options: str) -> Connection:
    inode = hold(path)
    try:
        db = Connection(f"{path.resolve().as_uri()}?{options}", uri=True)
    except BaseException:
        release(inode)
        raise
    db.inode = inode
    return db


def lacks_wal(path: pathlib.Path) -> bool:
    """Returns whether an open run is a copy without its -wal file. A run that is being recorded
    always has a -wal file. Raises ValueError if the -wal file belongs to a different run."""
    if is_written(path):
        return False
    refuse_foreign_wal(path)
    journal = side_file(path, "-journal")
    if any(wal_header(path)) or (journal.is_file() and journal.stat().st_size):
        return False
    key, records = stored_in(path) or (None, True)
    return key != "none" and (key is not None or records)


def is_model(path: pathlib.Path) -> bool:
    """Returns whether the file is a safetensors file (the header starts at byte 8)."""
    with open(path, "rb") as file:
        return file.read(9)[8:] == b"{"


def connect(path: pathlib.Path) -> Connection:
    """Opens a run file for reading. Files next to a closed run are not read or written. Raises
    ValueError if the file is not a run."""
    inode = hold(path)  # keeps the file open until a connection opens it
    try:
        return connected(path, header_is_closed(inode))
    finally:
        release(inode)


def connected(path: pathlib.Path, closed: bool) -> Connection:
    alone = not closed and lacks_wal(path)
    for options in ("mode=ro", "mode=ro&immutable=1"):
        db = opened(path, "mode=ro&immutable=1" if closed or alone else options)
        db.lacks_wal = alone
        try:
            identity = db.execute("PRAGMA application_id").fetchone()[0]
            version = db.execute("PRAGMA user_version").fetchone()[0]
        except sqlite3.DatabaseError as error:
            db.close()
            if error.sqlite_errorcode & 255 not in (sqlite3.SQLITE_READONLY,
                                                    sqlite3.SQLITE_CANTOPEN):
                raise ValueError(f"{path}: is a model; expected a run file" if is_model(path)
                                 else f"{path}: damaged: {error}" if error.sqlite_errorcode & 255
                                 == sqlite3.SQLITE_CORRUPT else
                                 f"{path}: not an echofuse run file: {error}") from None
            for suffix in ("-wal", "-journal"):
                rest = side_file(path, suffix)
                if rest.is_file() and rest.stat().st_size:
                    raise ValueError(
                        f"{path}: was not closed, and its last records are in {rest}; copy both "
                        "files to a writable folder") from None
            continue
        if db.is_closed() and not closed:  # the writer has just closed the run
            db.close()
            return connect(path)
        if not identity and not db.execute("SELECT 1 FROM sqlite_schema").fetchone():
            db.close()
            raise ValueError(f"{path}: is empty: the recording process was killed before the first "
                             f"record, or the records were in {side_file(path, '-wal')}, which is "
                             "missing; look for a copy named *.rescued.sqlite")
        if identity == APPLICATION_ID and version == FORMAT_VERSION:
            try:
                guard(db, path)
            except BaseException:
                db.close()
                raise
            return db
        db.close()
        raise ValueError(f"{path}: not an echofuse run file" if identity != APPLICATION_ID else
                         f"{path}: run format {version}, expected {FORMAT_VERSION}; " + (
                             "use a newer echofuse" if version > FORMAT_VERSION else
                             "convert it: python3 -m echofuse.runs.convert OLD NEW"
                             if version == 3 else "use the echofuse that recorded it"))
    raise ValueError(f"{path}: cannot be read")


FAULTS_OF_FILES = tuple(f"SQLITE_{fault}" for fault in (
    "CORRUPT", "NOTADB", "IOERR", "CANTOPEN", "BUSY", "LOCKED", "FULL", "NOMEM", "PROTOCOL"))


def query(db: Connection, path: pathlib.Path, sql: str, values: tuple[Any, ...]) -> list[Any]:
    """Returns the result rows of an SQL query. Raises ValueError if the query is invalid, and
    sqlite3.Error if the file is damaged."""
    try:
        return db.execute(sql, values).fetchall()
    except (sqlite3.Error, sqlite3.Warning, OverflowError) as error:
        # A damaged file raises DatabaseError; its subclasses have a name since Python 3.11.
        name = getattr(error, "sqlite_errorname", "")
        if type(error) is sqlite3.DatabaseError or name.startswith(FAULTS_OF_FILES):
            raise
        raise ValueError(f"{path}: query rejected: {error}: {sql}") from None


def status_of(db: Connection, path: pathlib.Path, stored: str) -> str:
    """Returns the status of a run as a string, as RunReader::info() does in C++."""
    if stored != "open":
        return stored
    if db.is_closed():
        return "copy of an open run"
    if is_written(path):
        return stored
    return "crashed, no -wal" if db.lacks_wal else "crashed"


def guard(db: sqlite3.Connection, path: pathlib.Path) -> None:
    """Protects against malicious files (acquire/RUN_FILE.md, threat model, item 1): rejects code in
    the schema and limits the run time of statements. Raises ValueError if the schema contains
    code."""
    # One step is 10 000 instructions. A valid run needs less than one instruction per byte.
    left = iter(range(200 + path.stat().st_size * 4 // 10_000))
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(max(path.stat().st_size, 16 << 20), 128 << 20))
    db.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)  # ATTACH would create the file that it names
    db.text_factory = functools.lru_cache(lambda text: text.decode("utf-8", "backslashreplace"))
    db.set_progress_handler(lambda: next(left, None) is None, 10_000)
    db.execute("PRAGMA trusted_schema = OFF")
    left_out = set(SCHEMA) - STATISTICS - {"zone"}
    for kind, name, sql in db.execute(
        "SELECT type, name, sql FROM sqlite_schema WHERE sql IS NOT NULL"):
        left_out.discard(name)
        if kind != "table" or name not in SCHEMA:
            escaped, quoted = printable(name), printable(name.replace('"', '""'))
            raise ValueError(
                f'{path}: contains the {kind} "{escaped}"; expected only the tables of a run; '
                f'remove it with: DROP {kind.upper()} "{quoted}"')
        if sql != SCHEMA[name]:
            raise ValueError(f"{path}: its table {name} does not have the expected definition")
    if left_out:
        raise ValueError(f"{path}: has no table {min(left_out)}; expected all tables of a run")


def meta_of(path: pathlib.Path, text: Any) -> dict[str, str]:
    """Returns the metadata. As in C++, skips a byte order mark, and refuses lone surrogates."""
    try:
        text = text.decode() if isinstance(text, bytes) else text
        meta = json.loads(text.removeprefix("\ufeff"))
        if isinstance(meta, dict) and all(isinstance(value, str) for value in meta.values()):
            json.dumps(meta, ensure_ascii=False).encode()
            meta.pop(WAL_KEY, None)
            return meta
    except (AttributeError, ValueError, RecursionError):
        pass
    raise ValueError(f"{path}: meta is not a JSON object of strings")


def numbers_in(text: str) -> list[float]:
    """Returns the numbers in a text, or an empty list if the text contains anything else
    (numbers_in() in drivers/util/format.hpp)."""
    words = text.split()
    values = [float(word) for word in words] if all(map(NUMBER.fullmatch, words)) else []
    in_range = all(math.isfinite(value) and (value != 0 or not NONZERO.match(word))
                   for word, value in zip(words, values))
    return values if in_range else []


def reals(**columns: float) -> str:
    """Returns SQL expressions for columns of numbers, with the values that replace NULL."""
    return ", ".join(f"CAST(ifnull({name}, {value}) AS REAL)" for name, value in columns.items())


def axes_of(db: sqlite3.Connection, path: pathlib.Path) -> dict[str, Axis]:
    """Returns the axes of a run by name. Raises ValueError if an axis is invalid (check_axis() in
    acquire/record/run_reader.cpp)."""
    most = max(path.stat().st_size, MIN_AXIS_LIMIT)
    rows = db.execute("SELECT name, quantity, unit, CAST(ifnull(count, 0) AS INTEGER), "
                      f"{reals(start=0, step=0, scale=1)} FROM axis").fetchmany(MAX_AXES + 1)
    for name, _, _, count, start, step, scale in rows:
        antennas = 1 if name != "array" else scale if scale.is_integer() else 0
        if (len(rows) > MAX_AXES or not 0 <= count <= most or not abs(start) < 1e15
                or not 1e-15 <= abs(step) < 1e15 or not 0 < scale < 1e15
                or not 1 <= antennas <= MAX_ANTENNAS):
            raise ValueError(f"{path}: axis {name}: {count} points from {start:g} in steps of "
                             f"{step:g}, scale {scale:g}; expected at most {MAX_AXES} axes of at "
                             f"most {most} points, with plausible positions and scales")
    return {row[0]: Axis(*row) for row in rows}


def offsets_of(db: sqlite3.Connection, path: pathlib.Path) -> dict[str, float]:
    """Returns the range bias of each calibrated sensor, m. Raises ValueError if a calibration is
    invalid."""
    rows = db.execute(f"SELECT sensor, {reals(offset_m=0)} FROM calibration").fetchmany(4)
    out = dict(rows)
    if (len(out) < len(rows) or not {*out} <= {"spd", "radar", "depth"}
            or not all(abs(offset_m) <= MAX_OFFSET_M for offset_m in out.values())):
        raise ValueError(f"{path}: damaged: table calibration contains {rows}; expected one offset "
                         f"of at most {MAX_OFFSET_M} m per sensor")
    return out


def antennas_of(db: sqlite3.Connection, path: pathlib.Path,
                array: Axis | None) -> list[tuple[float, ...]]:
    """Returns x, y, gain and phase of each radar antenna. Raises ValueError if an antenna is not
    plausible, or if the number of antennas differs from that of the axis."""
    rows = db.execute(f"SELECT {reals(x=0, y=0, gain=1, phase_rad=0)} FROM antenna ORDER BY rowid"
                      ).fetchmany(MAX_ANTENNAS + 1)
    if len(rows) > MAX_ANTENNAS or not all(
            max(abs(x), abs(y), abs(phase)) < 1e3 and 1e-3 <= gain <= 1e3
            for x, y, gain, phase in rows) or rows and array and len(rows) != array.scale:
        raise ValueError(f"{path}: damaged: table antenna: expected at most {MAX_ANTENNAS} "
                         "antennas with position, gain and phase, in agreement with the axis "
                         "array")
    return rows


def table(db: sqlite3.Connection, name: str) -> dict[str, NDArray[Any]]:
    """Returns all columns of a table except blobs. INTEGER becomes int64 (NULL: NULL_INTEGER), REAL
    becomes float64 (NULL: NaN), and text becomes UTF-8 bytes (dtype S)."""
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
