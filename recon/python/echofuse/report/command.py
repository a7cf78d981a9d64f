# SPDX-License-Identifier: MIT
"""echofuse-report: write a self-contained HTML page that scores models on held-out records,
compares two models record by record, or summarises a recorded run.

    echofuse-report page --run scenes.sqlite --model fused.safetensors --live monday.sqlite
    echofuse-report page --run scenes.sqlite --compare a.safetensors b.safetensors
    echofuse-report page --live monday.sqlite

`echofuse-recon evaluate --json --per-record` computes the scores, and `echofuse-recon reconstruct`
the maps."""
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
from .other_maps import OtherMaps, named_folders
from .records import half_tangent, map_remarks, record_blocks, select_records
from .scores import Evaluation, ReportModel, ReportError, Scores, evaluate, means_of, read_models
from .story import Story, info_of

__all__ = ["main"]

TERMS = (
    ("SPD", "single-pixel single-photon detector; its clicks are histogrammed by time of flight."),
    ("record", "sensor data of one time slot; the map of its depth camera is the ground-truth "
               "map."), ("IoU",
     "intersection over union of the body pixels in the predicted and the ground-truth map; 1 is "
     "perfect."),
    ("lateral error", "sideways distance between the centres of the predicted and the true body."),
    ("depth error", "mean absolute error over the pixels that belong to the body in both maps."),
    ("mirror fraction",
     "fraction of the predicted body at the left-right mirrored position: 0 = none, 0.5 = side "
     "unknown; can be slightly negative by chance."), ("on the true side",
     "fraction of the bodies more than 0.3 m off the axis that are predicted on the correct side."),
    ("thresholded map",
     "map in which pixels with a depth closer to the background than to the mean body are set to "
     "the background."), ("p",
     "probability that a run under the training conditions differs from the training data by at "
     "least as much as this run; if p is below 0.001, the run is reported as different."),
    ("flagged", "(of a record) reported as different from the training records."),
    ("SSIM, RMSE", "structural similarity and root mean square depth error of the whole map."))


MAX_FAILING = 6  # maximum number of failing records shown with pictures


