#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""table.py BUILD_DIR SCRATCH: runs the benchmarks of BUILD_DIR and prints their results as one table.

The columns are the code path, the value of echofuse, the limit of the machine, the ratio of the value to the limit, the
peer program, and the ratio of the value to that of the peer. Other output of the benchmark programs (limits.hpp) is
printed unchanged. Peers that are not installed are omitted."""
import pathlib
import sqlite3
import subprocess
import sys
import time
import timeit
import zlib

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "recon/python"))
import echofuse  # noqa: E402

# rows[path] contains the unit, the value of echofuse, the limit and the name of the limit.
# peers[path] contains the name and the value of the peer.
rows, peers = {}, {}


def best_s(rounds, work, clock=time.process_time):
    return min(timeit.repeat(work, timer=clock, repeat=rounds, number=1))


def run(*command):
    """Runs a benchmark, and adds the rows of its output to `rows` and `peers`."""
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, text=True, check=True)
    for line in done.stdout.splitlines():
        kind, *words = line.split("\t")
        if kind == "row":
            rows[words[0]] = words[1], float(words[2]), float(words[3]), words[4]
        elif kind == "peer":
            peers[words[0]] = words[1], float(words[2])
        else:
            print(line, flush=True)
    return done.stdout


def load(path):
    """Returns the histogram, the range profile and the depth map of each record, read with NumPy."""
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as run_file:
        found = run_file.execute("SELECT spd, radar, depth FROM record").fetchall()
    return [(numpy.frombuffer(spd, "<u4"), numpy.frombuffer(radar, "<f4"),
             numpy.frombuffer(zlib.decompress(mm), "<u2").reshape(64, 64) / numpy.float32(1000)) for spd, radar, mm in found]


def in_python(recorded, few):
    """Measures how the Python package loads all records, reads one of them, and reads the state of a run that it follows."""
    def all_arrays():
        run = echofuse.open(recorded)
        return run.spd, run.radar, run.depth

    records = len(load(recorded))
    rows["loading a record in Python"] = ("us", 1e6 * best_s(3, all_arrays) / records,
                                          1e6 * best_s(3, lambda: echofuse.open(recorded)) / records, "opening the run")
    peers["loading a record in Python"] = "NumPy, sqlite3, zlib", 1e6 * best_s(3, lambda: load(recorded)) / records
    for path in few, recorded:
        run = echofuse.open(path)
        run.spd  # noqa: B018 (reads and caches the array)
        rows[f"a step of Run.follow(), {len(run)} records"] = "us", 1e6 * best_s(20, lambda: run.refresh().spd), 0, ""
        cold = echofuse.open(path)
        rows[f"run[i].spd, {len(run)} records"] = "us", 1e6 * best_s(20, lambda: cold[7].spd), 0, ""


def to_maps(recon, model, recorded, scratch):
    """Measures `reconstruct` and its peer in wall-clock time, because the command uses several threads."""
    numbers, records, name = iter(range(100)), len(load(recorded)), "records to NPY, a record"
    command = [recon, "reconstruct", model, recorded, "--format", "npy", "-q", "--out"]
    took = best_s(5, lambda: subprocess.check_output([*command, scratch / f"maps{next(numbers)}"]), time.perf_counter)
    maps = numpy.load(scratch / "maps0/maps.npy")
    copy = numpy.empty_like(maps)
    rows[name] = "us", 1e6 * took / records, 1e6 * best_s(5, lambda: numpy.copyto(copy, maps)) / records, "copying the maps"
    peers[name] = "numpy.save of ready maps", 1e6 * best_s(
        3, lambda: numpy.save(scratch / f"maps{next(numbers)}.npy", maps), time.perf_counter) / records


def torch():
    """Measures PyTorch on one thread, with a network of the same size: the training rate (GFLOP/s) and the time of a map."""
    try:
        import torch as t
    except ImportError:
        return
    t.set_num_threads(1)
    widths, batch, batches = (365, 512, 256, 4096), 128, 27
    layers = [t.nn.Linear(a, b) for a, b in zip(widths, widths[1:])]
    network = t.nn.Sequential(layers[0], t.nn.ReLU(), layers[1], t.nn.ReLU(), layers[2])
    optimiser = t.optim.AdamW(network.parameters(), lr=1e-3)
    x, y = t.rand(batch, widths[0]), t.rand(batch, widths[-1])

    def epoch():
        for _ in range(batches):
            optimiser.zero_grad()
            t.nn.functional.mse_loss(network(x), y).backward()
            optimiser.step()
    weights = sum(a * b for a, b in zip(widths, widths[1:]))
    peers["training of the plain network"] = "PyTorch", 6e-9 * weights * batch * batches / best_s(3, epoch)
    with t.inference_mode():
        peers["one map of mlp-512-256"] = "PyTorch", 1e6 * best_s(200, lambda: network(x[:1]))


def rays(count, half_tangent=0.55):
    t = half_tangent * (2 * numpy.arange(count) + 1 - count) / count
    x, y = numpy.meshgrid(t, -t)
    return numpy.stack([x.ravel(), y.ravel(), numpy.ones(count * count)], 1)


def cast(capsules, ray):
    """Returns z and albedo * cosine of the nearest capsule hit by each ray; infinity and 0 if a ray hits no capsule."""
    nearest, light = numpy.full(len(ray), numpy.inf), numpy.zeros(len(ray))
    ray2 = numpy.einsum("ij,ij->i", ray, ray)
    for *ends, radius, albedo in capsules:
        a, b = numpy.array(ends[:3]), numpy.array(ends[3:])
        axis = b - a
        axis2, axis_a = axis @ axis, axis @ a
        along, to_a = ray @ axis, ray @ a
        square = axis2 * ray2 - along**2
        half = axis2 * to_a - axis_a * along
        root = half**2 - square * (axis2 * (a @ a - radius**2) - axis_a**2)
        z = (half - numpy.sqrt(root)) / square
        foot = z * along - axis_a
        for end, beyond in ((a, foot <= 0), (b, foot >= axis2)):
            to_end = ray @ end
            z = numpy.where(beyond, (to_end - numpy.sqrt(to_end**2 - ray2 * (end @ end - radius**2))) / ray2, z)
        met = (root >= 0) & (z > 0) & (z < nearest)
        point = ray * z[:, None]
        share = numpy.clip((point @ axis - axis_a) / axis2, 0, 1)
        normal = (point - a - share[:, None] * axis) / radius
        nearest = numpy.where(met, z, nearest)
        light = numpy.where(met, albedo * numpy.abs(numpy.einsum("ij,ij->i", normal, ray)) / numpy.sqrt(ray2), light)
    return nearest, light


def histogram(capsules, ray, width_ps=100, first_ps=13343, bins=336, sigma_ps=84.93):
    z, light = cast(capsules, ray)
    seen = numpy.isfinite(z)
    stretch = numpy.sqrt(numpy.einsum("ij,ij->i", ray[seen], ray[seen]))
    metres = z[seen] * stretch
    fine = numpy.histogram(2e12 * metres / 299792458, bins * 16, (first_ps, first_ps + bins * width_ps),
                        weights=light[seen] / stretch**3 / metres**2)[0]
    t = numpy.arange(-96, 97) * width_ps / 16
    return numpy.convolve(fine, numpy.exp(-0.5 * (t / sigma_ps) ** 2), "same").reshape(bins, 16).sum(1)


def scenes(program):
    """Compares the program with a NumPy renderer on the same scenes and rays. The depth maps must agree within 1 mm."""
    people, counts = [], 0
    for line in subprocess.run([program, "--people"], capture_output=True, text=True, check=True).stdout.splitlines():
        kind, *numbers = line.split()
        if kind == "rays":
            counts = int(numbers[0])
        elif kind == "person":
            people.append(([], None))
        elif kind == "capsule":
            people[-1][0].append([float(n) for n in numbers])
        else:
            people[-1] = people[-1][0], numpy.array(numbers, int)
    coarse, fine = rays(64), rays(counts)
    for capsules, truth in people:
        z, _ = cast(capsules, coarse)
        mm = numpy.where(z <= 6, numpy.rint(1000 * numpy.where(numpy.isfinite(z), z, 0)), 0)
        differ = numpy.count_nonzero(numpy.abs(mm - truth) > 1)
        assert not differ, f"{differ} of 4096 pixels differ from NumPy by more than 1 mm"
    run(program)
    for path, work in (("simulated depth map", lambda c: cast(c, coarse)), ("simulated histogram", lambda c: histogram(c, fine))):
        peers[path] = "NumPy", 1e6 * best_s(3, lambda work=work: [work(capsules) for capsules, _ in people]) / len(people)


def number(value):
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def print_table():
    lines = [["path", "ours", "limit", "share", "peer", "ratio"]]
    for path, (unit, ours, limit, what) in rows.items():
        rate = unit.endswith("/s")
        share = (ours / limit if rate else limit / ours) if limit else 0
        line = [path, f"{number(ours)} {unit}", f"{number(limit)} ({what})" if limit else "", f"{100 * share:.0f} %" if limit else ""]
        name, value = peers.get(path, ("", 0))
        line += [f"{number(value)} ({name})", f"{ours / value if rate else value / ours:.2g} x"] if value else ["", ""]
        lines.append(line)
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    lines.insert(1, ["-" * width for width in widths])
    for line in lines:
        print("| " + " | ".join(word.ljust(width) for word, width in zip(line, widths)) + " |")


build, scratch = map(pathlib.Path, sys.argv[1:])
recon, bench = build / "bin/echofuse-recon", build / "bench"
recorded, few, model = scratch / "run", scratch / "few", scratch / "model.safetensors"
for path, *words in (recorded, "--seed", "1"), (few, "--records", "400"):
    subprocess.run([build / "bin/echofuse-sim", "dataset", "-q", *words, "--out", path], check=True)
run(bench / "bench_recon", recorded)
peers["loading a record"] = "NumPy, sqlite3, zlib", 1e6 * best_s(2, lambda: load(recorded)) / len(load(recorded))
in_python(recorded, few)
subprocess.run([recon, "train", recorded, "--model", "factorised-16", "--epochs", "10", "-q", "--out", model], check=True)
to_maps(recon, model, recorded, scratch)
torch()
run(bench / "bench_tags")
numpy.seterr(all="ignore")  # rays that hit nothing
scenes(bench / "bench_scenes")
print_table()
