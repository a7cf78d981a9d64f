#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/recon/training_memory.py BIN_DIR: a training on 20 000 records with hardly any memory for its tables
keeps what is resident (but for pages of files, which the system may drop) below a bound, and makes the model
that one with memory makes."""
import json
import pathlib
import subprocess
import sys
import tempfile
import time

bin_dir = pathlib.Path(sys.argv[1]).resolve()
RECORDS, BOUND_MB = 20_000, 200


def train(folder, name, *options):
    """The peak of its resident memory, in MB."""
    process = subprocess.Popen([bin_dir / "echofuse-recon", "train", folder / "run", "--out", folder / name,
                                "--epochs", "1", "-q", *options])
    peak_kb = 0
    while process.poll() is None:
        text = pathlib.Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
        lines = [line.split() for line in text.splitlines() if line.startswith("RssAnon:")]
        peak_kb = max([peak_kb, *(int(line[1]) for line in lines)])
        time.sleep(0.02)
    assert process.returncode == 0, name
    return peak_kb / 1000


def metrics(folder, name):
    command = [bin_dir / "echofuse-recon", "evaluate", folder / name, folder / "run", "--json"]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)["metrics"]


with tempfile.TemporaryDirectory(prefix="echofuse-") as path:
    folder = pathlib.Path(path)
    subprocess.run([bin_dir / "echofuse-sim", "dataset", "-q", "--seed", "1", "--records", str(RECORDS),
                    "--out", folder / "run"], check=True)
    usual, limited = train(folder, "usual"), train(folder, "limited", "--memory", "0.02")
    print(f"resident at most: {usual:.0f} MB, with --memory 0.02 {limited:.0f} MB")
    assert usual > 300, "the bound says nothing"
    assert limited < BOUND_MB, limited
    assert metrics(folder, "usual") == metrics(folder, "limited")
