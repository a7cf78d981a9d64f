# SPDX-License-Identifier: MIT
"""Common part of the system tests: the paths of the programs and modules, and a test case with a folder. The programs are
in the folder that is the first argument of a test. The other arguments are the tests to run."""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

bin_dir = pathlib.Path(sys.argv[1]).resolve()
source = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(source / folder) for folder in ("tests", "tests/fixtures", "tests/view", "recon/python")]
import waiting


class Case(unittest.TestCase):
    def setUp(self):
        self.dir = self.new_folder(self.enterContext)

    def call(self, *words, **how):
        return call(self.dir, *words, **how)

    def lab(self, *command, options=(), simulator=(bin_dir / "echofuse-sim", "lab")):
        """Runs a command in the simulated laboratory self.dir/lab. Returns the finished process (waiting.run)."""
        return waiting.run([*simulator, "--dir", self.dir / "lab", *options, "--", *command], text=True, timeout=180,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    @staticmethod
    def new_folder(enter):
        """Returns a folder that is deleted at the end of the test, or of the class with `enterClassContext`."""
        return pathlib.Path(enter(tempfile.TemporaryDirectory(prefix="echofuse-")))


class SharedCase(Case):
    """Test case in which all tests use the same folder."""

    @classmethod
    def setUpClass(cls):
        cls.dir = cls.new_folder(cls.enterClassContext)

    def setUp(self):
        pass


def call(folder, *words, ok=(0,), timeout_s=240, **environment):
    """Runs a command in a folder and returns its output, without the messages. The exit code must be one of `ok`."""
    done = subprocess.run(list(map(str, words)), cwd=folder, capture_output=True, text=True, timeout=timeout_s, env=os.environ | {
        "PATH": f"{bin_dir}:{os.environ['PATH']}", "PYTHONPATH": str(source / "recon/python"), "PYTHONDONTWRITEBYTECODE": "1"} | environment)
    assert done.returncode in ok, f"{words}: {done.returncode}: {done.stdout}{done.stderr}"
    return done.stdout


def main(case):
    unittest.main(argv=[sys.argv[0], *(f"{case.__name__}.{name}" for name in sys.argv[2:])])
