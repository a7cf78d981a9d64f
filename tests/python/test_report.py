# SPDX-License-Identifier: MIT
"""Tests the page of echofuse-report: the numbers equal those of `evaluate --json`, the failures come first, only
measured values appear, and the page of the run contains the data of its records."""
import base64
import csv
import json
import os
import shutil
import signal
import subprocess
import time
import xml.etree.ElementTree
import zlib

import numpy as np
import pytest

import echofuse
from echofuse.bench import derive
from echofuse.report import blocks
from echofuse.report import scores
from echofuse.report import tables
from echofuse.report.scores import Count, Evaluation, Means, Mean, ReportModel, Scores, sensors_of
from fixtures import BIN, change, changed, json_of, model, outcome, program, scenes



def report(*words):
    """Runs echofuse-report. Returns its exit code and its output, including error messages."""
    done = outcome("echofuse-report", *words)
    return done.returncode, done.stdout + done.stderr


def page_of(folder):
    """Returns the tables and sentences above the page of the run: {"verdict", "fails", "tables": by caption, "of": text
    of each section}. A table contains its rows as lists of cells; a cell is the list of its texts."""
    text = (folder / "report.html").read_text()
    root = xml.etree.ElementTree.fromstring(text[text.index('<section id="report">'):text.index("</section>") + 10])

    def rows_of(table):
        return [[[part for part in cell.itertext() if part] for cell in row] for row in table.iter("tr")]

    return {"verdict": root.findtext("p[@class='verdict']"), "fails": [item.text for item in root.iterfind("ul/li")],
            "tables": {table.findtext("caption", ""): rows_of(table) for table in root.iter("table")},
            "of": {part.findtext("summary"): "\n".join(part.itertext()) for part in root.iter("details")}}


def table_of(page, caption):
    """Returns the rows of the first table with a caption that begins with this text, without the head."""
    return next(rows for name, rows in page["tables"].items() if name.startswith(caption))[1:]


def messages_of(page):
    """Returns the messages of a saved page. The arrays are in message["arrays"]."""
    lines = page.read_text().split('id="messages">')[1].split("</script>")[0].split()
    out = []
    for data in (zlib.decompress(base64.b64decode(line)) for line in lines):
        length = int.from_bytes(data[:4], "little")
        message, start = json.loads(data[4:4 + length]), (4 + length + 7) // 8 * 8
        for name, array in message["arrays"].items():
            kind = {"u16": "<u2", "u32": "<u4", "f32": "<f4", "f64": "<f8"}[array["type"]]
            message["arrays"][name] = np.frombuffer(data, kind, int(np.prod(array["shape"])), start + array["offset"]).reshape(array["shape"])
        out.append(message)
    return out


def evaluated(*words):
    return json_of("echofuse-recon", "-q", "evaluate", *words)


def test_all_programs_widen_the_intervals_of_a_run_that_differs_by_the_same_factor(tmp_path):
    trained, run = model("mean-shape", scenes(300)), scenes(80, 5, "--set", "radar_bias_m=0.1")
    factor = evaluated(trained, run)["domain_shift"]["interval_factor"]
    assert factor > 1.5
    program("echofuse-recon", "reconstruct", "-q", trained, run, "--out", tmp_path / "maps")
    with open(tmp_path / "maps/records.csv", newline="") as table:
        intervals = {int(row["record"]): float(row["lateral_interval_90_m"] or "nan") for row in csv.DictReader(table)}
    program("echofuse-view", "--save", tmp_path / "page.html", run, "--model", trained)
    shown = {message["index"]: message["reconstruction"]["lateral_interval_90_m"] for message in messages_of(tmp_path / "page.html")
             if message["kind"] == "record"}
    stated = {index: value for index, value in shown.items() if value is not None}
    assert len(stated) > 10
    assert all(intervals[index] == pytest.approx(value, abs=0.0006) for index, value in stated.items())


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """Creates a training run, a test run, and models that use both sensors, one sensor or no sensor. One model is trained with
    two seeds."""
    made, run = tmp_path_factory.mktemp("report"), scenes(160)
    shutil.copy(run, made / "run.sqlite")
    shutil.copy(scenes(60, 8), made / "fresh.sqlite")
    for name, kind, *words in (("fused", "ridge"), ("spd", "ridge", "--inputs", "spd"), ("radar", "ridge", "--inputs", "radar"), ("body", "mean-shape"),
                               ("mean", "mean"), ("again", "ridge", "--seed", 2), ("paper", "paper", "--inputs", "spd", "--epochs", 2)):
        shutil.copy(model(kind, run, "--set", "fallback=false", *words), made / name)
    changed(made / "fresh.sqlite", made / "frozen.sqlite", "frozen camera in the records from ?1 to ?2", 0, 59)
    return made


