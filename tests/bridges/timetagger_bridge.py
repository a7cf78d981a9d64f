#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""scripts/bridges/timetagger.py against the stand-in of the vendor's library."""
import contextlib
import io
import pathlib
import signal
import tempfile
import unittest

import testing
from testing import Client, Program, connect, golden, np

import bridge
import recorder
import timetagger
import TimeTagger as library

SETTINGS = ["--start-channel", "-1", "--click-channel", "2", "--trigger-level=-1=-0.25", "--trigger-level", "2=0.1",
            "--dead-time", "2=25001", "--input-delay", "2=-1500", "--event-divider=-1=4", "--max-events", "5000"]


def options(*arguments):
    return timetagger.parse_arguments(arguments)


def open_tagger(*arguments):
    """The calls made, and what was said."""
    recorder.reset()
    with contextlib.redirect_stderr(io.StringIO()) as said:
        tagger = timetagger.Tagger(library, options(*arguments))
    return tagger, said.getvalue()


class Outlet:
    """In place of the server."""

    def __init__(self):
        self.blocks, self.lost = [], 0

    def send(self, kind, payload, items):
        self.blocks.append((kind, bytes(payload), items))

    def lose(self, items):
        self.lost += items


class Arguments(unittest.TestCase):
    def test_defaults(self):
        o = options()
        self.assertEqual((o.listen, o.serial, o.start_channel, o.click_channel), (("127.0.0.1", 41110), "", 1, 2))
        self.assertEqual((o.conditional_filter, o.test_signal, o.max_events, o.block_ms), (None, False, 1 << 24, 20.0))

    def test_refused(self):
        for bad in (["--listen", "41110"], ["--listen", "h:99999"], ["--click-channel", "1"], ["--start-channel", "0"],
                    ["--trigger-level", "2"], ["--trigger-level", "2=x"], ["--trigger-level", "2=nan"],
                    ["--trigger-level", "3=0.1"], ["--input-delay", "1=0.5"], ["--dead-time", "2=-1"],
                    ["--event-divider", "1=65536"], ["--max-events", "0"], ["--block-ms", "0"],
                    ["--conditional-filter", "-1"], ["--conditional-filter", "48000", "--event-divider", "1=4"], ["--no-such"], ["extra"]):
            with self.subTest(bad), contextlib.redirect_stderr(io.StringIO()) as said:
                with self.assertRaises(SystemExit) as ended:
                    options(*bad)
                self.assertEqual(ended.exception.code, 2)
                self.assertIn("error:", said.getvalue())


class Calls(unittest.TestCase):
    def test_every_setting_in_order(self):
        tagger, said = open_tagger("--serial", "2138000X", *SETTINGS)
        tagger.close()
        self.assertEqual(recorder.calls, [
            ("createTimeTagger", "2138000X"),
            ("setTestSignal", -1, False), ("setTestSignal", 2, False),
            ("setTriggerLevel", -1, -0.25), ("setTriggerLevel", 2, 0.1),
            ("setInputDelay", 2, -1500),
            ("setDeadtime", 2, 25001),
            ("setConditionalFilter", [], []),
            ("setEventDivider", -1, 4),
            ("sync",),
            ("TimeTagStream", 5000, [-1, 2]),
            ("stop",), ("freeTimeTagger",)])
        self.assertIn("dead time of channel 2: 26000 ps (asked for 25001)", said)

    def test_first_device(self):
        open_tagger("--test-signal")
        self.assertEqual(recorder.calls[0], ("createTimeTagger", ""))
        self.assertIn(("setTestSignal", 1, True), recorder.calls)

    def test_filter_keeps_the_pulse_before_the_photon(self):
        open_tagger("--conditional-filter", "48000", "--input-delay", "1=100", "--input-delay", "2=7")
        delays = [call for call in recorder.calls if "Delay" in call[0]]
        self.assertEqual(delays, [("setDelayHardware", 1, 48000), ("setDelaySoftware", 1, 100 - 48000),
                                  ("setDelaySoftware", 2, 7)])
        self.assertIn(("setConditionalFilter", [2], [1]), recorder.calls)
        # With a cable in its place no hardware delay is asked for.
        open_tagger("--conditional-filter", "0", "--input-delay", "1=-48000")
        delays = [call for call in recorder.calls if "Delay" in call[0]]
        self.assertEqual(delays, [("setDelaySoftware", 1, -48000)])

    def test_refused_settings_free_the_device(self):
        for name in ("setTriggerLevel", "sync", "TimeTagStream"):
            recorder.reset()
            recorder.faults[name, 1] = "no"
            self.assertRaisesRegex(RuntimeError, "^no$", timetagger.Tagger, library, options("--trigger-level", "1=1"))
            self.assertEqual(recorder.calls[-1], ("freeTimeTagger",))

    def test_hello(self):
        self.assertEqual(open_tagger()[0].hello(), {"model": "Time Tagger Ultra", "serial": "STAND-IN-1",
                                                   "firmware": "Version: 2 FPGA: 10"})


