#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests scripts/bridges/orbbec.py and realsense.py with stand-ins for the vendors' SDKs."""
import struct
import types
import unittest
from unittest import mock

import testing
from testing import Client, Outlet, Program, golden, messages, np
import bridge
import camera as shared
import orbbec
import pyorbbecsdk as sdk
import recorder
import pyrealsense2


SIZE = ("--width", "64", "--height", "64", "--fps", "30")


class CameraCase(unittest.TestCase):
    def setUp(self):
        recorder.reset()
        for name, value in {"silent": False, "skip": 0, "scale": 1.0}.items():
            patch = mock.patch.object(sdk, name, value)
            patch.start()
            self.addCleanup(patch.stop)
        self.outlet = Outlet()

    def open(self, *arguments):
        with messages() as said:
            camera = orbbec.Camera(sdk, orbbec.parse_arguments([*SIZE, *arguments]))
        self.said = said.getvalue()
        return camera


class Calls(CameraCase):
    def test_camera_is_opened_by_its_serial_number_and_closed(self):
        self.open("--serial", "STAND-IN-2").close()
        self.assertEqual(recorder.calls, [
            ("query_devices",), ("get_device_by_serial_number", "STAND-IN-2"), ("set_bool_property", "mirror", False),
            ("get_stream_profile_list", "depth"), ("enable_stream", 64, 64, "y16", 30), ("start",), ("stop",)])

    def test_first_camera_is_opened_if_no_serial_number_is_given(self):
        self.assertEqual(self.open().hello(), {"model": "Orbbec Gemini 2", "serial": "STAND-IN-2", "firmware": "1.4.98"})
        self.assertIn(("get_device_by_serial_number", "STAND-IN-2"), recorder.calls)

    def test_depth_mode_and_preset_and_projector_state_are_set_before_the_camera_starts(self):
        self.open().close()
        self.assertFalse({"load_preset", "set_depth_work_mode", "set_int_property"} & {call[0] for call in recorder.calls})
        self.assertNotIn("projector", self.said)
        recorder.reset()
        self.open("--no-projector", "--preset", "high accuracy", "--depth-mode", "binned sparse default")
        start = recorder.calls.index(("start",))
        for call in (("set_depth_work_mode", "Binned Sparse Default"), ("load_preset", "High Accuracy"),
                     ("set_bool_property", "laser", False)):
            self.assertLess(recorder.calls.index(call), start)
        self.assertIn('depth mode "Binned Sparse Default", preset "High Accuracy", projector off\n', self.said)

    def test_projector_is_switched_off_through_the_property_that_the_camera_supports(self):
        with mock.patch.object(sdk, "supported", {"laser", "laser control"}):
            self.open("--no-projector")
        self.assertIn(("set_int_property", "laser control", 0), recorder.calls)
        with mock.patch.object(sdk, "supported", set()):
            self.assertRaisesRegex(RuntimeError, "cannot switch off its projector", self.open, "--no-projector")

    def test_error_for_an_unknown_preset_or_depth_mode_lists_the_known_names(self):
        with self.assertRaisesRegex(RuntimeError, '^no preset "x"; this camera has "Default", "High Accuracy"$'):
            self.open("--preset", "x")
        with self.assertRaisesRegex(RuntimeError, '^no depth mode "x"; this camera has "Unbinned Dense Default", '):
            self.open("--depth-mode", "x")
        with mock.patch.object(sdk, "presets", []), self.assertRaisesRegex(RuntimeError, "has none$"):
            self.open("--preset", "Default")

    def test_image_size_that_the_camera_does_not_support_is_refused(self):
        with self.assertRaisesRegex(RuntimeError, "^the camera has no depth mode with 64 x 48 pixels at 30 frames/s: Invalid input"):
            self.open("--height", "48")

    def test_intrinsics_for_another_image_size_are_refused(self):
        lens = types.SimpleNamespace(**vars(sdk.camera) | {"width": 128})
        with mock.patch.object(sdk.VideoStreamProfile, "get_intrinsic", lambda self: lens):
            self.assertRaisesRegex(RuntimeError, "128 x 64", self.open)
        self.assertEqual(recorder.calls[-1], ("stop",))

    def test_missing_camera_intrinsics_are_refused(self):
        for fault, words in (("zero", "no valid intrinsics for the depth mode of 64 x 64 pixels: fx 0, fy 0"),
                             ("nan", "no valid intrinsics for the depth mode"), ("none", "install version 2")):
            with mock.patch.object(sdk, "intrinsics", fault):
                self.assertRaisesRegex(RuntimeError, words, self.open)
            self.assertEqual(recorder.calls[-1], ("stop",))
        fails = mock.Mock(side_effect=RuntimeError("Can not find matched camera param!"))
        with mock.patch.object(sdk.VideoStreamProfile, "get_intrinsic", fails):
            self.assertRaisesRegex(RuntimeError, "depth mode: Can not find matched camera param!$", self.open)

    def test_lens_distortion_is_reported_in_pixels(self):
        with mock.patch.object(sdk.distortion, "k1", 0.1):
            self.open()
        # Shift of a corner in x and y: 0.1 * r^2 * x * 50 pixels, with x = y = 0.63 and r^2 = 0.7938.
        self.assertIn("up to 3.54 pixel", self.said)

    def test_invalid_command_line_arguments_are_refused(self):
        for bad in (["--width", "0"], ["--fps", "x"], ["--listen", "nowhere"]):
            with self.subTest(bad), messages(), self.assertRaises(SystemExit) as ended:
                orbbec.parse_arguments(bad)
            self.assertEqual(ended.exception.code, 2)


