#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests what each program answers to damaged, foreign and malicious run files. Each command must end soon, use little
memory, print a single error line and return a documented exit code. Malicious strings from runs and devices must not
affect a terminal or a spreadsheet."""
import contextlib
import json
import os
import pathlib
import re
import resource
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
import threading
import zlib

from case import SharedCase, bin_dir, main, source
import fixtures
sys.path.insert(0, str(source / "scripts/bridges"))
import bridge
import pack

PACKAGE = source / "recon/python"
RECORDS = 12
sanitized = b"__asan_init" in (bin_dir / "echofuse-acquire").read_bytes()
# Time limit for each command in s. A command usually takes a fraction of a second.
MOST_S = 60
MOST_MIB = 4000 if sanitized else 700
DOCUMENTED = {0, 1, 2, 3, 4, 5, 6}


def depth(blob, width=None, height=None):
    def changes(run):
        hostile(run, "depth image ?1", blob)
        for axis, count in (("depth_x", width), ("depth_y", height)):
            if count is not None:
                fixtures.change(run, "axis ?1 has ?2 points", axis, count)
    return changes


def strange_name(run):
    with contextlib.closing(sqlite3.connect(run)) as db:
        db.execute("CREATE TABLE \"a\x1b[31m\nb\" (x)")


def hostile(run, name, *values):
    fixtures.change(run, name, *values, file="hostile.sql" if name in fixtures.changes("hostile.sql") else "damage.sql")


def replaced_by(create):
    """Returns a change that replaces the run by what `create` creates."""
    def change(run):
        run.unlink()
        create(run)
    return change


# A user's script that reads all arrays of a run.
READ = """
import sys, echofuse
try:
    with echofuse.open(sys.argv[1]) as run:
        run.spd, run.radar, run.depth, run.photons(), run.events()
except (ValueError, OSError) as error:
    sys.exit(str(error))
