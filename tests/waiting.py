# SPDX-License-Identifier: MIT
"""Functions that wait for other processes and detect processes that did not get enough processor time."""
import contextlib
import os
import pathlib
import sys
import time


def wait_for(what, condition, timeout_s=20, pause_s=0.02):
    """Waits until condition() is true. `what` is the error message for a timeout, or a function that returns this
    message."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {timeout_s} s: {what() if callable(what) else what}")
        time.sleep(pause_s)


def starved(*pids):
    """Returns True if one of the processes has waited for a processor for more than 1 s and for more than 10 % of its
    lifetime."""
    uptime_s = float(pathlib.Path("/proc/uptime").read_text().split()[0])
    for pid in pids:
        folder, waited_s = pathlib.Path(f"/proc/{pid}"), 0.0
        started = int((folder / "stat").read_text().rpartition(")")[2].split()[19])
        for file in folder.glob("task/*/schedstat"):
            with contextlib.suppress(OSError):  # the thread may have ended
                waited_s += int(file.read_text().split()[1]) * 1e-9
        if waited_s > max(1, 0.1 * (uptime_s - started / os.sysconf("SC_CLK_TCK"))):
            return True
    return False


if __name__ == "__main__":
    sys.exit(not starved(*sys.argv[1:]))
