# SPDX-License-Identifier: MIT
"""echofuse-report: write a self-contained HTML page that scores models on held-out records,
compares two models record by record, or summarises a recorded run.

    echofuse-report page --run scenes.sqlite --model fused.safetensors --live monday.sqlite
    echofuse-report page --run scenes.sqlite --compare a.safetensors b.safetensors
    echofuse-report page --live monday.sqlite

`echofuse-recon evaluate --json --per-record` computes the scores, and `echofuse-view --save` writes
the page of the run."""
from __future__ import annotations

import argparse
import datetime
import json
import os
import pathlib
import sqlite3
import sys
import tempfile
from typing import Any, NoReturn

import numpy as np

from .. import __version__
from ..bench.methods import version, writing
from ..models.model import read_safetensors
from ..runs import run_files
from ..runs.programs import EXIT_CODES, call
from ..runs.staged import replaced, stop_by_signal
from . import tables
from .blocks import Block, details, fails, html_of, listed, paragraph
from .other_maps import OtherMaps, named_folders
from .scores import (Evaluation, ReportModel, ReportError, Scores, evaluate, lines_of, means_of,
                     read_models)

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


MAX_PICTURED = 30  # maximum number of failing records on the saved page
MARK = "<section id=\"report\" hidden></section>"  # place of the tables in the saved page


def info_of(path: str) -> dict[str, Any]:
    """Returns the JSON output of `echofuse-acquire info`."""
    return dict(json.loads(call("echofuse-acquire", "info", "--json", path, ok=(0, 5)).stdout))


def summary_of(info: dict[str, Any]) -> str:
    """Returns e.g. "complete: 20 records, 19 with all three sensors"."""
    n, whole = info["records"], info["all_valid"]
    out = f"{info['status']}: {n} record{'' if n == 1 else 's'}"
    out += f", {'all' if whole == n else whole} with all three sensors" if n else ""
    out += f"; {info['incomplete']} without a required sensor" if info["incomplete"] else ""
    return out + (f"; {info['doubts']}." if info["doubts"] else ".")


