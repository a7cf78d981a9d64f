# SPDX-License-Identifier: MIT
"""Real photons: histograms of a TMF8820 (ams OSRAM) before a known object, as runs of echofuse.

The data set is public (Mu et al., "Towards 3D Vision with Low-Cost Single-Photon Cameras", CVPR
2024; the file NAME.json.gz of a shape has 128 poses, `hists` 9 zones x 128 bins, `reference_hist`,
`pose` 4 x 4; NAME.stl or NAME.obj has the shape on its table). The truth is cast from mesh and
pose; the table is no return. `fit` finds the fields, time zeros and response of the zones from a
few poses (zone_fit.py); `rendered` are random boxes, wedges and cylinders on a table, seen by these
zones.

    python3 -m echofuse.tmf8820 measured tall_block.json.gz tall_block.stl --out test
    python3 -m echofuse.tmf8820 fit block.json.gz block.stl --poses 0,11,22,33,44,55 --out fit.json
    python3 -m echofuse.tmf8820 rendered block.json.gz --fit fit.json --records 3000 --out train
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

from ..runs.acquire import write_run
from . import zone_fit

Array = NDArray[np.float64]
# metres of range a bin; bin of range 0: fitted once to a block at known poses
BINS, BIN_M, ZERO_BIN = 128, zone_fit.BIN_M, 12.0
OBJECT_M = 0.003  # height above the table from which a hit belongs to the object
SIZE, HALF_TANGENT = 32, 0.3  # rays and pixels both ways; half of the chip's 33 degrees
PS_PER_M = 2e12 / 299_792_458.0
COUNTS, BACKGROUND = 3e6, 600.0  # usual record: photons of all zones, counts a bin


def read_measured(path: str | pathlib.Path) -> tuple[Array, Array, Array]:
    """Counts [n, zones, 128], references [n, 128], poses [n, 4, 4] of a shape's file. Raises
    ValueError."""
    try:
        with gzip.open(path) as file:
            records: list[dict[str, Any]] = json.load(file)
        hists, reference, pose = (np.array([one[key] for one in records], float)
                                  for key in ("hists", "reference_hist", "pose"))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"{path}: expected records with hists, reference_hist and pose: {error}") from None
    if hists.ndim != 3 or hists.shape[2] != BINS or pose.shape[1:] != (4, 4):
        raise ValueError(
            f"{path}: hists {hists.shape}, pose {pose.shape}; expected [n, zones, {BINS}] and [n, "
            "4, 4]")
    return hists, reference, pose


def read_mesh(path: str | pathlib.Path) -> Array:
    """Triangles [k, 3 corners, xyz] of a binary .stl or an .obj file, metres. Raises ValueError."""
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
    """z of the table: the highest horizontal plane of at least half of the largest one's area."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    flat = np.abs(normals[:, 2]) > 0.999 * np.linalg.norm(normals, axis=1)
    areas: dict[float, float] = {}
    for z, area in zip(np.round(triangles[flat, :, 2].mean(1), 3), np.abs(normals[flat, 2]) / 2):
        areas[float(z)] = areas.get(float(z), 0) + float(area)
    return max(z for z, area in areas.items() if area >= max(areas.values()) / 2)


