# SPDX-License-Identifier: MIT
"""Tests that Python, C++ and a reader based only on acquire/RUN_FILE.md read the same values from a run, and the conversion of
runs of format 3."""
import contextlib
import os
import shutil
import sqlite3
import subprocess
import sys
import zlib

import numpy as np
import pytest

import echofuse
from fixtures import BIN, HERE, change, outcome, plates, program, query, scenes


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


C_M_PER_PS = 299_792_458e-12


def read(path):
    """Returns one dictionary per record: index, label, start time (UTC, ns), SPD counts, radar
    power and depth (m). SPD and radar ranges (m) are corrected for the calibrated offsets."""
    axes = {name: one for name, *one in query(path, "SELECT name, quantity, count, start, step, scale FROM axis")}
    offset_m = dict(query(path, "SELECT sensor, offset_m FROM calibration"))
    zones = query(path, "SELECT count(*) FROM sqlite_schema WHERE name = 'zone'")[0][0]
    zones = query(path, "SELECT count(*) FROM zone")[0][0] if zones else 0

    def at(name, within=0.0):
        _, count, start, step, _ = axes[name]
        return start + step * (np.arange(count) + within)

    records = []
    for index, valid, label, utc, spd, radar, depth in query(
            path, "SELECT idx, valid, label, slot_utc_ns, spd, radar, depth FROM record ORDER BY idx"):
        one = {"index": index, "label": label, "utc": utc}
        if valid & 1:
            one["spd"] = np.frombuffer(spd, "<u4").reshape(max(zones, 1), -1)
            one["spd_m"] = C_M_PER_PS * at("spd", 0.5) / 2 - offset_m.get("spd", 0)
        if valid & 2:
            one["radar"] = np.frombuffer(radar, "<f4").astype(float)
            one["radar_m"] = at("radar") - offset_m.get("radar", 0)
        if valid & 4:
            mm = np.frombuffer(zlib.decompress(depth), "<u2").reshape(axes["depth_y"][1], axes["depth_x"][1])
            one["depth_m"] = np.where(mm > 0, mm / 1000, np.nan)
        records.append(one)
    return records


@pytest.mark.parametrize("kind", ["one_pixel", "nine_zones", "scenes"])
def test_reader_written_from_the_manual_returns_the_same_arrays_as_the_package(tmp_path, kind):
    path = tmp_path / "run.sqlite"
    shutil.copyfile(scenes(6) if kind == "scenes" else plates(kind, 6), path)
    if kind == "scenes":
        for sensor, offset_m in (("spd", 0.3), ("radar", 0.5)):
            change(path, "offset ?2 of the sensor ?1", sensor, offset_m)
    run, found = echofuse.open(path), read(path)
    assert [one["index"] for one in found] == run.index.tolist() and [one["label"] for one in found] == run.labels
    assert [one["utc"] for one in found] == run.time.astype(np.int64).tolist()
    assert np.array_equal(np.array([one["spd"] for one in found]).reshape(run.spd.shape), run.spd)
    assert np.allclose([one["radar"] for one in found], run.radar, rtol=1e-6)
    assert np.allclose([one["depth_m"] for one in found], run.depth, atol=1e-6, equal_nan=True)
    # Corrected ranges are the axis minus the offset. The SPD bin at 3 m contains the two-way travel time of 3 m.
    assert np.allclose(found[0]["radar_m"], run.axes["radar"].values - run.offset_m.get("radar", 0))
    bin_of = int(np.argmin(np.abs(found[0]["spd_m"] - 3)))
    assert run.axes["spd"].values[bin_of] <= 2 * (3 + run.offset_m.get("spd", 0)) / C_M_PER_PS <= run.axes["spd"].values[bin_of] + run.axes["spd"].step


def test_import_accepts_all_documented_keys_of_run_toml(tmp_path):
    np.save(tmp_path / "spd.npy", np.ones((2, 9), np.uint32))
    np.save(tmp_path / "radar.npy", np.ones((2, 7)))
    np.save(tmp_path / "depth.npy", np.full((2, 8, 8), 3000, np.uint16))
    (tmp_path / "run.toml").write_text("""
window_s = 0.5
labels = ["a", "b"]
notes = "mine"
[spd]
first_bin_ps = 100.0
bin_width_ps = 50.0
irf_fwhm_ps = 1234.56789
offset_m = 0.1
[radar]
first_m = 0.5
step_m = 0.25
cell_m = 0.04996540967
taps = "1 0.9 0.5 0.2"
offset_m = 0.2
[depth]
unit = "mm"
half_tangent = 0.4
map_z_max_m = 5.0
map_size = 4
""")
    (tmp_path / "lab.toml").write_text("not TOML")  # An import does not read the configuration of the laboratory.
    outcome("echofuse-acquire", "import", tmp_path, "--out", tmp_path / "own", "--began", "2024-02-07", cwd=tmp_path, check=True)
    run = echofuse.open(tmp_path / "own")
    assert run.labels == ["a", "b"] and run.offset_m == {"spd": 0.1, "radar": 0.2} and run.maps().shape == (2, 4, 4)
    assert (run.axes["spd"].start, run.axes["radar"].step, run.axes["map_z"].step) == (100, 0.25, 5)
    assert [run.meta[key] for key in ("radar_cell_m", "radar_taps", "irf_fwhm_ps")] == ["0.04996540967", "1 0.9 0.5 0.2", "1234.56789"]
