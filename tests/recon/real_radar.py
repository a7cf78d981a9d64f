#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks that models trained on the radar recordings published by Turpin et al. score better than the mean map."""
import os
import pathlib
import subprocess
import sys
import tempfile

here = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(here.parent / "fixtures"))
from fixtures import BIN, json_of, program  # noqa: E402

data = pathlib.Path(os.environ.get("ECHOFUSE_DATA", here.parents[2] / "shared/data")) / "turpin-radar"
if not data.exists():
    print("skipped: no recordings in", data, "(set ECHOFUSE_DATA)")
    sys.exit(77)
scores = {}
with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
    run = f"{folder}/run.sqlite"
    subprocess.run([sys.executable, here / "turpin.py", BIN / "echofuse-sim", data, run], check=True)
    for model in ("mean", "nearest", "ridge"):
        words = ["--inputs", "radar", "--split", "blocked", "--set", "test_share=0.3", "--out", f"{folder}/{model}"]
        program("echofuse-recon", "train", run, "-q", "--model", model, *words)
        metrics = json_of("echofuse-recon", "evaluate", f"{folder}/{model}", run)["metrics"]
        scores[model] = metrics["ssim"]["mean"], metrics["rmse_m"]["mean"]
print(scores)
for model in ("nearest", "ridge"):
    assert scores[model][0] > scores["mean"][0] and scores[model][1] < scores["mean"][1], model
