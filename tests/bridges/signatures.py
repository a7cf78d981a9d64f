#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Checks that the bridges call only functions that the vendors published, also in code that no test reaches. The stand-ins
contain the tables of these functions and their sources."""
import ast
import unittest

import testing

import pyorbbecsdk
import pyrealsense2
import TimeTagger
from recorder import published


def calls(script, owners):
    """Returns the names of the methods that a bridge script calls on variables named in `owners`."""
    tree = ast.parse((testing.root / "scripts/bridges" / script).read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            base = node.func.value
            owner = base.attr if isinstance(base, ast.Attribute) else getattr(base, "id", "")
            if owner in owners:
                found.add(node.func.attr)
    return found


class Signatures(unittest.TestCase):
    def test_bridges_call_only_functions_that_the_vendors_published(self):
        for script, library, more, least, owners in (
                ("timetagger.py", TimeTagger, {"take", "Replay"}, 15, "library _library tagger _tagger _stream data"),
                ("orbbec.py", pyorbbecsdk, set(), 20, "_sdk sdk _context devices device info _pipeline _config profiles profile frames "
                                                      "frame modes presets"),
                ("realsense.py", pyrealsense2, set(), 16, "sdk _pipeline _config device profile frames frame sensor")):
            table = [*published(library.PUBLISHED)]
            called = calls(script, owners.split())
            self.assertEqual(called - {name for owner, function, _ in table for name in (owner, function)} - more, set())
            self.assertGreater(len(called), least)


testing.main()
