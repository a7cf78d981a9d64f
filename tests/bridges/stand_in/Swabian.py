# SPDX-License-Identifier: MIT
"""Hides an installed vendor package, so that the tests take the stand-in TimeTagger beside this."""
raise ImportError("hidden by the tests")
