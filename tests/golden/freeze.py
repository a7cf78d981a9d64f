#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""freeze.py BUILD [--keep FOLDER]: prints the SHA-256 of each output of the programs below BUILD.

Run it before and after a change that should not change results, and compare the outputs with diff. The hashes ignore
uuids, creation times, the host, the commit and measured times. Takes three minutes on two cores.
"""
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
COSTS = {"infer_us_batch", "infer_us_median", "infer_us_p99", "train_s"}
WORLDS = {
    "base": [],
    "antennas": ["radar_antennas=8", "radar_sum=coherent", "radar_frames=20"],
    "room": ["background=room"],
    "zones": ["spd_zones=3"],
}
TABLES = ["all_ok", "run"]


def digest(*parts: bytes) -> str:
    total = hashlib.sha256()
    for part in parts:
        total.update(part)
    return total.hexdigest()


def masked(text: str) -> bytes:
    return VOLATILE.sub("*", text).encode()


def h5_digest(path: pathlib.Path) -> str:
    """Hashes each array and attribute of an HDF5 file, except creation times, host and commit."""
    total = hashlib.sha256()

    def attributes(item: h5py.Dataset | h5py.Group) -> None:
        for key in sorted(item.attrs):
            total.update(masked(f"{key}={np.asarray(item.attrs[key]).tolist()!r}"))

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        total.update(name.encode())
        attributes(item)
        if isinstance(item, h5py.Dataset):
            data = item[()]
            text = np.asarray(data).dtype.kind in "OS"
            total.update(masked(repr(np.asarray(data).tolist())) if text else np.ascontiguousarray(data).tobytes())

    with h5py.File(path) as file:
        attributes(file)
        file.visititems(visit)
    return total.hexdigest()


def json_digest(text: str) -> str:
    """Hashes a JSON object without measured times and the run's path."""

    def without(item: object) -> object:
        if isinstance(item, dict):
            return {k: without(v) for k, v in item.items() if k not in COSTS | {"file", "model", "host"}}
        return [without(v) for v in item] if isinstance(item, list) else item

    return digest(masked(json.dumps(without(json.loads(text)), sort_keys=True)))


def csv_digest(path: pathlib.Path) -> str:
    """Hashes a table without its columns of measured times."""
    lines = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")]
    timed = {i for i, name in enumerate(lines[0]) if name.endswith(("_us", "_s", "_ms")) or "_us_" in name}
    return digest(*(masked(",".join(c for i, c in enumerate(line) if i not in timed)) + b"\n" for line in lines))


class Freeze:
    def __init__(self, build: pathlib.Path, work: pathlib.Path):
        self.build, self.work = build.resolve(), work

    def run(self, program: str, *words: str) -> str:
        command = [str(self.build / program), *words]
        done = subprocess.run(command, cwd=self.work, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"freeze: {' '.join(command)}: {done.stderr.strip()}")
        return done.stdout

    def say(self, name: str, value: str) -> None:
        print(f"{value}  {name}", flush=True)

    def run_file(self, name: str) -> None:
        self.say(f"{name} info", json_digest(self.run("bin/echofuse-acquire", "info", f"{name}.sqlite", "--json")))
        self.run("bin/echofuse-export", f"{name}.sqlite", "--to", f"{name}.h5")
        self.say(f"{name} export", h5_digest(self.work / f"{name}.h5"))

    def virtual_day(self) -> None:
        self.run("tests/virtual_run", "--out", "day.sqlite", "--slots", "28800", "--seed", "1")
        self.run_file("day")

    def data_sets(self) -> None:
        for world, settings in WORLDS.items():
            for seed in "123":
                words = [w for s in settings for w in ("--set", s)]
                self.run("bin/echofuse-sim", "dataset", "--out", f"{world}{seed}.sqlite", "--records", "120", "--seed", seed,
                         "-q", *words)
                self.run_file(f"{world}{seed}")

    def models(self) -> None:
        for world in WORLDS:
            for kind in ("factorised-4", "mean-shape", "ridge", "mlp-32"):
                model = f"{world}-{kind}.safetensors"
                self.run("bin/echofuse-recon", "-q", "train", f"{world}1.sqlite", "--model", kind, "--epochs", "4", "--out", model)
                self.weights(model)
                self.say(f"{world} {kind} evaluate", json_digest(
                    self.run("bin/echofuse-recon", "-q", "evaluate", model, f"{world}2.sqlite", "--train", f"{world}1.sqlite", "--json")))
                folder = self.work / f"maps-{world}-{kind}"
                self.run("bin/echofuse-recon", "-q", "reconstruct", model, f"{world}2.sqlite", "--out", str(folder),
                         "--format", "colour,mm")
                self.say(f"{world} {kind} maps", digest(*(p.read_bytes() for p in sorted(folder.glob("*.png")))))
                self.say(f"{world} {kind} records.csv", csv_digest(folder / "records.csv"))
        self.run("bin/echofuse-recon", "-q", "train", "base3.sqlite", "--from", "base-factorised-4.safetensors", "--out", "tuned.safetensors")
        self.weights("tuned.safetensors")

    def weights(self, model: str) -> None:
        data = (self.work / model).read_bytes()
        size = int.from_bytes(data[:8], "little")
        header = json.loads(data[8:8 + size])
        header.pop("__metadata__", None)
        tensors = [n.encode() + data[8 + size + t["data_offsets"][0]:8 + size + t["data_offsets"][1]] for n, t in sorted(header.items())]
        self.say(f"{model} tensors", digest(*tensors))

    def help_texts(self) -> None:
        for program in ("acquire", "recon", "view", "sim", "export"):
            self.help_of(f"bin/echofuse-{program}", [])

    def help_of(self, program: str, words: list[str]) -> None:
        text = self.run(program, *words, "--help")
        self.say(" ".join([program[4:], *words, "--help"]), digest(text.encode()))
        below = text.split("Subcommands:", 1)[1].split("\n\n", 1)[0] if "Subcommands:" in text else ""
        for name in re.findall(r"^  (\w+)", below, re.M):
            self.help_of(program, [*words, name])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path, help="build folder, e.g. build/release")
    parser.add_argument("--keep", type=pathlib.Path, help="keep the outputs in this folder")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        work = args.keep or pathlib.Path(scratch)
        work.mkdir(parents=True, exist_ok=True)
        freeze = Freeze(args.build, work.resolve())
        freeze.help_texts()
        freeze.data_sets()
        freeze.models()
        freeze.virtual_day()


if __name__ == "__main__":
    main()
