# SPDX-License-Identifier: MIT
"""Figures for papers, by matplotlib (python3-matplotlib), in the colours of the live page. Each function returns a
Figure; its savefig("NAME.pdf") or ("NAME.svg") writes vectors.

>>> from echofuse import plot
>>> plot.record("monday", 7).savefig("record.pdf")
>>> plot.pareto("study/pareto.csv").savefig("pareto.pdf")
"""
from __future__ import annotations

import csv
import pathlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from . import model as models
from . import run as runs

COLOURS = {"spd": "#0b5cad", "radar": "#a64200", "depth": "#00695c", "both": "#16191d", "papers": "#5b0f75",
           "grey": "#6a7078", "bad": "#b3201a"}
NO_RETURN = "#e8eaed"
Path = str | pathlib.Path


def figure(columns: int = 1, rows: int = 1, wide: float = 4.6, high: float = 3.4) -> tuple[Figure, NDArray[Any]]:
    made = Figure(figsize=(wide * columns, high * rows), layout="constrained")
    FigureCanvasAgg(made)
    axes = made.subplots(rows, columns, squeeze=False).ravel()
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
    return made, axes


def opened(run: runs.Run | Path) -> runs.Run:
    return run if isinstance(run, runs.Run) else runs.open(run)


# Maps and records


def span_of(depth_m: ArrayLike) -> tuple[float, float]:
    """What 96 % of the returns lie in, to half a metre; 2.5 to 5 m of few."""
    there = np.asarray(depth_m, float)
    there = np.sort(there[there > 0])
    if len(there) < 50:
        return 2.5, 5.0
    near = np.floor(2 * there[int(0.02 * (len(there) - 1))]) / 2
    return float(near), float(max(np.ceil(2 * there[int(0.98 * (len(there) - 1))]) / 2, near + 1))


def draw_map(ax: Axes, depth_m: ArrayLike, x: ArrayLike, y: ArrayLike, span: tuple[float, float] | None = None,
             title: str = "", bar: bool = True) -> None:
    """Metres [rows, columns] over the tangents x and y of the pixel centres, near is bright; what is not above 0 is no
    return. Without a span shares of 0 to 1."""
    values, x, y = np.asarray(depth_m, float), np.asarray(x, float), np.asarray(y, float)
    shown = np.ma.masked_where(~(values > 0), values) if span else values
    dx, dy = abs(x[1] - x[0]) / 2, abs(y[1] - y[0]) / 2
    if y[0] < y[-1]:
        shown, y = shown[::-1], y[::-1]
    edges = (x[0] - dx, x[-1] + dx, y[-1] - dy, y[0] + dy)
    low, high = span or (0, 1)
    image = ax.imshow(shown, cmap="viridis_r" if span else "inferno", vmin=low, vmax=high, extent=edges, interpolation="nearest")
    ax.set_facecolor(NO_RETURN)
    ax.spines[:].set_visible(False)
    for axis, first, last in ((ax.xaxis, *edges[:2]), (ax.yaxis, *edges[2:])):
        degrees = [d for d in range(-80, 81, 20) if first < np.tan(np.radians(d)) < last]
        axis.set_ticks([float(np.tan(np.radians(d))) for d in degrees], [f"{d}°" for d in degrees])
    ax.set_title(title, fontsize=10)
    if bar:
        ax.figure.colorbar(image, ax=ax, label="m" if span else "", shrink=0.85)


def map(depth_m: ArrayLike, half_tangent: float, *, span: tuple[float, float] | None = None,  # noqa: A001
        title: str = "") -> Figure:
    """One map of a model [N, N]; half_tangent: of the edges of its field (Maps.half_tangent)."""
    return maps({title: depth_m}, half_tangent, span=span)


def maps(named: dict[str, ArrayLike], half_tangent: float, *, span: tuple[float, float] | None = None) -> Figure:
    """Maps of the same record side by side, over the same span."""
    span = span or span_of(np.concatenate([np.ravel(values) for values in named.values()]))
    return side_by_side(named, half_tangent, [span] * len(named))


def shares(named: dict[str, ArrayLike], half_tangent: float) -> Figure:
    """The truth, and how far each pixel of the maps has come from the room (0) to a body (1)."""
    truth, *_ = named.values()
    return side_by_side(named, half_tangent, [span_of(truth)] + [None] * (len(named) - 1))


