# SPDX-License-Identifier: MIT
"""echofuse-report: one page of HTML for people who look before they read, and which needs nothing
but itself: models beside one another on the records that training held out, two models record by
record, or a run as it was recorded.

    echofuse-report page --run scenes.sqlite --model fused.safetensors --live monday.sqlite
    echofuse-report page --run scenes.sqlite --compare a.safetensors b.safetensors
    echofuse-report page --live monday.sqlite

The numbers are those of `echofuse-recon evaluate --json --per-record`, the maps those of
`reconstruct`."""
from __future__ import annotations

import argparse
import base64
import datetime
import os
import pathlib
import sqlite3
import sys
from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from .. import __version__, runs
from ..bench.methods import version, writing
from ..models.maps import span_of
from ..models.model import read_safetensors
from ..runs.batches import blocks as in_blocks
from ..runs.programs import EXIT_CODES
from ..runs.staged import replaced, stop_by_signal
from ..runs.zones import summed
from . import tables
from .blocks import (Block, details, fails, html_of, listed, paragraph, pictures, printable,
                     three_digits)
from .other_maps import OtherMaps, named
from .records import chosen, half_tangent, said_of, shown
from .scores import Judged, Mode, ReportError, Scores, evaluated, means_of, modes_of
from .story import Story, info_of

TERMS = (
    ("SPD", "single-photon detector of one pixel; its clicks are counted by time of flight."),
    ("record",
     "what the sensors saw in one time slot, with the map of the depth camera: the truth."),
    ("IoU", "intersection over union of the pixels of the body, in map and truth; 1 is perfect."),
    ("lateral error", "distance of the body's middle in the map from the true one, sideways."),
    ("depth error", "mean, over the pixels that are body in both maps."),
    ("mirror fraction",
     "of the body that is drawn, beside the truth and beside its mirror image about the SPD's "
     "axis, how much is at the mirror image: "
              "0 none, 0.5 as much; a little below 0 by chance."),
    ("on the true side", "of the bodies more than 0.3 m off the axis."),
    ("thresholded map",
     "what is nearer to the background than to the mean body is set to the background."),
    ("p", "of a run as a whole: how probably a run like the training is as far from it; below "
          "0.001 the run is unlike the training."),
    ("flagged", "a single record that is unlike the training records."),
    ("SSIM, RMSE", "similarity of structure; root of the mean squared depth error, over the map."))


MOST_FAILING = 6  # records with pictures


