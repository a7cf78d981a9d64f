# SPDX-License-Identifier: MIT
"""Tests that the models in Python and echofuse-recon predict the same foreground, and depths that agree within 0.1 mm."""
import csv
import dataclasses
import shutil

import numpy as np
import pytest

import echofuse
from echofuse.runs import lags
from fixtures import change, changed, json_of, outcome, plates, program, scenes

FAST = ["factorised-8"]
# Simulator settings of each run, and the models that are trained and compared on it, by run name.
RUNS = {
    "50cm": ([], [FAST, ["mean-shape"], ["mlp-64-32"], ["mlp-mask-32"], ["pca-mlp-64"], ["ridge"], ["mean"],
                  ["pca-mlp-64", "--inputs", "spd"]]),
    "4cm": (["radar_resolution_m=0.088"], [FAST]),
    "antennas": (["radar_antennas=8", "radar_sum=coherent"], [FAST]),
    "room": (["background=room"], [FAST]),
    "piled-up": (["pulses_per_window=20000", "spd_dead_time_ps=30000"], [FAST]),
    "calibrated": ([], [FAST]),
    "zones": (["spd_zones=3"], [FAST, [*FAST, "--inputs", "spd"], ["mlp-64"]]),
    "one_pixel": (None, [FAST, ["mlp-64"]]),
    "nine_zones": (None, [FAST, [*FAST, "--inputs", "spd"], ["mlp-64"]]),
}


def stated(path, taps, cell_m=0.3):
    change(path, "metadata entry ?1 with the value ?2", "radar_cell_m", str(cell_m))
    change(path, "metadata entry ?1 with the value ?2", "radar_taps", " ".join(f"{v:.6g}" for v in taps) + " +- 0.01")


def as_the_daemon_writes(path):
    """Adds noise to the radar power as the daemon stores it for TI's boards, and appends five range bins beyond the model axis."""
    run = echofuse.open(path)
    power = np.pad(run.radar + 3, ((0, 0), (0, 5)), mode="edge").astype("<f4")
    change(path, "radar power includes the noise")
    change(path, "five more range bins")
    for index, row in zip(run.index.tolist(), power):
        change(path, "radar data of record ?1", index, row.tobytes())


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("method")
    for name, (settings, _) in RUNS.items():
        made = plates(name, 60) if settings is None else scenes(60, 1, *(word for one in settings for word in ("--set", one)))
        shutil.copyfile(made, folder / f"{name}.sqlite")
    for name in ("calibrated", "antennas"):
        for sensor, offset_m in (("spd", 0.031), ("radar", 0.087)):
            change(folder / f"{name}.sqlite", "offset ?2 of the sensor ?1", sensor, offset_m)
    change(folder / "piled-up.sqlite", "filtered sync and unknown clicks per pulse in every second record")
    return folder


@pytest.mark.parametrize("name", ["50cm", "antennas"])
@pytest.mark.parametrize("difference", ["codes", "response", "flanks", "flanks of the model", "axes"])
def test_python_predictions_equal_those_of_echofuse_recon_for_runs_with_other_units_or_axes(runs, tmp_path, name, difference):
    """The run has logarithmic radar codes, a symmetric or asymmetric radar response that differs from that of the
    training run, or axes that are shifted by less than a bin."""
    trained, run = (shutil.copy(runs / f"{name}.sqlite", tmp_path / f"{part}.sqlite") for part in ("trained", "run"))
    flanks = np.exp(-np.arange(-9, 8) ** 2 / np.where(np.arange(-9, 8) < 0, 22, 9))
    stated(trained, flanks if difference == "flanks of the model" else np.exp(-np.arange(8) ** 2 / 14))
    if difference == "axes":
        change(run, "SPD axis shifted by ?1 bins", 0.3)
        change(run, "radar axes shifted by ?1 bins", -0.4)
    elif difference in ("response", "flanks of the model"):
        stated(run, np.exp(-np.arange(8) ** 2 / 5))
    elif difference == "flanks":
        stated(run, flanks)
    elif name == "50cm":
        as_the_daemon_writes(run)
    compare(tmp_path, trained, run, "factorised-8", "--epochs", 1)


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, (_, kinds) in RUNS.items() for kind in kinds])
def test_maps_predicted_in_python_equal_those_of_echofuse_recon(runs, tmp_path, name, kind):
    epochs = ["--epochs", 1] if kind[0].rstrip("-0123456789") in ("factorised", "mean-shape", "mlp", "mlp-mask", "pca-mlp") else []
    compare(tmp_path, *[runs / f"{name}.sqlite"] * 2, *kind, *epochs, "--set", "fallback=false")


