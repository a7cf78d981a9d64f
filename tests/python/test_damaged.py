# SPDX-License-Identifier: MIT
"""Tests that reading a damaged run or model raises a ValueError or an OSError that names the file."""
import contextlib
import sqlite3

import numpy as np
import pytest

import echofuse
from fixtures import model, query, scenes

MUTANTS = 300
VALUES = [None, -1, 0, 2 ** 40, 2 ** 63 - 1, 1e300, "text", b"\xff\xfe", ""]


def other_bytes(path, rng):
    """Flips bits, overwrites or repeats bytes, or truncates the end of a file."""
    data = bytearray(path.read_bytes())
    first, length = rng.integers(len(data)), int(rng.integers(1, 200))
    kind = rng.integers(4)
    if kind == 0:
        for at in rng.integers(len(data), size=rng.integers(1, 9)):
            data[at] ^= 1 << rng.integers(8)
    elif kind == 1:
        data[first:first + length] = rng.bytes(length)
    elif kind == 2:
        del data[first:]
    else:
        data[first:first] = data[first:first + length]
    path.write_bytes(data)


def other_value(path, rng):
    columns = [(table, column) for table in ("run", "axis", "record", "calibration", "antenna")
               for column, in query(path, f"SELECT name FROM pragma_table_info('{table}')")]
    table, column = columns[rng.integers(len(columns))]
    with sqlite3.connect(path) as db, contextlib.suppress(sqlite3.Error):  # the database may refuse the value
        db.execute("PRAGMA ignore_check_constraints = ON")
        db.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = (SELECT rowid FROM {table} ORDER BY rowid LIMIT 1 OFFSET ?)",
                   (VALUES[rng.integers(len(VALUES))], int(rng.integers(4))))


def read_all(path):
    with echofuse.open(path) as run:
        for read in (lambda: run.spd, lambda: run.radar, lambda: run.depth, run.photons, run.power,
                     run.lags, run.quality, run.events, lambda: run.maps([0]), lambda: repr(run),
                     lambda: [run.table(name) for name in run.tables]):
            read()


@pytest.mark.parametrize("read, damage", [(read_all, other_bytes), (read_all, other_value), (echofuse.load_model, other_bytes)])
def test_reading_a_damaged_file_raises_only_errors_that_name_the_file(tmp_path, read, damage):
    whole = scenes(20) if read == read_all else model("mlp-8", scenes(20), "--epochs", 2)
    data, rng, path = whole.read_bytes(), np.random.default_rng(1), tmp_path / "file.sqlite"
    for _ in range(MUTANTS):
        path.write_bytes(data)
        damage(path, rng)
        try:
            read(path)
            assert read == read_all or path.read_bytes() == data
        except (ValueError, OSError) as error:
            assert str(path) in str(error), repr(error)
