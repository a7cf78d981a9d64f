# SPDX-License-Identifier: MIT
"""Limits of methods: each of a list under conditions from easy to broken, trained there as well
(matched) or at the base condition alone (shifted). The axes of simulated records are settings of
`echofuse-sim dataset`; recorded runs have those axes that can be made from their records
(derive.py)."""
from __future__ import annotations

import argparse
import json
import pathlib
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import derive, fog
from . import table as tables
from .methods import CONSTANT, Method, Row, method, version
from .programs import BenchError, UsageError, call

TEST_SEEDS = 1000  # the test records' seed, after that of the training records


@dataclass(frozen=True)
class World:
    """Differences from the base condition: settings, kind of scene, standing at |x|, a way through
    each record, visibility in fog (0: clear), a factor of the training records, changes of the
    finished run."""

    set: tuple[str, ...] = ()
    scenes: str = "records"
    at_x_m: float | None = None
    walk_m: float = 0
    fog_m: float = 0
    records: float = 1
    changes: tuple[derive.Change, ...] = ()


BASE = World()


@dataclass(frozen=True)
class Axis:
    """Values in order from one end to the other; the world of one of them is BASE."""

    kind: str  # matched, shifted
    name: str
    title: str  # with its unit
    values: dict[str, World] = field(default_factory=dict)
    quick: tuple[str, ...] = ()  # values of the quick study, beside the base

    @property
    def id(self) -> str:
        return f"{self.kind}-{self.name}"

    @property
    def base(self) -> str:
        return next(label for label, world in self.values.items() if world == BASE)


