# SPDX-License-Identifier: MIT
"""Records as a report shows them: what was measured, the truth, and the maps that `echofuse-recon
reconstruct` makes."""
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
from .scores import Mode, Scores

UNCALIBRATED = (
    "no uncertainty: needs a model with sensor inputs and an uninterrupted training on at least 50 "
    "records")
# [N, N] each: thresholded (metres, 0: no return), share, and deviation if stated
Map = dict[str, NDArray[np.float32]]


def shown(run: str, wanted: Sequence[int], modes: Sequence[Mode] = (),
          scores: Sequence[Scores] = (),
          room: Sequence[str] = ()) -> dict[int, Block]:
    """Records of these indices by their index, with the map of each mode's first model, whose
    scores are given."""
    with runs.open(run) as whole:
        rows = np.flatnonzero(np.isin(whole.index, wanted)).tolist()
        out = {int(whole.index[row]): measured(whole[row:row + 1]) for row in rows}
    for mode, scored in zip(modes if out else (), scores):
        for index, (status, one) in reconstructed(mode, run, list(out), room).items():
            at = int(np.flatnonzero(scored.index == index)[0])
            out[index]["body_m"] = short(scored["range_m"][at])
            out[index]["maps"].append(map_of(mode, scored, at, status, one))
    return out


def measured(one: runs.Run) -> Block:
    """Block of one record: title, truth, clicks [bins] and power [points], at true ranges; "body_m"
    and "maps" are to come. One that cannot be read has none of them, and says so."""
    (_, run, faults), = blocks(one)
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
    """[..., points], at least 60 dB below the highest: what is less is noise that was taken off, or
    none."""
    power = power.astype(float)
    floor = np.maximum(1e-6 * power.max(-1, keepdims=True), 1e-30)
    return np.asarray(10 * np.log10(np.maximum(power, floor)))


def half_tangent(run: runs.Run) -> float:
    axis = run.axes.get("map_x")
    return round(axis.step * axis.count / 2, 9) if axis else 0.55


def reconstructed(mode: Mode, run: str, wanted: Sequence[int],
                  room: Sequence[str]) -> dict[int, tuple[str, Map]]:
    """Status and map by the record's index, of the mode's first model."""
    calibrated = bool(mode.facts[0]["0/calibrated"])
    with tempfile.TemporaryDirectory(prefix="echofuse-report-") as scratch:
        folder = pathlib.Path(scratch)
        call("echofuse-recon", "-q", "reconstruct", mode.files[0], run, "--rows",
             ",".join(map(str, wanted)), "--out", folder,
             "--format", "npy,foreground" + ",uncertainty" * calibrated, *room, ok=(0, 5))
        index = load_maps(folder)[1].tolist()
        with open(folder / "records.csv", newline="", encoding="utf-8") as file:
            status = {int(row["record"]): row["status"] for row in csv.DictReader(file)}
        arrays = {name: np.load(folder / f"{name}.npy")
                  for name in ("thresholded", "share", *["deviation"] * calibrated)}
    return {i: (status[i], {name: np.nan_to_num(values[k]) for name, values in arrays.items()})
            for k, i in enumerate(index)}


def map_of(mode: Mode, scored: Scores, at: int, status: str, made: Map) -> Block:
    """Block of a record's thresholded map, with the statements of the model and of `reconstruct`
    about it."""
    within = scored["lateral_interval_90_m"][at]
    stated = (UNCALIBRATED if "deviation" not in made else "the place is not known"
              if np.isnan(within) else f"within {100 * within:.0f} cm sideways (90 %)")
    out = {"name": mode.title, "map": packed(made["thresholded"], 1e-3, "<u2"),
           "share": packed(made["share"], 0.005, "u1"),
           "scores": words_of(scored, at), "stated": stated}
    warnings = [*([f"unlike the training: {scored.warnings[at]}"] if scored.warnings[at] else []),
                *([status] if status != "ok" else [])]
    out |= {"warning": "; ".join(warnings)} if warnings else {}
    return out | ({"deviation": packed(made["deviation"], 0.01, "u1")} if "deviation" in made
                  else {})


def words_of(scored: Scores, at: int) -> str:
    """Scores of a record's map."""
    words = [f"IoU {scored['iou'][at]:.2f}"]
    words += [f"{name} {100 * scored[metric][at]:.1f} cm"
              for name, metric in (("lateral error", "lateral_m"), ("depth error", "depth_mae_m"))
              if not np.isnan(scored[metric][at])]
    return ", ".join(words) + "."


def said_of(made: Block, named: bool) -> str:
    """Sentences of the model about its map; named: one of several models."""
    who = made["name"] if named else "The model"
    return f"{who} states: {made['stated']}. " + (f"{who} warns: {made['warning']}. "
                                                  if "warning" in made else "")


def middle_record(modes: Sequence[Mode], wanted: set[int]) -> int | None:
    """The record nearest to the middle of the order of each model with the first one's inputs: no
    picked cherries."""
    off: dict[int, int] = {}
    for mode in modes:
        order = [index for index in mode.first.order
                 if index in wanted] if mode.takes == modes[0].takes else []
        for place, index in enumerate(order):
            off[index] = max(off.get(index, 0), abs(place - len(order) // 2))
    return min(sorted(off), key=lambda index: off[index]) if off else None


def chosen(run: str, modes: Sequence[Mode], room: Sequence[str],
           failing: Sequence[int]) -> tuple[list[Block], list[Block], list[Block]]:
    """Record of median quality of person and letters, by all modes; then of the first one the
    worst, median and best; and those that fail."""
    first, main, captions = modes[0].first, [], []
    common = set.intersection(*(set(mode.first.index.tolist()) for mode in modes))
    for person in (True, False):
        wanted = {index for index, label in zip(first.index.tolist(), first.labels)
                  if (label == "person") == person and index in common}
        if (index := middle_record(modes, wanted)) is not None:
            main.append(index)
            captions.append(
                f"Of all {len(wanted)} records of this kind the one nearest to the median IoU of "
                "each model with these inputs.")
    order = first.order
    ends = {what: order[int(share * (len(order) - 1))]
            for what, share in (("Worst", 0), ("Median", 0.5), ("Best", 1))}
    by_all = shown(run, main, modes, [mode.first for mode in modes], room)
    by_first = shown(run, [*ends.values(), *failing], modes[:1], [first], room)
    return ([by_all[index] | {"caption": caption} for index, caption in zip(main, captions)],
            [by_first[index] | {"title": f"{what}: {by_first[index]['title']}"}
             for what, index in ends.items()],
            [by_first[index] for index in failing if index not in [*main, *ends.values()]])
