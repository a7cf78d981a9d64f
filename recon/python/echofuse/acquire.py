# SPDX-License-Identifier: MIT
"""Recording from Python: echofuse-acquire run --json below it."""
from __future__ import annotations

import json
import os
import pathlib
import signal
import subprocess
import tempfile
from typing import Any, Iterator

from . import run as runs


def record(config: str | pathlib.Path | None = None, count: int = 1, *, label: str | None = None,
           out: str | pathlib.Path | None = None, settings: dict[str, Any] | None = None,
           program: str | None = None) -> runs.Run:
    """Records so many slots and returns the closed run. settings: {"run.window_s": 1.0}, over the configuration's;
    program: echofuse-acquire of that path ($ECHOFUSE_ACQUIRE). Raises RuntimeError with the program's own line if it
    ends otherwise; Ctrl-C ends the run with its slot."""
    words = [program or os.environ.get("ECHOFUSE_ACQUIRE", "echofuse-acquire"), "run", "--json", "-q", "--count", str(count)]
    given = dict(settings or {}) | ({} if label is None else {"run.label": label})
    for option, values in (("--config", [config]), ("--out", [out]), ("--set", [f"{k}={v}" for k, v in given.items()])):
        for value in values:
            words += [option, os.fspath(value)] if value is not None else []
    path = None
    # A session of its own: Ctrl-C at the terminal comes here alone, and goes on once.
    with tempfile.TemporaryFile("w+") as errors, subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=errors, text=True, start_new_session=True) as child:
        try:
            path = file_of(map(json.loads, child.stdout))
        except KeyboardInterrupt:
            child.send_signal(signal.SIGINT)
            child.stdout.read()
            raise
        finally:
            child.wait()
            errors.seek(0)
            said = errors.read()
    if child.returncode or path is None:
        raise RuntimeError(said.strip() or f"echofuse-acquire ended with exit code {child.returncode}")
    return runs.open(path)


def file_of(events: Iterator[dict[str, Any]]) -> str | None:
    """The run's file, when all events have come."""
    found = None
    for event in events:
        found = event["file"] if event["event"] == "run" else found
    return found
