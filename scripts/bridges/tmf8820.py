#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Serves the histograms of a TMF8820 (ams OSRAM, nine zones of 128 bins) over the echofuse bridge
protocol. Reads them from the log of the manufacturer's Arduino program, in which histograms must be
enabled. echofuse connects with tdc.address = "bridge:tcp://HOST:PORT".

A measurement consists of 30 lines "#Raw,ADDRESS,K,128 bytes" and a line "#Obj,...". K is
10 * byte + channel. Byte 0 is the low byte. Channel 0 is the reference, and channels 1 to 9 are the
zones."""
import gzip
import json
import os
import pathlib
import select
import sys
import termios
import time
import tty

import bridge
from pack import np

CHANNELS, BINS, BYTES = 10, 128, 3
BIN_WIDTH_PS, ZERO_BIN = 92.06, 12.0  # bin width in two-way time, and the bin that corresponds to range 0
# Fields of view of the channels in the 3 x 3 mode; columns run from right to left, rows from top to bottom.
ZONES = [{"x": x, "y": y, "width": 0.3, "zero_ps": 0} for x in (.17, 0, -.17) for y in (.17, 0, -.17)]
EXPOSURE_S = 0.132  # measurement time in the manufacturer's default configuration


class Log:
    """Assembles measurements from log lines; discards a measurement if a line is missing or damaged."""

    def __init__(self):
        self._rows, self.lost = {}, 0

    def take(self, line):
        """Adds a line; returns the counts [zones, bins] if it completes a measurement, otherwise None."""
        kind, *fields = line.strip().split(",")
        if kind == "#Obj" and self._rows:
            self.lost += 1
            self._rows = {}
        if kind != "#Raw":
            return None
        row = self._row(fields)
        if row is None or row[0] != len(self._rows):
            self.lost += bool(self._rows)
            self._rows = {}
            if row is None or row[0] != 0:
                return None
        self._rows[row[0]] = row[1]
        if len(self._rows) < BYTES * CHANNELS:
            return None
        digits = np.array([self._rows[k] for k in range(BYTES * CHANNELS)], "<u4")
        self._rows = {}
        counts = (digits.reshape(BYTES, CHANNELS, BINS) << np.array([0, 8, 16], "<u4")[:, None, None]).sum(0)
        return counts[1:].astype("<u4")

    @staticmethod
    def _row(fields):
        try:
            numbers = [int(field) for field in fields]
        except ValueError:
            return None
        sound = len(numbers) == 2 + BINS and 0 <= min(numbers[1:]) and max(numbers[2:]) < 256
        return (numbers[1], numbers[2:]) if sound and numbers[1] < BYTES * CHANNELS else None


class Port:
    """Reads measurement lines from a serial port."""

    def __init__(self, path, baud):
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._fd)
        settings = termios.tcgetattr(self._fd)
        settings[4] = settings[5] = getattr(termios, f"B{baud}")
        termios.tcsetattr(self._fd, termios.TCSANOW, settings)
        self._rest = b""

    def lines(self):
        if not select.select([self._fd], [], [], 0.1)[0]:
            return []
        if not (read := os.read(self._fd, 1 << 16)):
            raise RuntimeError("the serial port was disconnected")
        *lines, self._rest = (self._rest + read).split(b"\n")
        return [line.decode("ascii", "replace") for line in lines]

    def close(self):
        os.close(self._fd)


def captured(path):
    """Returns the counts [zones, bins] of every measurement in a log file or in a JSON file of records with the key
    "hists". Raises ValueError for other files."""
    path = pathlib.Path(path)
    with (gzip.open if path.suffix == ".gz" else open)(path, "rt", encoding="utf-8") as file:
        text = file.read()
    if text.lstrip().startswith("["):
        found = [np.array(record["hists"], "<u4") for record in json.loads(text)]
    else:
        log = Log()
        found = [counts for line in text.splitlines() if (counts := log.take(line)) is not None]
    if not found or any(counts.shape != (CHANNELS - 1, BINS) for counts in found):
        raise ValueError(f"{path}: expected measurements of {CHANNELS - 1} zones and {BINS} bins, as "
                         "#Raw lines or JSON")
    return found


class Chip:
    def __init__(self, options):
        self._exposure_s, self._next = options.exposure, 0
        self._counts = captured(options.replay) if options.replay else None
        self._port = None if options.replay else Port(options.port, options.baud)
        self._log, self._lost_reported = Log(), 0
        self._source = options.replay or options.port

    def hello(self):
        return {"model": "TMF8820", "serial": os.path.basename(self._source), "firmware": "",
                "sends": "histograms", "zones": ZONES}

    def _send(self, server, counts):
        server.send(bridge.HISTOGRAM, bridge.histogram(counts, -ZERO_BIN * BIN_WIDTH_PS, BIN_WIDTH_PS,
                                                       self._exposure_s), items=1)

    def poll(self, server):
        if self._counts:
            time.sleep(self._exposure_s)
            self._send(server, self._counts[self._next % len(self._counts)])
            self._next += 1
            return 0
        for line in self._port.lines():
            if (counts := self._log.take(line)) is not None:
                self._send(server, counts)
        server.lose(self._log.lost - self._lost_reported)
        self._lost_reported = self._log.lost
        return 0

    def close(self):
        if self._port:
            self._port.close()


def main():
    parser = bridge.parser(__doc__)
    parser.add_argument("--listen", metavar="HOST:PORT", type=bridge.listen_address, default=("127.0.0.1", 41112),
                        help="address to which echofuse connects (default: 127.0.0.1:41112)")
    parser.add_argument("--port", metavar="FILE", default="/dev/ttyACM0", help="serial port of the board (default: /dev/ttyACM0)")
    parser.add_argument("--baud", type=int, default=115200, choices=(115200, 230400, 460800, 921600, 1000000),
                        help="baud rate of the serial port (default: 115200)")
    parser.add_argument("--exposure", metavar="S", type=bridge.number(float, 0.001, 60), default=EXPOSURE_S,
                        help=f"duration of a measurement, s (default: {EXPOSURE_S:g})")
    parser.add_argument("--replay", metavar="FILE",
                        help="replay this log or public capture (.json.gz) in a loop, instead of reading from a board")
    options = parser.parse_args()
    bridge.require_packages()
    return bridge.run(options.listen, lambda: Chip(options), "histograms")


if __name__ == "__main__":
    sys.exit(main())