class Frames(CameraCase):
    def test_depth_block_payload_equals_the_golden_file(self):
        camera = self.open()
        camera._options.width, camera._options.height = 3, 2
        lens = types.SimpleNamespace(width=3, height=2, fx=2, fy=2, cx=1, cy=0.5)
        profile = types.SimpleNamespace(get_intrinsic=lambda: lens, get_distortion=lambda: sdk.distortion)
        with messages():
            camera._read_lens(profile)
        frame = shared.Frame(42, 123_456_789_012, 3, 2, np.array([0, 1000, 2000, 3000, 4000, 65535], "<u2"), 1.0)
        self.assertEqual(camera._payload(frame), golden()[2][32:])

    def test_depth_in_camera_units_is_converted_to_millimetres(self):
        camera = self.open()
        for scale in (0.5, 20.0):
            with mock.patch.object(sdk, "scale", scale):
                camera.poll(self.outlet)
            index = len(self.outlet.blocks)
            z = np.frombuffer(self.outlet.blocks[-1][1][36:], "<u2")
            exact = np.rint(sdk.values(index, 64 * 64) * scale)
            np.testing.assert_array_equal(z, np.where(exact > 65535, 0, exact))
        self.assertTrue((z == 0).any())  # depths that do not fit into 16 bits become 0

    def test_missing_frame_numbers_are_counted_as_lost_frames(self):
        camera = self.open()
        camera.poll(self.outlet)
        camera.poll(self.outlet)
        self.assertEqual(self.outlet.lost, 0)
        sdk.skip = 3
        camera.poll(self.outlet)
        self.assertEqual((self.outlet.lost, len(self.outlet.blocks)), (3, 3))
        self.assertEqual(struct.unpack_from("<I", self.outlet.blocks[-1][1], 16)[0], 6)

    def test_silent_camera_causes_a_restart_of_the_pipeline_and_then_of_the_device(self):
        camera = self.open()
        camera.poll(self.outlet)
        with mock.patch.object(shared, "NO_DATA_S", 0.1), messages():
            sdk.silent = True
            while recorder.calls[-1] != ("start",) or recorder.calls[-2] != ("stop",):
                camera.poll(self.outlet)
            self.assertEqual(self.outlet.lost, 1)
            sdk.silent = False
            camera.poll(self.outlet)  # the frame numbers restart at 1, but no frame is lost
            self.assertEqual((self.outlet.lost, len(self.outlet.blocks)), (1, 2))
            sdk.silent = True
            with self.assertRaisesRegex(RuntimeError, "after a restart"):
                while True:
                    camera.poll(self.outlet)

    def test_invalid_depth_frame_is_skipped(self):
        camera = self.open()
        good = shared.Frame(1, 0, 64, 64, np.zeros(4096, "<u2"), 1.0)
        wrong = {"size 64 x 32 pixels": dict(height=32, steps=np.zeros(2048, "<u2")), "size": dict(steps=np.zeros(5, "<u2")),
                 "time (us) -1": dict(time_us=-1), "number -2": dict(index=-2), "step (mm) nan": dict(mm_per_step=float("nan"))}
        for n, (why, fields) in enumerate(wrong.items()):
            frames = [good._replace(index=2 * n), good._replace(**{"index": 2 * n + 1} | fields), good._replace(index=2 * n + 2)]
            with self.subTest(why), messages() as said, \
                    mock.patch.object(camera, "wait", side_effect=frames):
                for _ in frames:
                    camera.poll(self.outlet)
                self.assertEqual((self.outlet.lost, len(self.outlet.blocks)), (n + 1, 2 * n + 2))
                self.assertIn(why if why != "size" else "", said.getvalue())


