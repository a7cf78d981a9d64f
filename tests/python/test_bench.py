# SPDX-License-Identifier: MIT
"""Tests data splits, ground-truth maps, derived runs and the result table of echofuse-bench."""
import errno
import os
import pathlib
import shutil
import types

import numpy as np
import pytest

import echofuse
from echofuse import bench
from echofuse.bench import derive, letters, stability
from echofuse.bench.methods import call
from echofuse.bench.table import content_hash
from echofuse.models.model import read_safetensors
from fixtures import change, changed, executable, made, program, scenes



@pytest.fixture
def run():
    return echofuse.open(scenes(61))


@pytest.mark.parametrize(("kind", "seed", "gap"), [("random", 1, 0), ("random", 7, 0), ("blocked", 1, 3)])
def test_python_split_equals_the_split_of_the_train_command(run, tmp_path, kind, seed, gap):
    model = tmp_path / "model"
    program("echofuse-recon", "-q", "train", run.path, "--model", "mean", "--split", kind, "--seed", seed, "--set", f"gap={gap}",
            "--out", model)
    tensors, _ = read_safetensors(model)
    index, part = tensors["split/index"].ravel(), tensors["split/part"].ravel()
    split = echofuse.split(run, kind, seed, gap=gap)
    for number, rows in enumerate((split.train, split.validation, split.test)):
        assert sorted(index[part == number].tolist()) == run.index[rows].tolist()


def test_split_and_user_methods_exclude_doubtful_records(run, tmp_path):
    path = tmp_path / "frozen.sqlite"
    changed(run.path, path, "frozen camera in every third record")
    change(path, "radar is not valid in record ?1", 4)
    sound = [i for i in range(61) if i % 3 and i != 4]
    split = echofuse.split(echofuse.open(path))
    assert sorted(np.concatenate([split.train, split.validation, split.test]).tolist()) == sound
    seen = []
    bench.python_method("mine", lambda: types.SimpleNamespace(fit=lambda run, rows: seen.extend(rows.tolist()))).fit(
        path, tmp_path, 1, True)
    assert seen == sound


@pytest.mark.parametrize(("size", "half"), [(64, None), (24, 0.5), (17, 0.6)])
def test_true_maps_in_python_equal_those_of_echofuse_recon(tmp_path, size, half):
    """The nearest neighbour of a training record is the record itself, so the predicted map equals the ground-truth
    map. The test uses the standard map grid and two coarser grids."""
    path, model, maps = tmp_path / "run.sqlite", tmp_path / "model", tmp_path / "maps"
    shutil.copy(scenes(20, 1, "--set", "map_size=64", "--set", "depth_noise_m=0.03"), path)
    for axis, sign in (("map_x", 1), ("map_y", -1)) if half else ():
        change(path, "axis ?1 has ?2 points", axis, size)
        change(path, "axis ?1 starts at ?2", axis, sign * (half / size - half))
        change(path, "axis ?1 has the step ?2", axis, sign * 2 * half / size)
    program("echofuse-recon", "train", "-q", path, "--model", "nearest", "--set", "test_share=0", "--set", "validation_share=0", "--out", model)
    program("echofuse-recon", "reconstruct", "-q", model, path, "--out", maps, "--format", "npy")
    one, (found, index) = echofuse.open(path), echofuse.load_maps(maps)
    assert index.tolist() == one.index.tolist() and found.shape[1] == size
    assert np.array_equal(found, one.maps(), equal_nan=True)


def test_derived_run_contains_the_requested_changes(run, tmp_path):
    with echofuse.open(derive.copy(run.path, tmp_path / "dim.sqlite", derive.thinned(0.1, 1), derive.fewer(0.5, 2))) as dim:
        assert len(dim) == 31 and dim.info["uuid"] != run.info["uuid"]
        assert dim.spd.sum() == pytest.approx(0.1 * run.spd[np.isin(run.index, dim.index)].sum(), rel=0.01)
    with echofuse.open(derive.copy(run.path, tmp_path / "lost.sqlite", derive.lost("radar"))) as lost:
        assert not lost.valid["radar"].any() and lost.valid["spd"].all() and np.array_equal(lost.spd, run.spd)
    with echofuse.open(derive.copy(run.path, tmp_path / "off.sqlite", derive.range_offset(0.1))) as off:
        assert np.allclose(off.power(), run.power(-0.1), atol=1e-4 * run.power().max())
    with echofuse.open(derive.copy(run.path, tmp_path / "noisy.sqlite", derive.noise(20, 1))) as noisy:
        added = (noisy.radar - run.radar) / run.radar.max(1, keepdims=True)
        assert added.std() == pytest.approx(0.01, rel=0.1) and abs(added.mean()) < 0.001


