# SPDX-License-Identifier: MIT
"""Runs of echofuse as NumPy arrays, and maps of its models, made in NumPy as well
(models/method.py: the method on one page).

>>> import echofuse
>>> run = echofuse.open("monday")
>>> run.spd.shape, run.axes["spd"].unit
>>> one = echofuse.record("lab.toml", count=1, label="empty")  # as echofuse-acquire run
>>> maps = echofuse.load_model("fused.safetensors").predict(run)
>>> maps.depth_m.shape  # metres; NaN: nothing returned
"""
from . import metrics
from .models import Estimator, Maps, Model, load_maps, load_model, save_maps
from .runs import Axis, Record, Run, Split, record, split, to_xarray, write_run
from .runs import open as open  # noqa: A004 (not in __all__: it would replace the built-in)

__version__ = "0.3.0"

__all__ = ["Axis", "Estimator", "Maps", "Model", "Record", "Run", "Split", "load_maps",
           "load_model", "metrics", "record", "save_maps", "split", "to_xarray", "write_run"]
