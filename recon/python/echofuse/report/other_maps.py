# SPDX-License-Identifier: MIT
"""Adds maps computed by other programs to a report. `echofuse-recon evaluate --maps` scores these
maps on the records of the first model."""
from __future__ import annotations

import pathlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import metrics, runs
from ..models.maps import load_maps
from . import tables
from .blocks import Block, packed, paragraph, pictures
from .records import measured, record_blocks, score_text
from .scores import Evaluation, ReportModel, ReportError, evaluate, means_of

__all__ = ["OtherMaps", "named_folders"]


def named_folders(arguments: Sequence[str]) -> dict[str, str]:
    """Parses NAME=FOLDER or FOLDER into {name: folder}. Raises ReportError for a duplicate name."""
    out: dict[str, str] = {}
    for argument in arguments:
        name, equals, folder = argument.partition("=")
        if not equals or "/" in name:
            name, folder = pathlib.Path(argument).resolve().name, argument
        if name in out:
            raise ReportError(f"--maps {argument}: the name {name} is already in use; give "
                              "NAME=FOLDER", 2)
        out[name] = folder
    return out


class OtherMaps:
    """Scores and maps of the given folders and, if there is a model, of the first model."""

    def __init__(self, folders: dict[str, str], run: str, models: Sequence[ReportModel],
                 room: Sequence[str]) -> None:
        self.folders, self.run, self.models, self.room = folders, run, models[:1], room
        self.evaluation: Evaluation = evaluate([model.files[0] for model in self.models], run, room,
                                               list(folders.values()))
        with runs.open(run) as opened:
            self.scene = self._scene(opened)
        self.names = [*folders, *(model.title for model in self.models)]

    @property
    def span(self) -> tuple[float, float]:
        """Limits of the depth scale of the maps, m."""
        return self.evaluation.span(float(self.scene.background_m.max()), self.scene.far_m)

    @property
    def verdict(self) -> str:
        parts = [f"{name}: IoU {tables.plus_minus(means_of(scores.result['metrics']), 'iou')}"
                 for name, scores in zip(self.names, self.evaluation.scores)]
        return f"On {len(self.evaluation.scores[0].index)} records: {'; '.join(parts)}."

    def table(self) -> list[Block]:
        result = self.evaluation.result
        records, rows, gains = result["records"], [], []
        paired = [{}, *(pair["metrics"] for pair in result["paired"])]
        for name, scores, gain in zip(self.names, self.evaluation.scores, paired):
            missing = records - scores.result["answered"]
            rows.append(tables.Row(name + f" ({missing} maps missing)" * bool(missing),
                                   means_of(scores.result["metrics"]), scores))
            gains.append((name, gain))
        rows += tables.rows_of([], result)
        return [tables.metrics_table(rows, f"{records} records; mean ± standard error over maps; "
                                           "a missing map counts as an empty map"),
                *tables.differences_table(self.names[0], gains[1:]),
                *([paragraph(result["note"] + ".")] if result["note"] else [])]

    def record(self) -> Block | None:
        """Returns the record with the median IoU among the maps in the first folder, together with
        all maps of this record. Returns None if there are no maps because all folders contain PNG
        files."""
        order = self.evaluation.scores[0].order
        index = order[len(order) // 2]
        with runs.open(self.run) as run:
            out = measured(run[np.flatnonzero(run.index == index)])
        if self.models:
            scores = self.evaluation.scores[len(self.folders)]
            out = record_blocks(self.run, [index], self.models, [scores], self.room)[index]
        model_maps = out["maps"]
        out["maps"] = []
        for (name, folder), scores in zip(self.folders.items(), self.evaluation.scores):
            if (pathlib.Path(folder) / "maps.npy").exists():
                maps, indices = load_maps(folder)
                found = maps[indices == index]
                drawn = found if len(found) else np.zeros((1, *maps.shape[1:]), np.float32)
                at = int(np.flatnonzero(scores.index == index)[0])
                out["maps"].append(map_block(name, drawn, self.scene, score_text(scores, at)))
        out["maps"] += model_maps
        out["caption"] = (f"Of {len(order)} records, this one has the median IoU of "
                          f"{self.names[0]}.")
        return out if out["maps"] else None

    def _scene(self, run: runs.Run) -> metrics.Scene:
        for model in self.models:
            facts = model.facts[0]
            size = int(facts["0/scene/map_size"])
            return metrics.Scene(model.tensors["0/scene/background_m"].reshape(size, size),
                                 float(facts["0/scene/foreground_depth_m"]),
                                 float(facts["0/scene/map_half_tangent"]),
                                 float(facts["0/scene/map_z_max_m"]))
        return metrics.Scene.of_maps(run.maps(run.valid["depth"]))

    def blocks(self, at: int, record: Block | None) -> list[Block]:
        """Returns the tables, and pictures of `record`, which has the position `at` in the list of
        records of the page."""
        if record is None:
            return self.table()
        show = ["truth", *(f"{what} {k}" for k in range(len(record["maps"]))
                           for what in ("map", "error"))]
        return [*self.table(), pictures(at, show, record["caption"], title=record["title"])]


def map_block(name: str, depth_m: NDArray[np.float32], scene: metrics.Scene, scores: str) -> Block:
    """Returns a block with a map [1, N, N], thresholded as in `evaluate`."""
    share = scene.share(depth_m)[0]
    drawn = np.where(share > 0.5, scene.clipped(depth_m)[0], scene.background_m)
    return {"name": name, "map": packed(drawn, 1e-3, "<u2"), "share": packed(share, 0.005, "u1"),
            "scores": scores, "stated": "no uncertainty"}
