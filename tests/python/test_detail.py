# SPDX-License-Identifier: MIT
"""Tests examples/detail.py, which measures how much detail a simulated scene needs."""
import csv
import os
import pathlib
import subprocess
import sys

from fixtures import BIN

ROOT = pathlib.Path(__file__).resolve().parents[2]


def table(fine, *coarse):
    """Runs the example with 12 records. Returns {coarse setting: {error column: error relative to the fine setting}}."""
    command = [sys.executable, ROOT / "recon/python/examples/detail.py", "--fine", fine, "--coarse", *coarse, "--records", "12"]
    done = subprocess.run(command, env=os.environ | {"ECHOFUSE_BIN": str(BIN)}, check=True, capture_output=True, text=True)
    rows = csv.DictReader(done.stdout.splitlines())
    return {row.pop("setting"): {key: float(value) for key, value in row.items()} for row in rows}


def test_histogram_error_falls_with_the_number_of_simulated_rays():
    found = table("spd_rays=2048", "spd_rays=2048", "spd_rays=48", "spd_rays=128", "spd_rays=364")
    assert set(found["spd_rays=2048"].values()) == {0}
    errors = [found[f"spd_rays={rays}"]["spd_chi2"] for rays in (48, 128, 364)]
    assert errors[0] > 10 * errors[1] > 100 * errors[2] and 0 < errors[2] < 0.1
    assert all(row["radar_chi2"] == row["depth_mm"] == row["pixels"] == 0 for row in found.values())


def test_detail_example_measures_the_effect_of_the_number_of_radar_rays_and_the_target_scale():
    found = table("radar_rays=1536", "radar_rays=48", "target_scale=1.01")
    assert found["radar_rays=48"]["radar_chi2"] > 1 and found["radar_rays=48"]["spd_chi2"] == 0
    assert found["target_scale=1.01"]["depth_mm"] > 1 and found["target_scale=1.01"]["pixels"] > 0
