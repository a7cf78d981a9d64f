#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests scripts/bridges/tmf8820.py, which reads the log of the chip from a serial port or a file."""
import gzip
import json
import os
import pathlib
import pty
import re
import struct
import tempfile
import tty
import unittest

import testing
from testing import Client, Program, np, run_program
import bridge
import fixtures
import tmf8820

SLOTS = 20


def measurement(counts, number=1):
    """Returns the log lines printed by the manufacturer's program for the counts [9, 128], preceded
    by those of a reference channel."""
    channels = np.vstack([np.full(128, 7), counts]).astype(np.int64)
    lines = [f"#Raw,65,{10 * byte + channel}," + ",".join(str(n >> 8 * byte & 255) for n in row)
             for byte in range(3) for channel, row in enumerate(channels)]
    return "".join(line + "\r\n" for line in [*lines, f"#Obj,65,{number},30,9,{number * 1000}" + ",0" * 72])


def body(seed):
    """Returns the counts of the nine zones with a body in front of the sensor."""
    rng = np.random.default_rng(seed)
    near = 40 + 30 * rng.random()
    return rng.poisson(50 + 8e4 * rng.random((9, 1)) * np.exp(-0.5 * ((np.arange(128) - near) / 2) ** 2))


def read(lines, **how):
    """Returns the measurements in these lines of a log, the number of lost measurements, and the reasons to refuse the log."""
    reasons = []
    log = tmf8820.Log(refuse=reasons.append, **how)
    return [taken for line in lines if (taken := log.take(line)) is not None], log.lost, reasons


