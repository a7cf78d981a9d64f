# SPDX-License-Identifier: MIT
"""Tests the TMF8820 simulation, its bin width with public measurements in ECHOFUSE_DATA, and methods for first returns."""
import csv
import gzip
import json
import os
import pathlib
import struct
import subprocess
import sys

import numpy as np
import pytest

from echofuse.bench import photon_track, spad_camera, tmf8820, zone_fit
from echofuse.models.photon_baselines import FirstReturn, OpenFirstReturn, interpolation
from fixtures import outcome

REFERENCE = 1e5 * np.exp(-(((np.arange(128) - 14) / 1.2) ** 2)) + 5
BLOCK = tmf8820.box(0.06, 0.05, 0.1)
TABLE = np.array([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]], float)


def chip():
    """Returns four zones with round fields of view, centred at tangents of +-0.12, and with different time zeros."""
    x, y = (part.ravel() for part in zone_fit.tangents(zone_fit.G, zone_fit.FIELD_TANGENT))
    fields = [np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * 0.1**2)) for cx, cy in
              ((-0.12, 0.12), (0.12, 0.12), (-0.12, -0.12), (0.12, -0.12))]
    return zone_fit.ZoneFit(np.array(fields), np.array([11.6, 12.0, 12.2, 12.6]), 1.7, 1.2, np.ones(4))


def captures(count, seed):
    """Simulates `count` measurements of a block. Returns counts [n, zones, 128] and sensor poses [n, 4, 4]."""
    rng, zones, counts, poses = np.random.default_rng(seed), chip(), [], []
    for _ in range(count):
        pose = tmf8820.random_pose(rng, 0.1)
        depth, cosine, height = tmf8820.cast(pose, np.concatenate([TABLE, BLOCK]), zone_fit.G, zone_fit.FIELD_TANGENT)
        bare = tmf8820.histograms(depth, cosine * np.where(height > 0.003, 1, zones.albedo), zones, zones.zero_bin,
                                  zone_fit.response_of(REFERENCE, zones.exponent))
        counts.append(rng.poisson(40 * bare + 60))
        poses.append(pose)
    return np.array(counts), np.array(poses)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Creates a folder with simulated data in the file format of the public data set: two capture files and a mesh."""
    folder = tmp_path_factory.mktemp("data")
    mesh = np.concatenate([TABLE, BLOCK])
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0) for corners in mesh)
    (folder / "block.stl").write_bytes(bytes(80) + struct.pack("<I", len(mesh)) + body)
    for seed, name in enumerate(("block", "block_random")):
        counts, poses = captures(24, seed)
        records = [{"hists": h, "reference_hist": list(REFERENCE), "pose": p} for h, p in zip(counts.tolist(), poses.tolist())]
        (folder / f"{name}.json.gz").write_bytes(gzip.compress(json.dumps(records).encode()))
    return folder


def test_rays_from_a_sensor_above_a_block_hit_the_top_face(data):
    pose = np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.3], [0, 0, 0, 0]], float)
    triangles = tmf8820.read_mesh(data / "block.stl")
    truth = tmf8820.truth_of(*tmf8820.cast(pose, triangles)[::2], tmf8820.table_height(triangles))
    assert np.nanmin(truth) == pytest.approx(0.2) and 30 < np.isfinite(truth).sum() < 400


def test_zone_fit_recovers_fields_of_view_time_zero_offsets_and_response(data, tmp_path):
    zones = chip()
    found = tmf8820.fit_to_poses(data / "block_random.json.gz", data / "block.stl", range(16))
    assert (found.fields >= 0).all() and (found.explained > 0.97).all()
    assert np.abs(found.zero_bin - zones.zero_bin).max() < 0.25 and found.exponent == zones.exponent
    assert np.abs(found.centres()[:, :2] - zones.centres()[:, :2]).max() < 0.05
    counts, poses = captures(8, 5)  # The measurements with seed 5 were not used for the fit.
    counts = counts - np.median(counts[:, :, -30:], axis=2, keepdims=True)
    scenes = tmf8820.hits_from(poses, data / "block.stl")
    for k in range(4):
        unit = scenes.unit_counts(zone_fit.response_of(REFERENCE, found.exponent), found.zero_bin[k], found.albedo)
        assert zone_fit.explained(unit, found.fields[k], counts[:, k]) > 0.9
    found.save(tmp_path / "fit.json")
    assert np.array_equal(zone_fit.load(tmp_path / "fit.json").fields, found.fields)
    (tmp_path / "fit.json").write_text("{}")
    with pytest.raises(ValueError, match="invalid zone fit"):
        zone_fit.load(tmp_path / "fit.json")
    with pytest.raises(ValueError, match="expected pose numbers from 0 to 23"):
        tmf8820.fit_to_poses(data / "block.json.gz", data / "block.stl", [24])


def test_rendered_photons_are_in_the_zone_and_time_bin_of_the_object():
    zones = chip()
    depth = np.full(zone_fit.G**2, np.inf)
    x, y = (part.ravel() for part in zone_fit.tangents(zone_fit.G, zone_fit.FIELD_TANGENT))
    depth[(np.abs(x - 0.12) < 0.05) & (np.abs(y - 0.12) < 0.05)] = 0.276  # A range of 0.276 m corresponds to 20 bins.
    counts = tmf8820.histograms(depth, np.ones_like(depth), zones, zones.zero_bin, zone_fit.response_of(REFERENCE, 1.7))
    # The time zero of zone 1 is bin 12, so the peak is in bin 32.
    assert counts.sum(1).argmax() == 1 and counts[1].argmax() == 32
    counts, maps = tmf8820.render_records(zones, REFERENCE, 3, 1)
    assert counts.shape == (3, 4, 128) and maps.shape == (3, 32, 32)
    assert np.array_equal(tmf8820.render_records(zones, REFERENCE, 3, 1)[0], counts)


def test_random_records_of_a_seed_keep_their_objects_and_counts():
    counts, maps = tmf8820.render_records(chip(), REFERENCE, 8, 5)
    assert np.isfinite(maps).sum((1, 2)).tolist() == [980, 348, 753, 594, 234, 504, 308, 352]
    assert np.nanmean(maps, (1, 2)) == pytest.approx([0.067, 0.121, 0.123, 0.228, 0.14, 0.189, 0.156, 0.162], abs=1e-3)
    total, bins = counts.sum((1, 2)), (counts * np.arange(128)).sum((1, 2))
    assert total / 1e6 == pytest.approx([6.3446, 3.9817, 1.536, 6.1021, 1.8833, 4.4445, 7.3748, 3.5688], rel=1e-3)
    assert bins / total == pytest.approx([16.946, 21.248, 24.783, 29.699, 31.847, 28.997, 24.337, 25.877], rel=1e-3)


def test_response_of_a_zone_is_the_reference_above_its_background_raised_to_a_power():
    response, peak = zone_fit.response_of(5.0 + 100 * (np.arange(128) == 30) + 50 * (np.arange(128) == 40), 2)
    assert peak == 30 and response[[29, 30, 40]] == pytest.approx([0, 0.8, 0.2])


def test_table_is_the_highest_large_horizontal_plane():
    tilted = TABLE + TABLE[..., :1] * (0, 0, 0.05) + (0, 0, 0.3)
    small, large = 0.6 * TABLE + (0, 0, 0.2), 0.8 * TABLE + (0, 0, 0.1)
    assert tmf8820.table_height(np.concatenate([TABLE, tilted, small, large])) == 0.1
    assert tmf8820.table_height(0.01 * TABLE + (0, 0, 0.25)) == 0.25


def test_first_return_method_ignores_the_echo_of_the_table():
    range_m = np.arange(60) * 0.01
    bump = lambda at: np.exp(-(((np.arange(60) - at) / 1.5) ** 2))  # noqa: E731
    both, table, nothing = 1000 * bump(20) + 200 * bump(40), 500 * bump(40), np.zeros(60)
    ranges, shares = FirstReturn.objects(np.array([both, table, nothing], np.float32), range_m)
    assert ranges[0] == pytest.approx(0.2, abs=0.003) and np.isnan(ranges[1:]).all()
    assert shares.tolist() == [pytest.approx(1000 / 1800, abs=0.01), 0, 0]  # light is proportional to counts x range^2


def test_bench_compares_photon_methods_on_rendered_captures_according_to_a_recipe(data, tmp_path):
    recipe = tmp_path / "recipe.toml"
    words = ["run", "-q", "--recipe", recipe, "--data", data, "--runs", tmp_path / "runs", "--out", tmp_path / "photons.csv"]
    recipe.write_text("""