def test_report_numbers_equal_those_of_evaluate(here, tmp_path):
    words = ["--model", f"ours={here / 'body'}", "--model", here / "spd"]
    code, said = report(tmp_path, "--run", here / "fresh.sqlite", *words, "--live", here / "fresh.sqlite")
    assert code == 0, said
    page, told = page_of(tmp_path), evaluated(here / "body", here / "spd", here / "fresh.sqlite")
    alone = evaluated(here / "body", here / "fresh.sqlite")
    assert told["rows"][0]["metrics"] == alone["metrics"] and told["trivial"] == alone["trivial"]
    names = {word.title: metric for metric, word in tables.METRICS.items()}
    for row in table_of(page, "The best value, and values that do not"):
        metric = names[row[0][0]]
        for cell, one in zip(row[1:], [told["rows"][0]["metrics"], told["rows"][1]["metrics"], *told["trivial"].values()]):
            mean, n = one[metric]["mean"], one[metric]["maps"]
            expected = f"{mean * n:.0f} of {n}" if mean is not None and metric == "left_right" else mean is not None and tables.METRICS[metric].text(mean)
            assert cell[0] in (expected, "0", "no body found", "not defined") and (cell[0][0] == "n") == (mean is None)
            assert cell[0] != "0" or abs(mean) < 1e-14
    first = table_of(page, "60 records; mean")[0]
    assert [cell[0] for cell in first[1:]] == [tables.METRICS[m].text(alone["metrics"][m]["mean"]) for m in tables.FIRST]
    assert first[1][1] == f"±{alone['metrics']['iou']['se']:.2f}"
    stated = table_of(page, "Stated uncertainty")[0]
    assert stated[1] == [f"{100 * alone['calibration']['lateral_interval_90_m']:.1f}"]
    count, of = map(int, stated[2][0].split(" of "))
    assert count / of == pytest.approx(alone["calibration"]["within_lateral_interval_90"])
    assert table_of(page, "Single maps on one thread")[1][3] == [blocks.three_digits(told["rows"][1]["cost"]["multiply_adds"])]


def test_report_page_contains_the_data_and_maps_of_its_records(here, tmp_path):
    assert report(tmp_path, "--run", here / "fresh.sqlite", "--model", here / "body")[0] == 0
    saved, *messages = messages_of(tmp_path / "report.html")
    made = echofuse.load_model(here / "body").predict(here / "fresh.sqlite")
    records = [message for message in messages if message["kind"] == "record"]
    failures = [row for row in table_of(page_of(tmp_path), "body (mean-shape") if row[3] != [blocks.NONE]]
    linked = {int(k) for row in failures for k in row[3] if k.isdigit()}
    for row in failures:
        count, found = int(row[1][0].split(" of ")[0]), [part for part in row[3] if part.isdigit()]
        assert len(found) == min(count, 8) and (", ..." in row[3]) == (count > 8)
    assert saved["kind"] == "saved" and saved["of"] == 60 and saved["records"] == [record["index"] for record in records]
    assert linked and linked <= set(saved["records"]) and {0, 59} <= set(saved["records"]) and len(records) <= 40
    with echofuse.open(here / "fresh.sqlite") as run:
        for record in records:
            at, arrays = int(np.flatnonzero(run.index == record["index"])[0]), record["arrays"]
            drawn, depth = arrays["reconstruction"], np.nan_to_num(made.depth_m[at])
            assert np.abs(np.where(drawn > 0, drawn - depth, 0)).max() < 1e-3 and (drawn > 0).sum() == (depth > 1.7).sum()
            assert np.allclose(arrays["map"], np.nan_to_num(run.maps([at])[0]), atol=1e-3)
            assert np.array_equal(arrays["spd"], run.spd[at])


