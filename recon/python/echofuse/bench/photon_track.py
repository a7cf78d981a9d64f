# SPDX-License-Identifier: MIT
"""Creates the runs of the benchmark track that uses measured photon counts. Converts public TMF8820
files into runs with nine zones, and into runs with a single histogram, the sum of all zones. Each
shape (NAME.json.gz) that has a mesh is a test set. The training records are rendered with zones
fitted to a few poses. These poses are excluded from the test sets."""
from __future__ import annotations

import pathlib
from collections.abc import Iterator
from typing import Any, NamedTuple

from . import zone_fit

__all__ = ["RunPair", "make_runs", "shapes_in"]


class RunPair(NamedTuple):
    """A training run, and a run for testing the models trained on it."""

    shape: str
    zones: str  # "zones", "sum" (sum of all zones), or "1" (single pixel)
    train: pathlib.Path
    test: pathlib.Path


def mesh_of(data: pathlib.Path, shape: str) -> pathlib.Path | None:
    """Returns the mesh file of a shape (NAME.stl or NAME.obj), or None if it is missing. The shape
    NAME_random uses the mesh of NAME."""
    names = [name + end for name in (shape, shape.removesuffix("_random"))
             for end in (".stl", ".obj")]
    return next((path for name in names if (path := data / name).exists()), None)


def shapes_in(data: pathlib.Path) -> list[str]:
    """Returns the names of the shapes that have both records and a mesh."""
    names = (path.name.removesuffix(".json.gz") for path in sorted(data.glob("*.json.gz")))
    return [name for name in names if mesh_of(data, name)]


def make_runs(track: dict[str, Any], folder: pathlib.Path, data: pathlib.Path) -> Iterator[RunPair]:
    """Generates the missing runs of the track, and yields all training and test pairs."""
    # tmf8820 is imported here, because `python3 -m echofuse.bench.tmf8820` would import it twice.
    from . import tmf8820

    fit, source = track["fit"], data / f"{track['fit']['shape']}.json.gz"
    name, plan = track["name"], track["train"]
    trains = {value: folder / f"{name}-{value}-train.sqlite" for value in ("zones", "sum")}
    path = folder / f"{name}-fit.json"
    if not path.exists():
        mesh = mesh_of(data, fit["shape"])
        if mesh is None:
            raise ValueError(f"{data}: the mesh of {fit['shape']} is missing (expected a .stl or "
                             ".obj file)")
        tmf8820.fit_to_poses(source, mesh, fit["poses"]).save(path)
    zones = zone_fit.load(path)

    def write(runs: dict[str, pathlib.Path], make: Any, label: str, notes: str) -> None:
        if all(run.exists() for run in runs.values()):
            return
        counts, maps = make()
        for value, run in runs.items():
            if not run.exists():
                tmf8820.write(run, counts, maps, zones if value == "zones" else None, label, notes)

    reference = tmf8820.read_measured(source)[1].mean(0)
    write(trains, lambda: tmf8820.render_records(zones, reference, plan["records"], plan["seed"]),
          "solid", "rendered")
    for shape in shapes_in(data):
        tests = {value: folder / f"{name}-{value}-{shape}.sqlite" for value in trains}
        excluded = fit["poses"] if shape == fit["shape"] else ()
        mesh = mesh_of(data, shape)
        assert mesh is not None  # shapes_in() returns only shapes with a mesh
        write(tests, lambda shape=shape, mesh=mesh, excluded=excluded: tmf8820.measured_records(
            data / f"{shape}.json.gz", mesh, excluded), shape, "measured")
        for value in trains:
            yield RunPair(shape, value, trains[value], tests[value])
