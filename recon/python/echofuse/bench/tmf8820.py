# SPDX-License-Identifier: MIT
"""Converts TMF8820 (ams OSRAM) histograms of a known object into runs.

The data set is public (Mu et al., "Towards 3D Vision with Low-Cost Single-Photon Cameras", CVPR
2024). NAME.json.gz contains 128 records of a shape. Each record has `hists` (9 zones x 128 bins),
`reference_hist` and `pose` (4 x 4). NAME.stl or NAME.obj is a mesh of the shape and of the table
under it. `measured` computes the ground-truth maps from the mesh and the poses; pixels that show
only the table contain no return. `fit` fits the fields of view, the time zeros and the response of
the zones to a few poses (zone_fit.py). `rendered` simulates records of random boxes, wedges and
cylinders on a table with these zones.

    python3 -m echofuse.bench.tmf8820 measured tall_block.json.gz tall_block.stl --out test
    python3 -m echofuse.bench.tmf8820 fit block.json.gz block.stl --poses 0,22,44 --out fit.json
    python3 -m echofuse.bench.tmf8820 rendered block.json.gz --fit fit.json --out train
"""
from __future__ import annotations

import argparse
import gzip
import json
import pathlib
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runs import PS_PER_M
from ..runs.acquire import write_run
from . import zone_fit

__all__ = ["box", "cast", "fit_to_poses", "histograms", "hits_from", "measured_records",
           "random_pose", "read_measured", "read_mesh", "render_records", "table_height",
           "truth_of", "write"]

Array = NDArray[np.float64]
# number of bins, bin width (m), and bin of range 0; fitted to a block at known poses
BINS, BIN_M, ZERO_BIN = 128, zone_fit.BIN_M, 12.0
OBJECT_M = 0.003  # minimum height of a hit above the table to count as a hit on the object, m
SIZE, HALF_TANGENT = 32, 0.3  # pixels per map side; tangent of half the field of view of 33 degrees
# typical record: total number of photons, and background counts per bin summed over all zones
COUNTS, BACKGROUND = 3e6, 600.0


def read_measured(path: str | pathlib.Path) -> tuple[Array, Array, Array]:
    """Reads the counts [n, zones, 128], reference histograms [n, 128] and poses [n, 4, 4] of a
    shape. Raises ValueError if the file is invalid."""
    try:
        with gzip.open(path) as file:
            records: list[dict[str, Any]] = json.load(file)
        hists, reference, pose = (np.array([record[key] for record in records], float)
                                  for key in ("hists", "reference_hist", "pose"))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"{path}: expected the keys hists, reference_hist and pose in each record: "
            f"{error}") from None
    if hists.ndim != 3 or hists.shape[2] != BINS or pose.shape[1:] != (4, 4):
        raise ValueError(
            f"{path}: hists has shape {hists.shape} (expected [n, zones, {BINS}]), pose has "
            f"shape {pose.shape} (expected [n, 4, 4])")
    return hists, reference, pose


def read_mesh(path: str | pathlib.Path) -> Array:
    """Reads triangles [k, 3 corners, xyz], m, from a binary .stl or an .obj file. Raises ValueError
    for any other kind of file."""
    contents = pathlib.Path(path).read_bytes()
    if pathlib.Path(path).suffix == ".obj":
        lines = [line.split() for line in contents.decode().splitlines()]
        corners = np.array([line[1:4] for line in lines if line[:1] == ["v"]], float)
        faces = [[int(word.split("/")[0]) for word in line[1:]]
                 for line in lines if line[:1] == ["f"]]
        fans = [(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)]
        at = np.array(fans)
        return np.asarray(corners[np.where(at > 0, at - 1, at)])
    kind = np.dtype([("normal", "<3f4"), ("corners", "<9f4"), ("more", "<u2")])
    count = int.from_bytes(contents[80:84], "little")
    if len(contents) < 84 + count * kind.itemsize or count == 0:
        raise ValueError(f"{path}: expected a binary .stl or an .obj file")
    return np.frombuffer(contents, kind, count, 84)["corners"].reshape(-1, 3, 3).astype(float)