def test_report_is_a_single_page_without_external_resources(here, tmp_path):
    code, said = report(tmp_path, "--run", here / "run.sqlite", *(word for name in ("fused", "spd", "radar") for word in ("--model", here / name)),
                        "--live", here / "fresh.sqlite")
    assert code == 0 and said.endswith("report.html\n"), said
    for name in "report.html", "live.html":
        text = (tmp_path / name).read_text()
        assert not [outside for outside in ('src="', 'href="http', "url(", "@import") if outside in text] and len(text) < 3e6
    page = page_of(tmp_path)
    assert list(page["of"]) == ["Failures", "By label", "All metrics", "Cost", "Recorded run", "Remarks", "Provenance", "Terms"]
    assert "Do not use SSIM alone" in page["of"]["All metrics"]
    assert f"command\nechofuse-report {tmp_path}" in page["of"]["Provenance"].replace("commandechofuse", "command\nechofuse")
    # The values published by Lai et al. appear only if the report contains one of their networks.
    assert not [value for value in ("0.6576", "0.6389", "0.5266") if value in str(page)]
    shown, = (message for message in messages_of(tmp_path / "live.html") if message["kind"] == "run")
    assert shown["file"] == "fresh.sqlite" and shown["facts"][0] == ["started", echofuse.open(here / "fresh.sqlite").info["started_utc"]]


def test_report_groups_models_by_their_inputs(here, tmp_path):
    code, said = report(tmp_path, "--run", here / "fresh.sqlite", "--model", f"ours={here / 'fused'}", here / "spd", f"small={here / 'body'}",
                        here / "mean", f"ours={here / 'again'}", here / "paper")
    assert code == 0, said
    page = page_of(tmp_path)
    assert [row[0][0] for row in table_of(page, "60 records; mean")][:5] == [
        "ours (ridge, SPD + radar profile; 2 trainings)", "small (mean-shape, SPD + radar profile)", "spd (ridge, SPD alone)",
        "paper (the paper's network, SPD alone)", "mean (no sensor)"]
    assert "Worse than" not in page["verdict"] and len(page["verdict"]) < 300
    against = table_of(page, "Differences from ours")
    assert len(against) == 4 and against[0][1][0][0] in "+-"
    assert table_of(page, "Networks of the paper")[0][2] == ["0.6389"]  # Lai et al. published this SSIM for their SPD network.
    code, said = report(tmp_path / "no", "--run", here / "run.sqlite", "--model", f"a={here / 'spd'}", f"a={here / 'radar'}")
    assert code == 1 and f"inputs radar alone, but {here / 'spd'} with the same name has the inputs SPD alone; give --model NAME=" in said


def test_report_scores_all_models_on_records_that_have_every_sensor(here, tmp_path):
    derive.copy(here / "fresh.sqlite", tmp_path / "some.sqlite", lambda records: records.lost["radar"].__setitem__(slice(None, None, 4), True))
    dark = derive.copy(here / "fresh.sqlite", tmp_path / "dark.sqlite", derive.lost("radar"), lambda r: r.keep.__setitem__(slice(5, None), False))
    program("echofuse-recon", "train", "-q", here / "run.sqlite", "--model", "ridge", "--out", tmp_path / "both")
    code, said = report(tmp_path, "--run", tmp_path / "some.sqlite", "--model", tmp_path / "both", here / "spd", here / "radar", "--live", dark)
    assert code == 0, said
    assert "on 45 simulated records of a new run" in said and "Recorded run: 5 records: radar lost: SPD alone." in said
    assert "15 records with a depth map left out" in said
    assert page_of(tmp_path)["fails"][0].startswith("Recorded run: ")
    code, said = report(tmp_path / "spd", "--run", dark, "--model", here / "spd")
    assert code == 0 and "spd (ridge, SPD alone), on 5 " in said


