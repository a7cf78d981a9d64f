#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""scripts/compare_torch.py MODEL RUN... [--bin DIR] [--threads N] [--keep DIR]: trains the network of an mlp
model in PyTorch on the same records as MODEL, trains it here once more, and prints both rows: accuracy on
the records that were held out, seconds per epoch, microseconds per map.

Both have the same split, inputs, widths, epochs, batch, patience, He initialisation, squared loss, AdamW and
half a cosine of learning rate, read from MODEL; only the random numbers differ. PyTorch's weights are put
into a copy of the model file, so that `echofuse-recon evaluate` scores both. The microseconds are those of
one record's map with one thread: here from its counts on, in PyTorch from the normalised record on."""
import argparse
import json
import math
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zlib

try:
    import h5py
    import numpy
    import torch
except ImportError as error:
    sys.exit(f"compare_torch.py: {error}; install it with: apt-get install python3-torch python3-h5py python3-numpy")


def seal(path):
    """Puts the checksum of a changed model in front of it (acquire/record/h5.hpp)."""
    contents = path.read_bytes()[512:]
    head = b"ECHOFUSE" + struct.pack("<IIQ", 1, zlib.crc32(contents), 512 + len(contents))
    path.write_bytes(head.ljust(512, b"\0") + contents)


def training_options(path):
    """What MODEL was trained with, as options of `echofuse-recon train`."""
    with h5py.File(path) as f:
        if f.attrs["model"] not in ("mlp", b"mlp"):
            sys.exit(f"compare_torch.py: {path}: a model of kind {f.attrs['model']}; only an mlp can be compared")
        if "epochs" not in f["training"].attrs:
            sys.exit(f"compare_torch.py: {path}: written before models kept their settings; train it anew")
        text = lambda value: value.decode() if isinstance(value, bytes) else str(value)
        options = {name.replace("_", "-"): text(f.attrs[name])
                   for name in ("inputs", "scaling", "split", "gap", "seed", "test_share", "validation_share")}
        for name in ("epochs", "batch", "patience", "learning_rate", "weight_decay"):
            options[name.replace("_", "-")] = text(f["training"].attrs[name])
        options["model"] = "mlp"
        options["hidden"] = ",".join(str(n) for n in f["training/hidden"][:])
        radar = f["axes/radar"].attrs
        if text(radar["quantity"]) == "binned_power":
            options["radar-bin"] = text(radar["step"])
    return options


class Network(torch.nn.Module):
    """The layers between the scaling of inputs and maps, and that scaling."""

    def __init__(self, model, widths):
        super().__init__()
        spd, radar = (float(model["features"].attrs[name]) for name in ("spd_gain", "radar_gain"))
        inputs = model.attrs["inputs"]
        bins = 0 if inputs in ("radar", b"radar") else int(model["axes/spd"].attrs["count"])
        gain = torch.full((widths[0],), radar)
        gain[:bins] = spd
        for name, value in (("centre", model["features/centre"][:]), ("centre_m", model["model/centre"][:])):
            self.register_buffer(name, torch.from_numpy(value))
        self.register_buffer("gain", gain)
        self.spread_m = float(model["model/spread"][0])  # the same for all pixels
        self.layers = torch.nn.ModuleList(torch.nn.Linear(a, b) for a, b in zip(widths, widths[1:]))
        for layer in self.layers:
            torch.nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            torch.nn.init.zeros_(layer.bias)
        torch.nn.init.zeros_(self.layers[-1].weight)

    def scaled(self, records):
        return (records - self.centre) * self.gain

    def raw(self, x):
        for layer in self.layers[:-1]:
            x = torch.relu(layer(x))
        return self.layers[-1](x)

    def forward(self, records):
        return self.centre_m + self.spread_m * self.raw(self.scaled(records))