def side_by_side(named: dict[str, ArrayLike], half_tangent: float, spans: Sequence[tuple[float, float] | None]) -> Figure:
    made, axes = figure(len(named), wide=2.9, high=2.7)
    for k, (ax, (title, values), span) in enumerate(zip(axes, named.items(), spans)):
        size = len(np.asarray(values))
        at = half_tangent * ((2 * np.arange(size) + 1) / size - 1)
        draw_map(ax, values, at, -at, span, title, k == len(named) - 1 or span != spans[k + 1])
    return made


def power_by_direction(run: runs.Run, row: int, sines: NDArray[np.float64]) -> NDArray[np.float64]:
    """[points, sines] of the radar's antennas side by side: linear, by their correlations (Bartlett's beam)."""
    lags = run.lags()[row].astype(float)
    out = np.ones((len(lags), len(sines)))
    axis = run.lags_axis
    across = (lags.shape[1] - 1) // 2
    if axis is not None and axis.quantity.endswith(" up"):
        across -= int(axis.quantity.split(", ")[-1].split()[0])
    for lag in range(1, across + 1):
        phase = np.pi * lag * sines
        real, imaginary = lags[:, 2 * lag - 1, None], lags[:, 2 * lag, None]
        out += 2 * (1 - lag / (across + 1)) * (real * np.cos(phase) - imaginary * np.sin(phase)) / np.maximum(lags[:, :1], 1e-30)
    return np.maximum(out, 0) * lags[:, :1]


def record(run: runs.Run | Path, index: int) -> Figure:
    """What the sensors saw in the record of this index: map of the camera, histogram, profile; with antennas also the
    power over range and azimuth. Raises KeyError for an index that the run does not have."""
    run = opened(run)
    rows = np.flatnonzero(run.index == index)
    if not len(rows):
        raise KeyError(f"{run.path}: no record {index}")
    row, antennas = int(rows[0]), run.lags_axis is not None
    made, axes = figure(4 if antennas else 3, wide=3.7, high=2.9)
    label = run.labels[row]
    made.suptitle(", ".join(filter(None, [run.path.name, f"record {index}", label])), fontsize=10)
    camera, spd, radar = axes[:3]
    if run.valid["depth"][row] and "depth_x" in run.axes:
        depth = np.nan_to_num(run.depth[row])
        draw_map(camera, depth, run.axes["depth_x"].values, run.axes["depth_y"].values, span_of(depth), "depth camera")
    else:
        camera.set_title("no depth in this record", fontsize=10)
    if "spd" in run.axes and run.valid["spd"][row]:
        spd.step(run.axes["spd"].values / runs.PS_PER_M, run.spd[row], where="post", color=COLOURS["spd"], lw=0.9)
    spd.set(xlabel="range (m)", ylabel="clicks")
    spd.set_title("SPD", fontsize=10)
    if "radar" in run.axes and run.valid["radar"][row]:
        decibels = 10 * np.log10(np.maximum(run.radar[row], 1e-30))
        radar.plot(run.axes["radar"].values, decibels - np.median(decibels), color=COLOURS["radar"], lw=1.1)
    radar.set(xlabel="range (m)", ylabel="dB over the median", ylim=(-10, max(30, radar.get_ylim()[1])))
    radar.set_title("radar", fontsize=10)
    if antennas and run.lags_axis is not None:
        degrees, axis = np.linspace(-72, 72, 97), run.lags_axis
        decibels = 10 * np.log10(np.maximum(power_by_direction(run, row, np.sin(np.radians(degrees))), 1e-30))
        image = axes[3].pcolormesh(degrees, axis.values, decibels - decibels.max(), cmap="viridis", vmin=-25, vmax=0, rasterized=True)
        axes[3].set(xlabel="azimuth (degrees)", ylabel="range (m)")
        axes[3].set_title("radar's antennas", fontsize=10)
        made.colorbar(image, ax=axes[3], label="dB")
    return made


