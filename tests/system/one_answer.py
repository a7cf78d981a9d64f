#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that info, list, the live page, Python, HDF5, report and evaluate report the same facts about unusual runs. The
runs have failing sensors, a full disk, a killed daemon, copied records, a single record or no record."""
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import subprocess
import sys
import warnings
from collections import Counter

import live
from live import WINDOW_S, bin_dir, wait_for

import fixtures
from fixtures import outcome
from page_socket import Client
from case import source

os.environ |= {"ECHOFUSE_BIN": str(bin_dir), "PYTHONPATH": str(source / "recon/python")}

try:
    import h5py
    import numpy as np

    import echofuse
except ImportError as error:
    print(f"skipped: {error} (./scripts/setup --tests)")
    sys.exit(77)
warnings.simplefilter("ignore")  # The files left behind by the killed daemon cause warnings.
SENSORS = {"spd": 1, "radar": 2, "depth": 4}
# The camera stalls three times, because the run may start after the first stall on a busy machine.
FAULTS = "".join(f'[[fault]]\ndevice = "{device}"\nkind = "{kind}"\nat_s = {at}\nfor_s = {5 * WINDOW_S}\n{amount}\n'
                 for device, kind, at, amount in (*(("depth", "stall", at, "") for at in (3.5, 9, 14)), ("radar", "drop", 5, "amount = 0.5"),
                                                  ("tdc", "gain", 6, "amount = 0.002"), ("depth", "freeze", 7, "")))


def kinds(verdicts):
    """Returns the number of records for each kind of verdict. The kind is the text before the colon."""
    return dict(Counter(verdict.partition(":")[0] for verdict in verdicts))


def doubtful(verdicts):
    """Returns the number of records in which at least one sensor's verdict marks the data as doubtful. `verdicts`
    contains the list of verdicts of each sensor."""
    return sum(any(v.partition(":")[0] not in ("", "ok", "not configured") for v in row) for row in zip(*verdicts.values()))


def of_info(run):
    told = json.loads(outcome("echofuse-acquire", "info", "--json", run).stdout)
    keys = "records status valid lost labels verdicts uuid meta doubtful doubts incomplete all_valid operator window_s"
    out = {key: told[key] for key in (*keys.split(), "started_utc", "ended_utc", "first_slot_utc")}
    return out | {"unwritten": told["counters"].get("run", {}).get("unwritten", 0), "events": sum(told["events"].values()),
                  "notes": [told["notes"]] * bool(told["notes"]) + [m["text"] for m in told["marks"] if m["kind"] == "note"],
                  "leftovers": [pathlib.Path(file).name for file in told["leftovers"]],
                  "unconfigured": [s for s in SENSORS if set(told["verdicts"][s]) == {"not configured"}]}


def of_list(run):
    told = json.loads(outcome("echofuse-acquire", "list", "--json", run.parent).stdout)["runs"]
    one, = (entry for entry in told if entry["path"] == str(run))
    keys = "records status valid labels doubtful notes operator window_s started_utc"
    return {key: one[key] for key in keys.split()} | {"doubts": one["verdict"], "length_s": round(one["length_s"], 3),
                                                      "leftovers": [pathlib.Path(file).name for file in one["leftovers"]]}


def of_view(run):
    view = subprocess.Popen([bin_dir / "echofuse-view", run, "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL, text=True)
    try:
        client = Client(view.stdout.readline().strip())
        head = client.until("run")
        state = client.until("state")
        client.socket.close()
    finally:
        view.kill()
        view.communicate()
    sensors, n = state["sensors"], state["records"]
    facts = dict(map(tuple, head["facts"]))
    there = [s for s in SENSORS if sensors[s]["configured"]]
    return {"records": n, "status": state["status"], "doubts": state["doubts"], "uuid": head["uuid"], "operator": head["operator"],
            "lost": {s: sensors[s]["lost"] for s in SENSORS}, "started_utc": head["started_utc"],
            "ended_utc": facts.get("ended", ""), "window_s": head["window_s"], "length_s": round(state["elapsed_s"], 3),
            "valid": {s: n - sensors[s]["missing"] if s in there else 0 for s in SENSORS},
            "notes": [head["notes"]] * bool(head["notes"]) + [e["text"] for e in state["events"] if e["level"] == "note"],
            "unconfigured": [s for s in SENSORS if n and s not in there]}


def of_python(run):
    with echofuse.open(run) as opened:
        told, info = opened.quality(), opened.info
        verdicts = {s: told[f"{s}_verdict"].tolist() for s in SENSORS}
        counters = opened.table("counter")
        record = opened.table("record")
        notes = [text for _, level, _, text in opened.events() if level == "note"]
        stored = {key: info[key] for key in ("status", "uuid", "started_utc", "ended_utc", "operator", "window_s")}
        return stored | {
                "records": len(opened), "meta": opened.meta, "labels": dict(Counter(opened.labels)),
                "valid": {s: int(opened.valid[s].sum()) for s in SENSORS},
                "all_valid": int(np.all(list(opened.valid.values()), 0).sum()),
                "lost": {s: int(told[f"{s}_lost"].sum()) for s in SENSORS}, "verdicts": {s: kinds(verdicts[s]) for s in SENSORS},
                "doubtful": doubtful(verdicts), "incomplete": int((record["missing"] > 0).sum()), "events": len(opened.events()),
                "notes": [info["notes"]] * bool(info["notes"]) + notes, "follow": len(list(opened.follow())),
                "unwritten": int(counters["value"][counters["name"] == b"unwritten"].sum()),
                "first_slot_utc": f"{np.datetime64(opened.time[0], 'ms')}Z" if len(opened) else "",
                "unconfigured": [s for s in SENSORS if set(verdicts[s]) == {"not configured"}]}


def of_hdf5(run, folder):
    place = folder / "x.h5"
    place.unlink(missing_ok=True)
    done = outcome("echofuse-export", run, "--to", place)
    assert done.returncode == 0, done.stderr
    with h5py.File(place) as file:
        entry, text = file["entry"], lambda values: [value.decode() for value in values]
        valid = sum(bit * entry[f"data/{s}_valid"][()].astype(int) for s, bit in SENSORS.items())
        verdicts = {s: text(entry[f"data/{s}_verdict"][()]) for s in SENSORS}
        counter, event, record = (entry[f"tables/{name}"] for name in ("counter", "event", "record"))
        title, one = entry["title"][()].decode(), lambda name: entry[name][()].decode()
        notes = [what for level, what in zip(text(event["level"][()]), text(event["text"][()])) if level == "note"]
        meta = json.loads(entry["tables/run/meta"][0])
        meta.pop("wal_key", None)
        return {"records": len(valid), "status": one("status"), "started_utc": one("start_time"), "ended_utc": one("end_time"),
                "operator": one("operator"), "uuid": one("entry_identifier"), "meta": meta,
                "valid": {s: int((valid & bit > 0).sum()) for s, bit in SENSORS.items()}, "all_valid": int((valid == 7).sum()),
                "labels": dict(Counter(text(entry["data/label"][()]))), "verdicts": {s: kinds(verdicts[s]) for s in SENSORS},
                "lost": {s: int(entry[f"data/{s}_lost"][()].sum()) for s in SENSORS}, "doubtful": doubtful(verdicts),
                "incomplete": int((record["missing"][()] > 0).sum()), "notes": [title] * bool(title) + notes,
                "unwritten": sum(int(value) for name, value in zip(counter["name"][()], counter["value"][()])
                                 if name == b"unwritten"),
                "events": len(event["id"]), "leftovers": [pathlib.Path(line.split(": ")[1]).name for line in done.stderr.splitlines()]}


def of_report(run, folder):
    shutil.rmtree(folder / "page", ignore_errors=True)
    done = outcome("echofuse-report", folder / "page", "--live", run)
    assert done.returncode == 0, done.stderr
    page = (folder / "page/report.html").read_text(encoding="utf-8")
    status, n = re.search(r'run is ([^<]*?): (\d+) records?\b', page).groups()
    doubts = re.search(r'; (\d+ of \d+ doubtful: [^<]*?)\.<', page)
    lack = re.search(r"(\d+) without a required sensor", page)
    return {"records": int(n), "status": status, "doubts": doubts[1] if doubts else "", "incomplete": int(lack[1]) if lack else 0}


class OneAnswer(live.Live):
    @property
    def lab_options(self):
        (self.dir / "faults.toml").write_text(FAULTS)
        return (*live.Live.lab_options, "--faults", self.dir / "faults.toml")

    def recorded(self, name, *options, limit=None, kill_at=None):
        """Records the run self.dir/NAME.sqlite and returns the exit code of the daemon."""
        self.run = self.dir / f"{name}.sqlite"
        daemon = self.record(*options, preexec_fn=limit and (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))))
        if kill_at is not None:
            wait_for("records", lambda: self.committed() >= kill_at and self.run.exists())
            daemon.send_signal(signal.SIGKILL)
        log = self.finish(daemon, code=None, timeout_s=30 + 150 * WINDOW_S)
        self.assertIn(daemon.returncode, (0, 6, -signal.SIGKILL), log)
        return daemon.returncode

    def answers(self, run):
        """Returns the facts that each program reports about a run. info and report are called last, because info
        closes the run of a killed daemon."""
        out = {"list": of_list(run), "view": of_view(run), "Python": of_python(run), "HDF5": of_hdf5(run, self.dir)}
        return out | {"info": of_info(run), "report": of_report(run, self.dir)}

    def check(self, name, **expected):
        run = self.dir / f"{name}.sqlite"
        told = self.answers(run)
        self.assertLessEqual(expected.keys(), set().union(*told.values()), name)
        for question in sorted(set().union(*told.values())):
            with self.subTest(run=name, question=question):
                found = {program: answers[question] for program, answers in told.items() if question in answers}
                for program, answer in found.items():
                    self.assertEqual(answer, expected.get(question, [*found.values()][0]), (program, found))
        return told["info"]

    def check_scored(self):
        """evaluate scores the records that have a depth map and no data marked as doubtful. The counts of the other
        records agree with `info`."""
        model, run = fixtures.model("ridge", fixtures.scenes(60)), self.dir / "scored.sqlite"
        fixtures.changed(fixtures.scenes(60, 5), run, "verdict ?3 of the camera in the records from ?1 to ?2", 5, 10, "stands still: 3")
        fixtures.change(run, "verdict ?3 of the SPD in the records from ?1 to ?2", 20, 22, "weak: 1 clicks")
        fixtures.change(run, "no radar frames in the records from ?1 to ?2", 30, 31)
        fixtures.change(run, "no frames of the required camera in the records from ?1 to ?2", 40, 42)
        fixtures.change(run, "record ?1 lost ?2 SPD data, ?3 radar frames and ?4 depth frames", 50, 7, 2, 1)
        info = self.check("scored", status="complete", doubtful=14, incomplete=3, lost={"spd": 7, "radar": 2, "depth": 1})
        scored = json.loads(outcome("echofuse-recon", "evaluate", model, run, "--json").stdout)
        left_out = scored["doubtful"]["records"]
        self.assertEqual(left_out, {"SPD weak": info["verdicts"]["spd"]["weak"], "camera stands still": info["verdicts"]["depth"]["stands still"]})
        self.assertEqual(scored["records"] + sum(left_out.values()), info["valid"]["depth"])
        self.assertEqual(scored["fallback_records"], info["records"] - info["valid"]["radar"])

    def test_all_programs_report_the_same_contents_of_a_damaged_run(self):
        required = "--set", "depth.policy=required"
        self.assertEqual(self.recorded("odd", *required, "--set", "run.label=first", "--meta", "lens=50mm", "--count", str(round(6 / WINDOW_S))), 0)
        for words in (["the lens was dirty"], ["<b>a second note</b>"]):
            self.assertEqual(outcome("echofuse-acquire", "annotate", self.run, *words).returncode, 0)
        self.assertEqual(self.recorded("full", "--set", "depth.address=", "--set", "run.label=x", limit=256 << 10), 6)
        self.recorded("killed", "--meta", "lens=50mm", kill_at=4)
        self.recorded("one", "--count", "1", "--set", "run.label=a b")
        self.recorded("zero", kill_at=0)
        self.recorded("T4.2K", "--count", "2")
        killed = self.dir / "killed.sqlite"
        shutil.copy(killed, self.dir / "alone.sqlite")
        shutil.copy(killed, self.dir / "emptied.sqlite")
        (self.dir / "emptied.sqlite-wal").touch()
        for suffix in ("", "-wal"):
            shutil.copy(f"{killed}{suffix}", self.dir / f"whole.sqlite{suffix}")
        shutil.copy(f"{killed}-wal", self.dir / "one.sqlite-wal")
        fixtures.query(self.dir / "whole.sqlite", "VACUUM INTO ?", str(self.dir / "snapshot.sqlite"))

        odd = self.check("odd", status="complete", meta={"lens": "50mm"} | of_info(self.dir / "odd.sqlite")["meta"],
                         notes=["the lens was dirty", "<b>a second note</b>"])
        self.assertGreater(min(odd["doubtful"], odd["incomplete"]), 0)
        full = self.check("full", status="stopped:disk", unconfigured=["depth"], leftovers=[])
        self.assertGreater(full["unwritten"], 0)
        self.check("one", records=1, labels={"a b": 1}, leftovers=["one.sqlite-wal"])
        self.check("T4.2K", records=2, status="complete")
        self.check("alone", status="crashed, no -wal", ended_utc="")
        self.check("emptied", status="crashed, no -wal")
        self.check("snapshot", status="copy of an open run")
        self.assertGreaterEqual(self.check("killed", status="crashed", ended_utc="")["records"], 4)
        self.check("zero")
        self.check_scored()


live.main(OneAnswer)
