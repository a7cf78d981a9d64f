# SPDX-License-Identifier: MIT
"""Runs of echofuse as NumPy arrays, and maps of its models, made in NumPy as well (method.py: the
method on one page).

>>> import echofuse
>>> run = echofuse.open("monday")
>>> run.spd.shape, run.axes["spd"].unit
>>> one = echofuse.record("lab.toml", count=1, label="empty")  # as echofuse-acquire run
>>> maps = echofuse.load_model("fused.safetensors").predict(run)
>>> maps.depth_m.shape  # metres; NaN: nothing returned
"""
from . import metrics
from .acquire import record, write_run
from .axis import Axis
from .model import Estimator, Maps, Model, load_model
from .maps import load_maps, save_maps
from .netcdf import dataset as to_xarray
from .run import Record, Run
from .run import open as open  # noqa: A004 (not in __all__: it would replace the built-in)
from .splits import Split, split

__version__ = "0.3.0"

__all__ = ["Axis", "Estimator", "Maps", "Model", "Record", "Run", "Split", "load_maps",
           "load_model", "metrics", "record", "save_maps", "split", "to_xarray", "write_run"]