"""
ZONES = "table zone: expected at most 64 zones, each with a centre, a width and a time-zero offset"
# Each row contains a change of a valid run, and the words that the error line of every reader must contain. Some readers
# give other answers: other words, or "reads" if they accept the input.
NOT_RUNS = [
    (replaced_by(lambda run: run.write_text("no database, but long enough to be read as one " * 20)), "not an echofuse run file"),
    (replaced_by(lambda run: run.write_bytes(struct.pack("<Q", 2) + b"{}")), "is a model; expected a run file"),
    (replaced_by(os.mkfifo), "is a FIFO; expected a regular file", {"export python": "is not a regular file; expected a run file"}),
    (replaced_by(os.mkdir), "is a folder; expected a regular file", {"export python": "is a folder; expected a run file",
                                                                      "view": "the run does not exist yet"}),
    (pathlib.Path.unlink, "No such file or directory; expected a run file", {"export python": "no such run file"}),
    ("run format 2", "run format 2, expected 4; use the echofuse that recorded it"),
    ("run format 3", "run format 3, expected 4; convert it: python3 -m echofuse.runs.convert OLD NEW"),
    ("run format 5", "run format 5, expected 4; use a newer echofuse"),
    ("table with a quotation mark", 'remove it with: DROP TABLE "m""y"'),
]
FOREIGN_TABLES = [
    *((change, "expected only the tables of a run") for change in ("endless view", "endless view of events", "trigger", "index", "virtual table")),
    (strange_name, "a\\x1b[31m\\nb"),
    *((change, "its table event does not have the expected definition") for change in ("generated column", "default")),
    *((change, "its table late does not have the expected definition") for change in ("check", "no rowid")),
    ("no table of records", "has no table record"),
]
METADATA = [(("metadata of the run", text), "meta is not a JSON object of strings") for text in ("", "[", "[]", "{\"a\": 1}", "[" * 100000, "null", 7)]
WRONG = {"export python": "plausible positions", "note": "reads"}
AXES = [
    ("negative", "table axis: count is -1", WRONG), ("4e9", "has 4294967295 points", WRONG),
    ("wrapped", "table axis: count is 4294967", WRONG), ("1e7", "do not fit into a file of", WRONG),
    *((change, "expected finite numbers", WRONG) for change in ("words", "infinite", "no step", "tiny", "huge")),
    ("8192 x 8192 pixels", "8192 points per record do not fit into a file of", {"export python note": "reads"}),
    ("many", "more than 16 axes", {"export python": "at most 16 axes", "note": "reads"}),
]
RECORD_NUMBERS = [(change, "expected 0 to 9007199254740992", {"note": "reads"}) for change in ("one at the end", "all at the end", "far")]
ZONE_TABLES = [
    *((change, ZONES, {"note": "reads"}) for change in ("zone without x", "zone without y", "zone of width 0", "zone of infinite width",
                                     "zone with an infinite time-zero offset", "a million zones")),
    *((change, "record 0: spd has 12096 bytes, but its axis requires", {"info view report note": "reads", "export": "12 records are unreadable"})
      for change in ("one more zone", "one more time bin")),
]


def pages_that_repeat(path, table):
    """Replaces the root page of a table with a tree of six interior pages. Each page contains 400 links to the next
    page, so that the table appears to have 4e15 rows."""
    (root,), (size,) = (fixtures.query(path, query, *values)[0] for query, *values in (
        ("SELECT rootpage FROM sqlite_schema WHERE name = ?", table), ("PRAGMA page_size",)))
    data = bytearray(path.read_bytes())
    leaf = data[(root - 1) * size:root * size]
    first_new = len(data) // size + 1
    below = [first_new + i for i in range(6)]
    fan = 400

    def interior(child):
        cell = struct.pack(">I", child) + b"\x01"
        content = size - fan * len(cell)
        head = struct.pack(">BHHHBI", 5, 0, fan, content, 0, child)
        pointers = b"".join(struct.pack(">H", content + i * len(cell)) for i in range(fan))
        return (head + pointers).ljust(content, b"\0") + cell * fan
    data[(root - 1) * size:root * size] = interior(below[0])
    for i in range(5):
        data += interior(below[i + 1])
    data += leaf
    data[28:32] = struct.pack(">I", len(data) // size)
    path.write_bytes(data)


class DamagedInputs(SharedCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.seed = cls.dir / "seed.sqlite"
        cls.model = cls.dir / "mean.h5"
        fixtures.program("echofuse-sim", "dataset", "--out", cls.seed, "--people", RECORDS, "--seed", 7, "-q")
        fixtures.program("echofuse-recon", "train", cls.seed, "--out", cls.model, "--model", "mean", "-q")
        cls.shapes = dict(fixtures.query(cls.seed, "SELECT name, count FROM axis"))
        assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss < 1024 * MOST_MIB

    def command(self, *words):
        program = words[0] if words[0] == sys.executable else bin_dir / f"echofuse-{words[0]}"
        most_before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        done = subprocess.run(list(map(str, (program, *words[1:]))), capture_output=True, stdin=subprocess.DEVNULL,
                              cwd=self.dir, env=os.environ | {"PYTHONPATH": str(PACKAGE)}, timeout=MOST_S)
        said = done.stderr
        self.assertIn(done.returncode, DOCUMENTED, (words, said[-500:]))
        most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss  # of all processes so far
        self.assertLessEqual(most, max(most_before, 1024 * MOST_MIB), words)
        self.assertIsNone(re.search(rb"[\x00-\x08\x0b-\x1f\x7f]", done.stdout + said), (words, said[:300]))
        if done.returncode == 1:
            self.assertEqual(said.count(b"\n"), 1, (words, said))
        return done.returncode, done.stdout, said.decode()

    def make(self, change, seed=None):
        run = self.dir / "run.sqlite"
        run.rmdir() if run.is_dir() else run.unlink(missing_ok=True)
        shutil.copy(seed or self.seed, run)
        if callable(change):
            change(run)
        elif change:
            hostile(run, *((change,) if isinstance(change, str) else change))
        return run

    def attack(self, run, *only):
        """Runs commands on a run file and returns the exit code of each command."""
        codes, self.said = {}, ""
        folder = tempfile.TemporaryDirectory()
        d = pathlib.Path(self.enterContext(folder))
        commands = {"info": ["acquire", "info", run], "json": ["acquire", "info", run, "--json"],
                    "export": ["export", run, "--to", d / "x.h5"], "python": [sys.executable, "-c", READ, run],
                    "view": ["view", run, "--save", d / "x.html"], "report": ["report", d / "page", "--live", run],
                    "csv": ["export", run, "--record", 3, "--to", d / "x.csv"],
                    "evaluate": ["recon", "evaluate", self.model, run, "--all"],
                    "reconstruct": ["recon", "reconstruct", self.model, run, "--out", d / "maps", "--format", "mm"],
                    "train": ["recon", "train", run, "--out", d / "x.model.h5", "--model", "mean", "-q"],
                    "label": ["acquire", "annotate", run, "--label", "hello"], "note": ["acquire", "annotate", run, "hello"]}
        for name in only or ("info", "json", "export", "csv", "evaluate", "reconstruct", "train", "label", "note"):
            before = run.read_bytes() if run.is_file() else None
            codes[name], out, said = self.command(*commands[name])
            self.said += said
            if name == "json" and codes[name] == 0:
                json.loads(out.decode("utf-8"))
            if name != "note" and before is not None:
                self.assertEqual(run.read_bytes(), before, f"{name} changed the run")
        folder.cleanup()
        return codes

    def check(self, rows, seed=None):
        for change, words, *others in rows:
            run = self.make(change, seed)
            answers = {reader: answer for names, answer in (others[0] if others else {}).items() for reader in names.split()}
            for reader in ("info", "train", "view", "report", "export", "python", "note"):
                with self.subTest(change, reader=reader):
                    code, expected = self.attack(run, reader)[reader], answers.get(reader, words)
                    self.assertEqual(code, 0 if expected == "reads" else 5 if "unreadable" in expected else 1, self.said)
                    self.assertIn("" if expected == "reads" else expected, self.said)

    def test_programs_refuse_files_that_are_not_runs(self):
        self.check(NOT_RUNS)

    def test_programs_refuse_a_run_with_an_invalid_zone_table(self):
        seed = self.dir / "zones.sqlite"
        self.command("sim", "dataset", "--out", seed, "--people", RECORDS, "--seed", 7, "-q", "--set", "spd_zones=3")
        self.check(ZONE_TABLES, seed)

    def test_all_commands_read_a_valid_run(self):
        codes = self.attack(self.make(""))
        self.assertEqual({n: c for n, c in codes.items() if c}, {"label": 1}, (codes, self.said))

    def test_programs_refuse_a_run_with_foreign_tables(self):
        self.check(FOREIGN_TABLES)

    def test_programs_refuse_a_run_with_invalid_metadata(self):
        self.check(METADATA)

    def test_commands_refuse_a_run_with_corrupt_database_pages(self):
        for table in ("record", "event", "run", "axis", "sqlite_schema"):
            with self.subTest(table):
                run = self.make("event")
                if table == "sqlite_schema":
                    with contextlib.closing(sqlite3.connect(run)) as db, db:
                        db.execute("PRAGMA writable_schema = ON")
                        db.execute("UPDATE sqlite_schema SET rootpage = 1 WHERE name = 'record'")
                else:
                    pages_that_repeat(run, table)
                codes = self.attack(run)
                # `info` reads only one row of the table `run`.
                self.assertEqual(codes["info"], 0 if table == "run" else 1, self.said)

    def test_programs_refuse_a_run_with_invalid_axes(self):
        self.check(AXES)
        codes = self.attack(self.make("empty axes"))
        self.assertEqual((codes["info"], codes["export"], codes["csv"]), (0, 5, 1), self.said)
        codes = self.attack(self.make("a million time bins"), "info", "export", "csv", "reconstruct")
        self.assertEqual((codes["info"], codes["export"], codes["csv"], codes["reconstruct"]), (0, 1, 1, 5), self.said)
        self.assertIn("but its axis requires 4000000", self.said)

    def test_commands_refuse_records_with_invalid_depth_images(self):
        n = self.shapes["depth_x"]
        size = 2 * n * n
        good = zlib.compress(b"\1\1" * n * n)
        cases = {"no data": depth(b""), "a picture": depth(b"\x89PNG\r\n\x1a\n" + bytes(9000)), "cut": depth(good[:-20]),
                 "too short": depth(zlib.compress(bytes(size - 2))), "too long": depth(zlib.compress(bytes(size + 2))),
                 "wrong sum": depth(good[:-1] + bytes([good[-1] ^ 1])), "number": depth(7),
                 "30000 x 3000": depth(zlib.compress(bytes(180_000_000), 9), 30000, 3000),
                 "2^30": depth(good, 1 << 20, 1 << 10), "4000 x 2000 of nothing": depth(zlib.compress(bytes(1000)), 4000, 2000)}
        for name, change in cases.items():
            with self.subTest(name):
                codes = self.attack(self.make(change), "export", "csv", "evaluate")
                # If an image has more pixels than the file can hold, the whole run is rejected. Other invalid images
                # cause only the record to be rejected.
                self.assertEqual((codes["export"], codes["csv"]), (1 if name == "2^30" else 5, 1), (codes, self.said))
                self.assertIn("depth is not a deflated image of", self.said)
        codes = self.attack(self.make(depth(good)), "export", "csv")
        self.assertEqual((codes["export"], codes["csv"]), (0, 0), self.said)

    def test_programs_refuse_a_run_with_invalid_record_numbers(self):
        self.check(RECORD_NUMBERS)
        codes = self.attack(self.make("negative record numbers"))
        self.assertEqual((codes["info"], codes["export"]), (1, 1), self.said)

    def test_commands_escape_control_characters_in_texts_of_a_run(self):
        for change in "control", "not UTF-8":
            with self.subTest(change):
                run = self.make(change)
                codes = self.attack(run, "info", "json", "export", "csv", "evaluate", "reconstruct")
                self.assertEqual({codes[n] for n in ("info", "json", "csv")}, {0}, self.said)
                for words in (["info", run], ["info", run, "--json"]):
                    out = self.command("acquire", *words)[1].decode("utf-8")
                    self.assertNotIn("\nforged", out)
                    self.assertEqual(out, "".join(c for c in out if c == "\n" or c.isprintable()))

    def test_csv_export_contains_no_cell_that_becomes_a_formula(self):
        run = self.make("formula")
        table = self.dir / "x.csv"
        self.assertEqual(self.command("export", run, "--record", 3, "--to", table)[0], 0)
        lines = table.read_text().splitlines()
        table.unlink()
        heads = [line for line in lines if line.startswith("#")]
        self.assertEqual(lines[:len(heads) + 1], [*heads, "sensor,x,y,value"])
        self.assertIn("label x\\n=cmd", heads[0])
        self.assertEqual(sum(line.startswith("spd,") for line in lines), self.shapes["spd"])
        for line in lines:
            self.assertIsNone(re.search(r"(^|[,;])[=+@]", line), line)

    def test_commands_escape_control_characters_in_texts_of_devices(self):
        pack.crc32c = fixtures.crc32c
        server, over = bridge.Server(("127.0.0.1", 0)), threading.Event()

        def send():
            while not over.wait(0.05):
                server.send(bridge.TAGS, bytes(16), 1)
        sender = threading.Thread(target=send)
        sender.start()
        try:
            evil = "m\x1b[2J\r\nforged line\u202e\x9b"
            server.online({"model": evil, "serial": evil, "firmware": evil})
            config = self.dir / "evil.toml"
            config.write_text(f"[run]\nconnect_timeout_s = 1.5\n[tdc]\naddress = \"bridge:tcp://127.0.0.1:{server.address[1]}\"\n")
            for words in (["devices", "--config", config], ["devices", "--json", "--config", config],
                          ["doctor", "--config", config],
                          ["run", "--config", config, "--out", self.dir / "evil", "--count", 1, "--set",
                           "run.window_s=0.3"], ["info", self.dir / "evil"]):
                _, out, said = self.command("acquire", *words)
                text = out.decode("utf-8") + said
                # Both commands print the model name of the device.
                if words[0] in ("devices", "info"):
                    self.assertIn("forged", text, words)
                self.assertNotIn("\nforged", text)
                self.assertEqual(text, "".join(c for c in text if c == "\n" or c.isprintable()))
        finally:
            over.set()
            sender.join()
            server.close()

    def test_extreme_values_in_a_run_give_documented_exit_codes(self):
        for change in ("null", "no run", "no axis", "no record", "no axis, spd not valid", "valid", "times", "past", "window",
                       "counts", "swapped", "other types", ("full bins", b"\xff" * 4 * self.shapes["spd"]), "notes",
                       "long value", "settings", "offset", "no offset", "names"):
            with self.subTest(change):
                self.attack(self.make(change), "info", "json", "export", "csv", "reconstruct", "train")


main(DamagedInputs)
