#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Serves the depth frames of an Orbbec Gemini 2 (or another camera that the Orbbec SDK supports) over the echofuse
bridge protocol, through the vendor's pyorbbecsdk. echofuse connects with
depth.address = "bridge:tcp://HOST:PORT"."""
import sys

import bridge
import camera
import vendor
from pack import np

EPILOG = """\
The SDK can stop delivering frames after about a day. The bridge therefore restarts the pipeline of the
SDK after 3 s without a frame. Pixel positions are those of a pinhole camera with the intrinsics that
the SDK reports. Lens distortion is not corrected; on start, the bridge prints the distortion in the
image corners."""


def parse_arguments(arguments):
    return camera.parse_arguments(arguments, __doc__, EPILOG, height=400, depth_modes=True)


class Camera(camera.Camera):
    """An open Orbbec camera that streams depth frames."""

    def __init__(self, sdk, options):
        super().__init__(options)
        self._sdk = sdk
        self._context = sdk.Context()  # the devices stay valid only while the context exists
        device = self._find()
        info = device.get_device_info()
        self._hello = {"model": info.get_name(), "serial": info.get_serial_number(),
                       "firmware": info.get_firmware_version()}
        self._device = device
        self._unmirror(device)
        self.configure()
        self._pipeline = sdk.Pipeline(device)
        self._config = sdk.Config()
        profile = self._profile()
        self._config.enable_stream(profile)
        self.start()
        try:
            self._read_lens(profile)
        except Exception:
            self.close()
            raise

    def start(self):
        self._pipeline.start(self._config)

    def stop(self):
        self._pipeline.stop()

    def _find(self):
        devices = self._context.query_devices()
        found = [devices.get_device_serial_number_by_index(i) for i in range(devices.get_count())]
        serial = bridge.choose(found, self._options.serial, "Orbbec camera")
        return devices.get_device_by_serial_number(serial)

    def _unmirror(self, device):
        mirror = self._sdk.OBPropertyID.OB_PROP_DEPTH_MIRROR_BOOL
        if device.is_property_supported(mirror, self._sdk.OBPermissionType.PERMISSION_WRITE):
            device.set_bool_property(mirror, False)

    def set_depth_mode(self, name):
        device = self._device
        modes = device.get_depth_work_mode_list()
        found = [modes.get_depth_work_mode_by_index(i) for i in range(modes.get_count())]
        name = camera.known_name("depth mode", name, [mode.name for mode in found])
        device.set_depth_work_mode(next(mode for mode in found if mode.name == name))
        return name

    def set_preset(self, name):
        device = self._device
        presets = device.get_available_preset_list()
        names = [presets.get_name_by_index(i) for i in range(presets.get_count())]
        name = camera.known_name("preset", name, names)
        device.load_preset(name)
        return name

    def projector_off(self):
        device, ids = self._device, self._sdk.OBPropertyID
        write = self._sdk.OBPermissionType.PERMISSION_WRITE
        for switch, set_to, off in ((ids.OB_PROP_LASER_CONTROL_INT, device.set_int_property, 0),
                                    (ids.OB_PROP_LASER_BOOL, device.set_bool_property, False)):
            if device.is_property_supported(switch, write):
                set_to(switch, off)
                return True
        return False

    def _profile(self):
        o = self._options
        profiles = self._pipeline.get_stream_profile_list(self._sdk.OBSensorType.DEPTH_SENSOR)
        try:
            return profiles.get_video_stream_profile(o.width, o.height, self._sdk.OBFormat.Y16, o.fps)
        except Exception as error:
            raise RuntimeError(f"the camera has no depth mode with {o.width} x {o.height} pixels at {o.fps} frames/s: {error}") from None

    def _read_lens(self, profile):
        """Reads the intrinsics from the profile, because Pipeline.get_camera_param() returns zeros in version 2
        without a colour stream (orbbec/pyorbbecsdk, issues 56 and 103)."""
        if not hasattr(profile, "get_intrinsic"):
            raise RuntimeError("this version of pyorbbecsdk does not provide the intrinsics of a stream; install "
                               "version 2 (package pyorbbecsdk2)")
        try:
            lens, distortion = profile.get_intrinsic(), profile.get_distortion()
        except Exception as error:
            raise RuntimeError(f"cannot read the intrinsics of the depth mode: {error}") from None
        self.began(lens)
        bridge.say(f"the lens distortion of up to {distortion_px(lens, distortion):.2f} pixels is not corrected")

    def hello(self):
        return self._hello

    def wait(self, timeout_ms):
        frames = self._pipeline.wait_for_frames(timeout_ms)
        frame = frames.get_depth_frame() if frames is not None else None
        return frame and camera.Frame(frame.get_index(), frame.get_timestamp_us(), frame.get_width(), frame.get_height(),
                                      np.frombuffer(frame.get_data(), "<u2"), frame.get_depth_scale())


def distortion_px(lens, d):
    """Returns the largest displacement of an image corner in pixels, computed with Brown's distortion model."""
    u, v = np.meshgrid([0, lens.width - 1], [0, lens.height - 1])
    x, y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    r2 = x * x + y * y
    radial = (1 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3))) / (1 + r2 * (d.k4 + r2 * (d.k5 + r2 * d.k6)))
    dx = x * (radial - 1) + 2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x)
    dy = y * (radial - 1) + d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y
    return float(np.hypot(dx * lens.fx, dy * lens.fy).max())


def main():
    vendor.use_python()
    options = parse_arguments(sys.argv[1:])
    bridge.require_packages()
    sdk = vendor.library(["pyorbbecsdk"], "pyorbbecsdk2")
    vendor.check_version("pyorbbecsdk2", vendor.version_of_package("pyorbbecsdk2"), "2.0.18")
    return bridge.run(options.listen, lambda: Camera(sdk, options), "frames")


if __name__ == "__main__":
    sys.exit(main())
