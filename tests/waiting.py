# SPDX-License-Identifier: MIT
"""Waiting for what other processes do."""
import time


def wait_for(what, condition, timeout_s=20):
    """`what`: words, or what makes them when it is too late."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"no {what() if callable(what) else what} within {timeout_s} s")
        time.sleep(0.02)
