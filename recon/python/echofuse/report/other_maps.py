# SPDX-License-Identifier: MIT
"""Maps of other programs in a report: judged by `echofuse-recon evaluate --maps`, on the same
records as the first model."""
from __future__ import annotations

import pathlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import metrics, runs
from ..models.maps import load_maps
from . import tables
from .blocks import Block, packed, paragraph, pictures
from .records import measured, shown, words_of
from .scores import Judged, Mode, ReportError, evaluated, means_of


def named(given: Sequence[str]) -> dict[str, str]:
    """NAME=FOLDER or FOLDER each, as {name: folder}. Raises ReportError for a name given twice."""
    out: dict[str, str] = {}
    for one in given:
        name, equals, folder = one.partition("=")
        if not equals or "/" in name:
            name, folder = pathlib.Path(one).resolve().name, one
        if name in out:
            raise ReportError(f"--maps {one}: the name {name} is there; give NAME=FOLDER", 2)
        out[name] = folder
    return out


class OtherMaps:
    """Maps of these folders, and of the first model if there is one."""

    def __init__(self, folders: dict[str, str], run: str, modes: Sequence[Mode],
                 room: Sequence[str]) -> None:
        self.folders, self.run, self.modes, self.room = folders, run, modes[:1], room
        self.judged: Judged = evaluated([mode.files[0] for mode in self.modes], run, room,
                                        list(folders.values()))
        with runs.open(run) as opened:
            self.scene = self._scene(opened)
        self.names = [*folders, *(mode.title for mode in self.modes)]

    @property
    def span(self) -> tuple[float, float]:
        """Depths of the page's maps."""
        return self.judged.span(float(self.scene.background_m.max()), self.scene.far_m)

    @property
    def verdict(self) -> str:
        means = [means_of(one.told["metrics"]) for one in self.judged.scores]
        parts = [f"{name}: IoU {tables.plus_minus(one, 'iou')}"
                 for name, one in zip(self.names, means)]
        return f"On {len(self.judged.scores[0].index)} records: {'; '.join(parts)}."

    def table(self) -> list[Block]:
        records, rows, gains = self.judged.told["records"], [], []
        paired = [{}, *(one["metrics"] for one in self.judged.told["paired"])]
        for name, one, gain in zip(self.names, self.judged.scores, paired):
            lacking = records - one.told["answered"]
            rows.append(tables.Row(name + f" ({lacking} not answered)" * bool(lacking),
                                   means_of(one.told["metrics"]), one))
            gains.append((name, gain))
        rows += tables.rows_of([], self.judged.told)
        return [tables.metrics_table(rows, f"{records} records; mean ± standard error over maps; a "
                                           "record that is not answered counts as an empty map"),
                *tables.differences_table(self.names[0], gains[1:]),
                *([paragraph(self.judged.told["note"] + ".")] if self.judged.told["note"] else [])]

    def record(self) -> Block | None:
        """The record of median IoU of the first folder, with the maps of all; none of folders of
        PNGs."""
        order = self.judged.scores[0].order
        index = order[len(order) // 2]
        with runs.open(self.run) as run:
            out = measured(run[np.flatnonzero(run.index == index)])
        if self.modes:
            model = self.judged.scores[len(self.folders)]
            out = shown(self.run, [index], self.modes, [model], self.room)[index]
        own = out["maps"]
        out["maps"] = []
        for (name, folder), one in zip(self.folders.items(), self.judged.scores):
            if (pathlib.Path(folder) / "maps.npy").exists():
                maps, of = load_maps(folder)
                found = maps[of == index]
                made = found if len(found) else np.zeros((1, *maps.shape[1:]), np.float32)
                at = int(np.flatnonzero(one.index == index)[0])
                out["maps"].append(block_of(name, made, self.scene, words_of(one, at)))
        out["maps"] += own
        out["caption"] = f"Of {len(order)} records the one of median IoU by {self.names[0]}."
        return out if out["maps"] else None

    def _scene(self, run: runs.Run) -> metrics.Scene:
        for mode in self.modes:
            facts = mode.facts[0]
            size = int(facts["0/scene/map_size"])
            return metrics.Scene(mode.tensors["0/scene/background_m"].reshape(size, size),
                                 float(facts["0/scene/foreground_depth_m"]),
                                 float(facts["0/scene/map_half_tangent"]),
                                 float(facts["0/scene/map_z_max_m"]))
        return metrics.Scene.of_maps(run.maps(run.valid["depth"]))

    def blocks(self, at: int, record: Block | None) -> list[Block]:
        """at: place of the record in the page's list."""
        if record is None:
            return self.table()
        show = ["truth", *(f"{what} {k}" for k in range(len(record["maps"]))
                           for what in ("map", "error"))]
        return [*self.table(), pictures(at, show, record["caption"], title=record["title"])]


def block_of(name: str, one: NDArray[np.float32], scene: metrics.Scene, scores: str) -> Block:
    """A map [1, N, N] as the judge thresholds it."""
    share = scene.share(one)[0]
    drawn = np.where(share > 0.5, scene.clipped(one)[0], scene.background_m)
    return {"name": name, "map": packed(drawn, 1e-3, "<u2"), "share": packed(share, 0.005, "u1"),
            "scores": scores, "stated": "no uncertainty"}