name = "small"
seeds = 1
[[track]]
name = "photons"
title = "rendered captures"
fit = {shape = "block_random", poses = [0, 2, 4, 6, 8, 10, 12, 14, 16, 18]}
train = {records = 120, seed = 1}
zones = ["echofuse.models.photon_baselines:FirstReturn", "echofuse.models.photon_baselines:AllForeground",
         "echofuse.models.photon_baselines:OwnMeanMap", "mlp-mask-32:spd", "not_installed:Network"]
sum = ["nearest:spd"]
""")
    done = outcome("echofuse-bench", *words, "--markdown")
    said = "skipped a method of the recipe: method not_installed:Network: No module named 'not_installed'"
    assert done.returncode == 0 and done.stderr.count(said) == 1, done.stderr
    rows = list(csv.DictReader((tmp_path / "photons.csv").read_text().splitlines()[1:]))
    assert len(rows) == 10
    for row in rows:
        assert row["axis"] in ("photons block", "photons block_random"), row
        assert 0.1 < float(row["iou"]) < 1 and float(row["depth_mae_m"]) < 0.1, row
    assert photon_track.shapes_in(data) == ["block", "block_random"]
    recipe.write_text(recipe.read_text() + '[track.sha256]\nzones-train = "0"\n')
    done = outcome("echofuse-bench", *words[:-1], tmp_path / "other.csv")
    assert done.returncode > 0 and "the records differ from those of the recipe" in done.stderr


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
    counts, damaged = scene(), np.zeros((32, 32), bool)
    counts[14, 14] = 0
    assert np.isfinite(spad_camera.truth_of(counts, damaged)).sum() == 143
    damaged[14, 14] = True
    assert np.isfinite(spad_camera.truth_of(counts, damaged)).sum() == 144


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
    assert ranges[:2] == pytest.approx([1.0, 2.5]) and heights == pytest.approx([1.82482, 0.24331, 0], rel=1e-4)


def test_spad_camera_reports_a_missing_file(tmp_path):
    pytest.importorskip("scipy")
    told = subprocess.run([sys.executable, "-m", "echofuse.bench.spad_camera", tmp_path], text=True, capture_output=True)
    assert told.returncode == 1 and "steps_0-6-12.mat" in told.stderr, told


def test_ranges_of_a_second_tmf8820_before_a_plane_match_the_bin_width():
    """Fits bins to the distances of every second measurement, and compares the ranges of the others."""
    shared = pathlib.Path(os.environ.get("ECHOFUSE_DATA", pathlib.Path(__file__).resolve().parents[3] / "shared/data"))
    path = shared / "spad-tmf8820-plane/distance_data.json.gz"
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
