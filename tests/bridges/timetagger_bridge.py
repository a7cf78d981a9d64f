#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests scripts/bridges/timetagger.py with a stand-in for the vendor's library."""
import contextlib
import io
import os
import pathlib
import signal
import sys
import tempfile
import time
import types
import unittest
from unittest import mock

import testing
from testing import Client, Outlet, Program, connect, golden, messages, np
import bridge
import pack
import recorder
import timetagger
import TimeTagger as library
from fixtures import executable
import vendor


SETTINGS = ["--start-channel", "-1", "--click-channel", "2", "--trigger-level=-1=-0.25", "--trigger-level", "2=0.1",
            "--dead-time", "2=25001", "--input-delay", "2=-1500", "--event-divider=-1=4", "--max-events", "5000"]


def options(*arguments):
    return timetagger.parse_arguments(arguments)


# Simulates an old version of the library without CustomMeasurement.
old_library = types.SimpleNamespace(**{k: v for k, v in vars(library).items() if k != "CustomMeasurement"})


def open_tagger(*arguments, which=library):
    """Opens the stand-in tagger with the given options. Returns the tagger and its messages."""
    recorder.reset()
    with messages() as said:
        tagger = timetagger.Tagger(which, options(*arguments))
    return tagger, said.getvalue()


class Arguments(unittest.TestCase):
    def test_tagger_options_have_their_default_values(self):
        o = options()
        found = o.listen, o.serial, o.start_channel, o.click_channel, o.conditional_filter, o.test_signal, o.max_events
        self.assertEqual((*found, o.block_ms), (("127.0.0.1", 41110), "", 1, 2, None, False, 1 << 24, 20.0))
        o = options("--start-channel", "0", "--click-channel", "1", "--trigger-level", "0=0.5")  # old devices have an input 0
        self.assertEqual((o.start_channel, o.click_channel, o.trigger_level), (0, 1, [(0, 0.5)]))

    def test_invalid_tagger_options_are_refused(self):
        for bad in (["--listen", "41110"], ["--listen", "h:99999"], ["--click-channel", "1"],
                    ["--trigger-level", "2"], ["--trigger-level", "2=x"], ["--trigger-level", "2=nan"],
                    ["--trigger-level", "3=0.1"], ["--input-delay", "1=0.5"], ["--dead-time", "2=-1"],
                    ["--event-divider", "1=65536"], ["--max-events", "0"], ["--block-ms", "0"],
                    ["--conditional-filter", "-1"], ["--conditional-filter", "48000", "--event-divider", "1=4"], ["--no-such"], ["extra"],
                    ["--file", "a.ttbin", "--network", "lab"], ["--file", "a.ttbin", "--trigger-level", "1=0.5"],
                    ["--network", "lab", "--resolution", "HighResA"], ["--network", "lab", "--serial", "1"]):
            with self.subTest(bad), messages() as said, self.assertRaises(SystemExit) as ended:
                options(*bad)
            self.assertEqual((ended.exception.code, "error:" in said.getvalue()), (2, True))


