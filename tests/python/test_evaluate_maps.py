# SPDX-License-Identifier: MIT
"""Tests `echofuse-recon evaluate --maps`: which records are scored, and whether the maps belong to the run."""
import json

import numpy as np
import pytest

import echofuse
from echofuse.bench import derive
from fixtures import outcome, scenes


@pytest.fixture
def run():
    return echofuse.open(scenes(60))


def judged(folder, run, *words, ok=True):
    done = outcome("echofuse-recon", "-q", "evaluate", "--maps", folder, run.path, *words)
    assert (done.returncode == 0) == ok, done.stderr
    return json.loads(done.stdout) if "--json" in words and ok else done.stdout + done.stderr


def save(folder, of, rows, **more):
    echofuse.save_maps(folder, of.maps(rows), of.index[rows], **more)
    return folder


def test_evaluate_scores_a_record_without_a_map_as_an_empty_map(run, tmp_path):
    few = save(tmp_path / "few", run, np.arange(6))
    told, whole = judged(few, run, "--json"), judged(save(tmp_path / "all", run, np.arange(60)), run, "--json")
    assert (told["records"], told["answered"], told["rows"][0]["answered"]) == (60, 6, 6)
    assert told["metrics"]["iou"]["mean"] == pytest.approx(0.1) and told["trivial"] == whole["trivial"]
    assert (whole["answered"], whole["metrics"]["iou"]["mean"]) == (60, 1)
    text = judged(few, run)
    assert "few: 6 of 60 records have a map; missing maps are replaced by the empty room" in text
    assert text[text.index("depth_mae_m"):].splitlines()[1].split()[:3] == ["over", "maps", "6"]


def test_evaluate_scores_only_the_records_selected_by_the_rows_option(run, tmp_path):
    rows = echofuse.split(run).test
    folder = save(tmp_path / "mine", run, rows, run=run)
    for asked in ("test", "listed"):
        told = judged(folder, run, "--json", "--rows", asked)
        assert (told["records"], told["answered"], told["metrics"]["iou"]["mean"]) == (len(rows), len(rows), 1)
        assert told["left_out"] == {"excluded by --rows": 60 - len(rows)}


def test_load_maps_includes_maps_predicted_without_one_sensor(tmp_path):
    echofuse.save_maps(tmp_path, np.zeros((3, 4, 4)), [1, 2, 4])
    (tmp_path / "records.csv").write_text('record,status\n1,"radar lost: SPD alone"\n2,"antennas lost: range profile alone"\n'
                                          "3,a sensor missing\n4,ok\n")
    assert echofuse.load_maps(tmp_path)[1].tolist() == [1, 2, 4]


def test_evaluate_refuses_maps_of_records_that_the_run_does_not_contain(run, tmp_path):
    echofuse.save_maps(tmp_path / "none", run.maps([0, 1]), [0, 1000])
    assert "contains a map of record 1000; " in judged(tmp_path / "none", run, ok=False)


@pytest.mark.parametrize("old, new", [("record", "index"), (",", ";"), ("1,ok", "0,ok"), ("1,ok", "-1,ok"), ("1,ok", "+1,ok"), ("1,ok", "1.0,ok"),
                                      ("1,ok", ",ok"), ("1,ok", "1"), ("1,ok", "99999999999999999999,ok"), ("1,ok", "1,dead"), ("1,ok", "1_0,ok")])
def test_load_maps_and_evaluate_refuse_the_same_tables(run, tmp_path, old, new):
    folder = save(tmp_path / "maps", run, [0, 1, 2])
    table = (folder / "records.csv").read_text()
    (folder / "records.csv").write_bytes(("\ufeff" + table.replace("\n", "\r\n")).encode())
    assert echofuse.load_maps(folder)[1].tolist() == [0, 1, 2] and judged(folder, run, "--json")["answered"] == 3
    (folder / "records.csv").write_text(table.replace(old, new))
    with pytest.raises(ValueError, match=f"^{folder}: "):
        echofuse.load_maps(folder)
    assert str(folder) in judged(folder, run, ok=False)


@pytest.mark.parametrize("change", [lambda maps: maps * 1000, lambda maps: maps.astype(">f4"), lambda maps: np.asfortranarray(maps), lambda maps: maps > 2,
                                    lambda maps: maps.astype("f2"), lambda maps: maps.astype(object), lambda maps: maps.reshape(3, -1), lambda maps: maps[:2], None])
def test_load_maps_and_evaluate_refuse_the_same_arrays(run, tmp_path, change):
    folder, maps = save(tmp_path / "maps", run, [0, 1, 2]), np.nan_to_num(run.maps([0, 1, 2]))
    with open(folder / "maps.npy", "wb") as file:
        np.save(file, change(maps) if change else maps, allow_pickle=True)
        file.write(b"" if change else b"behind the array")
    with pytest.raises(ValueError, match=f"^{folder}: "):
        echofuse.load_maps(folder)
    assert str(folder) in judged(folder, run, ok=False)


def test_save_maps_and_evaluate_refuse_a_folder_that_contains_maps_of_another_run(run, tmp_path):
    folder = save(tmp_path / "mine", run, np.arange(60), run=run)
    with echofuse.open(derive.copy(run.path, tmp_path / "other.sqlite")) as other:
        with pytest.raises(FileExistsError, match="contains maps of another run"):
            save(folder, other, np.arange(60), run=other)
        assert "contains maps of another run" in judged(folder, other, ok=False)
    assert judged(folder, run, "--json")["metrics"]["iou"]["mean"] == 1
