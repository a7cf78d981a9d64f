#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Runs the commands of a text: readme.py BIN FILE.md [--slow] types its ```sh blocks, line by line and in order, into
one shell in an empty folder that has the programs in PATH and scripts/ and config/ beside it. A block after
`<!-- not run: reason -->` is left out; one after `<!-- slow -->`, which repeats what a quicker test checks, without
--slow. The first command that fails ends the test."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

root = pathlib.Path(__file__).resolve().parent.parent
LAST = "readme.py: every line was run"

text = pathlib.Path(sys.argv[2]).read_text(encoding="utf-8")
blocks = [code for note, code in re.findall(r"(<!-- (?:not run: [^>]+|slow) -->\n+)?^```sh\n(.*?)^```$", text, re.M | re.S)
          if not note or ("slow" in note and "--slow" in sys.argv)]
assert blocks, f"{sys.argv[2]}: no commands"
with tempfile.TemporaryDirectory(prefix="readme-") as folder:
    for name in ("scripts", "config"):
        (pathlib.Path(folder) / name).symlink_to(root / name)
    # A shell that a command opens (`echofuse-sim lab -- bash`) reads the lines that follow, as it would from a
    # terminal: a pipe, because bash reads ahead in a file. BASH_ENV makes it stop at a failure, too. Exit code 5
    # (some records are bad) is none: a busy machine may keep a laboratory of real time from a slot.
    stop = pathlib.Path(folder) / ".stop"
    stop.write_text("set -o pipefail; trap 'status=$?; [ $status = 5 ] || exit $status' ERR\n", encoding="utf-8")
    environment = {**os.environ, "BASH_ENV": str(stop), "PATH": sys.argv[1] + os.pathsep + os.environ["PATH"]}
    run = subprocess.run(["bash", "-v"], input="".join(blocks) + f"echo '{LAST}'\n", cwd=folder, env=environment,
                         stdout=subprocess.PIPE, text=True)
sys.stdout.write(run.stdout)
sys.exit(run.returncode or LAST not in run.stdout.splitlines())
