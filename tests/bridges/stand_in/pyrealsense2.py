# SPDX-License-Identifier: MIT
"""Stand-in for RealSense's Python SDK with the functions that the bridge calls.

Names and arguments are those in the SDK's bindings (IntelRealSense/librealsense, wrappers/python/pyrs_pipeline.cpp at
09696f9 and pyrs_frame.cpp at 005e21b, pyrs_device.cpp, pyrs_options.cpp). The depth unit STAND_IN_SCALE is in m. With
STAND_IN_SILENT=n, the camera sends no frame after the n-th until the stream is restarted. STAND_IN_INTRINSICS=zero sets the
intrinsics to zero. See recorder.py for other settings."""
import os
import time
import types

import numpy as np
from recorder import called, complete, constant, happen, lacks, setting, values

PUBLISHED = """
context: query_devices(0)
device: get_info(1) first_depth_sensor(0)
depth_sensor: supports(1) set_option(2) get_option_range(1) get_option_value_description(2)
config: enable_device(1) enable_stream(5)
pipeline: start(1) stop(0) try_wait_for_frames(1)
pipeline_profile: get_device(0) get_stream(2)
stream_profile: as_video_stream_profile(0)
video_stream_profile: get_intrinsics(0)
composite_frame: get_depth_frame(0)
depth_frame: get_frame_number(0) get_timestamp(0) get_units(0) get_width(0) get_height(0) get_data(0)"""

stream = types.SimpleNamespace(depth="depth")
format = types.SimpleNamespace(z16="z16")
camera_info = types.SimpleNamespace(name="name", serial_number="serial", firmware_version="firmware")
option = types.SimpleNamespace(emitter_enabled="laser", visual_preset="preset")
PRESETS = ["Custom", "Default", "Hand", "High Accuracy"]
WIDTH, HEIGHT = 64, 48
coeffs = [0.0] * 5


class video_stream_profile:
    def get_intrinsics(self):
        f = 0.0 if setting("INTRINSICS") == "zero" else 50.0
        return types.SimpleNamespace(width=WIDTH, height=HEIGHT, fx=f, fy=f, ppx=31.5, ppy=23.5, coeffs=coeffs)


class stream_profile:
    as_video_stream_profile = constant(video_stream_profile())


class depth_sensor:
    def supports(self, option):
        return not lacks(option)

    def get_option_range(self, option):
        return types.SimpleNamespace(min=0.0, max=len(PRESETS) - 1.0)

    def get_option_value_description(self, option, value):
        return PRESETS[int(value)]


class device:
    first_depth_sensor = constant(depth_sensor())

    def get_info(self, info):
        return {"name": "Intel RealSense D435", "serial": "STAND-IN-3", "firmware": "5.16.0.1"}[info]


class context:
    def query_devices(self):
        called("query_devices")
        return [device() for _ in range(int(setting("CAMERAS", 1)))]


class config:
    def enable_stream(self, stream_type, width, height, format, framerate):
        called("enable_stream", stream_type, width, height, format, framerate)
        self.size = width, height


class pipeline_profile:
    get_device = constant(device())

    def get_stream(self, stream_type, stream_index=-1):
        return stream_profile()


class pipeline:
    def start(self, config):
        called("start")
        if config.size != (WIDTH, HEIGHT):
            raise RuntimeError("Couldn't resolve requests")
        self._index = 0
        return pipeline_profile()

    def try_wait_for_frames(self, timeout_ms=5000):
        happen("try_wait_for_frames")
        time.sleep(0.02)
        if self._index == int(setting("SILENT", 0)) > 0:
            os.environ["STAND_IN_SILENT"] = "0"
            self._index = None
        if self._index is None:
            return False, None
        self._index += 1
        return True, composite_frame(self._index)


class composite_frame:
    def __init__(self, index):
        self._index = index

    def get_depth_frame(self):
        return depth_frame(self._index)


class depth_frame:
    get_width, get_height = constant(WIDTH), constant(HEIGHT)

    def __init__(self, index):
        self._index = index

    def get_frame_number(self):
        return self._index

    def get_timestamp(self):
        return 1000.0 + 66.667 * self._index

    def get_units(self):
        return float(np.float32(setting("SCALE", "0.001")))

    def get_data(self):
        return values(self._index, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH)


complete(globals(), PUBLISHED)
