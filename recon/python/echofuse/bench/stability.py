# SPDX-License-Identifier: MIT
"""Stability study: measures methods under increasingly difficult conditions (conditions.py). On a
matched axis, methods are trained under the test condition. On a shifted axis, they are trained
under the base condition."""
from __future__ import annotations

import argparse
import json
import pathlib
import tempfile
from collections.abc import Sequence

import numpy as np

from ..runs.programs import ProgramError, UsageError, call, positive
from . import derive, fog, table as tables
from .conditions import BASE, Axis, World, recorded_axes, simulated_axes
from .methods import CONSTANT, Method, Row, method, version

__all__ = ["Simulated", "add_command", "run"]

TEST_SEEDS = 1000  # difference between the seeds of the test and the training records


class Simulated:
    """Generates runs of simulated records under any condition."""

    def __init__(self, settings: Sequence[str], records: int, test_records: int) -> None:
        self.settings = [word for setting in settings for word in ("--set", setting)]
        self.records, self.test_records = records, test_records
        settings_of_base = json.loads(call("echofuse-sim", "config", "--json",
                                           *self.settings).stdout)["settings"]
        self.base = {key: setting["value"] for key, setting in settings_of_base.items()}

    @property
    def source_line(self) -> str:
        """First line of a result table; identifies the data used for the measurements."""
        settings = " ".join(word for word in self.settings if word != "--set")
        return (f"{version()}: {self.records} training and {self.test_records} test records, "
                f"simulated{'; ' * bool(settings)}{settings}")

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
        """Returns a change that replaces the counts with counts of the same scenes in fog."""
        if self.base["spd_dead_time_ps"] > 0:
            raise ProgramError("fog cannot be combined with a detector dead time")
        if self.base["spd_zones"] > 1:
            raise ProgramError("fog cannot be combined with detector zones")
        clear = out.with_name("clear-" + out.name)
        call("echofuse-sim", "dataset", "-q", "--out", clear, "--seed", seed, f"--{world.scenes}",
             records, *self.settings, "--set", "background_counts=0",
             "--set", "pulses_per_window=0")
        counts = fog.add_fog(derive.read(clear).spd, world.fog_m, self.base, seed)
        clear.unlink()

        def change(target: derive.Records) -> None:
            target.spd = counts

        return change

    def _dataset(self, out: pathlib.Path, seed: int, words: Sequence[str],
                 scenes: Sequence[tuple[str, float, float | None]]) -> None:
        scene_list = out.with_suffix(".toml")
        scene_list.write_text("".join(f'[[scene]]\nkind = "{kind}"\nx_m = {x:.9g}\n'
                                      + (f"z_m = {z:.9g}\n" if z is not None else "")
                                      for kind, x, z in scenes))
        call("echofuse-sim", "dataset", "-q", "--out", out, "--seed", seed, *words, "--set",
             f"scenes={scene_list}")
        scene_list.unlink()

    def _walkers(self, world: World, records: int, seed: int, out: pathlib.Path,
                 words: Sequence[str]) -> None:
        """Generates records of walking people. Each record combines five short records along the
        path by adding their photon counts and averaging their radar power. The ground-truth map
        shows the person at the midpoint of the path."""
        if self.base["radar_antennas"] > 1:
            raise ProgramError("walking people cannot be combined with several antennas")
        steps, rng = 5, np.random.default_rng(seed)
        x = rng.uniform(-self.base["target_x_m"], self.base["target_x_m"], records)
        z = rng.uniform(self.base["target_z_min_m"], self.base["target_z_max_m"], records)
        turn = rng.uniform(0, 2 * np.pi, records)
        shares = [word for key in ("signal_photons", "background_counts", "radar_frames")
                  if self.base[key] > 0
                  for word in ("--set", f"{key}={max(1, round(self.base[key] / steps))}")]
        parts: list[derive.Records] = []
        with tempfile.TemporaryDirectory(prefix="echofuse-bench-") as scratch:
            for k, step in enumerate((0, -2, -1, 1, 2)):
                way = world.walk_m * step / steps
                path = pathlib.Path(scratch, f"{k}.sqlite")
                self._dataset(path, seed, [*words, *shares],
                              [(("letter" if i % 4 else "person"), x[i] + way * np.cos(turn[i]),
                                z[i] + way * np.sin(turn[i])) for i in range(records)])
                parts.append(derive.read(path))

            def add_up(target: derive.Records) -> None:
                target.spd = np.sum([part.spd for part in parts], axis=0, dtype=np.uint32)
                target.radar = np.mean([part.radar for part in parts], axis=0, dtype=np.float32)

            derive.copy(pathlib.Path(scratch, "0.sqlite"), out, add_up)


