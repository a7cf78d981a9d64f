# SPDX-License-Identifier: MIT
"""Limits of methods: each of a list under conditions from easy to broken, trained there as well
(matched) or at the base condition alone (shifted). The conditions are in conditions.py."""
from __future__ import annotations

import argparse
import json
import pathlib
import tempfile
from collections.abc import Sequence

import numpy as np

from ..runs.programs import BenchError, UsageError, call
from . import derive, fog, table as tables
from .conditions import BASE, Axis, World, recorded_axes, simulated_axes
from .methods import CONSTANT, Method, Row, method, version

TEST_SEEDS = 1000  # the test records' seed, after that of the training records


class Simulated:
    """Runs of simulated records of any world."""

    def __init__(self, settings: Sequence[str], records: int, test_records: int) -> None:
        self.settings = [word for setting in settings for word in ("--set", setting)]
        self.records, self.test_records = records, test_records
        told = json.loads(call("echofuse-sim", "config", "--json",
                               *self.settings).stdout)["settings"]
        self.base = {key: one["value"] for key, one in told.items()}

    @property
    def of(self) -> str:
        """Source line of a table of such runs."""
        settings = " ".join(word for word in self.settings if word != "--set")
        return (f"{version()}: {self.records} simulated records, {self.test_records} to judge "
                f"by{'; ' * bool(settings)}{settings}")

    def axes(self) -> list[Axis]:
        return simulated_axes(self.base)

    def train(self, world: World, seed: int, folder: pathlib.Path) -> pathlib.Path:
        return self.make(world, round(self.records * world.records), seed, folder / "train.sqlite")

    def test(self, world: World, seed: int, folder: pathlib.Path) -> pathlib.Path:
        return self.make(world, self.test_records, TEST_SEEDS + seed, folder / "test.sqlite")

    def make(self, world: World, records: int, seed: int, out: pathlib.Path) -> pathlib.Path:
        words = [*self.settings, *(word for setting in world.set for word in ("--set", setting))]
        if world.walk_m > 0:
            self._walkers(world, records, seed, out, words)
        elif world.at_x_m is not None:
            x = world.at_x_m
            self._dataset(out, seed, words, [(("person" if i % 8 < 2 else "letter"),
                                              x if i % 2 else -x, None) for i in range(records)])
        else:
            call("echofuse-sim", "dataset", "-q", "--out", out, "--seed", seed, f"--{world.scenes}",
                 records, *words)
        changes = [*world.changes]
        if world.fog_m > 0:
            changes.append(self._in_fog(world, records, seed, out))
        if not changes:
            return out
        changed = derive.copy(out, out.with_name("changed-" + out.name), *changes)
        out.unlink()
        return changed

    def _in_fog(self, world: World, records: int, seed: int, out: pathlib.Path) -> derive.Change:
        """The counts of the same scenes in fog; background and pile-up come behind it."""
        if self.base["spd_dead_time_ps"] > 0:
            raise BenchError("fog: not with a dead time of the detector")
        if self.base["spd_zones"] > 1:
            raise BenchError("fog: not with zones of the detector")
        clear = out.with_name("clear-" + out.name)
        call("echofuse-sim", "dataset", "-q", "--out", clear, "--seed", seed, f"--{world.scenes}",
             records, *self.settings, "--set", "background_counts=0",
             "--set", "pulses_per_window=0")
        counts = fog.seen(derive.read(clear).spd, world.fog_m, self.base, seed)
        clear.unlink()

        def change(target: derive.Records) -> None:
            target.spd = counts

        return change

    def _dataset(self, out: pathlib.Path, seed: int, words: Sequence[str],
                 scenes: Sequence[tuple[str, float, float | None]]) -> None:
        listed = out.with_suffix(".toml")
        listed.write_text("".join(f'[[scene]]\nkind = "{kind}"\nx_m = {x:.9g}\n'
                                  + (f"z_m = {z:.9g}\n" if z is not None else "")
                                  for kind, x, z in scenes))
        call("echofuse-sim", "dataset", "-q", "--out", out, "--seed", seed, *words, "--set",
             f"scenes={listed}")
        listed.unlink()

    def _walkers(self, world: World, records: int, seed: int, out: pathlib.Path,
                 words: Sequence[str]) -> None:
        """A walk is a sum of five short records in which the same people stand, a step further in
        each: photons add up, power is the mean. The true map is that of the middle."""
        if self.base["radar_antennas"] > 1:
            raise BenchError("people who walk: not with several antennas")
        steps, rng = 5, np.random.default_rng(seed)
        x = rng.uniform(-self.base["target_x_m"], self.base["target_x_m"], records)
        z = rng.uniform(self.base["target_z_min_m"], self.base["target_z_max_m"], records)
        turn = rng.uniform(0, 2 * np.pi, records)
        shares = [word for key in ("signal_photons", "background_counts", "radar_frames")
                  if self.base[key] > 0
                  for word in ("--set", f"{key}={max(1, round(self.base[key] / steps))}")]
        sums: list[derive.Records] = []
        with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
            for k, step in enumerate((0, -2, -1, 1, 2)):
                way = world.walk_m * step / steps
                one = pathlib.Path(scratch, f"{k}.sqlite")
                self._dataset(one, seed, [*words, *shares],
                              [(("letter" if i % 4 else "person"), x[i] + way * np.cos(turn[i]),
                                z[i] + way * np.sin(turn[i])) for i in range(records)])
                sums.append(derive.read(one))

            def add_up(target: derive.Records) -> None:
                target.spd = np.sum([one.spd for one in sums], axis=0, dtype=np.uint32)
                target.radar = np.mean([one.radar for one in sums], axis=0, dtype=np.float32)

            derive.copy(pathlib.Path(scratch, "0.sqlite"), out, add_up)


