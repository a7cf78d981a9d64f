# SPDX-License-Identifier: MIT
"""Tests that reading a damaged run or model raises a ValueError or an OSError that names the file."""
import contextlib
import sqlite3

import numpy as np

import echofuse
from fixtures import model, query, scenes

MUTANTS = 300


def mutated(data, rng):
    """Returns a copy of `data` with flipped bits, overwritten or repeated bytes, or a truncated end."""
    data = bytearray(data)
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
    return bytes(data)


def read_all(path):
    with echofuse.open(path) as run:
        for read in (lambda: run.spd, lambda: run.radar, lambda: run.depth, run.photons, run.power,
                     run.lags, run.quality, run.events, lambda: run.maps([0]), lambda: repr(run),
                     lambda: [run.table(name) for name in run.tables]):
            read()


def survives(use, path):
    """Returns True if `use` reads the file, and False if it raises a ValueError or an OSError."""
    try:
        use(path)
        return True
    except (ValueError, OSError) as error:
        assert str(path) in str(error), repr(error)
        return False


def test_reading_a_mutated_run_raises_only_errors_that_name_the_file(tmp_path):
    data, rng, path = scenes(20).read_bytes(), np.random.default_rng(1), tmp_path / "run.sqlite"
    for _ in range(MUTANTS):
        path.write_bytes(mutated(data, rng))
        survives(read_all, path)


def test_reading_a_run_with_invalid_values_raises_only_errors_that_name_the_file(tmp_path):
    data, rng, path = scenes(20).read_bytes(), np.random.default_rng(2), tmp_path / "run.sqlite"
    values = [None, -1, 0, 2 ** 40, 2 ** 63 - 1, 1e300, "text", b"\xff\xfe", ""]
    columns = [(table, column) for table in ("run", "axis", "record", "calibration", "antenna")
               for column, in query(scenes(20), f"SELECT name FROM pragma_table_info('{table}')")]
    for _ in range(MUTANTS):
        path.write_bytes(data)
        table, column = columns[rng.integers(len(columns))]
        with sqlite3.connect(path) as db:
            db.execute("PRAGMA ignore_check_constraints = ON")
            with contextlib.suppress(sqlite3.Error):  # the database may refuse the value
                db.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = (SELECT rowid FROM {table} ORDER BY rowid LIMIT 1 OFFSET ?)",
                           (values[rng.integers(len(values))], int(rng.integers(4))))
        survives(read_all, path)


def test_load_model_refuses_mutated_model_files(tmp_path):
    data, rng, path = model("mlp-8", scenes(20), "--epochs", 2).read_bytes(), np.random.default_rng(3), tmp_path / "m.safetensors"
    for _ in range(MUTANTS):
        path.write_bytes(mutated(data, rng))
        assert survives(echofuse.load_model, path) == (path.read_bytes() == data)