class Report:
    """Content of the page: scores of models by `evaluate`, the story of a live run, and records
    with maps."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.args, self.run = args, args.run or args.live
        self.room = ["--empty", args.empty] if args.empty else []
        self.info = info_of(self.run)
        self.page = pathlib.Path(args.dir) / "report.html"
        if (not args.force and self.page.exists()
            and self.info["uuid"] not in self.page.read_text(encoding="utf-8")):
            raise ReportError(
                f"{args.dir}: holds a report of another run; give another folder, or --force to "
                "write over it", 2)
        self.simulated = self.info["notes"].startswith("simulated")
        self.modes: list[Mode] = []  # the subject first; those of equal inputs together
        self.main: list[Block] = []
        self.gallery: list[Block] = []
        self.failing: list[Block] = []
        self.others: OtherMaps | None = None
        self.other_record: Block | None = None
        self.live: Judged | None = None
        self.story: Story | None = None
        self.span: Sequence[float] = (2.5, 5)
        if args.model or args.compare:
            self.add_models()
        if args.maps:
            self.others = OtherMaps(named(args.maps), self.run, self.modes, self.room)
            self.other_record = self.others.record()
            if not self.modes:
                self.span = self.others.span
        if args.live:
            self.add_live()
        self.made = self.how_made()

    def add_models(self) -> None:
        compared = bool(self.args.compare)
        self.modes = modes_of(self.args.compare or self.args.model, compared)
        self.judged = evaluated([path for mode in self.modes for path in mode.files], self.run,
                                self.room)
        scores, paired = iter(self.judged.scores), iter(
            [{}, *(one["metrics"] for one in self.judged.told.get("paired", []))])
        for mode in self.modes:
            mode.scores = [next(scores) for _ in mode.files]
            mode.differences, *_ = [next(paired) for _ in mode.files]
        if compared and not self.modes[1].differences:
            raise ReportError(
                "the two models hold other records out; give a run that neither was trained on")
        first = self.modes[0]
        self.span = self.judged.span(float(first.tensors["0/scene/background_m"].max()),
                                     float(first.facts[0]["0/scene/map_z_max_m"]))
        worst = [index for _, _, which in tables.failing(first.first) for index in which[:2]]
        self.main, self.gallery, self.failing = chosen(self.run, self.modes, self.room,
                                                       list(dict.fromkeys(worst))[:MOST_FAILING])
        order = [colour for colour in ("both", "papers", "depth", "grey", "spd", "radar")
                 if colour not in {mode.inputs for mode in self.modes}]
        #: of each mode's series: modes of both sensors, and further ones of equal inputs, take
        #: turns
        self.colours = ["grey", "both"]
        for at, mode in enumerate([] if compared else self.modes):
            before = sum(other.inputs == mode.inputs or other.both and mode.both
                         for other in self.modes[:at])
            self.colours[at:] = [order[min(before, len(order) - 1)] if mode.both
                                 or before else mode.inputs]

    def add_live(self) -> None:
        """The record of median quality or, without a model, one with the most sensors."""
        self.story = Story(self.args.live)
        if self.modes and self.args.live != self.run:
            self.live = evaluated(self.modes[0].files[:1], self.args.live, self.room)
            order = self.live.scores[0].order
            found = shown(self.args.live, [order[len(order) // 2]], self.modes[:1],
                          self.live.scores, self.room)
            caption = ("Of the records that the daemon recorded, the one whose map has the median "
                       "IoU.")
        else:
            found = shown(self.args.live, self.story.typical())
            caption = "The record in the middle of those with the most sensors."
        index = {} if self.args.live == self.run else {"index": None}  # that of another run
        self.main += [one | {"caption": caption} | index for one in found.values()]
        self.span = self.span if self.modes or self.others or not self.main else span_of(
            np.frombuffer(base64.b64decode(self.main[0]["truth"]), "<u2") / 1000)

    @property
    def first(self) -> Scores:
        return self.modes[0].first

    @property
    def verdict(self) -> str:
        """Headline of the page."""
        simulated = "simulated" if self.simulated else "recorded"
        if not self.modes and self.others:
            return self.others.verdict
        if not self.modes and self.story:
            return ("The simulated run is " if self.simulated
                    else "The run is ") + self.story.verdict
        if self.args.compare:
            return tables.comparison_verdict(self.modes[1], simulated)
        facts = self.modes[0].facts[0]
        known = [facts[f"split/run/{k}"] for k in range(facts["split/runs"])]
        return tables.models_verdict(self.modes, self.judged, simulated,
                                     self.info["uuid"] not in known)

    @property
    def live_problems(self) -> list[str]:
        out = tables.problems_of_run(self.live.scores[0], "Recorded run: ") if self.live else []
        out += [f"Recorded run: {text}" for text in self.story.gone] if self.story else []
        own_s, scored_s = (self.story or self).info["window_s"], self.info["window_s"]
        if self.live and own_s != scored_s > 0:
            out.append(f"Recorded run: its records are {own_s:g} s long, those of the scored run "
                       f"{scored_s:g} s.")
        return out

    @property
    def problems(self) -> list[str]:
        """Problems as sentences, the gravest first."""
        return self.live_problems + (tables.problems_of_run(self.first) if self.modes else [])

    def how_made(self) -> dict[str, str]:
        """Program, host, run and models."""
        info, host, started = self.info, os.uname(), self.info["started_utc"]
        recorded = f"{started[:10]} {started[11:16]} UTC" if started[10:11] == "T" else started
        recorded += (f", echofuse {info['version']}" if info["version"]
                     else "") + (f", on {info['host']}" if info["host"] else "")
        now = datetime.datetime.now(datetime.timezone.utc)
        out: dict[str, str] = {
               "date": f"{now:%Y-%m-%d %H:%M} UTC",
               "program": f"echofuse {__version__}, {version()}",
               "host": f"{host.nodename} ({host.sysname} {host.release}, {host.machine})",
               "command": " ".join(["echofuse-report", *sys.argv[1:]]),
               "run": f"{self.run}, {info['records']} records", "run's uuid": info["uuid"],
               "recorded": recorded + "; simulated" * self.simulated,
               "length of a record": f"{info['window_s']:g} s" if info["window_s"] > 0 else "",
               "operator": info["operator"],
               "notes": info["notes"]} | info["meta"]
        if self.modes:
            with runs.open(self.run) as run:
                clicks = [summed(part.photons())[part.valid["spd"]].sum(1)
                          for _, part, _ in in_blocks(run)] if "spd" in run.axes else [np.zeros(0)]
                counts = np.sort(np.concatenate(clicks))
                half, size = (half_tangent(run),
                              run.axes["map_x"].count if "map_x" in run.axes else 64)
            low, middle, high = (three_digits(counts[int(share * len(counts))]) if len(counts)
                                 else "" for share in (0.05, 0.5, 0.95))
            out |= {"clicks a record": f"{middle} (median; 90 % of the records: {low} to {high})"
                    if middle else "no detector",
                    "maps": f"{size} x {size} pixels over ±{np.degrees(np.arctan(half)):.1f}°",
                    "data CRC-32C": f"{self.judged.told['data_crc32c']:08x}",
                    "empty room": self.args.empty or "", "another room": self.judged.said}
        for path, facts in ((path, facts) for mode in self.modes
                            for path, facts in zip(mode.files, mode.facts)):
            parts = np.bincount(read_safetensors(path)[0]["split/part"].ravel(), minlength=3)
            out[f"model {path}"] = (
                f"{facts['0/model']}; seed {facts['split/seed']}; its training: {parts[0]} "
                f"records, {parts[1]} of validation, "
                                    f"{parts[2]} held out (data CRC-32C "
                                    f"{facts['data_crc32c']:08x})")
        return out

    @property
    def origin(self) -> str:
        """When, where and by what, in one line."""
        made, name = self.made, os.path.basename
        live = (f" Recorded run {name(self.story.path)}." if self.story
                and self.story.path != self.run else "")
        command = " ".join(map(name, made["command"].split()))
        return (f"{made['date']}, {made['host'].split()[0]}, {made['program']}. Run "
                f"{name(self.run)}{' (simulated)' * self.simulated} of "
                f"{made['recorded'][:20]}.{live} Command: "
                f"{command if len(command) <= 160 else command[:160] + ' ...'}")

    def first_pictures(self) -> Block:
        """The subject's map of the first record, or both of a comparison, beside the truth."""
        record, models = self.main[0], 2 if self.args.compare else 1
        said = record["caption"] + " " + "".join(said_of(made, models > 1)
                                                 for made in record["maps"][:models])
        said += (f"All maps of this page are over the same depths, {self.span[0]:g} to "
                 f"{self.span[1]:g} m. ")
        return pictures(0, ["truth", *(f"{what} {m}" for what in ("map", "error")
                                       for m in range(models))],
                        said + "Of an error hatched is what is missed, dotted what is invented.",
                        title=record["title"], compare=models > 1)

    def record_blocks(self) -> list[Block]:
        blur = ("How far each pixel has come from the room (0) to a body (1); above a half it is "
                "shown as one.")
        if any(mode.takes.endswith("alone") for mode in self.modes):
            blur += " A sensor alone leaves open on which side the body is: a blur."
        out = []
        for i, record in enumerate(self.main):
            show, maps = measured(record), record["maps"]
            for m, made in enumerate(maps):
                show += [f"map {m}", f"error {m}",
                         *([f"deviation {m}"] if "deviation" in made else [])]
            said = record["caption"] + " " + "".join(said_of(made, len(maps) > 1) for made in maps)
            said += ("The uncertainty is the standard deviation of the depth; most of it is "
                     "whether there is body or wall.")
            out.append(details(record["title"], pictures(i, show, said),
                               pictures(i, ["truth", *(f"share {m}" for m in range(len(maps)))],
                                        blur, whole=True)))
        return out

    def failures(self) -> list[Block]:
        first = len(self.main) + len(self.gallery)
        live = self.live.scores if self.live else []
        rows = [(mode.title, mode.first)
                for mode in self.modes] + [(f"recorded run: {self.modes[0].title}", scores)
                                           for scores in live]
        return [*fails(self.problems), tables.failures_table(self.modes[0]),
                *([details("Maps of failing records", {"kind": "columns", "blocks": [
                    pictures(first + i, ["truth", "map 0", "error 0"],
                             said_of(record["maps"][0], False), title=record["title"])
                    for i, record in enumerate(self.failing)]})] if self.failing else []),
                tables.stated_table(rows),
                *([paragraph(f"{self.first.outside}.")] if self.first.outside else []),
                *(paragraph(f"Scored run: {text}.") for text in self.first.remarks),
                *(paragraph(f"Recorded run: {text}.") for scores in live
                  for text in scores.remarks)]

    def live_blocks(self, story: Story) -> list[Block]:
        between, last = [], len(self.main) - 1
        if self.live:
            rows = [tables.Row(self.modes[0].title, means_of(self.live.told["metrics"]),
                               self.live.scores[0]), *tables.rows_of([], self.live.told)]
            caption = (f"{self.live.told['records']} records of the recorded run against its depth "
                       "camera")
            between = [*fails(self.live_problems), tables.metrics_table(rows, caption)]
        of = [pictures(last, [*measured(one), *(["map 0", "error 0"] if one["maps"] else [])],
                       one["caption"], title=one["title"])
              for one in self.main[last:]]
        return story.blocks(between, of)

    def to_json(self) -> Block:
        """The page (blocks.py)."""
        problems, most, modes, compared = self.problems, 4, self.modes, bool(self.args.compare)
        records = [*self.main, *self.gallery, *self.failing,
                   *([self.other_record] if self.other_record else [])]
        page: Block = {"title": "Two models on the same records" if compared
                       else "Depth maps from one pixel and one radar" if modes or self.others else
                       "A recorded run", "verdict": self.verdict, "fails": problems[:most],
                       "more": "", "origin": self.origin,
                       "span": list(self.span), "records": records, "first": [],
                       "sections": []}
        if modes:
            page["more"] = ((f"{len(problems) - most} more, and" if len(problems) > most
                             else "Numbers, and") + " which records") * bool(problems)
            page["first"] = [self.first_pictures()] * bool(self.main) + [
                tables.first_table(modes, self.judged.told)]
        elif self.others:
            page["first"] = self.others.table()[:1]
        columns = [pictures(len(self.main) + i, ["truth", "map 0", "error 0"],
                            said_of(record["maps"][0], False), title=record["title"])
                   for i, record in enumerate(self.gallery)]
        sections = (("failures", "What fails", self.failures),
                    ("difference", "The difference",
                     lambda: tables.comparison(*modes) if compared else []),
                    ("gallery", "Worst, median, best",
                     lambda: [{"kind": "columns", "blocks": columns}]),
                    ("errors", "Where the errors are",
                     lambda: [tables.errors(modes, self.colours)]),
                    ("labels", "By label", lambda: tables.labels_table(modes[0])),
                    ("metrics", "All metrics", lambda: tables.all_table(modes, self.judged.told)),
                    ("maps", "Maps of other programs",
                     lambda: self.others.blocks(len(records) - 1, self.other_record)
                     if self.others else []),
                    ("cost", "Cost", lambda: [tables.cost_table(modes)]),
                    ("records", "Records and their maps", self.record_blocks),
                    ("space", "In space", lambda: [{"kind": "cloud", "record": 0}] if self.main
                     else []),
                    ("live", "The recorded run",
                     lambda: self.live_blocks(self.story) if self.story else []),
                    ("training", "Training", lambda: tables.losses(modes)),
                    ("made", "How this was made", lambda: listed(self.made.items())),
                    ("terms", "Terms", lambda: listed(TERMS)))
        for name, heading, blocks in sections:
            if (modes or name in ("maps", "live", "made")) and (found := blocks()):
                page["sections"].append({"id": name, "heading": heading, "blocks": found})
        return page