def simulated_axes(base: dict[str, Any]) -> list[Axis]:
    """All axes of simulated records. `base`: the simulator's settings, {key: value}."""
    photons, resolution_m = base["signal_photons"], base["radar_resolution_m"]
    coherent, antennas = base["radar_sum"] == "coherent", max(base["radar_antennas"], 1)
    axes: list[Axis] = []

    def numbers(kind: str, name: str, title: str, values: Iterable[float], quick: Iterable[float],
                world: Callable[[float], World], at: float) -> None:
        worlds = {f"{v:g}": BASE if np.isclose(v, at, rtol=1e-9, atol=0) else world(v)
                  for v in values}
        if BASE not in worlds.values():
            raise UsageError(f"axis {kind}-{name} has no value for the simulator's base: {at:g}")
        axes.append(Axis(kind, name, title, worlds, tuple(f"{v:g}" for v in quick)))

    def setting(kind: str, name: str, title: str, key: str, values: Iterable[float],
                quick: Iterable[float],
                unit: float = 1) -> None:
        numbers(kind, name, title, values, quick, lambda v: World((f"{key}={v * unit:.9g}",)),
                base[key] / unit)

    def words(kind: str, name: str, title: str, values: dict[str, World],
              quick: Sequence[str]) -> None:
        axes.append(Axis(kind, name, title, values, tuple(quick)))

    def at_resolution(m: float) -> tuple[str, ...]:  # sampled as densely, over the same span
        step, span = (m * base["radar_step_m"] / resolution_m,
                      base["radar_step_m"] * (base["radar_bins"] - 1))
        return (f"radar_resolution_m={m:.9g}", f"radar_step_m={step:.9g}",
                f"radar_bins={np.floor(span / step) + 1:.9g}")

    def at_bin_width(ps: float) -> World:
        bins = round(base["bin_width_ps"] * base["bins"] / ps)
        return World((f"bin_width_ps={ps:.9g}", f"bins={bins}"))

    def pile_up(v: float, stated: bool = True) -> World:
        return World((f"pulses_per_window={photons / v if v else 0:.9g}",
                      *(() if stated else ("spd_detector_stated=false",))))

    # Matched: the sensors
    setting("matched", "irf", "SPD's impulse response, FWHM (ps)", "irf_fwhm_ps",
            (2, 50, 200, 500, 1000, 2000), (2, 2000))
    numbers("matched", "bin_width", "SPD's bin width (ps)", (10, 50, 100, 200, 400, 800), (800,),
            at_bin_width, base["bin_width_ps"])
    numbers("matched", "radar_resolution", "radar's resolution (m)", (0.044, 0.1, 0.25, 0.5, 1),
            (0.044, 1),
            lambda m: World(at_resolution(m)), resolution_m)
    setting("matched", "baseline", "baseline (m)", "baseline_m", (2, 1, 0.5, 0.2, 0.1, 0),
            (2, 0.1, 0))
    setting("matched", "snr", "radar's SNR (dB)", "radar_snr_db", (30, 20, 10, 5, 0), (10, 0))
    setting("matched", "photons", "photons a record", "signal_photons", (1e6, 1e5, 1e4, 1e3, 1e2),
            (1e3, 1e2))
    setting("matched", "background", "SPD's background (counts to a signal photon)",
            "background_counts", (0, 0.1, 1, 10, 100),
            (1, 10), photons)
    pulses = base["pulses_per_window"]
    numbers("matched", "pile_up", "pile-up (photons to a laser pulse, the first is seen)",
            (0, 0.01, 0.1, 0.5, 1, 2), (0.1, 2),
            pile_up, photons / pulses if pulses > 0 else 0)
    cm = f"coherent {100 * resolution_m:g} cm"
    echoes = {"incoherent": World(("radar_sum=incoherent",)) if coherent else BASE,
              cm: BASE if coherent else World(("radar_sum=coherent",))}
    words("matched", "speckle", "radar's sum of echoes",
          {"incoherent": echoes["incoherent"],
           "coherent 4.4 cm": World((*at_resolution(0.044), "radar_sum=coherent")), **echoes},
          ("incoherent", cm))
    counts = sorted({1, 2, 4, 8} | ({antennas} if antennas > 8 else set()))
    numbers("matched", "antennas", "radar's antennas", counts, (1, 2, 8),
            lambda n: World((f"radar_antennas={n:g}",)), antennas)
    if antennas > 1 or coherent:
        setting("matched", "looks", "radar's frames a record", "radar_frames", (15, 60, 240), (15,))

    # Matched: scenes, slots, rooms
    numbers("matched", "records", "training records (factor)", (6.67, 3, 1, 0.28, 0.07), (0.28,),
            lambda v: World(records=v), 1)
    setting("matched", "size", "size of the body (factor)", "target_scale", (1.5, 1, 0.7, 0.5, 0.3),
            (0.5,))
    setting("matched", "side", "bodies within |x| (m)", "target_x_m", (1, 0.5, 0.25, 0.1), (0.1,))
    kinds = {"people and letters": BASE, "people": World(scenes="people"),
             "letters": World(scenes="letters"),
             "two people": World(scenes="two-people")}
    words("matched", "scenes", "scenes", kinds, ("people", "two people"))
    slot_s, frames = base["window_s"], base["radar_frames"]
    slots = sorted({slot_s} | {s for s in (3, 2, 1, 0.5, 0.25, 0.1, 0.05)
                               if antennas == 1 or frames * s / slot_s > antennas}, reverse=True)
    numbers("matched", "slot", "length of a record (s)", slots, (0.5, 1), lambda s: World((
        f"window_s={s:.9g}", *(f"{key}={base[key] * s / slot_s:.9g}"
                               for key in ("signal_photons", "background_counts")),
        f"radar_frames={max(1, round(frames * s / slot_s))}")), slot_s)
    numbers("shifted", "walk", "people who walk (m/s)", (0, 0.25, 0.5, 1), (0.5,),
            lambda v: World(walk_m=v * slot_s), 0)
    words("matched", "rooms", "rooms, and echoes by their walls", _rooms(at_resolution),
          ("corridor", "corridor echoes", "closed", "closed echoes"))

    # Shifted: an instrument that changed since the training
    gains = (0.25, 0.5, 1, 2, 4)
    setting("shifted", "spd_delay", "SPD's delay after calibration (ps)", "spd_delay_ps",
            (0, 10, 50, 100, 200, 500), (50, 200, 500))
    setting("shifted", "radar_offset", "radar's offset after calibration (m)", "radar_bias_m",
            (0, 0.01, 0.02, 0.05, 0.1, 0.2),
            (0.02, 0.05, 0.2))
    setting("shifted", "spd_gain", "light (factor)", "signal_photons", gains, (0.25, 4), photons)
    numbers("shifted", "radar_gain", "radar's gain (factor)", gains, (0.25, 4),
            lambda v: World(changes=(derive.gain(v),)), 1)
    setting("shifted", "irf", "SPD's impulse response, FWHM (ps)", "irf_fwhm_ps", (100, 200, 300),
            (100, 300))
    setting("shifted", "snr", "radar's SNR (dB)", "radar_snr_db", (30, 20, 10, 5, 0), (10, 0))
    setting("shifted", "baseline", "baseline (m)", "baseline_m", (0.4, 0.45, 0.5, 0.55, 0.6),
            (0.4, 0.6))
    setting("shifted", "background", "SPD's background (counts to a signal photon)",
            "background_counts", (0, 0.1, 1, 10),
            (0.1, 1, 10), photons)
    if pulses == 0:
        piled = {"none": BASE} | {f"{v:g}{'' if stated else ' uncorrected'}": pile_up(v, stated)
                                  for v in (0.1, 0.5, 2) for stated in (True, False)}
        words("shifted", "pile_up", "pile-up (photons to a laser pulse), corrected or not", piled,
              ("2", "2 uncorrected"))
    words("shifted", "speckle", "radar's sum of echoes", echoes, ("incoherent", cm))
    if coherent:
        moving = ("radar_sway_m", "radar_twist_deg", "radar_breath_m")
        numbers("shifted", "motion", "people's motion (factor)", (1, 0.5, 0.2, 0), (0,),
                lambda share: World(tuple(f"{key}={share * base[key]:.9g}" for key in moving)), 1)
    if antennas > 1:
        words("shifted", "antennas", "radar's antennas",
              {f"{antennas:g}": BASE, "lost": World(("radar_antennas=1",))}, ("lost",))
        numbers("shifted", "phase", "error of the antennas' phases (degrees, rms)",
                (0, 5, 15, 30, 60), (15, 30),
                lambda deg: World((f"radar_phase_error_rad={np.radians(deg):.9g}",
                                   "radar_array_calibrated=false")), 0)

    # Fog: trained in it, or in clear air
    for kind in ("matched", "shifted"):
        numbers(kind, "fog", "visibility in fog (m), 0: clear", (0, 1000, 300, 100, 50, 20, 10, 5),
                (100, 20), lambda m: World(fog_m=m), 0)

    # Shifted: surprises
    for sensor in ("radar", "spd"):
        words("shifted", f"lost_{sensor}", "radar" if sensor == "radar" else "SPD",
              {"there": BASE, "missing": World(changes=(derive.lost(sensor),))}, ("missing",))
    words("shifted", "scenes", "scenes", kinds
          | {"nobody": World(("background_counts=10000",), scenes="empty")},
          ("two people", "nobody"))
    aside = {f"{x:g}": World(at_x_m=x) for x in (1.1, 1.25, 1.5)}
    words("shifted", "side", "bodies at |x| (m)",
          {f"within {base['target_x_m']:g}": BASE} | aside, ("1.25", "1.5"))
    near, far = base["target_z_min_m"], base["target_z_max_m"]
    standing = {"2.5 to 3": (2.5, 3), f"{near:g} to {far:g}": None, "4 to 4.5": (4, 4.5),
                "4.5 to 5": (4.5, 5), "5 to 6": (5, 6)}
    words("shifted", "distance", "bodies at z (m)",
          {label: World((f"target_z_min_m={z[0]:g}", f"target_z_max_m={z[1]:g}"))
         if z else BASE for label, z in standing.items()}, ("4 to 4.5", "5 to 6"))
    return axes


