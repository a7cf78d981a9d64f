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

ROOT = pathlib.Path(__file__).parents[2]
write = echofuse.write_run
TWO = [zones.Zone(-0.17, 0.02, 0.3, 1100.0), zones.Zone(0.17, 0.02, 0.3, 1000.5)]


def counts(records=3, histograms=2, bins=30):
    return np.random.default_rng(1).poisson(20, (records, histograms, bins)).astype(np.uint32)


def test_detector_zones_are_read_back_as_written(tmp_path):
    run = write(tmp_path / "own", spd=counts(), zones=TWO)
    assert run.spd.shape == (3, 2, 30) and np.array_equal(run.spd, counts())
    assert run.zones == TWO and np.array_equal(run[1].spd, counts()[1])
    assert run.info["status"] == "complete" and run[1:3].spd.shape == (2, 2, 30)
    assert np.allclose(zones.directions(run)[:, 0], [-0.17, 0.17])


def test_tangent_of_a_zone_width_must_be_positive_and_at_most_200(tmp_path):
    wide = [TWO[0], TWO[1]._replace(width=200.0)]
    assert write(tmp_path / "own", spd=counts(), zones=wide).zones == wide
    assert not wide[1]._replace(width=200.1).plausible() and not wide[1]._replace(width=0.0).plausible()


def test_zones_of_unknown_direction_keep_their_time_zero(tmp_path):
    unknown = [zone._replace(x=np.nan, y=np.nan, width=np.nan, zero_ps=zero_ps) for zone, zero_ps in zip(TWO, (0.0, 150.0))]
    run = write(tmp_path / "own", spd=counts(), zones=unknown)
    assert [zone.text for zone in write(tmp_path / "again", spd=run.spd, zones=run.zones).zones] == [zone.text for zone in unknown]


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


def test_derived_run_keeps_the_detector_zones(tmp_path):
    write(tmp_path / "own", spd=counts(), zones=TWO)
    derive.copy(tmp_path / "own.sqlite", tmp_path / "dim.sqlite", derive.thinned(0.5, seed=1))
    run = echofuse.open(tmp_path / "dim")
    assert run.zones == TWO and run.spd.sum() < counts().sum()


def test_room_light_of_a_derived_run_is_shared_by_all_zones_of_a_record(tmp_path):
    write(tmp_path / "own", spd=counts(records=40, histograms=9))
    derive.copy(tmp_path / "own.sqlite", tmp_path / "light.sqlite", derive.background(900, seed=1))
    added = echofuse.open(tmp_path / "light").spd - counts(records=40, histograms=9).astype(float)
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


@pytest.mark.parametrize("said, arrays", [
    ("spd.zones has 2 zones; expected 3, as in spd.npy [3, 3, 30]", {"spd": counts(histograms=3), "zones": TWO}),
    ("spd.zones has 2 zones; expected 1, as in spd.npy [3, 30]", {"spd": counts()[:, 0], "zones": TWO}),
    ("spd.zones has 2 zones; expected spd.npy [n, zones, bins]", {"radar": np.ones((3, 5)), "zones": TWO}),
    ("has 65 zones; expected at most 64", {"spd": counts(histograms=65)}),
    ("expected \"X Y WIDTH\" or \"X Y WIDTH ZERO_PS\"", {"spd": counts(), "zones": [(0, 0, 0.1), (0, 0, 0)]}),
    ("expected \"X Y WIDTH\" or \"X Y WIDTH ZERO_PS\"", {"spd": counts(), "zones": [(0, 0, 0.1, 0, 7), (0, 0, 0.1)]}),
    ("expected 2 dimensions, one row per record, or 3: [records, zones, bins]", {"spd": np.ones((3, 2, 2, 2))}),
])
def test_write_run_refuses_zones_that_do_not_match_the_histogram_array(tmp_path, said, arrays):
    with pytest.raises(RuntimeError) as refused:
        write(tmp_path / "own", **arrays)
    assert said in str(refused.value)


def test_zone_directions_raise_an_error_if_the_run_does_not_contain_them(tmp_path):
    run = write(tmp_path / "own", spd=counts())
    assert len(run.zones) == 2 and np.isnan(run.zones[0].x)
    with pytest.raises(ValueError, match="detector zones are unknown; set spd.zones"):
        zones.directions(run)


def test_zones_example_compares_detectors_with_one_and_nine_zones():
    done = subprocess.run([sys.executable, ROOT / "recon/python/examples/zones.py", "--zones", "1",
                           "3", "--train", "60", "--test", "20", "--data-sets", "1", "--methods",
                           "mean", "nearest:spd"], capture_output=True, text=True, check=True)
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
    with echofuse.open(own) as run:
        assert len(reader.predict(run).depth_m) == 40
    with echofuse.open(other) as run, pytest.raises(ValueError, match=said):
        reader.predict(run)
    done = outcome("echofuse-recon", "reconstruct", "-q", path, other, "--out", tmp_path / "maps")
    assert done.returncode == 1 and said in done.stderr
