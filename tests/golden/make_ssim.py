#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Writes ssim.txt: the structural similarity of 20 pairs of maps by scikit-image. tests/recon/ssim.cpp makes the same maps."""
import pathlib

import numpy
import skimage
from skimage.metrics import structural_similarity

SIZE = 64


def stream(seed):  # yields the upper 24 bits of the random generator of Numerical Recipes
    state = seed
    while True:
        state = (1664525 * state + 1013904223) % 2**32
        yield (state >> 8) / 2**24


def maps(pair):
    """Returns the two maps of a pair. In even pairs both maps show a plate at 3 to 4 m. In the second map the plate is
    shifted and the background is noise. In odd pairs the first map is noise, and the second is a mixture of the first
    with other noise."""
    noise = stream(pair + 1)
    a, b = numpy.zeros((SIZE, SIZE)), numpy.zeros((SIZE, SIZE))
    for r in range(SIZE):
        for c in range(SIZE):
            u, v = next(noise), next(noise)
            if pair % 2:
                a[r, c], b[r, c] = 6 * u, 6 * (0.7 * u + 0.3 * v)
            else:
                a[r, c] = 3 + u if 16 <= r < 48 and 20 <= c < 36 else 0
                b[r, c] = 3 + v if 16 <= r < 48 and 20 + pair <= c < 36 + pair else 0.1 * v
    return a.astype(numpy.float32).astype(float), b.astype(numpy.float32).astype(float)


lines = [f"# scikit-image {skimage.__version__} structural_similarity(gaussian_weights=True, sigma=1.5,",
         "# use_sample_covariance=False, data_range=6) of the pairs of make_ssim.py"]
for pair in range(20):
    value = structural_similarity(*maps(pair), gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=6)
    lines.append(f"{pair} {value:.10f}")
pathlib.Path(__file__).with_name("ssim.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
