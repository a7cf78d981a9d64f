#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/python/octave.py BIN_DIR: runs the MATLAB example of recon/PYTHON.md in Octave, on an exported run. Octave in Debian 12
has no h5read, so a function based on h5py replaces it. Octave's load() must also read the complete file."""
import contextlib
import pathlib
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile

octave = shutil.which("octave-cli")
if not octave:
    print("skipped: octave is not installed (./scripts/setup --all)")
    sys.exit(77)
bin_dir = pathlib.Path(sys.argv[1])
text = (pathlib.Path(__file__).resolve().parents[2] / "recon/PYTHON.md").read_text(encoding="utf-8")
# The commands plot and imagesc are removed, because they need a display.
example = re.sub(r"^(plot|imagesc).*", "", re.search(r"```matlab\n(.*?)```", text, re.S)[1], flags=re.M)
h5read = """function out = h5read(file, path)
  [status, text] = system(sprintf('/usr/bin/python3 h5read.py %s %s', file, path));
  head = strsplit(strtrim(text));
  f = fopen('h5read.bin'); values = fread(f, Inf, ['*' head{1}]); fclose(f);
  out = reshape(values, [cellfun(@str2double, head(2:end)) 1]);  % Reverses the order of the dimensions, as h5read of MATLAB does.
end
"""
by_h5py = """import sys, h5py
a = h5py.File(sys.argv[1])[sys.argv[2]][:]
a.tofile('h5read.bin')
print({'f4': 'single', 'f8': 'double'}.get(a.dtype.str[1:], a.dtype.name), *a.shape[::-1])
"""
if subprocess.run(["/usr/bin/python3", "-c", "import h5py"], stderr=subprocess.DEVNULL).returncode:
    print("skipped: python3-h5py is not installed (./scripts/setup --tests)")
    sys.exit(77)
with tempfile.TemporaryDirectory(prefix="octave-") as name:
    folder = pathlib.Path(name)
    run = folder / "monday.sqlite"
    subprocess.run([bin_dir / "echofuse-sim", "dataset", "-q", "--out", run, "--records", "12"], check=True)
    subprocess.run([bin_dir / "echofuse-export", run, "--to", folder / "monday.h5"], check=True)
    (folder / "h5read.m").write_text(h5read)
    (folder / "h5read.py").write_text(by_h5py)
    (folder / "manual.m").write_text(example + "\nprintf('%d ', size(spd), sum(spd(:)), ps(2) - ps(1), size(depth_m)); printf('\\n');\n"
                                     "run = load('monday.h5');\nprintf('%d ', size(run.entry.data.spd)); printf('%s\\n', run.entry.status);\n")
    said = subprocess.run([octave, "--no-gui", "-q", "manual.m"], cwd=folder, text=True, capture_output=True, timeout=100)
    with contextlib.closing(sqlite3.connect(run)) as db:
        counts = sum(int.from_bytes(blob[i:i + 4], "little") for blob, in db.execute("SELECT spd FROM record") for i in range(0, len(blob), 4))
        bins, step = db.execute("SELECT count, step FROM axis WHERE name = 'spd'").fetchone()
wanted = f"{bins} 12 {counts} {step:g} 64 64 12 {bins} 12 complete"
if said.returncode or wanted not in " ".join(said.stdout.split()):
    sys.exit(f"octave: expected {wanted}, got {said.stdout} {said.stderr}")
