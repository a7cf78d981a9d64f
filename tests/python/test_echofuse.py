# SPDX-License-Identifier: MIT
"""Tests how the Python package (recon/python) opens, reads and converts simulated runs."""
import concurrent.futures
import copy
import fcntl
import os
import shutil
import sqlite3
import struct
import subprocess
import sys
from contextlib import closing, contextmanager

import numpy as np
import pytest

import echofuse
from echofuse.runs import grid, run_files
from fixtures import BIN, change, changed, json_of, outcome, program, scenes


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("runs")
    shutil.copy(scenes(60), made / "monday.sqlite")
    return made


def test_open_finds_a_run_by_its_name_without_suffix(folder):
    run = echofuse.open(folder / "monday")
    assert len(run) == 60 and run.index.tolist() == list(range(60))
    assert run.info["status"] == "complete"
    assert sorted(set(label.split(":")[0] for label in run.labels)) == ["letter", "person"]
    assert run.time.dtype == np.dtype("datetime64[ns]") and (np.diff(run.time) > np.timedelta64(0)).all()
    assert all(mask.all() for mask in run.valid.values())
    assert run.axes["spd"].unit == "ps" and run.axes["radar"].unit == "m"
    assert run.axes["radar"].values[1] == run.axes["radar"].start + run.axes["radar"].step


# Removes what Python lacks on Windows, except for os.name.
WITHOUT_POSIX = """
import os, signal, sys
import numpy
sys.modules["fcntl"] = None
for module, names in (os, "O_CLOEXEC O_NONBLOCK O_NOFOLLOW O_DIRECTORY pread uname getuid geteuid fchmod"), (signal, "SIGHUP"):
    for name in names.split():
        delattr(module, name)
import echofuse
run = echofuse.open(sys.argv[1])
print(len(run), run.spd.sum(), run.radar.sum(), run.depth.sum(), run.info["status"])
"""


def test_closed_run_can_be_read_without_the_functions_that_windows_lacks(folder):
    found = subprocess.run([sys.executable, "-c", WITHOUT_POSIX, folder / "monday.sqlite"], capture_output=True, text=True, check=True)
    run = echofuse.open(folder / "monday")
    assert found.stdout.split() == [str(x) for x in (len(run), run.spd.sum(), run.radar.sum(), run.depth.sum(), "complete")]


def test_record_without_data_from_a_sensor_is_marked_as_invalid_for_that_sensor(folder, tmp_path):
    path = changed(folder / "monday.sqlite", tmp_path / "lost.sqlite", "no SPD and radar data in record ?1", 7)
    run = echofuse.open(path)
    assert not run.valid["radar"][7] and run.valid["radar"].sum() == 59
    assert np.isnan(run.radar[7]).all() and not np.isnan(run.radar[8]).any()
    assert (run.spd[7] == 0).all()
    change(path, "radar data of one byte in record ?1", 8)
    run = echofuse.open(path)
    assert np.isfinite(run[9].radar).all() and np.isnan(run[7].radar).all()  # one record is read without the others
    with pytest.raises(ValueError, match="record 8: radar has"):
        run.radar  # noqa: B018
    with pytest.raises(ValueError, match="record 8: radar has"):
        [record.radar for record in run]


def test_records_of_an_iteration_equal_the_rows_of_the_run(folder):
    run, again = echofuse.open(folder / "monday")[::-1], echofuse.open(folder / "monday")[::-1]
    for record, other in zip(run, again):
        for name in "spd", "radar", "depth":
            assert np.array_equal(getattr(record, name), getattr(again, name)[record.row], equal_nan=True)
        assert record.label == other.label and record.index == run.index[record.row]


def test_threads_may_read_the_arrays_of_one_run_at_the_same_time(folder):
    run = echofuse.open(folder / "monday")
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        for name in "spd", "radar", "depth":
            assert {len(table) for table in pool.map(lambda _, name=name: getattr(run, name), range(16))} == {60}
        assert {len(maps) for maps in pool.map(lambda _: run.maps(), range(16))} == {60}
    assert np.array_equal(run.depth, run.maps(), equal_nan=True)


