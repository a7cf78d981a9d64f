#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests scripts/bridges/timetagger.py with a Time Tagger server or a recording instead of a device.

Also tests the scan of trigger levels and the required versions of the Python interpreter and the library. All tests use
a stand-in for the vendor's library."""
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest
from unittest import mock

import testing
from testing import Client, Program, connect, np

import bridge
from fixtures import executable
import pack
import recorder
import TimeTagger as library
import vendor
from timetagger_bridge import open_tagger


class Shared(unittest.TestCase):
    """Uses a Time Tagger server or a recording instead of a device."""

    def test_settings_of_a_time_tagger_server_are_not_changed(self):
        tagger, _ = open_tagger("--network", "lab", "--input-delay", "2=-1500")
        tagger.close()
        self.assertEqual(recorder.calls, [
            ("createTimeTaggerNetwork", "lab:41101"), ("setDelayClient", 2, -1500), ("sync",), ("CustomMeasurement",),
            ("register_channel", 1), ("register_channel", 2), ("finalize_init",), ("stop",), ("freeTimeTagger",)])

    def test_refused_setting_is_reported_with_a_remedy(self):
        self.assertIn("start the server with AccessMode.Control", testing.ended(
            "timetagger.py", "--network", "lab:4444", "--trigger-level", "2=0.5", STAND_IN_LISTEN="1"))
        with Program("timetagger.py", "--network", "lab:4444", STAND_IN_LISTEN="1") as program:
            with Client(program.address) as client:
                client.until(bridge.TAGS)
            self.assertEqual(program.stop(), 0)

    def test_bridge_reconnects_to_a_time_tagger_server_that_was_lost(self):
        with Program("timetagger.py", "--network", "lab", STAND_IN_SERVER="20") as program:
            with Client(program.address) as client:
                client.until(bridge.BYE)
            with connect(program.address) as client:
                client.until(bridge.TAGS)
            self.assertIn("the connection to the server lab:41101 was lost; trying again", program.said())

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
                    self.assertEqual(program.process.wait(10), 0)
                    self.assertIn("has ended", program.said())
                    self.assertEqual([call for call in program.calls() if call in calls], calls)

    def test_tags_of_channels_that_other_clients_requested_are_excluded(self):
        with Program("timetagger.py", STAND_IN_FOREIGN="1") as program, Client(program.address) as client:
            tags = np.frombuffer(client.until(bridge.TAGS)[-1].payload, pack.RECORD)
            self.assertEqual(set(tags["channel"][tags["type"] == 0]), {1, 2})

    def test_time_resolution_of_the_tagger_can_be_selected(self):
        open_tagger("--resolution", "HighResB")
        self.assertEqual(recorder.calls[0], ("createTimeTagger", "STAND-IN-1", 2))

    def test_trigger_level_scan_finds_the_plateau_of_the_count_rate(self):
        said = scan("2")
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertIn("plateau from 0.3 to 1.2 V, 100000 /s: --trigger-level=2=0.75\n", said.stdout)
        self.assertEqual(said.stdout.count(" V "), 51)
        self.assertEqual(scan("2", STAND_IN_PLATEAU="none").returncode, 5)
        said = scan("2", "--network", "lab", STAND_IN_LISTEN="1")
        self.assertEqual((said.returncode, "AccessMode.Listen" in said.stderr), (4, True))

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
        with mock.patch.object(np, "__version__", "2.1.0"):
            for found, fails in (("2.17.3", True), ("2.9.0", True), ("2.17.4", False), ("2.22", False), ("", False)):
                with testing.messages() as said:
                    try:
                        vendor.check_version("Swabian-TimeTagger", found, "2.17.4")
                        self.assertFalse(fails, found)
                    except SystemExit:
                        self.assertTrue(fails, found)
                        self.assertIn("-m pip install --upgrade Swabian-TimeTagger", said.getvalue())
        with mock.patch.object(np, "__version__", "1.24.2"):
            vendor.check_version("Swabian-TimeTagger", "2.9.0", "2.17.4")  # with numpy 1, any version of the library works


def scan(*words, **env):
    return subprocess.run([sys.executable, testing.root / "scripts/bridges/timetagger.py", "--scan", *words],
                          env=os.environ | {"PYTHONPATH": str(testing.here / "stand_in")} | env, text=True, capture_output=True)


testing.main()