def table_height(triangles: Array) -> float:
    """Returns z of the table, m. The table is the highest horizontal plane that has at least half
    the area of the largest horizontal plane."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    flat = np.abs(normals[:, 2]) > 0.999 * np.linalg.norm(normals, axis=1)
    areas: dict[float, float] = {}
    for z, area in zip(np.round(triangles[flat, :, 2].mean(1), 3), np.abs(normals[flat, 2]) / 2):
        areas[float(z)] = areas.get(float(z), 0) + float(area)
    return max(z for z, area in areas.items() if area >= max(areas.values()) / 2)


def cast(pose: Array, triangles: Array, size: int = SIZE,
         half_tangent: float = HALF_TANGENT) -> tuple[Array, Array, Array]:
    """Casts rays from a pose through size x size pixels, row-major from the top left. The columns
    of the pose are the x axis, the y axis, the viewing direction and the position. For each ray,
    returns the depth along the viewing direction (m, inf: no hit), the cosine of the angle of
    incidence, and the height of the hit, m (Moeller-Trumbore intersection)."""
    x, y = zone_fit.tangents(size, half_tangent)
    rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ pose[:3, :3].T
    first, edge_1, edge_2 = (triangles[:, 0], triangles[:, 1] - triangles[:, 0],
                             triangles[:, 2] - triangles[:, 0])
    p = np.cross(rays[:, None], edge_2)  # shape [rays, triangles, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / (p * edge_1).sum(-1)
        from_first = pose[:3, 3] - first
        u = (p * from_first).sum(-1) * inverse
        q = np.cross(from_first, edge_1)
        v = rays @ q.T * inverse
        z = (q * edge_2).sum(-1) * inverse
    z = np.where((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (z > 1e-6), z, np.inf)
    hit = z.argmin(1)
    depth = z[np.arange(len(rays)), hit]
    normals = np.cross(edge_1, edge_2)[hit]
    lengths = np.linalg.norm(normals, axis=1) * np.linalg.norm(rays, axis=1)
    cosine = np.abs((normals * rays).sum(1)) / np.maximum(lengths, 1e-12)
    height = pose[2, 3] + np.where(np.isfinite(depth), depth, 0) * rays[:, 2]
    return depth, cosine, height


def truth_of(depth: Array, height: Array, table_m: float) -> NDArray[np.float32]:
    """Returns the depth map [SIZE, SIZE] of the object, m; NaN in pixels without the object."""
    return np.where(np.isfinite(depth) & (height > table_m + OBJECT_M), depth,
                    np.nan).astype(np.float32).reshape(SIZE, SIZE)


def box(x: float, y: float, z: float) -> Array:
    """Returns the triangles of a box on the plane z = 0, centred on the z axis."""
    corners = np.array([(sx * x / 2, sy * y / 2, sz * z) for sz in (0, 1)
                        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    return _hull(corners, 4)


def wedge(x: float, y: float, z: float) -> Array:
    """Returns the triangles of a box on the plane z = 0 that narrows to a ridge."""
    out = box(x, y, z)
    out[..., 0] *= np.where(out[..., 2] > 0, 0.05, 1)
    return out


def cylinder(radius: float, z: float, sides: int = 16) -> Array:
    """Returns the triangles of a cylinder on the plane z = 0, centred on the z axis."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], 1)
    return _hull(np.concatenate([np.c_[ring, np.zeros(sides)], np.c_[ring, np.full(sides, z)]]),
                 sides)


