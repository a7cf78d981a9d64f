# SPDX-License-Identifier: MIT
"""Stand-in for RealSense's Python SDK with the functions that the bridge calls.

Pixel i of frame n has the value 500 + (7 n + 3 i) % 5000. Names and arguments are those in the SDK's bindings
(IntelRealSense/librealsense, wrappers/python/pyrs_pipeline.cpp at 09696f9 and pyrs_frame.cpp at 005e21b, pyrs_device.cpp,
pyrs_options.cpp); signatures.py compares them. Environment variables:
  STAND_IN_CAMERAS=n      number of cameras (default 1)
  STAND_IN_SCALE=x        depth unit, m (default .001)
  STAND_IN_FINER=n        from frame n on, the depth unit is a tenth of STAND_IN_SCALE
  STAND_IN_SILENT=n       the camera sends no frame after the n-th until the stream is restarted
  STAND_IN_INTRINSICS=zero  the intrinsics are zero
  STAND_IN_TIMES=n:ms,... times of these frames
  STAND_IN_LACKS=option,...  options that the camera does not support"""
import os
import time
import types

import numpy as np
from recorder import called, happen

stream = types.SimpleNamespace(depth="depth")
format = types.SimpleNamespace(z16="z16")
camera_info = types.SimpleNamespace(name="name", serial_number="serial", firmware_version="firmware")
option = types.SimpleNamespace(emitter_enabled="emitter", visual_preset="preset")
PRESETS = ["Custom", "Default", "Hand", "High Accuracy"]
WIDTH, HEIGHT = 64, 48


def values(index, pixels):
    return (500 + (7 * index + 3 * np.arange(pixels)) % 5000).astype("<u2")


class device:
    def get_info(self, info):
        return {"name": "Intel RealSense D435", "serial": "STAND-IN-3", "firmware": "5.16.0.1"}[info]

    def first_depth_sensor(self):
        return depth_sensor()


class depth_sensor:
    def supports(self, option):
        return option not in os.environ.get("STAND_IN_LACKS", "").split(",")

    def set_option(self, option, value):
        called("set_option", option, value)

    def get_option_range(self, option):
        return types.SimpleNamespace(min=0.0, max=len(PRESETS) - 1.0)

    def get_option_value_description(self, option, value):
        return PRESETS[int(value)]


class context:
    def query_devices(self):
        called("query_devices")
        return [device() for _ in range(int(os.environ.get("STAND_IN_CAMERAS", "1")))]


class config:
    def enable_device(self, serial):
        called("enable_device", serial)

    def enable_stream(self, stream_type, width, height, format, framerate):
        called("enable_stream", stream_type, width, height, format, framerate)
        self.size = width, height


class stream_profile:
    def as_video_stream_profile(self):
        return video_stream_profile()


class video_stream_profile:
    def get_intrinsics(self):
        f = 0.0 if os.environ.get("STAND_IN_INTRINSICS") == "zero" else 50.0
        return types.SimpleNamespace(width=WIDTH, height=HEIGHT, fx=f, fy=f, ppx=31.5, ppy=23.5, coeffs=[0.0] * 5)


class pipeline_profile:
    def get_device(self):
        return device()

    def get_stream(self, stream_type, stream_index=-1):
        return stream_profile()


class pipeline:
    def start(self, config):
        called("start")
        if config.size != (WIDTH, HEIGHT):
            raise RuntimeError("Couldn't resolve requests")
        self._index = 0
        return pipeline_profile()

    def stop(self):
        called("stop")

    def try_wait_for_frames(self, timeout_ms=5000):
        happen("try_wait_for_frames")
        time.sleep(0.02)
        if self._index == int(os.environ.get("STAND_IN_SILENT", "0")) > 0:
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
    def __init__(self, index):
        self._index = index

    def get_frame_number(self):
        return self._index

    def get_timestamp(self):
        odd = dict(item.split(":") for item in os.environ.get("STAND_IN_TIMES", "").split(",") if item)
        return float(odd.get(str(self._index), 1000.0 + 66.667 * self._index))

    def get_units(self):
        finer = self._index >= int(os.environ.get("STAND_IN_FINER", "1000000"))
        return float(np.float32(os.environ.get("STAND_IN_SCALE", "0.001"))) * (0.1 if finer else 1)

    def get_width(self):
        return WIDTH

    def get_height(self):
        return HEIGHT

    def get_data(self):
        return values(self._index, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH)
