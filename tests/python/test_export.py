# SPDX-License-Identifier: MIT
"""Tests echofuse-export, which writes runs as HDF5, netCDF or CSV."""
import functools
import os
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest

import echofuse
from echofuse.runs import antennas, batches as blocks
from echofuse.runs import staged as staging
from echofuse.export.command import export
from echofuse.runs.run_files import NULL_INTEGER
from fixtures import BIN, change, changed, plates, program, query, scenes

h5py = pytest.importorskip("h5py")


def tool(*words, env=None, prefix=()):
    return subprocess.run([*prefix, BIN / "echofuse-export", *map(str, words)], capture_output=True, text=True,
                          env={**os.environ, **(env or {})})


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Creates four runs. own.sqlite has 20 records: record 3 has no SPD data, and records 7 and 9 are unreadable. far.sqlite
    has eight records with antenna data and a note. one_pixel.sqlite and nine_zones.sqlite are the default runs."""
    folder, rng = tmp_path_factory.mktemp("export"), np.random.default_rng(1)
    spd = rng.poisson(50, (20, 8)).astype(float)
    spd[3] = np.nan
    depth = rng.uniform(1, 4, (20, 6, 6))
    depth[:, 0, 0] = np.nan
    echofuse.write_run(folder / "own", spd=spd, first_bin_ps=13343, bin_width_ps=100,
                       radar=rng.uniform(1, 2, (20, 4)), first_m=0.5, depth_m=depth, labels=[f"person {i}" for i in range(20)])
    bad = np.array([1, np.nan, 1, 1], "<f4")
    change(folder / "own.sqlite", "radar data of record ?1", 9, bad.tobytes())
    change(folder / "own.sqlite", "histogram of two bytes in record ?1", 7)
    shutil.copy(scenes(8, 1, "--set", "radar_antennas=8", "--set", "radar_sum=coherent", "--set", "radar_frames=20"), folder / "far.sqlite")
    program("echofuse-acquire", "annotate", folder / "far.sqlite", "door open, µ")
    for kind in "one_pixel", "nine_zones":
        shutil.copy(plates(kind, 20), folder / f"{kind}.sqlite")
    return folder


def test_hdf5_export_contains_the_arrays_and_marks_unreadable_records(runs, tmp_path):
    run, done = echofuse.open(runs / "own"), tool(runs / "own", "--to", tmp_path / "a.h5")
    assert (done.returncode, done.stderr) == (
        5, f"echofuse-export: 2 records are unreadable; {tmp_path / 'a.h5'} marks them as unreadable\n")
    with h5py.File(tmp_path / "a.h5") as file:
        data, good = file["entry/data"], ~np.isin(np.arange(20), (7, 9))
        assert data["spd"].dtype == np.uint32 and data["radar"].dtype == data["depth"].dtype == np.float32
        assert data["record"][:].tolist() == list(range(20))
        assert data["spd_valid"][:].tolist() == [row not in (3, 7, 9) for row in range(20)]
        assert data["depth_valid"][:].tolist() == data["radar_valid"][:].tolist() == [row not in (7, 9) for row in range(20)]
        assert data["label"].asstr()[:].tolist() == run.labels
        assert np.array_equal(data["time"][:].astype("datetime64[ns]"), run.time)
        fine = run[10:20]
        assert np.array_equal(data["spd"][10:], fine.spd) and np.array_equal(data["radar"][10:], fine.radar)
        assert np.array_equal(data["depth"][10:], fine.depth, equal_nan=True)
        assert (data["spd"][:][~good] == 0).all() and (data["spd"][3] == 0).all() and data["spd"][4].any()
        for name in "radar", "depth":
            assert np.isnan(data[name][:][~good]).all() and np.isfinite(data[name][3][1:]).all()
        assert data["radar_verdict"][9] == b"unreadable: radar bin 1 is not a finite number"
        assert data["depth_verdict"][7] == b"unreadable: spd has 2 bytes, but its axis requires 32"
        assert data["spd_time"][3] == 13343 + 300 and data["radar_range"][2] == 1
        assert (data["spd_time"].attrs["units"], data["radar_range"].attrs["units"], data["depth"].attrs["units"]) == ("ps", "m", "m")
        assert [dim.label for dim in data["depth"].dims] == ["record", "depth_y", "depth_x"]
        assert file["entry"].attrs["NX_class"] == "NXentry" and file["entry/depth"].attrs["signal"] == "depth"
        assert file["entry/entry_identifier"].asstr()[()] == run.info["uuid"]
        # The identifier and the labels are stored as fixed-length strings.
        assert file["entry/entry_identifier"].dtype.kind == "S" and data["label"].dtype.kind == "S"


@pytest.mark.parametrize("name", ["own", "far", "one_pixel", "nine_zones"])
def test_hdf5_export_contains_every_table_of_the_run_with_units(runs, tmp_path, name):
    assert export(echofuse.open(runs / name), tmp_path / "a.h5") == (2 if name == "own" else 0)
    columns = 0
    ask = functools.partial(query, runs / f"{name}.sqlite")
    with h5py.File(tmp_path / "a.h5") as file:
        for table, in ask("SELECT name FROM sqlite_schema WHERE type = 'table'"):
            for column, kind in ask(f"SELECT name, type FROM pragma_table_info('{table}') WHERE type != 'BLOB'"):
                stored = file[f"entry/tables/{table}/{column}"]
                null = {"INTEGER": NULL_INTEGER, "REAL": np.nan, "TEXT": ""}[kind]
                wanted = [null if value is None else value for value, in ask(f'SELECT "{column}" FROM "{table}" ORDER BY rowid')]
                found = stored.asstr()[:].tolist() if kind == "TEXT" else stored[:]
                np.testing.assert_array_equal(found, np.array(wanted, stored.dtype) if kind != "TEXT" else wanted)
                assert kind == "TEXT" or stored.attrs["units"]
                assert stored.attrs.get("missing_value") == (NULL_INTEGER if kind == "INTEGER" and NULL_INTEGER in found else None)
                columns += 1
        assert columns > 60
        tables = file["entry/tables"]
        if name == "nine_zones":
            assert tables["zone/zero_ps"].attrs["units"] == "ps"
        units = {place: tables[place].attrs["units"] for place in ("record/slot_utc_ns", "record/slot_start_ns", "axis/start", "record/spd_offset_s")}
        assert units == {"record/slot_utc_ns": "nanoseconds since 1970-01-01T00:00:00Z", "record/slot_start_ns": "ns",
                         "axis/start": "given in the column unit of the same row", "record/spd_offset_s": "s"}
        if name == "far":
            assert tables["event/text"].asstr()[-1] == "door open, µ"
            assert (tables["antenna/x"].attrs["units"], tables["antenna/phase_rad"].attrs["units"]) == ("half wavelengths", "rad")
            values, blob = file["entry/data/array"], antennas.values(echofuse.open(runs / "far"))
            assert values.shape == blob.shape == (8, 29, 82) and np.array_equal(values[:], blob)
            assert file["entry/data/array_frames"][:].tolist() == [20] * 8


def test_xarray_opens_every_group_of_the_hdf5_export(runs, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    for name in "own", "far", "one_pixel", "nine_zones":
        export(echofuse.open(runs / name), tmp_path / f"{name}.h5")
        groups = ["/"]
        with h5py.File(tmp_path / f"{name}.h5") as file:
            file.visititems(lambda path, item: groups.append(path) if isinstance(item, h5py.Group) else None)
        assert len(groups) > 15
        for group in groups:
            with xarray.open_dataset(tmp_path / f"{name}.h5", group=group, engine="h5netcdf") as found:
                found.load()
        with xarray.open_dataset(tmp_path / f"{name}.h5", group="entry/data", engine="h5netcdf") as found:
            assert found.spd.dims == ("record", *["zone"] * (name == "nine_zones"), "spd_time") and found.time.dtype == "datetime64[ns]"
            assert found.label.values.tolist() == echofuse.open(runs / name).labels
        # The netcdf4 engine cannot open a file in which a dimension scale contains strings.
        with h5py.File(tmp_path / f"{name}.h5") as file:
            file.visititems(lambda path, item: [path for dim in getattr(item, "dims", []) for scale in dim.values()
                                                if scale.dtype.kind == "S" and pytest.fail(path)] and None)


@pytest.mark.parametrize("name", ["far", "one_pixel", "nine_zones"])
def test_netcdf_export_equals_the_result_of_to_xarray(runs, tmp_path, monkeypatch, name):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    monkeypatch.setattr(blocks, "MAX_RECORDS", 3)
    run = echofuse.open(runs / name)
    assert export(run, tmp_path / "a.nc") == 0 and export(echofuse.open(runs / "own"), tmp_path / "own.nc") == 2
    wanted = echofuse.to_xarray(run)
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as found:
        assert set(found.variables) == set(wanted.variables) and found.sizes == wanted.sizes
        for name, each in wanted.variables.items():
            np.testing.assert_array_equal(found[name].values, each.values, err_msg=name)
        assert found.attrs["uuid"] == run.info["uuid"] and found.depth.attrs["units"] == "m"
        assert found.attrs["Conventions"].startswith("CF-")
    with h5py.File(tmp_path / "a.nc") as stored:
        assert not [name for name in wanted.coords if "_FillValue" in stored[name].attrs]
    export(run, tmp_path / "a.h5")
    with xarray.open_dataset(tmp_path / "a.h5", group="entry/data", engine="h5netcdf") as found:
        for name in (set(wanted.variables) - {"spd_range"}) & set(found.variables):
            assert found[name].dims == wanted[name].dims and found[name].attrs.get("units") == wanted[name].attrs.get("units"), name
            same = np.array_equal if found[name].dtype.kind in "OSU" else np.testing.assert_array_equal
            assert same(found[name].values, wanted[name].values) is not False, name
        lacks = {name for name in wanted.variables if not name.startswith(("zone", "event", "antenna"))} - set(found.variables)
        assert lacks == {"spd_range"}
    with xarray.open_dataset(tmp_path / "own.nc", engine="h5netcdf") as found:
        assert found.spd_valid.values.tolist() == [row not in (3, 7, 9) for row in range(20)]
        assert found.spd_verdict.values[9] == "unreadable: radar bin 1 is not a finite number"


def test_netcdf_attributes_are_numbers_and_state_the_facts_of_the_run(runs, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    path = tmp_path / "a.sqlite"
    shutil.copy(runs / "own.sqlite", path)
    change(path, "label ?2 of record ?1", 1, "a\0b")
    given = {"uuid": "mine", "status": "fine", "spd_offset_m": "0.3 +- 1", "Conventions": "x", "_NCProperties": "x", "nul": "a\0b", "sample": "0012",
             "gain": "2.5", "irf_fwhm_ps": "203 +- 2", "radar_taps": "1 0.5 0.25", "detector_dead_time_ps": "45 ns"}
    for key, value in given.items():
        change(path, "metadata entry ?1 with the value ?2", key, value)
    run = echofuse.open(path)
    assert np.array_equal(run[:3].photons(), echofuse.open(runs / "own")[:3].photons())  # an invalid dead time is ignored, as in C++
    assert export(run, tmp_path / "a.nc") == export(run, tmp_path / "a.h5") == 2
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as found:
        facts = {key: found.attrs.get(key) for key in given}
        assert facts | {"radar_taps": list(facts["radar_taps"])} == given | {
            "uuid": run.info["uuid"], "status": "complete", "spd_offset_m": run.offset_m.get("spd"), "Conventions": "CF-1.8",
            "_NCProperties": None, "nul": "a\\x00b", "gain": 2.5, "irf_fwhm_ps": 203, "radar_taps": [1, 0.5, 0.25]}
        assert (found.attrs["window_s"], found.attrs["irf_fwhm_ps_standard_error"]) == (run.info["window_s"], 2)
        assert found.label.values[1] == "a\\x00b" and all(found[name].attrs["long_name"] for name in found.variables)


@pytest.mark.parametrize("name", ["own", "one_pixel", "nine_zones"])
def test_export_does_not_depend_on_the_block_size(runs, tmp_path, monkeypatch, name):
    run = echofuse.open(runs / name)
    export(run, tmp_path / "whole.h5")
    monkeypatch.setattr(blocks, "MAX_BYTES", 400)  # A limit of 400 bytes gives blocks of one record.
    assert [len(part) for _, part, _ in blocks.blocks(run, lambda done: None)] == [1] * 20
    export(run, tmp_path / "blocks.h5")
    with h5py.File(tmp_path / "whole.h5") as whole, h5py.File(tmp_path / "blocks.h5") as parts:
        def same(name, item):
            if isinstance(item, h5py.Dataset):
                np.testing.assert_array_equal(item[()], parts[name][()], err_msg=name)
        whole.visititems(same)


def test_export_accepts_a_run_without_records(runs, tmp_path):
    changed(runs / "far.sqlite", tmp_path / "none.sqlite", "without a record and an axis")
    assert tool(tmp_path / "none", "--to", tmp_path / "a.h5").returncode == 0
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["entry/data/record"].shape == (0,)
    pytest.importorskip("h5netcdf")
    assert tool(tmp_path / "none", "--to", tmp_path / "a.nc").returncode == 0


def test_csv_export_contains_the_sensor_values_of_one_record(runs, tmp_path):
    for name, zones_of in ("own", ""), ("one_pixel", ""), ("nine_zones", ", y = zone"):
        run = echofuse.open(runs / name)
        assert tool(run.path, "--record", 2, "--to", tmp_path / f"{name}.csv").returncode == 0
        lines = (tmp_path / f"{name}.csv").read_text().splitlines()
        one, (times, ranges, xs, ys) = run[2:3], (run.axes[axis].values for axis in ("spd", "radar", "depth_x", "depth_y"))
        assert f"# spd: x = two-way time in ps, value = counts{zones_of}" in lines
        assert lines[lines.index("sensor,x,y,value") + 1:] == [
            *(f"spd,{time:.9g},{zone if zones_of else ''},{count}" for zone, counts in enumerate(np.atleast_2d(one.spd[0])) for time, count in zip(times, counts)),
            *(f"radar,{range_m:.9g},,{power:.9g}" for range_m, power in zip(ranges, one.radar[0])),
            *(f"depth,{x:.9g},{y:.9g},{mm}" for y, line in zip(ys, one.depth_mm(0)) for x, mm in zip(xs, line))]
    assert not [line for line in tool(runs / "own", "--record", 3, "--to", tmp_path / "b.csv").stderr.splitlines()]
    assert "\nspd," not in (tmp_path / "b.csv").read_text()
    assert "radar bin 1 is not a finite number" in tool(runs / "own", "--record", 9, "--to", tmp_path / "c.csv").stderr
    changed(runs / "own.sqlite", tmp_path / "sly.sqlite", "label ?2 of record ?1", 1, "a\n=1+1,;\"\x1b")
    tool(tmp_path / "sly", "--record", 1, "--to", tmp_path / "d.csv")
    assert (tmp_path / "d.csv").read_text().splitlines()[0].endswith(r"label a\n=1+1\x2c\x3b\x22\x1b")


def test_csv_export_contains_radar_power_over_range_and_azimuth(runs, tmp_path):
    """The expected value is the power of a Bartlett beamformer, computed term by term."""
    run = echofuse.open(runs / "far")
    assert tool(runs / "far", "--record", 1, "--to", tmp_path / "a.csv").returncode == 0
    text = (tmp_path / "a.csv").read_text()
    assert "mean over 20 frames" in text
    values, sine, total = antennas.values(run)[1, 5].astype(float), 7 / 32 - 1, 0
    place = 24
    for m, (x, _, gain, phase) in enumerate(run.antennas):
        h = gain * np.exp(1j * (phase + np.pi * x * sine))
        total += values[16 + m] / abs(h) ** 2
        for other, _, gain_of, phase_of in run.antennas[m + 1:]:
            g = gain_of * np.exp(1j * (phase_of + np.pi * other * sine))
            total += 2 * ((values[place] + 1j * values[place + 1]) / (h * g.conjugate())).real
            place += 2
    line, = (line for line in text.splitlines() if line.startswith(f"array,{run.axes['array'].values[5]:.9g},{sine:.9g},"))
    assert float(line.rpartition(",")[2]) == pytest.approx(total / 64, rel=1e-6)


def test_beamforming_recovers_the_direction_and_power_of_a_wave():
    sine, power, count = 0.3125, 9.0, 8
    gain, phase = 1 + 0.1 * np.arange(count), 0.4 * np.arange(count) ** 2
    x = 3 * gain * np.exp(1j * (np.pi * np.arange(count) * sine + phase))
    first, last = np.triu_indices(count, 1)
    pairs = x[first] * x[last].conj()
    values = np.concatenate([np.zeros(16), abs(x) ** 2, np.stack([pairs.real, pairs.imag], 1).ravel(), [0, 0]])
    scale = values[16:24].sum()
    blob = np.float32(scale).tobytes() + np.rint(values / scale * 32767).astype("<i2").tobytes()

    class One:
        axes = {"array": echofuse.Axis("array", "covariance", "m", 1, 0, 1, count)}
        antennas = [(m, 0, gain[m], phase[m]) for m in range(count)]
        valid, index, path = {"radar": np.array([True])}, np.array([0]), "one"
        of_records = staticmethod(lambda columns, table="": [(0, blob)])
        array_bins = echofuse.Run.array_bins
        __len__ = lambda self: 1  # noqa: E731

    seen = antennas.beams(One(), np.array([sine, sine + 0.1]))[0, 0]
    # Half of the phase step between adjacent antennas, rad, for the Dirichlet kernel in the next line.
    half = np.pi * 0.1 / 2
    assert seen == pytest.approx([power, power * (np.sin(8 * half) / (8 * np.sin(half))) ** 2], rel=1e-2)


def test_export_refuses_invalid_arguments_and_files(runs, tmp_path):
    (tmp_path / "a.h5").write_text("precious")
    for words, code, said in [((runs / "own", "--to", tmp_path / "a.h5"), 1, "a.h5: exists already; choose another name"),
                              ((runs / "own", "--to", tmp_path / "b.csv"), 2, "with --record N"),
                              ((runs / "own", "--to", tmp_path / "b.h5", "--record", 1), 2, "with --record N"),
                              ((runs / "own", "--to", tmp_path / "b.csv", "--record", 20), 1, "record 20 is missing (the run has 20 records)"),
                              ((runs / "own", "--to", tmp_path / "no/b.h5"), 6, "b.h5: cannot write (No such file or directory)")]:
        done = tool(*words)
        assert done.returncode == code and said in done.stderr and (code == 2 or done.stderr.count("\n") == 1), done.stderr
    assert (tmp_path / "a.h5").read_text() == "precious" and os.listdir(tmp_path) == ["a.h5"]


@pytest.mark.parametrize("module, name", [("h5py", "a.h5"), ("xarray", "a.nc"), ("h5netcdf", "a.nc")])
def test_export_error_names_the_missing_package(runs, tmp_path, module, name):
    for needed in {"a.h5": [], "a.nc": ["xarray", "h5netcdf"]}[name]:
        pytest.importorskip(needed)
    (tmp_path / f"{module}.py").write_text("raise ImportError")
    done = tool(runs / "own", "--to", tmp_path / name, env={"PYTHONPATH": str(tmp_path)})
    assert (done.returncode, done.stderr) == (
        1, f"echofuse-export: {tmp_path / name}: requires python3-{module} (apt-get install python3-{module})\n")


def test_export_marks_a_record_as_unreadable_if_a_number_replaces_its_array(runs, tmp_path):
    shutil.copy(runs / "far.sqlite", tmp_path / "bad.sqlite")
    for row, data in enumerate(("histogram", "range profile", "depth image")):
        change(tmp_path / "bad.sqlite", f"a number instead of the {data} of record ?1", row)
    done = tool(tmp_path / "bad", "--to", tmp_path / "a.h5")
    assert (done.returncode, done.stderr) == (5, f"echofuse-export: 3 records are unreadable; {tmp_path / 'a.h5'} marks them as unreadable\n")


def test_export_holds_its_lock_even_if_the_lock_file_is_replaced(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    place, flock, late = tmp_path / "a.h5", staging.fcntl.flock, []

    def gone(held, how):
        """Replaces the lock file just before this process locks it, as if other processes had
        deleted and recreated it."""
        if not late:
            late.extend(tmp_path.glob(".*.lock"))
            late[0].unlink()
            late[0].touch()
        flock(held, how)

    monkeypatch.setattr(staging.fcntl, "flock", gone)
    with staging.staged(place) as path:
        path.write_text("ours")
        with pytest.raises(BlockingIOError, match="another process is creating this file"), staging.staged(place):
            pass
        assert late[0].exists()
    assert os.listdir(tmp_path) == ["a.h5"] and place.read_text() == "ours"
    with pytest.raises(FileExistsError, match="exists already"), staging.staged(tmp_path / "b.h5") as path:
        path.write_text("ours")
        (tmp_path / "b.h5").write_text("theirs")
    assert (tmp_path / "b.h5").read_text() == "theirs"
    late[0].symlink_to(tmp_path / "b.h5")
    place.unlink()
    with pytest.raises(OSError, match="symbolic links"), staging.staged(place):
        pass
    assert (tmp_path / "b.h5").read_text() == "theirs" and not place.exists()


def test_export_does_not_write_through_a_planted_link(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "short"))
    (tmp_path / "short").mkdir()
    (tmp_path / "theirs").write_text("theirs")
    with pytest.raises(FileExistsError), staging.staged(tmp_path / "a.h5") as path:
        (tmp_path / path.name).symlink_to(tmp_path / "theirs")
    assert sorted(os.listdir(tmp_path)) == ["short", "theirs"] and (tmp_path / "theirs").read_text() == "theirs"


def test_export_creates_a_file_on_a_file_system_that_does_not_support_hard_links(tmp_path, monkeypatch):
    def no_links(*_):
        raise PermissionError

    monkeypatch.setattr(os, "link", no_links)
    with staging.staged(tmp_path / "a.h5") as path:
        path.write_text("ours")
    assert os.listdir(tmp_path) == ["a.h5"]


@pytest.mark.parametrize("kib", [0, 20])
@pytest.mark.parametrize("name", ["a.h5", "a.nc", "a.csv"])
def test_export_to_a_full_disk_leaves_no_file(runs, tmp_path, name, kib):
    if kib and name == "a.csv":
        return
    if name == "a.nc":
        pytest.importorskip("h5netcdf")
    done = tool(runs / "far", "--to", tmp_path / name, *(["--record", 1] if name == "a.csv" else []), env={"TMPDIR": str(tmp_path)},
                prefix=["sh", "-c", f"ulimit -f {2 * kib}; exec \"$@\"", "sh"])
    assert (done.returncode, done.stderr) == (6, f"echofuse-export: {tmp_path / name}: cannot write (File too large)\n")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_interrupted_export_leaves_no_file_and_can_be_repeated(runs, tmp_path, how):
    echofuse.write_run(tmp_path / "long", spd=np.ones((5000, 64)), radar=np.ones((5000, 16)))
    files = lambda: {name for name in os.listdir(tmp_path) if not name.startswith("long")}  # noqa: E731
    process = subprocess.Popen([BIN / "echofuse-export", tmp_path / "long", "--to", tmp_path / "a.h5"], stderr=subprocess.DEVNULL,
                               env={**os.environ, "TMPDIR": str(tmp_path)})
    while process.poll() is None and len(files()) < 2:
        time.sleep(0.001)
    time.sleep(0.05)
    process.send_signal(how)
    assert process.wait() == (-how if how == signal.SIGKILL else 130)
    assert "a.h5" not in files() and (how == signal.SIGKILL or not files())
    assert tool(tmp_path / "long", "--to", tmp_path / "a.h5", env={"TMPDIR": str(tmp_path)}).returncode == 0
    assert files() == {"a.h5"}
