# SPDX-License-Identifier: MIT
"""The bench's track of real photons: from the public files of a TMF8820 to runs of its nine zones
and of their sum. Each NAME.json.gz with a mesh is a test set. Training records are rendered by
zones that are fitted to a few poses. No test set contains these poses."""
from __future__ import annotations

import pathlib
from collections.abc import Iterator
from typing import Any, NamedTuple

from . import tmf8820, zone_fit


class Part(NamedTuple):
    """A training run and a test run: all zones, or their sum."""

    shape: str
    zones: str  # "zones" or "sum"
    train: pathlib.Path
    test: pathlib.Path


def mesh_of(data: pathlib.Path, shape: str) -> pathlib.Path | None:
    """NAME.stl or NAME.obj; NAME_random is the same object."""
    names = [name + end for name in (shape, shape.removesuffix("_random"))
             for end in (".stl", ".obj")]
    return next((path for name in names if (path := data / name).exists()), None)


def shapes_in(data: pathlib.Path) -> list[str]:
    """Shapes with records of a detector with zones, and a mesh."""
    names = (path.name.removesuffix(".json.gz") for path in sorted(data.glob("*.json.gz")))
    return [name for name in names if mesh_of(data, name)]


def made(track: dict[str, Any], folder: pathlib.Path, data: pathlib.Path) -> Iterator[Part]:
    """The runs of the track, made unless they are there."""
    fit, source = track["fit"], data / f"{track['fit']['shape']}.json.gz"
    name, plan = track["name"], track["train"]
    trains = {value: folder / f"{name}-{value}-train.sqlite" for value in ("zones", "sum")}
    path = folder / f"{name}-fit.json"
    if not path.exists():
        mesh = mesh_of(data, fit["shape"])
        if mesh is None:
            raise ValueError(f"{data}: no mesh of {fit['shape']}")
        tmf8820.fitted(source, mesh, fit["poses"]).save(path)
    zones = zone_fit.load(path)

    def write(runs: dict[str, pathlib.Path], make: Any, label: str, notes: str) -> None:
        if all(run.exists() for run in runs.values()):
            return
        counts, maps = make()
        for value, run in runs.items():
            if not run.exists():
                tmf8820.write(run, counts, maps, zones if value == "zones" else None, label, notes)

    reference = tmf8820.read_measured(source)[1].mean(0)
    write(trains, lambda: tmf8820.rendered(zones, reference, plan["records"], plan["seed"]),
          "solid", "rendered")
    for shape in shapes_in(data):
        tests = {value: folder / f"{name}-{value}-{shape}.sqlite" for value in trains}
        without = fit["poses"] if shape == fit["shape"] else ()
        mesh = mesh_of(data, shape)
        assert mesh is not None  # shapes_in
        write(tests, lambda shape=shape, mesh=mesh, without=without: tmf8820.measured(
            data / f"{shape}.json.gz", mesh, without), shape, "measured")
        for value in trains:
            yield Part(shape, value, trains[value], tests[value])
