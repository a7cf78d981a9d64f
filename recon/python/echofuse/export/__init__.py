# SPDX-License-Identifier: MIT
"""Exports runs to HDF5, netCDF and CSV."""
from .command import export, main

__all__ = ["export", "main"]