class Reader(unittest.TestCase):
    def test_histogram_counts_are_assembled_from_three_bytes(self):
        counts = np.arange(9 * 128).reshape(9, 128) * 14_000
        first, second = (measurement(counts, number).splitlines() for number in (1, 2))
        for begin, complete in (0, 2), (5, 1):  # the log may begin within a measurement
            found, lost, _ = read([*first[begin:], *second])
            np.testing.assert_array_equal(found, [counts] * complete)
            self.assertEqual(lost, 0)

    def test_damaged_measurement_is_counted_as_lost(self):
        lines, following = measurement(np.full((9, 128), 3)).splitlines(), measurement(body(1), 2).splitlines()
        impossible = lambda text: re.sub("((?:[^,]*,){40})[^,]*", r"\g<1>99", text, count=1)
        for row, damage in ((12, lambda text: text[:12]), (12, lambda text: text.replace(",", ",x", 3)), (12, lambda text: ""),
                            (12, lambda text: text + ",1"), (12, lambda text: text.replace("#Raw,65,", "#Raw,65,3")),
                            *((2, lambda text, byte=byte: text.rpartition(",")[0] + f",{byte}") for byte in (256, -1)),
                            (12, impossible), (22, impossible)):  # in a middle and in a high byte
            changed = [*lines[:row], damage(lines[row]), *lines[row + 1:]]
            self.assertEqual(read(changed), ([], 1, []))
            found, lost, _ = read([*changed, *following])
            self.assertEqual((len(found), lost), (1, 1))

    def test_logs_of_other_modes_are_refused_with_the_reason(self):
        static = [measurement(body(1), number) for number in range(8)]
        turns = [measurement(body(number % 4), number) for number in range(8)]
        other = [text.replace("#Raw,65", "#Raw,66").replace("#Obj,65", "#Obj,66") for text in static]
        captures = [text[:text.index("#Obj")] for text in static]
        second = [re.sub(r"#Raw,65,(\d+)", lambda m: f"#Raw,65,{int(m[1]) + 30}", text) for text in captures]
        again = [measurement(body(1), 5)] * 8
        for texts, taken, lost, reason in (
                (static, 8, 0, None),
                ([measurement(body(1), 250 + n) for n in range(6)] + [measurement(body(1), 0)], 7, 0, None),
                ([*static[:2], *static[4:]], 6, 2, None),
                ([f"12:01:{k} -> {line}\n" for k, line in enumerate(static[0].splitlines())], 0, 0, "time stamps"),
                ([static[0], other[1]], 1, 0, "two chips: I2C addresses 65 and 66"),
                (turns, 7, 0, "8 x 8 mode"),
                ([captures[n] + static[n] for n in range(8)], 2, 3, "4 x 4 or 8 x 8 mode"),
                ([captures[n] + second[n] + static[n] for n in range(8)], 0, 0, "4 x 4 mode"),
                (["#Conf,Period=132ms,KIter=250 SPAD=7 Pers=0\n", *static], 0, 0, "4 x 4 mode"),
                (["#Conf,Period=132ms,KIter=250 SPAD=6 Pers=0\n", *static], 8, 0, None),
                (again, 1, 3, "result numbers do not change")):
            found, missed, reasons = read("".join(texts).splitlines())
            self.assertEqual((len(found), missed, len(reasons)), (taken, lost, int(reason is not None)), reason)
            self.assertIn(reason or "", " ".join(reasons))
        found, missed, _ = read("".join(a + b for a, b in zip(static, other)).splitlines(), address=66)
        self.assertEqual((len(found), missed), (8, 0))

    def test_sensor_log_is_read_from_text_and_json_files(self):
        with tempfile.TemporaryDirectory() as folder:
            log, public = pathlib.Path(folder, "log.txt"), pathlib.Path(folder, "object.json.gz")
            log.write_text("noise\n" + measurement(body(1)) + measurement(body(2), 2), encoding="utf-8")
            with gzip.open(public, "wt") as file:
                json.dump([{"hists": body(3).tolist(), "pose": []}], file)
            self.assertTrue(np.array_equal(tmf8820.captured(log), [body(1), body(2)]))
            self.assertTrue(np.array_equal(tmf8820.captured(public), [body(3)]))
            log.write_text("noise\n", encoding="utf-8")
            with self.assertRaisesRegex(ValueError, "expected measurements of 9 zones"):
                tmf8820.captured(log)

    def test_board_is_started_and_read_through_a_serial_port(self):
        board, port = pty.openpty()
        tty.setraw(port)
        with Program("tmf8820.py", "--port", os.ttyname(port)) as program, Client(program.address) as client:
            os.write(board, b"UART commands\r\n")
            self.assertEqual(os.read(board, 10), b"ezm")  # the waiting board is started
            blocks = client.until(bridge.HELLO)  # waits for the connection, because earlier measurements would be lost
            os.write(board, (measurement(body(1)) + measurement(body(2), 2)[:500] + "\n" + measurement(body(4), 2)).encode())
            blocks += client.until(bridge.HISTOGRAM)
            hello = json.loads(blocks[0].payload)
            self.assertEqual((hello["sends"], len(hello["zones"])), ("histograms", 9))
            zones, bins = struct.unpack_from("<II", blocks[-1].payload)
            counts = np.frombuffer(blocks[-1].payload, "<u4", offset=44).reshape(zones, bins)
            self.assertTrue(np.array_equal(counts, body(1)))
            last = client.until(bridge.HISTOGRAM)[-1]
            self.assertTrue(np.array_equal(np.frombuffer(last.payload, "<u4", offset=44).reshape(9, 128), body(4)))
            self.assertEqual(program.stop(), 0)
        os.close(board)
        os.close(port)


class Recording(unittest.TestCase):
    def test_tmf8820_recording_contains_the_counts_and_directions_of_its_zones(self):
        with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
            place = pathlib.Path(folder)
            (place / "log.txt").write_text("".join(measurement(body(k), k) for k in range(50)), encoding="utf-8")
            with Program("tmf8820.py", "--replay", place / "log.txt", "--exposure", "0.05") as chip:
                config = testing.config(place / "lab.toml", tdc=chip)
                run_program("echofuse-acquire", "run", "--config", config, "--out", place / "run", "--count", SLOTS)
                self.assertIn("; zones ", run_program("echofuse-acquire", "doctor", "--config", config))
            run = place / "run.sqlite"
            told = json.loads(run_program("echofuse-acquire", "info", run, "--json"))
            self.assertEqual(len(told["zones"]), 9)
            self.assertTrue(all(zone["clicks"] > 0 and abs(zone["x"]) <= 0.17 for zone in told["zones"]))
            self.assertIn("zones     9, clicks ", run_program("echofuse-acquire", "info", run))
            self.assertGreater(told["valid"]["spd"], 0.8 * SLOTS)
            zones = fixtures.query(run, "SELECT x, y, width FROM zone")
            self.assertEqual((len(zones), zones[0]), (9, (0.17, 0.17, 0.3)))


testing.main()
