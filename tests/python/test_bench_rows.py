# SPDX-License-Identifier: MIT
"""Tests when echofuse-bench measures a table row again, and how it calls a user's method."""
import csv
import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import pytest

import echofuse
from echofuse import bench
from echofuse.bench import stability
from fixtures import BIN, executable, program, scenes


METHOD = """
import numpy as np
class Mine:
    def fit(self, run, rows):
        self.map = run.maps()[rows[{row}]]
    def predict(self, run):
        return np.repeat(self.map[None], len(run), 0)
class Failing(Mine):
    def predict(self, run):
        return self.weights
class Unmade(Mine):
    def __init__(self, seed):
        self.weights = len(seed)
class Copying(Mine):
    def predict(self, run):
        assert not run.valid["depth"].any() and len(run.labels) == len(run)
        return run.maps()
"""
# External program that predicts the map of the training record with the most similar histogram.
PROGRAM = f"""#!{sys.executable}
import sys
import numpy as np
import echofuse
train, test = map(echofuse.open, sys.argv[1:3])
nearest = [np.argmin(((train.spd.astype(float) - row) ** 2).sum(1)) for row in test.spd]
echofuse.save_maps(sys.argv[3], train.maps(nearest), test.index, run=test)
"""


@pytest.fixture
def runs():
    return scenes(40), scenes(20, 2)


def pareto(folder, runs, *methods, out="b.csv", row=0, more=()):
    """Writes the user's methods to mine.py in `folder` and runs echofuse-bench pareto there. Returns the finished process and
    the table rows by method name."""
    (folder / "mine.py").write_text(METHOD.format(row=row))
    done = subprocess.run([sys.executable, BIN / "echofuse-bench", "pareto", *runs, "--methods", *methods, "--seeds", "1", "-q", "--out", out,
                           *more], cwd=folder, capture_output=True, text=True, check=False)
    table = bench.Table(folder / out) if (folder / out).exists() else None
    return done, {row["model"]: row for row in table.rows.values()} if table else {}


def test_bench_compares_the_examples_and_an_external_program_with_a_built_in_method(runs, tmp_path):
    methods, examples = ["nearest", "./other"], pathlib.Path(__file__).parents[2] / "recon/python/examples"
    for module, package, name in (("torch_network", "torch", "Network"), ("forest", "sklearn", "Forest")):
        if importlib.util.find_spec(package):  # The method is omitted if its package is not installed.
            shutil.copy(examples / f"{module}.py", tmp_path)
            methods.append(f"{module}:{name}")
    executable(tmp_path / "other", PROGRAM)
    done, rows = pareto(tmp_path, runs, *methods)
    assert done.returncode == 0 and rows.keys() == set(methods), done.stderr
    assert {(row["answered"], row["records"], row["threads"]) for row in rows.values()} == {("20", "20", "1")}
    assert float(rows["nearest"]["multiply_adds"]) > 0


def lines(folder):
    return len((folder / "b.csv").read_text().splitlines())


@pytest.mark.parametrize("edited", ["mine.py", "helper.py", "parts/late.py"])
def test_bench_measures_a_method_again_only_if_its_code_changed(runs, tmp_path, edited):
    (tmp_path / "parts").mkdir()
    (tmp_path / "venv/site-packages").mkdir(parents=True)
    code = {"mine.py": METHOD.format(row=0).replace("import numpy", "import helper\nimport numpy").replace("fit(self, run, rows):", "fit(self, run, rows):\n        import parts.late"),
            "helper.py": "import sys\nsys.path.append('venv/site-packages')\nimport installed\n", "parts/late.py": "", "other.py": "", "venv/site-packages/installed.py": ""}
    for name, text in code.items():
        (tmp_path / name).write_text(text)
    words = [sys.executable, BIN / "echofuse-bench", "pareto", *runs, "--methods", "mine:Mine", "mean", "--seeds", "1", "-q", "--out", "b.csv"]
    bench_here = lambda: subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stderr  # noqa: E731
    assert "reused" not in bench_here() and "reused rows: 2\n" in bench_here()
    for name in "other.py", "venv/site-packages/installed.py":
        (tmp_path / name).write_text("# changed\n")
    assert "reused rows: 2\n" in bench_here() and lines(tmp_path) == 4
    (tmp_path / edited).write_text(code[edited] + "# changed\n")
    assert "reused rows: 1\n" in bench_here() and lines(tmp_path) == 5
    assert "reused rows: 2\n" in bench_here()


