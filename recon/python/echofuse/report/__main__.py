# SPDX-License-Identifier: MIT
"""Entry point of python3 -m echofuse.report."""
from .command import main

main()
