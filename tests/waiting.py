# SPDX-License-Identifier: MIT
"""Waiting for what other processes do."""
import pathlib
import time


def wait_for(what, condition, timeout_s=20, pause_s=0.02):
    """`what`: words, or what makes them when it is too late."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {timeout_s} s: {what() if callable(what) else what}")
        time.sleep(pause_s)


def starved(*processes):
    """True if these processes, which still run, have waited for a processor for more than a second in total."""
    threads = [file for process in processes for file in pathlib.Path(f"/proc/{process.pid}/task").glob("*/schedstat")]
    return sum(int(file.read_text().split()[1]) for file in threads) > 1e9