def cast(pose: Array, triangles: Array, size: int = SIZE,
         half_tangent: float = HALF_TANGENT) -> tuple[Array, Array, Array]:
    """From a pose (columns: x, y, view, place) through size x size pixels, row-major from the top
    left: z along the view (inf: nothing), cosine at the surface, height of the hit. Moeller and
    Trumbore's test."""
    x, y = zone_fit.tangents(size, half_tangent)
    rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ pose[:3, :3].T
    first, one, two = (triangles[:, 0], triangles[:, 1] - triangles[:, 0],
                       triangles[:, 2] - triangles[:, 0])
    p = np.cross(rays[:, None], two)  # [rays, triangles, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / (p * one).sum(-1)
        from_first = pose[:3, 3] - first
        u = (p * from_first).sum(-1) * inverse
        q = np.cross(from_first, one)
        v = rays @ q.T * inverse
        z = (q * two).sum(-1) * inverse
    z = np.where((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (z > 1e-6), z, np.inf)
    hit = z.argmin(1)
    depth = z[np.arange(len(rays)), hit]
    normals = np.cross(one, two)[hit]
    lengths = np.linalg.norm(normals, axis=1) * np.linalg.norm(rays, axis=1)
    cosine = np.abs((normals * rays).sum(1)) / np.maximum(lengths, 1e-12)
    height = pose[2, 3] + np.where(np.isfinite(depth), depth, 0) * rays[:, 2]
    return depth, cosine, height


def truth_of(depth: Array, height: Array, table_m: float) -> NDArray[np.float32]:
    """Map [SIZE, SIZE] in metres: the object's pixels, NaN for the table and beyond."""
    return np.where(np.isfinite(depth) & (height > table_m + OBJECT_M), depth,
                    np.nan).astype(np.float32).reshape(SIZE, SIZE)


def box(x: float, y: float, z: float) -> Array:
    """Triangles of a box on the plane z = 0 about the origin."""
    corners = np.array([(sx * x / 2, sy * y / 2, sz * z) for sz in (0, 1)
                        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    return _hull(corners, 4)


def wedge(x: float, y: float, z: float) -> Array:
    """A box with a ridge as its top."""
    out = box(x, y, z)
    out[..., 0] *= np.where(out[..., 2] > 0, 0.05, 1)
    return out


def cylinder(radius: float, z: float, sides: int = 16) -> Array:
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], 1)
    return _hull(np.concatenate([np.c_[ring, np.zeros(sides)], np.c_[ring, np.full(sides, z)]]),
                 sides)


def _hull(corners: Array, n: int) -> Array:
    """Side and top faces between a lower and an upper ring of n corners."""
    faces = [(k, (k + 1) % n, n + k)
             for k in range(n)] + [((k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    return np.asarray(corners[np.array(faces + [(n, n + k, n + k + 1) for k in range(1, n - 1)])])


def any_object(rng: np.random.Generator) -> tuple[Array, float]:
    """A random solid on the plane z = 0, turned about z, and its height."""
    wide, deep, high = rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.12), rng.uniform(0.04, 0.25)
    solid = (box(wide, deep, high), wedge(wide, deep, high),
             cylinder(wide / 2, high))[rng.integers(3)]
    c, s = np.cos(turn := rng.uniform(0, 2 * np.pi)), np.sin(turn)
    return solid @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), high


def any_pose(rng: np.random.Generator, high: float) -> Array:
    """A sensor above the table that looks towards the object, rolled at random."""
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
    """Relative counts [zones, 128] of a scene of G * G rays: field x gain / r^2 of each ray at its
    range, blurred by the response."""
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


def rendered(fit: zone_fit.ZoneFit, reference: Array, records: int,
             seed: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Counts [n, zones, 128] and maps [n, SIZE, SIZE] of random objects. reference [128]: the
    chip's own. Albedo, response, time zeros and gains vary by more than the fit's errors."""
    rng = np.random.default_rng(seed)
    table = np.array([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]],
                     float)
    counts, maps, zones = [], [], len(fit.fields)
    for _ in range(records):
        solid, high = any_object(rng)
        pose, scene = any_pose(rng, high), np.concatenate([table, solid])
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


def seen_by(poses: Array, mesh: str | pathlib.Path) -> zone_fit.Scenes:
    """Hits of the rays of a zone's field from these poses."""
    triangles = read_mesh(mesh)
    found = [cast(pose, triangles, zone_fit.G, zone_fit.FIELD_TANGENT) for pose in poses]
    depth, cosine, height = (np.array(part) for part in zip(*found))
    return zone_fit.Scenes(depth, cosine, height > table_height(triangles) + OBJECT_M)


def fitted(data: str | pathlib.Path, mesh: str | pathlib.Path,
           poses: Sequence[int]) -> zone_fit.ZoneFit:
    """The zones of the chip, from these poses of a shape."""
    counts, references, places = read_measured(data)
    rows = list(poses)
    if not rows or not all(0 <= row < len(counts) for row in rows):
        raise ValueError(f"poses {rows}: expected some of 0 to {len(counts) - 1}")
    return zone_fit.fit_zones(counts[rows], references.mean(0), seen_by(places[rows], mesh))


def write(out: str | pathlib.Path, counts: NDArray[Any], maps: NDArray[np.float32],
          fit: zone_fit.ZoneFit | None, label: str, notes: str) -> None:
    """Makes a run of counts [n, zones, 128] and maps. Without a fit: of the sum of the zones."""
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


def measured(data: str | pathlib.Path, mesh: str | pathlib.Path,
             without: Sequence[int] = ()) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Counts [n, zones, 128] and true maps of a shape's poses, but for some."""
    counts, _, poses = read_measured(data)
    triangles = read_mesh(mesh)
    table_m = table_height(triangles)
    rows = np.setdiff1d(np.arange(len(poses)), without)
    maps = [truth_of(*cast(poses[row], triangles)[::2], table_m) for row in rows]
    return counts[rows].astype(np.uint32), np.array(maps)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python3 -m echofuse.tmf8820",
                                     description=__doc__.split("\n\n")[0])
    parser.add_argument("what", choices=("measured", "fit", "rendered"))
    parser.add_argument("data", help="NAME.json.gz of a shape; rendered: whose reference is used")
    parser.add_argument("mesh", nargs="?", help="NAME.stl or NAME.obj, of measured records")
    parser.add_argument("--poses", help="fit: numbers of the poses, as 0,8,16 (default: all)")
    parser.add_argument("--fit", help="what `fit` wrote; without it the zones are added up")
    parser.add_argument("--records", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", required=True, help="run to make, or the fit's JSON file")
    args = parser.parse_args()
    try:
        _make(args)
    except (ValueError, OSError, RuntimeError) as error:
        sys.exit(f"tmf8820: {error}")


def _make(args: argparse.Namespace) -> None:
    fit = zone_fit.load(args.fit) if args.fit else None
    if args.what != "rendered" and args.mesh is None:
        raise ValueError("expected the mesh of the shape")
    if args.what == "fit":
        poses = ([int(word) for word in args.poses.split(",")] if args.poses
                 else range(len(read_measured(args.data)[0])))
        found = fitted(args.data, args.mesh, poses)
        found.save(args.out)
        print(found.text())
    elif args.what == "measured":
        label = pathlib.Path(args.data).name.split(".")[0]
        write(args.out, *measured(args.data, args.mesh), fit, label, "measured")
    elif fit is None:
        raise ValueError("rendered records need --fit")
    else:
        reference = read_measured(args.data)[1].mean(0)
        records = rendered(fit, reference, args.records, args.seed)
        write(args.out, *records, fit, "solid", "rendered")


if __name__ == "__main__":
    main()