def measured(record: Block) -> list[str]:
    return ["truth", *(sensor for sensor in ("spd", "radar") if record[sensor]["count"] > 0)]


def require(args: argparse.Namespace) -> None:
    """Raises ReportError (2) for options that do not fit each other."""
    for wrong, text in ((args.empty and not args.run, "--empty is for the models of --run"),
                        (args.model and args.compare,
                         "--compare takes the place of the other models"),
                        (not args.run and args.compare, "--compare needs --run"),
                        (not args.run and args.maps, "--maps needs --run"),
                        (not args.run and args.model and not args.live,
                         "models need --run, or --live"),
                        (args.run and not args.model and not args.compare and not args.maps,
                         "--run needs --model, --compare or --maps"),
                        (not args.run and not args.live,
                         "nothing to report on: give --run with models, or --live")):
        if wrong:
            raise ReportError(text, 2)


def write_page(page: pathlib.Path, text: str) -> None:
    with writing(page):
        page.parent.mkdir(parents=True, exist_ok=True)
        with replaced(page) as new:
            new.write_text(text, encoding="utf-8")


class Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ReportError(f"{message}; see --help", 2)


def main() -> None:
    """Runs the program echofuse-report."""
    head, examples, *_ = (__doc__ or "").split("\n\n")
    parser = Parser(prog="echofuse-report", description=head.partition(": ")[2],
                    epilog=f"Examples:\n{examples}\n\n{EXIT_CODES}6 disk, 130 interrupted",
                    formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version",
                        version=f"echofuse-report {__version__}",
                        help="print the version and exit")
    parser.add_argument("dir", metavar="FOLDER", help="folder for report.html")
    parser.add_argument("--run", metavar="RUN", help="run file; its held-out records are scored")
    parser.add_argument("--model", metavar="MODEL", nargs="+", action="extend", default=[],
                        help="model files, FILE or NAME=FILE; the first is the "
                        "one that the report is about, several of a name are seeds of one")
    parser.add_argument("--compare", metavar="MODEL", nargs=2,
                        help="two model files: their differences record by record")
    parser.add_argument("--maps", metavar="FOLDER", nargs="+", action="extend", default=[],
                        help="maps of other programs, as evaluate --maps: FOLDER or NAME=FOLDER")
    parser.add_argument("--live", metavar="RUN",
                        help="a recorded run: its story, also without any model; with --model also "
                             "its maps")
    parser.add_argument("--empty", metavar="RUN",
                        help="a run of nobody in the room of this run, if it is another one than "
                             "in training")
    parser.add_argument("--force", action="store_true", help="write over a report of another run")
    stopped = stop_by_signal()
    try:
        args = parser.parse_args()
        require(args)
        report = Report(args)
        write_page(report.page, html_of(report.to_json()))
    except (KeyboardInterrupt, RuntimeError, ValueError, OSError, sqlite3.Error) as error:
        if stopped:
            sys.exit(130)
        print(f"echofuse-report: {printable(str(error))}", file=sys.stderr)
        sys.exit(getattr(error, "code", 1))
    remarks = report.first.remarks if report.modes else []
    print("\n".join(map(printable, (report.verdict, *report.problems, *remarks, str(report.page)))))
