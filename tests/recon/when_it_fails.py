#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Simulates the causes of failure listed in the first table of WHEN_IT_FAILS.md. Checks that the programs print the
words that the table quotes for each cause. Called as `when_it_fails.py BIN TABLE`."""
import collections
import csv
import pathlib
import re
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fixtures"))
import fixtures  # noqa: E402

rows = {}
for line in pathlib.Path(sys.argv[2]).read_text(encoding="utf-8").split("## ")[0].splitlines():
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    if line.startswith("| ") and len(cells) == 3:
        rows[cells[1]] = cells[0]
antennas = ("radar_antennas=8", "radar_sum=coherent")
# The cause, its settings, and the smallest share of the records that must be flagged with the quoted reason.
RECORDS = [
    ("antenna phases", (*antennas, "radar_phase_error_rad=0.8", "radar_array_calibrated=false"), .4, {"model": "antennas"}),
    ("pile-up", ("pulses_per_window=200000", "spd_detector_stated=false"), .8),
    ("two people", (), .4, {"kind": "--two-people"}),
    ("person nearer or farther", ("target_z_min_m=4.4", "target_z_max_m=5"), .8),
    ("empty scene", ("background_counts=10000",), .9, {"kind": "--empty", "count": 50}),
    ("walls or furniture", ("background=room",), .9),
    ("wall echoes", ("background=closed", "multipath_order=1"), .4, {"model": "closed"}),
]
# The cause, its settings, and the smallest share of the records that must not be flagged, because the run as a whole is reported.
RUNS = [
    ("radar range bias", ("radar_bias_m=0.08",), .9),
    ("more radar noise", ("radar_snr_db=10",), 0),
    ("person farther to the side", ("target_x_m=1.6",), .8),
    ("coherent echoes", ("radar_sum=coherent",), 0, {"count": 40}),
    ("radar moved", ("baseline_m=0.2",), .8),
]


MODELS = {"profile": ((), 1200), "closed": (("background=closed",), 1200), "antennas": (antennas, 3000)}


def dataset(seed, settings, kind="--records", count=200):
    words = [word for setting in settings for word in ("--set", setting)]
    return fixtures.made("echofuse-sim", "dataset", "-q", kind, count, "--seed", seed, *words)


class WhenItFails(unittest.TestCase):
    def see(self, beginning, *settings, model="profile", **how):
        """Simulates the cause and reconstructs the run. Returns the words quoted in the table, the output of the
        program, and the number of flagged records for each reason."""
        row = next(cell for cause, cell in rows.items() if cause.startswith(beginning))
        trained_with, count = MODELS[model]
        trained = fixtures.model("mean-shape", dataset(1, trained_with, count=count), "--epochs", 30, "--set", "fallback=false")
        with tempfile.TemporaryDirectory(prefix="fails.") as folder:
            words = [trained, dataset(2, settings, **how), "--format", "npy", "--out", f"{folder}/maps"]
            done = fixtures.outcome("echofuse-recon", "reconstruct", *words)
            self.assertIn(done.returncode, (0, 5), done.stderr)
            with open(f"{folder}/maps/records.csv", newline="", encoding="utf-8") as table:
                reasons = collections.Counter(record["out_of_distribution"] for record in csv.DictReader(table))
        return re.findall(r"`([^`]+)`", row), done.stdout + done.stderr, reasons

    def test_cause_is_reported_for_the_records_or_the_run(self):
        for beginning, settings, least, *how in RECORDS:
            with self.subTest(beginning):
                words, _, reasons = self.see(beginning, *settings, **dict(*how))
                named = sum(count for reason, count in reasons.items() if any(reason.startswith(word) for word in words))
                self.assertGreaterEqual(named, least * sum(reasons.values()), f"{words}: {reasons.most_common(4)}")
        for beginning, settings, least, *how in RUNS:
            with self.subTest(beginning):
                words, said, reasons = self.see(beginning, *settings, **dict(*how))
                self.assertIn("this run differs from the training data", said)
                self.assertTrue(any(word in said for word in words), f"{words}: {said}")
                self.assertGreaterEqual(reasons[""], least * sum(reasons.values()))


unittest.main(argv=sys.argv[:1])