def test_report_describes_a_run_without_a_model_or_compares_two_models(here, tmp_path):
    code, said = report(tmp_path / "alone", "--live", here / "fresh.sqlite")
    assert code == 0 and "60 records, all with all three sensors" in said
    assert list(page_of(tmp_path / "alone")["of"]) == ["Provenance"]
    assert [m["arrays"]["used_spd"].size for m in messages_of(tmp_path / "alone/report.html") if m["kind"] == "strip"] == [60]

    def compare(first, second):
        return report(tmp_path / (first + second), "--run", here / "fresh.sqlite", "--compare", here / first, here / second)

    code, said = compare("mean", "body")
    assert code == 0 and "the second model is better" in said, said
    page, paired = page_of(tmp_path / "meanbody"), evaluated(here / "mean", here / "body", here / "fresh.sqlite")["paired"][0]["metrics"]
    rows = {row[0][0]: row for row in table_of(page, "Paired by record")}
    assert [cell[0] for cell in rows["IoU"][1:6]] == [
        "60", *(f"{paired['iou'][key]:.3f}" for key in ("first", "second")),
        f"{paired['iou']['mean']:+.3f}", f"{paired['iou']['low']:+.3f} to {paired['iou']['high']:+.3f}"]
    # A plus sign means that the second model is better, even for an error metric.
    assert rows["IoU"][6] == ["second"] and rows["RMSE (m)"][4][0][0] == "+"
    code, said = compare("body", "body")
    assert code == 0 and "do not differ significantly" in said and "difference +0.000 (95 %: +0.000 to +0.000)" in said


def test_report_shows_the_records_without_data_from_a_sensor(here, tmp_path):
    lost = derive.copy(here / "fresh.sqlite", tmp_path / "lost.sqlite", lambda records: records.lost["radar"].__setitem__(slice(40, None), True))
    change(lost, "verdict ?1 of the radar in records without radar data", "no frames")
    code, said = report(tmp_path, "--live", lost)
    assert code == 0 and "40 with all three sensors; 20 of 60 doubtful: radar no frames 20." in said
    state = next(message for message in messages_of(tmp_path / "report.html") if message["kind"] == "state")
    worst = state["sensors"]["radar"]["worst"]
    assert (worst["word"], worst["records"], worst["index"], worst["valid"]) == ("no frames", 20, 59, False)
    assert state["sensors"]["spd"]["worst"] is None and state["last_doubt"]["index"] == 59 and state["doubtful"] == 20


def test_report_contains_every_line_of_the_evaluate_command(here, tmp_path):
    odd = changed(here / "fresh.sqlite", tmp_path / "odd.sqlite", "frozen camera in the records from ?1 to ?2", 0, 24)
    change(odd, "same depth image in the records from ?1 to ?2", 0, 24)
    change(odd, "radar is not valid in record ?1", 40)
    change(odd, "record ?1 has the histogram of record ?2", 50, 51)
    told = evaluated(here / "body", tmp_path / "odd.sqlite")
    for part in ("camera stands still 25; including them: IoU", "twice in the run 1", "1 records with a depth map left out: missing sensor 1"):
        assert any(part in line for line in told["notes"].splitlines()), told["notes"]
    code, said = report(tmp_path, "--run", tmp_path / "odd.sqlite", "--model", here / "body")
    assert code == 0, said
    page = "\n".join([*page_of(tmp_path)["fails"], *page_of(tmp_path)["of"].values()])
    assert [line for line in scores.lines_of(told) if line not in said or line not in page] == []
    assert scores.lines_of({"new": {"text": "a\nb"}, "model": "c", "rows": [{"more": "b"}, {"count": 1}]}) == ["a", "b"]


def test_report_states_why_a_record_cannot_be_read(here, tmp_path):
    changed(here / "fresh.sqlite", tmp_path / "bad.sqlite", "histogram of one byte in record ?1", 59)
    code, said = report(tmp_path / "page", "--live", tmp_path / "bad.sqlite")
    assert code == 0, said
    reasons = [message["text"] for message in messages_of(tmp_path / "page/report.html") if message["kind"] == "trouble"]
    assert len(reasons) == 1 and "spd has 1 bytes" in reasons[0]


def test_report_on_a_full_disk_or_after_sigterm_leaves_no_files(here, tmp_path):
    (tmp_path / "scratch").mkdir()
    words, env = [BIN / "echofuse-report", tmp_path / "page", "--live", here / "fresh.sqlite"], os.environ | {"TMPDIR": str(tmp_path / "scratch")}
    full = subprocess.run(["sh", "-c", "ulimit -f 40; exec \"$@\"", "sh", *words], capture_output=True, text=True, env=env)
    page = tmp_path / "page/report.html"
    assert full.returncode == 6 and full.stderr.endswith("cannot be written: File too large\n"), full.stderr
    assert not page.parent.exists() and os.listdir(tmp_path / "scratch") == []
    page.parent.mkdir()
    (tmp_path / "precious").write_text("precious")
    page.with_name("report.html.part").symlink_to(tmp_path / "precious")
    subprocess.run(words, check=True, env=env, stdout=subprocess.DEVNULL)
    assert (tmp_path / "precious").read_text() == "precious"
    process = subprocess.Popen([*words, "--run", here / "fresh.sqlite", "--model", here / "body"], env=env)
    while process.poll() is None and not list((tmp_path / "scratch").glob("echofuse-report-*")):
        time.sleep(0.001)
    time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    assert process.wait() == 130 and os.listdir(tmp_path / "scratch") == []


