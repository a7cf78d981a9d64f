# SPDX-License-Identifier: MIT
"""Tests that echofuse.metrics returns the same scores per record as `echofuse-recon evaluate`."""
import csv

import numpy as np
import pytest

import echofuse
from echofuse import metrics, models
from fixtures import program, scenes

COLUMNS = {"iou": metrics.iou, "depth_mae_m": metrics.depth_mae_m, "lateral_m": metrics.lateral_m, "ssim_fg": metrics.ssim_fg,
           "ghost": metrics.ghost}


def wrong(truth, how):
    """Returns maps with errors. The maps are shifted and noisy, blurred like those of a regression model, or mirrored.
    Some mirrored maps are replaced by constant maps."""
    z, rng = np.nan_to_num(truth), np.random.default_rng(3)
    if how == "noise":
        out = np.roll(z + rng.normal(0, 0.1, z.shape) * (z > 0), 2, 2) * (rng.random(z.shape) < 0.9)
    elif how == "expected":
        out = sum(np.roll(z, k, 2) * 0.2 for k in range(-2, 3)) + rng.normal(0, 0.05, z.shape)
    else:
        out = z[:, :, ::-1].copy()
        out[::5] = 0
        out[1::5] = 9
    return out.astype(np.float32)


@pytest.fixture(params=["none", "room"])
def runs(request):
    return [echofuse.open(scenes(40, seed, "--set", f"background={request.param}")) for seed in (1, 2)]


@pytest.mark.parametrize("how", ["noise", "expected", "mirrored"])
def test_python_metrics_equal_those_of_the_evaluate_command(runs, tmp_path, how):
    train, test = runs
    maps, truth, scene = wrong(test.maps(), how), test.maps(), metrics.Scene.of_maps(train.maps())
    echofuse.save_maps(tmp_path / "maps", maps, test.index)
    program("echofuse-recon", "evaluate", "-q", "--maps", tmp_path / "maps", test.path, "--train", train.path, "--all",
            "--per-record", tmp_path / "scores.csv")
    with open(tmp_path / "scores.csv", newline="") as file:
        judged = [row for row in csv.DictReader(file)]
    name = judged[0]["name"]
    rows = {int(row["record"]): row for row in judged if row["name"] == name}
    at = [int(np.flatnonzero(test.index == index)[0]) for index in rows]
    assert len(at) >= 30
    for column, function in COLUMNS.items():
        wanted = [float(row[column] or "nan") for row in rows.values()]
        found = function(maps, truth, scene)[at]
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-7, err_msg=column)
        assert np.isfinite(found).any(), column


def test_a_scene_refuses_maps_of_another_size():
    scene = metrics.Scene(np.zeros((8, 8), np.float32), 3.0)
    for size in 1, 9:
        for function in scene.true_mask, scene.share, scene.holds_returns, scene.clipped:
            with pytest.raises(ValueError, match=r"expected \[2, 8, 8\]"):
                function(np.ones((2, size, size)))


def test_metrics_return_nan_for_undefined_scores():
    scene = metrics.Scene(np.zeros((8, 8), np.float32), 3.0)
    empty, body = np.full((1, 8, 8), np.nan), np.full((1, 8, 8), np.nan)
    body[0, 2:5, 1:3] = 3
    assert np.isnan(metrics.iou(empty, empty, scene)) and metrics.iou(empty, body, scene) == 0
    assert metrics.iou(body, body, scene) == 1 and metrics.lateral_m(body, body, scene) == 0
    assert np.isnan(metrics.depth_mae_m(empty, body, scene)) and np.isnan(metrics.lateral_m(empty, body, scene))
    assert np.isnan(metrics.ssim_fg(body, body, scene))  # The SSIM window is larger than the map.
    assert metrics.ghost(body[:, :, ::-1], body, scene) == 1


