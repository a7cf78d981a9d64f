# SPDX-License-Identifier: MIT
"""Tests that echofuse-bench compares user networks, random forests and maps from an external program with a built-in
method."""
import importlib.util
import pathlib
import subprocess
import sys

from echofuse import bench
from fixtures import BIN, program

EXAMPLES = pathlib.Path(__file__).parents[2] / "recon/python/examples"
OWN = """
import numpy as np
class First:
    def fit(self, run, rows):
        self.map = run.maps(rows[{row}:])[0]
    def predict(self, run):
        return np.repeat(self.map[None], len(run), axis=0)
"""
# External program that predicts the map of the training record with the most similar histogram.
PROGRAM = f"""#!{sys.executable}
import sys
import numpy as np
import echofuse
train, test = map(echofuse.open, sys.argv[1:3])
nearest = [np.argmin(((train.spd.astype(float) - row) ** 2).sum(1)) for row in test.spd]
echofuse.save_maps(sys.argv[3], train.maps(nearest), test.index, run=test)
"""


def walk(folder, *methods):
    done = subprocess.run([sys.executable, BIN / "echofuse-bench", "pareto", "train.sqlite", "test.sqlite", "--out", "mine.csv", "--seeds",
                           "1", "--markdown", "-q", "--methods", *methods], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    head, _, *rows = ([cell.strip() for cell in line.split("|")] for line in done.stdout.splitlines() if line.startswith("|"))
    return {row[2].strip("`"): dict(zip(head, row)) for row in rows}


def test_bench_compares_user_methods_and_maps_of_another_program_in_one_table(tmp_path):
    for name, records, seed in (("train", 60, 1), ("test", 20, 2)):
        program("echofuse-sim", "dataset", "-q", "--out", tmp_path / f"{name}.sqlite", "--records", records, "--seed", seed)
    methods = ["nearest", "own:First", "./other"]
    for module, package, name in (("torch_network", "torch", "Network"), ("forest", "sklearn", "Forest")):
        if importlib.util.find_spec(package):  # The method is omitted if its package is not installed.
            (tmp_path / f"{module}.py").write_text((EXAMPLES / f"{module}.py").read_text())
            methods.append(f"{module}:{name}")
    (tmp_path / "own.py").write_text(OWN.format(row=0))
    (tmp_path / "other").write_text(PROGRAM)
    (tmp_path / "other").chmod(0o755)
    first = walk(tmp_path, *methods)
    assert list(first) and set(methods) == set(first)
    for name, row in first.items():
        assert row["answered"] == "20 of 20" and " to " in row["95 % interval over the records"], name
        assert row["threads"] == "1"
    assert sum(row["IoU difference from the best"] == "" for row in first.values()) == 1
    (tmp_path / "own.py").write_text(OWN.format(row=5))
    again = walk(tmp_path, *methods)
    assert {name: row["IoU"] == first[name]["IoU"] for name, row in again.items()} == {name: name != "own:First" for name in methods}
    assert len(bench.Table(tmp_path / "mine.csv").rows) == len(methods)
