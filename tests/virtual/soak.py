#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Records in virtual time with random faults of several devices at the same time.

Every slot must have a record, and scripts/audit_run.py must account for every loss. No slot may be late. A second run of the
first hour must be bit-identical to the first run. If a condition is not met, the exit code is 1."""
import argparse
import hashlib
import importlib.machinery
import importlib.util
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fixtures"))
from fixtures import query  # noqa: E402

scripts = pathlib.Path(__file__).resolve().parents[2] / "scripts"
WINDOW_S = 3
folder_in_memory = "/dev/shm" if os.path.isdir("/dev/shm") else None  # keeps disk delays out of the measured time
PAUSE_S = 40  # mean time between the starts of two faults in the same device


def load(name):
    loader = importlib.machinery.SourceFileLoader(name, str(scripts / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
    loader.exec_module(module)
    return module


def faults(seconds, seed):
    """Draws random faults in the same way as scripts/soak, but without garbage data from the depth camera."""
    soak = load("soak")
    soak.PAUSE_S = PAUSE_S
    soak.TROUBLE["depth"] = [trouble for trouble in soak.TROUBLE["depth"] if trouble[0] != "garbage"]
    return soak.fault_text(soak.random_faults(seconds, seed))


def record(program, folder, fault_text, slots, seed):
    """Records a run and returns the processor time used, in seconds."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "faults.toml").write_text(fault_text)
    done = subprocess.run([program, "--out", folder / "run.sqlite", "--slots", str(slots), "--window", str(WINDOW_S), "--seed",
                           str(seed), "--name", str(os.getpid()), "--faults", folder / "faults.toml", "--log", folder / "log.jsonl"], check=True,
                          stdout=subprocess.PIPE, text=True)
    return float(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("--hours", type=float, default=24)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    slots = round(3600 * args.hours / WINDOW_S)
    fault_text = faults(slots * WINDOW_S, args.seed)
    wrong = []
    with tempfile.TemporaryDirectory(prefix="echofuse-", dir=folder_in_memory) as name:
        folder = pathlib.Path(name)
        cpu_s = record(args.program, folder / "whole", fault_text, slots, args.seed)
        (status, records, late_s, events), = query(folder / "whole/run.sqlite", """
            SELECT status, (SELECT count(*) FROM record), (SELECT max(closed_late_s) FROM record), (SELECT count(*) FROM event) FROM run""")
        print(f"{records} records of {slots}, {status}, {events} events, latest slot {1e3 * late_s:.3f} ms late, "
              f"{cpu_s:.1f} s of processor time")
        if (status, records, late_s) != ("complete", slots, 0):
            wrong.append("the run is not complete")
        audit = subprocess.run([sys.executable, scripts / "audit_run.py", folder / "whole/run.sqlite",
                                folder / "whole/log.jsonl"], stdout=subprocess.PIPE, text=True)
        print(audit.stdout, end="")
        if audit.returncode != 0:
            wrong.append("the audit found unexplained differences")
        hour = min(slots, 3600 // WINDOW_S)
        parts = ("first" if hour < slots else "whole", "second")
        for part in {*parts} - {"whole"}:
            record(args.program, folder / part, fault_text, hour, args.seed)
        first, second = (hashlib.sha256((folder / part / "run.sqlite").read_bytes()).hexdigest() for part in parts)
        print("SHA-256 of two one-hour runs:", first[:16], second[:16])
        if first != second:
            wrong.append("two runs with the same seed differ")
    print("\n".join(wrong or ["passed"]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
