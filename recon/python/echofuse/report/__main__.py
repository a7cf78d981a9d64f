# SPDX-License-Identifier: MIT
"""python3 -m echofuse.report"""
from .command import main

main()
