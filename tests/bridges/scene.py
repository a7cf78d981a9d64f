# SPDX-License-Identifier: MIT
"""Scene of own_radar.py and own_camera.py: a walking person at the distance simulated by scripts/bridges/example.py."""
import math


def body(time_s):
    """Returns the tangent of the angle to the person, and the distance to the person, m."""
    return 0.3 * math.sin(time_s / 0.7), 4.25 + 0.6 * math.sin(time_s)
