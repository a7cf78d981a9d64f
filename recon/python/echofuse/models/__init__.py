# SPDX-License-Identifier: MIT
"""Predicts depth maps with trained models in NumPy. The maps are equal to those of
echofuse-recon."""
from .maps import load_maps, save_maps
from .model import Estimator, Maps, Model, load_model, read_safetensors

__all__ = ["Estimator", "Maps", "Model", "load_maps", "load_model", "read_safetensors", "save_maps"]