class Calls(unittest.TestCase):
    def test_tagger_settings_are_applied_in_a_fixed_order(self):
        local, network = ("createTimeTagger", "STAND-IN-1"), ("createTimeTaggerNetwork", "lab:41101")
        no_filter, filtered = ("setConditionalFilter", [], []), ("setConditionalFilter", [2], [1])
        dark = [("setTestSignal", 1, False), ("setTestSignal", 2, False)]
        given = [("setTestSignal", -1, False), ("setTestSignal", 2, False), ("setTriggerLevel", -1, -0.25),
                 ("setTriggerLevel", 2, 0.1), ("setInputDelay", 2, -1500), ("setDeadtime", 2, 25001), no_filter,
                 ("setEventDivider", -1, 4)]
        for words, first, calls in (
                (["--serial", "STAND-IN-1", *SETTINGS], local, given),
                (["--test-signal"], local, [("setTestSignal", 1, True), ("setTestSignal", 2, True), no_filter]),
                (["--resolution", "HighResB"], (*local, 2), [*dark, no_filter]),
                # A filter delay of 0 means that a cable delays the signal, instead of the hardware of the tagger.
                (["--conditional-filter", "0", "--input-delay", "1=-48000"], local,
                 [*dark, ("setDelaySoftware", 1, -48000), filtered]),
                (["--conditional-filter", "48000", "--input-delay", "1=100", "--input-delay", "2=7"], local,
                 [*dark, ("setDelayHardware", 1, 48000), ("setDelaySoftware", 1, -47900), ("setDelaySoftware", 2, 7),
                  filtered]),
                # The settings of a Time Tagger server are not changed.
                (["--network", "lab", "--input-delay", "2=-1500"], network, [("setDelayClient", 2, -1500)]),
                (["--network", "lab", "--test-signal", "--conditional-filter", "0"], network,
                 [("setTestSignal", 1, True), ("setTestSignal", 2, True), ("setDelaySoftware", 1, 0), filtered])):
            start, most = options(*words).start_channel, options(*words).max_events
            measurement = [("CustomMeasurement",), ("register_channel", start), ("register_channel", 2), ("finalize_init",)]
            for which, stream in (library, measurement), (old_library, [("TimeTagStream", most, [start, 2])]):
                with self.subTest(words):
                    tagger, said = open_tagger(*words, which=which)
                    tagger.close()
                    self.assertEqual(recorder.calls, [first, *calls, ("sync",), *stream, ("stop",), ("freeTimeTagger",)])
                    self.assertEqual("dead time of channel 2: 26000 ps (requested: 25001 ps)\n" in said, "--dead-time" in words)

    def test_tagger_is_freed_if_a_setting_is_refused(self):
        for name in ("setTriggerLevel", "sync", "CustomMeasurement"):
            for network, advice in ([], "$"), (["--network", "lab"], "; .* start the server with AccessMode.Control"):
                with mock.patch.dict(os.environ, STAND_IN_FAULTS=f"{name}:1"):
                    self.assertRaisesRegex(RuntimeError, f"^{name} failed" + (advice if name == "setTriggerLevel" else "$"),
                                           open_tagger, "--trigger-level", "1=1", *network)
                self.assertEqual(recorder.calls[-1], ("freeTimeTagger",))

    def test_hello_block_describes_the_tagger(self):
        self.assertEqual(open_tagger("--trigger-level", "2=0.125")[0].hello(), {
            "model": "Time Tagger Ultra", "serial": "STAND-IN-1",
            "firmware": "Version: 2 FPGA: 10; trigger levels 1: 0.5 V, 2: 0.125 V"})


