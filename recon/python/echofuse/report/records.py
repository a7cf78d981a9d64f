# SPDX-License-Identifier: MIT
"""Collects the records of a report: sensor data, ground-truth maps, and maps from `echofuse-recon
reconstruct`."""
from __future__ import annotations

import csv
import pathlib
import tempfile
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import runs
from ..models.maps import load_maps
from ..runs.batches import blocks
from ..runs.programs import call
from ..runs.zones import summed
from .blocks import Block, packed, short
from .scores import ReportModel, Scores

__all__ = ["decibels", "half_tangent", "map_remarks", "measured", "record_blocks", "score_text",
           "select_records"]

UNCALIBRATED = (
    "no uncertainty (requires a model with sensor inputs and an uninterrupted training on at least "
    "50 records)")
# maps [N, N] by name: "thresholded" (m, 0: no return), "share" (relative depth), "deviation" (m)
Map = dict[str, NDArray[np.float32]]


def record_blocks(run: str, indices: Sequence[int], models: Sequence[ReportModel] = (),
                  scores: Sequence[Scores] = (), room: Sequence[str] = ()) -> dict[int, Block]:
    """Returns one block per record, keyed by record index. The maps in the blocks are predicted by
    the first file of each model. `scores` contains the scores of the same files."""
    with runs.open(run) as whole:
        rows = np.flatnonzero(np.isin(whole.index, indices)).tolist()
        out = {int(whole.index[row]): measured(whole[row:row + 1]) for row in rows}
    for model, scored in zip(models if out else (), scores):
        for index, (status, maps) in reconstruct(model, run, list(out), room).items():
            at = int(np.flatnonzero(scored.index == index)[0])
            out[index]["body_m"] = short(scored["range_m"][at])
            out[index]["maps"].append(map_block(model, scored, at, status, maps))
    return out


def measured(record: runs.Run) -> Block:
    """Returns a block that describes one record: title, ground-truth map, clicks [bins], and power
    [points], dB, at true ranges. "body_m" and "maps" are empty. If the record is damaged, its title
    contains the error message."""
    (_, run, faults), = blocks(record)
    truth = run.maps()[0] if "depth_x" in run.axes else np.zeros((64, 64))
    title = ", ".join([run.labels[0] or "no label", f"record {run.index[0]}", *faults.values()])
    out: Block = {"index": int(run.index[0]), "title": title, "half_tangent": half_tangent(run),
                  "truth": packed(truth, 1e-3, "<u2"), "body_m": None, "maps": []}
    for sensor, axis in (("spd", run.axes.get("spd")), ("radar", run.power_axis)):
        out[sensor] = {"start": axis.start, "step": axis.step,
                       "count": axis.count} if axis else {"start": 0, "step": 1, "count": 0}
    if run.valid["spd"][0]:
        out["spd"]["clicks"] = [*map(short, summed(run.photons())[0])]
    if run.valid["radar"][0]:
        out["radar"]["db"] = [*map(short, decibels(run.power()[0]))]
    return out


def decibels(power: NDArray[np.float32]) -> NDArray[np.float64]:
    """Converts power [..., points] to dB, clipped at 60 dB below the maximum."""
    power = power.astype(float)
    floor = np.maximum(1e-6 * power.max(-1, keepdims=True), 1e-30)
    return np.asarray(10 * np.log10(np.maximum(power, floor)))


def half_tangent(run: runs.Run) -> float:
    return round(run.half_tangent, 9)


def reconstruct(model: ReportModel, run: str, indices: Sequence[int],
                room: Sequence[str]) -> dict[int, tuple[str, Map]]:
    """For each record index, returns the status and the maps predicted by the first file of the
    model."""
    calibrated = bool(model.facts[0]["0/calibrated"])
    with tempfile.TemporaryDirectory(prefix="echofuse-report-") as scratch:
        folder = pathlib.Path(scratch)
        call("echofuse-recon", "-q", "reconstruct", model.files[0], run, "--rows",
             ",".join(map(str, indices)), "--out", folder,
             "--format", "npy,foreground" + ",uncertainty" * calibrated, *room, ok=(0, 5))
        index = load_maps(folder)[1].tolist()
        with open(folder / "records.csv", newline="", encoding="utf-8") as file:
            status = {int(row["record"]): row["status"] for row in csv.DictReader(file)}
        arrays = {name: np.load(folder / f"{name}.npy")
                  for name in ("thresholded", "share", *["deviation"] * calibrated)}
    return {i: (status[i], {name: np.nan_to_num(values[k]) for name, values in arrays.items()})
            for k, i in enumerate(index)}


