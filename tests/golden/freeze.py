#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""freeze.py BUILD [--keep FOLDER]: prints the SHA-256 of each output of the programs below BUILD.

Compare the outputs before and after a change with diff. The hashes ignore uuids, the host, the commit and all times."""
import argparse
import hashlib
import json
import pathlib
import re
import subprocess
import sys
import tempfile

import h5py
import numpy as np

VOLATILE = re.compile(
    r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}|20[2-9]\d-\d\d-\d\d[T ][\d:.]+Z?|\"host\": \"[^\"]*\"")
# The size of a model depends on the digits of the times that it stores.
MEASURED = {"infer_us_batch", "infer_us_median", "infer_us_p99", "train_s", "model_bytes", "file", "model", "host"}
WORLDS = {"base": [], "antennas": ["radar_antennas=8", "radar_sum=coherent", "radar_frames=20"], "room": ["background=room"],
          "zones": ["spd_zones=3"]}

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("build", type=pathlib.Path, help="build folder, e.g. build/release")
parser.add_argument("--keep", type=pathlib.Path, help="keep the outputs in this folder")
arguments = parser.parse_args()
scratch = tempfile.TemporaryDirectory()
work = (arguments.keep or pathlib.Path(scratch.name)).resolve()
work.mkdir(parents=True, exist_ok=True)


def run(name, *words):
    command = [arguments.build.resolve() / name, *words]
    done = subprocess.run(command, cwd=work, capture_output=True, text=True)
    return done.stdout if done.returncode == 0 else sys.exit(f"freeze: {command}: {done.stderr.strip()}")


def say(name, *parts):
    """Prints the hash of bytes, or of texts without the volatile parts."""
    total = hashlib.sha256()
    for part in parts:
        total.update(VOLATILE.sub("*", part).encode() if isinstance(part, str) else part)
    print(f"{total.hexdigest()}  {name}", flush=True)


def values_of(path):
    """Yields the names, the attributes and the data of an HDF5 file."""
    with h5py.File(path) as file:
        items = [("", file)]
        file.visititems(lambda name, item: items.append((name, item)))
        for name, item in items:
            yield from (name, *(f"{key}={np.asarray(item.attrs[key]).tolist()!r}" for key in sorted(item.attrs)))
            if isinstance(item, h5py.Dataset):
                data = np.asarray(item[()])
                yield repr(data.tolist()) if data.dtype.kind in "OS" else np.ascontiguousarray(data).tobytes()


def unmeasured(item):
    """Returns JSON data without measured times and the paths of files."""
    if isinstance(item, dict):
        return {key: unmeasured(value) for key, value in item.items() if key not in MEASURED}
    return [unmeasured(value) for value in item] if isinstance(item, list) else item


def say_json(name, text):
    say(name, json.dumps(unmeasured(json.loads(text)), sort_keys=True))


def say_run(name):
    say_json(f"{name} info", run("bin/echofuse-acquire", "info", f"{name}.sqlite", "--json"))
    run("bin/echofuse-export", f"{name}.sqlite", "--to", f"{name}.h5")
    say(f"{name} export", *values_of(work / f"{name}.h5"))


def say_table(name, path):
    """Prints the hash of a table without its columns of measured times."""
    lines = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")]
    kept = [i for i, column in enumerate(lines[0]) if not column.endswith(("_us", "_s", "_ms")) and "_us_" not in column]
    say(name, *(",".join(line[i] for i in kept) + "\n" for line in lines))


def say_weights(model):
    data = (work / model).read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8:8 + size])
    header.pop("__metadata__", None)
    say(f"{model} tensors", *(name.encode() + data[8 + size:][slice(*tensor["data_offsets"])] for name, tensor in sorted(header.items())))


def say_help(name, *words):
    text = run(f"bin/echofuse-{name}", *words, "--help")
    say(" ".join([f"echofuse-{name}", *words, "--help"]), text.encode())
    for command in re.findall(r"^  (\w+)", text.partition("Subcommands:")[2].partition("\n\n")[0], re.M):
        say_help(name, *words, command)


for program in ("acquire", "recon", "view", "sim", "export"):
    say_help(program)
for world, settings in WORLDS.items():
    for seed in "123":
        run("bin/echofuse-sim", "dataset", "--out", f"{world}{seed}.sqlite", "--records", "120", "--seed", seed, "-q",
            *(word for setting in settings for word in ("--set", setting)))
        say_run(f"{world}{seed}")
for world in WORLDS:
    for kind in ("factorised-4", "mean-shape", "ridge", "mlp-32"):
        model, folder = f"{world}-{kind}.safetensors", work / f"maps-{world}-{kind}"
        run("bin/echofuse-recon", "-q", "train", f"{world}1.sqlite", "--model", kind, "--epochs", "4", "--out", model)
        say_weights(model)
        say_json(f"{world} {kind} evaluate", run("bin/echofuse-recon", "-q", "evaluate", model, f"{world}2.sqlite", "--train",
                                                 f"{world}1.sqlite", "--json"))
        run("bin/echofuse-recon", "-q", "reconstruct", model, f"{world}2.sqlite", "--out", str(folder), "--format", "colour,mm")
        say(f"{world} {kind} maps", *(path.read_bytes() for path in sorted(folder.glob("*.png"))))
        say_table(f"{world} {kind} records.csv", folder / "records.csv")
run("bin/echofuse-recon", "-q", "train", "base3.sqlite", "--from", "base-factorised-4.safetensors", "--out", "tuned.safetensors")
say_weights("tuned.safetensors")
run("tests/virtual_run", "--out", "day.sqlite", "--slots", "28800", "--seed", "1")
say_run("day")
