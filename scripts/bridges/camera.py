# SPDX-License-Identifier: MIT
"""Code shared by the bridges for depth cameras: arguments, frame payload, counting of missing
frames, and restarting a stream that has stopped."""
import collections
import struct
import time

import bridge
from pack import np

WAIT_MS = 100    # longest wait for a frame; it may delay the handling of a signal
NO_DATA_S = 3.0  # restart the stream after this time without a frame; if it stays silent, reopen the device

MAX_LOST = 1 << 20  # larger jumps of the frame number are not counted as lost frames

# A frame from the SDK: frame number, device time in us, image size, and depths as unsigned 16-bit multiples of
# mm_per_step.
Frame = collections.namedtuple("Frame", "index time_us width height steps mm_per_step")
# Intrinsics of an image of this size: focal lengths fx, fy and principal point cx, cy, in pixels.
Lens = collections.namedtuple("Lens", "width height fx fy cx cy")


def parse_arguments(arguments, text, epilog, height, depth_modes=False):
    parser = bridge.parser(text, epilog)
    add, number = parser.add_argument, bridge.number
    add("--listen", metavar="HOST:PORT", type=bridge.listen_address, default=("127.0.0.1", 41111),
        help="address to which echofuse connects (default: 127.0.0.1:41111); use only trusted networks, because a "
             "client needs no password")
    add("--serial", default="", help="serial number of the camera, if several are attached")
    add("--width", type=number(int, 1, 4096), default=640, help="width of the depth image, pixels (default: 640)")
    add("--height", type=number(int, 1, 2048), default=height,
        help=f"height of the depth image, pixels (default: {height})")
    add("--fps", type=number(int, 1, 120), default=15, help="number of frames per second (default: 15)")
    add("--no-projector", action="store_true",
        help="switch off the infrared projector, because silicon detectors detect its light (850 nm)")
    add("--preset", metavar="NAME", help="preset of the SDK, e.g. \"High Accuracy\"; an unknown name prints a list of all presets")
    if depth_modes:
        add("--depth-mode", metavar="NAME",
            help="depth mode, e.g. \"Unbinned Dense Default\"; an unknown name prints a list of all depth modes")
    return parser.parse_args(arguments)


def known_name(kind, requested, names):
    """Returns the name in the camera's list that equals `requested` except for case."""
    for name in names:
        if name.casefold() == requested.casefold():
            return name
    raise RuntimeError(f"no {kind} \"{requested}\"; this camera has "
                       + (", ".join(f'"{name}"' for name in names) or "none"))


class Camera:
    """An open camera. A vendor's class implements start(), which starts the stream and calls began(lens);
    wait(), which returns the next Frame or None; stop(); set_preset(name) and set_depth_mode(name), which
    return the camera's name; projector_off(), which returns False if the camera cannot switch it."""

    def __init__(self, options):
        self._options = options
        self._restarted, self._last_index, self._last_frame_s = False, None, time.monotonic()
        # kinds of fault already printed, and number of bad frames since the last good frame
        self._reported, self._odd = set(), 0

    def began(self, lens):
        """Computes the tangents of the pixel centres; they increase to the right and upwards."""
        size, requested = (lens.width, lens.height), (self._options.width, self._options.height)
        mode = f"{requested[0]} x {requested[1]} pixels"
        if not (lens.fx > 0 and lens.fy > 0 and np.isfinite([lens.fx, lens.fy, lens.cx, lens.cy]).all()):
            raise RuntimeError(f"the SDK has no valid intrinsics for the depth mode of {mode}: fx {lens.fx:g}, fy "
                               f"{lens.fy:g}; without intrinsics, the directions of the pixels are unknown; choose "
                               "another --width and --height, or update the SDK and the camera's firmware")
        if size != requested:
            raise RuntimeError(f"the intrinsics are for {size[0]} x {size[1]} pixels; expected {mode}")
        self._axes = -lens.cx / lens.fx, 1 / lens.fx, lens.cy / lens.fy, -1 / lens.fy

    def configure(self):
        """Applies the given options and prints the settings; all other camera settings stay unchanged."""
        options, done = self._options, []
        for kind in ("depth mode", "preset"):
            key = kind.replace(" ", "_")
            if (requested := getattr(options, key, None)) is not None:
                done.append(f'{kind} "{getattr(self, "set_" + key)(requested)}"')
        if options.no_projector:
            if not self.projector_off():
                raise RuntimeError("this camera cannot switch off its projector")
            done.append("projector off")
        if done:
            bridge.say(", ".join(done))

    def poll(self, server):
        frame = self.wait(WAIT_MS)
        fault = frame and self._fault(frame)
        if fault:  # a bad frame counts as not received
            server.lose(1)
            self._odd += 1
            if fault[0] not in self._reported:
                self._reported.add(fault[0])
                bridge.say(f"dropping frames with {fault[0]} {fault[1]}")
        if fault or frame is None:
            self._watch(server)
            return 0
        self._last_frame_s = time.monotonic()
        self._restarted = False
        ahead = 0 if self._last_index is None else frame.index - self._last_index - 1 - self._odd
        if ahead > 0:
            server.lose(ahead if ahead <= MAX_LOST else 1)
        self._last_index, self._odd = frame.index, 0
        server.send(bridge.DEPTH, self._payload(frame), 1)
        return 0

    def _fault(self, frame):
        """Returns the name and value of the frame's first invalid property, or None if all
        properties are valid. The comparisons are written so that NaN counts as invalid."""
        size, requested = (frame.width, frame.height), (self._options.width, self._options.height)
        if size != requested or frame.steps.nbytes != 2 * size[0] * size[1]:
            return "size", f"{size[0]} x {size[1]} pixels and {frame.steps.nbytes} bytes"
        for name, value, minimum in (("number", frame.index, 0), ("time (us)", frame.time_us, 0), ("step (mm)", frame.mm_per_step, 1e-6)):
            if not minimum <= value < 1 << 64:
                return name, f"{value:g}"
        return None

    def _watch(self, server):
        if time.monotonic() - self._last_frame_s < NO_DATA_S:
            return
        if self._restarted:
            raise RuntimeError("no frames arrived after a restart of the stream")
        bridge.say(f"no frame has arrived for {NO_DATA_S:g} s; restarting the stream")
        self.stop()
        self.start()
        server.lose(1)  # a restart loses at least one frame; the true number is unknown because frame numbers restart
        self._restarted, self._last_index, self._last_frame_s, self._odd = True, None, time.monotonic(), 0

    def _payload(self, frame):
        z_mm = frame.steps
        if frame.mm_per_step != 1:
            exact = np.rint(z_mm * float(frame.mm_per_step))
            z_mm = np.where(exact <= 65535, exact, 0).astype("<u2")
        return struct.pack("<IIQI4f", frame.width, frame.height, round(frame.time_us), frame.index & 0xFFFFFFFF, *self._axes) + z_mm.tobytes()

    def close(self):
        self.stop()
