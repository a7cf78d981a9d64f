# SPDX-License-Identifier: MIT
"""Tests that a reader based only on acquire/RUN_FILE.md reads the same values from a run as the Python package."""
import shutil
import sqlite3
import zlib

import numpy as np
import pytest

import echofuse
from fixtures import change, plates, program, scenes

C_M_PER_PS = 299_792_458e-12


def read(path):
    """Returns one dictionary per record: index, label, start time (UTC, ns), SPD counts, radar
    power and depth (m). SPD and radar ranges (m) are corrected for the calibrated offsets."""
    db = sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)
    axes = {name: one for name, *one in db.execute("SELECT name, quantity, count, start, step, scale FROM axis")}
    offset_m = dict(db.execute("SELECT sensor, offset_m FROM calibration"))
    zones = db.execute("SELECT count(*) FROM sqlite_schema WHERE name = 'zone'").fetchone()[0]
    zones = db.execute("SELECT count(*) FROM zone").fetchone()[0] if zones else 0

    def at(name, within=0.0):
        _, count, start, step, _ = axes[name]
        return start + step * (np.arange(count) + within)

    records = []
    for index, valid, label, utc, spd, radar, depth in db.execute(
            "SELECT idx, valid, label, slot_utc_ns, spd, radar, depth FROM record ORDER BY idx"):
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
irf_fwhm_ps = 180.0
offset_m = 0.1
[radar]
first_m = 0.5
step_m = 0.25
cell_m = 0.5
taps = "1 0.9 0.5 0.2"
offset_m = 0.2
[depth]
unit = "mm"
half_tangent = 0.4
map_z_max_m = 5.0
map_size = 4
""")
    program("echofuse-acquire", "import", tmp_path, "--out", tmp_path / "own", "--began", "2024-02-07")
    run = echofuse.open(tmp_path / "own")
    assert run.labels == ["a", "b"] and run.offset_m == {"spd": 0.1, "radar": 0.2} and run.maps().shape == (2, 4, 4)
    assert (run.axes["spd"].start, run.axes["radar"].step, run.axes["map_z"].step) == (100, 0.25, 5)