class Tags(unittest.TestCase):
    def poll(self, columns, *arguments, which=library, chunk=1 << 20):
        """Sends the given tags to the bridge, in chunks. Returns the outlet with the blocks, the pause and the messages."""
        tagger, _ = open_tagger(*arguments, which=which)
        tagger._stream.stop()
        if which is old_library:
            tagger._stream._stream.getData = lambda: library.TimeTagStreamBuffer(*columns)
        else:
            tagger._stream.take()
            tags = np.zeros(len(columns[3]), library.TAG)
            for name, column in zip(library.TAG.names, columns):
                tags[name] = column
            for first in range(0, len(tags), chunk):
                tagger._stream.process(tags[first:first + chunk], 0, 0)
            tags.view("u1")[:] = 0xEE  # overwrites the array, as the library does
        outlet = Outlet()
        with messages() as said, mock.patch.object(timetagger, "RATE_S", 0):
            pause = tagger.poll(outlet)
        return outlet, pause, said.getvalue()

    def pattern(self, size):
        return [np.resize(column, size) for column in library.pattern(1, 2, 5_000_000)]

    def test_tag_block_payload_equals_the_golden_file(self):
        # The last tag is on a channel that another client requested.
        columns = ([0, 0, 4, 2, 0], [0, 0, 7, 0, 0], [1, 2, 2, 0, 7], [1_000_000, 1_013_443, 0, 1_100_000, 1_100_001])
        columns = [np.array(column, kind) for column, kind in zip(columns, ("u1", "u2", "i4", "i8"))]
        for which in (library, old_library):
            outlet, _, _ = self.poll(columns, which=which)
            self.assertEqual(outlet.blocks, [(bridge.TAGS, golden()[1][32:], 4)])

    def test_long_tag_blocks_are_split(self):
        for which in (library, old_library):
            for size, sizes in (0, []), (150_000, 4 * [32768] + [18928]):
                outlet, pause, _ = self.poll(self.pattern(size), which=which)
                self.assertEqual(([items for _, _, items in outlet.blocks], pause, outlet.lost), (sizes, 0.02, 0))
            tags = np.frombuffer(b"".join(payload for _, payload, _ in outlet.blocks), pack.RECORD)
            for name, column in zip(tags.dtype.names, self.pattern(150_000)):
                np.testing.assert_array_equal(tags[name], column)

    def test_tags_refused_by_a_full_buffer_are_counted_as_lost(self):
        # In the old library, the stream returns a full buffer but does not report the number of lost tags.
        # CustomMeasurement drops and counts all tags of a call if they do not fit into the buffer.
        for which, size, sent, lost in ((old_library, 4999, 4999, 0), (old_library, 5000, 5000, 1), (library, 5000, 5000, 0),
                                        (library, 5001, 3000, 2001)):
            outlet, pause, said = self.poll(self.pattern(size), "--max-events", "5000", which=which, chunk=3000)
            found = sum(items for _, _, items in outlet.blocks), outlet.lost, pause, "--max-events" in said
            self.assertEqual(found, (sent, lost, 0 if lost else 0.02, lost > 0))

    def test_message_about_lost_tags_contains_the_tag_rate(self):
        said = self.poll(self.pattern(150_000))[2]  # this pattern has overflows
        self.assertRegex(said, r"tags are lost at a tag rate of [\d.]+ million/s \(\d+ MB/s\): the device's buffer overflows; "
                               r"67 % of the tags are laser pulses; --conditional-filter")
        self.assertNotIn("--conditional-filter", self.poll(self.pattern(150_000), "--conditional-filter", "48000")[2])
        self.assertEqual(self.poll([column[:700] for column in self.pattern(700)])[2], "")  # the first 700 tags contain no overflow

    def test_tag_loss_at_20_mhz_is_reported_only_twice_within_100_s(self):
        with mock.patch.object(time, "monotonic", lambda: self.now), messages() as said:
            self.now = 0.0
            losses = timetagger.Losses(options())
            tags = [pack.Packed(b"", 1_000_000, starts=1_000_000, overflows=0)]
            for _ in range(20):
                self.now += 0.05
                losses.look(tags, 0, 0)
            self.assertEqual(said.getvalue(), "")  # a message appears only after a loss
            for _ in range(2000):
                self.now += 0.05
                losses.look(tags, 0, dropped=round(20 * self.now))
        self.assertEqual(said.getvalue().count("\n"), 2)  # two messages in 100 s
        self.assertIn("20.00 million/s (320 MB/s): echofuse reads too slowly; 100 % of the tags "
                      "are laser pulses", said.getvalue())