def timeline(run: runs.Run | Path) -> Figure:
    """Rates of the sensors over the run, red where a record has no data; residuals of the clocks."""
    run = opened(run)
    window = float(run.info["window_s"])
    used = np.array(run.select("SELECT spd_used, radar_used, depth_used FROM record ORDER BY idx"), float)
    clocks = np.array(run.select("SELECT idx, spd_clock_residual_s, radar_clock_residual_s, depth_clock_residual_s FROM "
                                 "record ORDER BY idx"), float)
    names = {"spd": "SPD (clicks/s)", "radar": "radar (frames/s)", "depth": "camera (frames/s used)"}
    made, axes = figure(1, 4, wide=6.4, high=1.25)
    minutes = (run.time - run.time[0]) / np.timedelta64(1, "s") / 60 if len(run) else np.zeros(0)
    for k, (ax, (sensor, name)) in enumerate(zip(axes, names.items())):
        ax.plot(minutes, used[:, k] / window if len(used) else [], color=COLOURS[sensor], lw=1)
        ax.vlines(minutes[~run.valid[sensor]], 0, 1, color=COLOURS["bad"], lw=1, alpha=0.6, transform=ax.get_xaxis_transform())
        ax.set_ylabel(name.replace(" ", "\n", 1), fontsize=8)
        ax.set_ylim(bottom=0)
    for k, sensor in enumerate(names):
        if len(clocks):
            axes[3].plot(np.interp(clocks[:, 0], run.index, minutes), 1e6 * clocks[:, 1 + k], color=COLOURS[sensor], lw=1)
    axes[3].set_ylabel("residual\n(µs)", fontsize=8)
    for ax in axes:
        ax.set_xlim(0, max(float(minutes[-1]) if len(run) else 0, 1e-3))
    axes[3].set_xlabel("time (min)")
    return made


# Studies


def table(path: Path) -> list[dict[str, Any]]:
    """Rows of a study's CSV; numbers as float, NaN where there is none."""
    words = {"axis", "value", "model", "inputs", "machine", "known"}

    def number(text: str) -> float:
        try:
            return float(text)
        except ValueError:
            return float("nan")

    with open(path, encoding="utf-8") as lines:
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        return [{key: text if key in words else number(text) for key, text in row.items()} for row in rows]


def name_of(row: dict[str, Any]) -> str:
    inputs = {"spd": ", SPD alone", "radar": ", radar alone", "fused-profile": ", one antenna"}
    return row["model"] + inputs.get(row["inputs"], "")


def colour_of(name: str, taken: Iterable[str] = ()) -> str:
    """What is made of one sensor has the sensor's colour; in a chart of few lines each colour is there once."""
    first = ("spd" if "SPD" in name else "radar" if "radar" in name else "papers" if name.startswith("mlp") else
             "both" if name.startswith("factorised") else "grey" if name == "nearest" else "depth")
    free = [c for c in (first, "depth", "radar", "spd", "papers", "both") if COLOURS[c] not in set(taken)]
    return COLOURS[free[0] if free else "grey"]


def over_seeds(rows: Sequence[dict[str, Any]], metric: str) -> tuple[float, float]:
    values = np.array([row[metric] for row in rows])
    return float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else 0.0


