# SPDX-License-Identifier: MIT
"""Reports of models and runs, each one page of HTML."""
from .command import main

__all__ = ["main"]
