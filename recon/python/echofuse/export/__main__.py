# SPDX-License-Identifier: MIT
"""Entry point of python3 -m echofuse.export."""
from .command import main

main()
