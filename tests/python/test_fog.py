# SPDX-License-Identifier: MIT
"""Compares the fog simulation of echofuse-bench with analytic results and published values."""
import numpy as np
import pytest

from echofuse.bench import derive, fog, stability
from echofuse.runs.run import PS_PER_M

SETTINGS = {"half_tangent": 0.55, "spd_field": 1, "spd_falloff": 0, "signal_photons": 1e5, "background_counts": 0,
            "pulses_per_window": 0, "bin_width_ps": 100, "first_bin_ps": 13343, "spd_delay_ps": 0}


@pytest.mark.parametrize("visibility_m", [5, 20, 200, 300, 499])
def test_fog_extinction_matches_the_kim_model_below_500_m_visibility(visibility_m):
    """At visibilities below 500 m, the extinction at 1550 nm equals that at 550 nm (Kim, Proc. SPIE 4214, 26, 2001)."""
    assert fog.extinction_per_m(visibility_m) * visibility_m == pytest.approx(3.912, rel=0.12)


def mean_counts(visibility_m, photons=0, records=400, **settings):
    clear = np.full((records, 336), photons, np.uint32)
    return fog.add_fog(clear, visibility_m, SETTINGS | settings, 1).mean(axis=0)


def test_fog_attenuates_photons_and_adds_backscatter_that_falls_with_the_square_of_the_range():
    range_m = (13343 + 100 * (np.arange(336) + 0.5)) / PS_PER_M
    extinction, t2 = fog.extinction_per_m(30), 0.55**2
    solid_angle_sr = 4 * np.arcsin(t2 / (1 + t2))
    per_m = 1e5 / (0.24 / 3.5**4) * np.pi * extinction / 18.8 * solid_angle_sr
    back = per_m * np.exp(-2 * extinction * range_m) / range_m**2 * 100 / PS_PER_M
    alone, both = mean_counts(30), mean_counts(30, 1000)
    assert alone == pytest.approx(back, rel=0.05, abs=0.1)
    assert alone.sum() == pytest.approx(back.sum(), rel=2e-3)
    assert both - alone == pytest.approx(1000 * np.exp(-2 * extinction * range_m), rel=0.05)


def test_fog_backscatter_comes_only_from_the_detector_field_of_view():
    total = mean_counts(30).sum()
    assert mean_counts(30, spd_field=0.5).sum() / total == pytest.approx(0.30, rel=0.05)
    assert mean_counts(30, spd_falloff=3).sum() < 0.4 * total


def test_fog_is_applied_before_pile_up_and_does_not_attenuate_background_counts():
    assert mean_counts(20, background_counts=33600)[-50:] == pytest.approx(mean_counts(20)[-50:] + 100, rel=0.03)
    rate, pulses = mean_counts(20), 100_000
    waiting = np.exp(-np.cumsum([0, *rate[:-1]]) / pulses)
    piled = mean_counts(20, pulses_per_window=pulses, records=50)
    assert piled.sum() == pytest.approx(pulses * -np.expm1(-rate.sum() / pulses), rel=2e-3)
    assert piled == pytest.approx(pulses * waiting * -np.expm1(-rate / pulses), rel=0.1, abs=3)


def test_bench_simulates_the_same_scenes_with_and_without_fog(tmp_path):
    source = stability.Simulated(["pulses_per_window=200000"], 12, 12)
    axis = next(axis for axis in source.axes() if axis.id == "shifted-fog")
    (tmp_path / "fog").mkdir()
    clear = derive.read(source.test(stability.BASE, 1, tmp_path))
    thick = derive.read(source.test(axis.values["20"], 1, tmp_path / "fog"))
    assert np.array_equal(clear.radar, thick.radar)
    assert np.array_equal(clear.run.depth, thick.run.depth, equal_nan=True)
    near = slice(0, 20)  # In range bins in front of all bodies, all counts are backscatter from fog.
    assert clear.spd[:, near].sum() == 0 and thick.spd[:, near].sum() > 12 * 2000
    assert thick.spd.sum(axis=1).max() < 200_000 < thick.spd.sum()


def test_bench_simulates_bodies_aside_and_walking_people(tmp_path):
    source, runs = stability.Simulated(["radar_frames=20", "background_counts=1000"], 8, 8), []
    for world in stability.World(at_x_m=0.6), stability.World(walk_m=1.0), stability.World(walk_m=1e-9):
        folder = tmp_path / str(len(runs))
        folder.mkdir()
        runs.append(derive.read(source.test(world, 1, folder)).run)
    aside, walk, stand = runs
    # The bodies are alternately on the left and on the right. Two of eight records show people.
    across = [np.nanmean(np.where(np.isfinite(depth), aside.axes["map_x"].values, np.nan)) for depth in aside.maps()]
    assert np.sign(across).tolist() == [-1, 1] * 4
    assert [[label.split(":")[0] for label in run.labels] for run in (aside, walk)] == [
        ["person"] * 2 + ["letter"] * 6, (["person"] + ["letter"] * 3) * 2]
    # The light of a walking person is spread over more bins. The map shows the middle of the path.
    assert np.array_equal(walk.maps(), stand.maps(), equal_nan=True) and (walk.spd.max(1) < stand.spd.max(1)).sum() > 5
    assert float(walk.spd.sum()) == pytest.approx(float(stand.spd.sum()), rel=0.1)


def test_bench_refuses_fog_combined_with_a_detector_dead_time(tmp_path):
    source = stability.Simulated(["pulses_per_window=200000", "spd_dead_time_ps=5000"], 12, 12)
    with pytest.raises(stability.ProgramError, match="fog cannot be combined with a detector dead time"):
        source.test(stability.World(fog_m=20), 1, tmp_path)
