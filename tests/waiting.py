# SPDX-License-Identifier: MIT
"""Waiting for what other processes do."""
import time


def wait_for(what, condition, timeout_s=20, pause_s=0.02):
    """`what`: words, or what makes them when it is too late."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {timeout_s} s: {what() if callable(what) else what}")
        time.sleep(pause_s)