class Report:
    """Contents of the report: scores of models above the saved page of the scored run. If a
    recorded run is given in addition, its page is a second file."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.args, self.run = args, args.run or args.live
        self.options = [*(["--empty", args.empty] if args.empty else []),
                        *(word for run in args.train for word in ("--train", run))]
        self.info = info_of(self.run)
        self.page = pathlib.Path(args.dir) / "report.html"
        if (not args.force and self.page.exists()
            and self.info["uuid"] not in self.page.read_text(encoding="utf-8")):
            raise ReportError(
                f"{args.dir}: contains a report of another run; give another folder, or --force "
                "to overwrite it", 2)
        self.simulated = self.info["notes"].startswith("simulated")
        self.models: list[ReportModel] = []  # models with the same inputs are adjacent
        self.others: OtherMaps | None = None
        self.live: Evaluation | None = None
        self.live_info = info_of(args.live) if args.live else None
        if args.model or args.compare:
            self.add_models()
        if args.maps:
            self.others = OtherMaps(named_folders(args.maps), self.run, self.models, self.options)
        if self.models and args.live not in (None, self.run):
            self.live = evaluate(self.models[0].files[:1], args.live, self.options)
        self.provenance = self.read_provenance()

    def add_models(self) -> None:
        compared = bool(self.args.compare)
        self.models = read_models(self.args.compare or self.args.model, compared)
        self.evaluation = evaluate([path for model in self.models for path in model.files],
                                   self.run, self.options)
        scores, paired = iter(self.evaluation.scores), iter(
            [{}, *(pair["metrics"] for pair in self.evaluation.result.get("paired", []))])
        for model in self.models:
            model.scores = [next(scores) for _ in model.files]
            model.differences, *_ = [next(paired) for _ in model.files]
        if compared and not self.models[1].differences:
            raise ReportError(
                "the models have different held-out records; choose a run that is new to both")

    @property
    def first(self) -> Scores:
        return self.models[0].first

    @property
    def verdict(self) -> str:
        """Headline of the page."""
        simulated = "simulated" if self.simulated else "recorded"
        if not self.models and self.others:
            return self.others.verdict
        if not self.models:
            return f"The {'simulated ' * self.simulated}run is {summary_of(self.info)}"
        if self.args.compare:
            return tables.comparison_verdict(self.models[1], simulated)
        facts = self.models[0].facts[0]
        training = [facts[f"split/run/{k}"] for k in range(facts["split/runs"])]
        return tables.models_verdict(self.models, self.evaluation, simulated,
                                     self.info["uuid"] not in training)

    @property
    def live_problems(self) -> list[str]:
        out = tables.problems_of_run(self.live.scores[0], "Recorded run: ") if self.live else []
        if self.live_info and self.live_info["doubts"]:
            out.append(f"Recorded run: {self.live_info['doubts']}.")
        own_s, scored_s = (self.live_info or self.info)["window_s"], self.info["window_s"]
        if self.live and own_s != scored_s > 0:
            out.append(f"Recorded run: its slots last {own_s:g} s, but the slots of the scored "
                       f"run last {scored_s:g} s.")
        return out

    @property
    def problems(self) -> list[str]:
        """Sentences that describe problems, the most serious problem first."""
        return self.live_problems + (tables.problems_of_run(self.first) if self.models else [])

    @property
    def remarks(self) -> list[str]:
        """All other lines of text that `evaluate` returned."""
        results = [found.result for found in (self.evaluation if self.models else None, self.live,
                                              self.others and self.others.evaluation) if found]
        shown = " ".join(self.problems)
        return [line for line in lines_of(results) if line not in shown]

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
            out |= {"data CRC-32C": f"{self.evaluation.result['data_crc32c']:08x}",
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
        live = f" Recorded run {name(self.args.live)}." if self.live else ""
        command = " ".join(map(name, facts["command"].split()))
        return (f"{facts['date']}, {facts['host'].split()[0]}, {facts['program']}. Run "
                f"{name(self.run)}{' (simulated)' * self.simulated} of "
                f"{facts['recorded'][:20]}.{live} Command: "
                f"{command if len(command) <= 160 else command[:160] + ' ...'}")

    def pictured(self) -> list[int]:
        """Returns the records that the page must contain: the worst, the median and the best one
        of the first model, and its failing records."""
        if not self.models:
            return []
        order = self.first.order
        ends = [order[int(share * (len(order) - 1))] for share in (0, 0.5, 1)]
        failing = [index for _, _, which in tables.failing(self.first) for index in which[:8]]
        return list(dict.fromkeys([*ends, *failing]))[:MAX_PICTURED]

    def failures(self) -> list[Block]:
        rows = [(model.title, model.first) for model in self.models]
        rows += [(f"recorded run: {self.models[0].title}", scores)
                 for scores in (self.live.scores if self.live else [])]
        return [tables.failures_table(self.models[0]), tables.uncertainty_table(rows),
                *([paragraph(f"{self.first.outside}.")] if self.first.outside else [])]

    def live_blocks(self, live: Evaluation) -> list[Block]:
        rows = [tables.Row(self.models[0].title, means_of(live.result["metrics"]), live.scores[0]),
                *tables.rows_of([], live.result)]
        return [paragraph(f"{self.args.live}: {summary_of(info_of(self.args.live))}"),
                paragraph("live.html", "link"), *fails(self.live_problems), tables.metrics_table(
                    rows, f"{live.result['records']} records of the recorded run, compared with "
                          "the maps of its depth camera")]

    def blocks(self) -> list[Block]:
        models, out = self.models, [paragraph(self.verdict, "verdict"), *fails(self.problems),
                                    paragraph(self.origin, "quiet")]
        order = self.first.order if models else []
        if order:
            out += [tables.first_table(models, self.evaluation.result), {
                "kind": "table", "caption": "", "baselines": 0, "head": ["IoU of the first model",
                "record"], "rows": [[title, {"text": "", "records": [index]}] for title, index in
                zip(("lowest", "median", "highest"), self.pictured())]}]
        sections = [("Failures", self.failures if models else None),
                    ("Difference", (lambda: tables.comparison(*models)) if self.args.compare
                     else None),
                    ("By label", (lambda: tables.labels_table(models[0])) if models else None),
                    ("All metrics", (lambda: tables.all_table(models, self.evaluation.result))
                     if models else None),
                    ("Maps of other programs", self.others.table if self.others else None),
                    ("Cost", (lambda: [tables.cost_table(models)]) if models else None),
                    ("Recorded run", (lambda: self.live_blocks(self.live)) if self.live else None),
                    ("Remarks", lambda: [paragraph(f"{line}.") for line in self.remarks]),
                    ("Provenance", lambda: listed(self.provenance.items())),
                    ("Terms", (lambda: listed(TERMS)) if models else None)]
        return out + [details(heading, *found) for heading, blocks in sections
                      if blocks and (found := blocks())]

    def write(self) -> None:
        # `echofuse-view` cannot adapt a model to another room, so the page shows no maps then.
        model = ["--model", self.models[0].files[0]] if self.models and not self.args.empty else []
        records = [word for index in self.pictured() for word in ("--records", index)]
        with writing(self.page), tempfile.TemporaryDirectory(prefix="echofuse-report-") as folder:
            pages = {self.page: (self.run, records, html_of(self.blocks()))}
            if self.live:
                pages[self.page.with_name("live.html")] = (self.args.live, [], "")
            for k, (page, (run, words, text)) in enumerate(pages.items()):
                saved = pathlib.Path(folder) / f"{k}.html"
                call("echofuse-view", "--save", saved, run, *model, *words)
                whole = saved.read_text(encoding="utf-8")
                page.parent.mkdir(parents=True, exist_ok=True)
                with replaced(page) as new:
                    new.write_text(whole.replace(MARK, f"<section id=\"report\">\n{text}</section>")
                                   if text else whole, encoding="utf-8")


def require(args: argparse.Namespace) -> None:
    """Raises ReportError with exit code 2 if options are missing or cannot be combined."""
    for wrong, text in ((args.empty and not args.run, "--empty requires --run"),
                        (args.train and not args.run, "--train requires --run"),
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
    parser.add_argument("--train", metavar="RUN", nargs="+", action="extend", default=[],
                        help="training runs, which define the foreground and the background and "
                             "provide the neighbours of the nearest-neighbour baseline")
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
        report.write()
    except (KeyboardInterrupt, RuntimeError, ValueError, OSError, sqlite3.Error) as error:
        if stopped:
            sys.exit(130)
        print(f"echofuse-report: {run_files.printable(str(error))}", file=sys.stderr)
        sys.exit(getattr(error, "code", 1))
    print("\n".join(map(run_files.printable, (report.verdict, *report.problems, *report.remarks,
                                              str(report.page)))))
