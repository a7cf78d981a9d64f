# SPDX-License-Identifier: MIT
"""Adds maps computed by other programs to a report. `echofuse-recon evaluate --maps` scores these
maps on the records of the first model."""
from __future__ import annotations

import pathlib
from collections.abc import Sequence

from . import tables
from .blocks import Block
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
    """Scores of the maps in the given folders and, if there is a model, of the first model."""

    def __init__(self, folders: dict[str, str], run: str, models: Sequence[ReportModel],
                 options: Sequence[str]) -> None:
        models = models[:1]
        self.evaluation: Evaluation = evaluate([model.files[0] for model in models], run, options,
                                               list(folders.values()))
        self.names = [*folders, *(model.title for model in models)]

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
                *tables.differences_table(self.names[0], gains[1:])]