@pytest.mark.parametrize("said, maps, truth", [
    (r"\[8, 8\] \(expected \[n, N, N\]", np.ones((8, 8)), np.ones((8, 8))),
    (r"maps: shape \[1, 8, 8\] \(expected \[5, 8, 8\]", np.ones((1, 8, 8)), np.ones((5, 8, 8))),
    (r"maps: shape \[5, 8, 8\] \(expected \[1, 8, 8\]", np.ones((5, 8, 8)), np.ones((1, 8, 8))),
    (r"shape \[2, 9, 9\] \(expected \[2, 8, 8\]", np.ones((2, 9, 9)), np.ones((2, 9, 9))),
    ("median depth of map 1 is above 200 m; expected metres", np.stack([np.ones((8, 8)), np.full((8, 8), 2500)]), np.ones((2, 8, 8))),
    ("median depth of map 0", np.ones((1, 8, 8)), np.full((1, 8, 8), 2500, np.uint16)),
    ("map 0 has an impossible depth: inf m", np.full((1, 8, 8), np.inf), np.ones((1, 8, 8))),
    ("map 0 has an impossible depth: -101 m", np.full((1, 8, 8), -101.0), np.ones((1, 8, 8))),
])
def test_metrics_refuse_other_shapes_and_units(said, maps, truth):
    for function in COLUMNS.values():
        with pytest.raises(ValueError, match=said):
            function(maps, truth, metrics.Scene(np.zeros((8, 8), np.float32), 3.0))


@pytest.mark.parametrize("said, values", [
    ("background_m: the median depth of map 0 is above 200 m", {"background_m": np.full((8, 8), 5000)}), ("foreground_m: 3000", {"foreground_m": 3000}),
    ("foreground_m: nan", {"foreground_m": np.nan}), ("half_tangent: 30 .expected 0.02 to 3", {"half_tangent": 30}), ("far_m: 6000", {"far_m": 6000}),
    ("far_m: '6' .expected a number", {"far_m": "6"}), ("maps: bool", {"maps": np.ones((1, 8, 8), bool)}), ("truth: bool", {"truth": np.ones((1, 8, 8), bool)}),
])
def test_metrics_refuse_impossible_scenes_and_masks(said, values):
    given = {"background_m": np.full((8, 8), 5.0), "foreground_m": 3.0, "maps": np.ones((1, 8, 8)), "truth": np.ones((1, 8, 8))} | values
    with pytest.raises(ValueError, match=said):
        metrics.iou(given.pop("maps"), given.pop("truth"), metrics.Scene(**given))


def test_background_without_returns_may_be_nan_zero_or_masked():
    background, truth = np.where(np.arange(8) < 4, 0, 5.0) * np.ones((8, 1)), np.full((1, 8, 8), 3.0)
    for given in (np.where(background, background, np.nan), np.ma.masked_equal(background, 0), background.tolist()):
        assert np.array_equal(metrics.Scene(given, 3.0).true_mask(truth), metrics.Scene(background, 3.0).true_mask(truth))


@pytest.mark.parametrize("maps, without, background_m", [(5, 1, 0), (6, 1, 5), (10, 2, 0), (11, 2, 5)])
def test_background_has_no_return_where_a_fifth_of_the_training_maps_has_none(maps, without, background_m):
    table = np.full((maps, 8, 8), 5.0)
    table[:without, 0, 0] = np.nan
    assert metrics.Scene.of_maps(table).background_m[0, 0] == background_m


def test_masked_pixels_of_maps_have_no_return(tmp_path):
    scene, body = metrics.Scene(np.zeros((8, 8), np.float32), 3.0), np.full((1, 8, 8), 3.0)
    hidden = np.broadcast_to(np.arange(8) < 4, body.shape)
    for function in metrics.iou, metrics.depth_mae_m, metrics.lateral_m:
        assert function(np.ma.array(body, mask=hidden), body, scene) == function(np.where(hidden, np.nan, body), body, scene)
    echofuse.save_maps(tmp_path, np.ma.array(body, mask=hidden), [3])
    assert np.array_equal(np.isnan(echofuse.load_maps(tmp_path)[0]), hidden)


def test_scenes_splits_and_maps_are_equal_if_their_values_are():
    def made(depth_m, number):
        maps = np.array([[[depth_m, np.nan], [2, 3]]], np.float32)
        return (metrics.Scene(maps[0], 1.5), echofuse.Split(*(np.array([number, k]) for k in range(3))),
                models.Maps(maps, np.array([number]), np.arange(2.), np.arange(2.), ["spd"], 0.5))
    for one, same, other in zip(made(1, 7), made(1, 7), made(1.5, 8)):
        assert one == same and one != other and one != 7
        with pytest.raises(TypeError, match="unhashable"):
            hash(one)