class Report:
    """Contents of the page: model scores, data of a recorded run as a function of time, and records
    with maps."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.args, self.run = args, args.run or args.live
        self.room = ["--empty", args.empty] if args.empty else []
        self.info = info_of(self.run)
        self.page = pathlib.Path(args.dir) / "report.html"
        if (not args.force and self.page.exists()
            and self.info["uuid"] not in self.page.read_text(encoding="utf-8")):
            raise ReportError(
                f"{args.dir}: contains a report of another run; give another folder, or --force "
                "to overwrite it", 2)
        self.simulated = self.info["notes"].startswith("simulated")
        self.models: list[ReportModel] = []  # models with the same inputs are adjacent
        self.main: list[Block] = []
        self.gallery: list[Block] = []
        self.failing: list[Block] = []
        self.others: OtherMaps | None = None
        self.other_record: Block | None = None
        self.live: Evaluation | None = None
        self.story: Story | None = None
        self.span: Sequence[float] = (2.5, 5)
        if args.model or args.compare:
            self.add_models()
        if args.maps:
            self.others = OtherMaps(named_folders(args.maps), self.run, self.models, self.room)
            self.other_record = self.others.record()
            if not self.models:
                self.span = self.others.span
        if args.live:
            self.add_live()
        self.provenance = self.read_provenance()

    def add_models(self) -> None:
        compared = bool(self.args.compare)
        self.models = read_models(self.args.compare or self.args.model, compared)
        self.evaluation = evaluate([path for model in self.models for path in model.files],
                                   self.run, self.room)
        scores, paired = iter(self.evaluation.scores), iter(
            [{}, *(pair["metrics"] for pair in self.evaluation.result.get("paired", []))])
        for model in self.models:
            model.scores = [next(scores) for _ in model.files]
            model.differences, *_ = [next(paired) for _ in model.files]
        if compared and not self.models[1].differences:
            raise ReportError(
                "the models have different held-out records; choose a run that is new to both")
        first = self.models[0]
        self.span = self.evaluation.span(float(first.tensors["0/scene/background_m"].max()),
                                         float(first.facts[0]["0/scene/map_z_max_m"]))
        worst = [index for _, _, which in tables.failing(first.first) for index in which[:2]]
        self.main, self.gallery, self.failing = select_records(
            self.run, self.models, self.room, list(dict.fromkeys(worst))[:MAX_FAILING])
        order = [colour for colour in ("both", "papers", "depth", "grey", "spd", "radar")
                 if colour not in {model.inputs for model in self.models}]
        #: colours of the models; the first model that uses only one sensor has the sensor's colour
        self.colours = ["grey", "both"]
        for at, model in enumerate([] if compared else self.models):
            before = sum(other.inputs == model.inputs or other.both and model.both
                         for other in self.models[:at])
            self.colours[at:] = [order[min(before, len(order) - 1)] if model.both
                                 or before else model.inputs]

    def add_live(self) -> None:
        """Adds a record of the recorded run: the record with the median IoU or, if the report has
        no model, one of the records with valid data from the most sensors."""
        self.story = Story(self.args.live)
        if self.models and self.args.live != self.run:
            self.live = evaluate(self.models[0].files[:1], self.args.live, self.room)
            order = self.live.scores[0].order
            found = record_blocks(self.args.live, [order[len(order) // 2]], self.models[:1],
                                  self.live.scores, self.room)
            caption = "The record with the median IoU in the recorded run."
        else:
            found = record_blocks(self.args.live, self.story.typical())
            caption = ("A record from the middle of the run, among the records with data from the "
                       "most sensors.")
        # index None: the record is not from the scored run
        index = {} if self.args.live == self.run else {"index": None}
        self.main += [block | {"caption": caption} | index for block in found.values()]
        self.span = self.span if self.models or self.others or not self.main else span_of(
            np.frombuffer(base64.b64decode(self.main[0]["truth"]), "<u2") / 1000)

    @property
    def first(self) -> Scores:
        return self.models[0].first

    @property
    def verdict(self) -> str:
        """Headline of the page."""
        simulated = "simulated" if self.simulated else "recorded"
        if not self.models and self.others:
            return self.others.verdict
        if not self.models and self.story:
            return ("The simulated run is " if self.simulated
                    else "The run is ") + self.story.verdict
        if self.args.compare:
            return tables.comparison_verdict(self.models[1], simulated)
        facts = self.models[0].facts[0]
        training = [facts[f"split/run/{k}"] for k in range(facts["split/runs"])]
        return tables.models_verdict(self.models, self.evaluation, simulated,
                                     self.info["uuid"] not in training)

    @property
    def live_problems(self) -> list[str]:
        out = tables.problems_of_run(self.live.scores[0], "Recorded run: ") if self.live else []
        out += [f"Recorded run: {text}" for text in self.story.losses] if self.story else []
        own_s, scored_s = (self.story or self).info["window_s"], self.info["window_s"]
        if self.live and own_s != scored_s > 0:
            out.append(f"Recorded run: its slots last {own_s:g} s, but the slots of the scored "
                       f"run last {scored_s:g} s.")
        return out

    @property
    def problems(self) -> list[str]:
        """Sentences that describe problems, the most serious problem first."""
        return self.live_problems + (tables.problems_of_run(self.first) if self.models else [])

    def read_provenance(self) -> dict[str, str]:
        """Returns information about the program, the host, the run and the models, keyed by
        title."""
        info, host, started = self.info, os.uname(), self.info["started_utc"]
        recorded = f"{started[:10]} {started[11:16]} UTC" if started[10:11] == "T" else started
        recorded += (f", echofuse {info['version']}" if info["version"]
                     else "") + (f", on {info['host']}" if info["host"] else "")
        now = datetime.datetime.now(datetime.timezone.utc)
        out: dict[str, str] = {"date": f"{now:%Y-%m-%d %H:%M} UTC",
               "program": f"echofuse {__version__}, {version()}",
               "host": f"{host.nodename} ({host.sysname} {host.release}, {host.machine})",
               "command": " ".join(["echofuse-report", *sys.argv[1:]]),
               "run": f"{self.run}, {info['records']} records", "run's uuid": info["uuid"],
               "recorded": recorded + "; simulated" * self.simulated,
               "slot length": f"{info['window_s']:g} s" if info["window_s"] > 0 else "",
               "operator": info["operator"], "notes": info["notes"]} | info["meta"]
        if self.models:
            with runs.open(self.run) as run:
                clicks = [summed(part.photons())[part.valid["spd"]].sum(1)
                          for _, part, _ in in_blocks(run)] if "spd" in run.axes else [np.zeros(0)]
                counts = np.sort(np.concatenate(clicks))
                half, size = (half_tangent(run),
                              run.axes["map_x"].count if "map_x" in run.axes else 64)
            low, middle, high = (three_digits(counts[int(share * len(counts))]) if len(counts)
                                 else "" for share in (0.05, 0.5, 0.95))
            out |= {"clicks per record": f"{middle} (median; 90 % of the records: {low} to {high})"
                    if middle else "no detector",
                    "maps": f"{size} x {size} pixels over ±{np.degrees(np.arctan(half)):.1f}°",
                    "data CRC-32C": f"{self.evaluation.result['data_crc32c']:08x}",
                    "empty room": self.args.empty or "", "another room": self.evaluation.room_note}
        for path, facts in ((path, facts) for model in self.models
                            for path, facts in zip(model.files, model.facts)):
            parts = np.bincount(read_safetensors(path)[0]["split/part"].ravel(), minlength=3)
            out[f"model {path}"] = (
                f"{facts['0/model']}; seed {facts['split/seed']}; {parts[0]} training, "
                f"{parts[1]} validation and {parts[2]} held-out records (data CRC-32C "
                f"{facts['data_crc32c']:08x})")
        return out

    @property
    def origin(self) -> str:
        """One line with the date, the host, the program, the run and the command."""
        facts, name = self.provenance, os.path.basename
        live = (f" Recorded run {name(self.story.path)}." if self.story
                and self.story.path != self.run else "")
        command = " ".join(map(name, facts["command"].split()))
        return (f"{facts['date']}, {facts['host'].split()[0]}, {facts['program']}. Run "
                f"{name(self.run)}{' (simulated)' * self.simulated} of "
                f"{facts['recorded'][:20]}.{live} Command: "
                f"{command if len(command) <= 160 else command[:160] + ' ...'}")

    def first_pictures(self) -> Block:
        """Returns pictures of the first record: the ground-truth map, and the maps of the first
        model or of both compared models."""
        record, count = self.main[0], 2 if self.args.compare else 1
        text = record["caption"] + " " + "".join(map_remarks(block, count > 1)
                                                 for block in record["maps"][:count])
        text += (f"All maps on this page have the same depth scale, {self.span[0]:g} "
                 f"to {self.span[1]:g} m. ")
        return pictures(0, ["truth", *(f"{what} {m}" for what in ("map", "error")
                                       for m in range(count))],
                        text + "Errors: missed pixels are hatched, false pixels are dotted.",
                        title=record["title"], compare=count > 1)

    def record_blocks(self) -> list[Block]:
        blur = ("Relative depth of each pixel, from 0 (background) to 1 (mean body); a pixel above "
                "0.5 belongs to the body.")
        if any(model.sensors.endswith("alone") for model in self.models):
            blur += (" A single sensor does not determine whether the body is on the left or the "
                     "right, so its maps are blurred.")
        out = []
        for i, record in enumerate(self.main):
            show, maps = measured(record), record["maps"]
            for m, block in enumerate(maps):
                show += [f"map {m}", f"error {m}",
                         *([f"deviation {m}"] if "deviation" in block else [])]
            text = record["caption"] + " " + "".join(map_remarks(block, len(maps) > 1)
                                                     for block in maps)
            text += ("The uncertainty is the standard deviation of the depth; it is large where "
                     "a pixel may belong to the body or to the background.")
            out.append(details(record["title"], pictures(i, show, text),
                               pictures(i, ["truth", *(f"share {m}" for m in range(len(maps)))],
                                        blur, whole=True)))
        return out

    def failures(self) -> list[Block]:
        first = len(self.main) + len(self.gallery)
        live = self.live.scores if self.live else []
        rows = [(model.title, model.first)
                for model in self.models] + [(f"recorded run: {self.models[0].title}", scores)
                                           for scores in live]
        return [*fails(self.problems), tables.failures_table(self.models[0]),
                *([details("Maps of failing records", {"kind": "columns", "blocks": [
                    pictures(first + i, ["truth", "map 0", "error 0"],
                             map_remarks(record["maps"][0], False), title=record["title"])
                    for i, record in enumerate(self.failing)]})] if self.failing else []),
                tables.uncertainty_table(rows),
                *([paragraph(f"{self.first.outside}.")] if self.first.outside else []),
                *(paragraph(f"Scored run: {text}.") for text in self.first.remarks),
                *(paragraph(f"Recorded run: {text}.") for scores in live
                  for text in scores.remarks)]

    def live_blocks(self, story: Story) -> list[Block]:
        between, last = [], len(self.main) - 1
        if self.live:
            rows = [tables.Row(self.models[0].title, means_of(self.live.result["metrics"]),
                               self.live.scores[0]), *tables.rows_of([], self.live.result)]
            caption = (f"{self.live.result['records']} records of the recorded run, compared with "
                       "the maps of its depth camera")
            between = [*fails(self.live_problems), tables.metrics_table(rows, caption)]
        shown = [pictures(last, [*measured(record),
                                 *(["map 0", "error 0"] if record["maps"] else [])],
                          record["caption"], title=record["title"]) for record in self.main[last:]]
        return story.blocks(between, shown)

    def to_json(self) -> Block:
        """Returns the contents of the page in the format of blocks.py."""
        problems, most, models, compared = self.problems, 4, self.models, bool(self.args.compare)
        records = [*self.main, *self.gallery, *self.failing,
                   *([self.other_record] if self.other_record else [])]
        page: Block = {"title": "Two models on the same records" if compared
                       else "Depth maps from one pixel and one radar" if models or self.others else
                       "A recorded run", "verdict": self.verdict, "fails": problems[:most],
                       "more": "", "origin": self.origin,
                       "span": list(self.span), "records": records, "first": [], "sections": []}
        if models:
            page["more"] = (f"Details, and {len(problems) - most} more problems"
                            if len(problems) > most else "Details") * bool(problems)
            page["first"] = [self.first_pictures()] * bool(self.main) + [
                tables.first_table(models, self.evaluation.result)]
        elif self.others:
            page["first"] = self.others.table()[:1]
        columns = [pictures(len(self.main) + i, ["truth", "map 0", "error 0"],
                            map_remarks(record["maps"][0], False), title=record["title"])
                   for i, record in enumerate(self.gallery)]
        sections = (("failures", "Failures", self.failures), ("difference", "Difference",
                     lambda: tables.comparison(*models) if compared else []),
                    ("gallery", "Worst, median and best record",
                     lambda: [{"kind": "columns", "blocks": columns}]),
                    ("errors", "Error distributions",
                     lambda: [tables.errors(models, self.colours)]),
                    ("labels", "By label", lambda: tables.labels_table(models[0])),
                    ("metrics", "All metrics", 
                     lambda: tables.all_table(models, self.evaluation.result)),
                    ("maps", "Maps of other programs",
                     lambda: self.others.blocks(len(records) - 1, self.other_record)
                     if self.others else []), ("cost", "Cost", lambda: [tables.cost_table(models)]),
                    ("records", "Records and maps", self.record_blocks),
                    ("space", "3D view", lambda: [{"kind": "cloud", "record": 0}] if self.main
                     else []), ("live", "Recorded run",
                     lambda: self.live_blocks(self.story) if self.story else []),
                    ("training", "Training", lambda: tables.losses(models)),
                    ("made", "Provenance", lambda: listed(self.provenance.items())),
                    ("terms", "Terms", lambda: listed(TERMS)))
        for name, heading, blocks in sections:
            if (models or name in ("maps", "live", "made")) and (found := blocks()):
                page["sections"].append({"id": name, "heading": heading, "blocks": found})
        return page


def measured(record: Block) -> list[str]:
    """Returns the kinds of pictures of a record that require no model."""
    return ["truth", *(sensor for sensor in ("spd", "radar") if record[sensor]["count"] > 0)]


def require(args: argparse.Namespace) -> None:
    """Raises ReportError with exit code 2 if options are missing or cannot be combined."""
    for wrong, text in ((args.empty and not args.run, "--empty requires --run"),
                        (args.model and args.compare, "--compare cannot be combined with --model"),
                        (not args.run and args.compare, "--compare requires --run"),
                        (not args.run and args.maps, "--maps requires --run"),
                        (not args.run and args.model and not args.live,
                         "--model requires --run or --live"),
                        (args.run and not args.model and not args.compare and not args.maps,
                         "--run requires --model, --compare or --maps"),
                        (not args.run and not args.live,
                         "nothing to report: give --run with models, or --live")):
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
    """Runs echofuse-report with the arguments in sys.argv."""
    head, examples, *_ = (__doc__ or "").split("\n\n")
    parser = Parser(prog="echofuse-report", description=head.partition(": ")[2],
                    epilog=f"Examples:\n{examples}\n\n{EXIT_CODES}6 disk, 130 interrupted",
                    formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"echofuse-report {__version__}",
                        help="print the version and exit")
    parser.add_argument("dir", metavar="FOLDER", help="folder in which report.html is written")
    parser.add_argument("--run", metavar="RUN",
                        help="run on which the models are scored; only its held-out records are "
                             "used")
    parser.add_argument("--model", metavar="MODEL", nargs="+", action="extend", default=[],
                        help="model files, given as FILE or NAME=FILE; the report describes the "
                             "first model; files with the same NAME come from repeated training "
                             "runs of one model")
    parser.add_argument("--compare", metavar="MODEL", nargs=2,
                        help="compare two model files record by record")
    parser.add_argument("--maps", metavar="FOLDER", nargs="+", action="extend", default=[],
                        help="folders with maps from other programs, given as FOLDER or "
                             "NAME=FOLDER; for the format, see `echofuse-recon evaluate --maps`")
    parser.add_argument("--live", metavar="RUN",
                        help="report the events and the missing data of this recorded run; with "
                             "--model, also show its depth maps")
    parser.add_argument("--empty", metavar="RUN",
                        help="run recorded in the empty room; only needed if the room differs from "
                             "the training room")
    parser.add_argument("--force", action="store_true",
                        help="overwrite the report in FOLDER, even if it is on another run")
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
    remarks = report.first.remarks if report.models else []
    print("\n".join(map(printable, (report.verdict, *report.problems, *remarks, str(report.page)))))