@pytest.mark.parametrize("edited", ["mine", "source/maps.sh"])
def test_bench_measures_an_edited_command_again(runs, tmp_path, edited):
    folder = tmp_path / "own"
    executable(folder / "mine", f"#!/bin/sh\ndate +%N > {folder}/output\nexec sh {folder}/source/maps.sh $3\n")
    executable(folder / "source/maps.sh", f"cp -r {tmp_path}/maps $1\n")
    run = echofuse.open(runs[1])
    echofuse.save_maps(tmp_path / "maps", run.maps(), run.index)
    for rows, extra in (3, ""), (3, ""), (4, "# changed\n"):
        (folder / edited).write_text((folder / edited).read_text() + extra)
        done, rows_of = pareto(tmp_path, runs, "own/mine")
        assert done.returncode == 0 and rows_of["own/mine"]["iou"] == "1" and lines(tmp_path) == rows


def test_bench_table_accepts_regenerated_data_and_refuses_different_data(runs, tmp_path):
    again = tmp_path / "again.sqlite"
    program("echofuse-sim", "dataset", "-q", "--out", again, "--records", 20, "--seed", 2)
    assert echofuse.open(again).info["uuid"] != echofuse.open(runs[1]).info["uuid"]
    pareto(tmp_path, runs, "mean")
    done, _ = pareto(tmp_path, (runs[0], again), "mean")
    assert done.returncode == 0 and lines(tmp_path) == 3
    done, _ = pareto(tmp_path, (again, runs[0]), "mean")
    assert done.returncode == 2 and "choose another --out" in done.stderr


@pytest.mark.parametrize(("name", "said"), [("Failing", "AttributeError: 'Failing' object has no attribute 'weights'"),
                                            ("Unmade", "TypeError: object of type 'int' has no len()")])
def test_failed_method_causes_a_nan_row_and_a_logged_traceback_and_exit_code_1(runs, tmp_path, name, said):
    done, rows = pareto(tmp_path, runs, f"mine:{name}", "mean", more=["--markdown"])
    assert done.returncode == 1 and "the tracebacks are in b.log" in done.stderr and "| `mean` |" in done.stdout
    assert rows[f"mine:{name}"]["iou"] == "nan" and float(rows["mean"]["iou"]) >= 0
    log = (tmp_path / "b.log").read_text()
    assert said in log and "mine.py\", line" in log
    done, _ = pareto(tmp_path, runs, f"mine:{name}", "mean")
    assert done.returncode == 1 and lines(tmp_path) == 4


def test_predict_method_has_no_access_to_the_true_maps(runs, tmp_path):
    done, rows = pareto(tmp_path, runs, "mine:Copying")
    assert done.returncode == 0, done.stderr
    assert float(rows["mine:Copying"]["iou"]) == 0


@pytest.mark.parametrize(("method", "more", "said"), [("lacking:Mine", [], "lacking:Mine: No module named 'no_such_package'"),
                                                    ("empty", ["--figure", "b.svg"], "install python3-matplotlib")])
def test_bench_reports_a_missing_package_before_the_first_measurement(runs, tmp_path, monkeypatch, method, more, said):
    (tmp_path / "lacking.py").write_text("import no_such_package\nclass Mine: pass\n")
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['matplotlib'] = None\n")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    done, rows = pareto(tmp_path, runs, "mean", method, more=more)
    assert done.returncode == 2 and said in done.stderr and not rows


