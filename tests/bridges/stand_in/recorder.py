# SPDX-License-Identifier: MIT
"""What was called, and faults at given calls: in this process (`calls`, `faults`) or, for a bridge
that runs as a program, through STAND_IN_LOG=file and STAND_IN_FAULTS=name:n,... (the n-th call)."""
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
    """A call that comes too often to be recorded."""
    _counts[name] = _counts.get(name, 0) + 1
    at = (name, _counts[name])
    if at in faults or f"{name}:{at[1]}" in os.environ.get("STAND_IN_FAULTS", "").split(","):
        raise RuntimeError(faults.get(at, f"{name} failed"))
