#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Records a run with a simulated radar that sends antenna samples. Checks that every frame arrives complete, and that
each record contains the statistics of its frames. The expected statistics are computed from the raw bytes."""
import json
import struct

import numpy as np

from case import Case, bin_dir, main, source
from fixtures import crc32c, query
import waiting

cfg = source / "config/radar/xwr68xx_azimuth_50cm.cfg"
MAGIC = bytes((2, 1, 4, 3, 6, 5, 8, 7))
WINDOW_S = 0.4
BINS, KEPT, ANTENNAS = 64, 32, 8
VALUES = ANTENNAS * ANTENNAS + 2 * ANTENNAS + 2


def frames_of(raw):
    """Returns a dictionary that maps each frame number to the frame bytes and the antenna samples [bin, antenna] of the kept
    range bins."""
    frames, place = {}, raw.find(MAGIC)
    while place >= 0 and place + 40 <= len(raw):
        size, number, tlvs = (struct.unpack_from("<I", raw, place + at)[0] for at in (12, 20, 32))
        frame, at, samples = raw[place:place + size], 40, None
        if len(frame) < size or size < 40:
            break
        for _ in range(tlvs):
            kind, length = struct.unpack_from("<II", frame, at)
            if kind == 4:
                parts = np.frombuffer(frame, "<i2", length // 2, at + 8).reshape(BINS, ANTENNAS, 2).astype(float)
                samples = (parts[..., 1] + 1j * parts[..., 0])[:KEPT]
            at += 8 + length
        frames[number] = frame, samples
        place = raw.find(MAGIC, place + size)
    return frames


def unpacked(blob):
    """Returns the power and the statistics of each range bin. Most statistics are relative to the power of the bin. The means
    are relative to the square root of the power."""
    bins = np.frombuffer(blob, [("power", "<f4"), ("values", "<i2", VALUES)])
    assert len(bins) == KEPT
    return bins["power"], bins["values"] / 32767


def parts(complex_values):
    return np.stack([complex_values.real, complex_values.imag], -1).reshape(KEPT, -1)


def statistics(frames, numbers):
    """Computes the power and the statistics of each range bin from the frames of a record."""
    samples, follow = np.array([frames[n][1] for n in numbers]), np.diff(numbers) == 1
    power = (abs(samples) ** 2).sum(2).mean(0)
    covariance = np.einsum("fbm,fbn->bmn", samples, samples.conj()) / len(samples)
    lag = (samples[1:] * samples[:-1].conj())[follow].sum((0, 2)) / max(1, follow.sum())
    scale = np.where(power, power, 1)[:, None]
    # The lag-1 correlation averages fewer products than the power, so it may exceed 1. It is therefore clipped to
    # [-1, 1] before it is stored.
    return power, np.hstack([
        parts(samples.mean(0)) / np.sqrt(scale), np.einsum("bmm->bm", covariance).real / scale,
        parts(covariance[:, *np.triu_indices(ANTENNAS, 1)]) / scale, np.clip(parts(lag) / scale, -1, 1)])


class Antennas(Case):
    def record(self, count):
        done = self.lab(bin_dir / "echofuse-acquire", "run", "--config", self.dir / "lab/lab.toml", "--set", f"run.window_s={WINDOW_S}", "--out",
                        self.dir / "run", "--count", count, "--keep-raw", self.dir / "raw", options=(
                            "--window", WINDOW_S, "--scene", "mixed", "--hold", 5 * WINDOW_S, "--radar-cfg", cfg, "--log", self.dir / "sent.jsonl",
                            "--set", "radar_sum=coherent", "--set", "radar_phase_error_rad=0.3", "--set", "radar_leakage=2"))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.starved = done.starved

    def check(self, count):
        run = self.dir / "run.sqlite"
        records = query(run, "SELECT idx, radar_frames, radar_last, array_frames, array FROM record ORDER BY idx")
        counted = dict(query(run, "SELECT name, value FROM counter WHERE source = 'radar'"))
        self.assertEqual(len(records), count)
        for name in "bad_headers", "bad_tlvs", "bad_arrays", "junk_bytes":
            self.assertEqual(counted.get(name, 0), 0, name)
        frames = frames_of(b"".join(f.read_bytes() for f in sorted((self.dir / "raw").glob("radar-[0-9]*.dat"))))
        # The simulated radar may skip frames on a busy machine.
        log = [entry for entry in map(json.loads, (self.dir / "sent.jsonl").read_text().splitlines()) if entry["device"] == "radar"]
        sent = {entry["frame"]: entry["crc"] for entry in log if entry["what"] == "sent"}
        skipped = {entry["frame"] for entry in log if entry["what"] == "skipped"}
        if self.starved and len(skipped) >= len(sent) / 10:
            waiting.not_checked(f"rate of the frames ({len(skipped)} skipped, {len(sent)} sent)", self.starved)
        else:
            self.assertLess(len(skipped), len(sent) / 10)
        self.assertLessEqual(counted.get("lost_frames", 0), len(skipped))
        before, worst, compared = None, 0, 0
        for idx, used, last, array_frames, blob in records:
            self.assertEqual(array_frames, used, idx)
            if used == 0:
                self.assertIsNone(blob)
                continue
            compared += 1
            numbers = sorted(n for n in sent if n <= last)[-used:]
            if before is not None:
                self.assertLessEqual(set(range(before + 1, numbers[0])), skipped, f"missing frame before record {idx}")
            self.assertEqual(numbers, [n for n in range(numbers[0], last + 1) if n not in skipped], idx)
            before = last
            for n in numbers:
                self.assertEqual(crc32c(frames[n][0]), sent[n], f"frame {n}")
            (power, values), (true_power, true_values) = unpacked(blob), statistics(frames, numbers)
            np.testing.assert_allclose(power, true_power, rtol=1e-5)
            worst = max(worst, abs(values - true_values).max())
        self.assertGreaterEqual(compared, count / 4 if self.starved else count)
        # The limit is half of the quantisation step of 1/32767, plus the rounding error of the sums.
        self.assertLess(worst, 3e-5)

    def test_antenna_statistics_of_20_slots_match_the_raw_frames(self):
        self.record(20)
        self.check(20)

    def test_antenna_statistics_of_200_slots_match_the_raw_frames(self):
        self.record(200)
        self.check(200)


main(Antennas)