class Recorded:
    """Worlds of two recorded runs, one to train on and one to judge by."""

    def __init__(self, train: str, test: str) -> None:
        self.runs = pathlib.Path(train), pathlib.Path(test)

    @property
    def of(self) -> str:
        return tables.of_runs(*self.runs)

    def axes(self) -> list[Axis]:
        return recorded_axes()

    def train(self, world: World, seed: int, folder: pathlib.Path) -> pathlib.Path:
        changes = [*world.changes, *([derive.fewer(world.records, seed)] if world.records < 1
                                     else [])]
        return derive.copy(self.runs[0], folder / "train.sqlite",
                           *changes) if changes else self.runs[0]

    def test(self, world: World, seed: int, folder: pathlib.Path) -> pathlib.Path:
        return derive.copy(self.runs[1], folder / "test.sqlite",
                           *world.changes) if world.changes else self.runs[1]


def cells(source: Simulated | Recorded, axes: Sequence[Axis], methods: Sequence[Method], *,
          seeds: int,
          quick: bool) -> list[tables.Cell]:
    """Every method with every seed at the base and at all values of the axes."""
    places = [("base", "base", BASE, BASE)]
    for axis in axes:
        for label, world in axis.values.items():
            if world != BASE and (not quick or not axis.quick or label in axis.quick):
                places.append((axis.id, label, world if axis.kind == "matched" else BASE, world))

    def cell(axis: str, label: str, known: World, world: World, how: Method,
             seed: int) -> tables.Cell:
        return tables.Cell(axis, label, how, seed,
                           tables.Source(f"train {key(known, axis, label)} {seed}",
                                         lambda folder: source.train(known, seed, folder)),
                           tables.Source(f"test {key(world, axis, label)} {seed}",
                                         lambda folder: source.test(world, seed, folder)),
                           fallback=known == BASE)

    def key(world: World, axis: str, label: str) -> str:
        return "base" if world == BASE else f"{axis} {label}"

    return [cell(*place, how, seed) for seed in range(1, seeds
                                                      + 1) for place in places for how in methods]


