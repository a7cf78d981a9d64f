# SPDX-License-Identifier: MIT
"""Python reads every array of a run as the programs do: 20 runs of random sizes, sensors and values, written by C++."""
import contextlib
import gzip
import os
import pathlib
import sqlite3
import subprocess
import zlib

import numpy as np
import pytest

import echofuse
from programs import BIN


def test_arrays_of_twenty_runs(tmp_path):
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


def test_another_format_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "run.sqlite"
    subprocess.run([BIN / "echofuse-sim", "dataset", "-q", "--records", "2", "--out", path], check=True)
    for version, advice in ((1, "expected 2; scripts/convert_run makes"), (3, "expected 2; use a newer echofuse")):
        with sqlite3.connect(path) as db:
            db.execute(f"PRAGMA user_version = {version}")
        with pytest.raises(ValueError, match=f"run format {version}, {advice}"):
            echofuse.open(path)


def test_a_conversion_that_fails_leaves_nothing_and_says_why(tmp_path):
    root, old, new = pathlib.Path(__file__).parents[2], tmp_path / "old.sqlite", tmp_path / "new.sqlite"

    def convert(blocks="unlimited"):
        done = subprocess.run(["sh", "-c", f"ulimit -f {blocks}; exec \"$@\"", "sh", root / "scripts/convert_run", old, new], capture_output=True, text=True)
        return done.returncode, done.stderr

    old.write_text("no database, but long enough to be read as one " * 20)
    assert convert() == (1, f"{old}: file is not a database\n")
    old.write_bytes(gzip.decompress((root / "tests/golden/run-0.1.0.sqlite.gz").read_bytes()))
    code, said = convert(8)
    assert code == 6 and said.startswith(f"{new}: cannot write (") and said.count("\n") == 1
    with sqlite3.connect(old) as db:
        rows = [(idx, bytearray(png)) for idx, png in db.execute("SELECT idx, depth FROM record WHERE depth IS NOT NULL")]
        idx, png = rows[0]
        at = png.index(b"IDAT")
        data = bytearray(zlib.decompress(png[at + 4:at + 4 + int.from_bytes(png[at - 4:at], "big")]))
        data[0] = 1  # the filter of the first row
        packed = zlib.compress(data)
        png[at - 4:] = len(packed).to_bytes(4, "big") + b"IDAT" + packed + bytes(4) + bytes(png[-12:])
        db.execute("UPDATE record SET depth = ? WHERE idx = ?", (bytes(png), idx))
    db.close()
    assert convert() == (1, f"{old}: a depth image is no 16-bit grey PNG without filters, as versions up to 0.1.0 recorded\n")
    assert not [name for name in os.listdir(tmp_path) if "new" in name]


def test_a_conversion_cleans_up_what_a_killed_one_left(tmp_path):
    """Killed while it wrote, or just before its file had its name; one that still writes is left alone."""
    convert, old = pathlib.Path(__file__).parents[2] / "scripts/convert_run", tmp_path / "old.sqlite"
    old.write_bytes(gzip.decompress((convert.parents[1] / "tests/golden/run-0.1.0.sqlite.gz").read_bytes()))
    dumps = []
    for number, end in enumerate(("", "os.kill(os.getpid(), 9)", "db.commit()")):
        new = tmp_path / f"{number}.sqlite"
        hidden = tmp_path / f".{new.name}.unfinished"
        write = (f"import os, sqlite3; db = sqlite3.connect({str(hidden)!r}); db.execute('PRAGMA cache_size = 1'); db.execute('BEGIN'); "
                 f"db.execute('CREATE TABLE run (x)'); db.execute('INSERT INTO run VALUES (zeroblob(2000000))'); {end}")
        if end:
            subprocess.run(["/usr/bin/python3", "-c", write], check=False)
            assert hidden.stat().st_size > 1_000_000
        subprocess.run([convert, old, new], check=True)
        assert not list(tmp_path.glob(".*"))
        with contextlib.closing(sqlite3.connect(new)) as db:
            dumps.append(list(db.iterdump()))
    assert dumps[0] == dumps[1] == dumps[2]
    with contextlib.closing(sqlite3.connect(tmp_path / ".new.sqlite.unfinished")) as other:
        other.execute("BEGIN EXCLUSIVE")
        done = subprocess.run([convert, old, tmp_path / "new.sqlite"], capture_output=True, text=True)
        assert done.returncode == 1 and "new.sqlite: another process is making it" in done.stderr
        assert (tmp_path / ".new.sqlite.unfinished").exists() and not (tmp_path / "new.sqlite").exists()
