# SPDX-License-Identifier: MIT
"""Empty module that hides an installed vendor package, so that tests use the stand-in TimeTagger of this folder."""
raise ImportError("hidden by the tests")
