# SPDX-License-Identifier: MIT
"""Builds sentences and tables about the models of a report. Most of them describe the first
model."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .blocks import NONE, Block, cell, paragraph, table, three_digits
from .scores import Count, Evaluation, Mean, Means, ReportModel, Scores, means_of

__all__ = ["FIRST", "METRICS", "Row", "all_table", "best_of", "comparison", "comparison_verdict",
           "cost_table", "differences_table", "failing", "failures_table", "first_table",
           "labels_table", "metrics_table", "models_verdict", "plus_minus",
           "problems_of_run", "rows_of", "uncertainty_table", "value"]


class MetricFormat(NamedTuple):
    """The name, the unit and the number format of a metric."""

    name: str
    unit: str
    scale: float
    decimals: int
    best: str  # best value: "more" (highest), "less" (lowest) or "0"

    def text(self, value: float, more: int = 0) -> str:
        return f"{self.scale * value:.{self.decimals + more}f}"

    @property
    def title(self) -> str:
        return f"{self.name} ({self.unit.strip()})" if self.unit else self.name

    @property
    def head(self) -> Block:
        return cell(self.title, {"0": "0 is best", "more": "higher is better",
                                 "less": "lower is better"}[self.best])


METRICS = {"iou": MetricFormat("IoU", "", 1, 2, "more"),
           "lateral_m": MetricFormat("lateral error", " cm", 100, 1, "less"),
           "depth_mae_m": MetricFormat("depth error", " cm", 100, 1, "less"),
           "ghost": MetricFormat("mirror fraction", "", 1, 2, "0"),
           "left_right": MetricFormat("on the true side", "", 1, 2, "more"),
           "rmse_m": MetricFormat("RMSE", " m", 1, 2, "less"),
           "ssim": MetricFormat("SSIM", "", 1, 2, "more"),
           "ssim_hard": MetricFormat("SSIM, thresholded map", "", 1, 2, "more"),
           "ssim_fg": MetricFormat("SSIM near the body", "", 1, 2, "more")}
FIRST = ("iou", "lateral_m", "depth_mae_m")  # metrics at the top of the page
PAIRED = ("iou", "lateral_m", "depth_mae_m", "ssim_fg", "ssim_hard", "rmse_m", "ghost")
FEW = 10  # minimum number of maps of a score that is marked as the best
BASELINES = {"empty": "empty room", "mean": "mean of the training maps",
             "nearest": "nearest training record"}
# SSIM that Lai et al. reported for their network, Chin. Opt. Lett. 22, 022701 (2024).
PAPER_SSIM = {"spd": 0.6389, "radar": 0.5266}


def plus_minus(means: Means, metric: str) -> str:
    """Formats a mean with its unit and, if more than four maps contribute, with its standard
    error."""
    m, form = means[metric], METRICS[metric]
    return form.text(m.mean) + (f" ± {form.text(m.se)}" if m.maps > 4
                                and not np.isnan(m.se) else "") + form.unit


def baselines_of(result: dict[str, Any]) -> list[tuple[str, Means]]:
    """Returns the titles and means of the baselines in the JSON output of `evaluate`."""
    return [(title, means_of(result["trivial"][name]))
            for name, title in BASELINES.items() if name in result["trivial"]]


def better_of(d: dict[str, Any]) -> str:
    """Returns which model is better: "first", "second", or "" if the 95 % interval of the
    difference contains 0 or is unknown (too few records)."""
    return ("" if d["low"] is None or d["low"] <= 0 <= d["high"] else "second" if d["mean"] > 0
            else "first")


def interval(d: dict[str, Any], form: MetricFormat) -> str:
    return NONE if d["low"] is None else " to ".join(f"{form.scale * d[key]:+.{form.decimals + 1}f}"
                                                     for key in ("low", "high"))


# Functions that return sentences


def comparison_verdict(second: ReportModel, simulated: str) -> str:
    d = second.differences["iou"]
    which = (f"the {better_of(d)} model is better" if better_of(d)
             else "the two models do not differ significantly")
    gain = ("too few records for an interval" if d["low"] is None
            else "95 %: " + interval(d, METRICS["iou"]))
    return (f"On {d['records']} {simulated} records {which}: IoU {d['first']:.3f} and "
            f"{d['second']:.3f}, difference {d['mean']:+.3f} ({gain}).")


def models_verdict(models: Sequence[ReportModel], evaluation: Evaluation, simulated: str,
                   new_run: bool) -> str:
    """Returns a summary with the scores of the first model and of the measured baselines, and with
    the metrics for which a second model is better."""
    own = models[0]
    second = "".join(f"{model.short} with the same inputs: {plus_minus(model.means, 'iou')}; "
                     for model in models[1:] if len(models) == 2 and model.sensors == own.sensors)
    baseline = "baselines: " + ", ".join(f"{title} {plus_minus(means, 'iou')}" for title, means
                                         in baselines_of(evaluation.result))
    out = (f"{own.title}, on {len(own.first.index)} {simulated} "
           f"records{' of a new run' if new_run else ' held out in the training'}: "
           f"IoU {plus_minus(own.means, 'iou')} ({second}{baseline})")
    out += "".join(f", {METRICS[m].name} {plus_minus(own.means, m)}"
                   for m in FIRST[1:] if own.means[m].maps) + "."
    for model in models[1:] if len(models) == 2 else []:  # three or more: see differences_table()
        found = [(METRICS[m], model.differences[m])
                 for m in PAIRED if m not in ("ssim_fg", "ghost") and m in model.differences]
        worse = [f"{form.name} ({form.text(d['first'])} against "
                 f"{form.text(d['second'])}{form.unit})"
                 for form, d in found if better_of(d) == "second"]
        out += f" Worse than {model.title} in {', '.join(worse)}." if worse else ""
    return out


def problems_of_run(scores: Scores, where: str = "") -> list[str]:
    out = [f"{where}{scores.shift['text']}."] if scores.shift.get("found") else []
    if scores.inside.total and scores.inside.interval[1] < 0.9:
        out.append(f"{where}{scores.outside}.")
    return out + [f"{where}{note}." for note in scores.notes]


# Functions that return tables


class Row(NamedTuple):
    """Row of a metrics table. If `scores` belong to a single model file, paired comparisons are
    possible."""

    name: str
    means: Means
    scores: Scores | None = None
    baseline: bool = False


def rows_of(models: Sequence[ReportModel], result: dict[str, Any]) -> list[Row]:
    return [*(Row(model.title, model.means, model.first if len(model.files) == 1 else None)
              for model in models),
            *(Row(title, means, None, True) for title, means in baselines_of(result))]


def loss(metric: str, value: float) -> float:
    """Converts a score to a loss: a lower value is better."""
    return {"more": -value, "less": value, "0": abs(value)}[METRICS[metric].best]


def equal_within_errors(a: Row, b: Row, metric: str) -> bool:
    """Returns whether two means do not differ significantly (at the 95 % level). The comparison is
    paired by record if possible."""
    x, y = a.means[metric], b.means[metric]
    difference = abs(loss(metric, x.mean) - loss(metric, y.mean))
    error = np.hypot(np.nan_to_num(x.se), np.nan_to_num(y.se))
    if a.scores and b.scores and np.array_equal(a.scores.index, b.scores.index):
        d = a.scores[metric] - b.scores[metric]
        d = d[~np.isnan(d)]
        error = d.std() / np.sqrt(len(d) - 1) if len(d) > 4 else error
    return bool(difference <= 1.96 * error)


def best_of(rows: Sequence[Row], metric: str) -> list[bool]:
    """For each row, returns whether it is the best row or does not differ significantly from it.
    Ignores scores of few maps."""
    max_maps = max((row.means[metric].maps for row in rows), default=0)
    defined = [row.means[metric].maps >= max(FEW, max_maps / 2) for row in rows]
    best = min((row for row, is_defined in zip(rows, defined) if is_defined),
               key=lambda row: loss(metric, row.means[metric].mean), default=None)
    return [is_defined and best is not None and equal_within_errors(row, best, metric)
            for row, is_defined in zip(rows, defined)]


def value(row: Row, metric: str, best: bool) -> Block:
    """Returns the table cell of a metric. For `depth_mae_m`, the cell also contains the number
    of maps, in brackets."""
    m, form, mark = row.means[metric], METRICS[metric], "best" if best else ""
    if np.isnan(m.mean):
        return cell("", "no body found" if metric in FIRST[1:] else "not defined")
    if metric == "left_right" and (row.baseline or row.scores):
        return cell(f"{m.mean * m.maps:.0f} of {m.maps}", "", mark)
    small = f"±{form.text(m.se)}" if m.maps > 2 and m.se > 0 else ""
    if metric == "depth_mae_m" and (row.baseline or row.scores):
        small += f" ({m.maps})"
    return cell("0" if abs(m.mean) < 1e-14 else form.text(m.mean), small.strip(), mark)


def metrics_table(rows: Sequence[Row], caption: str) -> Block:
    best = [best_of(rows, metric) for metric in FIRST]
    lines = [[row.name, *(value(row, m, b[i]) for m, b in zip(FIRST, best))]
             for i, row in enumerate(rows)]
    return table(caption, ["model", *(METRICS[m].head for m in FIRST)], lines,
                 sum(row.baseline for row in rows))


def first_table(models: Sequence[ReportModel], result: dict[str, Any]) -> Block:
    rows, seeds = rows_of(models, result), len(models[0].files) > 1
    return metrics_table(rows, f"{len(models[0].first.index)} records; mean ± standard error over "
              f"{'trainings' if seeds else 'maps'}. In brackets: number of maps in which the "
              "predicted and the true body overlap. The best value, and values that do not differ "
              "from it significantly, are marked.")


def differences_table(first: str, gains: Sequence[tuple[str, dict[str, Any]]]) -> list[Block]:
    """Returns a table of the gains over the first model, paired by record, with 95 % intervals."""
    def gain(d: dict[str, Any] | None, form: MetricFormat) -> str | Block:
        if d is None:
            return NONE
        mark = {"first": "bad", "second": "good"}.get(better_of(d), "")
        return cell(f"{form.scale * d['mean']:+.{form.decimals + 1}f}", interval(d, form), mark)

    rows = [[name, *(gain(differences.get(m), METRICS[m]) for m in FIRST)]
            for name, differences in gains if differences]
    return [table(f"Differences from {first}, paired by record, with 95 % intervals; positive "
                  "means better", ["", *(METRICS[m].title for m in FIRST)], rows)] if rows else []


def all_table(models: Sequence[ReportModel], result: dict[str, Any]) -> list[Block]:
    """Returns the table of all metrics (rows) and models (columns), and notes on SSIM."""
    rows, own = rows_of(models, result), models[0].means
    lines = [[METRICS[m].head, *(value(row, m, best) for row, best in zip(rows, best_of(rows, m)))]
             for m in METRICS]
    raw, hard, empty = (own["ssim"].mean, own["ssim_hard"].mean,
                        means_of(result["trivial"]["empty"])["ssim"].mean)
    scores = f"{raw:.3f}" + (f" raw and {hard:.3f} as a thresholded map" if abs(raw - hard) >= 5e-4
                             else "")
    out = [table("The best value, and values that do not differ from it significantly, are marked",
                 ["metric", *(row.name for row in rows)], lines),
           *differences_table(models[0].title, [(model.title, model.differences)
                                               for model in models[1:]]),
           paragraph("Do not use SSIM alone. Most of a depth map is background, so an empty room "
                     f"has SSIM {empty:.3f}; the first model has {scores}. IoU, lateral error and "
                     "mirror fraction show whether the body is found, and on which side.", "note")]
    papers = [[model.title, summary(model.means, "ssim", 1),
               f"{PAPER_SSIM.get(model.inputs, 0.6576):.4f}"] for model in models if model.papers]
    if papers:
        gap = (" The difference between the results with both sensors and with one sensor is "
               "comparable." if len(papers) > 1 else "")
        out += [table("Networks of the paper (Lai et al., Chin. Opt. Lett. 22, 022701, 2024)",
            ["", "SSIM here", "SSIM in the paper"], papers),
                paragraph("Absolute values are not comparable: the paper does not state the "
                          "window and the data range of its SSIM." + gap)]
    return out


def summary(means: Means, metric: str, more: int = 0) -> str | Block:
    m, form = means[metric], METRICS[metric]
    small = f"±{form.text(m.se, more)}" if m.maps > 4 and not np.isnan(m.se) else ""
    small += f" ({m.maps})" * (metric == "depth_mae_m")
    return cell(form.text(m.mean, more), small.strip()) if m.maps else NONE


def cost_table(models: Sequence[ReportModel]) -> Block:
    rows = [[model.title, f"{c['infer_us_median']:.0f}", f"{c['infer_us_p99']:.0f}",
             three_digits(c["multiply_adds"]), three_digits(c["parameters"]),
             f"{c['model_bytes'] / 1e6:.1f}", f"{c['train_s']:.0f}"] for model in models
            for c in [model.first.result["cost"]]]
    return table("Single maps on one thread of this host",
                 ["", "time per map (µs, median)", "p99 (µs)", "multiply-adds", "parameters",
                  cell("file (MB)", "with fallback models and uncertainty"), "training (s)"], rows)


def labels_table(model: ReportModel) -> list[Block]:
    s, rows = model.first, []
    for label in sorted(set(s.labels)):
        rows_of_label = np.array([text == label for text in s.labels])
        means = Means({name: Mean.of(s[name][rows_of_label]) for name in FIRST})
        left_right = s["left_right"][rows_of_label]
        side = Count.where(left_right > 0.5, left_right)
        rows.append([label or "(none)", str(rows_of_label.sum()),
                     *(summary(means, m) for m in FIRST), str(side) if side.total else NONE])
    heads = ["label", "records", *(METRICS[m].title for m in FIRST), "on the true side"]
    caption = "Mean ± standard error (five or more maps); number of maps in brackets"
    return [table(f"{caption}; {model.title}", heads, rows)] if len(rows) > 1 else []


def failing(s: Scores) -> list[tuple[str, Count, list[int]]]:
    """Returns the kinds of failures, the most frequent kind first. Each kind includes the number
    and the indices of its records, the worst record first."""
    iou, side, error, stated = (s[name] for name in ("iou", "left_right", "lateral_m",
                                                     "lateral_interval_90_m"))
    known = error + stated
    kinds = [("body missed (IoU below 0.2)", iou < 0.2, iou, iou),
             ("body on the wrong side (only bodies off the axis)", side < 0.5, side, -error),
             ("lateral error above 30 cm", error > 0.3, error, -error),
             ("body outside its stated interval (10 % expected)", error > stated, known,
              -error / stated)]
    reasons = np.array([text.partition(" (")[0] for text in s.warnings], object)
    kinds += [(f"flagged: {reason}", reasons == reason,
               np.zeros(len(reasons)), iou) for reason in sorted(set(reasons) - {""})]
    found = [(title, Count.where(holds, known), s.index[holds][np.argsort(by[holds])].tolist())
             for title, holds, known, by in kinds if not np.isnan(known).all()]
    return sorted(found, key=lambda kind: -kind[1].count / kind[1].total)


def failures_table(model: ReportModel) -> Block:
    rows = [[title, str(count), f"{100 * count.interval[0]:.0f} to {100 * count.interval[1]:.0f} %",
             {"text": "", "records": indices[:8], "more": len(indices) > 8} if indices else NONE]
            for title, count, indices in failing(model.first)]
    return table(model.title, ["failure", "records", "95 % interval",
                              {"text": "record numbers, worst first", "words": True}], rows)


def uncertainty_table(rows: Sequence[tuple[str, Scores]]) -> Block:
    """Returns a table that compares predicted uncertainties with observed errors. Each row of
    `rows` is (title, scores)."""
    def row(name: str, s: Scores) -> list[str | Block]:
        whole: str | Block = "not tested"
        if s.shift:
            whole = cell("differs", "", "bad") if s.shift["found"] else "matches"
        if not s.result["calibrated"]:
            return [name, "not calibrated", NONE, NONE, NONE, NONE, whole]
        c, inside, records = s.result["calibration"], s.inside, s.result["records"]
        stated, deviation, error = (NONE if c[key] is None else f"{unit * c[key]:{form}}"
                                    for key, unit, form in (("lateral_interval_90_m", 100, ".1f"),
                                     ("pixel_deviation_m", 1, ".2f"), ("pixel_error_m", 1, ".2f")))
        share = cell(str(inside) if inside.total else NONE, "",
                     "bad" if inside.total and inside.interval[1] < 0.9 else "")
        return [name, stated, share, deviation, error,
                f"{(c['flagged'] or 0) * records:.0f} of {records}", whole]

    return table("Stated uncertainty and observed errors", [
        "", "stated 90 % interval (± cm)", "bodies inside", "stated pixel error (m, rms)",
        "observed pixel error (m, rms)", "flagged records", "run against the training data"],
                 [row(*pair) for pair in rows])


def comparison(a: ReportModel, b: ReportModel) -> list[Block]:
    """Compares two models record by record. A gain is positive if the second model is better."""
    rows = []
    for form, d in ((METRICS[m], b.differences[m]) for m in PAIRED if m in b.differences):
        better = cell(better_of(d), "", "good") if better_of(d) else "not significant"
        rows.append([form.title, str(d["records"]), form.text(d["first"], 1),
                     form.text(d["second"], 1),
                     f"{form.scale * d['mean']:+.{form.decimals + 1}f}", interval(d, form), better])
    return [paragraph(f"First model: {a.title}. Second model: {b.title}."),
            table("Paired by record; 95 % intervals from resampling blocks of up to ten "
                  "neighbouring records", ["metric", "records", "first", "second",
                   cell("difference", "positive: the second model is better"), "95 % interval",
                   "better"], rows)]