class Recorded:
    """Derives the runs of each condition from a recorded training run and a recorded test run."""

    def __init__(self, train: str, test: str) -> None:
        self.runs = pathlib.Path(train), pathlib.Path(test)

    @property
    def source_line(self) -> str:
        return tables.source_line(*self.runs)

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
          seeds: int, quick: bool) -> list[tables.Cell]:
    """Returns one table cell per method, seed and condition. The conditions are the base condition
    and the values of the axes (if `quick` is true, only the values in Axis.quick)."""
    places = [("base", "base", BASE, BASE)]
    for axis in axes:
        for label, world in axis.values.items():
            if world != BASE and (not quick or not axis.quick or label in axis.quick):
                places.append((axis.id, label, world if axis.kind == "matched" else BASE, world))

    def cell(axis: str, label: str, train: World, test: World, estimator: Method,
             seed: int) -> tables.Cell:
        return tables.Cell(axis, label, estimator, seed,
                           tables.RunSource(f"train {key(train, axis, label)} {seed}",
                                            lambda folder: source.train(train, seed, folder)),
                           tables.RunSource(f"test {key(test, axis, label)} {seed}",
                                            lambda folder: source.test(test, seed, folder)),
                           fallback=train == BASE)

    def key(world: World, axis: str, label: str) -> str:
        return "base" if world == BASE else f"{axis} {label}"

    return [cell(*place, estimator, seed) for seed in range(1, seeds + 1) for place in places
            for estimator in methods]


def first_failures(rows: Sequence[Row], axis: Axis) -> dict[str, list[str]]:
    """For each method, returns the axis values closest to the base value at which the method fails,
    at most one in each direction. A method fails if its IoU does not exceed that of the best
    baseline (empty room, mean map, nearest record) by more than the standard deviation over the
    seeds, or if its IoU is NaN."""
    def iou(model: str, inputs: str | None, label: str) -> dict[str, float]:
        at = ("base", "base") if axis.values[label] == BASE else (axis.id, label)
        return {row["seed"]: float(row["iou"]) for row in rows
                if (row["axis"], row["value"], row["model"]) == (*at, model)
                and inputs in (None, row["inputs"])}

    def below(model: str, inputs: str, label: str) -> bool:
        mine, best = iou(model, inputs, label), [iou(name, None, label)
                                                 for name in (*CONSTANT, "nearest")
                                                 if name != model]
        gain = [value - np.nanmax([0.0, *(scores[seed] for scores in best if seed in scores)])
                for seed, value in mine.items()]
        return bool(gain) and not np.mean(gain) > (np.std(gain, ddof=1) if len(gain) > 1 else 0)

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
        out[model if inputs in ("fused", "-") else f"{model}:{inputs}"] = [
                                    label for label in first if label is not None]
    return out


def add_command(parser: argparse.ArgumentParser) -> None:
    default = ["nearest", "mean-shape", "factorised-16", "mlp-128-64"]
    parser.add_argument("--methods", nargs="+", metavar="METHOD", default=default,
                        help=f"methods to test (default: {' '.join(default)})")
    parser.add_argument("--axes", nargs="+",
                        help="axes (varied conditions) to measure, e.g. shifted-snr (default: "
                             "all); an unknown name prints a list of all axes")
    parser.add_argument("--quick", action="store_true",
                        help="measure fewer values per axis, with only 1000 training records and "
                             "300 test records")
    parser.add_argument("--records", type=positive, help="number of simulated training records "
                                                    "(default: 3600)")
    parser.add_argument("--test-records", type=positive, help="number of simulated test records "
                                                         "(default: 1000)")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE",
                        help="simulator settings of the base condition, e.g. background=room")
    parser.add_argument("--runs", nargs=2, metavar=("TRAIN", "TEST"),
                        help="use this training run and this test run instead of simulated runs")


def run(args: argparse.Namespace) -> tables.Table:
    source: Simulated | Recorded = Recorded(*args.runs) if args.runs else Simulated(
        args.set, args.records or (1000 if args.quick else 3600),
        args.test_records or (300 if args.quick else 1000))
    known = {axis.id: axis for axis in source.axes()}
    unknown = [name for name in args.axes or [] if name not in known]
    if unknown:
        raise UsageError(f"unknown axis {unknown[0]} (expected one of: {', '.join(known)})")
    axes = [known[name] for name in args.axes or known]
    names = dict.fromkeys((*CONSTANT, "nearest", *args.methods))  # always includes the baselines
    methods = [method(name) for name in names]
    table = tables.Table(args.out, source.source_line, args.part)
    tables.fill(table, cells(source, axes, methods, seeds=args.seeds or 3, quick=args.quick),
               jobs=args.jobs, part=args.part, quiet=args.quiet)
    rows = list(table.rows.values())
    if args.markdown:
        columns = list(first_failures(rows, axes[0]))
        print("| axis | " + " | ".join(f"`{name}`" for name in columns) + " |\n|---" + "|---"
              * len(columns) + "|")
        for axis in axes:
            failures = first_failures(rows, axis)
            print(f"| {axis.title} ({axis.kind}) | "
                  + " | ".join(", ".join(failures.get(name, [])) or "-" for name in columns) + " |")
    if args.figure:
        from .. import plot

        for axis in axes:
            stem = pathlib.Path(args.figure)
            out = stem if len(axes) == 1 else stem.with_name(f"{stem.stem}-{axis.id}{stem.suffix}")
            plot.stability(args.out, axis.id, base=axis.base, title=axis.title).savefig(out)
    return table
