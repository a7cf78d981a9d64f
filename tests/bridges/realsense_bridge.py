#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests scripts/bridges/realsense.py with a stand-in for the vendor's SDK."""
import struct
import unittest

import testing
from testing import Client, Program, np

import bridge
import pyrealsense2 as sdk

SIZE = ("--width", "64", "--height", "48", "--fps", "30")


class Process(unittest.TestCase):
    def frame(self, *arguments, **env):
        with Program("realsense.py", *SIZE, *arguments, **env) as program, Client(program.address) as client:
            payload = client.until(bridge.DEPTH)[-1].payload
            self.assertEqual(program.stop(), 0)
            self.assertEqual(program.calls()[-1], ("stop",))
            self.calls = program.calls()
        return struct.unpack_from("<IIQI4f", payload), np.frombuffer(payload[36:], "<u2")

    def test_depth_frame_is_sent_with_its_time_and_axes(self):
        (width, height, time_us, index, *axes), z = self.frame("--serial", "STAND-IN-3")
        self.assertEqual((width, height, time_us), (64, 48, 1_000_000 + 66_667 * index))
        np.testing.assert_allclose(axes, [-31.5 / 50, 1 / 50, 23.5 / 50, -1 / 50], rtol=1e-6)
        np.testing.assert_array_equal(z, sdk.values(index, 64 * 48))
        self.assertEqual(self.calls[:4], [("query_devices",), ("enable_device", "STAND-IN-3"),
                                          ("enable_stream", "depth", 64, 48, "z16", 30), ("start",)])

    def test_projector_state_and_preset_are_sent_to_the_camera(self):
        with Program("realsense.py", *SIZE, "--no-projector", "--preset", "high accuracy", STAND_IN_SILENT="5") as program:
            with Client(program.address) as client:
                client.until(bridge.DEPTH)
                # The bridge sends the settings again after it restarts the stream.
                testing.wait_for("restart", lambda: program.calls().count(("set_option", "emitter", 0)) == 2)
            self.assertEqual(program.calls().count(("set_option", "preset", 3)), 2)
            self.assertIn('preset "High Accuracy", projector off\n', program.said())
            self.assertEqual(program.stop(), 0)

    def test_depth_in_tenths_of_a_millimetre_is_converted_to_millimetres(self):
        head, z = self.frame(STAND_IN_SCALE="0.0001")
        np.testing.assert_array_equal(z, np.rint(sdk.values(head[3], 64 * 48) * 0.1))

    def test_invalid_depth_frame_is_skipped(self):
        with Program("realsense.py", *SIZE, STAND_IN_TIMES="150:-3,151:nan,153:inf,154:1e20", STAND_IN_FINER="156") as program:
            with Client(program.address) as client:
                seen, lost = {}, 0
                while 158 not in seen:
                    block = client.until(bridge.DEPTH)[-1]
                    index = struct.unpack_from("<IIQI", block.payload)[3]
                    lost += block.dropped
                    seen[index] = np.frombuffer(block.payload[36:], "<u2")
            self.assertEqual(set(range(149, 159)) - set(seen), {150, 151, 153, 154})
            self.assertEqual(lost, 4)
            for index, z in seen.items():
                z_mm = sdk.values(index, 64 * 48) * (0.1 if index >= 156 else 1)
                np.testing.assert_array_equal(z, np.rint(z_mm))
            self.assertEqual(program.said().count("dropping frames"), 1)
            self.assertEqual(program.stop(), 0)
            self.assertEqual(program.calls().count(("start",)), 1)

    def test_options_that_the_camera_does_not_support_are_reported(self):
        for words, env, why in (([], {"STAND_IN_CAMERAS": "0"}, "no RealSense camera is connected"),
                                (["--serial", "1"], {}, "no RealSense camera with the serial number 1; attached: STAND-IN-3"),
                                ([], {"STAND_IN_CAMERAS": "2"}, "choose one with --serial: STAND-IN-3, STAND-IN-3"),
                                (["--width", "65"], {}, "the camera has no depth mode with 65 x 48 pixels at 30 frames/s: Couldn't resolve"),
                                (["--preset", "x"], {}, 'no preset "x"; this camera has "Custom", "Default"'),
                                (["--preset", "x"], {"STAND_IN_LACKS": "preset"}, "this camera has none"),
                                (["--no-projector"], {"STAND_IN_LACKS": "emitter"}, "cannot switch off its projector"),
                                ([], {"STAND_IN_INTRINSICS": "zero"}, "the SDK has no valid intrinsics")):
            self.assertIn(why, testing.ended("realsense.py", *SIZE, *words, **env))

    def test_silent_or_unplugged_camera_is_restarted(self):
        with Program("realsense.py", *SIZE, STAND_IN_SILENT="5", STAND_IN_FAULTS="try_wait_for_frames:180,query_devices:2") as program:
            with Client(program.address) as client:
                blocks = client.until(bridge.BYE)
            self.assertIn("no frame has arrived for 3 s; restarting the stream", program.said())
            self.assertEqual(sum(b.dropped for b in blocks), 1)
            testing.wait_for("camera", lambda: program.calls().count(("start",)) == 3)
            self.assertEqual(program.stop(), 0)


testing.main()
