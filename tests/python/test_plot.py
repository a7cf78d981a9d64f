# SPDX-License-Identifier: MIT
"""Tests echofuse.plot with runs made of arrays and with result tables of echofuse-bench."""
import functools
import itertools
import pathlib
import types

import numpy as np
import pytest

pytest.importorskip("matplotlib")
import echofuse
from echofuse import plot
from echofuse.plot import figures
from matplotlib.ticker import AutoLocator
from fixtures import model, scenes

GOLDEN = pathlib.Path(__file__).resolve().parents[1] / "golden/figures.txt"
COSTS = "# study pareto; axis,value,model,inputs,machine,seed,iou,lateral_m,multiply_adds,infer_us_median"
IOU = "# study stability; axis,value,model,inputs,machine,seed,iou"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Creates a run in which each sensor has no data in one record, and a run of two radar antennas and two detector zones."""
    made, at = tmp_path_factory.mktemp("plots"), np.arange(4)[:, None]
    spd, radar = 10. + (7 * np.arange(20) + at) % 23, 1. + (5 * np.arange(12) + at) ** 2 % 31
    depth, array = np.tile(np.arange(64.) % 5, (4, 1)), np.ones((1, 12, 10)) * [0, 0, 0, 0, 4, 4, 2, 1, 0, 0]
    spd[1], radar[2], depth[3] = np.nan, np.nan, np.nan
    write = functools.partial(echofuse.write_run, bin_width_ps=2000, window_s=2, label="plate")
    write(made / "test", spd=spd, radar=radar, depth_m=depth.reshape(4, 8, 8))
    write(made / "wide", spd=np.stack([spd, spd + 5], 1)[:1], radar=radar[:1], array=array, antennas=[(0, 0), (1, 0)])
    return made


def table(path, head, rows):
    path.write_text("\n".join([*head.split("; "), *rows, ""]))
    return path


def short(values):
    """Formats numbers with three digits: all of them, or if they are many, their number, their ends, and their mean."""
    values = np.ma.filled(np.ma.asarray(values, float), np.nan).ravel()
    shown = values if len(values) < 13 else [len(values), values[0], values[-1], np.nanmean(values)]
    return " ".join(f"{value:.3g}" for value in np.round(shown, 9) + 0.0)


def facts(name, figure):
    """Yields what a figure shows: its texts, its data, the limits of its axes, and its colours."""
    figure.canvas.draw()
    yield f"{name}: {short(figure.get_size_inches())} {[text.get_text() for text in figure.texts]}"
    for ax in figure.axes:
        if ax.get_label() == "<colorbar>":
            yield f"colour bar {ax.get_ylabel()}"
            continue
        words = ax.get_title(), ax.get_title("left"), ax.get_xlabel(), ax.get_ylabel(), ax.get_xscale(), ax.get_yscale()
        sides = sum(side.get_visible() for side in ax.spines.values())
        yield f"panel {words} x {short(ax.get_xlim())} y {short(ax.get_ylim())} sides {sides}"
        for axis, ends in (ax.xaxis, ax.get_xlim()), (ax.yaxis, ax.get_ylim()):
            if not isinstance(axis.get_major_locator(), AutoLocator):  # its ticks depend on the font
                labels = zip(axis.get_majorticklocs(), axis.get_ticklabels())
                yield "ticks " + ", ".join(label.get_text() for at, label in labels if min(ends) <= at <= max(ends))
        for line in ax.lines:
            style = [getattr(line, f"get_{of}")() for of in "color linewidth linestyle marker markersize".split()]
            label = "" if line.get_label().startswith("_") else line.get_label()
            yield f"line {style} {label!r} x {short(line.get_xdata())} y {short(line.get_ydata())}"
        for image in ax.images:
            where = f"{short(image.get_clim())} at {short(image.get_extent())}"
            yield f"image {image.get_cmap().name} {where}: {short(image.get_array())}"
        for bar in ax.patches:
            yield f"bar {short(bar.get_bbox().get_points())} {short(bar.get_facecolor())}"
        for part in ax.collections:
            if part.get_array() is not None:
                where = f"{short(part.get_clim())} at {short(part.get_coordinates())}"
                yield f"colours {part.get_cmap().name} {where}: {short(part.get_array())}"
                continue
            # How often a point is repeated, and the order of points, depend on the version of matplotlib.
            found = (point for path in part.get_paths() for point in path.vertices if np.isfinite(point).all())
            points = {tuple(np.round(point, 9)) for point in found}
            yield f"shape {short(sorted(points))} {short(part.get_facecolor())} {short(part.get_edgecolor())} {short(part.get_linewidth())}"
        for text in ax.texts:
            where = f"{short(text.get_position())} {text.get_ha()} {text.get_va()}"
            yield f"text {text.get_text()!r} {where} {short(text.get_fontsize())}"
        if legend := ax.get_legend():
            yield f"legend {[text.get_text() for text in legend.get_texts()]} {short(legend.get_texts()[0].get_fontsize())}"


def test_figures_show_the_texts_data_limits_and_colours_of_the_golden_file(folder):
    run, rows = echofuse.open(folder / "test"), []
    for k, seed in itertools.product(range(8), (1, 2)):
        costs = f"{0.58 + 0.001 * k + 0.01 * seed},{0.03 + 0.001 * k},{40000 + 900 * k},{8 + 0.1 * k}"
        rows.append(f"model,1,factorised-{k},fused,m,{seed},{costs}")
    rows += [f"{sweep},0.5,factorised-1,fused,m,{s},0.4,0.05,40000,8" for s in (1, 2) for sweep in ("records", "photons")]
    # Methods with a low or no score, a method without a cost, one without a time, and one with two seeds of different cost.
    odd = ["wrong,fused,m,1,0.002,nan,40000,8", "broken,fused,m,1,nan,nan,40000,8", "mine:Net,-,m,1,0.5,0.1,nan,5",
           "./other,-,m,1,0.5,0.1,nan,nan", "mlp-4,spd,m,1,0.5,0.1,10,5", "mlp-4,spd,m,2,0.5,0.1,30,5"]
    shown = {f"record {index}": plot.record(run, index) for index in range(4)} | {
        "antennas": plot.record(folder / "wide.sqlite", 0), "timeline": plot.timeline(run),
        "timeline without camera": plot.timeline(folder / "wide.sqlite"), "map": plot.map(run, title="a map"),
        "map of an array": plot.map(run.maps()[0], 0.3, span=(1, 3)),
        "shares": plot.shares({"truth": run.maps()[0], "ours": run.maps()[1] / 4}, 0.55),
        "pareto": plot.pareto(table(folder / "pareto.csv", COSTS, rows), bound_m=0.014),
        "odd": plot.pareto(table(folder / "odd.csv", COSTS, rows[:4] + [f"model,1,{row}" for row in odd]))}
    for axis, title, scores in (("shifted-x", "", {"base": (0.6, 0.2), "0.1": (0.5, 0.2), "0.2": (0.1, 0.2)}),
                                ("shifted-x", "offset", {value: (0.5, 0.2) for value in ("0.1", "0.2", "0.8")}),
                                ("matched-rooms", "", {"base": (0.6, 0.2), "corridor": (0.1, 0.2)})):
        lines = [f"{'base' if value == 'base' else axis},{value},{name},fused,-,{seed},{iou + seed / 100}"
                 for value, both in scores.items() for name, iou in zip(("factorised", "nearest"), both) for seed in (1, 2)]
        shown[f"{axis} {title}"] = plot.stability(table(folder / "stability.csv", IOU, lines), axis, base="0", title=title)
    found = "".join(f"{line}\n" for name, figure in shown.items() for line in facts(name, figure))
    (folder / "figures.txt").write_text(found, encoding="utf-8")
    if found != GOLDEN.read_text(encoding="utf-8"):
        pytest.fail(f"see diff {GOLDEN} {folder}/figures.txt; after a wanted change, copy the new file")


def test_plot_functions_save_figures_and_refuse_missing_records(folder):
    for file, start in ("a.pdf", b"%PDF"), ("a.svg", b"<?xml"):
        plot.record(folder / "test.sqlite", 0).savefig(folder / file)
        assert (folder / file).read_bytes().startswith(start)
    assert plot.record(folder / "test.sqlite", 0)._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(KeyError, match="no record 99"):
        plot.record(folder / "test.sqlite", 99)
    with pytest.raises(TypeError, match="half_tangent"):
        plot.map(np.ones((4, 4)))
    for draw in plot.maps, plot.shares:
        for named, words in ([1], r"named: \[1\] \(expected a dict\)"), ({}, "expected at least one map"):
            with pytest.raises(ValueError, match=words):
                draw(named, 0.5)


def test_power_by_direction_is_largest_in_the_direction_of_the_source():
    sines = np.linspace(-1, 1, 81)
    for source in (-0.5, 0.25):
        # Covariances of eight antennas at half a wavelength, for a wave from this direction.
        waves = 3 * np.exp(-1j * np.pi * source * np.arange(8))
        lags = np.zeros((1, 4, 15))
        lags[..., 0], lags[..., 1::2], lags[..., 2::2] = 3, waves[1:].real, waves[1:].imag
        power = figures.power_by_direction(types.SimpleNamespace(lags=lambda table=lags: table, lags_axis=None), 0, sines)
        assert power.shape == (4, 81) and np.all(sines[power.argmax(1)] == pytest.approx(source)), source
        assert power.max() == pytest.approx(8 * 3, rel=1e-6)


def test_plot_functions_draw_into_given_axes(folder):
    run, trained = echofuse.open(scenes(20)), model("mlp-8", scenes(120, 2), "--epochs", 3)
    maps = echofuse.load_model(trained).predict(run)
    figure, axes = plot.figure(4)
    assert plot.maps({"truth": run, "ours": maps}, index=7, ax=axes[:2]) is figure
    shown = axes[1].images[0].get_array()
    assert np.array_equal(shown.filled(np.nan), maps.depth_m[list(maps.index).index(7)], equal_nan=True)
    costs = table(folder / "costs.csv", COSTS, ["model,1,mlp-4,fused,m,1,0.5,0.1,10,5"])
    ious = table(folder / "ious.csv", IOU, ["matched-x,1,mlp-4,fused,-,1,0.5"])
    for draw, *given in ((plot.pareto, costs), (plot.stability, ious, "matched-x"), (plot.timeline, run), (plot.record, run, 0),
                         (plot.shares, {"truth": run.maps()[0]}, 0.5)):
        other, panels = plot.figure(4)
        assert draw(*given, ax=panels) is other, draw
    assert plot.learning_curve(trained, ax=axes[2]) is figure
    assert [(line.get_label(), *line.get_xdata()) for line in axes[2].lines] == [("training", 1, 2, 3), ("validation", 1, 2, 3)]
    clocks = plot.timeline(run).axes[-1].lines
    assert np.allclose(clocks[1].get_ydata(), 1e6 * run.table("record")["radar_clock_residual_s"], equal_nan=True)
    with pytest.raises(KeyError, match="no record 99"):
        plot.map(maps, index=99, ax=axes[3])
    with pytest.raises(ValueError, match="1 panels .expected 3"):
        plot.record(run, 0, ax=axes[3])
