#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Serves the depth frames of a RealSense camera over the echofuse bridge protocol, through the vendor's
pyrealsense2. echofuse connects with depth.address = "bridge:tcp://HOST:PORT"."""
import sys

import bridge
import camera
import vendor
from pack import np

EPILOG = """\
The bridge restarts the stream after 3 s without a frame. Pixel positions are those of a pinhole camera
with the intrinsics that the SDK reports. The depth image of a D400 camera is rectified, so that it has
no lens distortion. On USB 2, a camera has fewer depth modes; try --fps 6."""


def parse_arguments(arguments):
    return camera.parse_arguments(arguments, __doc__, EPILOG, height=480)


class Camera(camera.Camera):
    """An open RealSense camera that streams depth frames."""

    def __init__(self, sdk, options):
        super().__init__(options)
        self._sdk = sdk
        found = [device.get_info(sdk.camera_info.serial_number) for device in sdk.context().query_devices()]
        self._pipeline, self._config = sdk.pipeline(), sdk.config()
        self._config.enable_device(bridge.choose(found, options.serial, "RealSense camera"))
        self._config.enable_stream(sdk.stream.depth, options.width, options.height, sdk.format.z16, options.fps)
        self.start()

    def start(self):
        o, sdk = self._options, self._sdk
        try:
            profile = self._pipeline.start(self._config)
        except Exception as error:
            raise RuntimeError(f"the camera has no depth mode with {o.width} x {o.height} pixels at {o.fps} frames/s: {error}") from None
        try:
            device = profile.get_device()
            self._hello = {"model": device.get_info(sdk.camera_info.name),
                           "serial": device.get_info(sdk.camera_info.serial_number),
                           "firmware": device.get_info(sdk.camera_info.firmware_version)}
            self._sensor = device.first_depth_sensor()
            self.configure()
            lens = profile.get_stream(sdk.stream.depth).as_video_stream_profile().get_intrinsics()
            self.began(camera.Lens(lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy))
            if any(lens.coeffs):
                bridge.say("the depth image has lens distortion, which is not corrected: coefficients "
                           + ", ".join(f"{value:g}" for value in lens.coeffs))
        except Exception:
            self.stop()
            raise

    def stop(self):
        self._pipeline.stop()

    def set_preset(self, name):
        sensor, option = self._sensor, self._sdk.option.visual_preset
        values = range(int(sensor.get_option_range(option).max) + 1) if sensor.supports(option) else ()
        names = [sensor.get_option_value_description(option, value) for value in values]
        name = camera.known_name("preset", name, names)
        sensor.set_option(option, names.index(name))
        return name

    def projector_off(self):
        sensor, option = self._sensor, self._sdk.option.emitter_enabled
        if not sensor.supports(option):
            return False
        sensor.set_option(option, 0)
        return True

    def hello(self):
        return self._hello

    def wait(self, timeout_ms):
        received, frames = self._pipeline.try_wait_for_frames(timeout_ms)
        frame = frames.get_depth_frame() if received else None
        return camera.Frame(frame.get_frame_number(), 1000 * frame.get_timestamp(), frame.get_width(),
                            frame.get_height(), np.asarray(frame.get_data(), "<u2"),
                            round(1000 * frame.get_units(), 6)) if frame else None  # the SDK returns a float


def main():
    vendor.use_python()
    options = parse_arguments(sys.argv[1:])
    bridge.require_packages()
    sdk = vendor.library(["pyrealsense2"], "pyrealsense2")
    return bridge.run(options.listen, lambda: Camera(sdk, options), "frames")


if __name__ == "__main__":
    sys.exit(main())
