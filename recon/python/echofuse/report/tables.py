# SPDX-License-Identifier: MIT
"""Sentences, tables and charts of the models of a report. The subject is the first of the modes."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .blocks import NONE, Block, add_series, cell, chart, paragraph, table, three_digits
from .scores import Count, Judged, Mean, Means, Mode, Scores, Values, means_of


class Words(NamedTuple):
    """How the page names a metric, in what unit, and what is better."""

    name: str
    unit: str
    scale: float
    decimals: int
    best: str  # "more", "less", "0"

    def text(self, value: float, more: int = 0) -> str:
        return f"{self.scale * value:.{self.decimals + more}f}"

    @property
    def title(self) -> str:
        return f"{self.name} ({self.unit.strip()})" if self.unit else self.name

    @property
    def head(self) -> Block:
        return cell(self.title, "0 is best" if self.best == "0" else f"{self.best} is better")


METRICS = {"iou": Words("IoU", "", 1, 2, "more"),
           "lateral_m": Words("lateral error", " cm", 100, 1, "less"),
           "depth_mae_m": Words("depth error", " cm", 100, 1, "less"),
           "ghost": Words("mirror fraction", "", 1, 2, "0"),
           "left_right": Words("on the true side", "", 1, 2, "more"),
           "rmse_m": Words("RMSE", " m", 1, 2, "less"),
           "ssim": Words("SSIM", "", 1, 2, "more"),
           "ssim_hard": Words("SSIM, thresholded map", "", 1, 2, "more"),
           "ssim_fg": Words("SSIM near the body", "", 1, 2, "more")}
FIRST = ("iou", "lateral_m", "depth_mae_m")  # metrics of the first screen
PAIRED = ("iou", "lateral_m", "depth_mae_m", "ssim_fg", "ssim_hard", "rmse_m", "ghost")
BASELINES = {"empty": "empty room", "mean": "mean of the training maps",
             "nearest": "nearest training record"}
# SSIM that Lai et al., Chin. Opt. Lett. 22, 022701 (2024), state of their network.
PAPER_SSIM = {"spd": 0.6389, "radar": 0.5266}


def plus_minus(means: Means, metric: str) -> str:
    m, word = means[metric], METRICS[metric]
    return word.text(m.mean) + (f" ± {word.text(m.se)}" if m.maps > 4
                                and not np.isnan(m.se) else "") + word.unit


def baselines_of(told: dict[str, Any]) -> list[tuple[str, Means]]:
    return [(title, means_of(told["trivial"][name]))
            for name, title in BASELINES.items() if name in told["trivial"]]


def better_of(d: dict[str, Any]) -> str:
    """first, second, or nothing where the interval of the gain has 0, or is not known of so few
    records."""
    return ("" if d["low"] is None or d["low"] <= 0 <= d["high"] else "second" if d["mean"] > 0
            else "first")


def interval(d: dict[str, Any], word: Words) -> str:
    return NONE if d["low"] is None else " to ".join(f"{word.scale * d[key]:+.{word.decimals + 1}f}"
                                                     for key in ("low", "high"))


# Sentences


def comparison_verdict(second: Mode, simulated: str) -> str:
    d = second.differences["iou"]
    which = (f"the {better_of(d)} model is better" if better_of(d)
             else "the two models cannot be told apart")
    gain = ("too few records for an interval" if d["low"] is None
            else "95 %: " + interval(d, METRICS["iou"]))
    return (f"On {d['records']} {simulated} records {which}: IoU {d['first']:.3f} and "
            f"{d['second']:.3f}, difference {d['mean']:+.3f} ({gain}).")


def models_verdict(modes: Sequence[Mode], judged: Judged, simulated: str, new_run: bool) -> str:
    """How good, against what, and in what it is worse. A baseline with IoU 0 draws nobody: no
    opponent."""
    own = modes[0]
    like = "".join(f"{mode.short}, of the same inputs: {plus_minus(mode.means, 'iou')}; "
                   for mode in modes[1:] if len(modes) == 2 and mode.takes == own.takes)
    drawing = [(title, means) for title, means in baselines_of(judged.told)
               if means["iou"].mean > 0.01]
    best, means = max(drawing, key=lambda one: one[1]["iou"].mean, default=("", Means()))
    against = (f"the best baseline that draws a body, {best}: {plus_minus(means, 'iou')}" if best
               else "none of the baselines scored here draws a body")
    out = (f"{own.title}, on {len(own.first.index)} {simulated} "
           f"records{' of a new run' if new_run else ' that training held out'}: "
           f"IoU {plus_minus(own.means, 'iou')} ({like}{against})")
    out += "".join(f", {METRICS[m].name} {plus_minus(own.means, m)}"
                   for m in FIRST[1:] if own.means[m].maps) + "."
    for mode in modes[1:] if len(modes) == 2 else []:  # of more models: differences_table
        found = [(METRICS[m], mode.differences[m])
                 for m in PAIRED if m not in ("ssim_fg", "ghost") and m in mode.differences]
        worse = [f"{word.name} ({word.text(d['first'])} against "
                 f"{word.text(d['second'])}{word.unit})"
                 for word, d in found if better_of(d) == "second"]
        out += f" Worse than {mode.title} in {', '.join(worse)}." if worse else ""
    return out


def problems_of_run(scores: Scores, where: str = "") -> list[str]:
    out = [f"{where}{scores.shift['text']}."] if scores.shift.get("found") else []
    if scores.kept.of and scores.kept.interval[1] < 0.9:
        out.append(f"{where}{scores.outside}.")
    return out + [f"{where}{note}." for note in scores.notes]


# Tables


class Row(NamedTuple):
    """Row of a table of metrics; scores of a single model can be paired."""

    name: str
    means: Means
    scores: Scores | None = None
    baseline: bool = False


def rows_of(modes: Sequence[Mode], told: dict[str, Any]) -> list[Row]:
    return [*(Row(mode.title, mode.means, mode.first if len(mode.files) == 1 else None)
              for mode in modes),
            *(Row(title, means, None, True) for title, means in baselines_of(told))]


def loss(metric: str, value: float) -> float:
    return {"more": -value, "less": value, "0": abs(value)}[METRICS[metric].best]


def same(a: Row, b: Row, metric: str) -> bool:
    """Whether they cannot be told apart; record by record where that can be."""
    x, y = a.means[metric], b.means[metric]
    apart, error = abs(loss(metric, x.mean)
                       - loss(metric, y.mean)), np.hypot(np.nan_to_num(x.se), np.nan_to_num(y.se))
    if a.scores and b.scores and np.array_equal(a.scores.index, b.scores.index):
        d = a.scores[metric] - b.scores[metric]
        d = d[~np.isnan(d)]
        error = d.std() / np.sqrt(len(d) - 1) if len(d) > 4 else error
    return bool(apart <= 1.96 * error)


def best_of(rows: Sequence[Row], metric: str) -> list[bool]:
    """The best and all that cannot be told apart from it."""
    known = [row.means[metric].maps > 0 for row in rows]
    best = min((row for row, one in zip(rows, known) if one),
               key=lambda row: loss(metric, row.means[metric].mean), default=None)
    return [one and best is not None and same(row, best, metric) for row, one in zip(rows, known)]


def value(row: Row, metric: str, best: bool) -> Block:
    m, word, mark = row.means[metric], METRICS[metric], "best" if best else ""
    if np.isnan(m.mean):
        return cell("", "no body found" if metric in FIRST[1:] else "not defined")
    if metric == "left_right" and (row.baseline or row.scores):
        return cell(f"{m.mean * m.maps:.0f} of {m.maps}", "", mark)
    small = f"±{word.text(m.se)}" if m.maps > 2 and m.se > 0 else ""
    if metric == "depth_mae_m" and (row.baseline or row.scores):
        small += f" ({m.maps})"
    return cell("0" if abs(m.mean) < 1e-14 else word.text(m.mean), small.strip(), mark)


def metrics_table(rows: Sequence[Row], caption: str) -> Block:
    best = [best_of(rows, metric) for metric in FIRST]
    lines = [[row.name, *(value(row, m, b[i]) for m, b in zip(FIRST, best))]
             for i, row in enumerate(rows)]
    return table(caption, ["model", *(METRICS[m].head for m in FIRST)], lines,
                 sum(row.baseline for row in rows))


def first_table(modes: Sequence[Mode], told: dict[str, Any]) -> Block:
    rows, seeds = rows_of(modes, told), len(modes[0].files) > 1
    return metrics_table(
        rows, f"{len(modes[0].first.index)} records; mean ± standard error over "
              f"{'trainings' if seeds else 'maps'}; depth error in brackets: over this number of "
              "maps, in which body meets body; best: and all that cannot be told apart from it")


def differences_table(first: str, gains: Sequence[tuple[str, dict[str, Any]]]) -> list[Block]:
    """Gains of each over the first one, record by record, with intervals of 95 %."""
    def gain(d: dict[str, Any] | None, word: Words) -> str | Block:
        if d is None:
            return NONE
        mark = {"first": "bad", "second": "good"}.get(better_of(d), "")
        return cell(f"{word.scale * d['mean']:+.{word.decimals + 1}f}", interval(d, word), mark)

    rows = [[name, *(gain(told.get(m), METRICS[m]) for m in FIRST)] for name, told in gains if told]
    return [table(f"Against {first}, record by record; plus is better; 95 % interval",
                  ["", *(METRICS[m].title for m in FIRST)], rows)] if rows else []


def all_table(modes: Sequence[Mode], told: dict[str, Any]) -> list[Block]:
    """Metrics down, models across: it fits beside seven."""
    rows, own = rows_of(modes, told), modes[0].means
    lines = [[METRICS[m].head, *(value(row, m, best) for row, best in zip(rows, best_of(rows, m)))]
             for m in METRICS]
    raw, hard, empty = (own["ssim"].mean, own["ssim_hard"].mean,
                        means_of(told["trivial"]["empty"])["ssim"].mean)
    scores = f"{raw:.3f}" + (f" raw and {hard:.3f} as a thresholded map" if abs(raw - hard) >= 5e-4
                             else "")
    out = [table("Best: and all that cannot be told apart from it",
                 ["metric", *(row.name for row in rows)], lines),
           *differences_table(modes[0].title, [(mode.title, mode.differences)
                                               for mode in modes[1:]]),
           paragraph("Do not read the SSIM row alone. Most of a depth map is empty room, and SSIM "
                     "over the whole map mostly rewards leaving it empty: the empty room, as the "
                     f"answer to every record, scores {empty:.3f}; the first model scores "
                     f"{scores}. IoU, lateral error and mirror fraction say whether the body is "
                     "found, and on its side.", "note")]
    papers = [[mode.title, summary(mode.means, "ssim", 1),
               f"{PAPER_SSIM.get(mode.inputs, 0.6576):.4f}"] for mode in modes if mode.papers]
    if papers:
        gap = ("; what can be compared is the gap between both sensors and either one alone."
               if len(papers) > 1 else ".")
        out += [table(
            "Beside the paper: its networks only (Lai et al., Chin. Opt. Lett. 22, 022701, 2024)",
            ["", "SSIM here", "SSIM in the paper"], papers),
                paragraph("The paper states neither window nor data range of its SSIM, so its "
                          "values cannot be met as absolutes" + gap)]
    return out


def summary(means: Means, metric: str, more: int = 0) -> str | Block:
    m, word = means[metric], METRICS[metric]
    small = f"±{word.text(m.se, more)}" if m.maps > 4 and not np.isnan(m.se) else ""
    small += f" ({m.maps})" * (metric == "depth_mae_m")
    return cell(word.text(m.mean, more), small.strip()) if m.maps else NONE


def cost_table(modes: Sequence[Mode]) -> Block:
    rows = [[mode.title, f"{c['infer_us_median']:.0f}", f"{c['infer_us_p99']:.0f}",
             three_digits(c["multiply_adds"]), three_digits(c["parameters"]),
             f"{c['model_bytes'] / 1e6:.1f}", f"{c['train_s']:.0f}"] for mode in modes
            for c in [mode.first.told["cost"]]]
    return table("One map on one thread of this host",
                 ["", "time of a map (µs, median)", "99 % are below (µs)", "multiply-adds",
                  "parameters",
                  cell("file (MB)", "with fallbacks and what it knows of its errors"),
                  "training (s)"], rows)


def labels_table(mode: Mode) -> list[Block]:
    s, rows = mode.first, []
    for label in sorted(set(s.labels)):
        of = np.array([one == label for one in s.labels])
        means = Means({name: Mean.of(s[name][of]) for name in FIRST})
        side = Count.where(s["left_right"][of] > 0.5, s["left_right"][of])
        rows.append([label or "(none)", str(of.sum()), *(summary(means, m) for m in FIRST),
                     str(side) if side.of else NONE])
    heads = ["label", "records", *(METRICS[m].title for m in FIRST), "on the true side"]
    caption = "Means, of five records and more ± standard error; in brackets the number of maps"
    return [table(f"{caption}; {mode.title}", heads, rows)] if len(rows) > 1 else []


def failing(s: Scores) -> list[tuple[str, Count, list[int]]]:
    """Kinds of failures, the most frequent first, and their records, the worst first."""
    iou, side, off, stated = (s[name] for name in ("iou", "left_right", "lateral_m",
                                                   "lateral_interval_90_m"))
    known = off + stated
    kinds = [("the body is missed (IoU below 0.2)", iou < 0.2, iou, iou),
             ("the body stands on the wrong side (of those off the axis)", side < 0.5, side, -off),
             ("more than 30 cm off to the side", off > 0.3, off, -off),
             ("outside its stated interval (10 % expected)", off > stated, known, -off / stated)]
    reasons = np.array([text.partition(" (")[0] for text in s.warnings], object)
    kinds += [(f"flagged as unlike the training: {reason}", reasons == reason,
               np.zeros(len(reasons)), iou) for reason in sorted(set(reasons) - {""})]
    found = [(what, Count.where(holds, known), s.index[holds][np.argsort(by[holds])].tolist())
             for what, holds, known, by in kinds if not np.isnan(known).all()]
    return sorted(found, key=lambda one: -one[1].count / one[1].of)


def failures_table(mode: Mode) -> Block:
    rows = [[what, str(count), f"{100 * count.interval[0]:.0f} to {100 * count.interval[1]:.0f} %",
             {"text": "", "records": which[:8], "more": len(which) > 8} if which else NONE]
            for what, count, which in failing(mode.first)]
    return table(mode.title, ["what", "records", "95 % interval",
                              {"text": "which, the worst first", "words": True}], rows)


def stated_table(rows: Sequence[tuple[str, Scores]]) -> Block:
    """Records one by one, and the run as a whole."""
    def row(name: str, s: Scores) -> list[str | Block]:
        whole: str | Block = "not tested"
        if s.shift:
            whole = cell("unlike", "", "bad") if s.shift["found"] else "like it"
        if not s.told["calibrated"]:
            return [name, "not calibrated", NONE, NONE, NONE, NONE, whole]
        c, kept, records = s.told["calibration"], s.kept, s.told["records"]
        stated, deviation, error = (NONE if c[key] is None else f"{unit * c[key]:{form}}"
                                    for key, unit, form in
                                    (("lateral_interval_90_m", 100, ".1f"),
                                     ("pixel_deviation_m", 1, ".2f"), ("pixel_error_m", 1, ".2f")))
        held = cell(str(kept) if kept.of else NONE, "",
                    "bad" if kept.of and kept.interval[1] < 0.9 else "")
        return [name, stated, held, deviation, error,
                f"{(c['flagged'] or 0) * records:.0f} of {records}", whole]

    return table("How sure the models are, and how that holds", [
        "", "stated: within (cm, 90 %)", "bodies within it",
        "stated uncertainty of a pixel (m, rms)", "error of a pixel (m, rms)",
        "records flagged one by one", "the run as a whole against the training"],
                 [row(*one) for one in rows])


# Charts


def shares_below(values: Values) -> tuple[Values, Values]:
    """At most 200 of the values, and which share of all, in per cent, is not above each."""
    values = np.sort(values[~np.isnan(values)])
    at = np.arange(0, len(values), len(values) // 200 + 1)
    return values[at], 100 * (at + 1) / max(len(values), 1)


def distribution(modes: Sequence[Mode], colours: Sequence[str], metric: str, title: str, x: str,
                 **more: Any) -> Block:
    out = chart(title, x, "records below (%)", span=[0, 100], **more)
    for mode, colour in zip(modes, colours):
        add_series(out, mode.short, colour, "line",
                   *shares_below(METRICS[metric].scale * mode.first[metric]))
    out["note"] = "; ".join(f"{mode.short}: {(~np.isnan(mode.first[metric])).sum()} records"
                            for mode in modes) + "."
    return out


def error_chart(modes: Sequence[Mode], colours: Sequence[str], title: str, x: str,
                place: str) -> Block:
    """The subject's records as dots; medians of groups of as many records of all models, none of
    too few."""
    def pairs(mode: Mode) -> Values:
        both = np.column_stack([mode.first[place], 100 * mode.first["lateral_m"]])
        both = both[~np.isnan(both).any(1)]
        return np.asarray(both[np.lexsort((both[:, 1], both[:, 0]))])

    out, own, groups = chart(title, x, "lateral error (cm)", log=True), pairs(modes[0]), 0
    add_series(out, "a record", colours[0], "dots", *own.T)
    for mode, colour in zip(modes, colours):
        found = pairs(mode)
        parts = min(len(found) // 10, 8)
        if parts >= 4:
            edges = [g * len(found) // parts for g in range(parts + 1)]
            middles = [np.sort(found[a:b], 0)[(b - a) // 2] for a, b in zip(edges, edges[1:])]
            add_series(out, mode.short, colour, "marked", *np.array(middles).T)
            groups = max(groups, parts)
    out["note"] = f"Dots: {len(own)} records of {modes[0].title}. " + (
        f"Lines: medians of {groups} groups of about {len(own) // groups} records." if groups
        else "Too few for medians.")
    return out


def errors(modes: Sequence[Mode], colours: Sequence[str]) -> Block:
    return {"kind": "charts", "blocks": [
        error_chart(modes, colours, "Lateral error against range", "range (m)", "range_m"),
        error_chart(modes, colours, "Lateral error against side", "x, right of the SPD (m)",
                    "side_m"),
        distribution(modes, colours, "lateral_m", "Share of the records below a lateral error",
                     "lateral error (cm)", log_x=True),
        distribution(modes, colours, "iou", "Share of the records below an IoU", "IoU")]}


def losses(modes: Sequence[Mode]) -> list[Block]:
    """While training."""
    out = []
    for mode in modes:
        training, validation = (mode.tensors[f"0/training/{name}loss_m"].ravel()
                                for name in ("", "validation_"))
        if len(training) < 2:
            continue
        out.append(chart(mode.title, "epoch", "loss (rms, unit of the model)", log=True))
        for name, colour, curve in (("training", "grey", training),
                                    ("validation", "both", validation)):
            add_series(out[-1], name, colour, "line", np.arange(1, len(curve) + 1), curve)
        if best := mode.facts[0]["0/training/best_epoch"]:
            out[-1]["rules"].append({"at": best, "name": "kept"})
    return [{"kind": "charts", "blocks": out}] if out else []


def comparison(a: Mode, b: Mode) -> list[Block]:
    """Two models record by record; a gain is plus where the second is better, of an error too."""
    rows, charts = [], []
    for word, d in ((METRICS[m], b.differences[m]) for m in PAIRED if m in b.differences):
        better = cell(better_of(d), "", "good") if better_of(d) else "not told apart"
        rows.append([word.title, str(d["records"]), word.text(d["first"], 1),
                     word.text(d["second"], 1),
                     f"{word.scale * d['mean']:+.{word.decimals + 1}f}", interval(d, word), better])
    for metric, name, unit in (("iou", "gain of IoU", 1),
                               ("lateral_m", "gain: lateral error that is less (cm)", -100)):
        gain = unit * (b.first[metric] - a.first[metric])
        gain = gain[~np.isnan(gain)]
        charts.append(chart(f"Record by record ({len(gain)} records)", name, "records below (%)",
                            span=[0, 100], rules=[{"at": 0, "name": "equal"}],
                            note=f"Right of the line the second is better: "
                                 f"{Count(int((gain > 0).sum()), len(gain))}."))
        add_series(charts[-1], "all records", "both", "steps", *shares_below(gain))
    return [paragraph(f"First: {a.title}. Second: {b.title}."),
            table("The same records; intervals of 95 % by resampled blocks of at most ten "
                  "neighbours",
                  ["metric", "records", "first", "second",
                   cell("difference", "plus: second is better"), "95 % interval", "better"], rows),
            {"kind": "charts", "blocks": charts}]