def map_block(model: ReportModel, scored: Scores, at: int, status: str, maps: Map) -> Block:
    """Returns a block with a thresholded map, its uncertainty and its warnings. `at` is the
    position of the record in `scored`."""
    interval_m = scored["lateral_interval_90_m"][at]
    stated = (UNCALIBRATED if "deviation" not in maps else "no lateral interval"
              if np.isnan(interval_m) else f"lateral interval ±{100 * interval_m:.0f} cm (90 %)")
    out = {"name": model.title, "map": packed(maps["thresholded"], 1e-3, "<u2"),
           "share": packed(maps["share"], 0.005, "u1"),
           "scores": score_text(scored, at), "stated": stated}
    warnings = [*([f"differs from the training records: {scored.warnings[at]}"]
                  if scored.warnings[at] else []), *([status] if status != "ok" else [])]
    out |= {"warning": "; ".join(warnings)} if warnings else {}
    return out | ({"deviation": packed(maps["deviation"], 0.01, "u1")} if "deviation" in maps
                  else {})


def score_text(scored: Scores, at: int) -> str:
    """Returns the IoU and the errors of a map as text."""
    parts = [f"IoU {scored['iou'][at]:.2f}"]
    parts += [f"{name} {100 * scored[metric][at]:.1f} cm"
              for name, metric in (("lateral error", "lateral_m"), ("depth error", "depth_mae_m"))
              if not np.isnan(scored[metric][at])]
    return ", ".join(parts) + "."


def map_remarks(block: Block, named: bool) -> str:
    """Returns the uncertainty and the warnings of a map as text. If `named` is true, the text
    contains the name of the model."""
    model = block["name"] if named else "Model"
    return f"{model}: {block['stated']}. " + (f"{model}: warning: {block['warning']}. "
                                              if "warning" in block else "")


def median_record(models: Sequence[ReportModel], indices: set[int]) -> int | None:
    """Returns the index of the most typical record: the one with an IoU rank closest to the median
    rank in all models with the same inputs as the first model. Returns None if there are no
    records."""
    distance: dict[int, int] = {}
    for model in models:
        order = [index for index in model.first.order
                 if index in indices] if model.sensors == models[0].sensors else []
        for place, index in enumerate(order):
            distance[index] = max(distance.get(index, 0), abs(place - len(order) // 2))
    return min(sorted(distance), key=lambda index: distance[index]) if distance else None


def select_records(run: str, models: Sequence[ReportModel], room: Sequence[str],
                   failing: Sequence[int]) -> tuple[list[Block], list[Block], list[Block]]:
    """Returns three lists of records. The first contains the median record with the label "person"
    and the median record with any other label, with the maps of all models. The second contains the
    worst, median and best records of the first model. The third contains its failing records that
    are not in the other lists."""
    first, main, captions = models[0].first, [], []
    common = set.intersection(*(set(model.first.index.tolist()) for model in models))
    for person in (True, False):
        indices = {index for index, label in zip(first.index.tolist(), first.labels)
                   if (label == "person") == person and index in common}
        if (index := median_record(models, indices)) is not None:
            main.append(index)
            captions.append(f"Of {len(indices)} records of this kind, this one is closest to the "
                            "median IoU of the models with the same inputs as the first model.")
    order = first.order
    ends = {title: order[int(share * (len(order) - 1))]
            for title, share in (("Worst", 0), ("Median", 0.5), ("Best", 1))}
    by_all = record_blocks(run, main, models, [model.first for model in models], room)
    by_first = record_blocks(run, [*ends.values(), *failing], models[:1], [first], room)
    return ([by_all[index] | {"caption": caption} for index, caption in zip(main, captions)],
            [by_first[index] | {"title": f"{title}: {by_first[index]['title']}"}
             for title, index in ends.items()],
            [by_first[index] for index in failing if index not in [*main, *ends.values()]])
