# SPDX-License-Identifier: MIT
"""Tests reading the two default runs, in which a swapped axis, a wrong sign or a mixed-up zone
changes the values."""
import numpy as np
import pytest

import echofuse
from echofuse.runs import zones
from fixtures import plates

KINDS = ["one_pixel", "nine_zones"]
PS_PER_M = 2e12 / 299_792_458


def centroid(values, positions, background):
    above = np.maximum(values - background, 0)
    return (above * positions).sum() / above.sum()


@pytest.mark.parametrize("kind", KINDS)
def test_sensors_show_each_body_at_the_same_place(kind):
    run = echofuse.open(plates(kind, 8))
    maps, photons, power = run.maps(), run.photons(), run.power()
    size = maps.shape[1]
    tangents = ((np.arange(size) + 0.5) / size * 2 - 1) * 0.55
    for row, image in enumerate(maps):
        rows, columns = np.nonzero(image > 0)
        z = image[rows[0], columns[0]]
        x = z * (tangents[columns].min() + tangents[columns].max()) / 2
        up = -tangents[rows]
        assert up.min() == pytest.approx(-0.3, abs=0.035) and up.max() == pytest.approx(0.15, abs=0.035)
        assert centroid(power[row], run.axes["radar"].values, 0.02) == pytest.approx(np.hypot(x + 0.5, z), abs=0.06)
        time_ps = run.axes["spd"].values + run.axes["spd"].step / 2
        lit = [counts for counts in np.atleast_2d(photons[row]) if counts.sum() > 2000]
        assert lit
        for counts in lit:
            assert centroid(counts, time_ps, 8) / PS_PER_M == pytest.approx(np.hypot(x, z), abs=0.06)
        if kind == "nine_zones" and abs(x / z) > 0.2:
            directions = zones.directions(run)
            brightest = photons[row].sum(1).argmax()
            assert np.sign(directions[brightest, 0]) == np.sign(x)