def place_names(ax: Axes, points: Sequence[tuple[float, float, float, str, str]],
                steps: Sequence[tuple[float, float]] = ()) -> None:
    """Names (x, y, half a bar, name, colour) beside their points, over no other name, point, bar and step of a line, and
    nearer to no other point; a far one has a line to its point. The figure's layout must be final."""
    renderer = ax.figure.canvas.get_renderer()
    at, share = ax.transData.transform([point[:2] for point in points]), ax.figure.transFigure.inverted().transform
    ends = [ax.transData.transform([(x, max(y - bar, 1e-9)), (x, y + bar)])[:, 1] for x, y, bar, *_ in points]
    frame = ax.get_window_extent()
    bars = [(x - 5, min(y, low) - 5, x + 5, max(y, high) + 5) for (x, y), (low, high) in zip(at, ends)]
    corners = ax.transData.transform(steps).tolist() if steps else []
    bars += [(x, y - 2, end, y + 2) for (x, y), (end, _) in zip(corners, corners[1:])]
    texts = [ax.text(0, 0, name, fontsize=8, color=colour, ha="center", va="center", transform=ax.figure.transFigure)
             for *_, name, colour in points]
    sizes = [(box.width + 4, box.height + 2) for box in (text.get_window_extent(renderer) for text in texts)]

    def box_of(k: int, px: float, py: float) -> tuple[float, float, float, float]:
        (wide, high) = sizes[k]
        return px - wide / 2, py - high / 2, px + wide / 2, py + high / 2

    def placed(order: Sequence[int]) -> tuple[float, dict[int, tuple[float, float]]]:
        taken, total, out = list(bars), 0.0, {}
        for k in order:
            x, y = at[k]

            def cost(px: float, py: float) -> float:
                here = box_of(k, px, py)
                over = sum(max(0, min(here[2], b[2]) - max(here[0], b[0])) * max(0, min(here[3], b[3]) - max(here[1], b[1]))
                           for b in taken)
                out = max(0, frame.x0 - here[0]) + max(0, here[2] - frame.x1) + max(0, frame.y0 - here[1]) + max(0, here[3] - frame.y1)
                strays = sum(np.hypot(px - qx, py - qy) < np.hypot(px - x, py - y) for qx, qy in at if (qx, qy) != (x, y))
                away = np.hypot(max(abs(px - x) - sizes[k][0] / 2, 0), max(abs(py - y) - sizes[k][1] / 2, 0))
                return over + 1e4 * out + 30 * strays + max(away - 12, 0)

            out[k] = min(((x + np.cos(t) * (away + sizes[k][0] / 2), y + np.sin(t) * (away + sizes[k][1] / 2))
                          for away in 8 * 1.35 ** np.arange(11) for t in np.arange(16) * np.pi / 8), key=lambda p: cost(*p))
            total += cost(*out[k])
            taken.append(box_of(k, *out[k]))
        return total, out

    orders = [np.argsort(sign * at[:, side]).tolist() for side in (0, 1) for sign in (-1, 1)]
    for k, (px, py) in min((placed(order) for order in orders), key=lambda one: one[0])[1].items():
        texts[k].set_position(share((px, py)))
        left, low, right, high = box_of(k, px, py)
        x, y = at[k]
        end = np.clip(x, left, right), np.clip(y, low, high)
        if np.hypot(end[0] - x, end[1] - y) > 12:
            ax.annotate("", share(end), share((x, y)), "figure fraction", "figure fraction",
                        arrowprops={"arrowstyle": "-", "lw": 0.6, "color": points[k][4]})