class Silence(unittest.TestCase):
    def setUp(self):
        self.enterContext(mock.patch.multiple(timetagger, NO_DATA_S=0.1, ANSWER_MS=10))

    def poll(self, which):
        """Polls until the connection has been checked three times after the last tags. Returns the messages printed
        since the last tags."""
        tagger, _ = open_tagger(which=which)
        self.addCleanup(tagger.close)
        checks = lambda: recorder.calls.count(("sync",))
        outlet, blocks, before, end = Outlet(), 0, 0, time.monotonic() + 20
        with messages() as said:
            while not blocks or checks() < before + 3:
                self.assertLess(time.monotonic(), end, "no end of the silence within 20 s")
                time.sleep(tagger.poll(outlet))
                if len(outlet.blocks) > blocks:
                    blocks, before = len(outlet.blocks), checks()
                    said.seek(0)
                    said.truncate()
        return said.getvalue()

    def test_unplugged_tagger_is_detected_while_the_stream_runs(self):
        for which in (library, old_library):
            with mock.patch.object(library, "unplugged", 5):
                self.assertRaisesRegex(RuntimeError, "does not answer", self.poll, which)

    def test_missing_laser_pulses_are_not_reported_as_a_device_fault(self):
        with mock.patch.object(library, "dark", 5):
            said = self.poll(library)
        self.assertEqual(said.count("check that the laser is on"), 1)


