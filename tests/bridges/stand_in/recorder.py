# SPDX-License-Identifier: MIT
"""Records calls and causes faults at given calls: in this process (`calls`, `faults`), or for a bridge
in another process by STAND_IN_LOG=file and STAND_IN_FAULTS=name:n,... (the n-th call)."""
import json
import os

calls = []
faults = {}  # (name, n): text of the RuntimeError
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
    """Counts a call that is too frequent to be recorded."""
    _counts[name] = _counts.get(name, 0) + 1
    at = (name, _counts[name])
    if at in faults or f"{name}:{at[1]}" in os.environ.get("STAND_IN_FAULTS", "").split(","):
        raise RuntimeError(faults.get(at, f"{name} failed"))
