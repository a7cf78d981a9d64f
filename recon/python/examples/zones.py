# SPDX-License-Identifier: MIT
"""Measures what zones of the detector bring, with and without the radar, at equal total light.

    PYTHONPATH=. python3 examples/zones.py --train 4000 --test 1000 --methods mlp:spd mlp

A line of CSV for each number of zones, light, method and seed. The test set has the same scenes for
every number of zones. --set half_tangent=0.275 halves the field of view.
"""
import argparse
import pathlib
import tempfile

from echofuse.methods import call, measure, method

COLUMNS = ("iou", "lateral_m", "depth_mae_m", "multiply_adds", "train_s")


def dataset(path: pathlib.Path, records: int, seed: int, settings: list[str]) -> pathlib.Path:
    words = [word for one in settings for word in ("--set", one)]
    call("echofuse-sim", "dataset", "-q", "--out", path, "--records", records, "--seed", seed,
         *words)
    return path


def main() -> None:
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--zones", type=int, nargs="+", default=[1, 3, 4, 8])
    parser.add_argument("--photons", type=float, nargs="+", default=[1e5])
    parser.add_argument("--methods", nargs="+", default=["mean", "mlp:spd", "mlp"])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--train", type=int, default=1000)
    parser.add_argument("--test", type=int, default=300)
    parser.add_argument("--set", nargs="*", default=[])
    args = parser.parse_args()
    print("zones", "photons", "method", "seed", *COLUMNS, sep=",")
    for photons in args.photons:
        for side in args.zones:
            settings = [*args.set, f"spd_zones={side}", f"signal_photons={photons:g}"]
            with tempfile.TemporaryDirectory() as name:
                folder = pathlib.Path(name)
                train = dataset(folder / "train.sqlite", args.train, 1, settings)
                test = dataset(folder / "test.sqlite", args.test, 2, settings)
                for text in args.methods:
                    for seed in range(1, args.seeds + 1):
                        row = measure(method(text), train, test, seed)
                        print(side * side, f"{photons:g}", text, seed,
                              *(f"{row[column]:.4g}" for column in COLUMNS), sep=",", flush=True)


if __name__ == "__main__":
    main()
