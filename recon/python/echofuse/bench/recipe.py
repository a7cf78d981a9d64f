# SPDX-License-Identifier: MIT
"""Runs the benchmark described by a recipe. Each benchmark track has training and test runs. They
are generated locally and verified by checksums."""
from __future__ import annotations

import argparse
import functools
import os
import pathlib
import sys
import tomllib
from typing import Any

from ..runs.programs import ProgramError, UsageError, call
from . import photon_track, table as tables
from .methods import Method, method, version
from .table import checksum

__all__ = ["add_command", "run"]


def make_run(track: dict[str, Any], part: str, folder: pathlib.Path) -> pathlib.Path:
    """Returns the path of the training or test run of a track (`part` is "train" or "test").
    Generates the run if it is missing. Raises ProgramError if its checksum is wrong."""
    out = folder / f"{track['name']}-{part}.sqlite"
    if not out.exists():
        plan = track[part]
        settings = [word for setting in track["settings"] for word in ("--set", setting)]
        call("echofuse-sim", "dataset", "-q", "--out", out, "--records", plan["records"],
             "--seed", plan["seed"], *settings)
    require_checksum(out, track.get(f"{part}_sha256"))
    return out


def require_checksum(path: pathlib.Path, expected: str | None) -> None:
    """Raises ProgramError if the checksum of the sensor data differs from `expected`."""
    if expected and checksum(path) != expected:
        raise ProgramError(f"{path}: the records differ from those of the recipe: their SHA-256 is "
            f"{checksum(path)} (expected {expected})")


def run_pairs(track: dict[str, Any], folder: pathlib.Path,
              data: pathlib.Path | None) -> list[photon_track.RunPair]:
    """Returns the pairs of training and test runs of a track; empty if the track needs a data set
    that the user has not provided."""
    if "fit" not in track:
        return [photon_track.RunPair("", "1", *(make_run(track, part, folder)
                                                for part in ("train", "test")))]
    if data is None or not (data / f"{track['fit']['shape']}.json.gz").exists():
        return []
    pairs = list(photon_track.make_runs(track, folder, data))
    for pair in pairs:
        sums = track.get("sha256", {})
        require_checksum(pair.train, sums.get(f"{pair.zones}-train"))
        require_checksum(pair.test, sums.get(f"{pair.zones}-{pair.shape}"))
    return pairs


@functools.cache
def available_methods(*names: str) -> list[Method]:
    """Returns the methods with the given names, except those that need a library which is not
    installed (PyTorch, scikit-learn). Also searches for methods in the folder examples, which is
    next to the package in the source tree and inside the installed package."""
    package = pathlib.Path(__file__).resolve().parents[1]
    sys.path += [str(package / "examples"), str(package.parent / "examples")]
    out = []
    for name in names:
        try:
            out.append(method(name))
        except UsageError as error:
            if not isinstance(error.__cause__, ModuleNotFoundError):
                raise
            print(f"echofuse-bench: skipped a method of the recipe: {error}", file=sys.stderr)
    return out


def add_command(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--recipe", type=pathlib.Path,
                        default=pathlib.Path(__file__).with_name("echofuse-bench-2.toml"),
                        help="TOML file with the recipe of the benchmark (default: "
                             "echofuse-bench-2)")
    parser.add_argument("--runs", type=pathlib.Path, default=pathlib.Path("bench-runs"),
                        help="folder of the benchmark runs; missing runs are simulated (default: "
                             "bench-runs)")
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("ECHOFUSE_DATA"),
                        help="folder with the public real-photon data (default: $ECHOFUSE_DATA); "
                             "if the folder is missing, the track \"photons\" is skipped")
    parser.add_argument("--methods", nargs="*", default=[], metavar="METHOD",
                        help="methods that are measured in addition to the methods in the recipe")
    parser.add_argument("--tracks", nargs="+", help="tracks of the recipe to run (default: all "
                                                    "tracks)")
    parser.add_argument("--checksums", action="store_true",
                        help="print the checksums of the benchmark runs and exit")


def run(args: argparse.Namespace) -> tables.Table:
    recipe = tomllib.loads(args.recipe.read_text())
    own = [method(name) for name in args.methods]
    args.runs.mkdir(parents=True, exist_ok=True)
    data = pathlib.Path(args.data) if args.data else None
    if data and (data / "spad-tmf8820").is_dir():
        data = data / "spad-tmf8820"
    table = tables.Table(args.out, f"{version()}: {recipe['name']}", args.part)
    cells: list[tables.Cell] = []
    titles: dict[str, str] = {}
    for track in recipe["track"]:
        if args.tracks and track["name"] not in args.tracks:
            continue
        pairs = run_pairs(track, args.runs, data)
        if not pairs:
            print(f"echofuse-bench: skipped track {track['name']}: the folder given by --data does "
                  f"not contain {track['fit']['shape']}.json.gz", file=sys.stderr)
        for pair in pairs:
            if args.checksums:
                for path in (pair.train, pair.test):
                    print(f'{path.stem} = "{checksum(path)}"')
                continue
            axis = " ".join(filter(None, (track["name"], pair.shape)))
            titles[axis] = ": ".join(filter(None, (track["title"], pair.shape)))
            names = track.get(pair.zones) or track.get("methods") or recipe["methods"]
            train, test = tables.existing_run(pair.train), tables.existing_run(pair.test)
            cells += [tables.Cell(axis, pair.zones, estimator, seed, train, test)
                      for estimator in (*available_methods(*names), *own)
                      for seed in range(1, (args.seeds or recipe["seeds"]) + 1)]
    tables.fill(table, cells, jobs=args.jobs, part=args.part, quiet=args.quiet)
    if args.markdown:
        for name, title in titles.items():
            print(f"\n**{title}**\n\n{tables.markdown(tables.means(table, name))}")
    if args.figure:
        from .. import plot

        for name in titles:
            out = pathlib.Path(args.figure)
            plot.pareto(args.out,
                        axis=name).savefig(out.with_name(f"{out.stem}-{name}{out.suffix}"))
    return table
