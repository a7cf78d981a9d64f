#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""tests/python/torch_beside.py BIN_DIR: compares a PyTorch network with a built-in model in three commands, as on a plain
Debian system. Exits with 77 (skipped) if python3-torch is not installed."""
import csv
import importlib.util
import os
import pathlib
import subprocess
import sys
import tempfile

if importlib.util.find_spec("torch") is None:
    print("skipped: python3-torch is not installed (apt-get install python3-torch)")
    sys.exit(77)
examples = pathlib.Path(__file__).resolve().parents[2] / "recon/python/examples"
commands = """
echofuse-sim dataset -q --out train.sqlite --records 1000
echofuse-sim dataset -q --out test.sqlite --records 100 --seed 1001
echofuse-bench pareto train.sqlite test.sqlite --out mine.csv --markdown --seeds 1 --methods mean factorised-4 torch_network:Network
"""
with tempfile.TemporaryDirectory(prefix="torch-") as folder:
    said = subprocess.run(["sh", "-ec", commands], cwd=folder, text=True, stdout=subprocess.PIPE, check=True, env=os.environ | {
        "PATH": f"{pathlib.Path(sys.argv[1]).resolve()}:{os.environ['PATH']}", "PYTHONPATH": str(examples)}).stdout
    lines = pathlib.Path(folder, "mine.csv").read_text().splitlines()
iou = {row["model"]: float(row["iou"]) for row in csv.DictReader(line for line in lines if not line.startswith("#"))}
print(said, iou)
assert said.count("\n| ") >= 3 and "`torch_network:Network`" in said
assert iou["mean"] < 0.05 < 0.1 < iou["torch_network:Network"] < iou["factorised-4"], iou