def falls_below(rows: Sequence[Row], axis: Axis) -> dict[str, list[str]]:
    """By method, the first values on the ways from the base to both ends at which its IoU is not
    above that of the best baseline that draws a body (empty room, mean map, nearest record) by more
    than the spread over the seeds; NaN is below."""
    def iou(model: str, inputs: str | None, label: str) -> dict[str, float]:
        at = ("base", "base") if axis.values[label] == BASE else (axis.id, label)
        return {row["seed"]: float(row["iou"]) for row in rows
                if (row["axis"], row["value"], row["model"]) == (*at, model)
                and inputs in (None, row["inputs"])}

    def below(model: str, inputs: str, label: str) -> bool:
        mine, best = iou(model, inputs, label), [iou(name, None, label)
                                                 for name in (*CONSTANT, "nearest")
                                                 if name != model]
        ahead = [value - np.nanmax([0.0, *(one[seed] for one in best if seed in one)])
                 for seed, value in mine.items()]
        return bool(ahead) and not np.mean(ahead) > (np.std(ahead, ddof=1) if len(ahead) > 1 else 0)

    labels = list(axis.values)
    base = labels.index(axis.base)
    out: dict[str, list[str]] = {}
    for model, inputs in dict.fromkeys((row["model"], row["inputs"]) for row in rows):
        if model in CONSTANT:
            continue
        ways: list[Sequence[int]] = [range(base - 1, -1, -1), range(base + 1, len(labels))]
        if below(model, inputs, axis.base):
            ways = [[base]]
        first = [next((labels[k] for k in way if below(model, inputs, labels[k])), None)
                 for way in ways]
        out[model if inputs in ("fused",
                                "-") else f"{model}:{inputs}"] = [
                                    label for label in first if label is not None]
    return out


def add_command(parser: argparse.ArgumentParser) -> None:
    usual = ["nearest", "mean-shape", "factorised-16", "mlp-128-64"]
    parser.add_argument("--methods", nargs="+", metavar="METHOD", default=usual,
                        help=f"default: {' '.join(usual)}")
    parser.add_argument("--axes", nargs="+",
                        help="some of them, as shifted-snr; a wrong one lists all; default: all")
    parser.add_argument("--quick", action="store_true",
                        help="fewer values of each axis; 1000 training and 300 test records")
    parser.add_argument("--records", type=int, help="training records (default 3600)")
    parser.add_argument("--test-records", type=int, help="test records (default 1000)")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE",
                        help="settings of the simulator at the base")
    parser.add_argument("--runs", nargs=2, metavar=("TRAIN", "TEST"),
                        help="recorded runs in place of the simulator")


def run(args: argparse.Namespace) -> tables.Table:
    source: Simulated | Recorded = Recorded(*args.runs) if args.runs else Simulated(
        args.set, args.records or (1000 if args.quick else 3600),
        args.test_records or (300 if args.quick else 1000))
    known = {axis.id: axis for axis in source.axes()}
    unknown = [name for name in args.axes or [] if name not in known]
    if unknown:
        raise UsageError(f"axis {unknown[0]}: expected some of {', '.join(known)}")
    axes = [known[name] for name in args.axes or known]
    names = dict.fromkeys((*CONSTANT, "nearest", *args.methods))  # the baselines always
    methods = [method(name) for name in names]
    table = tables.Table(args.out, source.of, args.part)
    tables.fill(table, cells(source, axes, methods, seeds=args.seeds or 3, quick=args.quick),
               jobs=args.jobs, part=args.part, quiet=args.quiet)
    rows = list(table.rows.values())
    if args.markdown:
        columns = list(falls_below(rows, axes[0]))
        print("| axis | " + " | ".join(f"`{name}`" for name in columns) + " |\n|---" + "|---"
              * len(columns) + "|")
        for axis in axes:
            told = falls_below(rows, axis)
            print(f"| {axis.title} ({axis.kind}) | "
                  + " | ".join(", ".join(told.get(name, [])) or "-" for name in columns) + " |")
    if args.figure:
        from .. import plot

        for axis in axes:
            stem = pathlib.Path(args.figure)
            out = stem if len(axes) == 1 else stem.with_name(f"{stem.stem}-{axis.id}{stem.suffix}")
            plot.stability(args.out, axis.id, base=axis.base, title=axis.title).savefig(out)
    return table
