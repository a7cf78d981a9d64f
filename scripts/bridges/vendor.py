# SPDX-License-Identifier: MIT
"""The vendors' Python packages: in which interpreter, how to install them, and which version numpy 2 needs."""
import importlib
import importlib.metadata
import os
import re
import sys

import bridge
from pack import np


def use_python():
    """Goes on in the interpreter ECHOFUSE_BRIDGE_PYTHON, if it is set: that of a virtual environment."""
    python = os.environ.pop("ECHOFUSE_BRIDGE_PYTHON", "")
    if not python:
        return
    try:
        os.execv(python, [python, *sys.argv])
    except OSError as error:
        bridge.fail(f"ECHOFUSE_BRIDGE_PYTHON={python}: {error.strerror}", bridge.USAGE)


def library(modules, package):
    """The first of these modules that is there; the package has it."""
    faults = []
    for name in modules:
        try:
            return importlib.import_module(name)
        except ImportError as error:
            faults.append(str(error))
    bridge.fail(f"{'; '.join(dict.fromkeys(faults))}; install it for this Python, {sys.executable}, or in a virtual environment: "
         f"python3 -m venv --system-site-packages ~/bridges && ~/bridges/bin/pip install {package} && "
         "export ECHOFUSE_BRIDGE_PYTHON=~/bridges/bin/python3")


def version_of_package(name):
    """As pip installed it; empty where it did not."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def check_version(package, found, least):
    """Ends the program if numpy is of version 2 and the package is older than the first one for it."""
    numbers = [[int(n) for n in re.findall(r"\d+", text)[:3]] for text in (found, least, np.__version__)]
    if found and numbers[0] < numbers[1] and numbers[2][0] >= 2:
        bridge.fail(f"{package} {found} does not work with numpy {np.__version__}, versions from {least} on do: "
             f"{sys.executable} -m pip install --upgrade {package}")
