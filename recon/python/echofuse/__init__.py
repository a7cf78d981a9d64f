# SPDX-License-Identifier: MIT
"""Runs of echofuse as NumPy arrays, and maps of its models.

>>> import echofuse
>>> run = echofuse.open("monday")
>>> run.spd.shape, run.axes["spd"].unit
>>> maps = echofuse.load_model("fused.h5").predict(run)
"""
from .model import Maps, Model, load_model
from .run import Axis, Run, open  # noqa: A004 (the name that is wanted)

__all__ = ["Axis", "Maps", "Model", "Run", "load_model", "open"]
