#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that mistyped commands print the listed message and return the listed exit code, which their help must list."""
import functools
import pathlib
import re
import shlex
import struct
import subprocess
import sys
import tempfile

from case import bin_dir, source
import fixtures

# Each line contains a command, the expected exit code, and a string that the output must contain.
TABLE = """
recon trian | 2 | trian: no such command; the most similar name is train
recon -q trian x | 2 | trian: no such command; the most similar name is train
recon help train | 0 | train a model on one or more runs
recon train x --otu y | 2 | --otu: no such option; the most similar name is --out
recon evaluate nomodel norun | 1 | nomodel: No such file or directory; expected a model file
recon compare three.toml | 1 | three.toml: expected columns record, name and iou, as written by evaluate --per-record
recon train x --out m --model factorisd | 2 | factorisd
recon train x --out m --set epoch=3 | 3 | --set epoch=3: unknown key; no similar name
acquire run --cont 3 | 2 | --cont: no such option; the most similar name is --count
acquire run --count 0 | 2 | --count: Value 0: expected a positive number
acquire run --count 1e30 | 2 | --count = 1e30: expected a number
acquire run --meta x | 3 | no configuration
acquire config check --config TEMPLATE | 3 | lab.toml:39:1: radar.cli: still contains the template's XXXXXXXX; echofuse-acquire devices prints
acquire | 2 | a command is required
acquire lst | 2 | lst: no such command; the most similar name is list
sim dataset --otu x | 2 | --otu: no such option; the most similar name is --out
sim dataset --records 1e30 --out x | 2 | --records: Value 1e30 not in range 0 to 10000000
sim dataset --out x --set spd_bins=3 | 3 | unknown key; the most similar known name is "bins"
sim dataset --out x --set reflector=3 | 3 | unknown key; the most similar known name is "reflector_z_m"
sim lab --bogus -- ls --foo | 2 | --bogus: no such option; --help lists them
sim dataset --out x --like nofile | 3 | nofile
view --modle m x | 2 | --modle: no such option; the most similar name is --model
view | 2 | RUN is required
acquire config check --config three.toml | 3 | three.toml:2:13: not TOML
recon train dark.sqlite --out m | 1 | dark.sqlite: no record has a depth map; training needs the depth camera
recon train seen.sqlite --out m.safetensors --from nomodel | 1 | nomodel: No such file or directory; expected a model file
recon train seen.sqlite --out seen.sqlite | 2 | seen.sqlite
recon train seen.sqlite --out m --set doubtful=log | 3 | expected
recon train seen.sqlite --out m --set lossy=log | 3 | expected
recon reconstruct seen.sqlite seen.sqlite --out maps | 1 | seen.sqlite: is a run; expected a model file
recon reconstruct nomodel seen.sqlite --out maps --format gif | 2 | --format: gif not in {colour,mm,ply,npy,foreground,uncertainty}
recon evaluate nomodel seen.sqlite --rows test | 2 | --rows requires --maps
recon --threads many train x --out m | 2 | --threads
sim dataset --out seen.sqlite --records 4 | 1 | seen.sqlite: exists
sim dataset --out x --records 4 --people 1 | 2 | --records 4 differs from 1, the sum of the other record counts
sim lab --scene preson | 2 | --scene: preson not in {person,letter,mixed,
sim lab --dir . | 2 | contains files that do not belong to a laboratory
sim lab --dir new --hold 3s | 2 | --hold
acquire run --model nomodel | 2 | --model requires --view
acquire run --view --model nomodel | 2 | --model nomodel: no such file
acquire run --duration 5 | 2 | --duration: expected numbers with units, e.g. 2h
acquire run --count 3 --duration 5s | 2 | --count cannot be combined with --duration
acquire run --duration 99999999999h | 2 | --duration: expected at most 87660h (ten years)
acquire calibrate --distance -1 | 2 | --distance: Value -1 not in range 0.1 to 100
acquire calibrate --distance nan | 2 | --distance: nan: expected a number
recon evaluate x y --range-offset -inf | 2 | --range-offset
acquire calibrate --distance 1m | 2 | --distance: 1m: expected a number from 0.1 to 100, without a unit
sim dataset --out x --set background=200 | 3 | "corridor"; there is another key "background_counts"
acquire calibrate --reflector front | 2 | --reflector: front not in {detector,each}
acquire calibrate --side right --check | 2 | --side
export seen.sqlite --to x.txt | 2 | --to x.txt: expected NAME.h5 or NAME.nc, or NAME.csv with --record N
acquire info dark.toml | 1 | dark.toml
recon | 2 | subcommand
recon train --out m | 2 | run
recon train x --out m --inputs sonar | 2 | sonar
recon train seen.sqlite --out no/such/m | 6 | no/such/m
recon evaluate three.toml seen.sqlite | 1 | three.toml
recon evaluate nomodel seen.sqlite --surprise | 2 | --surprise
acquire config | 2 | subcommand is required
acquire run --out a --duration -1h | 2 | positive
acquire run --out a --config none.toml | 3 | none.toml: cannot read
acquire devices --config none.toml | 3 | none.toml: cannot read
acquire run --out a --config closed.toml --set depth.adress=openni: | 3 | depth.adress=openni:: unknown key; the most similar known name is "depth.address"
acquire run --out a --config closed.toml --set tdc.address=carrier:pigeon | 3 | carrier:pigeon
acquire run --out seen --config closed.toml | 1 | seen.sqlite: exists already
acquire run --out no/a --config closed.toml | 6 | its folder does not exist
acquire run --out a --config closed.toml --set tdc.policy="required" --set run.connect_timeout_s=0.2 | 4 | a required device delivered no data within 0.2 s
acquire run --out a --config closed.toml --meta room | 2 | --meta room: expected key=value
acquire run --out a --config closed.toml --meta irf_fwhm_ps=abc | 2 | --meta: expected a response
acquire run --out a --config closed.toml --meta irf_fwhm_ps=-3 | 2 | --meta: expected a response
acquire run --out a --config closed.toml --meta 'radar_taps=1 1 1' | 2 | --meta: expected a response
acquire run --out a --config closed.toml --meta a=1 --meta b=1 --meta a=2 | 2 | --meta a: given twice
acquire run --out a --config closed.toml --meta uuid=1 | 2 | --meta uuid=1: uuid is a name that echofuse uses itself
acquire run --out a --config closed.toml --meta status=1 | 2 | status is a name that echofuse uses itself
acquire run --out a --config closed.toml --meta spd_offset_m=1 | 2 | spd_offset_m is a name that echofuse uses itself
acquire run --out a --config closed.toml --meta detector_dead_time_ps=1 | 2 | detector_dead_time_ps is a name that echofuse uses itself
acquire run --out a --config closed.toml --meta _NCProperties=1 | 2 | _NCProperties is a name that echofuse uses itself
sim dataset --out x --people 0 --letters 0 | 2 | no records
sim dataset --out x --set irf_fwmh_ps=3 | 3 | irf_fwhm_ps
sim dataset --out x --set irf_fwhm_ps=-3 | 3 | a number from 0.1
sim dataset --out x --set radar_psf=kaiser | 3 | blackman
sim dataset --out x --set target_z_min_m=4.5 | 3 | target_z_min_m
sim dataset --out x --config none.toml | 3 | none.toml
sim dataset --out x --config three.toml | 3 | three.toml:2:
sim dataset --out three.toml --records 1 | 1 | exists already
sim dataset --out no/such/x --records 1 | 6 | no/such/x: its folder does not exist
recon evaluate seen.sqlite swapped.safetensors | 1 | seen.sqlite: is a run; expected a model file
bench run --version | 0 | echofuse-bench 0
view seen.sqlite --model seen.sqlite | 1 | seen.sqlite: is a run; expected a model file
export --version | 0 | echofuse-export 
bench --version | 0 | echofuse-bench 
bench stability --help | 0 | default: nearest mean-shape
bench run --help | 0 | bench-runs)
acquire info --version | 0 | echofuse-acquire 
recon --version | 0 | , matrix
sim | 2 | A subcommand is required
sim --version | 0 | echofuse-sim 
sim dataset --help | 0 | --two-people
report --version | 0 | echofuse-report 
acquire annotate seen.sqlite | 2 | expected either TEXT or --label TEXT
acquire list nofolder | 1 | nofolder
acquire devices --config closed.toml | 4 | Connection refused; is its bridge running? Start /
"""

