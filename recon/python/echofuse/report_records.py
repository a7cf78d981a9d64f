# SPDX-License-Identifier: MIT
"""Records as a report shows them: what was measured, the truth, and the maps that `echofuse-recon reconstruct` makes."""
from __future__ import annotations

import pathlib
import tempfile
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import derive
from . import run as runs
from .blocks import blocks
from .maps import load_maps
from .methods import call
from .report_blocks import Block, packed, short
from .report_scores import Judged, Mode, Scores

UNCALIBRATED = "no uncertainty: only a model of a sensor, trained to its end on 50 records or more, states its errors"
Map = tuple[NDArray[np.float32], NDArray[np.float32] | None]  # [N, N] metres as it is made, 0: no return; its deviation


def shown(run: str, wanted: Sequence[int], modes: Sequence[Mode] = (), scores: Sequence[Scores] = (), judged: Judged | None = None,
          room: Sequence[str] = ()) -> dict[int, Block]:
    """Records of these indices by their index, with the map of each mode's first model, whose scores are given."""
    with runs.open(run) as whole:
        rows = np.flatnonzero(np.isin(whole.index, wanted)).tolist()
        out = {int(whole.index[row]): measured(whole.rows(row, row + 1)) for row in rows}
    for path in whole.files if modes else []:
        with runs.open(path) as part:
            here = part.index[np.isin(part.index, wanted)].tolist()
        with tempfile.TemporaryDirectory(prefix="echofuse-report-") as scratch:
            few = derive.only(path, pathlib.Path(scratch) / "few.sqlite", here) if here else None
            maps = [reconstructed(mode, few, pathlib.Path(scratch) / str(k), room) for k, mode in enumerate(modes)] if few else []
        for mode, made, scored in zip(modes, maps, scores):
            for index, one in made.items():
                at = int(np.flatnonzero(scored.index == index)[0])
                out[index]["body_m"] = short(scored["range_m"][at])
                out[index]["maps"].append(map_of(mode, scored, at, judged, one))
    return out


def measured(one: runs.Run) -> Block:
    """Block of one record: title, truth, clicks [bins] and power [points], at true ranges; "body_m" and "maps" are to come.
    One that cannot be read has none of them, and says so."""
    (_, run, faults), = blocks(one)
    truth = run.maps()[0] if "depth_x" in run.axes else np.zeros((64, 64))
    out: Block = {"title": ", ".join([run.labels[0] or "no label", f"record {run.index[0]}", *faults.values()]), "half_tangent": half_tangent(run),
                  "truth": packed(truth, 1e-3, "<u2"), "body_m": None, "maps": []}
    for sensor, axis in (("spd", run.axes.get("spd")), ("radar", run.power_axis)):
        out[sensor] = {"start": axis.start, "step": axis.step, "count": axis.count} if axis else {"start": 0, "step": 1, "count": 0}
    if run.valid["spd"][0]:
        out["spd"]["clicks"] = [*map(short, run.photons()[0])]
    if run.valid["radar"][0]:
        out["radar"]["db"] = [*map(short, decibels(run.power()[0]))]
    return out


def decibels(power: NDArray[np.float32]) -> NDArray[np.float64]:
    """[..., points], at least 60 dB below the highest: what is less is noise that was taken off, or none."""
    power = power.astype(float)
    return 10 * np.log10(np.maximum(power, np.maximum(1e-6 * power.max(-1, keepdims=True), 1e-30)))


def half_tangent(run: runs.Run) -> float:
    axis = run.axes.get("map_x")
    return round(axis.step * axis.count / 2, 9) if axis else 0.55


def reconstructed(mode: Mode, run: pathlib.Path, folder: pathlib.Path, room: Sequence[str]) -> dict[int, Map]:
    """By the record's index, of the mode's first model."""
    calibrated = bool(mode.facts[0]["0/calibrated"])
    call("echofuse-recon", "-q", "reconstruct", mode.files[0], run, "--out", folder, "--format", "npy" + ",uncertainty" * calibrated, *room,
         ok=(0, 5))
    maps, index = load_maps(folder)
    deviations = np.load(folder / "deviation.npy") if calibrated else [None] * len(maps)
    return {int(i): (np.nan_to_num(z), deviation) for i, z, deviation in zip(index, maps, deviations)}


def map_of(mode: Mode, scored: Scores, at: int, judged: Judged, made: Map) -> Block:
    """The thresholded map of a record, as it is scored, and what the model says of it."""
    raw, deviation = made
    words = [f"IoU {scored['iou'][at]:.2f}"] + [f"{name} {100 * scored[metric][at]:.1f} cm" for name, metric in
             (("lateral error", "lateral_m"), ("depth error", "depth_mae_m")) if not np.isnan(scored[metric][at])]
    within = scored["lateral_interval_90_m"][at]
    stated = UNCALIBRATED if deviation is None else "the place is not known" if np.isnan(within) else f"within {100 * within:.0f} cm sideways (90 %)"
    out = {"name": mode.title, "map": packed(judged.thresholded(raw), 1e-3, "<u2"), "share": packed(judged.share(raw), 0.005, "u1"),
           "scores": ", ".join(words) + ".", "stated": stated}
    out |= {"warning": f"unlike the training: {scored.warnings[at]}"} if scored.warnings[at] else {}
    return out if deviation is None else out | {"deviation": packed(deviation, 0.01, "u1")}


def said_of(made: Block, named: bool) -> str:
    """Sentences of the model about its map; named: one of several models."""
    who = made["name"] if named else "The model"
    return f"{who} states: {made['stated']}. " + (f"{who} warns: {made['warning']}. " if "warning" in made else "")


def middle_record(modes: Sequence[Mode], wanted: set[int]) -> int | None:
    """The record nearest to the middle of the order of each model with the first one's inputs: no picked cherries."""
    off: dict[int, int] = {}
    for mode in modes:
        order = [index for index in mode.first.order if index in wanted] if mode.takes == modes[0].takes else []
        for place, index in enumerate(order):
            off[index] = max(off.get(index, 0), abs(place - len(order) // 2))
    return min(sorted(off), key=off.__getitem__, default=None)


def chosen(run: str, modes: Sequence[Mode], judged: Judged, room: Sequence[str]) -> tuple[list[Block], list[Block]]:
    """Record of median quality of person and letters, by all modes; then the worst, median and best of the first one."""
    first, main, captions = modes[0].first, [], []
    common = set.intersection(*(set(mode.first.index.tolist()) for mode in modes))
    for person in (True, False):
        wanted = {index for index, label in zip(first.index.tolist(), first.labels) if (label == "person") == person and index in common}
        if (index := middle_record(modes, wanted)) is not None:
            main.append(index)
            captions.append(f"Of all {len(wanted)} records of this kind the one nearest to the median IoU of each model with these inputs.")
    order = first.order
    ends = {what: order[int(share * (len(order) - 1))] for what, share in (("Worst", 0), ("Median", 0.5), ("Best", 1))}
    by_all = shown(run, main, modes, [mode.first for mode in modes], judged, room)
    by_first = shown(run, list(ends.values()), modes[:1], [first], judged, room)
    return ([by_all[index] | {"caption": caption} for index, caption in zip(main, captions)],
            [by_first[index] | {"title": f"{what}: {by_first[index]['title']}"} for what, index in ends.items()])
