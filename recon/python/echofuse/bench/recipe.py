# SPDX-License-Identifier: MIT
"""A bench as a recipe: tracks of a training and a test run that anybody can make again, with
checksums of their records."""
from __future__ import annotations

import argparse
import functools
import os
import pathlib
import sys
import tomllib
from typing import Any

from ..runs.programs import BenchError, UsageError, call
from . import photon_track, table as tables
from .methods import Method, method, version
from .table import checksum


def made(track: dict[str, Any], part: str, folder: pathlib.Path) -> pathlib.Path:
    """The run `part` ("train", "test") of a track, made unless it is there. Raises BenchError."""
    out = folder / f"{track['name']}-{part}.sqlite"
    if not out.exists():
        plan = track[part]
        words = [word for setting in track["settings"] for word in ("--set", setting)]
        call("echofuse-sim", "dataset", "-q", "--out", out, "--records", plan["records"],
             "--seed", plan["seed"], *words)
    require(out, track.get(f"{part}_sha256"))
    return out


def require(path: pathlib.Path, wanted: str | None) -> None:
    """Raises BenchError for records of another checksum."""
    if wanted and checksum(path) != wanted:
        raise BenchError(
            f"{path}: its records are not those of the recipe (sha256 {checksum(path)}; expected "
            f"{wanted})")


def parts_of(track: dict[str, Any], folder: pathlib.Path,
             data: pathlib.Path | None) -> list[photon_track.Part]:
    """Training and test runs of a track; none if its data are not there."""
    if "fit" not in track:
        return [photon_track.Part("", "1", *(made(track, part, folder)
                                             for part in ("train", "test")))]
    if data is None or not (data / f"{track['fit']['shape']}.json.gz").exists():
        return []
    parts = list(photon_track.made(track, folder, data))
    for part in parts:
        sums = track.get("sha256", {})
        require(part.train, sums.get(f"{part.zones}-train"))
        require(part.test, sums.get(f"{part.zones}-{part.shape}"))
    return parts


@functools.cache
def known(*names: str) -> list[Method]:
    """Methods of the recipe, without the ones that need a missing library (PyTorch, scikit-learn).
    Their examples are next to the package, or in it if it is installed."""
    package = pathlib.Path(__file__).resolve().parents[1]
    sys.path += [str(package / "examples"), str(package.parent / "examples")]
    out = []
    for name in names:
        try:
            out.append(method(name))
        except UsageError as error:
            if not isinstance(error.__cause__, ModuleNotFoundError):
                raise
            print(f"echofuse-bench: left out: {error}", file=sys.stderr)
    return out


def add_command(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--recipe", type=pathlib.Path,
                        default=pathlib.Path(__file__).with_name("echofuse-bench-2.toml"),
                        help="TOML file (default: echofuse-bench-2)")
    parser.add_argument("--runs", type=pathlib.Path, default=pathlib.Path("bench-runs"),
                        help="folder of the runs, made unless there (default: bench-runs)")
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("ECHOFUSE_DATA"),
                        help="folder of the public data of real photons; without it that track is "
                             "left out (default: $ECHOFUSE_DATA)")
    parser.add_argument("--methods", nargs="*", default=[], metavar="METHOD",
                        help="methods of your own, beside the recipe's")
    parser.add_argument("--tracks", nargs="+", help="some of them (default: all)")
    parser.add_argument("--checksums", action="store_true",
                        help="print those of the runs, and measure nothing")


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
        parts = parts_of(track, args.runs, data)
        if not parts:
            print(f"echofuse-bench: track {track['name']} left out: --data has no "
                  f"{track['fit']['shape']}.json.gz", file=sys.stderr)
        for part in parts:
            if args.checksums:
                for path in (part.train, part.test):
                    print(f'{path.stem} = "{checksum(path)}"')
                continue
            axis = " ".join(filter(None, (track["name"], part.shape)))
            titles[axis] = ": ".join(filter(None, (track["title"], part.shape)))
            names = track.get(part.zones) or track.get("methods") or recipe["methods"]
            cells += [tables.Cell(axis, part.zones, how, seed, tables.there(part.train),
                                  tables.there(part.test))
                      for how in (*known(*names), *own)
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
