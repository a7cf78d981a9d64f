#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/system/slips.py BIN_DIR: slips of the finger at the command line: each is answered by its text and exit code."""
import pathlib
import subprocess
import sys
import tempfile

bin_dir = pathlib.Path(sys.argv[1]).resolve()
# command | exit code | what it says
TABLE = """
recon trian | 2 | trian: no such command; the nearest is train
recon help train | 0 | fit a model to runs
recon --help | 0 | evaluate
recon train x --otu y | 2 | --otu: no such option; the nearest is --out
recon train nofile --out m | 1 | nofile: No such file or directory; expected a run file
recon evaluate nomodel norun | 1 | nomodel: No such file or directory; expected a model file
recon train x --out m --model factorisd | 2 | factorisd
recon train x --out m --set epoch=3 | 3 | --set epoch=3: unknown key, and none is like it
recon study paretto | 2 | paretto: no such command; the nearest is pareto
acquire run --cont 3 | 2 | --cont: no such option; the nearest is --count
acquire run --uot x | 2 | --uot: no such option; the nearest is --out
acquire run --count 0 | 2 | --count: Value 0: expected a positive number
acquire run --count 1e30 | 2 | --count = 1e30: expected a number
acquire run --meta x | 3 | no configuration
acquire config check --config TEMPLATE | 3 | radar.cli still has the template's XXXXXXXX; echofuse-acquire devices prints
acquire | 2 | a command is required
acquire lst | 2 | lst: no such command; the nearest is list
acquire info nofile | 1 | nofile
sim dataset --otu x | 2 | --otu: no such option; the nearest is --out
sim dataset --records 1e30 --out x | 2 | --records: Value 1e30 not in range 0 to 10000000
sim dataset --out x --set spd_bins=3 | 3 | unknown key; the nearest known one is "bins"
sim dataset --out x --set reflector=3 | 3 | unknown key, and none is like it
sim lab --duration -1 | 2 | --duration: Value -1: expected a positive number
sim lab --bogus -- ls --foo | 2 | --bogus: no such option; --help lists them
sim dataset --out x --like nofile | 3 | nofile
view --recrod 3 x | 2 | --recrod: no such option; the nearest is --record
view | 2 | RUN is required
view --text nofile | 1 | nofile: no run yet
acquire config check --config three.toml | 3 | three.toml:2:13: not TOML
acquire devices --config closed.toml | 4 | Connection refused; is the bridge started? echofuse-bridge-timetagger
"""

faults = []
with tempfile.TemporaryDirectory() as folder:
    written = pathlib.Path(folder)
    (written / "three.toml").write_text("[run]\nwindow_s = three\n")
    (written / "closed.toml").write_text('[tdc]\naddress = "bridge:tcp://127.0.0.1:9"\n')
    for line in TABLE.strip().splitlines():
        words, code, says = (part.strip() for part in line.split(" | "))
        template = bin_dir.parent / "share/echofuse/lab.toml"
        program, *rest = words.replace("TEMPLATE", str(template)).split()
        done = subprocess.run([bin_dir / f"echofuse-{program}", *rest], cwd=folder, capture_output=True, text=True, timeout=30,
                              env={"HOME": folder, "PATH": "/usr/bin:/bin"})
        said = done.stdout + done.stderr
        if done.returncode != int(code) or says not in said:
            faults.append(f"{words}: {done.returncode} (wanted {code}): {said[:200]}")
        if code != "0" and max(map(len, said.splitlines())) > 300:
            faults.append(f"{words}: a line of more than 300 characters")
print("\n".join(faults) or "each slip has its answer")
sys.exit(bool(faults))
