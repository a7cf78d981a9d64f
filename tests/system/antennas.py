#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Records a run with a simulated radar that sends antenna samples. Checks that every frame arrives complete, and that
each record contains the statistics of its frames. The expected statistics are computed from the raw bytes."""
import json
import math
import sqlite3
import struct
import subprocess

from case import Case, bin_dir, main, source
from fixtures import crc32c
import waiting

cfg = source / "config/radar/xwr68xx_azimuth_50cm.cfg"
MAGIC = bytes((2, 1, 4, 3, 6, 5, 8, 7))
WINDOW_S = 0.4
BINS, KEPT, ANTENNAS = 64, 32, 8
VALUES = ANTENNAS * ANTENNAS + 2 * ANTENNAS + 2


def frames_of(raw):
    """Returns a dictionary that maps each frame number to the frame bytes and the antenna samples of the kept range
    bins."""
    frames, place = {}, raw.find(MAGIC)
    while place >= 0:
        size, number, tlvs = (struct.unpack_from("<I", raw, place + at)[0] for at in (12, 20, 32)) \
            if place + 40 <= len(raw) else (0, 0, 0)
        if size < 40 or place + size > len(raw):
            break
        frame, at, samples = raw[place:place + size], 40, None
        for _ in range(tlvs):
            kind, length = struct.unpack_from("<II", frame, at)
            if kind == 4:
                parts = struct.unpack_from(f"<{length // 2}h", frame, at + 8)
                assert length == 4 * BINS * ANTENNAS
                samples = [complex(re, im) for im, re in zip(parts[::2], parts[1::2])][:KEPT * ANTENNAS]
            at += 8 + length
        frames[number] = frame, samples
        place = raw.find(MAGIC, place + size)
    return frames


def unpacked(blob):
    """Yields the power and the statistics of each range bin. Most statistics are relative to the power of the bin.
    The means are relative to the square root of the power."""
    size = 4 + 2 * VALUES
    assert len(blob) == KEPT * size
    for start in range(0, len(blob), size):
        yield struct.unpack_from("<f", blob, start)[0], [v / 32767 for v in struct.unpack_from(f"<{VALUES}h", blob, start + 4)]


def statistics(frames, numbers, b):
    """Computes the power and the statistics of one range bin from its frames."""
    bins = [[frames[n][1][b * ANTENNAS + m] for m in range(ANTENNAS)] for n in numbers]
    power = sum(abs(x) ** 2 for frame in bins for x in frame) / len(bins)
    root = math.sqrt(power) or 1
    covariance = [[sum(f[m] * f[n].conjugate() for f in bins) / len(bins) / (power or 1) for n in range(ANTENNAS)]
                  for m in range(ANTENNAS)]
    pairs = [(a, z) for (i, a), (j, z) in zip(zip(numbers, bins), list(zip(numbers, bins))[1:]) if j == i + 1]
    lag = sum(y * x.conjugate() for a, z in pairs for x, y in zip(a, z)) / max(1, len(pairs)) / (power or 1)
    values = [part for m in range(ANTENNAS) for x in [sum(f[m] for f in bins) / len(bins) / root] for part in (x.real, x.imag)]
    values += [covariance[m][m].real for m in range(ANTENNAS)]
    values += [part for m in range(ANTENNAS) for n in range(m + 1, ANTENNAS)
               for part in (covariance[m][n].real, covariance[m][n].imag)]
    # The lag-1 correlation averages fewer products than the power, so it may exceed 1. It is therefore clipped to
    # [-1, 1] before it is stored.
    return power, values + [max(-1, min(1, part)) for part in (lag.real, lag.imag)]


class Antennas(Case):
    def record(self, count):
        done = waiting.run(
            [bin_dir / "echofuse-sim", "lab", "--dir", self.dir / "lab", "--window", str(WINDOW_S), "--scene", "mixed", "--hold",
             str(5 * WINDOW_S), "--radar-cfg", cfg, "--log", self.dir / "sent.jsonl", "--set", "radar_sum=coherent", "--set",
             "radar_phase_error_rad=0.3", "--set", "radar_leakage=2", "--", bin_dir / "echofuse-acquire", "run", "--config",
             self.dir / "lab/lab.toml", "--set", f"run.window_s={WINDOW_S}", "--out", self.dir / "run", "--count", str(count),
             "--keep-raw", self.dir / "raw"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=180)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.starved = done.starved

    def check(self, count):
        with sqlite3.connect(f"file:{self.dir / 'run.sqlite'}?mode=ro", uri=True) as db:
            records = db.execute("SELECT idx, radar_frames, radar_last, array_frames, array FROM record ORDER BY idx").fetchall()
            counted = dict(db.execute("SELECT name, value FROM counter WHERE source = 'radar'"))
        self.assertEqual(len(records), count)
        for name in "bad_headers", "bad_tlvs", "bad_arrays", "junk_bytes":
            self.assertEqual(counted.get(name, 0), 0, name)
        frames = frames_of(b"".join(f.read_bytes() for f in sorted((self.dir / "raw").glob("radar-[0-9]*.dat"))))
        # The simulated radar may skip frames on a busy machine.
        sent, skipped = {}, set()
        for line in (self.dir / "sent.jsonl").read_text().splitlines():
            entry = json.loads(line)
            if entry["device"] == "radar" and entry["what"] == "sent":
                sent[entry["frame"]] = entry["crc"]
            elif entry["device"] == "radar" and entry["what"] == "skipped":
                skipped.add(entry["frame"])
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
            for b, (power, values) in enumerate(unpacked(blob)):
                true_power, true_values = statistics(frames, numbers, b)
                self.assertAlmostEqual(power, true_power, delta=1e-5 * true_power)
                worst = max(worst, *(abs(v - t) for v, t in zip(values, true_values)))
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