class Process(unittest.TestCase):
    def test_bridge_sends_queued_tags_and_frees_the_tagger_when_stopped(self):
        for how in (signal.SIGTERM, signal.SIGINT):
            with Program("timetagger.py") as program, Client(program.address) as client:
                self.assertEqual(client.block().kind, bridge.HELLO)
                blocks = client.until(bridge.TAGS)
                self.assertEqual(program.stop(how), 0)
                blocks += client.until(bridge.BYE)
                self.assertRaises(EOFError, client.block)
                self.assertEqual(program.calls()[-2:], [("stop",), ("freeTimeTagger",)])
                tags = sum(len(b.payload) // 16 for b in blocks if b.kind == bridge.TAGS)
                self.assertEqual(program.sent(), (tags, 1, 0))

    def test_missing_library_or_tagger_ends_the_bridge_with_one_line(self):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("Swabian", "TimeTagger"):
                (pathlib.Path(folder) / f"{name}.py").write_text("raise ImportError('no vendor library')\n")
            self.assertRegex(testing.ended("timetagger.py", path=folder),
                             r"\Atimetagger: no vendor library; install [^\n]*python3 -m venv --system-site-packages "
                             r"[^\n]*pip install Swabian-TimeTagger && export ECHOFUSE_BRIDGE_PYTHON[^\n]*\n\Z")
        said = testing.ended("timetagger.py", STAND_IN_FAULTS="createTimeTagger:1")
        self.assertEqual(said, "timetagger: createTimeTagger failed\n")

    def test_listen_address_in_use_is_reported(self):
        with Program("timetagger.py") as first:
            with Program("timetagger.py", "--listen", "127.0.0.1:%d" % first.address[1]) as second:
                self.assertEqual(second.process.wait(60), 1)
                self.assertIn("cannot listen on 127.0.0.1", second.said())
                self.assertEqual(second.calls()[-1], ("freeTimeTagger",))

    def test_tagger_that_fails_is_reopened_with_all_settings(self):
        """Uses a device that fails on the 20th call and cannot be opened in the next two attempts."""
        with Program("timetagger.py", *SETTINGS[:7],
                     STAND_IN_FAULTS="isRunning:20,createTimeTagger:2,createTimeTagger:3") as program:
            with Client(program.address) as client:
                blocks = [b for b in client.until(bridge.BYE) if b.kind != bridge.HELLO]  # the last block may be a keep-alive hello
                self.assertEqual(blocks[-2].kind, bridge.TAGS)
                self.assertRaises(EOFError, client.block)
            calls = program.calls
            testing.wait_for("device", lambda: [c[0] for c in calls()].count("finalize_init") == 2)
            with connect(program.address) as client:
                client.until(bridge.TAGS)
            opening = [c for c in calls()[: calls().index(("freeTimeTagger",))] if c[0] != "stop"]
            self.assertEqual(calls()[-len(opening):], opening)  # all settings are sent again
            self.assertIn("isRunning failed; trying again", program.said())
            self.assertEqual(program.stop(), 0)


class Shared(unittest.TestCase):
    """Uses a Time Tagger server or a recording instead of a device."""

    def test_lost_connection_to_a_time_tagger_server_is_reported(self):
        tagger, _ = open_tagger("--network", "lab")
        self.addCleanup(tagger.close)
        tagger.poll(Outlet())
        with mock.patch.object(library.TimeTaggerNetwork, "isConnected", return_value=False):
            self.assertRaisesRegex(RuntimeError, "^the connection to the server lab:41101 was lost$", tagger.poll, Outlet())

    def test_replay_of_a_recording_starts_when_the_first_client_connects(self):
        with tempfile.NamedTemporaryFile(suffix=".ttbin") as file:
            for env, calls in (({}, [("createTimeTaggerVirtual", file.name), ("run", 1.0)]),
                               ({"STAND_IN_OLD_FILE": "1"}, [("createTimeTaggerVirtual", ""), ("setReplaySpeed", 1.0),
                                                             ("replay", file.name)])):
                with Program("timetagger.py", "--file", file.name, **env) as program:
                    address = program.address
                    time.sleep(0.3)
                    self.assertNotIn(calls[-1], program.calls())
                    with Client(address) as client:
                        blocks = client.until(bridge.BYE)
                    self.assertEqual(sum(len(b.payload) // 16 for b in blocks if b.kind == bridge.TAGS), 3 * library.PATTERN_TAGS)
                    self.assertEqual(program.process.wait(60), 0)
                    self.assertIn("has ended", program.said())
                    self.assertEqual([call for call in program.calls() if call in calls], calls)

    def test_trigger_level_scan_finds_the_plateau_of_the_count_rate(self):
        for plateau, code, found in ("", 0, "plateau from 0.3 to 1.2 V, 100000 /s: --trigger-level=2=0.75\n"), ("none", 5, ""):
            recorder.reset()
            with mock.patch.dict(os.environ, STAND_IN_PLATEAU=plateau), messages():
                with contextlib.redirect_stdout(io.StringIO()) as said:
                    self.assertEqual(timetagger.scan(library, options("--scan", "2")), code)
            self.assertRegex(said.getvalue(), rf"\A -2.500 V  *0 /s  \n(.* V  .*\n){{49}}  2.500 V .*\n{found}\Z")
            self.assertEqual(recorder.calls[-2:], [("setTriggerLevel", 2, 0.5), ("freeTimeTagger",)])
        self.assertEqual(testing.ended("timetagger.py", "--scan", "2", STAND_IN_FAULTS="setTriggerLevel:1"),
                         "timetagger: setTriggerLevel failed\n")


class Python(unittest.TestCase):
    def test_bridge_runs_with_the_interpreter_of_a_virtual_environment(self):
        with tempfile.TemporaryDirectory() as folder:
            python = executable(pathlib.Path(folder) / "python3", f"#!/bin/sh\necho through >&2\nexec {sys.executable} \"$@\"\n")
            with Program("timetagger.py", ECHOFUSE_BRIDGE_PYTHON=str(python)) as program:
                program.address
                self.assertEqual(program.said().count("through"), 1)
        self.assertIn("ECHOFUSE_BRIDGE_PYTHON=/nowhere/python3: No such file",
                      testing.ended("timetagger.py", code=2, ECHOFUSE_BRIDGE_PYTHON="/nowhere/python3"))

    def test_library_versions_that_do_not_support_numpy_2_are_refused(self):
        for numpy, found, fails in (("2.1.0", "2.17.3", True), ("2.1.0", "2.9.0", True), ("2.1.0", "2.17.4", False),
                                    ("2.1.0", "2.22", False), ("2.1.0", "", False), ("1.24.2", "2.9.0", False)):
            with mock.patch.object(np, "__version__", numpy), messages() as said, (
                    self.assertRaises(SystemExit) if fails else contextlib.nullcontext()):
                vendor.check_version("Swabian-TimeTagger", found, "2.17.4")
            self.assertEqual("-m pip install --upgrade Swabian-TimeTagger" in said.getvalue(), fails, (numpy, found))


testing.main()
