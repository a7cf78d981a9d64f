# SPDX-License-Identifier: MIT
"""Hides an installed vendor package, so that the tests use the stand-in TimeTagger in this folder."""
raise ImportError("hidden by the tests")