@pytest.mark.parametrize(("words", "code", "text"), [
    (["--run", "fresh.sqlite"], 2, "--run requires --model, --compare or --maps"),
    (["--model", "body"], 2, "--model requires --run or --live"),
    (["--live", "fresh.sqlite", "--compare", "body", "spd"], 2, "--compare requires --run"),
    (["--live", "fresh.sqlite", "--maps", "m"], 2, "--maps requires --run"),
    (["--run", "fresh.sqlite", "--maps", "m", "other/m"], 2, "the name m is already in use; give NAME=FOLDER"),
    ([], 2, "nothing to report: give --run with models, or --live"),
    (["--run", "fresh.sqlite", "--model", "body", "--compare", "body", "spd"], 2, "--compare cannot be combined with --model"),
    (["--live", "fresh.sqlite", "--empty", "run.sqlite"], 2, "--empty requires --run"),
    (["--lvie", "fresh.sqlite"], 2, "--lvie"),
    (["--run", "fresh.sqlite", "--model", "nomodel"], 1, "nomodel: No such file or directory; expected a model file"),
    (["--run", "fresh.sqlite", "--model", "run.sqlite"], 1, "run.sqlite: is a run; expected a model file"),
    (["--run", "fresh.sqlite", "--model", "mean", "--empty", "run.sqlite"], 1, "cannot be used in another room"),
    (["--run", "frozen.sqlite", "--model", "body"], 1, "60 of 60 records left out: camera stands still 60"),
])
def test_report_refuses_invalid_arguments_with_a_one_line_error(here, tmp_path, monkeypatch, words, code, text):
    monkeypatch.chdir(here)
    found, said = report(tmp_path / "page", *words)
    assert found == code and text in said and said.count("\n") == 1, said
    assert not (tmp_path / "page").exists()


def test_report_of_another_run_is_overwritten_only_with_force(here, tmp_path):
    assert [report(tmp_path, "--live", here / "fresh.sqlite")[0] for _ in range(2)] == [0, 0]
    code, said = report(tmp_path, "--live", here / "run.sqlite")
    assert code == 2 and f"{tmp_path}: contains a report of another run; give another folder, or --force to overwrite it" in said
    assert report(tmp_path, "--live", here / "run.sqlite", "--force")[0] == 0
    assert page_of(tmp_path)["verdict"].endswith("160 records, all with all three sensors.")


# The following tests check the sentences that the report generates from given scores.


def mode_of(name, kind, iou, rmse_m, **columns):
    """Returns a model with scores for 20 letter records. The scores vary slightly around the given values."""
    wobble = 0.001 * (np.arange(20) % 3)
    values = {"iou": iou + wobble, "rmse_m": rmse_m + wobble, "lateral_m": 0.03 + wobble, "depth_mae_m": 0.1 + wobble,
              "lateral_interval_90_m": np.full(20, 0.1)} | columns
    told = {"model": kind, "records": 20, "left_out": 0, "notes": "", "fallbacks": {}, "antennas": "", "response": "", "ranges": "", "calibrated": False, "metrics": {
        metric: dict(zip(("mean", "se", "maps"), Mean.of(column))) for metric, column in values.items()}}
    facts = {"0/model": kind, "0/inputs": "spd", "0/calibrated": 0}
    scores = Scores(told, np.arange(20), ["letter:A"] * 20, [""] * 20, values)
    return ReportModel(name, [name], [facts], {}, "SPD alone", [scores])


def judged_of(**baselines):
    trivial = {name: {"iou": {"mean": iou, "se": 0.0, "maps": 20}} for name, iou in baselines.items()}
    return Evaluation([], {"trivial": trivial}, "")


