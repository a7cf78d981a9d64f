#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Serves the depth frames of an Orbbec Gemini 2 (or another camera of its SDK) over the echofuse
bridge protocol, through the vendor's pyorbbecsdk. echofuse connects with
depth.address = "bridge:tcp://HOST:PORT"."""
import argparse
import struct
import sys
import time

import bridge
from pack import np

WAIT_MS = 100    # also how long a signal waits
SILENCE_S = 3.0  # then the pipeline is restarted, and at the second time the device opened again

EPILOG = """\
The SDK is known to stop delivering after about a day of streaming until its pipeline is restarted;
this happens here after 3 s without a frame. Pixel positions are those of a pinhole camera with the
SDK's intrinsics; lens distortion is not corrected, its size in the corners is printed at the start."""


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(description=__doc__, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    add, number = parser.add_argument, bridge.number
    add("--listen", metavar="HOST:PORT", type=bridge.listen_address, default=("127.0.0.1", 41111),
        help="where echofuse connects (127.0.0.1:41111); there is no password: keep it in the laboratory")
    add("--serial", default="", help="of the camera; without it, the first one")
    add("--width", type=number(int, 1, 4096), default=640, help="of the depth image (640)")
    add("--height", type=number(int, 1, 2048), default=400, help="(400)")
    add("--fps", type=number(int, 1, 120), default=15, help="frames a second (15)")
    return parser.parse_args(arguments)


class Camera:
    """An open camera that streams depth."""

    def __init__(self, sdk, options):
        self._sdk, self._options = sdk, options
        self._context = sdk.Context()  # the devices live in it
        device = self._find()
        info = device.get_device_info()
        self._hello = {"model": info.get_name(), "serial": info.get_serial_number(),
                       "firmware": info.get_firmware_version()}
        self._unmirror(device)
        self._pipeline = sdk.Pipeline(device)
        self._config = sdk.Config()
        profile = self._profile()
        self._config.enable_stream(profile)
        self._pipeline.start(self._config)
        try:
            self._axes = self._read_axes(profile)
        except Exception:
            self.close()
            raise
        self._restarted = False
        self._last_index = None
        self._last_frame_s = time.monotonic()

    def _find(self):
        devices = self._context.query_devices()
        if devices.get_count() == 0:
            raise RuntimeError("no Orbbec camera is connected")
        if self._options.serial:
            return devices.get_device_by_serial_number(self._options.serial)
        return devices.get_device_by_index(0)

    def _unmirror(self, device):
        mirror = self._sdk.OBPropertyID.OB_PROP_DEPTH_MIRROR_BOOL
        if device.is_property_supported(mirror, self._sdk.OBPermissionType.PERMISSION_WRITE):
            device.set_bool_property(mirror, False)

    def _profile(self):
        o = self._options
        profiles = self._pipeline.get_stream_profile_list(self._sdk.OBSensorType.DEPTH_SENSOR)
        try:
            return profiles.get_video_stream_profile(o.width, o.height, self._sdk.OBFormat.Y16, o.fps)
        except Exception as error:
            raise RuntimeError(f"no depth mode {o.width} x {o.height} at {o.fps} frames/s: {error}") from None

    def _read_axes(self, profile):
        """Tangents: columns to the right, rows upwards, of the pixel centres. From the profile:
        Pipeline.get_camera_param() is all zeros in releases of version 2 unless colour runs as well
        (orbbec/pyorbbecsdk, issues 56 and 103)."""
        if not hasattr(profile, "get_intrinsic"):
            raise RuntimeError("this pyorbbecsdk does not tell the intrinsics of a stream: version 2 is needed")
        try:
            lens, distortion = profile.get_intrinsic(), profile.get_distortion()
        except Exception as error:
            raise RuntimeError(f"the camera does not tell the intrinsics of its depth mode: {error}") from None
        size, asked = (lens.width, lens.height), (self._options.width, self._options.height)
        mode = f"{asked[0]} x {asked[1]} pixels"
        if not (lens.fx > 0 and lens.fy > 0 and np.isfinite([lens.fx, lens.fy, lens.cx, lens.cy]).all()):
            raise RuntimeError(f"the SDK tells no intrinsics of the depth mode of {mode}: fx {lens.fx:g}, fy {lens.fy:g}; "
                               "without them no pixel has a direction; choose another --width and --height, or update "
                               "pyorbbecsdk and the camera's firmware")
        if size != asked:
            raise RuntimeError(f"the intrinsics are those of {size[0]} x {size[1]} pixels, not {mode}")
        bridge.say(f"lens distortion, not corrected: up to {distortion_px(lens, distortion):.2f} pixel")
        return -lens.cx / lens.fx, 1 / lens.fx, lens.cy / lens.fy, -1 / lens.fy

    def hello(self):
        return self._hello

    def poll(self, server):
        frames = self._pipeline.wait_for_frames(WAIT_MS)
        frame = frames.get_depth_frame() if frames is not None else None
        if frame is None:
            self._watch(server)
            return 0
        self._last_frame_s = time.monotonic()
        self._restarted = False
        self._count_missing(frame.get_index(), server)
        server.send(bridge.DEPTH, self._payload(frame), 1)
        return 0

    def _watch(self, server):
        if time.monotonic() - self._last_frame_s < SILENCE_S:
            return
        if self._restarted:
            raise RuntimeError("no frames in spite of a restart")
        bridge.say(f"no frame for {SILENCE_S:g} s: restarting the pipeline")
        self._pipeline.stop()
        self._pipeline.start(self._config)
        server.lose(1)  # at least; its frame numbers start again
        self._restarted = True
        self._last_index = None
        self._last_frame_s = time.monotonic()

    def _count_missing(self, index, server):
        if self._last_index is not None and index > self._last_index + 1:
            server.lose(index - self._last_index - 1)
        self._last_index = index

    def _payload(self, frame):
        width, height, data = frame.get_width(), frame.get_height(), frame.get_data()
        if (width, height) != (self._options.width, self._options.height) or data.nbytes != 2 * width * height:
            raise RuntimeError(f"a frame of {width} x {height} pixels and {data.nbytes} bytes is not what was asked for")
        z_mm = np.frombuffer(data, "<u2")
        scale = frame.get_depth_scale()  # millimetres per step
        if scale != 1:
            exact = np.rint(z_mm * float(scale))
            z_mm = np.where(exact <= 65535, exact, 0).astype("<u2")
        head = struct.pack("<IIQI4f", width, height, frame.get_timestamp_us(), frame.get_index() & 0xFFFFFFFF,
                           *self._axes)
        return head + z_mm.tobytes()

    def close(self):
        self._pipeline.stop()


def distortion_px(lens, d):
    """How far Brown's model moves the corner that it moves farthest, in pixels."""
    u, v = np.meshgrid([0, lens.width - 1], [0, lens.height - 1])
    x, y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    r2 = x * x + y * y
    radial = (1 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3))) / (1 + r2 * (d.k4 + r2 * (d.k5 + r2 * d.k6)))
    dx = x * (radial - 1) + 2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x)
    dy = y * (radial - 1) + d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y
    return float(np.hypot(dx * lens.fx, dy * lens.fy).max())


def main():
    options = parse_arguments(sys.argv[1:])
    bridge.require_packages()
    try:
        import pyorbbecsdk
    except ImportError as error:
        bridge.fail(f"{error}; install Orbbec's pyorbbecsdk (version 2) for this Python")
    return bridge.run(options.listen, lambda: Camera(pyorbbecsdk, options), "frames")


if __name__ == "__main__":
    sys.exit(main())
