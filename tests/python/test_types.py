# SPDX-License-Identifier: MIT
"""Checks the types of the package and of a user script with mypy --strict."""
import pathlib
import subprocess
import sys

import pytest
from fixtures import BIN

PACKAGE = pathlib.Path(__file__).parents[2] / "recon/python"
SCRIPT = """
import echofuse

run = echofuse.open("monday")
split = echofuse.split(run)
truth = run.maps(split.test)
some: echofuse.Run = run[run.valid["spd"]]
few: echofuse.Run = run[[1, 2]]
one: echofuse.Record = run[3]
maps: echofuse.Maps = echofuse.load_model("fused.safetensors").predict(few)
first = maps[0]
scene = echofuse.metrics.Scene.of_maps(truth)
iou = echofuse.metrics.iou(maps[1:].depth_m, truth[[0]], scene)
print(truth.shape, some, one.depth.shape, first.shape, iou.mean())
"""


def mypy(*words):
    """Returns the output lines of mypy. The mypy cache is in the build folder, so that NumPy is analysed only once."""
    pytest.importorskip("mypy")
    return subprocess.run([sys.executable, "-m", "mypy", "--config-file", PACKAGE / "pyproject.toml", "--cache-dir", BIN.parent / "mypy", *words],
                          cwd=PACKAGE, capture_output=True, text=True, check=False).stdout.splitlines()


def test_mypy_finds_no_type_error_in_the_package_or_a_user_script(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    assert mypy("echofuse", script)[-1].startswith("Success")
    script.write_text(SCRIPT + "maps[0].index\n")
    assert mypy(script)[-1].startswith("Found 1 error in 1 file")