def compare(folder, trained, run, *kind):
    program("echofuse-recon", "train", "-q", trained, "--out", folder / "model", "--model", *kind)
    program("echofuse-recon", "reconstruct", "-q", folder / "model", run, "--out", folder / "maps", "--format", "npy")
    assert len(same_maps(echofuse.load_model(folder / "model"), run, folder / "maps").index) == 60


def same_maps(loaded, run, folder):
    """Checks that a model predicts the maps that echofuse-recon has written to a folder. Returns the predicted maps."""
    found, (program_made, index) = loaded.predict(run), echofuse.load_maps(folder)
    background = loaded.estimators[0].t["scene/background_m"].reshape(loaded.estimators[0].size, -1)
    depth_m, by_program_m = np.nan_to_num(found.depth_m), np.nan_to_num(program_made)
    shown, shown_by_program = depth_m != background, by_program_m != background
    other = shown != shown_by_program
    assert found.index.tolist() == index.tolist()
    assert shown_by_program.any()
    assert other.sum() <= 3  # Rounding may change up to three pixels that are at the foreground threshold.
    assert np.abs(depth_m - by_program_m)[~other].max() < 1e-4
    return found


@pytest.mark.parametrize("places, pairs, quantity", [
    ([(0, 0), (1, 0), (2, 0)], ({1: [(1, 0), (2, 1)], 2: [(2, 0)]}, {}), "lags"),
    ([(0, 0), (1.005, 0), (3.02, 0)], ({1: [(1, 0)]}, {}), "lags"), ([(0, 0), (1, 0.02)], ({}, {}), None),
    ([(0, 0), (1, 0), (1, 2)], ({1: [(1, 0)]}, {2: [(2, 1)]}), "lags 1 3, 2 up"), ([(0, 0), (0, 1)], ({}, {}), None),
    ([(0, 0), (16, 0), (33, 0)], ({16: [(1, 0)]}, {}), "lags 16")])
def test_pairs_of_antennas_have_whole_spacings_of_up_to_16_half_wavelengths(places, pairs, quantity):
    found = lags.pairs_of([(*place, 1, 0) for place in places])
    axis = lags.axis_of(echofuse.Axis("array", "covariance", "m", 4, 0, 1, 7), found)
    assert found == pairs and (axis and axis.quantity) == quantity


def test_range_offset_shifts_the_lags_of_arrays_and_runs_alike(runs, tmp_path):
    program("echofuse-recon", "train", "-q", runs / "antennas.sqlite", "--model", "factorised-8", "--epochs", 1, "--out", tmp_path / "m")
    run, model = echofuse.open(runs / "antennas.sqlite"), echofuse.load_model(tmp_path / "m")
    arrays = {"spd": run.photons(), "radar": run.power(), "lags": run.lags()}
    assert (run.photons() == 0).any() and np.array_equal(model.predict(**arrays).depth_m, model.predict(run).depth_m, equal_nan=True)
    shifted, moved = model.predict(run, range_offset_m=0.5), model.predict(**arrays, range_offset_m=0.5)
    assert np.nanmax(abs(shifted.depth_m - moved.depth_m)) < 0.1 < np.nanmax(abs(shifted.depth_m - model.predict(run).depth_m))
    with pytest.raises(ValueError, match=r"lags: shape \[60, \d+, 3\] \(expected \[n, \d+, 15\]"):
        model.predict(**arrays | {"lags": run.lags()[:, :, :3]})


def histogram(bin_, count):
    return np.where(np.arange(336) == bin_, count, 3).astype("<u4").tobytes()


def record_3(column, value):
    return [("column ?1 of record 3 is ?2", column, value)]


def metadata(**entries):
    return [("metadata entry ?1 with the value ?2", *entry) for entry in entries.items()]


