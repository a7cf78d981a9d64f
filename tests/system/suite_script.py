#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests the exit status of scripts/test and its list of skipped tests. A substitute is used for ctest."""
import os
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def executable(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(0o755)


def run(status, output="100% tests passed, 0 tests failed out of 1", ci=""):
    """Runs scripts/test in a temporary folder. A fake ctest prints `output` and exits with
    `status`."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "scripts/dev").mkdir(parents=True)
        shutil.copy(ROOT / "scripts/test", root / "scripts")
        shutil.copy(ROOT / "scripts/dev/skipped.awk", root / "scripts/dev")
        executable(root / "scripts/setup", "")
        executable(root / "scripts/build", "")
        executable(root / "bin/ctest", f"cat <<'END'\n{output}\nEND\nexit {status}\n")
        environment = os.environ | {"PATH": f"{root}/bin:{os.environ['PATH']}", "CI": ci}
        return subprocess.run([root / "scripts/test"], env=environment, capture_output=True, text=True, timeout=60)


class SuiteScript(unittest.TestCase):
    def test_suite_script_returns_the_exit_status_of_ctest(self):
        for status in 0, 8:
            with self.subTest(status=status):
                done = run(status)
                self.assertEqual((done.returncode, done.stderr), (status, ""))

    def test_suite_script_fails_in_ci_if_a_skipped_test_gives_no_reason(self):
        skipped = "1/1 Test #1: a.test ....***Skipped\n100% tests passed, 0 tests failed out of 1"
        for ci, status in ("", 0), ("1", 1):
            with self.subTest(ci=ci):
                done = run(0, skipped, ci)
                self.assertEqual((done.returncode, done.stderr), (status, ""))
                self.assertIn("skipped: a.test: no reason given\n1 tests skipped, 0 checks not made", done.stdout)


unittest.main()
