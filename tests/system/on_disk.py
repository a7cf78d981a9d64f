# SPDX-License-Identifier: MIT
"""Uses strace to check that output files have reached the disk when a program exits."""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

PACKAGE = pathlib.Path(__file__).resolve().parents[2] / "recon/python"
BIN = pathlib.Path(sys.argv[1]).resolve()
CALLS = "trace=fsync,fdatasync,rename,renameat,renameat2,link,linkat"
MOVED = re.compile(r'(?:rename|link)\w*\((?:AT_FDCWD\S*, )?"([^"]+)", (?:AT_FDCWD\S*, )?"([^"]+)".*\) = 0')


def traced(folder, *words):
    """Returns the system calls of a command as tuples of the kind of call and the path (or paths) used in the
    call."""
    log = folder / "strace"
    subprocess.run(["strace", "-f", "-y", "-s", "4096", "-e", CALLS, "-o", log, *map(str, words)], cwd=folder, check=True,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}"})
    out = []
    for line in log.read_text().splitlines():
        if found := re.search(r"f(?:data)?sync\(\d+<(.*)>\) += 0", line):
            out.append(("sync", found[1]))
        elif found := MOVED.search(line):
            out.append(("move", tuple(str(folder / path) for path in found.groups())))
    return out


def check(calls, place):
    """Checks that a file was renamed to `place`. There must be an fsync of the file before the rename, and an fsync
    of the folder after it."""
    moves = [k for k, (what, path) in enumerate(calls) if what == "move" and path[1] == str(place)]
    assert moves, f"{place}: no rename in {calls}"
    source = calls[moves[-1]][1][0]
    assert ("sync", source) in calls[:moves[-1]], f"{place}: no fsync of {source} before the rename"
    assert ("sync", str(place.parent)) in calls[moves[-1]:], f"{place}: no fsync of its folder after the rename"


def main():
    if not shutil.which("strace"):
        print("skipped: strace is not installed (./scripts/setup --tests)")
        sys.exit(77)
    python = ("import echofuse; maps, index = echofuse.load_maps('maps'); echofuse.save_maps('maps', maps, index);"
              "echofuse.save_maps('new', maps, index)")
    with tempfile.TemporaryDirectory() as made:
        folder = pathlib.Path(made).resolve()
        for command, files in (
                (("echofuse-sim", "dataset", "-q", "--records", 40, "--out", "a.sqlite"), "a.sqlite"),
                (("echofuse-recon", "train", "a.sqlite", "--model", "mean", "--out", "m.safetensors"), "m.safetensors"),
                (("echofuse-export", "a.sqlite", "--to", "a.h5"), "a.h5"),
                (("echofuse-report", "page", "--live", "a.sqlite"), "page/report.html"),
                (("echofuse-recon", "reconstruct", "m.safetensors", "a.sqlite", "--out", "maps", "--format", "npy,mm"),
                 "maps/maps.npy maps/run.txt maps/camera.json maps/000003_mm.png maps/records.csv"),
                (("env", f"PYTHONPATH={PACKAGE}", "/usr/bin/python3", "-c", python),
                 "maps/maps.npy maps/records.csv new/maps.npy new/records.csv")):
            calls = traced(folder, *command)
            for name in files.split():
                check(calls, folder / name)
            if "reconstruct" in command:
                last = max(k for k, call in enumerate(calls) if call == ("sync", str(folder / "maps/records.csv")))
                assert last > max(k for k, (what, _) in enumerate(calls) if what == "move"), "records.csv: no fsync at the end"


main()