class Process(unittest.TestCase):
    def test_bridge_program_sends_depth_frames_until_it_is_stopped(self):
        with Program("orbbec.py", *SIZE) as program, Client(program.address) as client:
            client.block()
            frames = [client.until(bridge.DEPTH)[-1].payload for _ in range(3)]
            for payload in frames:
                width, height, time_us, index = struct.unpack_from("<IIQI", payload)
                self.assertEqual((width, height, time_us), (64, 64, 1_000_000 + 66_667 * index))
                self.assertEqual(payload[36:], sdk.values(index, 64 * 64).tobytes())
            self.assertEqual(program.stop(), 0)
            client.until(bridge.BYE)
            self.assertEqual(program.calls()[-1], ("stop",))

    def test_bridge_program_ends_with_one_line_if_the_camera_cannot_be_used(self):
        for env, said in (({"STAND_IN_CAMERAS": "0"}, "no Orbbec camera is connected"),
                          ({"STAND_IN_CAMERAS": "2"}, r"[^\n]*choose one with --serial: STAND-IN-2, STAND-IN-4"),
                          ({"STAND_IN_INTRINSICS": "zero"}, r"the SDK has no valid intrinsics for [^\n]*")):
            self.assertRegex(testing.ended("orbbec.py", *SIZE, **env), rf"\Aorbbec: {said}\n\Z")


REALSENSE_SIZE = ("--width", "64", "--height", "48", "--fps", "30")


class RealSense(unittest.TestCase):
    def frame(self, *arguments, **env):
        with Program("realsense.py", *REALSENSE_SIZE, *arguments, **env) as program, Client(program.address) as client:
            payload = client.until(bridge.DEPTH)[-1].payload
            self.assertEqual(program.stop(), 0)
            self.assertEqual(program.calls()[-1], ("stop",))
            self.calls = program.calls()
        return struct.unpack_from("<IIQI4f", payload), np.frombuffer(payload[36:], "<u2")

    def test_depth_frame_is_sent_with_its_time_and_axes(self):
        (width, height, time_us, index, *axes), z = self.frame("--serial", "STAND-IN-3")
        self.assertEqual((width, height, time_us), (64, 48, 1_000_000 + 66_667 * index))
        np.testing.assert_allclose(axes, [-31.5 / 50, 1 / 50, 23.5 / 50, -1 / 50], rtol=1e-6)
        np.testing.assert_array_equal(z, pyrealsense2.values(index, 64 * 48))
        self.assertEqual(self.calls[:4], [("query_devices",), ("enable_device", "STAND-IN-3"),
                                          ("enable_stream", "depth", 64, 48, "z16", 30), ("start",)])

    def test_projector_state_and_preset_are_sent_to_the_camera(self):
        with Program("realsense.py", *REALSENSE_SIZE, "--no-projector", "--preset", "high accuracy", STAND_IN_SILENT="5") as program:
            with Client(program.address) as client:
                client.until(bridge.DEPTH)
                # The bridge sends the settings again after it restarts the stream.
                testing.wait_for("restart", lambda: program.calls().count(("set_option", "emitter", 0)) == 2)
            self.assertEqual(program.calls().count(("set_option", "preset", 3)), 2)
            self.assertIn('preset "High Accuracy", projector off\n', program.said())
            self.assertEqual(program.stop(), 0)

    def test_depth_in_tenths_of_a_millimetre_is_converted_to_millimetres(self):
        head, z = self.frame(STAND_IN_SCALE="0.0001")
        np.testing.assert_array_equal(z, np.rint(pyrealsense2.values(head[3], 64 * 48) * 0.1))

    def test_invalid_depth_frame_is_skipped(self):
        with Program("realsense.py", *REALSENSE_SIZE, STAND_IN_TIMES="150:-3,151:nan,153:inf,154:1e20", STAND_IN_FINER="156") as program:
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
                z_mm = pyrealsense2.values(index, 64 * 48) * (0.1 if index >= 156 else 1)
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
            self.assertIn(why, testing.ended("realsense.py", *REALSENSE_SIZE, *words, **env))

    def test_silent_or_unplugged_camera_is_restarted(self):
        with Program("realsense.py", *REALSENSE_SIZE, STAND_IN_SILENT="5", STAND_IN_FAULTS="try_wait_for_frames:180,query_devices:2") as program:
            with Client(program.address) as client:
                blocks = client.until(bridge.BYE)
            self.assertIn("no frame has arrived for 3 s; restarting the stream", program.said())
            self.assertEqual(sum(b.dropped for b in blocks), 1)
            testing.wait_for("camera", lambda: program.calls().count(("start",)) == 3)
            self.assertEqual(program.stop(), 0)


testing.main()
