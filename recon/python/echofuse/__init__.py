# SPDX-License-Identifier: MIT
"""Reads echofuse runs as NumPy arrays, and predicts depth maps in NumPy. models/method.py
implements the complete reconstruction method in a compact form.

>>> import echofuse
>>> run = echofuse.open("monday")
>>> run.spd.shape, run.axes["spd"].unit
>>> empty = echofuse.record("lab.toml", count=1, label="empty")  # records one slot
>>> maps = echofuse.load_model("fused.safetensors").predict(run)
>>> maps.depth_m.shape  # metres, NaN: no return
"""
import os
import sys

# Benchmarks use one thread. NumPy reads these variables when it is imported.
if {"echofuse-bench", "echofuse.bench"} & {os.path.basename(word) for word in sys.orig_argv}:
    os.environ |= {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}

from . import metrics
from .models import Estimator, Maps, Model, load_maps, load_model, save_maps
from .runs import Axis, Record, Run, Split, annotate, record, split, to_xarray, write_run
from .runs import open as open  # noqa: A004 (not in __all__, because it shadows the built-in)

__version__ = "0.3.0"

__all__ = ["Axis", "Estimator", "Maps", "Model", "Record", "Run", "Split", "annotate", "load_maps",
           "load_model", "metrics", "record", "save_maps", "split", "to_xarray", "write_run"]
