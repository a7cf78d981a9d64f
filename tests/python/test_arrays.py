# SPDX-License-Identifier: MIT
"""Tests echofuse.write_run and `echofuse-acquire import FOLDER`, which convert NumPy arrays to a run."""
import io
import resource

import numpy as np
import pytest

import echofuse
from echofuse import plot
from echofuse.bench import derive
from echofuse.runs import antennas
from fixtures import BIN, json_of, outcome, program

write = echofuse.write_run


def test_run_written_from_arrays_reads_back_the_same_arrays(tmp_path):
    rng = np.random.default_rng(1)
    spd, radar, array = rng.poisson(50, (7, 90)), rng.normal(1, 0.3, (7, 12)).astype(np.float32), rng.normal(0, 1, (7, 12, 10))
    array[:, :, 4:6] = 100  # Columns 4 and 5 contain the power of each antenna.
    depth = np.where(rng.random((7, 24, 24)) < 0.5, np.nan, rng.uniform(0.5, 6, (7, 24, 24)))
    run = write(tmp_path / "own", spd=spd, first_bin_ps=-100.5, bin_width_ps=55.25, irf_fwhm_ps=300, radar=radar, first_m=0.5,
                step_m=0.04, radar_cell_m=0.25, radar_taps=[1, 0.9, 0.5, 0.2], array=array, array_frames=5,
                antennas=[(0, 0), (1, 0, 1.5, 0.25)], depth_m=depth, half_tangent=0.3, far_m=5, window_s=0.5,
                labels=[f"x{i}" for i in range(7)], notes="mine")
    assert np.array_equal(run.spd, spd) and np.array_equal(run.radar, radar)
    assert np.allclose(run.depth, depth, atol=5.1e-4, equal_nan=True)
    assert np.allclose(antennas.values(run), array, atol=0.01) and antennas.frames(run).tolist() == [5] * 7
    assert (run.axes["spd"].start, run.axes["spd"].step, run.axes["map_z"].step) == (-100.5, 55.25, 5)
    assert run.axes["radar"].values[2] == pytest.approx(0.58)
    assert run.axes["depth_x"].values[-1] == pytest.approx(0.3 * 23 / 24) and run.axes["map_x"].count == 24
    assert [run.meta[key] for key in ("radar_cell_m", "radar_taps", "irf_fwhm_ps")] == ["0.25", "1.0 0.9 0.5 0.2", "300"]
    assert run.antennas == [(0, 0, 1, 0), (1, 0, 1.5, 0.25)]
    assert run.labels[3] == "x3" and run.info["window_s"] == 0.5 and run.info["notes"] == "mine"
    assert all(valid.all() for valid in run.valid.values()) and run.info["status"] == "complete"


@pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8", "g", "?"])
def test_write_run_accepts_integer_float_and_bool_arrays(tmp_path, kind):
    spd = (np.arange(60).reshape(4, 15) % 100 + (1 << 24) * (np.dtype(kind).itemsize > 4)).astype(kind)
    assert np.array_equal(write(tmp_path / "own", spd=spd).spd, spd.astype(np.uint32))


def masked(shape, row, kind="u2"):
    return np.ma.masked_where(np.arange(shape[0]).reshape(-1, *[1] * (len(shape) - 1)) * np.ones(shape) == row, np.full(shape, 2000, kind))


@pytest.mark.parametrize("spd, radar, depth", [
    (np.array([[1, 1], [np.nan, np.nan], [1, 1]]), np.ones((3, 4)), None),
    (masked((3, 5), 1), masked((3, 4), 2), masked((3, 16, 16), 0)),
    ([*masked((3, 5), 1)], masked((3, 4), 2, float), masked((3, 16, 16), 0, float) / 1000),
    ([[1, 2], None, [3, 4]], [[1., 2.], [1., 2.], np.ma.masked], [None, *np.full((2, 16, 16), 2000)]),
    (np.array([[1, 2], [None, None], [3, 4]]), None, None),
])
def test_row_of_nan_or_none_or_masked_values_marks_the_sensor_as_missing(tmp_path, spd, radar, depth):
    run = write(tmp_path / "own", spd=spd, radar=radar, depth_m=depth)
    assert run.valid["spd"].tolist() == [True, False, True]
    for name, given, row in ("radar", np.ma.is_masked(radar), 2), ("depth", depth is not None, 0):
        assert run.valid[name].tolist() == [given and at != row for at in range(3)] or not given


