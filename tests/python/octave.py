#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/python/octave.py BIN_DIR: the example for MATLAB in recon/README.md, run by Octave on an exported run. Octave of
Debian 12 has no h5read; its load reads the same file, so a function h5read of four lines stands in for MATLAB's."""
import pathlib
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile

octave = shutil.which("octave-cli")
if not octave:
    print("skipped: octave is not installed")
    sys.exit(77)
bin_dir = pathlib.Path(sys.argv[1])
text = (pathlib.Path(__file__).resolve().parents[2] / "recon/README.md").read_text(encoding="utf-8")
example = re.search(r"```matlab\n(.*?)```", text, re.S)[1]
h5read = """function out = h5read(file, path)
  out = load('-hdf5', file);
  for name = strsplit(path(2:end), '/'), out = out.(name{1}); end
end
"""
with tempfile.TemporaryDirectory(prefix="octave-") as name:
    folder = pathlib.Path(name)
    run = folder / "monday.sqlite"
    subprocess.run([bin_dir / "echofuse-sim", "dataset", "-q", "--out", run, "--records", "12"], check=True)
    subprocess.run([bin_dir / "echofuse-acquire", "export", "-q", run, "--to", folder / "monday.h5"], check=True)
    (folder / "h5read.m").write_text(h5read)
    (folder / "example.m").write_text("graphics_toolkit('gnuplot'); figure('visible', 'off');\n" + example +
                                      "\nprintf('%d ', size(spd), sum(spd(:)), ps(2) - ps(1)); printf('\\n');\n")
    said = subprocess.run([octave, "--no-gui", "-q", "example.m"], cwd=folder, text=True, capture_output=True, timeout=100)
    db = sqlite3.connect(run)
    counts = sum(int.from_bytes(blob[i:i + 4], "little") for blob, in db.execute("SELECT spd FROM record")
                 for i in range(0, len(blob), 4))
    bins, step = db.execute("SELECT count, step FROM axis WHERE name = 'spd'").fetchone()
    db.close()
wanted = f"{bins} 12 {counts} {step:g}"
if said.returncode or wanted not in " ".join(said.stdout.split()):
    sys.exit(f"octave: expected {wanted}, got {said.stdout} {said.stderr}")
