#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""own_devices.py --listen ADDRESS radar|camera: a bridge with a simulated radar, written like a bridge for a user's own radar,
or with a simulated depth camera, which provides ground truth for runs with custom sensors. The scene is a walking person at
the distance simulated by scripts/bridges/example.py."""
import math
import struct
import sys
import time

import bridge
from pack import np

STEP_M, SIDE, STEP = 0.1, 64, 0.02


class Device:
    pause_s = 0.02

    def __init__(self):
        self._number = 0
        self._random = np.random.default_rng()

    def poll(self, server):
        time.sleep(self.pause_s)
        now = time.monotonic()
        self._number += 1
        self.send(server, now, 0.3 * math.sin(now / 0.7), 4.25 + 0.6 * math.sin(now))
        return 0

    def close(self):
        pass


class Radar(Device):
    def hello(self):
        return {"model": "Own radar", "serial": "R1", "firmware": "1"}

    def send(self, server, now, tangent, distance_m):
        power = 1e4 * np.exp(-0.5 * ((STEP_M * np.arange(80) - distance_m) / 0.1) ** 2) + 50 * self._random.exponential(size=80)
        server.send(bridge.RANGE_PROFILE, bridge.range_profile(power, 0, STEP_M, self._number), 1)


class Camera(Device):
    pause_s = 0.05

    def hello(self):
        return {"model": "Own camera", "serial": "C1", "firmware": "1"}

    def send(self, server, now, tangent, distance_m):
        tangents = STEP * (np.arange(SIDE) - (SIDE - 1) / 2)
        inside = (np.abs(tangents[None, :] - tangent) < 0.1) & (np.abs(tangents[:, None]) < 0.3)
        z = np.where(inside, 1000 * distance_m, 5000) + self._random.normal(0, 3, inside.shape)
        axes = tangents[0], STEP, -tangents[0], -STEP
        server.send(bridge.DEPTH, struct.pack("<IIQI4f", SIDE, SIDE, round(1e6 * now), self._number, *axes) + z.astype("<u2").tobytes(), 1)


device, items = (Radar, "profiles") if sys.argv[-1] == "radar" else (Camera, "frames")
sys.exit(bridge.run(bridge.listen_address(sys.argv[-2]), device, items))
