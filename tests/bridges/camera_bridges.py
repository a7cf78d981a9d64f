#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests scripts/bridges/orbbec.py and realsense.py with stand-ins for the vendors' SDKs."""
import os
import struct
import types
import unittest
from unittest import mock

import testing
from testing import Client, Outlet, Program, golden, messages, np
import bridge
import camera as shared
import orbbec
import pyorbbecsdk
import pyrealsense2
import realsense
import recorder

# Bridge, SDK and image height of each vendor. The depth images are 64 pixels wide.
ORBBEC, REALSENSE = (orbbec, pyorbbecsdk, 64), (realsense, pyrealsense2, 48)
STARTS = {ORBBEC: [("get_stream_profile_list", "depth"), ("enable_stream", 64, 64, "y16", 30), ("start",)],
          REALSENSE: [("query_devices",), ("enable_device", "STAND-IN-3"), ("enable_stream", "depth", 64, 48, "z16", 30),
                      ("start",)]}


def size(height):
    return "--width", "64", "--height", str(height), "--fps", "30"


def open_camera(vendor, *arguments, **env):
    """Opens a camera with these STAND_IN_ settings. Returns the camera and its messages."""
    recorder.reset()
    module, sdk, height = vendor
    with messages() as said, mock.patch.dict(os.environ, {f"STAND_IN_{name}": value for name, value in env.items()}):
        camera = module.Camera(sdk, module.parse_arguments([*size(height), *arguments]))
    return camera, said.getvalue()


def poll(camera, frames):
    """Polls a camera that provides these frames. Returns the outlet and the messages."""
    outlet = Outlet()
    with messages() as said, mock.patch.object(camera, "wait", side_effect=frames):
        for _ in frames:
            assert camera.poll(outlet) == 0
    return outlet, said.getvalue()


