# SPDX-License-Identifier: MIT
"""Measures how finely a scene must be sampled in the simulator. Compares data sets with coarse
settings to a data set with fine settings and the same seed.

    PYTHONPATH=. python3 examples/detail.py --fine spd_rays=2048 --coarse spd_rays=128 spd_rays=256

Photons and radar power are simulated almost without noise. Their mean squared errors are relative
to the noise variance at --photons and --snr-db. Errors far below 1 are negligible compared
with the noise. """
import argparse
import tempfile

import numpy as np

import echofuse
from echofuse.bench import call

MANY = 1e9  # number of photons per record; large enough to make photon noise negligible
QUIET = [f"signal_photons={MANY:g}", "radar_snr_db=200"]


def dataset(path: str, args: argparse.Namespace, settings: list[str]) -> echofuse.Run:
    words = [word for setting in [*QUIET, *args.set, *settings] for word in ("--set", setting)]
    call("echofuse-sim", "dataset", "-q", "--out", path, "--records", args.records,
         "--seed", args.seed, *words)
    return echofuse.open(path)


def errors(coarse: echofuse.Run, fine: echofuse.Run, photons: float, snr_db: float) -> list[float]:
    """Returns four errors: the mean squared errors of the counts (in bins with at least one count)
    and of the radar power, relative to the noise variance; the mean depth difference, mm; and the
    fraction of pixels with a return in only one of the two maps."""
    counts, true_counts = (run.spd * (photons / MANY) for run in (coarse, fine))
    lit = true_counts >= 1
    power, true_power = coarse.power(), fine.power()
    noise = true_power.max(axis=1).mean() * 10 ** (-snr_db / 10)
    difference = np.abs(coarse.maps() - fine.maps())
    return [np.mean((counts - true_counts)[lit] ** 2 / true_counts[lit]),
            np.mean((power - true_power) ** 2) / noise**2, 1000 * np.nanmean(difference),
            np.mean(np.isnan(coarse.maps()) != np.isnan(fine.maps()))]


def main() -> None:
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--fine", nargs="+", required=True,
                        help="simulator settings KEY=VALUE of the fine data set")
    parser.add_argument("--coarse", nargs="+", required=True,
                        help="simulator settings KEY=VALUE; each is used for one coarse data set")
    parser.add_argument("--set", nargs="*", default=["spd_rays=1024"],
                        help="simulator settings KEY=VALUE of all data sets")
    for name, value, text in (
            ("photons", 1e5, "number of photons per record for which the noise variance is "
                             "computed"),
            ("snr-db", 20.0, "radar signal-to-noise ratio for which the noise variance is "
                             "computed, dB"),
            ("records", 40, "number of records per data set"), ("seed", 1, "random seed")):
        parser.add_argument(f"--{name}", type=type(value), default=value, help=text)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        fine = dataset(f"{folder}/fine", args, args.fine)
        print("setting,spd_chi2,radar_chi2,depth_mm,pixels")
        for setting in args.coarse:
            coarse = dataset(f"{folder}/{setting}", args, [setting])
            found = errors(coarse, fine, args.photons, args.snr_db)
            print(setting, *(f"{error:.3g}" for error in found), sep=",")


if __name__ == "__main__":
    main()
