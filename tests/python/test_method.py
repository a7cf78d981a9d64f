# SPDX-License-Identifier: MIT
"""The method in Python (recon/python/echofuse/method.py) makes the maps of the program: the same pixels show a body, and
their depths agree to 0.1 mm."""
import sqlite3

import numpy as np
import pytest

import echofuse
from programs import program

# Name of the run: what makes it.
RUNS = {
    "50cm": [],
    "4cm": ["radar_resolution_m=0.088"],
    "antennas": ["radar_antennas=8", "radar_sum=coherent"],
    "room": ["background=room"],
    "piled-up": ["pulses_per_window=20000", "spd_dead_time_ps=30000"],
    "calibrated": [],
}
# Which kinds of models are tried on it.
KINDS = {
    "50cm": [["factorised-8"], ["silhouette"], ["mlp-64-32"], ["pca-mlp-64"], ["ridge"], ["mean"],
             ["pca-mlp-64", "--inputs", "spd"]],
    "4cm": [["factorised-8"]],
    "antennas": [["factorised-8"]],
    "room": [["factorised-8"]],
    "piled-up": [["factorised-8"]],
    "calibrated": [["factorised-8"]],
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("method")
    for name, settings in RUNS.items():
        words = [word for setting in settings for word in ("--set", setting)]
        program("echofuse-sim", "dataset", "-q", "--out", folder / f"{name}.sqlite", "--records", 60, *words)
    with sqlite3.connect(folder / "calibrated.sqlite") as db:
        columns = [row[1] for row in db.execute("PRAGMA table_info(calibration)")]
        for sensor, offset_m in (("spd", 0.031), ("radar", 0.087)):
            known = {"sensor": sensor, "offset_m": offset_m}
            db.execute(f"INSERT OR REPLACE INTO calibration VALUES ({', '.join('?' * len(columns))})",
                       [known.get(column, 0) for column in columns])
    return folder


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, kinds in KINDS.items() for kind in kinds])
def test_maps_are_those_of_the_program(runs, tmp_path, name, kind):
    model, run = tmp_path / "model", runs / f"{name}.sqlite"
    epochs = ["--epochs", 1] if kind[0].rstrip("-0123456789") in ("factorised", "silhouette", "mlp", "pca-mlp") else []
    program("echofuse-recon", "train", "-q", run, "--model", *kind, *epochs, "--set", "fallback=false", "--out", model)
    program("echofuse-recon", "reconstruct", "-q", model, run, "--out", tmp_path / "maps", "--format", "npz")
    program_made = np.load(next((tmp_path / "maps").rglob("*.npz")))
    loaded = echofuse.load_model(model)
    found = loaded.predict(run)
    background = loaded.estimators[0].t["scene/background_m"].reshape(loaded.estimators[0].size, -1)
    depth_m, by_program_m = np.nan_to_num(found.depth_m), np.nan_to_num(program_made["depth_m"])
    shown, shown_by_program = depth_m != background, by_program_m != background
    other = shown != shown_by_program
    assert found.index.tolist() == program_made["index"].tolist() and len(found.index) == 60
    assert shown_by_program.any()
    assert other.sum() <= 3  # exactly at the threshold
    assert np.abs(depth_m - by_program_m)[~other].max() < 1e-4
