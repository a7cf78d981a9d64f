# SPDX-License-Identifier: MIT
"""Runs for other programs: HDF5, netCDF, CSV."""
from .command import export, main

__all__ = ["export", "main"]
