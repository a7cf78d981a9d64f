# SPDX-License-Identifier: MIT
"""Draws figures of records, maps and bench tables."""
from __future__ import annotations

import csv
import io
import pathlib
import re
from collections.abc import Iterable, Sequence
from typing import Any, Union

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike, NDArray

from .. import models, runs
from ..models.maps import span_of
from ..runs.arguments import entries, plain, refused
from ..runs.run import opened

__all__ = ["COLOURS", "figure", "learning_curve", "map", "maps", "opened", "pareto", "record",
           "shares", "stability", "table", "timeline"]

COLOURS = {"spd": "#0b5cad", "radar": "#a64200", "depth": "#00695c", "both": "#16191d",
           "papers": "#5b0f75", "grey": "#6a7078", "bad": "#b3201a"}
NO_RETURN = "#e8eaed"
Path = str | pathlib.Path
Panels = Union[Axes, Sequence[Axes], None]

# Helper functions for panels


class Picture(Figure):  # type: ignore[misc]
    """A Figure that notebooks display without pyplot."""

    def _repr_png_(self) -> bytes:
        out = io.BytesIO()
        self.savefig(out, format="png")
        return out.getvalue()


def figure(columns: int = 1, rows: int = 1, wide: float = 4.6, high: float = 3.4,
           ax: Panels = None) -> tuple[Figure, NDArray[Any]]:
    """Creates a figure with columns x rows panels, or uses the panels in `ax`. Returns the figure
    and its panels. Raises ValueError if `ax` has too few panels."""
    if ax is not None:
        axes = np.atleast_1d(np.array(ax, object)).ravel()
        if len(axes) < columns * rows:
            raise ValueError(f"ax has {len(axes)} panels (expected {columns * rows})")
        return axes[0].figure, axes[:columns * rows]
    fig = Picture(figsize=(wide * columns, high * rows), layout="constrained")
    FigureCanvasAgg(fig)
    axes = fig.subplots(rows, columns, squeeze=False).ravel()
    for panel in axes:
        panel.spines[["top", "right"]].set_visible(False)
    return fig, axes


def plain_log(ax: Axes, *sides: str) -> None:
    """Makes the axes "x" or "y" logarithmic with plain tick labels such as 0.1, 1 and 10. An axis
    that spans only a few decades also has labels such as 3 and 30, or 2, 5, 20 and 50."""
    for side in sides:
        ax.set(**{f"{side}scale": "log"})
        axis = getattr(ax, f"{side}axis")
        low, high = sorted(getattr(ax, f"get_{side}lim")())
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 30 * low else (1, 3)
                                          if high < 300 * low else (1,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}".replace(",", " ")))
        axis.set_minor_formatter(NullFormatter())

# Figures of maps and records


def draw_map(ax: Axes, depth_m: ArrayLike, x: ArrayLike, y: ArrayLike,
             span: tuple[float, float] | None = None, title: str = "", bar: bool = True) -> None:
    """Draws depths [rows, columns], m, over the tangents x and y of the pixel centres. Near pixels
    are bright; values <= 0 mean no return. If no `span` is given, the values are fractions from 0
    to 1."""
    values, x, y = (np.asarray(plain("maps", table)[0], float) for table in (depth_m, x, y))
    image_values = np.where(values > 0, values, np.nan) if span else values
    dx, dy = abs(x[1] - x[0]) / 2, abs(y[1] - y[0]) / 2
    if y[0] < y[-1]:
        image_values, y = image_values[::-1], y[::-1]
    edges = (x[0] - dx, x[-1] + dx, y[-1] - dy, y[0] + dy)
    low, high = span or (0, 1)
    image = ax.imshow(image_values, cmap="viridis_r" if span else "inferno", vmin=low, vmax=high,
                      extent=edges, interpolation="nearest")
    ax.set_facecolor(NO_RETURN)
    ax.spines[:].set_visible(False)
    for axis, first, last in ((ax.xaxis, *edges[:2]), (ax.yaxis, *edges[2:])):
        degrees = [d for d in range(-80, 81, 20) if first < np.tan(np.radians(d)) < last]
        axis.set_ticks([float(np.tan(np.radians(d))) for d in degrees], [f"{d}°" for d in degrees])
    ax.set_title(title, fontsize=10)
    if bar:
        ax.figure.colorbar(image, ax=ax, label="m" if span else "", shrink=0.85)