@functools.cache
def stated_codes(program, *command):
    """Returns the exit codes listed in the help of a command, or all exit codes if the help lists none."""
    text = fixtures.outcome(f"echofuse-{program}", *command, "--help").stdout
    found = re.search(r"^exit codes:(.*(?:\n .*)*)", text, re.M)
    return set(re.findall(r"(?:^|[ ,])(\d+) [a-z]", found[1])) if found and "COMMAND" not in found[1] else set("0123456")

faults = []
for program, command, wanted in (("acquire", ("run",), "0 1 2 3 4 5 6 130"), ("acquire", ("list",), "0 1 2 3"),
                                 ("recon", ("evaluate",), "0 1 2 6 130"), ("view", (), "0 1 2"), ("export", (), "0 1 2 5 6 130")):
    if stated_codes(program, *command) != set(wanted.split()):
        faults.append(f"{program} {command}: --help lists {sorted(stated_codes(program, *command))}, expected {wanted}")
bridges = source / "scripts/bridges"
for bridge in (bridges / f"{name}.py" for name in ("timetagger", "orbbec", "realsense", "tmf8820", "example")):
    for word, says in (("--version", f"{bridge.name} "), ("--help", "exit codes: 0 ok, 1 failed, 2 usage, 4 device")):
        done = subprocess.run([sys.executable, bridge, word], capture_output=True, text=True)
        if done.returncode or says not in done.stdout:
            faults.append(f"{bridge.name} {word}: {done.stdout[-200:]}{done.stderr}")
