#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Serves the histograms of a TMF8820 (ams OSRAM, nine zones of 128 bins) over the echofuse bridge
protocol. Reads them from the log of the manufacturer's Arduino program, in which histograms must be
enabled. echofuse connects with tdc.address = "bridge:tcp://HOST:PORT".

A measurement consists of 30 lines "#Raw,ADDRESS,K,128 bytes" and a line "#Obj,ADDRESS,NUMBER,...".
K is 10 * byte + channel. Byte 0 is the low byte. Channel 0 is the reference, and channels 1 to 9 are
the zones. Other modes of the chip are refused. A board that waits is started with the commands e
(enable), z (histograms) and m (measure)."""
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


# Numbers of the chip's SPAD maps ("#Conf,... SPAD=7") that have other zones than 3 x 3.
OTHER_MODES = {4: "4 x 4", 5: "4 x 4", 7: "4 x 4", 10: "3 x 6", 15: "8 x 8"}


class Log:
    """Assembles measurements from log lines. Discards and counts a measurement if a line is missing or damaged. Calls
    refuse(reason) once, and takes no more lines, if the log is from another mode of the chip."""

    def __init__(self, address=None, refuse=bridge.say):
        self.lost, self.refused = 0, False
        self._chosen, self._address, self._refuse = address, address, refuse
        self._rows, self._number = [], None  # rows of the current measurement; number of the last one
        self._odd = {}  # number of lines with each oddity
        self._recent, self._taken = [], 0

    def take(self, line):
        """Adds a line; returns the counts [zones, bins] if it completes a measurement, otherwise None."""
        line = line.strip()
        kind, *fields = line.split(",")
        if self.refused:
            return None
        if kind == "#Conf" and "SPAD=" in line:
            self._check_map(line)
        if kind not in ("#Raw", "#Obj"):
            if "#Raw," in line:
                self._suspect(f'text before #Raw: "{line[:line.find("#Raw")]}"; switch off the time stamps of the serial monitor',
                              10)
            return None
        try:
            numbers = [int(field) for field in fields]
        except ValueError:
            numbers = []
        if numbers[:1] != [self._address] and self._address is not None and len(numbers) > 1:
            if self._chosen is None:
                self._suspect(f"two chips: I2C addresses {self._address} and {numbers[0]}; choose one with --address", 10)
                self._drop()
            return None
        return self._row(numbers) if kind == "#Raw" else self._result(numbers)

    def _suspect(self, reason, limit):
        """Refuses the log if there are `limit` lines with the same oddity, because single lines may be damaged."""
        oddity = reason.split(":")[0]
        self._odd[oddity] = self._odd.get(oddity, 0) + 1
        if self._odd[oddity] >= limit and not self.refused:
            self.refused = True
            self._refuse(reason)

    def _check_map(self, line):
        number = line.partition("SPAD=")[2].split(" ")[0].split(",")[0]
        if number.isdigit() and int(number) in OTHER_MODES:
            self._suspect(f"the chip is in the {OTHER_MODES[int(number)]} mode; expected 3 x 3 (command c changes it)", 1)

    def _drop(self):
        self.lost += bool(self._rows)
        self._rows = []

    def _row(self, numbers):
        sound = len(numbers) == 2 + BINS and 0 <= min(numbers) and max(numbers[2:]) < 256
        if sound and BYTES * CHANNELS <= numbers[1] < 2 * BYTES * CHANNELS:
            self._suspect("two captures for each result: the chip is in the 4 x 4 mode; expected 3 x 3", 5)
        if sound and numbers[1] == 0 and len(self._rows) == BYTES * CHANNELS:
            self._suspect("several captures for each #Obj line: the chip is in the 4 x 4 or 8 x 8 mode; expected 3 x 3", 3)
        if not sound or numbers[1] != len(self._rows):
            self._drop()
        if sound and numbers[1] == len(self._rows):
            self._rows.append(numbers[2:])
            self._first = numbers[0]

    def _result(self, numbers):
        rows, last = self._rows, self._number
        if len(numbers) < 2 or not 0 <= numbers[1] < 256 or len(rows) < BYTES * CHANNELS:
            if len(numbers) > 1 and len(rows) == BYTES * CHANNELS:
                self._suspect("result numbers outside 0 to 255: another program or chip?", 3)
            self._number = numbers[1] if len(numbers) > 1 else last
            return self._drop()
        self._rows, self._number, self._address = [], numbers[1], self._first
        step = 1 if last is None else (numbers[1] - last) % 256
        if step == 0:
            self.lost += 1
            return self._suspect("result numbers do not change: another mode or program?", 3)
        self.lost += step - 1 if step < 128 else 0  # a larger step is a restart of the board
        digits = np.array(rows, "<u4").reshape(BYTES, CHANNELS, BINS)
        counts = (digits << np.array([0, 8, 16], "<u4")[:, None, None]).sum(0)[1:].astype("<u4")
        if impossible(counts):
            self.lost += 1
            return None
        self._check_sequence(counts)
        return None if self.refused else counts

    def _check_sequence(self, counts):
        """In the 8 x 8 mode, four sub-captures alternate: each fourth measurement is alike, and its neighbours differ."""
        self._taken += 1
        self._recent = self._recent[-7:] + [counts.astype(float)]
        if self._taken % 8 == 0 and self._taken <= 32:
            lag = [sum(np.abs(a - b).sum() for a, b in zip(self._recent, self._recent[k:])) / (8 - k) for k in range(1, 5)]
            if lag[3] < 0.3 * min(lag[:3]):
                self._suspect("each fourth measurement is alike: the chip is in the 8 x 8 mode; expected 3 x 3", 1)


def impossible(counts):
    """Returns whether a bin has more than 100 times the counts of its neighbours, because a pulse is several bins wide."""
    padded = np.pad(counts.astype(float), ((0, 0), (1, 1)))
    return bool(((counts > 5000) & (counts > 100 * np.maximum(padded[:, :-2], padded[:, 2:]))).any())


class Port:
    """Reads measurement lines from a serial port."""

    def __init__(self, path, baud):
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._fd, termios.TCSANOW)  # keeps the lines that the board has sent already
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

    def write(self, commands):
        os.write(self._fd, commands)

    def close(self):
        os.close(self._fd)


def captured(path, address=None):
    """Returns the counts [zones, bins] of every measurement in a log file or in a JSON file of records with the key
    "hists". Raises ValueError for other files."""
    path = pathlib.Path(path)

    def refuse(reason):
        raise ValueError(f"{path}: {reason}")

    with (gzip.open if path.suffix == ".gz" else open)(path, "rt", encoding="utf-8") as file:
        text = file.read()
    if text.lstrip().startswith("["):
        found = [np.array(record["hists"], "<u4") for record in json.loads(text)]
    else:
        log = Log(address, refuse)
        found = [counts for line in text.splitlines() if (counts := log.take(line)) is not None]
    if not found or any(counts.shape != (CHANNELS - 1, BINS) for counts in found):
        raise ValueError(f"{path}: expected measurements of {CHANNELS - 1} zones and {BINS} bins, as "
                         "#Raw lines or JSON")
    return found


class Chip:
    def __init__(self, options):
        self._exposure_s, self._next = options.exposure, 0
        self._counts = captured(options.replay, options.address) if options.replay else None
        self._port = None if options.replay else Port(options.port, options.baud)
        self._log, self._lost_reported = Log(options.address, self._refuse), 0
        self._opened, self._started = time.monotonic(), False
        self._source = options.replay or options.port

    def hello(self):
        return {"model": "TMF8820", "serial": os.path.basename(self._source), "firmware": "",
                "sends": "histograms", "zones": ZONES}

    @staticmethod
    def _refuse(reason):
        raise RuntimeError(reason)

    def _start(self, lines):
        """Starts a board that waits: it has sent its help text, or nothing for 3 s."""
        if any(line.startswith("#") for line in lines):
            self._started = True
        elif any(line.strip() for line in lines) or time.monotonic() > self._opened + 3:
            bridge.say("the board waits; sending e, z and m: enable, histograms, measure")
            self._port.write(b"ezm")
            self._started = True

    def _send(self, server, counts):
        server.send(bridge.HISTOGRAM, bridge.histogram(counts, -ZERO_BIN * BIN_WIDTH_PS, BIN_WIDTH_PS,
                                                       self._exposure_s), items=1)

    def poll(self, server):
        if self._counts:
            time.sleep(self._exposure_s)
            self._send(server, self._counts[self._next % len(self._counts)])
            self._next += 1
            return 0
        lines = self._port.lines()
        if not self._started:
            self._start(lines)
        for line in lines:
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
    parser.add_argument("--address", metavar="N", type=bridge.number(int, 0, 127),
                        help="I2C address of the chip, if the board has several (65 by default)")
    parser.add_argument("--exposure", metavar="S", type=bridge.number(float, 0.001, 60), default=EXPOSURE_S,
                        help=f"duration of a measurement, s (default: {EXPOSURE_S:g})")
    parser.add_argument("--replay", metavar="FILE",
                        help="replay this log or public capture (.json.gz) in a loop, instead of reading from a board")
    options = parser.parse_args()
    bridge.require_packages()
    return bridge.run(options.listen, lambda: Chip(options), "histograms")


if __name__ == "__main__":
    sys.exit(main())