def test_masked_pixels_of_depth_images_have_no_return(tmp_path):
    mm = masked((16, 16), 5)
    for name, given in ("mm", mm), ("m", mm / 1000), ("object", np.where(mm.mask, None, mm.data)):
        run = write(tmp_path / name, spd=np.ones((2, 5)), depth_m=[given] * 2 if name != "object" else np.stack([given] * 2))
        assert np.array_equal(run.depth[1], mm.filled(0) / np.float32(1000) * np.where(mm.mask, np.nan, np.float32(1)), equal_nan=True)


@pytest.mark.parametrize("given, stored", [(np.arange(3), ["0", "1", "2"]), ([0.5, None, np.str_("x")], ["0.5", "", "x"]),
                                           ([np.nan, np.ma.masked, np.datetime64("NaT")], ["", "", ""]), (["nan", "NaT", "<NA>"],) * 2,
                                           ("\U0001f600\x7f\t\"\\\n\xfc", 3)])
def test_labels_may_be_numbers_and_contain_any_character(tmp_path, given, stored):
    labels = {"label": given} if stored == 3 else {"labels": given}
    assert write(tmp_path / "own", spd=np.ones((3, 5)), **labels).labels == ([given] * 3 if stored == 3 else stored)


@pytest.mark.parametrize("name", ["x-%Y", "100%", "%%", "-x", "x.sqlite.y"])
def test_write_run_uses_a_name_as_given(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    assert len(write(name, spd=np.ones((3, 5)))) == 3 and [path.name for path in tmp_path.iterdir()] == [f"{name}.sqlite"]


@pytest.mark.parametrize("name", ["", ".", "..", "d/"])
def test_write_run_refuses_the_name_of_a_folder(tmp_path, monkeypatch, name):
    (tmp_path / "d").mkdir()
    monkeypatch.chdir(tmp_path / "d")
    with pytest.raises(ValueError, match="expected the name of a run file"):
        write(name, spd=np.ones((3, 5)))
    if name:
        done = outcome("echofuse-acquire", "import", tmp_path / "d", "--out", name)
        assert done.returncode == 2 and "expected the name of a run file" in done.stderr
    with pytest.raises(RuntimeError, match=r"/x{251}\.sqlite: File name too long$"):
        write("x" * 251, spd=np.ones((3, 5)))
    with pytest.raises(FileNotFoundError, match="no such folder: '.*/missing'"):
        write(tmp_path / "missing/x", spd=np.ones((3, 5)))
    assert not list((tmp_path / "d").iterdir()) and len(list(tmp_path.iterdir())) == 1


def test_rows_of_a_run_have_one_dimension(tmp_path):
    run = write(tmp_path / "own", spd=np.arange(15).reshape(3, 5), depth_m=np.full((3, 16, 16), 2.))
    with pytest.raises(IndexError, match="not masked"):
        run[np.ma.masked_equal([0, 1], 1)]
    for rows in ([[0, 1], [1, 2]], np.array(1), True):
        with pytest.raises(IndexError, match="expected a slice, a mask or a list"):
            run[rows]
    assert plot.timeline(run[1:]).axes and run[[2, 0]].labels == ["", ""]
    for wrong in (lambda: run.maps([3]), lambda: run.map_of(3), lambda: run.depth_mm(3), lambda: run.maps([True])):
        with pytest.raises(IndexError, match="out of bounds|did not match"):
            wrong()
    assert run[np.int64(1)].spd[0] == 5


@pytest.mark.parametrize("size", [(8, 6), (2, 2), (300, 300)])
def test_images_that_are_resampled_to_maps_of_64_pixels_are_named(tmp_path, size):
    arrays = {"spd": np.ones((1, 5)), "depth_m": np.full((1, *size), 2.0)}
    with pytest.warns(UserWarning, match="depth_m: images of {} x {} pixels become maps of 64 x 64".format(*size)) as warned:
        assert write(tmp_path / "own", **arrays).maps().shape == (1, 64, 64)
    assert warned[0].filename == __file__ and write(tmp_path / "given", **arrays, map_size=20).maps().shape == (1, 20, 20)
    assert len(warned) == 1


TWO_ZONES = [(-0.17, 0.02, 0.3, 1100.0), (0.17, 0.02, 0.3, 1000.5)]
# The words of the error, and the arguments besides three histograms. The package itself refuses arguments that are not arrays
# of numbers (ValueError).
NO_NUMBERS = [
    ("spd: row 1 is masked in part", {"spd": np.ma.masked_equal(np.arange(6).reshape(3, 2), 2)}),
    ("spd: row 0 is masked in part", {"spd": [[1, None], [1, 2]]}),
    ("radar: row 2 is masked in part", {"radar": np.ma.masked_equal(np.arange(6.).reshape(3, 2), 5)}),
    ("spd: expected an array of numbers", {"spd": [[1, 2], [3]]}),
    *((f"zones: {said}", {"zones": [zone]}) for said, zone in (
        ("masked (expected a number)", np.ma.masked_equal([0, 0, 1], 1)), ("'left' (expected a sequence)", "left"),
        ("'left' (expected a number)", ("left", 0, 1)))),
    ("antennas: 3 (expected a sequence)", {"antennas": 3}), ("radar_taps: None (expected a sequence)", {"radar_taps": None}),
    ("window_s: None (expected a number)", {"window_s": None}), ("map_size: 16.5 (expected an integer)", {"map_size": 16.5}),
    ("map_size: 10000000000000000000 (expected an integer)", {"map_size": 10 ** 19}),
    ("signal['spd_clicks']: [1] (expected a number)", {"signal": {"spd_clicks": [1]}}),
    ("signal: [('spd_clicks', 1)] (expected a dict)", {"signal": [("spd_clicks", 1)]}),
    ("notes: [] (expected text or a number)", {"notes": []}),
    *((f"labels: {said}", {"labels": labels}) for said, labels in (
        ("{'a'} (expected a sequence)", {"a"}), ("{'a': 1} (expected a sequence)", {"a": 1}), ("array('abc'", np.array("abc")),
        ("1704067200000000000 (expected text or a number)", np.array(["2024"], "M8[ns]")), ("'abc' (expected a seq", "abc"),
        ("'\\ud800' (expected valid Unicode text)", ["\ud800"]), ("b'a' (expected text or a number)", [b"a"]))),
    *((f"spd: expected an array of numbers, not {kind}", {"spd": table}) for kind, table in (
        ("complex128 (3, 5)", np.ones((3, 5), complex)), ("<U3 (3, 5)", np.ones((3, 5)).astype("U3")),
        ("timedelta64[s] (3, 5)", np.ones((3, 5), "m8[s]")), ("float64 ()", 3.0), ("float64 ()", np.ma.masked))),
]
INVALID = [
    *((said, {"spd": spd}) for said, spd in (
        ("contains neither spd.npy", None), ("spd: has no rows", np.ones((0, 5))), ("exceeds 32 bits", [[2 ** 33]] * 3),
        ("spd: row 1 has nan", np.array([[1., 1], [np.nan, 1]])), ("spd: its shape is [9]; expected 2 dimensions", np.ones(9)),
        ("expected 2 dimensions, one row per record, or 3: [records, zones, bins]", np.ones((3, 2, 2, 2))),
        ("expected counts of 0 or more (if the background was subtracted, add it to all bins again)", -np.ones((3, 5))),
        ("multiply by 16 if each row is the mean over that number", np.arange(15).reshape(3, 5) / 16),
        ("multiply a normalised histogram by its photon number", np.random.default_rng(1).random((3, 5))),
        ("nothing to import: 3 records; no record contains valid data", np.full((3, 5), np.nan)),
        ("has 65 zones; expected at most 64", np.ones((3, 65, 5))))),
    ("spd.irf_fwhm_ps: expected 0.1 to 100000", {"irf_fwhm_ps": 0.05}),
    ("spd.irf_fwhm_ps is 0.35 ps, but the bins have 100 ps: is the width in ns?", {"irf_fwhm_ps": 0.35}),
    ("spd.zones has 2 zones; expected 3, as in spd.npy [3, 3, 30]", {"spd": np.ones((3, 3, 30)), "zones": TWO_ZONES}),
    ("spd.zones has 2 zones; expected 1, as in spd.npy [3, 5]", {"zones": TWO_ZONES}),
    ("spd.zones has 2 zones; expected spd.npy [n, zones, bins]", {"spd": None, "radar": np.ones((3, 5)), "zones": TWO_ZONES}),
    *(('expected "X Y WIDTH" or "X Y WIDTH ZERO_PS"', {"zones": [(0, 0, 1), zone]}) for zone in ((0, 0, 0), (0, 0, 1, 0, 7))),
    ("radar: has 4 rows, but spd has 3", {"radar": np.ones((4, 4))}),
    ("has inf; expected power below 1e38", {"spd": None, "radar": np.array([[1, np.inf, 1]])}),
    ("row 0 has at most 1e-35; expected values from 1e-30 to 1e+38; multiply", {"radar": np.full((3, 5), 1e-35)}),
    *(("radar.taps: expected 3 to 64 numbers", {"radar": np.ones((3, 5)), "radar_cell_m": 0.25, "radar_taps": taps})
      for taps in ((), [1, np.nan, 1], [1, 2])),
    ("radar.cell_m above 0", {"radar": np.ones((3, 5)), "radar_taps": [1, 0.5, 0.1]}),
    *((said, {"radar": np.ones((3, 5)), "array": array, "antennas": places}) for said, array, places in (
        ("expected a shape that matches radar.npy and radar.antennas", np.ones((3, 5, 7)), [(0, 0)]),
        ('"1.0"; expected at most 12 strings', None, [(1,)]), ('"0.0 0.0 0.0 0.0"; expected at most 12', None, [(0, 0, 0, 0)]),
        ("array: row 1 has the antenna power -1; expected powers of 0 or more",
         np.array([1, -1, 1])[:, None, None] * np.ones((3, 5, 10)), [(0, 0), (1, 0)]))),
    ("unknown key \"signal.a b\\n\"", {"signal": {"a b\n": 1}}), ("2 labels, but there are 3 records", {"labels": ["a", "b"]}),
    ("cannot be read: record 9999: its slot", {"spd": np.ones((10000, 5)), "window_s": 1e6}),
    *((said, {"depth_m": np.full((3, 16, 16), depth)}) for said, depth in (
        ("depth_m: row 0: a depth of 2900", 2900.0), ("expected 0 to 65.5 m", 2900.0),
        ("row 0: its median is 0 mm; expected depths in metres", 4e-4),
        ("its median is 3 mm; expected depths in millimetres (for metres pass floating-point numbers)", 3))),
]


@pytest.mark.parametrize("said, arrays", NO_NUMBERS + INVALID)
def test_write_run_refuses_invalid_arrays_and_states_what_is_expected(tmp_path, said, arrays):
    with pytest.raises(ValueError if any(said == row[0] for row in NO_NUMBERS) else RuntimeError) as refused:
        write(tmp_path / "own", **{"spd": np.ones((3, 5))} | arrays)
    assert said in str(refused.value) and str(tmp_path) not in str(refused.value).replace(str(tmp_path / "own"), "")
    assert not list(tmp_path.iterdir())


def npy(values, kind=None):
    file = io.BytesIO()
    np.save(file, np.array(values, kind))
    return file.getvalue()


@pytest.mark.parametrize("name, data, said", [
    *(("spd", npy(np.ones((3, 5)), "u2")[:cut], "") for cut in (1, 60, 100, 127, 130)),
    ("spd", npy(np.zeros((0, 5)), "<u4").replace(b"<u4", b"<u\0"), "has type '<u\\x00'; expected little-endian integers"),
    *((name, npy(values, float), said) for name, values, said in (
        ("index", [0.5, 1], "row 0 has 0.500000; expected a whole number from 0 to"), ("index", [0, np.nan], "row 1 has nan"),
        ("valid", [7, -1], "row 1 has -1.000000; expected a whole number from 0 to 7"), ("valid", [1e300, 7], "row 0 has 1"))),
])
def test_import_refuses_damaged_or_fractional_npy_files(tmp_path, name, data, said):
    write(tmp_path / "base", spd=np.ones((2, 5)))
    (tmp_path / "run.toml").write_text('run = "base.sqlite"')
    np.save(tmp_path / "index.npy", [0, 1])
    (tmp_path / f"{name}.npy").write_bytes(data)
    done = outcome("echofuse-acquire", "import", tmp_path, "--out", tmp_path / "own")
    assert done.returncode == 1 and f"{name}.npy: {said}" in done.stderr and done.stderr.count("\n") == 1


def events(run):
    return [text for _, _, source, text in run.events() if source == "import"]


def scene(n=12):
    """Returns n histograms with a peak and n range profiles with an echo. The noise of each record is independent."""
    rng = np.random.default_rng(2)
    peak, echo = 500 * (np.arange(90) // 5 == 7), 1000.0 * (np.arange(20) == 9)
    return {"spd": rng.poisson(peak + 10, (n, 90)), "radar": rng.exponential(1, (n, 20)) + echo}


def verdicts(run, sensor):
    return run.quality()[f"{sensor}_verdict"].tolist()


def first_repeated(arrays):
    return {name: np.repeat(values[:1], 12, 0) for name, values in arrays.items()}


def dim(arrays):
    return {"spd": np.random.default_rng(1).poisson(arrays["spd"] / 10)}


@pytest.mark.parametrize("spd, radar, change", [
    ("ok", "ok", lambda a: a), ("stands still", "stands still", first_repeated),
    ("no peak", "no range profile", lambda a: {name: 0 * values for name, values in a.items()}),
    ("weak", "not configured", dim), ("ok", "not configured", lambda a: dim(a) | {"signal": {"spd_clicks": 0}}),
    # Verdicts do not depend on the unit of the radar power.
    *(("not configured", word, lambda a, of=of, unit=unit: of({"radar": unit * a["radar"]}))
      for unit in (1e-12, 1e-3, 1e6) for word, of in (("ok", dict), ("stands still", first_repeated))),
])
def test_imported_records_get_the_same_verdicts_as_live_records(tmp_path, spd, radar, change):
    run = write(tmp_path / "own", **change(scene()))
    for sensor, word in ("spd", spd), ("radar", radar), ("depth", "not configured"):
        assert verdicts(run, sensor) == ["ok" if word == "stands still" else word, *[word] * 11], sensor


@pytest.mark.parametrize("said, change", [
    ("are they in dB?", lambda a: {"radar": 10 * np.log10(a["radar"]) + 60}),
    ("are they in dB?", lambda a: {"radar": 10 * np.log10(a["radar"]) - 5}),
    ("the range profile ends at 0.005 m; is its range step in metres?", lambda a: {"step_m": 25e-5}),
    ("bin 30 contains 4294967295 counts in an exposure of 3 s",
     lambda a: {"spd": np.where(np.arange(12 * 90).reshape(12, 90) == 480, 0xffffffff, a["spd"])})])
def test_import_reports_mistakes_of_the_program_that_wrote_the_arrays(tmp_path, said, change):
    arrays = scene()
    assert not events(write(tmp_path / "right", **arrays, began="2024-02-07"))
    run = write(tmp_path / "wrong", **{**arrays, **change(arrays)}, began="2024-02-07")
    assert len(events(run)) == 1 and said in events(run)[0]
    assert verdicts(run, "spd").count("no histograms") == ("4294967295" in said)


def test_began_argument_sets_the_start_time_of_an_imported_run(tmp_path):
    run = write(tmp_path / "own", began="2024-02-07T13:00:00+01:00", **scene())
    assert run.time[1] == np.datetime64("2024-02-07T12:00:03") and run.info["started_utc"] == "2024-02-07T12:00:00.000Z"
    assert run.info["ended_utc"] == "2024-02-07T12:00:36.000Z"
    assert "2024-02-07T12:00:00" in str(json_of("echofuse-acquire", "list", tmp_path))
    assert events(write(tmp_path / "today", **scene())) == [
        "start time unknown: the modification time of radar.npy is used; set it with --began UTC"]
    for text in (0, "2024-02-30", "2024-02-07T13:00:00+25:00", "2024-02-07T13:00:00+1", "noon"):
        with pytest.raises(RuntimeError, match="expected a time such as"):
            write(tmp_path / "other", began=text, **scene())


def test_import_marks_an_implausible_depth_map_as_invalid(tmp_path):
    depth = np.random.default_rng(1).integers(2000, 3000, (12, 16, 16)).astype(np.uint16)
    depth[3] = 7
    depth[5, :2] = 65535
    run = write(tmp_path / "own", depth_m=depth, began="2024-02-07", **scene())
    assert np.flatnonzero(~run.valid["depth"]).tolist() == [3]
    assert run.quality()["depth_verdict"][3] == "odd" and run.quality()["depth_figures"][3].startswith("its median is 7 mm")
    assert "1 of 12 maps are implausible and were omitted" in events(run)[0]
    assert np.isnan(run.depth[5, :2]).all() and not np.isnan(run.depth[5, 2:]).any()


def test_import_checks_the_npy_shape_before_allocating_memory(tmp_path):
    if b"__asan_init" in (BIN / "echofuse-acquire").read_bytes():
        pytest.skip("AddressSanitizer reserves more memory than the limit")
    (tmp_path / "run.toml").touch()
    with open(tmp_path / "spd.npy", "wb") as file:
        file.write(npy(np.zeros((1, 5)), "u1")[:128].replace(b"5), }" + 9 * b" ", b"4294967301), }"))
        file.truncate(128 + 4294967301)  # The file is sparse, so it occupies almost no disk space.
    done = outcome("echofuse-acquire", "import", tmp_path, "--out", tmp_path / "own",
                   preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30)))
    assert done.returncode == 1 and "has 4294967301 values per record; expected at most" in done.stderr


