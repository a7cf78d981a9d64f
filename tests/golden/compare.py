#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""compare.py OLD NEW: makes the outputs of freeze.py with two builds, and compares their numbers.

Prints one line per output: "equal", or the largest difference and its ratio to the largest value of the output. Arrays that
only one build writes are named. Use it for a change of a file format, after which the hashes of freeze.py differ."""
import collections
import json
import pathlib
import subprocess
import sys
import tempfile

import h5py
import numpy as np
from PIL import Image

# times, identities and texts, and SQL tables, in which a change of format shows
LEFT_OUT = ("time", "tables/", "label", "version", "entry_identifier", "start_time", "end_time")


def arrays(path):
    """Yields the names and the values of the numeric arrays of a file."""
    if path.suffix == ".h5":
        found = []
        with h5py.File(path) as file:
            file.visititems(lambda *one: found.append(one))
            found = [(name, np.asarray(item[()])) for name, item in found if isinstance(item, h5py.Dataset)]
        yield from ((name, values) for name, values in found
                    if values.dtype.kind in "biuf" and not any(word in name for word in LEFT_OUT))
    elif path.suffix == ".safetensors":
        data = path.read_bytes()
        size = int.from_bytes(data[:8], "little")
        for name, tensor in json.loads(data[8:8 + size]).items():
            if kind := {"F32": "<f4", "F64": "<f8", "I64": "<i8"}.get(tensor.get("dtype")):
                yield name, np.frombuffer(data[8 + size:][slice(*tensor["data_offsets"])], kind)
    elif path.name.endswith("_mm.png"):
        yield "depth, mm", np.asarray(Image.open(path))


def outputs(build):
    """Returns the arrays of the outputs of a build, by output and name; the maps of one model and world are one output."""
    out = collections.defaultdict(lambda: collections.defaultdict(list))
    with tempfile.TemporaryDirectory() as folder:
        freeze = pathlib.Path(__file__).with_name("freeze.py")
        subprocess.run([sys.executable, freeze, build, "--keep", folder], check=True, stdout=subprocess.DEVNULL)
        for path in filter(pathlib.Path.is_file, sorted(pathlib.Path(folder).rglob("*"))):
            for name, values in arrays(path):
                out[path.parent.name if path.suffix == ".png" else path.name][name].append(values.ravel())
    return {file: {name: np.concatenate(parts).astype(float) for name, parts in found.items()} for file, found in out.items()}


old, new = map(outputs, sys.argv[1:])
for file in sorted(old.keys() | new.keys()):
    was, now = old.get(file, {}), new.get(file, {})
    different = [f"{name}: only in the {'old' if name in was else 'new'} output" for name in sorted(was.keys() ^ now.keys())]
    for name in sorted(was.keys() & now.keys()):
        a, b = was[name], now[name]
        if a.shape != b.shape:
            different.append(f"{name}: {a.size} values before, {b.size} after")
        elif not np.array_equal(a, b, equal_nan=True):
            off, top = np.nanmax(abs(a - b)), np.nanmax(abs(a))
            different.append(f"{name}: differs by at most {off:.3g}, {off / top if top else np.inf:.2g} of the largest value")
    print("\n".join(f"{file} {line}" for line in different) or f"{file}: equal")
