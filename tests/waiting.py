# SPDX-License-Identifier: MIT
"""Waiting for other processes."""
import pathlib
import time


def wait_for(what, condition, timeout_s=20, pause_s=0.02):
    """`what` is a text for the error, or a function that returns it."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {timeout_s} s: {what() if callable(what) else what}")
        time.sleep(pause_s)


def starved(*processes):
    """Returns whether these running processes have waited more than a second in total for a processor."""
    threads = [file for process in processes for file in pathlib.Path(f"/proc/{process.pid}/task").glob("*/schedstat")]
    return sum(int(file.read_text().split()[1]) for file in threads) > 1e9
