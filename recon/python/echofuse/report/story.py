# SPDX-License-Identifier: MIT
"""Describes a recorded run without using a model: sensor data as a function of time, losses and
events."""
from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import runs
from ..runs.batches import blocks as in_blocks
from ..runs.programs import call
from ..runs.zones import summed
from .blocks import NONE, Block, details, packed, paragraph, short, table
from .records import decibels
from .scores import Values

__all__ = ["Story", "info_of"]

SENSORS = {"spd": "SPD", "radar": "radar", "depth": "depth camera"}
MAX_POINTS = 400  # maximum number of points per curve; more points could not be distinguished


def info_of(path: str) -> dict[str, Any]:
    """Returns the JSON output of `echofuse-acquire info`."""
    return dict(json.loads(call("echofuse-acquire", "info", "--json", path, ok=(0, 5)).stdout))


class Story:
    """Sensor data, losses and events of a run as a function of time. Times are in `unit`, relative
    to the start of the first slot."""

    def __init__(self, path: str) -> None:
        self.path, self.info, self.run = path, info_of(path), runs.open(path)
        self.quality = self.run.quality()
        self.unreadable: list[str] = []  # error messages about records, added by waterfalls()
        seconds = (self.run.time - self.run.time[:1]) / np.timedelta64(1, "s")
        whole = seconds[-1] if len(seconds) else 0
        self.unit, by = ("h", 3600) if whole > 7200 else ("min", 60) if whole > 180 else ("s", 1)
        self.at, self.end = seconds / by, (
            whole + self.quality["length_s"][-1]) / by if len(seconds) else 1

    @property
    def verdict(self) -> str:
        """Returns a summary, e.g. "complete: 20 records, 19 with all three sensors"."""
        n, whole = self.info["records"], self.info["all_valid"]
        out = f"{self.info['status']}: {n} record{'' if n == 1 else 's'}"
        if n == 0:
            return out
        out += f", {'all' if whole == n else whole} with all three sensors"
        out += (f"; {self.info['incomplete']} without a required sensor"
                if self.info["incomplete"] else "")
        return out + (f"; {self.info['doubts']}." if self.info["doubts"] else ".")

    def gaps(self, sensor: str) -> list[list[float]]:
        """Returns the start and the end of each gap in the data of a sensor. If there are more than
        MAX_POINTS gaps, returns only the longest gaps."""
        lacks = np.concatenate([[False], ~self.run.valid[sensor], [False]]).astype(int)
        times, steps = np.append(self.at, self.end), np.diff(lacks)
        found = np.column_stack([times[steps > 0], times[steps < 0]])
        return sorted(found[np.argsort(found[:, 0] - found[:, 1],
                                       kind="stable")][:MAX_POINTS].tolist())

    @property
    def losses(self) -> list[str]:
        """One sentence for each sensor that has no data at the end of the run, or in more than 5 %
        of the records. Sensors without any data are omitted."""
        by_time: dict[str, list[str]] = {}
        out, n = [], self.info["records"]
        for sensor, name in SENSORS.items():
            if (lacking := n - self.info["valid"][sensor]) in (0, n):
                continue
            begin, end = self.gaps(sensor)[-1]
            if end == self.end:
                by_time.setdefault(f"{begin:.4g} {self.unit}", []).append(name)
            elif lacking * 20 > n:
                out.append(f"{lacking} of {n} records have no data from the {name}.")
        return out + [f"no data from {', '.join(names)} after {time}."
                      for time, names in sorted(by_time.items())]

    def curve(self, values: Values, gather: Callable[..., Any] = np.mean) -> list[float | None]:
        """Combines neighbouring values into at most MAX_POINTS points. A point without values
        becomes None, or 0 for sums."""
        step = len(values) // MAX_POINTS + 1
        parts = (part[~np.isnan(part)] for part in (values[i:i + step]
                                                    for i in range(0, len(values), step)))
        return [short(gather(part)) if len(part) or gather is np.sum else None for part in parts]

    def strips(self) -> Block:
        """Returns the arrays for the class Strip of the live page (recon/web/charts.js), and the
        gaps of the sensors."""
        arrays = {"first": self.curve(self.at)}
        for s, valid in self.run.valid.items():
            quality = self.quality
            arrays |= {f"{name}_{s}": self.curve(np.where(valid, quality[f"{s}_{key}"], np.nan))
                       for name, key in (("used", "used"), ("residual_s", "clock_residual_s"))}
            arrays[f"lost_{s}"] = self.curve(self.quality[f"{s}_lost"], np.sum)
        gaps = {s: [[short(begin), short(end)] for begin, end in self.gaps(s)] for s in SENSORS}
        return {"kind": "strips", "unit": self.unit, "end": short(self.end), "arrays": arrays,
                "gaps": gaps, "window_s": self.info["window_s"]}

    def waterfalls(self) -> list[Block]:
        """Returns the counts and the power as images [columns, bins] with time along the columns,
        as on the live page: log(1 + clicks), and radar power in dB above its median. Each column is
        the mean over neighbouring records. The pixels are 8-bit values: 254 is the maximum
        (`most`), and 255 means no data."""
        def over_median(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.maximum(values - np.sort(values, 1)[:, [values.shape[1] // 2]], 0)

        run, step = self.run[0:len(self.run)], len(self.run) // MAX_POINTS + 1
        run.valid["depth"][:] = False  # skips reading the depth images
        axes = {sensor: self.run.axes[sensor]
                for sensor in ("spd", "radar") if sensor in self.run.axes}
        sums = {sensor: np.zeros(((len(run) - 1) // step + 1, axis.count))
                for sensor, axis in axes.items()}
        records = {sensor: np.zeros((len(table), 1)) for sensor, table in sums.items()}
        for first, part, faults in in_blocks(run):
            self.unreadable += [f"record {part.index[row]}: {fault}"
                                for row, fault in faults.items()]
            for sensor in axes:
                valid = part.valid[sensor]
                if valid.any():
                    values = np.log1p(summed(part.spd)[valid]) if sensor == "spd" else over_median(
                        decibels(np.nan_to_num(part.radar[valid])))
                    columns = (first + np.flatnonzero(valid)) // step
                    np.add.at(sums[sensor], columns, values)
                    np.add.at(records[sensor], columns, 1)
        out = []
        for sensor, axis in axes.items():
            if not records[sensor].any():
                continue
            means = np.divide(sums[sensor], records[sensor], out=np.full_like(sums[sensor], np.nan),
                              where=records[sensor] > 0)
            most, unit_m = max(float(np.nanmax(means)),
                               1), 1 / runs.PS_PER_M if sensor == "spd" else 1
            image = np.nan_to_num(254 * means / most, nan=255)
            out.append({"sensor": sensor, "values": packed(image, 1, "u1"), "columns": len(image),
                        "bins": axis.count, "most": short(most), "start_m": axis.start * unit_m,
                        "end_m": (axis.start + axis.count * axis.step) * unit_m})
        return [{"kind": "waterfalls", "unit": self.unit, "end": short(self.end),
                 "tables": out}] if out else []

    def typical(self) -> list[int]:
        """Returns a list with one record index, or an empty list if the run has no records. The
        record is in the middle of the records with data from the most sensors."""
        count = np.sum(list(self.run.valid.values()), 0)
        best: list[int] = self.run.index[count == count.max(initial=0)].tolist()
        return best[len(best) // 2:len(best) // 2 + 1]

    def blocks(self, between: Sequence[Block], pictures: Sequence[Block]) -> list[Block]:
        """Returns the tables and charts of the run. The blocks in `between` are inserted after the
        verdict."""
        rows = []
        for s, name in SENSORS.items():
            verdicts = "; ".join(f"{count} {kind}"
                                 for kind, count in sorted(self.info["verdicts"][s].items())
                                 if kind != "ok")
            valid, lost = self.info["valid"][s], self.info["lost"][s]
            rows.append([name, str(valid), str(self.info["records"] - valid),
                         f"{lost} {'tags' if s == 'spd' else 'frames'}", verdicts or NONE])
        reason = {"text": "verdicts other than ok", "words": True}
        out = [paragraph(f"{self.path}: {self.verdict}"), *between,
               table("", ["sensor", "records with data", "without data", "lost within records",
                          reason], rows)]
        if self.info["zones"]:
            out.append(table("Clicks of the zones", ["zone", "clicks", "x", "y"], [
                [str(k), f"{zone['clicks']:.0f}", *(f"{zone[at]:+.3f}" if at in zone else NONE
                                                    for at in "xy")]
                for k, zone in enumerate(self.info["zones"])]))
        out += [self.strips(), *self.waterfalls(), *pictures] if len(self.run) else []
        out += [paragraph(
            f"{len(self.unreadable)} record{'s' * (len(self.unreadable) > 1)} cannot be read: "
            f"{'; '.join(self.unreadable[:10])}.")] if self.unreadable else []
        labels = [[label or "(none)", str(count)]
                  for label, count in sorted(self.info["labels"].items())]
        out += [details("Labels", table("", ["label", "records"],
                                        labels))] if len(labels) > 1 else []
        events, heads = self.run.events(), ["UTC", "level", {"text": "source", "words": True},
                                            {"text": "event", "words": True}]
        return out + ([details(f"Events ({len(events)})", table("", heads, events[:200]))] if events
                      else [])
