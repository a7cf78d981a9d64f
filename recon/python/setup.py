# SPDX-License-Identifier: MIT
"""Stops a build without the files of the report page (echofuse/report/page, in a checkout a link
to the live page's folder)."""
import pathlib
import sys

from setuptools import setup

page = pathlib.Path(__file__).resolve().parent / "echofuse/report/page"
if not (page / "report.html").exists():
    sys.exit(f"{page}: report.html is missing; build in a checkout, from an sdist, or from a copy "
             "that follows links (cp -rL)")
setup()
