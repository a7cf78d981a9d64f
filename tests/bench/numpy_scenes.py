#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""numpy_scenes.py BENCH_SCENES: compares the program BENCH_SCENES with a NumPy renderer on the same scenes.

NumPy casts all rays at once, and uses the same number of rays for the detector. The depth maps must agree within 1 mm.
Prints the output of BENCH_SCENES and the times of NumPy."""
import subprocess
import sys
import time

import numpy as np


def rays(count, half_tangent=0.55):
    t = half_tangent * (2 * np.arange(count) + 1 - count) / count
    x, y = np.meshgrid(t, -t)
    return np.stack([x.ravel(), y.ravel(), np.ones(count * count)], 1)


def cast(capsules, ray):
    """Returns z and albedo * cosine of the nearest capsule hit by each ray; infinity and 0 if a ray
    hits no capsule."""
    nearest, light = np.full(len(ray), np.inf), np.zeros(len(ray))
    ray2 = np.einsum("ij,ij->i", ray, ray)
    for *ends, radius, albedo in capsules:
        a, b = np.array(ends[:3]), np.array(ends[3:])
        axis = b - a
        axis2, axis_a = axis @ axis, axis @ a
        along, to_a = ray @ axis, ray @ a
        square = axis2 * ray2 - along**2
        half = axis2 * to_a - axis_a * along
        root = half**2 - square * (axis2 * (a @ a - radius**2) - axis_a**2)
        z = (half - np.sqrt(root)) / square
        foot = z * along - axis_a
        for end, beyond in ((a, foot <= 0), (b, foot >= axis2)):
            to_end = ray @ end
            z = np.where(beyond, (to_end - np.sqrt(to_end**2 - ray2 * (end @ end - radius**2))) / ray2, z)
        met = (root >= 0) & (z > 0) & (z < nearest)
        point = ray * z[:, None]
        share = np.clip((point @ axis - axis_a) / axis2, 0, 1)
        normal = (point - a - share[:, None] * axis) / radius
        nearest = np.where(met, z, nearest)
        light = np.where(met, albedo * np.abs(np.einsum("ij,ij->i", normal, ray)) / np.sqrt(ray2), light)
    return nearest, light


def histogram(capsules, ray, width_ps=100, first_ps=13343, bins=336, sigma_ps=84.93):
    z, light = cast(capsules, ray)
    seen = np.isfinite(z)
    stretch = np.sqrt(np.einsum("ij,ij->i", ray[seen], ray[seen]))
    metres = z[seen] * stretch
    fine = np.histogram(2e12 * metres / 299792458, bins * 16, (first_ps, first_ps + bins * width_ps),
                        weights=light[seen] / stretch**3 / metres**2)[0]
    t = np.arange(-96, 97) * width_ps / 16
    return np.convolve(fine, np.exp(-0.5 * (t / sigma_ps) ** 2), "same").reshape(bins, 16).sum(1)


def best_us(work, people):
    best = np.inf
    for _ in range(3):
        begin = time.process_time()
        for capsules, _ in people:
            work(capsules)
        best = min(best, (time.process_time() - begin) * 1e6 / len(people))
    return best


np.seterr(all="ignore")
people, counts = [], 0
for line in subprocess.run([sys.argv[1], "--people"], capture_output=True, text=True, check=True).stdout.splitlines():
    kind, *numbers = line.split()
    if kind == "rays":
        counts = int(numbers[0])
    elif kind == "person":
        people.append(([], None))
    elif kind == "capsule":
        people[-1][0].append([float(n) for n in numbers])
    else:
        people[-1] = people[-1][0], np.array(numbers, int)

coarse, fine = rays(64), rays(counts)
differ = 0
for capsules, truth in people:
    z, _ = cast(capsules, coarse)
    mm = np.where(z <= 6, np.rint(1000 * np.where(np.isfinite(z), z, 0)), 0)
    differ += np.count_nonzero(np.abs(mm - truth) > 1)
print(f"numpy: {len(people)} depth maps, {differ} pixels of {4096 * len(people)} differ by more than 1 mm")

ours = subprocess.run([sys.argv[1]], capture_output=True, text=True, check=True).stdout
print(ours, end="")
for path, work in (("simulated depth map", lambda c: cast(c, coarse)),
                   ("simulated histogram", lambda c: histogram(c, fine))):
    print(f"peer\t{path}\tNumPy\t{best_us(work, people)}")
sys.exit(differ > 0)
