#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Template of a bridge for your own sensor; it simulates a counting board that sends histograms.
echofuse connects with tdc.address = "bridge:tcp://HOST:PORT". For a radar, send RANGE_PROFILE blocks
(bridge.range_profile) and connect with radar.address."""
import sys
import time

import bridge
from pack import np

BINS, BIN_WIDTH_PS, FIRST_BIN_PS = 336, 100.0, 13343.0  # two-way times for ranges of 2 to 7 m
EXPOSURE_S, PULSES = 0.05, 50_000                       # exposure time, and number of laser pulses per exposure


def list_boards():
    return ["SIM-1"]  # replace with the serial numbers that your library lists


class Board:
    """Wraps the calls to your library. After any exception, bridge.run() closes the device and
    tries to reopen it."""

    def __init__(self, serial):
        self._serial = bridge.choose(list_boards(), serial, "board")
        self._random = np.random.default_rng()

    def hello(self):
        return {"model": "Simulated board", "serial": self._serial, "firmware": "1.0",
                "sends": "histograms"}  # omit the key "sends" for a radar

    def poll(self, server):
        """Sends new data from the device; returns the seconds until the next call."""
        time.sleep(EXPOSURE_S)  # simulates the exposure time of a real board
        body = 150 + 40 * np.sin(time.monotonic())
        expected = 2 + 60 * np.exp(-0.5 * ((np.arange(BINS) - body) / 3) ** 2)
        counts = self._random.poisson(expected)
        server.send(bridge.HISTOGRAM, bridge.histogram(counts, FIRST_BIN_PS, BIN_WIDTH_PS,
                                                       EXPOSURE_S, PULSES), items=1)
        # If the device dropped n exposures, report them with server.lose(n) before sending the next block.
        return 0

    def close(self):
        pass  # release your device here


def main():
    parser = bridge.parser(__doc__)
    parser.add_argument("--listen", metavar="HOST:PORT", type=bridge.listen_address, default=("127.0.0.1", 41112),
                        help="address to which echofuse connects (default: 127.0.0.1:41112)")
    parser.add_argument("--serial", default="", help="serial number of the board")
    options = parser.parse_args()
    bridge.require_packages()
    return bridge.run(options.listen, lambda: Board(options.serial), "histograms")


if __name__ == "__main__":
    sys.exit(main())
