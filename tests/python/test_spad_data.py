# SPDX-License-Identifier: MIT
"""Tests the first return of pooled zones, and the bin width of a TMF8820 with public measurements in ECHOFUSE_DATA."""
import gzip
import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

from echofuse.bench import spad_camera, zone_fit
from echofuse.models.photon_baselines import FirstReturn, OpenFirstReturn, interpolation

data = pathlib.Path(os.environ.get("ECHOFUSE_DATA", pathlib.Path(__file__).resolve().parents[3] / "shared/data"))
NEAR = spad_camera.BIN_M * 20


def scene():
    """Returns counts [32, 32, bins] of an object before a dark background."""
    counts = np.full((32, 32, spad_camera.BINS), 2.0)
    counts[8:20, 8:20, 18:23] += (20, 200, 400, 200, 20)
    return counts


def test_first_returns_of_zones_find_an_object_and_its_range():
    counts = scene()
    truth = spad_camera.truth_of(counts, np.zeros((32, 32), bool))
    assert np.isfinite(truth).sum() == 144 and np.nanmax(np.abs(truth - NEAR)) < 1e-6
    scores = {side: spad_camera.score(counts, truth, side) for side in spad_camera.ZONES}
    assert scores[1][0] == pytest.approx(144 / 24**2) and all(error < 5e-4 for _, error in scores.values())
    assert scores[8][0] > 0.8 and scores[8][0] > scores[3][0] > scores[1][0]


def test_damaged_pixels_get_the_values_of_their_neighbours():
    counts = scene()
    counts[14, 14] = 0
    damaged = np.zeros((32, 32), bool)
    damaged[14, 14] = True
    assert np.isfinite(spad_camera.truth_of(counts, damaged)).sum() == 144
    assert np.isfinite(spad_camera.truth_of(counts, ~damaged & damaged)).sum() == 143


def test_interpolation_between_zones_is_bilinear():
    centres = np.array([(-1, 1), (1, 1), (-1, -1), (1, -1)], float)
    weights = interpolation(centres, np.array([0.0, -1.0, 0.5, 3.0]), np.array([0.0, 1.0, 0.0, 3.0]))
    expected = [[0.25] * 4, [1, 0, 0, 0], [0.125, 0.375, 0.125, 0.375], [0, 1, 0, 0]]
    assert weights == pytest.approx(np.array(expected), abs=1e-6)
    shares = np.array([1.0, 0, 0, 0])
    ranges = np.array([2.0, np.nan, np.nan, np.nan])
    assert np.isfinite(FirstReturn.map_of(ranges, shares, weights)).tolist() == [False, True, False, False]


def test_open_first_return_ignores_even_background_and_the_table_rule():
    range_m = 0.1 * np.arange(40)
    counts = np.full((3, 40), 5.0)
    counts[0, 9:12] += (300, 600, 300)
    counts[1, 24:27] += (40, 80, 40)
    ranges, heights = OpenFirstReturn.objects(counts, range_m)
    assert ranges[:2] == pytest.approx([1.0, 2.5]) and heights[0] > 0.5 > heights[1] > heights[2] == 0


def test_spad_camera_reports_a_missing_file(tmp_path):
    pytest.importorskip("scipy")
    told = subprocess.run([sys.executable, "-m", "echofuse.bench.spad_camera", tmp_path], text=True, capture_output=True)
    assert told.returncode == 1 and "steps_0-6-12.mat" in told.stderr, told


def test_ranges_of_a_second_tmf8820_before_a_plane_match_the_bin_width():
    """Fits bins to the distances of every second measurement, and compares the ranges of the others."""
    path = data / "spad-tmf8820-plane/distance_data.json.gz"
    if not path.exists():
        pytest.skip(f"{path} is missing (set ECHOFUSE_DATA)")
    with gzip.open(path) as file:
        records = json.load(file)
    counts, distance = (np.array([record[key] for record in records], float) for key in ("hists", "dist_to_plane"))
    place = spad_camera.highest(counts[..., zone_fit.FIRST:120])[0]
    fitted, tested = (np.flatnonzero(distance >= 0.1)[start::2] for start in (0, 1))
    bins_per_m, zero = np.polyfit(distance[fitted], place[fitted], 1)
    error = (place[tested] - zero) / bins_per_m - distance[tested, None]
    assert np.mean(1 / bins_per_m) == pytest.approx(zone_fit.BIN_M, rel=0.005)
    assert np.abs(error).mean() < 0.0006