@pytest.mark.parametrize(("ends", "code", "kind"), [("exit 1", 1, bench.ProgramError), ("exit 6", 6, bench.UsageError), ("kill -9 $$", 1, bench.UsageError)])
def test_bench_error_has_the_exit_code_of_the_failed_program(tmp_path, monkeypatch, ends, code, kind):
    executable(tmp_path / "echofuse-x", f"#!/bin/sh\necho echofuse-x: what was wrong >&2\n{ends}\n")
    monkeypatch.setenv("ECHOFUSE_BIN", str(tmp_path))
    with pytest.raises(bench.ProgramError, match="^what was wrong$") as found:
        call("echofuse-x")
    assert (type(found.value), found.value.code) == (kind, code)
    with pytest.raises(bench.UsageError, match="echofuse-y: No such file or directory; add the programs to PATH"):
        call("echofuse-y")


def test_bench_error_names_the_table_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    table = bench.Table(tmp_path / "table.csv")
    table.path = tmp_path / "file/table.csv"
    with pytest.raises(bench.ProgramError, match=r"file/table.csv: cannot write \(") as found:
        table.add({"axis": "model", "value": "1", "model": "mean", "inputs": "-", "seed": 1, "source": "-", "iou": 0.5})
    assert found.value.code == 6


class Constant:
    """For each test record, predicts the map of the first training record."""

    def fit(self, known, rows):
        self.map = known.maps()[rows[0]]

    def predict(self, fresh):
        return np.repeat(self.map[None], len(fresh), 0)


class Truth:
    def __init__(self, path):
        self.path = path

    def fit(self, known, rows):
        pass

    def predict(self, fresh):
        return echofuse.open(self.path).maps()


def test_true_maps_have_iou_1_even_for_bodies_nearer_than_any_training_body(run, tmp_path):
    near = made("echofuse-sim", "dataset", "-q", "--people", 12, "--set", "target_z_min_m=1.2", "--set", "target_z_max_m=1.4")
    row = bench.measure(bench.python_method("truth", lambda: Truth(near)), run.path, near)
    assert row["iou"] == 1 and row["depth_mae_m"] == 0
    with pytest.raises(bench.ProgramError, match="is a training run"):
        bench.measure(bench.python_method("truth", lambda: Truth(run.path)), run.path, run.path)


def test_bench_refuses_an_unknown_method_and_a_table_of_another_study(run, tmp_path):
    table = bench.Table(tmp_path / "b.csv", "this")
    with pytest.raises(bench.UsageError, match="nearst"):
        bench.fill(table, bench.pareto_cells(run.path, run.path, [bench.method("nearst")], seeds=1), quiet=True)
    assert not table.rows and not table.path.exists()
    with pytest.raises(bench.UsageError, match="no.such"):
        bench.method("no.such:Thing")
    table.add({"axis": "model", "value": "1", "model": "mean", "inputs": "-", "seed": 1, "source": "-", "iou": 0.5})
    assert bench.Table(table.path, "this").rows.keys() == table.rows.keys()
    with pytest.raises(bench.UsageError, match="contains results of this .expected that"):
        bench.Table(table.path, "that")


class Full(Constant):
    def predict(self, fresh):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/tmp/mine")


class Lost(Constant):
    def fit(self, known, rows):
        open("/nowhere/weights")


@pytest.mark.parametrize(("name", "code", "said"), [("Full", 6, "No space left on device: '/tmp/mine'"),
                                                    ("Lost", 1, "No such file or directory: '/nowhere/weights'")])
def test_full_disk_or_missing_file_ends_the_bench_without_writing_a_row(run, tmp_path, monkeypatch, capsys, name, code, said):
    test = derive.copy(run.path, tmp_path / "test.sqlite")
    monkeypatch.setattr("sys.argv", ["echofuse-bench", "pareto", str(run.path), str(test), "--methods", f"test_bench:{name}", "mean",
                                     "--seeds", "1", "-q", "--out", str(tmp_path / "b.csv")])
    with pytest.raises(SystemExit) as ended:
        bench.main()
    err = capsys.readouterr().err
    assert ended.value.code == code and said in err and err.count("\n") == 1
    assert not (tmp_path / "b.csv").exists()


@pytest.mark.parametrize("text", ["mine\n", "a note without an end", "# a note\nof two lines", "axis,value\nmine", "# this\n", "\xff\n"])
def test_bench_does_not_overwrite_a_file_that_is_not_a_table(tmp_path, text):
    (tmp_path / "notes.txt").write_text(text, encoding="latin-1")
    with pytest.raises(bench.UsageError, match="not a bench table|contains results of a note"):
        bench.Table(tmp_path / "notes.txt", "this")
    assert (tmp_path / "notes.txt").read_text(encoding="latin-1") == text


@pytest.mark.parametrize("damage", [
    ("frozen camera in the records from ?1 to ?2", 0, 0),
    ("offset ?2 of the sensor ?1", "radar", 0.05),
    ("radar axes shifted by ?1 bins", 0.2),
    ("histograms without counts in the records from ?1 to ?2", 3, 3),
])
def test_content_hash_of_a_run_depends_on_its_verdicts_offsets_axes_and_data(run, tmp_path, damage):
    path = tmp_path / "other.sqlite"
    shutil.copy(run.path, path)
    assert content_hash(path) == content_hash(run.path)
    change(path, *damage)
    assert content_hash(path) != content_hash(run.path)