@pytest.mark.parametrize("name, faulty, changes", [
    *(("50cm", True, record_3(*change)) for change in (
        *(("radar", value) for value in (7.5, *(np.full(29, power, "<f4").tobytes() for power in (np.nan, 1e38)))),
        *(("spd", value) for value in (7, None, histogram(7, 5 * 10 ** 8), histogram(9, 2 ** 32 - 1))), ("slot_utc_ns", -5),
        ("slot_end_ns", 0), ("clicks_per_pulse", -1), ("in_range", -1), ("valid", "x"))),
    *(("50cm", False, record_3(*change)) for change in (("slot_utc_ns", "noon"), ("label", None), ("depth", None))),
    *(("50cm", False, metadata(radar_cell_m=cell, radar_taps=taps)) for cell, taps in (
        ("0.25", "1 0.5"), ("0.25", "0.5 0.5 0.5"), ("-0.25", "1 0.5 0.2"), ("0_25", "1 0.5 0.2"), ("0.25 +- 0.01", "1 0.5 0.2"), ("nan", "1 0.5 0.2"),
        ("0.25", "1 1.2 0.5"), ("\ufeff0.25", "1 0.5 0.2"), ("0.25", "1 inf 0.5"), ("0.25", "1 1e-400 0.2"), ("+-0.25", "1 0.5 0.2"), (" +0.25", "1  0.5 0.2 "),
        ("0.25", "0.2 0.1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0.6 1 0.6 0.1 0 0 0 0 0 0 0 0 0 0 0.1"))),
    ("50cm", False, [("metadata of the run", '\ufeff{"lens": "50 mm"}')]),
    *(("piled-up", False, metadata(detector_dead_time_ps=text)) for text in (
        "inf", "1e400", "3_0000", "0x7530", "3e4", " +30000", "30000 40000", "until the next pulse", "")),
    *(("piled-up", False, [("slot length of the run is ?1", value)]) for value in (0, "x", 1e300)),
    *(("piled-up", False, record_3(*change)) for change in (("clicks_per_pulse", 0), ("in_range", None), ("starts", None))),
    ("antennas", True, record_3("array", b"12345678")), ("antennas", False, [("gain of the antennas is ?1", None)]),
])
def test_python_and_echofuse_recon_judge_damaged_records_and_metadata_alike(runs, tmp_path, name, faulty, changes):
    run, model = tmp_path / "run.sqlite", runs / f"{name}.model"
    run.write_bytes((runs / f"{name}.sqlite").read_bytes())
    if not model.exists():
        program("echofuse-recon", "train", "-q", run, "--model", "factorised-8", "--epochs", 1, "--out", model)
    for one in changes:
        change(run, *one)
    done = outcome("echofuse-recon", "reconstruct", "-q", model, run, "--out", tmp_path / "maps", "--format", "npy")
    assert done.returncode == (5 if faulty else 0)
    maps = same_maps(echofuse.load_model(model), run, tmp_path / "maps")
    with open(tmp_path / "maps/records.csv", newline="", encoding="utf-8") as table:
        status = {int(row["record"]): row["status"] for row in csv.DictReader(table)}
    assert ({3: status[3]} if faulty else {}) == maps.faults


@pytest.mark.parametrize("said, changes", [
    ("calibration", [("offset ?2 of the sensor ?1", "spd", 1), ("offset ?2 of the sensor ?1", "spd", 2)]),
    ("calibration", [("offset ?2 of the sensor ?1", "lidar", 1)]), ("offset", [("offset ?2 of the sensor ?1", "spd", 1e9)]),
    ("antenna", [("gain of the antennas is ?1", 0)]), ("antenna", [("without antenna ?1", 3)]),
    ("axis array", [("axis ?1 has the scale ?2", "array", 7.5)]), ("axis spd", [("axis ?1 has the scale ?2", "spd", 0)]),
    ("record", [("record ?1 has the number ?2", 3, -3)]), ("record", [("record ?1 has the number ?2", 3, 1 << 60)]),
    ("the run table is empty", [("without a run",)]), ("meta", [("metadata of the run", '{"lens": "\\ud800"}')]),
])
def test_python_and_echofuse_acquire_refuse_the_same_runs(runs, tmp_path, said, changes):
    run = changed(runs / "antennas.sqlite", tmp_path / "run.sqlite", "without calibration")
    for one in changes:
        change(run, *one)
    with pytest.raises(ValueError, match=f"^{run}: .*{said}"):
        echofuse.open(run)
    done = outcome("echofuse-acquire", "info", run)
    assert done.returncode == 1 and said in done.stderr and done.stderr.count("\n") == 1


