# SPDX-License-Identifier: MIT
"""Tests echofuse.plot with simulated runs and with result tables of echofuse-bench."""
import shutil
import types

import numpy as np
import pytest

pytest.importorskip("matplotlib")
import echofuse
from echofuse import plot
from echofuse.plot import figures
from fixtures import model, scenes


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("plots")
    shutil.copy(scenes(20), made / "test.sqlite")
    shutil.copy(scenes(1, 1, "--set", "radar_antennas=8"), made / "wide.sqlite")
    shutil.copy(model("mlp-8", scenes(120, 2), "--epochs", 3), made / "mlp.safetensors")
    return made


def table(path, head, rows):
    path.write_text("\n".join([*head.split("; "), *rows, ""]))
    return path


def written(figure, path):
    figure.savefig(path)
    return path.read_bytes()


@pytest.mark.parametrize("run, panels", [("test", 4), ("wide", 6)])
def test_plot_of_a_record_has_one_panel_for_each_sensor_and_each_colour_bar(folder, run, panels):
    figure = plot.record(folder / f"{run}.sqlite", 0)
    assert len(figure.axes) == panels  # The number of axes includes the colour bars.
    assert written(figure, folder / f"{run}.pdf").startswith(b"%PDF")
    with pytest.raises(KeyError, match="no record 99"):
        plot.record(folder / f"{run}.sqlite", 99)


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


def test_timeline_map_and_learning_curve_can_be_plotted(folder):
    assert b"<svg" in written(plot.timeline(folder / "test.sqlite"), folder / "run.svg")
    run = echofuse.open(folder / "test.sqlite")
    echofuse.write_run(folder / "no_radar", spd=run.spd, depth_m=run.maps())
    sensors = [axes.get_ylabel().split()[0] for axes in plot.timeline(folder / "no_radar.sqlite").axes]
    assert sensors == ["SPD", "camera", "residual"]
    maps = echofuse.load_model(folder / "mlp.safetensors").predict(folder / "test.sqlite")
    figure = plot.map(maps.depth_m[0], maps.half_tangent, title="a map")
    figure.savefig(folder / "map.svg")
    half = echofuse.open(folder / "test.sqlite").axes["map_x"]
    assert figure.axes[0].get_xlim() == pytest.approx((half.start - half.step / 2, -half.start + half.step / 2))
    with pytest.raises(TypeError, match="half_tangent"):
        plot.map(maps.depth_m[0])
    assert len(plot.learning_curve(folder / "mlp.safetensors").axes[0].lines) == 2


def test_plot_functions_draw_into_given_axes(folder):
    run = echofuse.open(folder / "test.sqlite")
    maps = echofuse.load_model(folder / "mlp.safetensors").predict(run)
    figure, axes = plot.figure(4)
    assert plot.maps({"truth": run, "ours": maps}, index=7, ax=axes[:2]) is figure
    shown = axes[1].images[0].get_array()
    assert np.array_equal(shown.filled(np.nan), maps.depth_m[list(maps.index).index(7)], equal_nan=True)
    assert plot.learning_curve(folder / "mlp.safetensors", ax=axes[2]) is figure and axes[2].lines
    with pytest.raises(KeyError, match="no record 99"):
        plot.map(maps, index=99, ax=axes[3])
    with pytest.raises(ValueError, match="1 panels .expected 3"):
        plot.record(run, 0, ax=axes[3])


def test_pareto_chart_gives_each_model_its_own_colour(folder):
    head = "# study pareto; axis,value,model,inputs,machine,seed,iou,lateral_m,multiply_adds,infer_us_median"
    rows = [f"model,1,factorised-{k},fused,m,{s},{0.58 + 0.001 * k + 0.01 * s},{0.03 + 0.001 * k},{40000 + 900 * k},{8 + 0.1 * k}"
            for k in range(8) for s in (1, 2)]
    rows += [f"records,0.5,factorised-1,fused,m,{s},0.4,0.05,40000,8" for s in (1, 2)]
    figure = plot.pareto(table(folder / "pareto.csv", head, rows), bound_m=0.014)
    assert len(figure.axes) == 3
    front = next(line for line in figure.axes[0].lines if line.get_label() == "Pareto front")
    assert len(front.get_xdata()) == 8 and (np.diff(front.get_ydata()) > 0).all()
    _, names = figure.axes[0].get_legend_handles_labels()
    assert {f"factorised-{k}" for k in range(8)} <= set(names)
    assert len({container.lines[0].get_color() for container in figure.axes[0].containers}) == 8
    ticks = [label.get_text() for label in figure.axes[1].get_xticklabels() if label.get_text()]
    assert "40 000" in ticks and not any("$" in tick for tick in ticks)
    assert not any("not shown" in text.get_text() for text in figure.axes[0].texts)
    failed = [f"model,1,{name},fused,m,1,{iou},nan,40000,8" for name, iou in (("wrong", "0.002"), ("broken", "nan"))]
    texts = [text.get_text() for text in plot.pareto(table(folder / "failed.csv", head, rows + failed), bound_m=0.014).axes[0].texts]
    assert "not shown (IoU below 0.01): wrong, broken" in texts


def stability(folder, axis, scores):
    """Plots two seeds of two models with the given scores, by condition."""
    rows = [f"{'base' if value == 'base' else axis},{value},{model},fused,-,{seed},{iou}" for value, both in scores.items()
            for model, iou in zip(("factorised", "nearest"), both) for seed in (1, 2)]
    return plot.stability(table(folder / "stability.csv", "# study stability; axis,value,model,inputs,machine,seed,iou", rows), axis, base="0").axes[0]


def crosses(ax):
    return [line.get_xdata().tolist() for line in ax.lines if line.get_marker() == "x"]


def test_stability_chart_marks_points_below_the_best_baseline(folder):
    ax = stability(folder, "shifted-x", {"base": (0.6, 0.2), "0.1": (0.5, 0.2), "0.2": (0.1, 0.2)})
    assert [label.get_text() for label in ax.get_xticklabels()] == ["0", "0.1", "0.2"]
    assert ax.get_xlabel() == "shifted-x" and crosses(ax) == [[2]]


def test_stability_chart_states_that_its_steps_are_not_to_scale(folder):
    ax = stability(folder, "shifted-x", {value: (0.5, 0.2) for value in ("0.1", "0.2", "0.8")})
    assert ax.get_xlabel() == "shifted-x (steps are not to scale)"


def test_stability_chart_draws_bars_for_conditions_that_are_not_numbers(folder):
    ax = stability(folder, "matched-rooms", {"base": (0.6, 0.2), "corridor": (0.1, 0.2)})
    assert [bar.get_height() for bar in ax.containers[1]] == [0.6, 0.1]
    assert not [line for line in ax.lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 1]
    assert crosses(ax) == [[1]]


def test_plots_are_displayed_in_a_notebook(folder):
    assert plot.record(folder / "test.sqlite", 0)._repr_png_().startswith(b"\x89PNG")
