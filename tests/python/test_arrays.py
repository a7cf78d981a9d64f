# SPDX-License-Identifier: MIT
"""Arrays of other programs become a run (echofuse.write_run, `echofuse-acquire import FOLDER`)."""
import subprocess

import numpy as np
import pytest

import echofuse
from programs import BIN

ACQUIRE = str(BIN / "echofuse-acquire")


def write(path, **arrays):
    return echofuse.write_run(path, program=ACQUIRE, **arrays)


def test_what_is_written_is_read(tmp_path):
    rng = np.random.default_rng(1)
    spd, radar = rng.poisson(50, (7, 90)), rng.normal(1, 0.3, (7, 12)).astype(np.float32)
    depth = np.where(rng.random((7, 24, 24)) < 0.5, np.nan, rng.uniform(0.5, 6, (7, 24, 24)))
    run = write(tmp_path / "own", spd=spd, first_bin_ps=-100.5, bin_width_ps=55.25, radar=radar, first_m=0.5, step_m=0.04,
                depth_m=depth, half_tangent=0.3, window_s=0.5, labels=[f"x{i}" for i in range(7)], notes="mine")
    assert np.array_equal(run.spd, spd) and np.array_equal(run.radar, radar)
    assert np.allclose(run.depth, depth, atol=5.1e-4, equal_nan=True)
    assert (run.axes["spd"].start, run.axes["spd"].step) == (-100.5, 55.25)
    assert run.axes["radar"].values[2] == pytest.approx(0.58)
    assert run.axes["depth_x"].values[-1] == pytest.approx(0.3 * 23 / 24) and run.axes["map_x"].count == 24
    assert run.labels[3] == "x3" and run.info["window_s"] == 0.5 and run.info["notes"] == "mine"
    assert all(valid.all() for valid in run.valid.values()) and run.info["status"] == "complete"


@pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8", "?"])
def test_every_type_of_numbers(tmp_path, kind):
    spd = (np.arange(60).reshape(4, 15) % 100).astype(kind)
    assert np.array_equal(write(tmp_path / "own", spd=spd).spd, spd.astype(np.uint32))


def test_a_row_of_nan_is_a_record_without_the_sensor(tmp_path):
    spd, radar = np.ones((3, 5)), np.ones((3, 4))
    spd[1] = np.nan
    radar[2] = np.nan
    run = write(tmp_path / "own", spd=spd, radar=radar)
    assert run.valid["spd"].tolist() == [True, False, True] and run.valid["radar"].tolist() == [True, True, False]
    assert not run.valid["depth"].any()


@pytest.mark.parametrize("said, arrays", [
    ("has neither spd.npy", {}),
    ("radar.npy: has 4 rows", {"spd": np.ones((3, 5)), "radar": np.ones((4, 4))}),
    ("spd.npy: its shape is [15]; expected 2 dimensions", {"spd": np.ones(15)}),
    ("expected counts from 0 on", {"spd": -np.ones((3, 5))}),
    ("multiply a normalised histogram", {"spd": np.full((3, 5), 0.2)}),
    ("more than 32 bits", {"spd": np.full((3, 5), 2.0 ** 33)}),
    ("expected finite power", {"radar": np.array([[1, np.inf, 1]])}),
    ("expected little-endian numbers", {"spd": np.ones((3, 5), complex)}),
    ("2 labels for 3 records", {"spd": np.ones((3, 5)), "labels": ["a", "b"]}),
    ("expected 0 to 65.5 m", {"spd": np.ones((3, 5)), "depth_m": np.full((3, 16, 16), 2900.0)}),
    ("its median is 3 mm; expected millimetres", {"spd": np.ones((3, 5)), "depth_m": np.full((3, 16, 16), 3)}),
])
def test_a_refusal_says_what_would_be_right(tmp_path, said, arrays):
    with pytest.raises(RuntimeError) as refused:
        write(tmp_path / "own", **arrays)
    assert said in str(refused.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("cut", [1, 60, 100, 127, 130])
def test_a_damaged_array_is_refused(tmp_path, cut):
    np.save(tmp_path / "spd.npy", np.ones((3, 5), np.uint16))
    (tmp_path / "run.toml").write_text("window_s = 1.0\n")
    whole = (tmp_path / "spd.npy").read_bytes()
    (tmp_path / "spd.npy").write_bytes(whole[:cut])
    done = subprocess.run([ACQUIRE, "import", tmp_path, "--out", tmp_path / "own"], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "spd.npy: " in done.stderr and done.stderr.count("\n") == 1


def test_a_response_is_kept_as_it_is_stated_and_no_laboratory_is_needed(tmp_path):
    np.save(tmp_path / "radar.npy", np.ones((3, 5)))
    (tmp_path / "run.toml").write_text('[radar]\ncell_m = 0.04996540967\ntaps = "1 0.9 0.5 0.2"\n[spd]\nirf_fwhm_ps = 1234.56789\n')
    (tmp_path / "lab.toml").write_text("this is no TOML")
    subprocess.run([ACQUIRE, "import", ".", "--out", "own"], check=True, cwd=tmp_path)
    meta = echofuse.open(tmp_path / "own.sqlite").meta
    assert (meta["radar_cell_m"], meta["radar_taps"]) == ("0.04996540967", "1 0.9 0.5 0.2")
    assert meta["irf_fwhm_ps"] == "1234.56789"