MapSource = Union[ArrayLike, models.Maps, runs.Run]


def map_of(source: MapSource, index: int | None,
           half_tangent: float | None) -> tuple[NDArray[Any], float]:
    """Returns a map [N, N] and the tangent at its edges. The source is an array, Maps, or a run
    with ground-truth maps; `index` is a record index of Maps or of the run. Raises KeyError if the
    record is missing, and TypeError if the source is an array and half_tangent is not given."""
    if isinstance(source, models.Maps):
        return source.depth_m[row_of(source, index)], source.half_tangent
    if isinstance(source, runs.Run):
        return source.map_of(row_of(source, index)), source.half_tangent
    if half_tangent is None:
        raise TypeError("half_tangent is required for an array of depths (see Maps.half_tangent)")
    return np.asarray(source), half_tangent


def row_of(source: models.Maps | runs.Run, index: int | None) -> int:
    rows = np.flatnonzero(source.index == index) if index is not None else np.arange(1)
    if not len(rows) or not len(source):
        raise KeyError(f"{getattr(source, 'path', 'maps')}: no record {index}")
    return int(rows[0])


def titles_and_maps(named: dict[str, Any]) -> tuple[list[str], list[Any]]:
    """Returns the keys and values of a dict. Raises ValueError if it is not a dict, or empty."""
    found = entries("named", named)
    if not found:
        raise refused("named", named, "at least one map")
    return [title for title, _ in found], [source for _, source in found]


def map(source: MapSource, half_tangent: float | None = None, *,  # noqa: A001
        index: int | None = None, span: tuple[float, float] | None = None, title: str = "",
        ax: Panels = None) -> Figure:
    """Draws one map. The source is an array [N, N], Maps, or a run with ground-truth maps.
    `half_tangent` is the tangent at the edges of an array. `index` is a record index of Maps or of
    the run (default: that of the first record)."""
    return maps({title: source}, half_tangent, index=index, span=span, ax=ax)


def maps(named: dict[str, MapSource], half_tangent: float | None = None, *,
         index: int | None = None, span: tuple[float, float] | None = None,
         ax: Panels = None) -> Figure:
    """Draws several maps of one record side by side with a common colour scale, e.g. maps({"truth":
    run, "ours": maps}, index=7)."""
    titles, sources = titles_and_maps(named)
    found = [map_of(source, index, half_tangent) for source in sources]
    span = span or span_of(np.concatenate([np.ravel(values) for values, _ in found]))
    return side_by_side(titles, found, [span] * len(found), ax)


def shares(named: dict[str, ArrayLike], half_tangent: float, *, ax: Panels = None) -> Figure:
    """Draws the ground-truth map next to maps of the relative depth, which is 0 at the background
    and 1 at the body."""
    titles, tables = titles_and_maps(named)
    found = [(np.asarray(values), half_tangent) for values in tables]
    return side_by_side(titles, found, [span_of(found[0][0])] + [None] * (len(found) - 1), ax)


def side_by_side(titles: Iterable[str], found: Sequence[tuple[NDArray[Any], float]],
                 spans: Sequence[tuple[float, float] | None], ax: Panels) -> Figure:
    fig, axes = figure(len(found), wide=2.9, high=2.7, ax=ax)
    for k, (panel, title, (values, half_tangent),
            span) in enumerate(zip(axes, titles, found, spans)):
        at = half_tangent * ((2 * np.arange(len(values)) + 1) / len(values) - 1)
        draw_map(panel, values, at, -at, span, title, k == len(found) - 1 or span != spans[k + 1])
    return fig