class Tags(unittest.TestCase):
    def poll(self, size, *arguments):
        """What a stream with these tags makes of it."""
        tagger, _ = open_tagger(*arguments)
        types, missed, channels, times = library.pattern(1, 2, 5_000_000)
        columns = [np.resize(column, size) for column in (types, missed, channels, times)]
        tagger._stream.getData = lambda: library.TimeTagStreamBuffer(*columns)
        outlet = Outlet()
        with contextlib.redirect_stderr(io.StringIO()) as said:
            pause = tagger.poll(outlet)
        return outlet, pause, said.getvalue(), columns

    def test_golden_payload(self):
        tagger, _ = open_tagger()
        columns = ([0, 0, 4, 2], [0, 0, 7, 0], [1, 2, 2, 0], [1_000_000, 1_013_443, 0, 1_100_000])
        tagger._stream.getData = lambda: library.TimeTagStreamBuffer(
            *(np.array(column, kind) for column, kind in zip(columns, ("u1", "u2", "i4", "i8"))))
        outlet = Outlet()
        tagger.poll(outlet)
        self.assertEqual(outlet.blocks, [(bridge.TAGS, golden()[1][32:], 4)])

    def test_long_blocks_are_divided(self):
        outlet, pause, _, columns = self.poll(150_000)
        self.assertEqual([items for _, _, items in outlet.blocks], [65536, 65536, 18928])
        tags = np.frombuffer(b"".join(payload for _, payload, _ in outlet.blocks), timetagger.RECORD)
        for name, column in zip(("type", "missed", "channel", "time"), columns):
            np.testing.assert_array_equal(tags[name], column)
        self.assertEqual((pause, outlet.lost), (0.02, 0))

    def test_nothing_is_no_block(self):
        outlet, _, _, _ = self.poll(0)
        self.assertEqual(outlet.blocks, [])

    def test_full_buffer_is_a_loss(self):
        outlet, pause, said, _ = self.poll(5000, "--max-events", "5000")
        self.assertEqual((sum(items for _, _, items in outlet.blocks), outlet.lost, pause), (5000, 1, 0))
        self.assertIn("--max-events", said)


class Process(unittest.TestCase):
    def test_clean_stop(self):
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

    def test_library_is_absent(self):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("Swabian", "TimeTagger"):
                (pathlib.Path(folder) / f"{name}.py").write_text("raise ImportError('no vendor library')\n")
            with Program("timetagger.py", path=folder) as program:
                self.assertEqual(program.process.wait(10), 4)
                self.assertRegex(program.said(), r"\Atimetagger: no vendor library; install [^\n]*\n\Z")

    def test_no_device(self):
        with Program("timetagger.py", STAND_IN_FAULTS="createTimeTagger:1") as program:
            self.assertEqual(program.process.wait(10), 4)
            self.assertEqual(program.said(), "timetagger: createTimeTagger failed\n")

    def test_address_in_use(self):
        with Program("timetagger.py") as first:
            with Program("timetagger.py", "--listen", "127.0.0.1:%d" % first.address[1]) as second:
                self.assertEqual(second.process.wait(10), 1)
                self.assertIn("cannot listen on 127.0.0.1", second.said())
                self.assertEqual(second.calls()[-1], ("freeTimeTagger",))

    def test_device_that_comes_back(self):
        """It fails in the 20th reading and is not there at the next opening."""
        with Program("timetagger.py", *SETTINGS[:7],
                     STAND_IN_FAULTS="getData:20,createTimeTagger:2,createTimeTagger:3") as program:
            with Client(program.address) as client:
                blocks = [b for b in client.until(bridge.BYE) if b.kind != bridge.HELLO]  # a sign of life may be last
                self.assertEqual(blocks[-2].kind, bridge.TAGS)
                self.assertRaises(EOFError, client.block)
            calls = program.calls
            testing.wait_for("device", lambda: [c[0] for c in calls()].count("TimeTagStream") == 2)
            with connect(program.address) as client:
                client.until(bridge.TAGS)
            opening = [c for c in calls()[: calls().index(("freeTimeTagger",))] if c[0] != "stop"]
            self.assertEqual(calls()[-len(opening):], opening)  # all settings once more
            self.assertIn("getData failed; trying again", program.said())
            self.assertEqual(program.stop(), 0)

    def test_slow_client_loses_and_knows(self):
        with Program("timetagger.py", STAND_IN_PULSES_PER_S="inf") as program, Client(program.address) as client:
            testing.wait_for("drops", lambda: client.block().dropped > 0)
            self.assertEqual(program.stop(), 0)


if __name__ == "__main__":
    testing.main()