class Settings(unittest.TestCase):
    def test_settings_are_sent_before_the_camera_starts(self):
        found, second = ([("query_devices",), ("get_device_by_serial_number", f"STAND-IN-{k}")] for k in (2, 4))
        mirror, start = ("set_bool_property", "mirror", False), STARTS[ORBBEC]
        chosen = ["--no-projector", "--preset", "high accuracy"]
        for vendor, words, env, calls, said in (
                (ORBBEC, [], {}, [*found, mirror, *start], ""),
                (ORBBEC, ["--serial", "STAND-IN-4"], {"CAMERAS": "2", "LACKS": "mirror"}, [*second, *start], ""),
                (ORBBEC, ["--no-projector"], {}, [*found, mirror, ("set_int_property", "laser control", 0), *start],
                 "projector off\n"),
                (ORBBEC, [*chosen, "--depth-mode", "binned sparse default"], {"LACKS": "laser control"},
                 [*found, mirror, ("set_depth_work_mode", "Binned Sparse Default"), ("load_preset", "High Accuracy"),
                  ("set_bool_property", "laser", False), *start],
                 'depth mode "Binned Sparse Default", preset "High Accuracy", projector off\n'),
                (REALSENSE, ["--serial", "STAND-IN-3"], {}, STARTS[REALSENSE], ""),
                (REALSENSE, chosen, {}, [*STARTS[REALSENSE], ("set_option", "preset", 3), ("set_option", "laser", 0)],
                 'preset "High Accuracy", projector off\n')):
            with self.subTest(words, env=env):
                camera, text = open_camera(vendor, *words, **env)
                camera.close()
                self.assertEqual(recorder.calls, [*calls, ("stop",)])
                self.assertTrue(said in text if said else "projector" not in text, text)

    def test_camera_that_cannot_be_used_is_refused_with_the_reason(self):
        no_lens = "the SDK has no valid intrinsics for the depth mode of 64 x "
        for vendor, words, env, why in (
                (ORBBEC, [], {"CAMERAS": "0"}, "no Orbbec camera is connected"),
                (ORBBEC, [], {"CAMERAS": "2"}, "choose one with --serial: STAND-IN-2, STAND-IN-4"),
                (ORBBEC, ["--preset", "x"], {}, 'no preset "x"; this camera has "Default", "High Accuracy"'),
                (ORBBEC, ["--depth-mode", "x"], {}, 'no depth mode "x"; this camera has "Unbinned Dense Default", '),
                (ORBBEC, ["--preset", "Default"], {"LACKS": "preset"}, "this camera has none"),
                (ORBBEC, ["--no-projector"], {"LACKS": "laser,laser control"}, "cannot switch off its projector"),
                (ORBBEC, ["--height", "48"], {}, "no depth mode with 64 x 48 pixels at 30 frames/s: Invalid input"),
                (ORBBEC, [], {"INTRINSICS": "wide"}, "the intrinsics are for 128 x 64 pixels; expected 64 x 64 pixels"),
                (ORBBEC, [], {"INTRINSICS": "zero"}, f"{no_lens}64 pixels: fx 0, fy 0"),
                (ORBBEC, [], {"INTRINSICS": "nan"}, no_lens), (ORBBEC, [], {"INTRINSICS": "none"}, "install version 2"),
                (ORBBEC, [], {"INTRINSICS": "fails"}, "depth mode: Can not find matched camera param!"),
                (REALSENSE, [], {"CAMERAS": "0"}, "no RealSense camera is connected"),
                (REALSENSE, ["--serial", "1"], {}, "no RealSense camera with the serial number 1; attached: STAND-IN-3"),
                (REALSENSE, ["--width", "65"], {}, "no depth mode with 65 x 48 pixels at 30 frames/s: Couldn't resolve"),
                (REALSENSE, ["--preset", "x"], {}, 'no preset "x"; this camera has "Custom", "Default", "Hand", '),
                (REALSENSE, ["--preset", "x"], {"LACKS": "preset"}, "this camera has none"),
                (REALSENSE, ["--no-projector"], {"LACKS": "laser"}, "cannot switch off its projector"),
                (REALSENSE, [], {"INTRINSICS": "zero"}, no_lens)):
            with self.subTest(why), self.assertRaises(RuntimeError) as refused:
                open_camera(vendor, *words, **env)
            self.assertIn(why, str(refused.exception))
            started = ("start",) in recorder.calls and "no depth mode with" not in why
            self.assertEqual(recorder.calls[-1] == ("stop",), started, why)

    def test_lens_distortion_is_reported(self):
        # Shift of a corner in x and y: 0.1 * r^2 * x * 50 pixels, with x = y = 0.63 and r^2 = 0.7938.
        every = dict(k1=0.1, k2=0.2, k3=-0.05, k4=0.02, k5=0.03, k6=0.04, p1=0.01, p2=-0.02)
        for vendor, lens, words in ((ORBBEC, mock.patch.object(pyorbbecsdk.distortion, "k1", 0.1), "up to 3.54 pixel"),
                                    (ORBBEC, mock.patch.multiple(pyorbbecsdk.distortion, **every), "up to 7.84 pixel"),
                                    (REALSENSE, mock.patch.object(pyrealsense2, "coeffs", [0, 0.5]), "coefficients 0, 0.5\n")):
            self.assertNotIn(words, open_camera(vendor)[1])
            with lens:
                self.assertIn(words, open_camera(vendor)[1])

    def test_hello_block_describes_the_camera(self):
        for vendor, hello in ((ORBBEC, ("Orbbec Gemini 2", "STAND-IN-2", "1.4.98")),
                              (REALSENSE, ("Intel RealSense D435", "STAND-IN-3", "5.16.0.1"))):
            self.assertEqual(open_camera(vendor)[0].hello(), dict(zip(("model", "serial", "firmware"), hello)))

    def test_invalid_command_line_arguments_are_refused(self):
        for bad in (["--width", "0"], ["--fps", "x"], ["--listen", "nowhere"]):
            with self.subTest(bad), messages(), self.assertRaises(SystemExit) as ended:
                orbbec.parse_arguments(bad)
            self.assertEqual(ended.exception.code, 2)