def test_report_summary_names_the_competing_model_and_metrics_in_which_it_is_better():
    ours, theirs = mode_of("ours", "factorised", 0.6, 0.46), mode_of("theirs", "pca", 0.5, 0.42)
    theirs.differences = {"rmse_m": {"records": 20, "first": 0.46, "second": 0.42, "mean": 0.04, "low": 0.03, "high": 0.05},
                          "iou": {"records": 20, "first": 0.6, "second": 0.5, "mean": -0.1, "low": -0.1, "high": -0.1}}
    said = tables.models_verdict([ours, theirs], judged_of(empty=0), "simulated", True)
    assert "20 simulated records of a new run: IoU 0.60 ± 0.00 (theirs with the same inputs: 0.50" in said
    assert "baselines: empty room 0.00 ± 0.00), lateral error 3.1 ± 0.0 cm" in said and "best" not in said
    assert said.endswith("Worse than theirs (pca, SPD alone) in RMSE (0.46 against 0.42 m).")
    theirs.sensors = "SPD + 8 antennas"
    said = tables.models_verdict([ours, theirs], judged_of(empty=0, nearest=0.3), "recorded", False)
    assert "same inputs" not in said and "nearest training record 0.30" in said and "20 recorded records held out in the training" in said


def test_report_lists_domain_shift_and_missed_intervals_as_problems():
    fused = mode_of("fused", "factorised", 0.6, 0.46).first
    assert tables.problems_of_run(fused) == []
    fused = mode_of("fused", "factorised", 0.6, 0.46, lateral_interval_90_m=np.full(20, 0.01)).first
    fused.result["domain_shift"] = {"found": True, "text": "this run differs from the training data: range +30.0 +- 2.0 cm", "p": 1e-4}
    fused.result["notes"] = "3 records: radar lost: SPD alone\n"
    assert tables.problems_of_run(fused, "Recorded run: ") == [
        "Recorded run: this run differs from the training data: range +30.0 +- 2.0 cm.",
        "Recorded run: 20 of 20 bodies are outside their stated 90 % interval (expected: 2); the worst is record 2 with a "
        "lateral error of 3 cm and a stated interval of ±1 cm.",
        "Recorded run: 3 records: radar lost: SPD alone."]
    one = mode_of("fused", "factorised", 0.6, 0.46, lateral_interval_90_m=np.where(np.arange(20) == 7, 0.02, 0.1)).first
    assert tables.problems_of_run(one) == [] and one.outside.startswith(
        "1 of 20 bodies are outside their stated 90 % interval (expected: 2); the worst is record 7")


def test_report_tables_mark_the_best_score_of_each_metric():
    side = (np.arange(20) > 0) * 1.0
    models = [mode_of("a", "factorised", 0.6, 0.46, ghost=np.zeros(20), left_right=side), mode_of("b", "pca", 0.5, 0.42, ghost=np.full(20, -0.1), left_right=side)]
    rows = tables.rows_of(models, {"trivial": {}})
    ghost = [tables.value(row, "ghost", best) for row, best in zip(rows, tables.best_of(rows, "ghost"))]
    assert tables.METRICS["ghost"].head["small"] == "0 is best"
    assert ghost[0] == {"text": "0", "mark": "best"} and ghost[1]["text"] == "-0.10"
    assert [tables.value(row, "left_right", best) for row, best in zip(rows, tables.best_of(rows, "left_right"))] == 2 * [{"text": "19 of 20", "mark": "best"}]
    assert tables.best_of(rows, "iou") == [True, False]
    # A lower error of few maps is not marked as the best.
    few = np.where(np.arange(20) < 9, 0.01, np.nan)
    rows = tables.rows_of([models[0], mode_of("c", "pca", 0.1, 0.9, lateral_m=few)], {"trivial": {}})
    assert tables.best_of(rows, "lateral_m") == [True, False]
    # Limits of the Wilson score interval.
    assert Count(0, 10).interval[0] == 0 and Count(5, 10).interval[0] == pytest.approx(0.2366, rel=1e-3)
    assert np.isnan(Means()["iou"].mean)


