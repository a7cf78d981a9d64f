# SPDX-License-Identifier: MIT
"""Reads, records, imports and splits runs."""
from .acquire import annotate, record, write_run
from .axis import Axis
from .netcdf import dataset as to_xarray
from .record import Record
from .run import PS_PER_M, SENSORS, Run, open  # noqa: A004
from .splits import Split, split

__all__ = ["PS_PER_M", "SENSORS", "Axis", "Record", "Run", "Split", "annotate", "open", "record",
           "split", "to_xarray", "write_run"]