def test_run_opened_with_a_relative_path_survives_a_change_of_the_folder(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    run = echofuse.open("monday")
    monkeypatch.chdir(tmp_path)
    assert run.path.is_absolute() and len(run.spd) == len(run.depth) == 60


@pytest.mark.parametrize("read", [
    lambda run: run.spd, lambda run: run[3].depth, lambda run: run.maps([1]), lambda run: run.table("record"),
    lambda run: next(run.follow()), lambda run: run[1:3].quality(), lambda run: run.tables,
    lambda run: echofuse.annotate(run, "late"), echofuse.Run.events, echofuse.Run.photons, echofuse.Run.refresh,
    echofuse.Run.to_xarray, echofuse.split])
def test_run_refuses_another_run_under_its_path(folder, tmp_path, read):
    for name in "a", "b":
        program("echofuse-sim", "dataset", "-q", "--out", tmp_path / f"{name}.sqlite", "--people", 5, "--letters", 0)
    run = echofuse.open(tmp_path / "a")
    with pytest.raises(RuntimeError, match="the note is empty"):
        echofuse.annotate(run, " ")
    os.replace(tmp_path / "b.sqlite", tmp_path / "a.sqlite")
    with pytest.raises(ValueError, match="a.sqlite: contains another run"):
        read(run)


def test_run_maps_equal_the_depth_images_and_are_cached(folder, tmp_path):
    run = echofuse.open(folder / "monday")
    assert np.array_equal(run.maps([5, 2]), run.depth[[5, 2]], equal_nan=True)
    maps = run.maps()
    assert np.array_equal(maps, run.depth, equal_nan=True) and not maps.flags.writeable
    assert np.shares_memory(maps, run.maps())


def test_map_pixel_is_the_upper_median_of_its_camera_pixels():
    axis = lambda name, count, half: echofuse.Axis(name, "tangent", "1", count, half / count - half, 2 * half / count, 1)  # noqa: E731
    columns, rows = (grid.cells(axis("camera", n, 0.5), axis("map", 5, 0.6)) for n in (23, 31))
    image = np.random.default_rng(1).integers(0, 8000, (31, 23)).astype(np.uint16)
    image[:, ::3] = 0
    found = grid.to_map(columns, rows, image.shape, 6)(image)
    for r, (top, bottom) in enumerate(rows):
        for c, (left, right) in enumerate(columns):
            cell = image[top:bottom, left:right].ravel()
            near = sorted(cell[(cell > 0) & (cell <= 6000)])
            enough = near and 2 * len(near) >= len(cell)
            assert found[r, c] == np.float32(near[len(near) // 2] / 1000) if enough else np.isnan(found[r, c])
    assert 0 < np.isnan(found).sum() < 25


@pytest.mark.parametrize("rows", [slice(10, 20), [7, 3, 3], np.array([], int), [], np.arange(60) % 7 == 0])
def test_indexing_a_run_gives_a_run_of_the_selected_records(folder, rows):
    run = echofuse.open(folder / "monday")
    part, wanted = run[rows], np.arange(60)[rows if len(np.shape(rows)) == 0 or len(rows) else slice(0)]
    assert part.index.tolist() == wanted.tolist() and part.labels == [run.labels[row] for row in wanted]
    for name in "spd", "radar", "depth", "time":
        assert np.array_equal(getattr(part, name), getattr(run, name)[wanted], equal_nan=name != "time")
    assert np.array_equal(part.maps(), run.maps(wanted), equal_nan=True)
    assert [record.index for record in part] == wanted.tolist() and run[np.int64(-1)].index == 59


def test_load_model_refuses_files_of_another_kind(folder, tmp_path):
    with pytest.raises(FileNotFoundError):
        echofuse.load_model(tmp_path / "m")
    for text in ("", "no model, but long enough to be read as one"):
        (tmp_path / "m").write_text(text)
        with pytest.raises(ValueError, match="not an echofuse model file"):
            echofuse.load_model(tmp_path / "m")
    with pytest.raises(ValueError, match="monday.sqlite: is a run; expected a model file"):
        echofuse.load_model(folder / "monday.sqlite")


@contextmanager
def writer_of(path):
    """Holds the lock that marks the run as being written by another program."""
    with open(f"{path}-lock", "w") as lock:
        fcntl.fcntl(lock, fcntl.F_OFD_SETLK, struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
        yield


def open_run(folder, path):
    """Creates an open run of three records in WAL mode. Returns the database connection that can append records."""
    path.write_bytes((folder / "monday.sqlite").read_bytes())
    db = sqlite3.connect(path, isolation_level=None)
    change(db, "open run of three records")
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("ATTACH ? AS whole", (str(folder / "monday.sqlite"),))
    return db


def killed_run(folder, path, records):
    """Creates the files left by kill -9: an open run, and its -wal file with more records and the key of the run."""
    live = path.with_suffix(".live")
    with closing(open_run(folder, live)) as db:
        change(db, "run of the program version ?1", "killed")  # creates the -wal
        change(db, "-wal key ?1", f"{run_files.wal_key(live):08x}")
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        change(db, "append the records ?1 to ?2 of the database whole", 3, records + 2)
        for suffix in ("", "-wal"):
            shutil.copy(f"{live}{suffix}", f"{path}{suffix}")


def test_follow_yields_the_records_of_a_growing_run_until_it_is_closed(folder, tmp_path):
    path = tmp_path / "live.sqlite"
    with closing(open_run(folder, path)) as db, writer_of(path):
        run = echofuse.open(path)
        assert len(run) == len(run.spd) == 3 and run.info["status"] == "open"
        rows = run.follow(pause_s=0.01)
        assert [next(rows) for _ in range(3)] == [0, 1, 2]
        before = run.spd, run.radar, run.depth, run.maps()
        change(db, "append the records ?1 to ?2 of the database whole", 3, 4)
        change(db, "histogram of one byte in record ?1", 1)  # records that were read are not read again
        assert next(rows) == 3 and len(run.spd) == 5
        whole = echofuse.open(folder / "monday")[:5]
        for old, new, wanted in zip(before, (run.spd, run.radar, run.depth, run.maps()), (whole.spd, whole.radar, whole.depth, whole.maps())):
            assert np.array_equal(new, wanted, equal_nan=True) and np.array_equal(old, wanted[:3], equal_nan=True)
        assert run.labels == whole.labels and np.array_equal(run.time, whole.time) and all(mask.all() for mask in run.valid.values())
        same = copy.copy(run)
        change(db, "append the records ?1 to ?2 of the database whole", 5, 6)
        run.refresh()
        assert len(same) == len(same.labels) == 5 and len(same.refresh()) == len(same.labels) == 7
        change(db, "status of the run", "complete")
        assert list(rows) == [4, 5, 6]
    assert "7 of 7" in run._repr_html_() and "<script" not in run._repr_html_()


@pytest.mark.parametrize("wal, status, count", [
    ("whole", "crashed", 10), *((wal, "crashed, no -wal", 3) for wal in (None, b"", bytes(4096)))])
def test_run_of_a_killed_program_has_status_crashed_and_follow_ends(folder, tmp_path, wal, status, count):
    path, link = tmp_path / "a.sqlite", tmp_path / "link.sqlite"
    killed_run(folder, path, 7)
    link.symlink_to(path)
    if wal is None:
        path.with_name("a.sqlite-wal").unlink()
    elif wal != "whole":
        path.with_name("a.sqlite-wal").write_bytes(wal)
    for name in path, link, path:
        run = echofuse.open(name)
        assert run.info["status"] == status and list(run.follow()) == list(range(count)) and "wal_key" not in run.meta
        told = json_of("echofuse-acquire", "info", name)
        assert (told["status"], told["records"]) == (status, count)
    if wal == "whole":
        program("echofuse-export", path, "--to", tmp_path / "a.h5")
    else:
        assert outcome("echofuse-acquire", "annotate", path, "x").returncode == 1
        assert sorted(file.name for file in tmp_path.glob("a.sqlite*")) == ["a.sqlite", *["a.sqlite-wal"] * (wal is not None)]


def test_open_refuses_a_wal_file_of_another_run(folder, tmp_path):
    path = tmp_path / "a.sqlite"
    killed_run(folder, path, 7)
    killed_run(folder, tmp_path / "b.sqlite", 12)
    shutil.copy(f"{tmp_path / 'b.sqlite'}-wal", f"{path}-wal")
    with pytest.raises(ValueError, match=r"a\.sqlite-wal belongs to another run \(key ") as refused:
        echofuse.open(path)
    assert outcome("echofuse-acquire", "info", path).stderr == f"echofuse-acquire: {refused.value}\n"
    assert sorted(file.name for file in tmp_path.glob("a.sqlite*")) == ["a.sqlite", "a.sqlite-wal"]


@pytest.mark.parametrize("files", [["-wal"], ["-wal", "-shm"], ["-journal"]])
def test_wal_and_journal_files_of_a_closed_run_are_ignored_with_a_warning(folder, tmp_path, files):
    path, other = tmp_path / "closed.sqlite", tmp_path / "other.sqlite"
    for copied in path, other:
        copied.write_bytes((folder / "monday.sqlite").read_bytes())
    # A killed program leaves these files: -wal and -shm, or the -journal of an unfinished transaction.
    with closing(sqlite3.connect(other, isolation_level=None)) as db:
        db.execute(f"PRAGMA journal_mode = {'DELETE' if '-journal' in files else 'WAL'}")
        db.executescript("PRAGMA cache_size = 1; BEGIN IMMEDIATE; UPDATE record SET label = 'x', spd = zeroblob(100000)"
                         + ("" if "-journal" in files else "; COMMIT"))
        for suffix in files:
            shutil.copy(f"{other}{suffix}", f"{path}{suffix}")
    before = {file.name: file.read_bytes() for file in tmp_path.glob("closed*")}
    with pytest.warns(UserWarning) as warned:
        run = echofuse.open(path)
    wanted = [f"{path}{suffix}: not read, because the run is closed; move it away" for suffix in files]
    assert [str(one.message) for one in warned] == wanted
    assert (run.spd == echofuse.open(folder / "monday").spd).all() and run.info["status"] == "complete"
    done = outcome("echofuse-export", path, "--to", tmp_path / "x.h5")
    assert done.returncode == 0 and all(text in done.stderr for text in wanted)
    assert {file.name: file.read_bytes() for file in tmp_path.glob("closed*")} == before


def test_closing_a_connection_keeps_the_locks_of_other_connections(folder, tmp_path):
    """SQLite uses POSIX locks, which a process loses when it closes any descriptor of the file."""
    path = tmp_path / "live.sqlite"
    shutil.copy(folder / "monday.sqlite", path)
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA journal_mode = WAL")
        change(db, "status of the run", "open")
        db.commit()
        with closing(run_files.connect(path)) as first:
            first.execute("SELECT count(*) FROM record").fetchone()
            run_files.connect(path).close()
            code = f"import sqlite3; print(*sqlite3.connect({str(path)!r}, timeout=0).execute('PRAGMA journal_mode=DELETE').fetchone())"
            db.close()
            other = subprocess.run(["/usr/bin/python3", "-c", code], capture_output=True, text=True)
            assert "locked" in other.stderr or other.stdout.strip() == "wal"


@pytest.mark.parametrize("name", ["T4.2K", "gain1.5", "2026.11.25", "a.sqlite.b", ".hidden"])
def test_all_programs_map_a_run_name_with_a_dot_to_the_same_file(folder, tmp_path, name):
    shutil.copy(folder / "monday.sqlite", tmp_path / f"{name}.sqlite")
    for given in (name, f"{name}.sqlite"):
        assert len(echofuse.open(tmp_path / given)) == 60
        assert json_of("echofuse-acquire", "info", tmp_path / given)["file"] == str(tmp_path / f"{name}.sqlite")
    program("echofuse-export", tmp_path / name, "--to", tmp_path / "x.h5")


def test_open_accepts_the_tables_of_sqlite_analyze(folder, tmp_path):
    path = tmp_path / "a.sqlite"
    shutil.copy(folder / "monday.sqlite", path)
    with closing(sqlite3.connect(path)) as db:
        db.executescript("CREATE INDEX i ON record (label); ANALYZE; DROP INDEX i")
    assert echofuse.open(path).tables == echofuse.open(folder / "monday").tables


@pytest.mark.parametrize("sql, values, said", [
    ("SELECT idx FROM records", (), "no such table: records"), ("SELECT", (), "incomplete input"),
    ("SELECT idx FROM record WHERE idx = ?", (), "Incorrect number of bindings"), ("SELECT 1; SELECT 2", (), "one statement at a time"),
    ("ATTACH 'new.sqlite' AS new", (), "too many attached"), ("CREATE INDEX place ON record(label)", (), "readonly database"), ("SELECT ?", (object(),), "Error binding parameter"),
    ("SELECT idx FROM record LIMIT 'a'", (), "datatype mismatch"), ("SELECT zeroblob(3e9)", (), "too big"), ("SELECT ?", (1 << 70,), "too large"),
])
def test_invalid_query_is_not_reported_as_damage(folder, sql, values, said):
    run = echofuse.open(folder / "monday")
    assert run.select("SELECT max(idx) FROM record") == [(59,)]
    with pytest.raises(ValueError, match=f"monday.sqlite: query rejected: .*{said}.*"):
        run.select(sql, *values)
    with pytest.raises(ValueError, match="monday.sqlite: has no table 'records'"):
        run.table("records")


def test_reading_a_run_leaves_no_database_connection_open(folder):
    run = echofuse.open(folder / "monday")
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(50):
        run.refresh()
        run.spd, run.radar, run.photons()
    assert len(os.listdir("/proc/self/fd")) <= before


def test_closed_run_in_wal_mode_can_be_read_from_a_read_only_folder(folder, tmp_path):
    closed = tmp_path / "closed"
    closed.mkdir()
    shutil.copy(folder / "monday.sqlite", closed)
    with closing(sqlite3.connect(closed / "monday.sqlite")) as db:
        assert db.execute("PRAGMA journal_mode = WAL").fetchone() == ("wal",)
    # File permissions do not restrict root, so root drops its capabilities.
    as_user = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []
    look = f"import echofuse; print(len(echofuse.open({str(closed / 'monday')!r})))"
    for wal, said in (None, "60\n"), (b"", "60\n"), (b"records", "monday.sqlite-wal; copy both"):
        if wal is not None:
            (closed / "monday.sqlite-wal").write_bytes(wal)
        closed.chmod(0o500)
        done = subprocess.run([*as_user, "/usr/bin/python3", "-c", look], text=True, capture_output=True)
        closed.chmod(0o700)
        assert said in done.stdout + done.stderr
        assert wal is not None or os.listdir(closed) == ["monday.sqlite"]


def test_record_function_records_a_run_and_returns_it(tmp_path, monkeypatch):
    laboratory = ["echofuse-sim", "lab", "--dir", tmp_path / "lab", "--scene", "person", "--hold", "0.2", "--window", "0.2", "--"]
    code = """if True:
        import echofuse, numpy as np
        run = echofuse.record("%s/lab/lab.toml", count=2, label='["here"]', out="%s/%%Y",
                              settings={"radar.keep_running": True, "run.window_s": np.float64(0.2)})
        echofuse.annotate(run, "-a note")
        print(len(run), run.labels, run.info["status"], run.refresh().events()[-1][-1])
        try:
            echofuse.record("%s/lab/lab.toml", out="%s/%%Y")
        except RuntimeError as error:
            print(error)""" % (4 * (tmp_path,))
    monkeypatch.setenv("ECHOFUSE_ACQUIRE", str(BIN / "echofuse-acquire"))
    said = subprocess.run([BIN / laboratory[0], *map(str, laboratory[1:]), "/usr/bin/python3", "-c", code],
                          text=True, capture_output=True, timeout=60)
    assert """2 ['["here"]', '["here"]'] complete -a note""" in said.stdout, said.stderr
    assert "%Y.sqlite" in said.stdout.splitlines()[-1] and "exist" in said.stdout.splitlines()[-1]


def test_to_xarray_returns_arrays_with_units_and_coordinates(folder, tmp_path):
    pytest.importorskip("xarray")
    data = echofuse.to_xarray(echofuse.open(folder / "monday"))
    assert data.spd.dims == ("record", "spd_time") and data.spd_time.attrs["units"] == "ps"
    assert data.depth.sizes["depth_y"] == 64
    assert data.spd_range.attrs["units"] == data.depth.attrs["units"] == "m" and data.spd_range[0] == pytest.approx(2, abs=0.01)
    assert set(data.spd_verdict.values) == {"ok"}
    assert int((data.label == "person").sum()) == 15
    own = echofuse.write_run(tmp_path / "own", spd=data.spd, labels=data.label, program=BIN / "echofuse-acquire")
    assert np.array_equal(own.spd, data.spd) and own.labels == data.label.values.tolist()


def test_to_pandas_returns_one_row_per_record(folder):
    pytest.importorskip("pandas")
    run = echofuse.open(folder / "monday")
    table = run[[3, 7]].to_pandas()
    assert table.index.name == "record" and table.index.tolist() == [3, 7] and table.label.tolist() == [run.labels[3], run.labels[7]]
    assert table.spd_valid.all() and table.time.iloc[0] == run.time[3] and (table.length_s > 0).all()