with tempfile.TemporaryDirectory() as folder:
    written = pathlib.Path(folder)
    (written / "three.toml").write_text("[run]\nwindow_s = three\n")
    (written / "closed.toml").write_text('[tdc]\naddress = "bridge:tcp://127.0.0.1:9"\n')
    (written / "dark.toml").write_text("")
    (written / "swapped.safetensors").write_bytes(struct.pack("<Q", 2) + b"{}")
    fixtures.program("echofuse-sim", "dataset", "-q", "--out", written / "seen.sqlite", "--records", 12)
    fixtures.changed(written / "seen.sqlite", written / "dark.sqlite", "no camera data")
    for line in TABLE.strip().splitlines():
        words, code, says = (part.strip() for part in line.split(" | "))
        template = bin_dir.parent / "share/echofuse/lab.toml"
        program, *rest = shlex.split(words.replace("TEMPLATE", str(template)))
        environment = {"HOME": folder, "PATH": "/usr/bin:/bin"}
        done = fixtures.outcome(f"echofuse-{program}", *rest, cwd=folder, timeout=120, env=environment)
        said = done.stdout + done.stderr
        command = re.match(r"(?:config (?:check|show)|[a-z]+|)", " ".join(rest))[0] if program in ("acquire", "recon", "sim", "bench") else ""
        if code not in stated_codes(program, *command.split()):
            faults.append(f"{words}: its --help does not list exit code {code}")
        if done.returncode != int(code) or says not in said:
            faults.append(f"{words}: {done.returncode} (expected {code}): {said[:200]}")
        if code != "0" and max(map(len, said.splitlines())) > 300:
            faults.append(f"{words}: a line of more than 300 characters")
print("\n".join(faults) or "passed")
sys.exit(bool(faults))