def test_study_computed_in_two_parts_gives_the_same_rows_and_trains_each_model_once(run, tmp_path):
    """Each of the two parts writes its own table in the folder of the common table. Study cells that need the same run
    or model share it."""
    made, learnt = [], scenes(12, 9)

    def cells():
        def source(name):
            def make(folder):
                made.append(name)
                return learnt if name == "train" else run.path
            return bench.RunSource(name, make)

        fits = bench.Method("mine", "-", lambda train, folder, seed, fallback: made.append(f"fit {seed}") or (
            lambda test, scratch: (["--maps", str(maps)], {})), find=lambda: [pathlib.Path(__file__)])
        return [bench.Cell("x", str(k), fits, seed, source("train"), source(f"test {k}")) for seed in (1, 2) for k in (1, 2)]

    maps = tmp_path / "maps"
    echofuse.save_maps(maps, run.maps(), run.index)
    (tmp_path / "whole.csv").touch()
    whole = bench.Table(tmp_path / "whole.csv")
    bench.fill(whole, cells(), quiet=True)
    assert sorted(made) == ["fit 1", "fit 2", "test 1", "test 2", "train"]
    out = tmp_path / "parts.csv"
    made.clear()
    for k in (2, 1):
        bench.fill(bench.Table(out, part=(k, 2)), cells(), part=(k, 2), quiet=True)
    assert [name for name in made if name.startswith("fit")] == ["fit 2", "fit 1"]
    assert not out.exists() and len(list(tmp_path.glob("parts-part-*-of-2.csv"))) == 2
    made.clear()
    joined = bench.Table(out)
    bench.fill(joined, cells(), quiet=True)
    assert not made and joined.rows.keys() == whole.rows.keys() and bench.Table(out).rows.keys() == whole.rows.keys()
    cat = tmp_path / "cat.csv"
    cat.write_text("".join(path.read_text() for path in tmp_path.glob("parts-part-*.csv")) + "x,1,mi")
    assert bench.Table(cat).rows.keys() == whole.rows.keys() and cat.read_text().endswith("\n")


def test_letters_are_recognised_in_true_maps_but_not_in_empty_or_mirrored_maps():
    settings = [word for setting in ("spd_rays=16", "radar_rays=16", "map_size=256") for word in ("--set", setting)]
    with echofuse.open(made("echofuse-sim", "dataset", "-q", "--letters", 24, "--seed", 3, *settings)) as run:
        truth, half = run.maps(), run.axes["map_x"].step * 128
        share, sizes = letters.read(truth, truth, run.labels, half)
        assert share.mean() > 0.85 and set(sizes) == {0, 1}
        text = letters.text(share, sizes).splitlines()
        assert text[0].startswith("24 letters: ") and text[1].startswith(f"{(sizes == 0).sum()} letters of 40 x 30 cm: ")
        assert letters.read(np.full_like(truth, np.nan), truth, run.labels, half)[0] == pytest.approx(0.1)
        share, sizes = letters.read(truth[:1], truth[:1], ["person"], half)
        assert np.isnan(share[0]) and sizes[0] == -1
        # The maps are mirrored left to right.
        assert np.nanmean(letters.read(truth[:, :, ::-1], truth, run.labels, half)[0]) < 0.8


def test_letter_template_is_blurred_in_proportion_to_the_pixels_of_the_map():
    grey = [np.count_nonzero((t := letters.template("H", (0.4, 0.5, 0.08), step)) % 1) / t.size for step in (0.002, 0.02, 0.05)]
    assert grey[0] < grey[1] < grey[2], grey


def test_each_axis_of_the_stability_study_contains_the_base_condition_once(run):
    for axis in stability.Simulated([], 10, 10).axes() + stability.recorded_axes():
        assert sum(world == stability.BASE for world in axis.values.values()) == 1, axis.id


def test_stability_study_of_eight_antennas_has_more_frames_per_record_than_antennas():
    source = stability.Simulated(["radar_antennas=8"], 10, 10)  # 60 frames in 3 s
    slots, = (axis.values for axis in source.axes() if axis.id == "matched-slot")
    assert list(slots) == ["3", "2", "1", "0.5"] and "radar_frames=10" in slots["0.5"].set


def test_stability_study_simulates_training_and_test_data_with_different_seeds(monkeypatch, tmp_path):
    source, made_of = stability.Simulated([], 10, 20), []
    monkeypatch.setattr(source, "make", lambda world, records, seed, out: made_of.append((records, seed)))
    for seed in 1, 2:
        source.train(stability.BASE, seed, tmp_path)
        source.test(stability.BASE, seed, tmp_path)
    assert made_of == [(10, 1), (20, 1001), (10, 2), (20, 1002)]
