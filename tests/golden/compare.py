#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""compare.py OLD NEW: makes the outputs of freeze.py with two builds, and compares their numbers.

Prints one line per output: "equal", or the largest difference and its ratio to the largest value of the output. Arrays that
only one build writes are named. Use it for a change of a file format, after which the hashes of freeze.py differ.
"""
import argparse
import collections
import json
import pathlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator

import h5py
import numpy as np
from PIL import Image

# times, identities and texts, and SQL tables, in which a change of format shows
LEFT_OUT = ("time", "tables/", "label", "version", "entry_identifier", "start_time", "end_time")


def arrays(path: pathlib.Path) -> Iterator[tuple[str, np.ndarray]]:
    """Yields the numeric arrays of a file."""
    if path.suffix == ".h5":
        with h5py.File(path) as file:
            found: list[tuple[str, np.ndarray]] = []
            file.visititems(lambda name, item: found.append((name, item[()])) if isinstance(item, h5py.Dataset) else None)
        yield from ((name, np.asarray(values)) for name, values in found
                    if np.asarray(values).dtype.kind in "biuf" and not any(word in name for word in LEFT_OUT))
    elif path.suffix == ".safetensors":
        data = path.read_bytes()
        size = int.from_bytes(data[:8], "little")
        for name, tensor in json.loads(data[8:8 + size]).items():
            if name != "__metadata__" and tensor["dtype"] in ("F32", "F64", "I64"):
                kind = {"F32": "<f4", "F64": "<f8", "I64": "<i8"}[tensor["dtype"]]
                yield name, np.frombuffer(data[8 + size:][slice(*tensor["data_offsets"])], kind)
    elif path.name.endswith("_mm.png"):
        yield "depth, mm", np.asarray(Image.open(path)).astype(float)


def outputs(folder: pathlib.Path) -> dict[str, dict[str, np.ndarray]]:
    """Returns the arrays of each output; the maps of one model and world are one output."""
    out: dict[str, dict[str, list[np.ndarray]]] = collections.defaultdict(lambda: collections.defaultdict(list))
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            for name, values in arrays(path):
                out[path.parent.name if path.suffix == ".png" else path.name][name].append(values.ravel())
    return {file: {name: np.concatenate(parts) for name, parts in found.items()} for file, found in out.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=pathlib.Path, help="build folder before the change")
    parser.add_argument("new", type=pathlib.Path, help="build folder after the change")
    args = parser.parse_args()
    freeze = pathlib.Path(__file__).with_name("freeze.py")
    with tempfile.TemporaryDirectory() as scratch:
        both = []
        for name in ("old", "new"):
            subprocess.run([sys.executable, freeze, getattr(args, name), "--keep", f"{scratch}/{name}"],
                           check=True, stdout=subprocess.DEVNULL)
            both.append(outputs(pathlib.Path(scratch, name)))
    old, new = both
    for file in sorted(old.keys() | new.keys()):
        was, now = old.get(file, {}), new.get(file, {})
        for name in sorted(was.keys() ^ now.keys()):
            print(f"{file} {name}: only in the {'old' if name in was else 'new'} output")
        for name in sorted(was.keys() & now.keys()):
            a, b = was[name].astype(float), now[name].astype(float)
            if a.shape != b.shape:
                print(f"{file} {name}: {a.size} values before, {b.size} after")
            elif not np.array_equal(a, b, equal_nan=True):
                off, top = np.nanmax(abs(a - b)), np.nanmax(abs(a))
                print(f"{file} {name}: differs by at most {off:.3g}, {off / top if top else np.inf:.2g} of the largest value")
        if not any(was[name].shape != now[name].shape or not np.array_equal(was[name], now[name], equal_nan=True)
                   for name in was.keys() & now.keys()):
            print(f"{file}: equal")


if __name__ == "__main__":
    main()
