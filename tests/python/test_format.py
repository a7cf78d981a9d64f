# SPDX-License-Identifier: MIT
"""Tests that Python and C++ read the same arrays from 20 random runs, and that Python rejects runs in other formats."""
import os
import subprocess

import numpy as np
import pytest

import echofuse
from fixtures import BIN, change


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
            read += run.stored_radar()[row].tobytes() if bits & 2 else b""
            read += run.depth_mm(row).tobytes() if bits & 4 else b""
        assert read == (path.parent / (path.name + ".read")).read_bytes(), path
        assert len(run) == 12


def test_open_refuses_another_run_format_version_and_gives_advice(tmp_path):
    path = tmp_path / "run.sqlite"
    subprocess.run([BIN / "echofuse-sim", "dataset", "-q", "--records", "2", "--out", path], check=True)
    for version, advice in ((2, "expected 3; use the echofuse that recorded it"), (4, "expected 3; use a newer echofuse")):
        change(path, f"run format {version}")
        with pytest.raises(ValueError, match=f"run format {version}, {advice}"):
            echofuse.open(path)