def test_loaded_model_describes_its_inputs_and_accepts_arrays(runs, tmp_path):
    run = echofuse.open(runs / "50cm.sqlite")
    program("echofuse-recon", "-q", "train", run.path, "--model", "factorised-8", "--out", tmp_path / "m")
    model = echofuse.load_model(tmp_path / "m")
    assert f"spd [n, {run.axes['spd'].count}]" in repr(model) and model.axes["radar"].unit == "m"
    maps, own = model.predict(run), model.predict(spd=run.photons(), radar=run.power(), axes=run.axes)
    assert np.array_equal(maps.depth_m, own.depth_m, equal_nan=True) and len(own) == len(run) == 60
    assert repr(maps) == "<echofuse maps: 60 maps of 64 x 64 pixels, m, tangents within 0.55>"
    # If radar data are missing, the model uses its SPD fallback.
    assert set(model.predict(spd=run.photons()).inputs) == {"spd"}
    assert len(model.predict(spd=run.photons(), range_offset_m=0.1)) == 60
    assert len(model.predict(spd=run.photons()[:0], radar=run.power()[:0]).depth_m) == 0
    spd = run.photons()
    spd[7], spd[8] = 5, np.nan
    some = model.predict(spd=spd, radar=run.power())
    assert some.faults == {7: "spd is the same in every bin", 8: "lacks spd, which the model needs"} and len(some) == 58
    odd = np.where(np.arange(spd[0].size) == 3, np.nan, run.photons())
    for said, arrays in (
            (r"spd: shape \[60, 3\] \(expected \[n, ", {"spd": spd[:, :3]}), ("number of records in both", {"spd": spd[:7]}),
            ("spd: row 0 contains a non-finite value or a negative count", {"spd": odd}),
            ("spd: row 0 contains a non-finite value or a negative count", {"spd": np.nan_to_num(odd, nan=-50)}),
            ("row 0 is masked in part", {"spd": np.ma.masked_invalid(odd)}), ("spd..: None .expected", {"axes": {"spd": None}}),
            (r"spd axis: \d+ points of counts from -?[\d.e+]+ ps in steps of 120 \(expected by .*: \d+ points of counts from",
             {"axes": {"spd": dataclasses.replace(run.axes["spd"], step=120.0)}})):
        with pytest.raises(ValueError, match=said):
            model.predict(**{"spd": run.photons(), "radar": run.power()} | arrays)
    with pytest.raises(ValueError, match="a run or arrays, not both"):
        model.predict(run, spd=run.photons())
    assert np.array_equal(maps[3], maps.depth_m[3], equal_nan=True) and maps[[1, 2]].index.tolist() == [1, 2]
    assert len(maps[maps.index > 50]) == 9 and maps[-2:].inputs == maps.inputs[-2:]
    for table in (run.spd, run.radar, run.depth):
        with pytest.raises(ValueError, match="read-only"):
            table[0] = 0
    for offset_m, said in ((np.nan, "nan"), (11, "11"), ("0.1", "'0.1'"), (None, "None")):
        for shift in lambda m: model.predict(run, range_offset_m=m), run.power:
            with pytest.raises(ValueError, match=f"^range_offset_m: {said} .expected"):
                shift(offset_m)
    maps.save(tmp_path / "maps")
    again, index = echofuse.load_maps(tmp_path / "maps")
    assert np.array_equal(again, maps.depth_m, equal_nan=True) and index.tolist() == maps.index.tolist()
    # evaluate --maps excludes the 54 records on which the model was trained.
    scored = json_of("echofuse-recon", "-q", "evaluate", "--maps", tmp_path / "maps", run.path)
    assert (scored["records"], scored["left_out"]) == (6, {"trained on": 54})
    pytest.importorskip("xarray")
    data = maps.to_xarray()
    assert data.dims == ("record", "depth_y", "depth_x") and data.attrs["units"] == "m" and float(data.depth_y[0]) > 0
    assert (data - run.to_xarray().depth).sizes == {"record": 60, "depth_y": 64, "depth_x": 64}