def power_by_direction(run: runs.Run, row: int, sines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the linear power received from each azimuth [points, sines], computed from the
    samples of the horizontal antennas (Bartlett beam). `sines` contains the sines of the
    azimuths."""
    lags = run.lags()[row].astype(float)
    out = np.ones((len(lags), len(sines)))
    axis = run.lags_axis
    across = (lags.shape[1] - 1) // 2
    if axis is not None and axis.quantity.endswith(" up"):
        across -= int(axis.quantity.split(", ")[-1].split()[0])
    for lag in range(1, across + 1):
        phase = np.pi * lag * sines
        real, imaginary = lags[:, 2 * lag - 1, None], lags[:, 2 * lag, None]
        out += 2 * (1 - lag / (across + 1)) * (real * np.cos(phase) - imaginary
                                               * np.sin(phase)) / np.maximum(lags[:, :1], 1e-30)
    return np.asarray(np.maximum(out, 0) * lags[:, :1])


def record(run: runs.Run | Path, index: int, *, ax: Panels = None) -> Figure:
    """Draws the depth image, the histogram and the range profile of a record. If the run has
    antenna samples, also draws the power as a function of range and azimuth. Raises KeyError if the
    record is missing."""
    run = opened(run)
    rows = np.flatnonzero(run.index == index)
    if not len(rows):
        raise KeyError(f"{run.path}: no record {index}")
    row, antennas = int(rows[0]), run.lags_axis is not None
    fig, axes = figure(4 if antennas else 3, wide=3.7, high=2.9, ax=ax)
    label = run.labels[row]
    if ax is None:
        fig.suptitle(", ".join(filter(None, [run.path.name, f"record {index}", label])),
                      fontsize=10)
    camera, spd, radar = axes[:3]
    if run.valid["depth"][row] and "depth_x" in run.axes:
        depth = np.nan_to_num(run.depth[row])
        draw_map(camera, depth, run.axes["depth_x"].values, run.axes["depth_y"].values,
                 span_of(depth), "depth camera")
    else:
        camera.set_title("no depth in this record", fontsize=10)
    if "spd" in run.axes and run.valid["spd"][row]:
        for counts in np.atleast_2d(run.spd[row]):  # draws one line per zone
            spd.step(run.axes["spd"].values / runs.PS_PER_M, counts, where="post",
                     color=COLOURS["spd"], lw=0.9)
    spd.set(xlabel="range (m)", ylabel="clicks")
    spd.set_title("SPD", fontsize=10)
    if "radar" in run.axes and run.valid["radar"][row]:
        decibels = 10 * np.log10(np.maximum(run.radar[row], 1e-30))
        radar.plot(run.axes["radar"].values, decibels - np.median(decibels), color=COLOURS["radar"],
                   lw=1.1)
    radar.set(xlabel="range (m)", ylabel="dB over the median",
              ylim=(-10, max(30, radar.get_ylim()[1])))
    radar.set_title("radar", fontsize=10)
    if antennas and run.lags_axis is not None:
        degrees, axis = np.linspace(-72, 72, 97), run.lags_axis
        decibels = 10 * np.log10(
            np.maximum(power_by_direction(run, row, np.sin(np.radians(degrees))), 1e-30))
        image = axes[3].pcolormesh(degrees, axis.values, decibels - decibels.max(), cmap="viridis",
                                   vmin=-25, vmax=0, rasterized=True)
        axes[3].set(xlabel="azimuth (degrees)", ylabel="range (m)")
        axes[3].set_title("radar antennas", fontsize=10)
        fig.colorbar(image, ax=axes[3], label="dB")
    return fig


def timeline(run: runs.Run | Path, *, ax: Panels = None) -> Figure:
    """Draws the clock residuals and the sensor rates as functions of time. Missing data are marked
    in red. A sensor without any data has no panel."""
    run = opened(run)
    window = float(run.info["window_s"])
    columns_of = [f"{sensor}_{name}" for name in ("used", "clock_residual_s")
                  for sensor in runs.SENSORS]
    found = np.array(run.of_records(", ".join(columns_of)), float).reshape(-1, 6)
    used, clocks = found[:, :3], found[:, 3:]
    names = {"spd": "SPD (clicks/s)", "radar": "radar (frames/s)",
             "depth": "camera (frames/s used)"}
    columns = {sensor: k for k, sensor in enumerate(names)}
    names = {sensor: name for sensor, name in names.items() if run.valid[sensor].any()}
    fig, axes = figure(1, len(names) + 1, wide=6.4, high=1.25, ax=ax)
    *axes, residuals = axes[:len(names) + 1]
    minutes = (run.time - run.time[0]) / np.timedelta64(1, "s") / 60 if len(run) else np.zeros(0)
    for panel, (sensor, name) in zip(axes, names.items()):
        panel.plot(minutes, used[:, columns[sensor]] / window, color=COLOURS[sensor], lw=1)
        panel.set_ylim(0, panel.get_ylim()[1])  # the red lines must not change the limits
        panel.vlines(minutes[~run.valid[sensor]], 0, 1, color=COLOURS["bad"], lw=1, alpha=0.6,
                     transform=panel.get_xaxis_transform())
        panel.set_ylabel(name.replace(" ", "\n", 1), fontsize=8)
    for sensor in names:
        residuals.plot(minutes, 1e6 * clocks[:, columns[sensor]], color=COLOURS[sensor], lw=1,
                       label={"spd": "SPD", "depth": "camera"}.get(sensor, sensor))
    residuals.set_ylabel("residual\n(µs)", fontsize=8)
    if residuals.lines:
        residuals.legend(fontsize=7, frameon=False, ncols=3, loc="upper left")
    for panel in (*axes, residuals):
        panel.set_xlim(0, max(float(minutes[-1]) if len(run) else 0, 1e-3))
    residuals.set_xlabel("time (min)")
    return fig


# Figures of bench tables and models


def table(path: Path) -> list[dict[str, Any]]:
    """Reads a table written by echofuse-bench. Returns the last row of each method, condition and
    seed. Numeric columns contain floats, with NaN for missing values."""
    texts = {"axis", "value", "model", "inputs", "source", "files", "machine", "known"}

    def number(text: str) -> float:
        try:
            return float(text)
        except ValueError:
            return float("nan")

    with open(path, encoding="utf-8") as lines:
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        keys = ("axis", "value", "model", "inputs", "seed")
        last = {tuple(row.get(key) for key in keys): row for row in rows}
        return [{key: text if key in texts else number(text)
                 for key, text in row.items()} for row in last.values()]


def name_of(row: dict[str, Any]) -> str:
    inputs = {"spd": ", SPD alone", "radar": ", radar alone", "fused-profile": ", one antenna"}
    return str(row["model"]) + inputs.get(row["inputs"], "")


def colour_of(name: str, taken: Iterable[str] = ()) -> str:
    """Returns the default colour of a method or, if this colour is in `taken`, a different colour.
    The default colour of a method that uses only one sensor is the colour of this sensor."""
    first = ("spd" if "SPD" in name else "radar" if "radar" in name else "papers"
             if name.startswith("mlp") else
             "both" if name.startswith("factorised") else "grey" if name == "nearest" else "depth")
    free = [c for c in (first, "depth", "radar", "spd", "papers", "both")
            if COLOURS[c] not in set(taken)]
    return COLOURS[free[0] if free else "grey"]


def over_seeds(rows: Sequence[dict[str, Any]], metric: str) -> tuple[float, float]:
    """Returns the mean and the standard deviation of a metric over the seeds."""
    values = np.array([row[metric] for row in rows])
    return float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else 0.0


def _costs(panel: Axes, methods: dict[str, list[dict[str, Any]]], cost: str, metric: str,
           unit: float) -> tuple[list[tuple[float, float]], str]:
    """Draws a metric against a cost. Returns the points, and the names of the methods without a
    known cost."""
    points, without = [], []
    for k, (name, rows) in enumerate(methods.items()):
        costs = [row[cost] for row in rows if row[cost] > 0]
        mean, spread = over_seeds(rows, metric)
        if not costs:
            without.append(name)
            continue
        x = float(np.mean(costs))
        panel.errorbar(x, unit * mean, unit * spread or None, fmt="os^v"[k // 10 % 4], ms=5,
                       capsize=3, color=f"C{k % 10}", label=name)
        points.append((x, unit * mean))
    return points, ", ".join(without)


def _iou_by_time(panel: Axes, methods: dict[str, list[dict[str, Any]]]) -> None:
    points, without = _costs(panel, methods, "infer_us_median", "iou", 1)
    front: list[tuple[float, float]] = []
    for at, y in sorted(points):
        if not front or y > front[-1][1]:
            front.append((at, y))
    panel.step([x for x, _ in front], [y for _, y in front], where="post",
               color=COLOURS["grey"], lw=1, zorder=0, label="Pareto front")
    panel.legend(fontsize=7, frameon=False, ncols=1 + len(methods) // 6, loc="upper left",
                 bbox_to_anchor=(0, -0.15))
    panel.set(xlabel="time per map, single record (µs, median)", ylabel="IoU")
    if without:
        panel.set_title(f"time not measured: {without}", loc="left", fontsize=7, wrap=True)
    plain_log(panel, "x")
    panel.margins(0.12)


def _error_by_cost(panel: Axes, methods: dict[str, list[dict[str, Any]]],
                   bound_m: float | None) -> None:
    _, without = _costs(panel, methods, "multiply_adds", "lateral_m", 100)
    if bound_m:
        panel.axhline(100 * bound_m, color=COLOURS["grey"], ls="--", lw=1)
        panel.text(0.01, 100 * bound_m, f"lower bound: {100 * bound_m:g} cm",
                   transform=panel.get_yaxis_transform(), va="bottom", fontsize=8)
    panel.set(xlabel="multiply-adds per map", ylabel="lateral error (cm)")
    if without:
        panel.text(0, -0.2, f"not counted: {without}", wrap=True, fontsize=7,
                   transform=panel.transAxes, va="top")
    plain_log(panel, *"xy")
    panel.margins(0.12)


def pareto(path: Path, *, bound_m: float | None = None, axis: str = "model",
           ax: Panels = None) -> Figure:
    """Draws the results of `echofuse-bench pareto`: IoU against time with the Pareto front, lateral
    error against multiply-adds, and IoU with reduced numbers of photons and training records.
    `bound_m` is a lower bound on the lateral error, m. `axis` is "model", or the name of a
    benchmark track."""
    rows = table(path)
    by_model: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        by_model.setdefault((row["axis"], row["value"], name_of(row)), []).append(row)
    sweeps = [sweep for sweep in ("photons", "records")
              if any(row["axis"] == sweep for row in rows)]
    shape = (2, 1 + (len(sweeps) + 1) // 2) if ax is None else (2 + len(sweeps), 1)
    fig, axes = figure(*shape, wide=5.4, high=4.0, ax=ax)
    methods = {name: group for (kind, _, name), group in by_model.items() if kind == axis}
    hidden = [name for name in methods if not over_seeds(methods[name], "iou")[0] >= 0.01]
    methods = {name: group for name, group in methods.items() if name not in hidden}
    _iou_by_time(axes[0], methods)
    if hidden:
        axes[0].text(0.99, 0.01, f"not shown (IoU below 0.01): {', '.join(hidden)}", fontsize=7,
                     transform=axes[0].transAxes, ha="right", va="bottom")
    _error_by_cost(axes[1], methods, bound_m)
    for panel, sweep in zip(axes[2:], sweeps):
        taken: list[str] = []
        for name in dict.fromkeys(key[2] for key in by_model if key[0] == sweep):
            line = sorted((float(value), *over_seeds(group, "iou"))
                          for (kind, value, other), group in by_model.items()
                          if other == name and kind in (sweep, axis))
            taken.append(colour_of(name, taken))
            panel.errorbar(*zip(*line), fmt="o-", ms=4, capsize=3, color=taken[-1], label=name)
        plain_log(panel, "x")
        panel.set(xlabel="fraction of the photons" if sweep == "photons"
                  else "fraction of the training records", ylabel="IoU")
        panel.legend(fontsize=8, frameon=False)
    for panel in axes[2 + len(sweeps):]:
        panel.remove()
    return fig


def stability(path: Path, axis: str, *, base: str | None = None, title: str = "",
              ax: Panels = None) -> Figure:
    """Draws the IoU of each method at each value of an axis, from a table of `echofuse-bench
    stability`. Draws lines if the values are numbers, otherwise bars. The upper edge of the shaded
    area is the IoU of the best baseline (empty room, mean map, nearest record). A cross marks a
    method that does not exceed this IoU by more than the standard deviation over the seeds. `base`
    is the axis value of the base condition; the table does not contain this value."""
    rows = [row for row in table(path) if row["axis"] in (axis, "base")]
    values = list(dict.fromkeys(row["value"] for row in rows if row["axis"] == axis))
    values = [base or "base", *values]
    ordered = all(re.fullmatch(r"-?[\d.]+(e-?\d+)?", value) for value in values)
    if ordered:
        values.sort(key=float)
    by: dict[str, list[tuple[float, float]]] = {}
    for name in dict.fromkeys(name_of(row) for row in rows):
        found = [[row for row in rows if name_of(row) == name
                  and row["value"] in (value, "base" if value == (base or "base") else value)]
              for value in values]
        by[name] = [over_seeds(group, "iou") if group else (float("nan"), 0.0) for group in found]
    baselines = {name for name in by if name in ("empty", "mean", "nearest")}
    best = np.nanmax([[0.0] * len(values), *([point[0] for point in by[name]]
                                             for name in baselines)], axis=0)
    methods = [name for name in by if name not in baselines]
    fig, (panel, *_) = figure(wide=7.2 if ordered else 11, high=3.8, ax=ax)
    at = np.arange(len(values))
    if ordered:
        panel.fill_between(at, 0, best, color="#fdf0d2", zorder=0)
        panel.plot(at, best, "--", color=COLOURS["grey"], label="best baseline")
    else:
        panel.bar(at, best, 0.96, color="#fdf0d2", zorder=0, label="best baseline")
    taken: list[str] = []
    for k, name in enumerate(methods):
        mean, spread = np.array(by[name]).T
        taken.append(colour_of(name, taken))
        below = ~(mean - spread > best)
        x = at if ordered else at + 0.84 * ((k + 0.5) / len(methods) - 0.5)
        if ordered:
            panel.errorbar(x, mean, spread, fmt="o-", ms=4, capsize=3, color=taken[-1], label=name)
        else:
            panel.bar(x, mean, 0.84 / len(methods), color=taken[-1], label=name)
            panel.errorbar(x, mean, spread, fmt="none", lw=1, ecolor=COLOURS["grey"])
        panel.plot(x[below], mean[below], "x", ms=10 if ordered else 5, mew=2.5 if ordered else 1.5,
                   color=taken[-1])
    if ordered:
        panel.axvline(values.index(base or "base"), color=COLOURS["grey"], lw=0.8, ls=":")
    panel.set_xticks(at, values, rotation=30 if max(len(v) for v in values) > 5 else 0,
                     ha="right" if max(len(v) for v in values) > 5 else "center")
    steps = np.diff([float(value) for value in values]) if ordered else np.zeros(0)
    scale = " (steps are not to scale)" * (not np.allclose(steps, steps[:1]))
    panel.set(xlabel=(title or axis) + scale, ylabel="IoU")
    panel.set_ylim(bottom=0)
    panel.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    return fig


def learning_curve(path: Path, *, ax: Panels = None) -> Figure:
    """Draws the training and validation losses stored in a model file. Raises ValueError if the
    file contains no losses."""
    tensors, facts = models.read_safetensors(path)
    fig, (panel, *_) = figure(ax=ax)
    for name, label, colour in (("loss_m", "training", "grey"),
                                ("validation_loss_m", "validation", "both")):
        found = [key for key in tensors if key.endswith("/" + name)]
        if found and len(tensors[found[0]]):
            panel.plot(np.arange(1, 1 + len(tensors[found[0]])), tensors[found[0]],
                       color=COLOURS[colour], label=label)
    if not panel.lines:
        raise ValueError(f"{path}: the model file contains no training epochs")
    plain_log(panel, "y")
    panel.set(xlabel="epoch", ylabel="loss (rms, unit of the model)")
    panel.legend(frameon=False)
    return fig
