# SPDX-License-Identifier: MIT
"""Records the calls of a stand-in library and raises errors at selected calls.

Tests in the same process use `calls` and `faults`. For a bridge in another process, STAND_IN_LOG names the file for the
calls, and STAND_IN_FAULTS=name:n,... selects the n-th call of each function."""
import json
import os

calls = []
faults = {}  # message of the RuntimeError for the n-th call of a function, by (name, n)
_counts = {}


def reset():
    calls.clear()
    faults.clear()
    _counts.clear()


def called(name, *values):
    calls.append((name, *values))
    if path := os.environ.get("STAND_IN_LOG"):
        with open(path, "a", encoding="utf-8") as log:
            log.write(json.dumps([name, *values]) + "\n")
    happen(name)


def happen(name):
    """Counts a call and raises the selected error. Does not record the call, because such calls may be frequent."""
    _counts[name] = _counts.get(name, 0) + 1
    at = (name, _counts[name])
    if at in faults or f"{name}:{at[1]}" in os.environ.get("STAND_IN_FAULTS", "").split(","):
        raise RuntimeError(faults.get(at, f"{name} failed"))