class Frames(unittest.TestCase):
    good = shared.Frame(1, 0, 64, 64, np.zeros(4096, "<u2"), 1.0)

    def test_depth_block_payload_equals_the_golden_file(self):
        camera = open_camera(ORBBEC)[0]
        camera._options.width, camera._options.height = 3, 2
        camera.began(types.SimpleNamespace(width=3, height=2, fx=2, fy=2, cx=1, cy=0.5))
        frame = shared.Frame(42, 123_456_789_012, 3, 2, np.array([0, 1000, 2000, 3000, 4000, 65535], "<u2"), 1.0)
        self.assertEqual(camera._payload(frame), golden()[2][32:])

    def test_depth_in_camera_units_is_converted_to_millimetres(self):
        for vendor, scale, scale_mm in ((ORBBEC, "0.5", 0.5), (ORBBEC, "20", 20.0), (REALSENSE, "0.001", 1.0),
                                        (REALSENSE, "0.0001", 0.1)):
            camera, outlet = open_camera(vendor)[0], Outlet()
            with mock.patch.dict(os.environ, STAND_IN_SCALE=scale):
                camera.poll(outlet)
            exact = np.rint(recorder.values(1, 64 * vendor[2]) * scale_mm)
            z_mm = np.frombuffer(outlet.blocks[0][1][36:], "<u2")
            np.testing.assert_array_equal(z_mm, np.where(exact > 65535, 0, exact))  # larger depths do not fit into 16 bits
            self.assertEqual((exact > 65535).any(), scale_mm == 20)
        longest = self.good._replace(steps=np.array([13107, 13108], "<u2"), mm_per_step=5.0)
        self.assertEqual(camera._payload(longest)[36:], b"\xff\xff\0\0")

    def test_missing_frame_numbers_are_counted_as_lost_frames(self):
        most = shared.MAX_LOST
        for numbers, lost in (([5, 6, 10], 3), ([5, 6 + most], most), ([5, 7 + most], 1), ([5, 4, 5], 0),
                              ([(1 << 32) - 1, 1 << 32], 0)):
            outlet, _ = poll(open_camera(ORBBEC)[0], [self.good._replace(index=number) for number in numbers])
            self.assertEqual(outlet.lost, lost, numbers)
            sent = [struct.unpack_from("<I", payload, 16)[0] for _, payload, _ in outlet.blocks]
            self.assertEqual(sent, [number % (1 << 32) for number in numbers])

    def test_invalid_depth_frame_is_skipped_and_reported_once(self):
        for why, fields in (("size 64 x 32 pixels and 4096 bytes", dict(height=32, steps=np.zeros(2048, "<u2"))),
                            ("size 64 x 64 pixels and 10 bytes", dict(steps=np.zeros(5, "<u2"))),
                            *((f"time (us) {us:g}", dict(time_us=us)) for us in (-1, float("nan"), float("inf"), 1e20)),
                            ("number -2", dict(index=-2)), ("step (mm) nan", dict(mm_per_step=float("nan")))):
            bad = [self.good._replace(**{"index": 1 + n} | fields) for n in range(2)]
            outlet, said = poll(open_camera(ORBBEC)[0], [self.good._replace(index=0), *bad, self.good._replace(index=3)])
            self.assertEqual((outlet.lost, len(outlet.blocks), said.count("\n")), (2, 2, 1), why)
            self.assertIn(f"dropping frames with {why}\n", said)

    def test_silent_camera_causes_a_restart_of_the_pipeline_and_then_of_the_device(self):
        camera, outlet = open_camera(ORBBEC)[0], Outlet()
        camera.poll(outlet)
        with mock.patch.object(shared, "NO_DATA_S", 0.1), messages():
            for fails in False, True:
                with mock.patch.object(camera, "wait", return_value=None):
                    restarts = recorder.calls.count(("start",))
                    while recorder.calls.count(("start",)) == restarts:
                        camera.poll(outlet)
                    self.assertEqual(recorder.calls[-2:], [("stop",), ("start",)])
                    if fails:
                        with self.assertRaisesRegex(RuntimeError, "after a restart"):
                            while True:
                                camera.poll(outlet)
                camera.poll(outlet)  # the frame numbers restart at 1, but no frame is lost
        self.assertEqual((outlet.lost, len(outlet.blocks)), (2, 3))


class Process(unittest.TestCase):
    def test_bridge_program_sends_depth_frames_until_it_is_stopped(self):
        for script, height, axes in ("orbbec.py", 64, [-31.5, 1, 31.5, -1]), ("realsense.py", 48, [-31.5, 1, 23.5, -1]):
            with Program(script, *size(height)) as program, Client(program.address) as client:
                for _ in range(3):
                    payload = client.until(bridge.DEPTH)[-1].payload
                    *shape, time_us, index = struct.unpack_from("<IIQI", payload)
                    self.assertEqual((shape, time_us), ([64, height], 1_000_000 + 66_667 * index))
                    np.testing.assert_allclose(np.frombuffer(payload[20:36], "<f4"), np.array(axes) / 50, rtol=1e-6)
                    self.assertEqual(payload[36:], recorder.values(index, 64 * height).tobytes())
                self.assertEqual(program.stop(), 0)
                client.until(bridge.BYE)
                self.assertEqual(program.calls()[-1], ("stop",))

    def test_bridge_program_ends_with_one_line_if_the_camera_cannot_be_used(self):
        self.assertEqual(testing.ended("orbbec.py", STAND_IN_CAMERAS="0"), "orbbec: no Orbbec camera is connected\n")

    def test_silent_or_unplugged_camera_is_restarted_with_its_settings(self):
        with Program("realsense.py", *size(48), "--no-projector", STAND_IN_SILENT="5",
                     STAND_IN_FAULTS="try_wait_for_frames:180,query_devices:2") as program:
            with Client(program.address) as client:
                blocks = client.until(bridge.BYE)
            self.assertIn("no frame has arrived for 3 s; restarting the stream", program.said())
            self.assertEqual(sum(b.dropped for b in blocks), 1)
            testing.wait_for("camera", lambda: program.calls().count(("set_option", "laser", 0)) == 3)
            self.assertEqual((program.stop(), program.calls().count(("start",))), (0, 3))


testing.main()
