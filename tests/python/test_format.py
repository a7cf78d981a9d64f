# SPDX-License-Identifier: MIT
"""Tests that Python, C++ and the manual acquire/RUN_FILE.md read the same values, and the conversion of runs of format 3."""
import contextlib
import os
import sqlite3
import subprocess
import sys
import zlib

import numpy as np
import pytest

import echofuse
from fixtures import BIN, HERE, outcome, plates, program, query


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
            for bit, values in (1, run.spd[row]), (2, run.radar[row]), (4, run.depth_mm(row)):
                read += values.tobytes() if bits & bit else b""
        assert read == path.with_name(path.name + ".read").read_bytes() and len(run) == 12, path


def converted(old, new):
    return subprocess.run([sys.executable, "-m", "echofuse.runs.convert", old, new], capture_output=True, text=True)


def test_run_of_format_3_is_converted(tmp_path):
    old, new = tmp_path / "old.sqlite", tmp_path / "new.sqlite"
    with contextlib.closing(sqlite3.connect(old)) as db:
        db.executescript((HERE / "format_3.sql").read_text())
    stored = query(old, "SELECT * FROM record", by_name=True)
    assert converted(old, new).returncode == 0
    run = echofuse.open(new)
    codes = np.array([np.frombuffer(row["radar"], "<f4") for row in stored], float)
    assert np.allclose(run.radar, 2 ** (codes * 2 / 256 * 16 / 12)) and run.axes["radar"].quantity == "power_with_noise"
    assert np.array_equal(run.spd, [np.frombuffer(row["spd"], "<u4") for row in stored])
    told = {name: values.tolist() for name, values in run.quality().items()}
    assert told["spd_verdict"] == ["covers only part", "ok", "ok"] and told["radar_verdict"][2] == "weak"
    assert "tags cover only 7 % of the " in told["spd_figures"][0] and "echo is 0.05 of the usual" in told["radar_figures"][2]
    kept = run.table("record")
    for name in set(stored[0].keys()) & set(kept) - {"spd_verdict", "radar_verdict", "depth_verdict"}:
        values = [row[name] for row in stored if row[name] is not None and not isinstance(row[name], str)]
        assert not values or kept[name].tolist() == values, name
    assert kept["clicks_per_pulse"].tolist() == pytest.approx([row["clicks_a_pulse"] or np.nan for row in stored], nan_ok=True)
    program("echofuse-acquire", "info", new)
    for one, other, text in ((new, tmp_path / "again", "expected a closed run of format 3"), (old, new, "exists")):
        refused = converted(one, other)
        assert refused.returncode == 1 and text in refused.stderr, refused.stderr


@pytest.mark.parametrize("kind", ["one_pixel", "nine_zones"])
def test_package_reads_the_values_that_the_manual_describes(kind):
    path = plates(kind, 6)
    run = echofuse.open(path)
    axes = {name: axis for name, *axis in query(path, "SELECT name, quantity, unit, count, start, step FROM axis")}
    for name, (quantity, unit, count, start, step) in axes.items():
        axis = run.axes[name]
        assert [axis.quantity, axis.unit] == [quantity, unit] and np.allclose(axis.values, start + step * np.arange(count))
    assert run.offset_m == dict(query(path, "SELECT sensor, offset_m FROM calibration")) != {}
    columns = "spd, radar, depth, idx, label, slot_utc_ns"
    for row, (spd, radar, depth, *facts) in enumerate(query(path, f"SELECT {columns} FROM record ORDER BY idx")):
        assert facts == [run.index[row], run.labels[row], run.time[row].astype(np.int64)]
        assert np.array_equal(np.frombuffer(spd, "<u4").reshape(run.spd[row].shape), run.spd[row])
        assert np.array_equal(np.frombuffer(radar, "<f4"), run.radar[row])
        mm = np.frombuffer(zlib.decompress(depth), "<u2").reshape(axes["depth_y"][2], axes["depth_x"][2])
        assert np.allclose(np.where(mm > 0, mm / 1000, np.nan), run.depth[row], atol=1e-6, equal_nan=True)


def test_import_reads_offsets_and_exact_numbers_but_no_laboratory_configuration(tmp_path):
    """echofuse.write_run writes the other keys of run.toml (test_arrays.py)."""
    for name in "spd", "radar":
        np.save(tmp_path / f"{name}.npy", np.ones((2, 9)))
    (tmp_path / "run.toml").write_text("[spd]\noffset_m = 0.1\nirf_fwhm_ps = 1234.56789\n[radar]\noffset_m = 0.2\n"
                                       "cell_m = 0.04996540967\ntaps = \"1 0.9 0.5 0.2\"\n")
    (tmp_path / "lab.toml").write_text("not TOML")
    outcome("echofuse-acquire", "import", tmp_path, "--out", tmp_path / "own", "--began", "2024-02-07", cwd=tmp_path, check=True)
    run = echofuse.open(tmp_path / "own")
    assert run.offset_m == {"spd": 0.1, "radar": 0.2}
    wanted = {"radar_cell_m": "0.04996540967", "radar_taps": "1 0.9 0.5 0.2", "irf_fwhm_ps": "1234.56789"}
    assert {key: run.meta[key] for key in wanted} == wanted
