# SPDX-License-Identifier: MIT
"""Real photons: histograms of a TMF8820 (ams OSRAM) before a known object, as runs of echofuse.

The data set is public (Mu et al., "Towards 3D Vision with Low-Cost Single-Photon Cameras", CVPR
2024; the file NAME.json.gz of a shape has 128 poses, `hists` 9 zones x 128 bins, `reference_hist`,
`pose` 4 x 4; NAME.stl or NAME.obj has the shape on its table). The truth is cast from mesh and
pose; the table is no return. Training records are rendered: random boxes, wedges and cylinders on a
table, with the chip's reference as response.

    python3 -m echofuse.tmf8820 measured tall_block.json.gz tall_block.stl --out test
    python3 -m echofuse.tmf8820 rendered tall_block.json.gz --records 4000 --seed 1 --out train
"""
from __future__ import annotations

import argparse
import gzip
import json
import pathlib
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .acquire import write_run

Array = NDArray[np.float64]
# metres of range a bin; bin of range 0: fitted once to a block at known poses
BINS, BIN_M, ZERO_BIN = 128, 0.0138, 12.0
SIZE, HALF_TANGENT = 32, 0.3  # rays and pixels both ways; half of the chip's 33 degrees
PS_PER_M = 2e12 / 299_792_458.0
COUNTS, BACKGROUND = 3e6, 600.0  # usual record: photons of all zones, counts a bin


def read_measured(path: str | pathlib.Path) -> tuple[Array, Array, Array]:
    """Counts [n, 128] of all zones, references [n, 128], poses [n, 4, 4] of a shape's file. Raises
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
    return hists.sum(1), reference, pose


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


def cast(pose: Array, triangles: Array) -> tuple[Array, Array, Array]:
    """From a pose (columns: x, y, view, place) through SIZE x SIZE pixels, row-major from the top
    left: z along the view (inf: nothing), cosine at the surface, height of the hit. Moeller and
    Trumbore's test."""
    at = HALF_TANGENT * ((2 * np.arange(SIZE) + 1) / SIZE - 1)
    x, y = np.meshgrid(at, -at)
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
    return np.where(np.isfinite(depth) & (height > table_m + 0.003), depth,
                    np.nan).astype(np.float32).reshape(SIZE, SIZE)


def box(x: float, y: float, z: float) -> Array:
    """Triangles of a box on the plane z = 0 about the origin."""
    corners = np.array([(sx * x / 2, sy * y / 2, sz * z) for sz in (0, 1)
                        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    return _hull(corners, 4)


def wedge(x: float, y: float, z: float) -> Array:
    """A box whose top is drawn together to a ridge."""
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


def histogram(depth: Array, cosine: Array, albedo: Array, response: Array) -> Array:
    """Relative counts [128] of a scene: cos / r^2 of each ray at its range, blurred by the
    response."""
    at = HALF_TANGENT * ((2 * np.arange(SIZE) + 1) / SIZE - 1)
    slant = np.sqrt(1 + np.add.outer(at ** 2, at ** 2)).ravel()
    seen = np.isfinite(depth)
    range_m = (depth * slant)[seen]
    place = np.clip(range_m / BIN_M + ZERO_BIN, 0, BINS - 2)
    low, weight = place.astype(int), (albedo * cosine)[seen] / range_m ** 2
    sharp = np.bincount(low, weight * (1 - (place - low)),
                        BINS) + np.bincount(low + 1, weight * (place - low), BINS)
    return np.convolve(sharp, response)[int(response.argmax()):][:BINS]


def rendered(reference: Array, records: int,
             seed: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Counts [n, 128] and maps [n, SIZE, SIZE] of random objects. reference [128]: the chip's own
    response."""
    rng = np.random.default_rng(seed)
    response = np.clip(reference - np.median(reference[-20:]), 0,
                       None)[max(int(reference.argmax()) - 3, 0):][:40]
    table = np.array([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]],
                     float)
    counts, maps = [], []
    for _ in range(records):
        solid, high = any_object(rng)
        depth, cosine, height = cast(any_pose(rng, high), np.concatenate([table, solid]))
        maps.append(truth_of(depth, height, 0))
        albedo = np.where(height > 0.003, np.exp(rng.uniform(-1, 1)), 1.0)
        bare = histogram(depth, cosine, albedo, response ** rng.uniform(1, 1.6))
        total = COUNTS * np.exp(rng.uniform(-1, 1))
        counts.append(rng.poisson(total * bare / max(bare.sum(),
                                                     1e-30) + BACKGROUND * rng.uniform(0.5, 1.5)))
    return np.array(counts, np.uint32), np.array(maps)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python3 -m echofuse.tmf8820",
                                     description=__doc__.split("\n\n")[0])
    parser.add_argument("what", choices=("measured", "rendered"))
    parser.add_argument(
        "data", help="NAME.json.gz of a shape: its records, or the response of the rendered ones")
    parser.add_argument("mesh", nargs="?", help="NAME.stl or NAME.obj, of measured records")
    parser.add_argument("--records", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", required=True, help="run to make")
    args = parser.parse_args()
    try:
        make(args.what, args.data, args.mesh, args.records, args.seed, args.out)
    except (ValueError, OSError, RuntimeError) as error:
        sys.exit(f"tmf8820: {error}")


def make(what: str, data: str | pathlib.Path, mesh: str | pathlib.Path | None, records: int,
         seed: int,
         out: str | pathlib.Path) -> None:
    """Makes a run of the measured records of a shape, or of rendered ones with its chip's
    response."""
    counts: NDArray[Any]
    counts, references, poses = read_measured(data)
    if what == "measured":
        if mesh is None:
            raise ValueError("measured records need the mesh of their shape")
        triangles = read_mesh(mesh)
        table_m = table_height(triangles)
        maps = np.array([truth_of(*(found := cast(pose, triangles))[::2], table_m)
                         for pose in poses])
    else:
        counts, maps = rendered(references.mean(0), records, seed)
    write_run(out, spd=counts, first_bin_ps=-ZERO_BIN * BIN_M * PS_PER_M,
              bin_width_ps=BIN_M * PS_PER_M, depth_m=maps,
              half_tangent=HALF_TANGENT, label=pathlib.Path(data).name.split(".")[0]
              if what == "measured" else "solid",
              notes=f"TMF8820: {what}")


if __name__ == "__main__":
    main()
