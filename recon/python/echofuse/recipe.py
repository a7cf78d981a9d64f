# SPDX-License-Identifier: MIT
"""A bench as a recipe: tracks of a training and a test run that anybody can make again, with
checksums of their records."""
from __future__ import annotations

import argparse
import hashlib
import os
import pathlib
import sys
import tomllib
from typing import Any

from . import table as tables
from . import tmf8820
from . import run as runs
from .methods import BenchError, call, method, version


def checksum(path: str | pathlib.Path) -> str:
    """SHA-256 of what the sensors of a run hold, record by record: counts, profiles as stored,
    depths in millimetres."""
    total = hashlib.sha256()
    with runs.open(path) as run:
        total.update(run.spd.astype("<u4").tobytes())
        total.update(run.stored_radar().astype("<f4").tobytes())
        for row in range(len(run)):
            total.update(run.depth_mm(row).astype("<u2").tobytes())
    return total.hexdigest()


def made(track: dict[str, Any], part: str, folder: pathlib.Path,
         data: pathlib.Path | None) -> pathlib.Path | None:
    """The run `part` ("train", "test") of a track, made unless it is there. None: its data are not
    there. Raises BenchError for records of another checksum."""
    out = folder / f"{track['name']}-{part}.sqlite"
    if not out.exists():
        plan = track.get(part, {})
        if "shape" in track:
            shape = data / f"{track['shape']}.json.gz" if data else None
            if shape is None or not shape.exists():
                return None
            meshes = [shape.with_name(f"{track['shape']}{kind}") for kind in (".stl", ".obj")]
            mesh = next((mesh for mesh in meshes if mesh.exists()), None)
            tmf8820.make("rendered" if part == "train" else "measured", shape, mesh,
                         plan.get("records", 0), plan.get("seed", 1), out)
        else:
            words = [word for setting in track["settings"] for word in ("--set", setting)]
            call("echofuse-sim", "dataset", "-q", "--out", out, "--records", plan["records"],
                 "--seed", plan["seed"], *words)
    wanted = track.get(f"{part}_sha256")
    if wanted and checksum(out) != wanted:
        raise BenchError(
            f"{out}: its records are not those of the recipe (sha256 {checksum(out)}; expected "
            f"{wanted})")
    return out


def add_command(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--recipe", type=pathlib.Path,
                        default=pathlib.Path(__file__).with_name("echofuse-bench-2.toml"),
                        help="TOML file (default: echofuse-bench-2)")
    parser.add_argument("--runs", type=pathlib.Path, default=pathlib.Path("bench-runs"),
                        help="folder of the runs, made unless there")
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("ECHOFUSE_DATA"),
                        help="folder of the public data of real photons; without it that track is "
                             "left out")
    parser.add_argument("--methods", nargs="*", default=[], metavar="METHOD",
                        help="methods of your own, beside the recipe's")
    parser.add_argument("--tracks", nargs="+", help="some of them")
    parser.add_argument("--checksums", action="store_true",
                        help="print those of the runs, and measure nothing")


def run(args: argparse.Namespace) -> None:
    recipe = tomllib.loads(args.recipe.read_text())
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
        train, test = (made(track, part, args.runs, data) for part in ("train", "test"))
        if train is None or test is None:
            print(f"echofuse-bench: track {track['name']} left out: --data has no "
                  f"{track['shape']}.json.gz", file=sys.stderr)
            continue
        if args.checksums:
            for part, path in (("train", train), ("test", test)):
                print(f'{track["name"]}: {part}_sha256 = "{checksum(path)}"')
            continue
        titles[track["name"]] = track["title"]
        methods = [method(name) for name in (*track.get("methods", recipe["methods"]),
                                             *args.methods)]
        cells += tables.pareto_cells(train, test, methods, seeds=args.seeds or recipe["seeds"],
                                     axis=track["name"])
    tables.fill(table, cells, jobs=args.jobs, part=args.part, quiet=args.quiet)
    if args.markdown:
        for name, title in titles.items():
            print(f"\n**{title}**\n\n{tables.markdown(tables.means(table, name))}")
    if args.figure:
        from . import plot

        for name in titles:
            out = pathlib.Path(args.figure)
            plot.pareto(args.out,
                        axis=name).savefig(out.with_name(f"{out.stem}-{name}{out.suffix}"))