def test_second_bench_process_does_not_duplicate_rows(runs, tmp_path):
    table = bench.Table(tmp_path / "b.csv")
    with table.exclusive():
        done, rows = pareto(tmp_path, runs, "mean")
        assert done.returncode == 1 and "table is in use by another process" in done.stderr and not rows
    late = bench.Table(tmp_path / "b.csv")
    cells = bench.pareto_cells(*runs, [bench.method("mean")], seeds=1)
    bench.fill(table, cells, quiet=True)
    before = lines(tmp_path)
    bench.fill(late, cells, quiet=True)
    assert lines(tmp_path) == before and not list(tmp_path.glob(".*.lock"))


def test_stability_study_always_includes_the_baseline_methods(tmp_path, monkeypatch):
    cells = []
    monkeypatch.setattr(stability.tables, "fill", lambda table, some, **_: cells.extend(some))
    monkeypatch.setattr("sys.argv", ["echofuse-bench", "stability", "--axes", "shifted-snr", "--quick", "--methods", "mlp-4", "--out",
                                     str(tmp_path / "b.csv")])
    bench.main()
    assert list(dict.fromkeys(cell.method.model for cell in cells)) == ["empty", "mean", "nearest", "mlp-4"]


@pytest.mark.parametrize("front", [[BIN / "echofuse-bench"], ["-m", "echofuse.bench"], ["echofuse-bench"]])
def test_bench_runs_numerical_libraries_with_one_thread(runs, tmp_path, monkeypatch, front):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    executable(tmp_path / "mine", f"#!/bin/sh\necho $OMP_NUM_THREADS $OPENBLAS_NUM_THREADS $MKL_NUM_THREADS > {tmp_path}/threads\nexit 1\n")
    (tmp_path / "echofuse-bench").write_text("from echofuse.bench import main\nmain()\n")  # as in a wheel
    subprocess.run([sys.executable, *front, "pareto", *runs, "--methods", "./mine", "-q", "--out", "b.csv"], cwd=tmp_path, check=False)
    assert (tmp_path / "threads").read_text() == "1 1 1\n"


def test_pareto_chart_shows_mean_cost_and_lists_methods_without_cost(tmp_path):
    plot = pytest.importorskip("echofuse.plot")
    table = bench.Table(tmp_path / "b.csv")
    for model, seed, cost in (("mlp-4", 1, 10.0), ("mlp-4", 2, 30.0), ("mine:Net", 1, float("nan"))):
        table.add({"axis": "model", "value": "1", "model": model, "inputs": "-", "seed": seed, "source": "-", "iou": 0.5,
                   "lateral_m": 0.1, "infer_us_median": 5.0, "multiply_adds": cost})
    table.add({"axis": "model", "value": "1", "model": "./other", "inputs": "-", "seed": 1, "source": "-", "iou": 0.5, "lateral_m": 0.1})
    times, panel = plot.pareto(table.path).axes[:2]
    assert times.get_title(loc="left") == "time not measured: ./other"
    assert [line.get_xdata()[0] for line in panel.lines if len(line.get_xdata()) == 1][0] == 20
    assert "not counted: mine:Net, ./other" in [text.get_text() for text in panel.texts]


