# SPDX-License-Identifier: MIT
"""HTML reports of models and runs."""
from .command import main

__all__ = ["main"]
