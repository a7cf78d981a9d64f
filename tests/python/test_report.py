# SPDX-License-Identifier: MIT
"""Tests the page of echofuse-report: the numbers equal those of `evaluate --json`, the failures come first, and only
measured values appear."""
import base64
import json
import os
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest

import echofuse
from echofuse.runs import batches as run_blocks
from echofuse.bench import derive
from echofuse.report import story as report_story
from echofuse.report import blocks
from echofuse.report import tables
from echofuse.report.scores import Count, Means, Mean, ReportModel, Scores, sensors_of
from fixtures import BIN, change, changed, program

BIN = BIN.resolve()
os.environ["ECHOFUSE_BIN"] = str(BIN)


def report(*words):
    """Runs echofuse-report. Returns its exit code and its output, including error messages."""
    done = subprocess.run([BIN / "echofuse-report", *map(str, words)], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def page_of(folder):
    text = (folder / "report.html").read_text()
    page = json.loads(text.split('id="data">')[1].split("</script>")[0])
    return page | {"of": {section["id"]: section["blocks"] for section in page["sections"]}}


def evaluated(*words):
    done = subprocess.run([BIN / "echofuse-recon", "-q", "evaluate", *map(str, words), "--json"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def of_kind(found, kind):
    return next(block for block in found if block["kind"] == kind)


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """Creates a training run, a test run, and models that use both sensors, one sensor or no sensor. One model is trained with
    two seeds."""
    made = tmp_path_factory.mktemp("report")
    for name, records, seed in (("run", 160, 1), ("fresh", 60, 8)):
        program("echofuse-sim", "dataset", "-q", "--out", made / f"{name}.sqlite", "--records", records, "--seed", seed)
    for name, *words in (("fused", "ridge"), ("spd", "ridge", "--inputs", "spd"), ("radar", "ridge", "--inputs", "radar"), ("body", "mean-shape"),
                         ("mean", "mean"), ("again", "ridge", "--seed", "2"), ("paper", "paper", "--inputs", "spd", "--epochs", "2")):
        program("echofuse-recon", "train", "-q", made / "run.sqlite", "--set", "fallback=false", "--out", made / name, "--model", *words)
    return made


def test_report_numbers_equal_those_of_evaluate(here, tmp_path):
    words = ["--model", f"ours={here / 'body'}", "--model", here / "spd"]
    code, said = report(tmp_path, "--run", here / "fresh.sqlite", *words, "--live", here / "fresh.sqlite")
    assert code == 0, said
    page, told = page_of(tmp_path), evaluated(here / "body", here / "spd", here / "fresh.sqlite")
    alone = evaluated(here / "body", here / "fresh.sqlite")
    assert told["rows"][0]["metrics"] == alone["metrics"] and told["trivial"] == alone["trivial"]
    metrics = page["of"]["metrics"][0]
    names = {word.title: metric for metric, word in tables.METRICS.items()}
    for row in metrics["rows"]:
        metric = names[row[0]["text"]]
        for cell, one in zip(row[1:], [told["rows"][0]["metrics"], told["rows"][1]["metrics"], *told["trivial"].values()]):
            mean, n = one[metric]["mean"], one[metric]["maps"]
            expected = "" if mean is None else f"{mean * n:.0f} of {n}" if metric == "left_right" else tables.METRICS[metric].text(mean)
            assert cell["text"] in (expected, "0")
            assert cell["text"] != "0" or abs(mean) < 1e-14
    first = page["first"][1]["rows"][0]
    assert [cell["text"] for cell in first[1:]] == [tables.METRICS[m].text(alone["metrics"][m]["mean"]) for m in tables.FIRST]
    assert first[1]["small"] == f"±{alone['metrics']['iou']['se']:.2f}"
    stated = next(one for one in page["of"]["failures"] if one.get("caption", "").startswith("Stated uncertainty"))["rows"][0]
    assert stated[1] == f"{100 * alone['calibration']['lateral_interval_90_m']:.1f}"
    share = alone["calibration"]["within_lateral_interval_90"]
    count, of = map(int, stated[2]["text"].split(" of "))
    assert count / of == pytest.approx(share)
    cost = page["of"]["cost"][0]["rows"][1]
    assert cost[3] == blocks.three_digits(told["rows"][1]["cost"]["multiply_adds"])


def test_report_shows_the_foreground_of_the_predicted_maps(here, tmp_path):
    assert report(tmp_path, "--run", here / "fresh.sqlite", "--model", here / "body")[0] == 0
    page, maps = page_of(tmp_path), echofuse.load_model(here / "body").predict(here / "fresh.sqlite")
    for record in page["records"]:
        index = int(record["title"].rpartition(" ")[2])
        drawn = np.frombuffer(base64.b64decode(record["maps"][0]["map"]), "<u2").reshape(64, 64) / 1000
        made = np.nan_to_num(maps.depth_m[maps.index == index][0])
        assert np.abs(np.where(drawn > 0, drawn - made, 0)).max() < 1e-3 and (drawn > 0).sum() == (made > 1.7).sum()
        with echofuse.open(here / "fresh.sqlite") as run:
            truth = np.nan_to_num(run.maps()[run.index == index][0])
            assert np.allclose(np.frombuffer(base64.b64decode(record["truth"]), "<u2").reshape(64, 64) / 1000, truth, atol=1e-3)
            assert record["spd"]["clicks"] == [blocks.short(v) for v in run.photons()[run.index == index][0]]


def test_report_is_a_single_page_without_external_resources(here, tmp_path):
    code, said = report(tmp_path, "--run", here / "run.sqlite", *(word for name in ("fused", "spd", "radar") for word in ("--model", here / name)),
                        "--live", here / "fresh.sqlite")
    assert code == 0 and said.endswith("report.html\n"), said
    text = (tmp_path / "report.html").read_text()
    assert not [outside for outside in ('src="', 'href="http', "url(", "@import", "fetch(") if outside in text]
    page = page_of(tmp_path)
    assert [section["id"] for section in page["sections"]] == [
        "failures", "gallery", "errors", "labels", "metrics", "cost", "records", "space", "live", "made", "terms"]
    # The records of the person and the letter have maps of all three models.
    # The live record and the worst, median and best records have one map each.
    assert [len(record["maps"]) for record in page["records"]][:6] == [3, 3, 1, 1, 1, 1]
    assert of_kind(page["of"]["metrics"], "note")["text"].startswith("Do not use SSIM alone")
    assert ["command", f"echofuse-report {tmp_path}"] == [page["of"]["made"][0]["rows"][3][0], page["of"]["made"][0]["rows"][3][1][:16 + len(str(tmp_path))]]
    # The values published by Lai et al. appear only if the report contains one of their networks.
    assert not [value for value in ("0.6576", "0.6389", "0.5266") if value in json.dumps(page)]
    assert len(of_kind(page["of"]["live"], "waterfalls")["tables"]) == 2
    assert of_kind(page["of"]["live"], "pictures")["show"] == ["truth", "spd", "radar", "map 0", "error 0"]


def test_report_groups_models_by_their_inputs(here, tmp_path):
    code, said = report(tmp_path, "--run", here / "fresh.sqlite", "--model", f"ours={here / 'fused'}", here / "spd", f"small={here / 'body'}",
                        here / "mean", f"ours={here / 'again'}", here / "paper")
    assert code == 0, said
    page = page_of(tmp_path)
    assert [row[0] for row in page["first"][1]["rows"]][:5] == [
        "ours (ridge, SPD + radar profile; 2 trainings)", "small (mean-shape, SPD + radar profile)", "spd (ridge, SPD alone)",
        "paper (the paper's network, SPD alone)", "mean (no sensor)"]
    assert page["of"]["metrics"][3]["rows"][0][2] == "0.6389"  # Lai et al. published this SSIM for their SPD network.
    code, said = report(tmp_path / "no", "--run", here / "run.sqlite", "--model", f"a={here / 'spd'}", f"a={here / 'radar'}")
    assert code == 1 and f"inputs radar alone, but {here / 'spd'} with the same name has the inputs SPD alone; give --model NAME=" in said


def test_report_scores_all_models_on_records_that_have_every_sensor(here, tmp_path):
    def some(records):
        records.lost["radar"][::4] = True

    derive.copy(here / "fresh.sqlite", tmp_path / "some.sqlite", some)
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
    page = page_of(tmp_path / "alone")
    assert page["title"] == "A recorded run" and len(page["records"]) == 1
    strips = of_kind(page["of"]["live"], "strips")
    assert len(strips["arrays"]["used_spd"]) == 60 and strips["gaps"]["radar"] == []
    assert of_kind(page["of"]["live"], "pictures")["show"] == ["truth", "spd", "radar"]

    def compare(first, second):
        return report(tmp_path / (first + second), "--run", here / "fresh.sqlite", "--compare", here / first, here / second)

    code, said = compare("mean", "body")
    assert code == 0 and "the second model is better" in said, said
    page, paired = page_of(tmp_path / "meanbody"), evaluated(here / "mean", here / "body", here / "fresh.sqlite")["paired"][0]["metrics"]
    rows = {row[0]: row for row in page["of"]["difference"][1]["rows"]}
    assert rows["IoU"][1:6] == ["60", *(f"{paired['iou'][key]:.3f}" for key in ("first", "second")),
                                f"{paired['iou']['mean']:+.3f}", f"{paired['iou']['low']:+.3f} to {paired['iou']['high']:+.3f}"]
    # A plus sign means that the second model is better, even for an error metric.
    assert rows["IoU"][6]["text"] == "second" and rows["RMSE (m)"][4][0] == "+"
    assert page["first"][0]["show"] == ["truth", "map 0", "map 1", "error 0", "error 1"]
    code, said = compare("body", "body")
    assert code == 0 and "do not differ significantly" in said and "difference +0.000 (95 %: +0.000 to +0.000)" in said


def test_report_shows_the_period_without_data_from_a_sensor(here, tmp_path):
    def lose(records):
        records.lost["radar"][40:] = True

    lost = derive.copy(here / "fresh.sqlite", tmp_path / "lost.sqlite", lose)
    change(lost, "verdict ?1 of the radar in records without radar data", "no frames")
    code, said = report(tmp_path, "--live", lost)
    assert code == 0 and "40 with all three sensors; 20 of 60 doubtful: radar no frames 20." in said
    assert "no data from radar after 120 s." in said
    assert of_kind(page_of(tmp_path)["of"]["live"], "strips")["gaps"]["radar"] == [[120.0, 180.0]]


def test_report_contains_every_note_of_the_evaluate_command(here, tmp_path):
    odd = changed(here / "fresh.sqlite", tmp_path / "odd.sqlite", "frozen camera in the records from ?1 to ?2", 0, 24)
    change(odd, "same depth image in the records from ?1 to ?2", 0, 24)
    change(odd, "radar is not valid in record ?1", 40)
    change(odd, "record ?1 has the histogram of record ?2", 50, 51)
    notes_of_evaluate = evaluated(here / "body", tmp_path / "odd.sqlite")["notes"].splitlines()
    for part in ("camera stands still 25; including them: IoU", "twice in the run 1", "1 records with a depth map left out: missing sensor 1"):
        assert any(part in line for line in notes_of_evaluate), notes_of_evaluate
    code, said = report(tmp_path, "--run", tmp_path / "odd.sqlite", "--model", here / "body")
    assert code == 0, said
    page = json.dumps(page_of(tmp_path), ensure_ascii=False)
    assert [line for line in notes_of_evaluate if line not in said or line not in page] == []


def test_report_refuses_a_run_with_only_doubtful_records(here, tmp_path):
    changed(here / "fresh.sqlite", tmp_path / "frozen.sqlite", "frozen camera in the records from ?1 to ?2", 0, 59)
    code, said = report(tmp_path / "page", "--run", tmp_path / "frozen.sqlite", "--model", here / "body")
    assert code == 1 and "60 of 60 records left out: camera stands still 60" in said and not (tmp_path / "page/report.html").exists()


def test_report_lists_an_unreadable_record_with_the_reason(here, tmp_path):
    """The unreadable record is record 30, because the report shows the middle record if no model is given."""
    changed(here / "fresh.sqlite", tmp_path / "bad.sqlite", "histogram of one byte in record ?1", 30)
    for words in ([], ["--run", tmp_path / "bad.sqlite", "--model", here / "body"]):
        code, said = report(tmp_path / "page", "--live", tmp_path / "bad.sqlite", *words)
        assert code == 0, said
        live = page_of(tmp_path / "page")["of"]["live"]
        image = np.frombuffer(base64.b64decode(of_kind(live, "waterfalls")["tables"][0]["values"]), "u1").reshape(60, -1)
        assert np.flatnonzero((image == 255).all(1)).tolist() == [30]
        assert [one for one in live if one.get("text", "").startswith("1 record cannot be read: record 30: unreadable: spd has 1 bytes")]
        if not words:
            assert "record 30, unreadable: spd has 1 bytes" in page_of(tmp_path / "page")["records"][0]["title"]


def test_report_waterfall_averages_adjacent_records_for_any_read_block_size(here, monkeypatch):
    run, pages = echofuse.open(here / "fresh.sqlite"), []
    monkeypatch.setattr(report_story, "MAX_POINTS", 30)
    for records in (256, 7):
        monkeypatch.setattr(run_blocks, "MAX_RECORDS", records)
        pages.append(report_story.Story(str(here / "fresh.sqlite")).waterfalls()[0]["tables"])
    assert pages[0] == pages[1]
    means = np.log1p(run.spd).reshape(20, 3, -1).mean(1)
    image = np.frombuffer(base64.b64decode(pages[0][0]["values"]), "u1").reshape(20, -1)
    assert np.abs(image - 254 * means / means.max()).max() <= 0.5 + 1e-9


def test_report_on_a_full_disk_or_after_sigterm_leaves_no_files(here, tmp_path):
    """If the disk is full, or after SIGTERM, partial files and scratch folders are deleted. A symbolic link at the path
    of the partial file is not followed."""
    (tmp_path / "scratch").mkdir()
    words, env = [BIN / "echofuse-report", tmp_path / "page", "--live", here / "fresh.sqlite"], os.environ | {"TMPDIR": str(tmp_path / "scratch")}
    full = subprocess.run(["sh", "-c", "ulimit -f 40; exec \"$@\"", "sh", *words], capture_output=True, text=True, env=env)
    page = tmp_path / "page/report.html"
    assert (full.returncode, full.stderr) == (6, f"echofuse-report: {page}: cannot write (File too large)\n")
    assert os.listdir(page.parent) == []
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
    (["--live", "nofile"], 1, "nofile.sqlite: No such file or directory; expected a run file"),
    (["--run", "fresh.sqlite", "--model", "nomodel"], 1, "nomodel: No such file or directory; expected a model file"),
    (["--run", "fresh.sqlite", "--model", "run.sqlite"], 1, "run.sqlite: is a run; expected a model file"),
    (["--run", "fresh.sqlite", "--model", "mean", "--empty", "run.sqlite"], 1, "cannot be used in another room"),
])
def test_report_refuses_invalid_arguments_with_a_one_line_error(here, tmp_path, monkeypatch, words, code, text):
    monkeypatch.chdir(here)
    found, said = report(tmp_path / "page", *words)
    assert found == code and text in said and said.count("\n") == 1, said
    assert not (tmp_path / "page").exists()


def test_report_of_another_run_is_overwritten_only_with_force(here, tmp_path):
    assert report(tmp_path, "--live", here / "fresh.sqlite")[0] == 0
    assert report(tmp_path, "--live", here / "fresh.sqlite")[0] == 0
    code, said = report(tmp_path, "--live", here / "run.sqlite")
    assert code == 2 and f"{tmp_path}: contains a report of another run; give another folder, or --force to overwrite it" in said
    assert report(tmp_path, "--live", here / "run.sqlite", "--force")[0] == 0
    assert page_of(tmp_path)["of"]["live"][0]["text"].endswith("160 records, all with all three sensors.")


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
    from echofuse.report.scores import Evaluation

    trivial = {name: {"iou": {"mean": iou, "se": 0.0, "maps": 20}} for name, iou in baselines.items()}
    return Evaluation([], {"trivial": trivial, "foreground_depth_m": 3.0}, "")


def test_report_summary_names_the_competing_model_and_metrics_in_which_it_is_better():
    ours, theirs = mode_of("ours", "factorised", 0.6, 0.46), mode_of("theirs", "pca", 0.5, 0.42)
    theirs.differences = {"rmse_m": {"records": 20, "first": 0.46, "second": 0.42, "mean": 0.04, "low": 0.03, "high": 0.05},
                          "iou": {"records": 20, "first": 0.6, "second": 0.5, "mean": -0.1, "low": -0.1, "high": -0.1}}
    said = tables.models_verdict([ours, theirs], judged_of(empty=0), "simulated", True)
    assert "20 simulated records of a new run: IoU 0.60 ± 0.00 (theirs with the same inputs: 0.50" in said
    assert "all baselines have IoU 0), lateral error 3.1 ± 0.0 cm" in said
    assert said.endswith("Worse than theirs (pca, SPD alone) in RMSE (0.46 against 0.42 m).")
    theirs.sensors = "SPD + 8 antennas"
    said = tables.models_verdict([ours, theirs], judged_of(empty=0, nearest=0.3), "recorded", False)
    assert "same inputs" not in said and "nearest training record: 0.30" in said and "20 recorded records held out in the training" in said


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
    # Limits of the Wilson score interval.
    assert Count(0, 10).interval[0] == 0 and Count(5, 10).interval[0] == pytest.approx(0.2366, rel=1e-3)
    assert np.isnan(Means()["iou"].mean)


def test_report_packs_arrays_as_base64_and_escapes_html():
    values = np.array([0, 1.2345, -1, 99, np.nan])
    # The packed values are 0, 1235 (0x04d3), 0, 65535, 0.
    assert blocks.packed(values, 1e-3, "<u2") == "AADTBAAA//8AAA=="
    assert blocks.packed(values, 0.01, "u1") == "AHsA/wA="  # The packed values are 0, 123, 0, 255, 0.
    assert blocks.short(float("nan")) is None and blocks.short(0.123456789) == 0.12346
    assert [blocks.three_digits(v) for v in (0, 8, 45971, 1366528, 9999.6)] == ["0", "8", "46 k", "1.37 M", "10 k"]
    html = blocks.html_of({"title": "<!--<script>", "verdict": "</script>\u202e\n"})
    assert '"title":"\\u003c!--\\u003cscript>"' in html and '"verdict":"\\u003c/script>\\\\u202e\\\\n"' in html


def test_report_lists_the_sensor_inputs_of_each_model():
    facts = {"0/model": "factorised", "0/inputs": "fused", "0/takes_antennas": 1, "0/axes/array/scale": 7.0, "0/axes/array/quantity": "lags"}
    assert sensors_of(facts) == "SPD + 8 antennas" and sensors_of(facts | {"0/takes_antennas": 0}) == "SPD + radar profile"
    assert sensors_of(facts | {"0/axes/array/quantity": "lags 1 2 5"}) == "SPD + antennas"
    assert sensors_of(facts | {"0/inputs": "radar"}) == "radar alone" and sensors_of({"0/model": "mean"}) == "no sensor"


def test_copied_report_package_contains_the_files_of_the_page(tmp_path):
    """Copies the package to another folder, as an installation does."""
    shutil.copytree(blocks.PAGE.parent, tmp_path / "echofuse", ignore=shutil.ignore_patterns("__pycache__"))
    code = "from echofuse.report.blocks import html_of; print(len(html_of({})))"
    said = subprocess.run(["/usr/bin/python3", "-c", code], env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=True)
    assert int(said.stdout) > 100_000


def test_report_compares_maps_of_other_programs_with_the_first_model(here, tmp_path):
    run = echofuse.open(here / "fresh.sqlite")
    echofuse.save_maps(tmp_path / "truth", run.maps(), run.index, run=run)
    echofuse.save_maps(tmp_path / "few", run.maps([0, 1, 2]), run.index[:3], run=run)
    words = ["--run", here / "fresh.sqlite", "--maps", f"theirs={tmp_path / 'truth'}", tmp_path / "few"]
    code, said = report(tmp_path / "page", *words, "--model", here / "body")
    assert code == 0, said
    page, told = page_of(tmp_path / "page"), evaluated("--maps", tmp_path / "truth", "--maps", tmp_path / "few", here / "body", run.path)
    scores, gains = (block for block in page["of"]["maps"] if block["kind"] == "table")
    assert [row[0] for row in scores["rows"]][:3] == ["theirs", "few (57 maps missing)", "body (mean-shape, SPD + radar profile)"]
    assert [row[1]["text"] for row in scores["rows"]][:3] == [f"{row['metrics']['iou']['mean']:.2f}" for row in told["rows"]]
    # The number in brackets is the number of maps with a depth error.
    assert [row[3]["small"].split("(")[-1] for row in scores["rows"]][:2] == ["60)", "3)"]
    assert [row[1]["text"] for row in gains["rows"]] == [f"{one['metrics']['iou']['mean']:+.3f}" for one in told["paired"]]
    shown = page["records"][of_kind(page["of"]["maps"], "pictures")["record"]]
    assert [one["name"] for one in shown["maps"]] == ["theirs", "few", "body (mean-shape, SPD + radar profile)"]
    assert shown["maps"][0]["scores"].startswith("IoU 1.00")
    truth = np.frombuffer(base64.b64decode(shown["truth"]), "<u2")
    assert np.array_equal(np.frombuffer(base64.b64decode(shown["maps"][0]["map"]), "<u2") > 0, truth > 0)
    code, said = report(tmp_path / "alone", *words)
    assert code == 0 and said.startswith("On 60 records: theirs: IoU 1.00"), said
    assert [section["id"] for section in page_of(tmp_path / "alone")["sections"]] == ["maps", "made"]


def test_report_of_a_recorded_run_lists_the_failures_and_scores_of_a_model(here, tmp_path):
    code, said = report(tmp_path, "--live", here / "fresh.sqlite", "--model", here / "body")
    assert code == 0, said
    page = page_of(tmp_path)
    assert {"failures", "metrics", "live"} <= set(page["of"]) and of_kind(page["of"]["live"], "strips")
    # The string in brackets identifies the commit.
    assert "echofuse-recon" in page["origin"] and "(" in dict(page["of"]["made"][0]["rows"])["program"]


def test_report_links_each_failure_to_at_most_8_records(here, tmp_path):
    assert report(tmp_path, "--run", here / "fresh.sqlite", "--model", here / "body")[0] == 0
    page = page_of(tmp_path)
    rows = [row for row in of_kind(page["of"]["failures"], "table")["rows"] if isinstance(row[3], dict)]
    shown = [record["index"] for record in page["records"]]
    assert rows and all(row[3]["records"][0] in shown for row in rows[:3])
    for row in rows:
        count = int(row[1].split(" of ")[0])
        assert len(row[3]["records"]) == min(count, 8) and row[3]["more"] == (count > 8)


def test_report_compares_the_first_of_five_models_with_the_others(here, tmp_path):
    words = [word for name in ("body", "fused", "spd", "radar", "mean") for word in ("--model", here / name)]
    code, said = report(tmp_path, "--run", here / "fresh.sqlite", *words)
    assert code == 0, said
    page = page_of(tmp_path)
    assert "Worse than" not in page["verdict"] and len(page["verdict"]) < 300
    against = next(block for block in page["of"]["metrics"] if block.get("caption", "").startswith("Differences from body"))
    assert len(against["rows"]) == 4 and against["rows"][0][1]["text"][0] in "+-"
