# SPDX-License-Identifier: MIT
"""python3 -m echofuse.bench"""
from .command import main

main()
