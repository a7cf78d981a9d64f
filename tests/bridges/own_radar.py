#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Bridge with a simulated radar, written like a bridge for a user's own radar."""
import sys
import time

import scene

import bridge
from pack import np

STEP_M, FRAME_S = 0.1, 0.02


class Radar:
    def __init__(self):
        self._number = 0
        self._random = np.random.default_rng()

    def hello(self):
        return {"model": "Own radar", "serial": "R1", "firmware": "1"}

    def poll(self, server):
        time.sleep(FRAME_S)
        _, distance_m = scene.body(time.monotonic())
        range_m = STEP_M * np.arange(80)
        power = 1e4 * np.exp(-0.5 * ((range_m - distance_m) / 0.1) ** 2)
        power += 50 * self._random.exponential(size=80)
        self._number += 1
        server.send(bridge.RANGE_PROFILE, bridge.range_profile(power, 0, STEP_M, self._number), 1)
        return 0

    def close(self):
        pass


sys.exit(bridge.run(bridge.listen_address(sys.argv[-1]), Radar, "profiles"))