def test_derived_run_keeps_everything_except_the_replaced_arrays(tmp_path):
    run = write(tmp_path / "base", **scene(), irf_fwhm_ps=300, labels=[f"x{i}" for i in range(12)], began="2024-02-07",
                depth_m=np.random.default_rng(1).uniform(2, 3, (12, 16, 16)), notes="mine")
    with echofuse.open(derive.copy(run.path, tmp_path / "few.sqlite", derive.gain(2), derive.range_offset(0.1),
                                   lambda records: records.keep.__setitem__(slice(3), False))) as few:
        assert few.index.tolist() == list(range(3, 12)) and few.labels == run.labels[3:] and few.axes == run.axes
        assert np.array_equal(few.radar, 2 * run.radar[3:]) and np.array_equal(few.spd, run.spd[3:])
        assert np.array_equal(few.depth, run.depth[3:]) and np.array_equal(few.time, run.time[3:])
        assert few.meta == run.meta and few.info["notes"] == "mine" and few.info["started_utc"] == run.info["started_utc"]
        assert few.info["uuid"] != run.info["uuid"] and few.offset_m == {"radar": pytest.approx(-0.1)}


@pytest.mark.parametrize("size", [3, 8])
def test_small_maps_keep_their_size_in_training_and_evaluation(tmp_path, size):
    rng = np.random.default_rng(1)
    depth = np.where(rng.random((40, size, size)) < 0.5, 0, rng.uniform(1, 4, (40, size, size)))
    run = write(tmp_path / "own", spd=rng.poisson(50, (40, 60)), depth_m=depth)
    assert run.maps().shape == (40, size, size) and np.allclose(np.nan_to_num(run.maps()), depth, atol=5.1e-4)
    model, maps = tmp_path / "m.safetensors", tmp_path / "maps"
    program("echofuse-recon", "-q", "train", run.path, "--inputs", "spd", "--model", "ridge", "--out", model)
    program("echofuse-recon", "-q", "reconstruct", model, run.path, "--out", maps, "--format", "npy,colour,ply")
    assert echofuse.load_maps(maps)[0].shape == (40, size, size)
    metrics = json_of("echofuse-recon", "-q", "evaluate", model, run.path)["metrics"]
    assert metrics["iou"]["mean"] >= 0 and metrics["ssim"]["mean"] is None