def pareto(path: Path, *, bound_m: float | None = None) -> Figure:
    """pareto.csv of `echofuse-recon study pareto`: IoU against time with the front, lateral error against the cost,
    and IoU with fewer photons and fewer training records. bound_m: the least lateral error that noise allows."""
    rows = table(path)
    by_model: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        by_model.setdefault((row["axis"], row["value"], name_of(row)), []).append(row)
    sweeps = [sweep for sweep in ("photons", "records") if any(row["axis"] == sweep for row in rows)]
    made, axes = figure(2, 1 + (len(sweeps) + 1) // 2, wide=5.4, high=4.0)
    shown = {name: same for (axis, _, name), same in by_model.items() if axis == "model" and over_seeds(same, "iou")[0] >= 0.01}
    front: list[tuple[float, float]] = []
    named: list[list[tuple[float, float, float, str, str]]] = []
    for ax, cost, metric, unit in ((axes[0], "infer_us_median", "iou", 1), (axes[1], "multiply_adds", "lateral_m", 100)):
        points = []
        for name, same in shown.items():
            x = [row[cost] for row in same if row[cost] > 0]
            mean, spread = over_seeds(same, metric)
            if not x:
                continue
            ax.errorbar(x[-1], unit * mean, unit * spread or None, fmt="o", ms=5, capsize=3, color=colour_of(name))
            points.append((x[-1], unit * mean, unit * spread, name, colour_of(name)))
        ax.set_xscale("log")
        if metric == "iou":
            for x, y, *_ in sorted(points):
                if not front or y > front[-1][1]:
                    front.append((x, y))
            ax.step(*zip(*front), where="post", color=COLOURS["grey"], lw=1, zorder=0)
            ax.set(xlabel="time of one map on one thread (µs, median)", ylabel="IoU")
        else:
            ax.set_yscale("log")
            if bound_m:
                ax.axhline(100 * bound_m, color=COLOURS["grey"], ls="--", lw=1)
                ax.text(0.01, 100 * bound_m, f"least possible: {100 * bound_m:g} cm", transform=ax.get_yaxis_transform(),
                        va="bottom", fontsize=8)
            ax.set(xlabel="multiply-adds of one map", ylabel="lateral error (cm)")
        ax.margins(0.12)
        named.append(points)
    for ax, sweep in zip(axes[2:], sweeps):
        taken: list[str] = []
        for name in dict.fromkeys(key[2] for key in by_model if key[0] == sweep):
            line = sorted((float(value), *over_seeds(same, "iou")) for (axis, value, other), same in by_model.items()
                          if other == name and axis in (sweep, "model"))
            taken.append(colour_of(name, taken))
            x, y, spread = zip(*line)
            ax.errorbar(x, y, spread, fmt="o-", ms=4, capsize=3, color=taken[-1], label=name)
        ax.set_xscale("log")
        ax.set(xlabel="share of the record's photons" if sweep == "photons" else "share of the training records", ylabel="IoU")
        ax.legend(fontsize=8, frameon=False)
    for ax in axes[2 + len(sweeps):]:
        ax.remove()
    made.canvas.draw()
    made.set_layout_engine("none")
    place_names(axes[0], named[0], front)
    place_names(axes[1], named[1])
    return made


def stability(path: Path, axis: str, *, base: str | None = None, title: str = "") -> Figure:
    """stability.csv of `echofuse-recon study stability`: IoU at each value of the axis. Shaded is what the best
    baseline that draws a body reaches (empty room, mean map, nearest record); a cross: not above it by more than the
    spread over seeds. base: the value of the axis at the base condition, which the table does not say."""
    rows = [row for row in table(path) if row["axis"] in (axis, "base")]
    values = list(dict.fromkeys(row["value"] for row in rows if row["axis"] == axis))
    values = [base or "base", *values]
    try:
        values.sort(key=float)
    except ValueError:
        pass
    by: dict[str, list[tuple[float, float]]] = {}
    for name in dict.fromkeys(name_of(row) for row in rows):
        at = [[row for row in rows if name_of(row) == name and row["value"] in (value, "base" if value == (base or "base") else value)]
              for value in values]
        by[name] = [over_seeds(same, "iou") if same else (float("nan"), 0.0) for same in at]
    baselines = {name for name in by if name in ("empty", "mean", "nearest")}
    best = np.nanmax([[point[0] for point in by[name]] for name in baselines] or [[np.nan] * len(values)], axis=0)
    made, (ax, *_) = figure(wide=7.2, high=3.8)
    at = np.arange(len(values))
    ax.fill_between(at, 0, best, color="#fdf0d2", zorder=0)
    ax.plot(at, best, "--", color=COLOURS["grey"], label="best baseline")
    taken: list[str] = []
    for name in (name for name in by if name not in baselines):
        mean, spread = np.array(by[name]).T
        taken.append(colour_of(name, taken))
        below = ~(mean - spread > best)
        ax.errorbar(at, mean, spread, fmt="o-", ms=4, capsize=3, color=taken[-1], label=name)
        ax.plot(at[below], mean[below], "x", ms=10, mew=2.5, color=taken[-1])
    ax.axvline(values.index(base or "base"), color=COLOURS["grey"], lw=0.8, ls=":")
    ax.set_xticks(at, values, rotation=30 if max(len(v) for v in values) > 5 else 0, ha="right" if max(len(v) for v in values) > 5 else "center")
    ax.set(xlabel=title or axis, ylabel="IoU")
    ax.set_ylim(bottom=0)
    ax.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    return made


def learning_curve(path: Path) -> Figure:
    """Losses of a model file while it was trained, of training and validation records. Raises ValueError for a model
    that has none."""
    tensors, facts = models.read_safetensors(path)
    made, (ax, *_) = figure()
    for name, label, colour in (("loss_m", "training", "grey"), ("validation_loss_m", "validation", "both")):
        found = [key for key in tensors if key.endswith("/" + name)]
        if found and len(tensors[found[0]]):
            ax.semilogy(np.arange(1, 1 + len(tensors[found[0]])), tensors[found[0]], color=COLOURS[colour], label=label)
    if not ax.lines:
        raise ValueError(f"{path}: a model without epochs")
    ax.set(xlabel="epoch", ylabel="loss (rms, unit of the model)")
    ax.legend(frameon=False)
    return made
