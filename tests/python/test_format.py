# SPDX-License-Identifier: MIT
"""Tests that Python and C++ read the same arrays from 20 random runs, and the conversion of runs of format 3."""
import contextlib
import os
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

import echofuse
from fixtures import BIN, HERE, program


def test_python_reads_arrays_of_random_runs_written_by_cpp(tmp_path):
    writer = BIN.parent / "tests/test_acquire"
    if not writer.exists():
        pytest.skip("the tests in C++ are not built")
    subprocess.run([writer, "[.random_runs]"], check=True, stdout=subprocess.DEVNULL,
                   env=os.environ | {"ECHOFUSE_RANDOM_RUNS": str(tmp_path)})
    files = sorted(tmp_path.glob("*.sqlite"))
    assert len(files) == 20
    for path in files:
        run = echofuse.open(path)
        read = b""
        for row in range(len(run)):
            bits = sum(bit for name, bit in (("spd", 1), ("radar", 2), ("depth", 4)) if run.valid[name][row])
            read += np.array([run.index[row], run.time[row].astype(np.int64), bits], "<i8").tobytes()
            read += run.spd[row].tobytes() if bits & 1 else b""
            read += run.radar[row].tobytes() if bits & 2 else b""
            read += run.depth_mm(row).tobytes() if bits & 4 else b""
        assert read == (path.parent / (path.name + ".read")).read_bytes(), path
        assert len(run) == 12


def converted(old, new):
    return subprocess.run([sys.executable, "-m", "echofuse.runs.convert", old, new], capture_output=True, text=True)


def test_run_of_format_3_is_converted(tmp_path):
    old, new = tmp_path / "old.sqlite", tmp_path / "new.sqlite"
    with contextlib.closing(sqlite3.connect(old)) as db:
        db.executescript((HERE / "format_3.sql").read_text())
        names = [row[1] for row in db.execute("PRAGMA table_info(record)")]
        stored = [dict(zip(names, row)) for row in db.execute("SELECT * FROM record")]
    assert converted(old, new).returncode == 0
    run = echofuse.open(new)
    codes = np.array([np.frombuffer(row["radar"], "<f4") for row in stored], float)
    assert np.allclose(run.radar, 2 ** (codes * 2 / 256 * 16 / 12))
    assert np.array_equal(run.spd, [np.frombuffer(row["spd"], "<u4") for row in stored])
    assert run.axes["radar"].quantity == "power_with_noise"
    told = run.quality()
    assert told["spd_verdict"].tolist() == ["covers only part", "ok", "ok"]
    assert told["spd_figures"][0] == "tags cover only 7 % of the slot"
    assert (told["radar_verdict"][2], told["radar_figures"][2]) == ("weak", "the echo is 0.05 of the usual")
    kept = run.table("record")
    for name in set(names) & set(kept) - {"spd_verdict", "radar_verdict", "depth_verdict"}:
        values = [row[name] for row in stored if row[name] is not None and not isinstance(row[name], str)]
        assert not values or kept[name].tolist() == values, name
    assert kept["clicks_per_pulse"].tolist() == pytest.approx([row["clicks_a_pulse"] or np.nan for row in stored], nan_ok=True)
    program("echofuse-acquire", "info", new)
    for one, other, text in ((new, tmp_path / "again", "expected a closed run of format 3"), (old, new, "exists")):
        refused = converted(one, other)
        assert refused.returncode == 1 and text in refused.stderr, refused.stderr
