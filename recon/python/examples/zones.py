# SPDX-License-Identifier: MIT
"""Measures the benefit of detector zones, with and without radar, for the same total amount of
light. Reports the scores of the maps, and the fraction of readable letters.

    PYTHONPATH=. python3 examples/zones.py --train 2000 --test 500 --data-sets 1 2 3

Prints a CSV line for each number of zones, light level, data set and method. The test
scenes do not depend on the number of zones. --set half_tangent=0.275 halves the field of view.
"""
import argparse
import pathlib
import tempfile

import echofuse
import numpy as np
from echofuse.bench import call, evaluate, letters, method

COLUMNS = ("iou", "lateral_m", "depth_mae_m", "multiply_adds", "train_s")
LETTERS = ("letters_40x30", "letters_30x20")


def dataset(path: pathlib.Path, records: int, seed: int, settings: list[str]) -> pathlib.Path:
    words = [word for setting in settings for word in ("--set", setting)]
    call("echofuse-sim", "dataset", "-q", "--out", path, "--records", records, "--seed", seed,
         *words)
    return path


def shares(maps: np.ndarray, run: echofuse.Run) -> list[float]:
    """For each letter size, returns the fraction of readable letters in the maps of a run."""
    found, sizes = letters.read(maps, run.maps(), run.labels, run.half_tangent)
    return [float(np.mean(found[sizes == k])) for k in range(len(letters.SIZES))]


def measure(text: str, train: pathlib.Path, test: pathlib.Path) -> list[float]:
    with tempfile.TemporaryDirectory() as name, echofuse.open(test) as run:
        folder = pathlib.Path(name)
        row, _ = evaluate(method(text).fit(train, folder, 1, False), train, test, test)
        call("echofuse-recon", "-q", "reconstruct", folder / "model.safetensors", test, "--format",
             "npy", "--out", folder / "maps")
        maps, _ = echofuse.load_maps(folder / "maps")
        return [row[column] for column in COLUMNS] + shares(maps, run)


def main() -> None:
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--zones", type=int, nargs="+", default=[1, 3, 4, 8],
                        help="numbers of zones along x (and also along y) to compare")
    parser.add_argument("--photons", type=float, nargs="+", default=[1e5],
                        help="mean number of photons per record")
    parser.add_argument("--methods", nargs="+",
                        default=["mean", "nearest:spd", "factorised:spd", "factorised"],
                        help="methods to compare, as for echofuse-bench")
    parser.add_argument("--data-sets", type=int, nargs="+", default=[1],
                        help="random seeds of the data sets")
    parser.add_argument("--train", type=int, default=1000, help="number of training records")
    parser.add_argument("--test", type=int, default=300, help="number of test records")
    parser.add_argument("--set", nargs="*", default=[],
                        help="simulator settings, each as KEY=VALUE")
    args = parser.parse_args()
    print("zones", "photons", "set", "data_set", "method", *COLUMNS, *LETTERS, sep=",")
    for photons in args.photons:
        for data_set in args.data_sets:
            for side in args.zones:
                settings = [*args.set, f"spd_zones={side}", f"signal_photons={photons:g}"]
                with tempfile.TemporaryDirectory() as name:
                    folder = pathlib.Path(name)
                    train = dataset(folder / "train.sqlite", args.train, data_set, settings)
                    test = dataset(folder / "test.sqlite", args.test, 1000 + data_set, settings)
                    head = side * side, f"{photons:g}", " ".join(args.set), data_set
                    with echofuse.open(test) as run:
                        print(*head, "truth", *[""] * len(COLUMNS),
                              *(f"{share:.4g}" for share in shares(run.maps(), run)), sep=",")
                    for text in args.methods:
                        if text == "factorised:spd" and side == 1:
                            text = "pca-mlp-256-256:spd"  # `factorised` needs zones or radar
                        row = measure(text, train, test)
                        print(*head, text, *(f"{value:.4g}" for value in row), sep=",", flush=True)


if __name__ == "__main__":
    main()
