#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/recon/compare_torch.py BIN_DIR: scripts/compare_torch.py on a small data set. Skipped (77) where
PyTorch is not installed."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

bin_dir = pathlib.Path(sys.argv[1]).resolve()
script = pathlib.Path(__file__).resolve().parents[2] / "scripts/compare_torch.py"
python = "/usr/bin/python3"  # Debian's: its packages are what the script asks for


def compare(*words, **how):
    return subprocess.run([python, script, *map(str, words), "--bin", bin_dir], capture_output=True, text=True, **how)


with tempfile.TemporaryDirectory(prefix="echofuse-") as name:
    folder = pathlib.Path(name)
    (folder / "absent").mkdir()
    (folder / "absent/torch.py").write_text("raise ImportError(\"No module named 'torch'\")\n")
    absent = compare("m", "r", env=os.environ | {"PYTHONPATH": str(folder / "absent")})
    assert absent.returncode == 1, absent
    assert absent.stderr.count("\n") == 1 and "apt-get install python3-torch" in absent.stderr, absent.stderr

    # Found, not imported: that takes seconds.
    find = "import importlib.util as u, sys; sys.exit(not all(map(u.find_spec, ('torch', 'h5py', 'numpy'))))"
    if subprocess.run([python, "-c", find], capture_output=True).returncode != 0:
        print("PyTorch or h5py is not installed")
        sys.exit(77)

    run, model = folder / "run.sqlite", folder / "m.h5"
    subprocess.run([bin_dir / "echofuse-sim", "dataset", "--out", run, "--records", "300"], check=True,
                   capture_output=True)
    subprocess.run([bin_dir / "echofuse-recon", "train", run, "--out", model, "-q", "--model", "mlp", "--hidden", "64,32", "--epochs", "6",
                    "--batch", "16", "--radar-bin", "0.5", "--patience", "6", "--test-share", "0.2"], check=True)
    both = compare(model, run, "--threads", 1, "--keep", folder / "kept")
    assert both.returncode == 0, both.stderr
    print(both.stdout)
    rows = {line.split()[0]: [float(n) for n in re.findall(r"[\d.]+", line)] for line in both.stdout.splitlines()[1:3]}
    assert set(rows) == {"echofuse", "PyTorch"}, both.stdout
    ours, theirs = rows["echofuse"], rows["PyTorch"]
    assert all(value > 0 for row in rows.values() for value in row[4:]), both.stdout
    # The same network on the same records: other random numbers move the error by less than 2 %.
    assert abs(ours[4] - theirs[4]) < 0.02 * ours[4], both.stdout
    assert "60 held-out records; 300 in all" in both.stdout, both.stdout
    # PyTorch's weights, in our file, are not ours.
    assert (folder / "kept/ours.h5").read_bytes() != (folder / "kept/torch.h5").read_bytes()