def train(network, data, options):
    """Returns seconds per epoch; leaves the best epoch's weights in the network."""
    epochs, batch, patience = (int(options[name]) for name in ("epochs", "batch", "patience"))
    rate = float(options["learning-rate"])
    x = network.scaled(torch.from_numpy(data["record"]))
    maps = torch.from_numpy(data["depth_m"]).flatten(1)
    y = (maps - network.centre_m) / network.spread_m
    rows, judged = (torch.from_numpy(numpy.flatnonzero(data["part"] == part)) for part in (0, 1))
    optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=float(options["weight-decay"]))
    best, least, best_epoch = None, math.inf, 0
    started = time.monotonic()
    for epoch in range(epochs):
        order = rows[torch.randperm(len(rows))]
        for first in range(0, len(order), batch):
            some = order[first:first + batch]
            done = (epoch + first / len(order)) / epochs
            optimiser.param_groups[0]["lr"] = rate * 0.5 * (1 + math.cos(math.pi * done))
            optimiser.zero_grad()
            torch.nn.functional.mse_loss(network.raw(x[some]), y[some]).backward()
            optimiser.step()
        with torch.no_grad():
            loss = float(torch.nn.functional.mse_loss(network.raw(x[judged]), y[judged])) if len(judged) else -epoch
        if loss < least:
            least, best_epoch = loss, epoch + 1
            best = {name: value.clone() for name, value in network.state_dict().items()}
        if epoch + 1 - best_epoch >= patience:
            break
    seconds = (time.monotonic() - started) / (epoch + 1)
    network.load_state_dict(best)
    return seconds


def microseconds_per_map(network, records):
    """Median and 99th percentile, with one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    taken = []
    with torch.inference_mode():
        for i in range(420):
            record = torch.from_numpy(records[i % len(records):][:1])
            started = time.perf_counter()
            network(record)
            taken.append((time.perf_counter() - started) * 1e6)
    torch.set_num_threads(threads)
    taken = sorted(taken[20:])
    return taken[200], taken[396]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("run", nargs="+")
    default = pathlib.Path(__file__).resolve().parent.parent / "build/release/bin"
    parser.add_argument("--bin", default=default, type=pathlib.Path, help="folder of echofuse-recon")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="of both trainings (default: all cores)")
    parser.add_argument("--keep", type=pathlib.Path, help="a folder for both models and the records")
    arguments = parser.parse_args()
    options = training_options(arguments.model)
    recon = str(arguments.bin / "echofuse-recon")
    with tempfile.TemporaryDirectory(prefix="echofuse-") as temporary:
        folder = arguments.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        ours, theirs, records = folder / "ours.h5", folder / "torch.h5", folder / "records.npz"
        run = lambda *words: subprocess.run([recon, *map(str, words)], check=True, stdout=subprocess.PIPE).stdout
        run("train", *arguments.run, "--out", ours, "--threads", arguments.threads, "-q", "--force",
            *(word for name, value in options.items() for word in (f"--{name}", value)))
        run("export", ours, "--to", records, "--run", *arguments.run, "-q")
        data = numpy.load(records)
        data = {name: data[name] for name in data.files}

        torch.set_num_threads(arguments.threads)
        torch.manual_seed(int(options["seed"]))
        with h5py.File(ours) as model:
            layers = sum(name.startswith("layer") for name in model["model"])
            shapes = [model[f"model/layer{i}/weights"].shape for i in range(layers)]
            network = Network(model, [shapes[0][0], *(shape[1] for shape in shapes)])
            epochs = len(model["training/loss_m"])
            seconds = [float(model.attrs["train_s"]) / epochs]
        seconds.append(train(network, data, options))
        shutil.copy(ours, theirs)
        with h5py.File(theirs, "r+") as model:
            for i, layer in enumerate(network.layers):
                model[f"model/layer{i}/weights"][...] = layer.weight.detach().numpy().T
                model[f"model/layer{i}/biases"][...] = layer.bias.detach().numpy()
        seal(theirs)

        print(f"{'':10}{'IoU':18}{'SSIM_fg':18}{'RMSE (m)':18}{'lateral (m)':18}{'s/epoch':9}us/map: median, p99")
        for name, path, per_epoch in (("echofuse", ours, seconds[0]), ("PyTorch", theirs, seconds[1])):
            result = json.loads(run("evaluate", path, arguments.run[0], "--json"))
            cells = [f"{metric['mean'] or 0:.4f} +- {metric['se'] or 0:.4f}" for metric in
                     (result["metrics"][key] for key in ("iou", "ssim_fg", "rmse_m", "lateral_m"))]
            us = (result["cost"]["infer_us_median"], result["cost"]["infer_us_p99"]) if path == ours else \
                microseconds_per_map(network, data["record"])
            print(f"{name:10}" + "".join(f"{cell:18}" for cell in cells) + f"{per_epoch:<9.4f}{us[0]:.1f}, {us[1]:.1f}")
        print(f"{result['records']} held-out records; {len(data['part'])} in all; {arguments.threads} threads to train, "
              f"1 to map; PyTorch {torch.__version__}")


if __name__ == "__main__":
    try:
        main()
    except subprocess.CalledProcessError as error:
        sys.exit(error.returncode)
