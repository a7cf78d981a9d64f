#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks that models trained on the radar recordings published by Turpin et al. score better than the mean map on the
last records. The test is skipped (exit code 77) if the folder ECHOFUSE_DATA does not contain the recordings."""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

here, bin_dir = pathlib.Path(__file__).resolve().parent, pathlib.Path(sys.argv[1]).resolve()
data = pathlib.Path(os.environ.get("ECHOFUSE_DATA", here.parents[2] / "shared/data")) / "turpin-radar"
if not data.exists():
    print("skipped: no recordings in", data, "(set ECHOFUSE_DATA)")
    sys.exit(77)


def score(folder, model):
    run = f"{folder}/run.sqlite"
    subprocess.run([bin_dir / "echofuse-recon", "train", run, "-q", "--model", model, "--inputs", "radar", "--split",
                    "blocked", "--set", "test_share=0.3", "--out", f"{folder}/{model}"], check=True)
    found = subprocess.run([bin_dir / "echofuse-recon", "evaluate", f"{folder}/{model}", run, "--json"], check=True,
                           stdout=subprocess.PIPE).stdout
    metrics = json.loads(found)["metrics"]
    return metrics["ssim"]["mean"], metrics["rmse_m"]["mean"]


with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
    subprocess.run([sys.executable, here / "turpin.py", bin_dir / "echofuse-sim", data, f"{folder}/run.sqlite"], check=True)
    scores = {model: score(folder, model) for model in ("mean", "nearest", "ridge")}
    print(scores)
    for model in ("nearest", "ridge"):
        assert scores[model][0] > scores["mean"][0], model
        assert scores[model][1] < scores["mean"][1], model
