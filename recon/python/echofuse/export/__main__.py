# SPDX-License-Identifier: MIT
"""python3 -m echofuse.export"""
from .command import main

main()
