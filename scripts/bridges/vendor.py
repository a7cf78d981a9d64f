# SPDX-License-Identifier: MIT
"""Finds and imports the vendors' Python packages: chooses the interpreter, explains how to install them, and checks
that they support the installed numpy."""
import importlib
import importlib.metadata
import os
import re
import sys

import bridge
from pack import np


def use_python():
    """Restarts the program with the interpreter $ECHOFUSE_BRIDGE_PYTHON if it is set, e.g. to use a virtual
    environment."""
    python = os.environ.pop("ECHOFUSE_BRIDGE_PYTHON", "")
    if not python:
        return
    try:
        os.execv(python, [python, *sys.argv])
    except OSError as error:
        bridge.fail(f"ECHOFUSE_BRIDGE_PYTHON={python}: {error.strerror}", bridge.USAGE)


def library(modules, package):
    """Imports and returns the first available module; exits with instructions to install `package` if none is
    available."""
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
    """Returns the version of the package that pip installed, or "" if pip did not install it."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def check_version(package, found, minimum):
    """Exits with instructions if numpy 2 is installed and the package is too old to support it."""
    numbers = [[int(n) for n in re.findall(r"\d+", text)[:3]] for text in (found, minimum, np.__version__)]
    if found and numbers[0] < numbers[1] and numbers[2][0] >= 2:
        bridge.fail(f"{package} {found} does not work with numpy {np.__version__}; expected {minimum} or later: "
             f"{sys.executable} -m pip install --upgrade {package}")