def test_bench_row_contains_the_number_of_records_with_a_map(runs, tmp_path, capsys):
    run = echofuse.open(runs[1])
    echofuse.save_maps(tmp_path / "few", run.maps([0, 1]), run.index[:2])
    command = executable(tmp_path / "mine", f"#!/bin/sh\ncp -r {tmp_path}/few $3\n")
    table = bench.Table(tmp_path / "b.csv")
    bench.fill(table, bench.pareto_cells(*runs, [bench.method(str(command)), bench.method("mean")], seeds=1), quiet=True)
    mine, mean = table.rows.values()
    assert (mine["answered"], mine["records"], mine["depth_maps"]) == (2, 20, 2) and mine["iou"] == pytest.approx(0.1)
    assert (mean["answered"], mean["records"]) == (20, 20)
    assert "2 of 20 records have a map; the other records are scored as empty maps" in capsys.readouterr().err
    row, = (line.split(" | ") for line in bench.markdown(bench.means(bench.Table(table.path))).splitlines() if str(command) in line)
    assert row[2:4] == ["2 of 20", "0.100"] and "0.0 cm (2)" in row


def test_bench_table_has_confidence_intervals_and_paired_differences_over_records(runs, tmp_path):
    done, _ = pareto(tmp_path, runs, "nearest", "mine:Mine", "empty", more=["--markdown"])
    assert done.returncode == 0, done.stderr
    shape = [line.count("|") for line in done.stdout.splitlines() if line.startswith("|")]
    assert set(shape) == {15}, shape
    head, _, *rows = ([cell.strip() for cell in line.split("|")] for line in done.stdout.splitlines() if line.startswith("|"))
    shown = {row[2].strip("`"): dict(zip(head, row)) for row in rows}
    assert b"\r" not in (tmp_path / "b.csv").read_bytes() + (tmp_path / "b.records.csv").read_bytes()
    with open(tmp_path / "b.records.csv", newline="") as file:
        lines = list(csv.DictReader(line for line in file if line[0] != "#"))
    iou = {name: np.array([float(line["iou"]) for line in lines if line["model"] == name]) for name in shown}
    best, other = sorted(("nearest", "mine:Mine"), key=lambda name: -iou[name].mean())
    for name in shown:
        low, high = map(float, shown[name]["95 % interval over the records"].split(" to "))
        assert len(iou[name]) == 20 and low <= iou[name].mean() <= high
    assert shown[best]["IoU difference from the best"] == ""
    assert float(shown[other]["IoU difference from the best"].split()[0]) == pytest.approx((iou[other] - iou[best]).mean(), abs=1e-3)


def test_bench_ignores_stale_and_incomplete_lines_of_the_score_file(runs, tmp_path):
    pareto(tmp_path, runs, "mine:Mine")
    with open(tmp_path / "b.records.csv", "a") as file:
        file.write("model,1,mine:Mine,-")
    done, rows = pareto(tmp_path, runs, "mine:Mine", row=5)
    table = bench.Table(tmp_path / "b.csv")
    row, = bench.means(table)
    assert row["compared"]["records"] == 20
    assert row["compared"]["metrics"]["iou"]["mean"] == pytest.approx(float(rows["mine:Mine"]["iou"]))


def test_bench_measures_the_time_per_map_for_single_records_and_batches(runs, tmp_path):
    method = """
import numpy as np, time
class Slow:
    def fit(self, run, rows):
        self.size = run.maps([0]).shape[1]
    def predict(self, run):
        assert len(run) > 1 or self.alone
        time.sleep(0.02)
        return np.full((len(run), self.size, self.size), 2.0)
    alone = True
class Several(Slow):
    alone = False
"""
    (tmp_path / "slow.py").write_text(method)
    done, rows = pareto(tmp_path, runs, "slow:Slow", "slow:Several", "ridge", more=["--markdown"])
    slow, several, ridge = (rows[name] for name in ("slow:Slow", "slow:Several", "ridge"))
    assert float(slow["infer_us_median"]) > 20_000 > 10 * float(slow["infer_us_batch"]) / 2 > 5_000
    assert several["infer_us_median"] == "nan" and float(several["iou"]) >= 0
    assert 0 < float(ridge["infer_us_batch"]) and float(ridge["infer_us_median"]) > 0
    assert {row["threads"] for row in rows.values()} == {"1"}
    assert "| time per single map | time per map in a batch | threads |" in done.stdout