def _rooms(at_resolution: Callable[[float], tuple[str, ...]]) -> dict[str, World]:
    """People before walls, and with echoes by these. RF and sound: one sensor as in Turpin et al.,
    PRL 126, 174301."""
    echoes = ("multipath_order=2",)
    direct = (*at_resolution(0.044), "radar_wall_scatter=0.1")
    sound = (*at_resolution(0.02), *echoes, "radar_wall_reflectivity=0.97",
             "radar_wall_scatter=0.03")

    def world(room: str, *settings: str) -> World:
        return World((*settings, f"background={room}",
                      *(() if room in ("room", "closed") else ("target_x_m=0.7",))))

    out = {"open": BASE, "open narrow": world("none"), "room": world("room"),
           "room echoes": world("room", *echoes)}
    for room in ("corridor", "closed"):
        out |= {room: world(room), f"{room} echoes": world(room, *echoes),
                f"{room} RF 4.4 cm direct": world(room, *direct),
                f"{room} RF 4.4 cm": world(room, *direct, *echoes),
                f"{room} sound 2 cm": world(room, *sound)}
    return out


def recorded_axes() -> list[Axis]:
    """Axes that can be made from the records of any run: the test is changed, or training and test
    alike."""
    def both(name: str, title: str, base: str, values: dict[str, derive.Change]) -> list[Axis]:
        worlds = {base: BASE} | {label: World(changes=(change,))
                                 for label, change in values.items()}
        return [Axis(kind, name, title, worlds, tuple(values)) for kind in ("matched", "shifted")]

    shifted = [Axis("shifted", "radar_offset", "radar's offset (m)", {"0": BASE} | {
        f"{m:g}": World(changes=(derive.range_offset(m),)) for m in (0.01, 0.02, 0.05, 0.1, 0.2)})]
    for sensor in ("radar", "spd"):
        shifted.append(Axis("shifted", f"lost_{sensor}", sensor,
                            {"there": BASE, "missing": World(changes=(derive.lost(sensor),))}))
    return [*both("photons", "share of the photons", "1",
                  {f"{s:g}": derive.thinned(s, 1) for s in (0.5, 0.1, 0.01, 0.001)}),
            *both("background", "counts of room light a record", "0",
                  {f"{n:g}": derive.background(n, 1) for n in (1e3, 1e4, 1e5)}),
            *both("snr", "radar's noise (dB below its peak)", "none",
                  {f"{db:g}": derive.noise(db, 1) for db in (20, 10, 5, 0)}),
            Axis("matched", "records", "training records (factor)",
                 {"1": BASE} | {f"{v:g}": World(records=v) for v in (0.5, 0.28, 0.07)}),
            *shifted]


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
        from . import plot

        for axis in axes:
            stem = pathlib.Path(args.figure)
            out = stem if len(axes) == 1 else stem.with_name(f"{stem.stem}-{axis.id}{stem.suffix}")
            plot.stability(args.out, axis.id, base=axis.base, title=axis.title).savefig(out)
    return table
