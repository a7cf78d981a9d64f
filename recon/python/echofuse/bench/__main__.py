# SPDX-License-Identifier: MIT
"""Entry point of python3 -m echofuse.bench."""
from .command import main

main()
