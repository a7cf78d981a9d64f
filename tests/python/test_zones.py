# SPDX-License-Identifier: MIT
"""Tests runs from detectors with several zones: import, zone directions, and models."""
import pathlib
import subprocess
import sys

import numpy as np
import pytest

import echofuse
from echofuse.bench import derive
from echofuse.models.photon_baselines import FirstReturn
from echofuse.runs import zones
from fixtures import changed, model, outcome, plates

EXAMPLES = pathlib.Path(__file__).parents[2] / "recon/python/examples"
write = echofuse.write_run
TWO = [zones.Zone(-0.17, 0.02, 0.3, 1100.0), zones.Zone(0.17, 0.02, 0.3, 1000.5)]


def counts(records=3, histograms=2, bins=30):
    return np.random.default_rng(1).poisson(20, (records, histograms, bins)).astype(np.uint32)


UNKNOWN = zones.Zone(np.nan, np.nan, np.nan, 0.0)


@pytest.mark.parametrize("given", [TWO, [TWO[0], TWO[1]._replace(width=200.0)], [UNKNOWN, UNKNOWN._replace(zero_ps=150.0)], []])
def test_detector_zones_are_read_back_as_written(tmp_path, given):
    run = write(tmp_path / "own", spd=counts(), zones=given)
    assert run.spd.shape == (3, 2, 30) and np.array_equal(run.spd, counts()) and np.array_equal(run[1].spd, counts()[1])
    assert [zone.text for zone in run.zones] == [zone.text for zone in given or [UNKNOWN] * 2]
    assert run.info["status"] == "complete" and run[1:3].spd.shape == (2, 2, 30)
    if np.isfinite(run.zones[0].x):
        assert np.allclose(zones.directions(run)[:, 0], [-0.17, 0.17])
    else:
        with pytest.raises(ValueError, match="detector zones are unknown; set spd.zones"):
            zones.directions(run)


@pytest.mark.parametrize("changes, good", [
    ({"width": 200}, True), ({"width": 200.1}, False), ({"width": 0}, False), ({"width": np.nan}, False), ({"x": -100}, True),
    ({"x": 100.1}, False), ({"x": np.nan}, False), ({"y": 100}, True), ({"y": -100.1}, False), ({"zero_ps": -1e12}, True),
    ({"zero_ps": 1.01e12}, False), ({"x": np.nan, "y": np.nan, "width": np.nan}, True)])
def test_zone_is_plausible_if_its_centre_and_width_and_time_zero_are_within_limits(changes, good):
    assert TWO[0]._replace(**changes).plausible() == good


def test_run_with_one_zone_is_read_as_a_single_pixel_run(tmp_path):
    run = write(tmp_path / "own", spd=counts(histograms=1))
    assert run.zones == [] and run.spd.shape == (3, 30) and "zone" not in run.tables


def test_photons_of_each_zone_are_shifted_by_the_time_zero_offset_of_the_zone(tmp_path):
    spd = np.zeros((1, 2, 60), np.uint32)
    spd[0, 0, 31], spd[0, 1, 30] = 100, 100
    run = write(tmp_path / "own", spd=spd, bin_width_ps=100, zones=[(-0.1, 0, 0.2, 1100), (0.1, 0, 0.2, 1000)])
    assert run.photons().shape == (1, 2, 60)
    assert run.photons()[0].argmax(1).tolist() == [20, 20]
    assert zones.summed(run.photons())[0, 20] == pytest.approx(200)


def test_derived_run_keeps_the_detector_zones_which_share_added_room_light(tmp_path):
    given = counts(records=40, histograms=9)
    zones_of = [TWO[k % 2]._replace(zero_ps=k) for k in range(9)]
    write(tmp_path / "own", spd=given, zones=zones_of)
    for name, change in ("dim", derive.thinned(0.5, seed=1)), ("light", derive.background(900, seed=1)):
        derive.copy(tmp_path / "own.sqlite", tmp_path / f"{name}.sqlite", change)
    dim, light = (echofuse.open(tmp_path / name) for name in ("dim", "light"))
    assert dim.zones == light.zones == zones_of and dim.spd.sum() == pytest.approx(given.sum() / 2, rel=0.02)
    added = light.spd - given.astype(float)
    assert added.min() >= 0 and added.sum((1, 2)).mean() == pytest.approx(900, abs=5 * 30 / 40 ** 0.5)
    assert added.sum((0, 2)) == pytest.approx(4000, abs=5 * 4000 ** 0.5)


def test_first_return_map_shows_a_body_in_the_zone_above_and_to_the_left(tmp_path):
    nine = [zones.Zone(x, y, 0.2, 0.0) for y in (0.2, 0.0, -0.2) for x in (-0.2, 0.0, 0.2)]
    spd = np.zeros((2, 9, 60), np.uint32)
    for record, zone in ((0, 0), (1, 5)):  # above and to the left; in the middle and to the right
        spd[record, :, 50] = 100
        spd[record, zone] = 900 * (np.arange(60) == 30)
    run = write(tmp_path / "own", spd=spd, zones=nine, bin_width_ps=0.05 * 2 / 299_792_458 * 1e12,
                depth_m=np.full((2, 18, 18), 2.0))
    method = FirstReturn()
    method.fit(run, np.arange(2))
    found = np.isfinite(method.predict(run))
    assert found[0, :6, :6].any() and not found[0, 8:].any() and not found[0, :, 8:].any()
    assert found[1, 7:11, 12:].all() and not found[1, :5].any() and not found[1, 13:].any() and not found[1, :, :9].any()


def test_zones_example_compares_detectors_with_one_and_nine_zones():
    words = "zones.py --zones 1 3 --train 60 --test 20 --data-sets 1 --methods mean nearest:spd".split()
    done = subprocess.run([sys.executable, *words], cwd=EXAMPLES, capture_output=True, text=True, check=True)
    rows = [line.split(",") for line in done.stdout.splitlines()]
    assert [(row[0], row[4]) for row in rows[1:]] == [
        (count, method) for count in ("1", "9") for method in ("truth", "mean", "nearest:spd")]
    iou = {(row[0], row[4]): float(row[5] or 1) for row in rows[1:]}
    assert iou["9", "nearest:spd"] > iou["1", "nearest:spd"] > iou["1", "mean"] == 0


@pytest.mark.parametrize("name, said", [("zones are mirrored", "another order"), ("zones are narrower", "width"),
                                        ("zones have no directions", "the directions of the zones are unknown, expected known")])
def test_models_of_zones_refuse_other_directions_in_python_and_in_the_programs(tmp_path, name, said):
    own = plates("nine_zones", 40)
    path = model("ridge", own, "--inputs", "spd")
    other = changed(own, tmp_path / "other.sqlite", name)
    reader = echofuse.load_model(path)
    assert len(reader.predict(own).depth_m) == 40
    for run, text in (other, said), (plates("one_pixel", 40), "has 1 zones .expected by the model: 9"):
        with pytest.raises(ValueError, match=text):
            reader.predict(run)
    done = outcome("echofuse-recon", "reconstruct", "-q", path, other, "--out", tmp_path / "maps")
    assert done.returncode == 1 and said in done.stderr