def _hull(corners: Array, n: int) -> Array:
    """Returns the triangles of the sides and the top of a solid. The first n corners form the lower
    ring, and the next n corners form the upper ring."""
    faces = [(k, (k + 1) % n, n + k)
             for k in range(n)] + [((k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    return np.asarray(corners[np.array(faces + [(n, n + k, n + k + 1) for k in range(1, n - 1)])])


def random_solid(rng: np.random.Generator) -> tuple[Array, float]:
    """Returns a random solid on the plane z = 0, and its height, m."""
    wide, deep, high = rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.12), rng.uniform(0.04, 0.25)
    solid = (box(wide, deep, high), wedge(wide, deep, high),
             cylinder(wide / 2, high))[rng.integers(3)]
    c, s = np.cos(turn := rng.uniform(0, 2 * np.pi)), np.sin(turn)
    return solid @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), high


def random_pose(rng: np.random.Generator, high: float) -> Array:
    """Returns a random pose of the chip above the table. The chip points at the object and has a
    random roll angle."""
    around = rng.uniform(0, 2 * np.pi)
    place = np.append(rng.uniform(0, 0.18) * np.array([np.cos(around), np.sin(around)]),
                      rng.uniform(max(0.1, high * 0.6), 0.34))
    if place[2] < high + 0.05:
        place[:2] *= max(1, (0.1 + rng.uniform(0, 0.08)) / max(np.hypot(*place[:2]), 1e-3))
    view = np.append(rng.normal(0, 0.03, 2), rng.uniform(0, high)) - place
    view /= np.linalg.norm(view)
    right = np.cross(view, np.append(rng.normal(size=2), 0.0))
    right /= np.linalg.norm(right)
    pose = np.zeros((4, 4))
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(view, right), view, place
    return pose


def histograms(depth: Array, gain: Array, fit: zone_fit.ZoneFit, zero_bin: Array,
               response: tuple[Array, int]) -> Array:
    """Computes the relative counts [zones, 128] with G * G rays. Each ray adds field weight x gain
    / r^2 to the histogram at its range; the histogram is then convolved with the response."""
    met = np.isfinite(depth)
    range_m = np.where(met, depth, 1) * zone_fit.slant()
    weights = fit.fields * np.where(met, gain / range_m**2, 0)
    taps, peak = response
    out = np.zeros((len(fit.fields), BINS))
    for k, zero in enumerate(zero_bin):
        place = np.clip(range_m / BIN_M + zero, 0, BINS - 2)
        low = place.astype(int)
        sharp = np.bincount(low, weights[k] * (1 - (place - low)), BINS)
        sharp += np.bincount(low + 1, weights[k] * (place - low), BINS)
        out[k] = np.convolve(sharp, taps)[peak:][:BINS]
    return out


def render_records(fit: zone_fit.ZoneFit, reference: Array, records: int,
                   seed: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Renders the counts [n, zones, 128] and the maps [n, SIZE, SIZE] of random objects.
    `reference` [128] is the reference histogram of the chip. The albedo, response, time zeros and
    gains vary randomly by more than their uncertainties."""
    rng = np.random.default_rng(seed)
    table = np.array([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]],
                     float)
    counts, maps, zones = [], [], len(fit.fields)
    for _ in range(records):
        solid, high = random_solid(rng)
        pose, scene = random_pose(rng, high), np.concatenate([table, solid])
        maps.append(truth_of(*cast(pose, scene)[::2], 0))
        depth, cosine, height = cast(pose, scene, zone_fit.G, zone_fit.FIELD_TANGENT)
        gain = cosine * np.where(height > OBJECT_M, 1.0, np.exp(rng.uniform(-1.2, 1.2)))
        response = zone_fit.response_of(reference, fit.exponent * rng.uniform(0.82, 1.18))
        zero_bin = fit.zero_bin + rng.normal(0, 0.2) + rng.normal(0, 0.1, zones)
        bare = histograms(depth, gain, fit, zero_bin, response)
        bare *= np.exp(rng.normal(0, 0.1, zones))[:, None]
        total = COUNTS * np.exp(rng.uniform(-1, 1)) / max(bare.sum(), 1e-30)
        counts.append(rng.poisson(total * bare + BACKGROUND / zones * rng.uniform(0.5, 1.5)))
    return np.array(counts, np.uint32), np.array(maps)


def hits_from(poses: Array, mesh: str | pathlib.Path) -> zone_fit.Scenes:
    """Casts G * G rays from each pose, and returns their first hits on the mesh."""
    triangles = read_mesh(mesh)
    found = [cast(pose, triangles, zone_fit.G, zone_fit.FIELD_TANGENT) for pose in poses]
    depth, cosine, height = (np.array(part) for part in zip(*found))
    return zone_fit.Scenes(depth, cosine, height > table_height(triangles) + OBJECT_M)


def fit_to_poses(data: str | pathlib.Path, mesh: str | pathlib.Path,
                 poses: Sequence[int]) -> zone_fit.ZoneFit:
    """Fits the zones of the chip to the records of a shape at the given pose numbers. Raises
    ValueError if the file or a pose number is invalid."""
    counts, references, places = read_measured(data)
    rows = list(poses)
    if not rows or not all(0 <= row < len(counts) for row in rows):
        raise ValueError(f"--poses: {rows} (expected pose numbers from 0 to {len(counts) - 1})")
    return zone_fit.fit_zones(counts[rows], references.mean(0), hits_from(places[rows], mesh))


def write(out: str | pathlib.Path, counts: NDArray[Any], maps: NDArray[np.float32],
          fit: zone_fit.ZoneFit | None, label: str, notes: str) -> None:
    """Writes a run that contains the counts [n, zones, 128] and the maps. If no fit is given, the
    counts of all zones are summed."""
    zones = []
    if fit is None:
        counts = counts.sum(1)
    else:
        first = [BIN_M * PS_PER_M * (zero - ZERO_BIN) for zero in fit.zero_bin]
        zones = [(x, y, 2 * deviation, zero_ps)
                 for (x, y, deviation), zero_ps in zip(fit.centres().tolist(), first)]
    write_run(out, spd=counts.astype(np.uint32), zones=zones,
              first_bin_ps=-ZERO_BIN * BIN_M * PS_PER_M, bin_width_ps=BIN_M * PS_PER_M,
              depth_m=maps, half_tangent=HALF_TANGENT, label=label, notes=f"TMF8820: {notes}")


def measured_records(data: str | pathlib.Path, mesh: str | pathlib.Path,
        excluded: Sequence[int] = ()) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Returns the measured counts [n, zones, 128] and the ground-truth maps [n, SIZE, SIZE] of all
    poses except the excluded ones."""
    counts, _, poses = read_measured(data)
    triangles = read_mesh(mesh)
    table_m = table_height(triangles)
    rows = np.setdiff1d(np.arange(len(poses)), excluded)
    maps = [truth_of(*cast(poses[row], triangles)[::2], table_m) for row in rows]
    return counts[rows].astype(np.uint32), np.array(maps)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python3 -m echofuse.bench.tmf8820",
                                     description=__doc__.split("\n\n")[0])
    parser.add_argument("what", choices=("measured", "fit", "rendered"),
                        help="one of: measured (convert measured records into a run), fit (fit the "
                             "zones to measured records), rendered (render records with fitted "
                             "zones)")
    parser.add_argument("data", help="NAME.json.gz with the measurements of a shape; `rendered` "
                                     "uses only their reference histograms")
    parser.add_argument("mesh", nargs="?",
                        help="mesh of the shape, NAME.stl or NAME.obj; not used by `rendered`")
    parser.add_argument("--poses", help="numbers of the poses that are fitted, e.g. 0,8,16 "
                                        "(default: all)")
    parser.add_argument("--fit", help="file that `fit` wrote; without it, `measured` sums the "
                                      "counts of all zones")
    parser.add_argument("--records", type=int, default=3000,
                        help="number of records to render (default: 3000)")
    parser.add_argument("--seed", type=int, default=1,
                        help="random seed of the rendered records (default: 1)")
    parser.add_argument("--out", required=True, help="run file to write, or with `fit`, JSON file "
                                                     "to write")
    args = parser.parse_args()
    try:
        _make(args)
    except (ValueError, OSError, RuntimeError) as error:
        sys.exit(f"tmf8820: {error}")


def _make(args: argparse.Namespace) -> None:
    fit = zone_fit.load(args.fit) if args.fit else None
    if args.what != "rendered" and args.mesh is None:
        raise ValueError("`measured` and `fit` require a mesh file, NAME.stl or NAME.obj")
    if args.what == "fit":
        poses = ([int(word) for word in args.poses.split(",")] if args.poses
                 else range(len(read_measured(args.data)[0])))
        result = fit_to_poses(args.data, args.mesh, poses)
        result.save(args.out)
        print(result.text())
    elif args.what == "measured":
        label = pathlib.Path(args.data).name.split(".")[0]
        write(args.out, *measured_records(args.data, args.mesh), fit, label, "measured")
    elif fit is None:
        raise ValueError("`rendered` requires --fit FILE")
    else:
        reference = read_measured(args.data)[1].mean(0)
        records = render_records(fit, reference, args.records, args.seed)
        write(args.out, *records, fit, "solid", "rendered")


if __name__ == "__main__":
    main()
