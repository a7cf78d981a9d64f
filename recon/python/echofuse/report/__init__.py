# SPDX-License-Identifier: MIT
"""Writes HTML reports about models and runs."""
from .command import main

__all__ = ["main"]