def test_split_uses_the_sensors_of_the_run_and_names_missing_data_if_no_record_remains(tmp_path):
    depth = np.where(np.arange(16) < 8, 2.0, 3.0) * np.ones((12, 16, 1))
    run = write(tmp_path / "own", depth_m=depth + np.random.default_rng(1).normal(0, 0.01, (12, 16, 16)), spd=scene()["spd"])
    assert len(np.concatenate(list(vars(echofuse.split(run, test_share=0.25)).values()))) == 12
    with pytest.raises(RuntimeError, match="no record has radar"):
        echofuse.split(run, inputs="fused")
    blind = write(tmp_path / "blind", **scene())
    with pytest.raises(RuntimeError, match="no record has a depth map"):
        echofuse.split(blind)


@pytest.mark.parametrize("said, maps, index", [
    *((f"index: {kind}] (expected 2 record indices)", np.ones((2, 4, 4)), index) for kind, index in (
        ("int64 [3", [1, 2, 3]), ("float64 [2", [1, .5]), ("int64 [2", [1, -1]), ("int64 [2", np.ma.array([1, 2], mask=1)))),
    ("index: record 3 has 2 maps", np.ones((2, 4, 4)), [3, 3]), ("has no record 12", np.ones((2, 4, 4)), [3, 12]),
    ("maps: bool (expected depths in metres)", np.ones((2, 4, 4), bool), [1, 2]),
    ("depth_m: shape [4, 4] (expected [n, N, N])", np.ones((4, 4)), [3]),
    ("expected metres, not millimetres", np.full((2, 4, 4), 3000), [1, 2]),
    ("has an impossible depth: inf m", np.full((2, 4, 4), np.inf), [1, 2]),
])
def test_save_maps_refuses_wrong_record_indices(tmp_path, said, maps, index):
    run = write(tmp_path / "own", **scene())
    with pytest.raises(ValueError) as refused:
        echofuse.save_maps(tmp_path / "maps", maps, index, run=run)
    assert said in str(refused.value) and not (tmp_path / "maps").exists()

