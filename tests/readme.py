#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Runs the ```sh blocks of a manual in order, in a single shell: `readme.py BIN FILE.md [--slow]`.

The current folder contains only scripts/ and config/, and the programs are in PATH. Blocks that follow
`<!-- not run: reason -->` are skipped. Blocks that follow `<!-- slow -->` are skipped unless --slow is given. The test ends
at the first command that fails."""
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
    # The shell reads the blocks from a pipe, because bash would read ahead if the blocks were in a file.
    # A shell started by a command (`echofuse-sim lab -- bash`) reads the following lines from the same pipe, as it
    # would from a terminal.
    # Because of BASH_ENV, shells that a command starts also exit at the first failure.
    # Exit code 5 (some bad records) is accepted, because the simulated laboratory may miss slots on a busy machine.
    # Exit code 4 (a device did not answer) is accepted if the simulated laboratory did not get enough processor time
    # (waiting.py).
    stop = pathlib.Path(folder) / ".stop"
    starved = f"/usr/bin/python3 {pathlib.Path(__file__).resolve().with_name('waiting.py')}"
    stop.write_text(f"""set -o pipefail
trap 'status=$?; [ $status = 5 ] || {{ [ $status = 4 ] && {starved} $PPID; }} || exit $status' ERR
""", encoding="utf-8")
    environment = {**os.environ, "BASH_ENV": str(stop), "PATH": sys.argv[1] + os.pathsep + os.environ["PATH"]}
    run = subprocess.run(["bash", "-v"], input="".join(blocks) + f"echo '{LAST}'\n", cwd=folder, env=environment,
                         stdout=subprocess.PIPE, text=True)
sys.stdout.write(run.stdout)
sys.exit(run.returncode or LAST not in run.stdout.splitlines())
