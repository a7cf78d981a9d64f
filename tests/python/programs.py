# SPDX-License-Identifier: MIT
"""Runs the programs under test, which are in the folder ECHOFUSE_BIN."""
import os
import pathlib
import subprocess

BIN = pathlib.Path(os.environ["ECHOFUSE_BIN"])


def program(name, *words):
    subprocess.run([BIN / name, *map(str, words)], check=True, stdout=subprocess.DEVNULL)