def test_report_escapes_html_and_formats_numbers():
    assert [blocks.three_digits(v) for v in (0, 8, 45971, 1366528, 9999.6)] == ["0", "8", "46 k", "1.37 M", "10 k"]
    text = "</script>\u202e\n<b>"
    assert blocks.html_of([blocks.paragraph(text)]) == "<p>&lt;/script&gt;\\u202e\\n&lt;b&gt;</p>\n"
    cells = blocks.table(text, [text], [[blocks.cell(text, text)], [{"text": "", "records": [3, 7], "more": True}]])
    html = blocks.html_of([cells, blocks.details(text, *blocks.fails([text]), *blocks.listed([(text, text)]))])
    assert "<b>" not in html and "</script" not in html and '<a href="#3">3</a>, <a href="#7">7</a>, ...' in html


def test_report_lists_the_sensor_inputs_of_each_model():
    facts = {"0/model": "factorised", "0/inputs": "fused", "0/takes_antennas": 1, "0/axes/array/scale": 7.0, "0/axes/array/quantity": "lags"}
    assert sensors_of(facts) == "SPD + 8 antennas" and sensors_of(facts | {"0/takes_antennas": 0}) == "SPD + radar profile"
    assert sensors_of(facts | {"0/axes/array/quantity": "lags 1 2 5"}) == "SPD + antennas"
    assert sensors_of(facts | {"0/inputs": "radar"}) == "radar alone" and sensors_of({"0/model": "mean"}) == "no sensor"


def test_report_compares_maps_of_other_programs_with_the_first_model(here, tmp_path):
    run = echofuse.open(here / "fresh.sqlite")
    echofuse.save_maps(tmp_path / "truth", run.maps(), run.index, run=run)
    echofuse.save_maps(tmp_path / "few", run.maps([0, 1, 2]), run.index[:3], run=run)
    words = ["--run", here / "fresh.sqlite", "--maps", f"theirs={tmp_path / 'truth'}", tmp_path / "few"]
    code, said = report(tmp_path / "page", *words, "--model", here / "body")
    assert code == 0, said
    page, told = page_of(tmp_path / "page"), evaluated("--maps", tmp_path / "truth", "--maps", tmp_path / "few", here / "body", run.path)
    rows, gains = table_of(page, "60 records; mean ± standard error over maps; a missing"), table_of(page, "Differences from theirs")
    assert [row[0][0] for row in rows][:3] == ["theirs", "few (57 maps missing)", "body (mean-shape, SPD + radar profile)"]
    assert [row[1][0] for row in rows][:3] == [f"{row['metrics']['iou']['mean']:.2f}" for row in told["rows"]]
    # The number in brackets is the number of maps with a depth error.
    assert [row[3][-1].split("(")[-1] for row in rows][:2] == ["60)", "3)"]
    assert [row[1][0] for row in gains] == [f"{one['metrics']['iou']['mean']:+.3f}" for one in told["paired"]]
    code, said = report(tmp_path / "alone", *words)
    assert code == 0 and said.startswith("On 60 records: theirs: IoU 1.00"), said
    assert list(page_of(tmp_path / "alone")["of"]) == ["Maps of other programs", "Remarks", "Provenance"]


def test_report_of_a_recorded_run_lists_the_failures_and_scores_of_a_model(here, tmp_path):
    code, said = report(tmp_path, "--live", here / "fresh.sqlite", "--model", here / "body")
    assert code == 0, said
    page = page_of(tmp_path)
    assert {"Failures", "All metrics"} <= set(page["of"]) and not (tmp_path / "live.html").exists()
    # The string in brackets identifies the commit.
    assert "echofuse-recon" in page["of"]["Provenance"] and "(" in page["of"]["Provenance"]


def test_report_uses_training_runs_for_baselines_and_refuses_to_score_one(here, tmp_path):
    words = ["--model", here / "body", "--train", here / "run.sqlite"]
    code, said = report(tmp_path, "--run", here / "fresh.sqlite", *words)
    assert code == 0 and "nearest training record" in page_of(tmp_path)["verdict"], said
    refusals = [report(tmp_path / "no", "--run", here / "run.sqlite", *words)]
    for command in (["echofuse-recon", "evaluate", here / "body", here / "run.sqlite", "--train", here / "run.sqlite"],
                    ["echofuse-bench", "pareto", here / "run.sqlite", here / "run.sqlite", "--out", tmp_path / "table"]):
        done = outcome(*command)
        refusals.append((done.returncode, done.stderr))
    assert [(code > 0, f"{here / 'run.sqlite'}: is a training run; score another run" in said) for code, said in refusals] == [(True, True)] * 3, refusals

