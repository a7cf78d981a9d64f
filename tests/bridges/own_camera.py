#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Bridge with a simulated depth camera, which provides ground truth for runs with custom sensors."""
import struct
import sys
import time

import scene

import bridge
from pack import np

SIDE, STEP = 64, 0.02


class Camera:
    def __init__(self):
        self._number = 0
        self._random = np.random.default_rng()

    def hello(self):
        return {"model": "Own camera", "serial": "C1", "firmware": "1"}

    def poll(self, server):
        time.sleep(0.05)
        now = time.monotonic()
        x, distance_m = scene.body(now)
        tangents = STEP * (np.arange(SIDE) - (SIDE - 1) / 2)
        inside = np.abs(tangents[None, :] - x) < 0.1
        inside = inside & (np.abs(tangents[:, None]) < 0.3)
        z = np.where(inside, 1000 * distance_m, 5000) + self._random.normal(0, 3, inside.shape)
        self._number += 1
        axes = tangents[0], STEP, -tangents[0], -STEP
        server.send(bridge.DEPTH, struct.pack("<IIQI4f", SIDE, SIDE, round(1e6 * now), self._number,
                                              *axes) + z.astype("<u2").tobytes(), 1)
        return 0

    def close(self):
        pass


sys.exit(bridge.run(bridge.listen_address(sys.argv[-1]), Camera, "frames"))
