#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that scripts/manual --api documents every public name and fails if a public name has no description."""
import shutil
import subprocess
import sys

import numpy as np

from case import Case, main, source
import echofuse
import fixtures

missing = [name for name in ("doxygen", "sphinx-build") if shutil.which(name) is None]
if missing:
    print(f"skipped: {' and '.join(missing)} not installed (./scripts/setup --tests)")
    sys.exit(77)


class ApiPages(Case):
    def manual(self, tree):
        return subprocess.run([tree / "scripts/manual", "--api", self.dir / "out"], capture_output=True, text=True, timeout=240)

    def copy(self):
        tree = self.dir / "tree"
        for name in ("scripts/manual", "recon/include", "recon/examples", "recon/python"):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if (source / name).is_dir() else shutil.copy)(source / name, tree / name)
        return tree

    def test_api_manual_documents_every_public_name(self):
        done = self.manual(source)
        self.assertEqual((done.returncode, done.stdout + done.stderr), (0, ""))
        index = (self.dir / "out/index.html").read_text()
        for page in ("cpp/index.html", "python/index.html"):
            self.assertIn(page, index)
            self.assertTrue((self.dir / "out" / page).exists())
        pages = "".join(path.read_text(encoding="utf-8") for path in (self.dir / "out/cpp").glob("*.html"))
        for name in ("lateral_interval_90_m", "for_each", "spd_axis", "MapGrid", "api_version", "follow"):
            self.assertIn(name, pages)
        page = (self.dir / "out/python/runs_and_models.html").read_text(encoding="utf-8")
        run = echofuse.open(fixtures.plates("nine_zones"))
        objects = {"": echofuse, "Run.": run, "Record.": run[0], "Axis.": run.axes["spd"],
                   "Maps.": echofuse.Maps(run.maps(), run.index, np.ones(64), np.ones(64), [""], 0.55)}
        names = [f"{prefix}{name}" for prefix, one in objects.items() for name in (dir(one) if prefix else echofuse.__all__)
                 if not name.startswith("_") and name != "metrics"]
        self.assertEqual([name for name in names if f'id="echofuse.{name}"' not in page], [])

    def test_api_manual_refuses_an_undocumented_cpp_name(self):
        tree = self.copy()
        header = tree / "recon/include/echofuse/run.hpp"
        text = header.read_text()
        header.write_text(text.replace("class Run {\n public:\n", "class Run {\n public:\n  int secret() const;\n"))
        done = self.manual(tree)
        self.assertEqual(done.returncode, 1)
        self.assertIn("Member secret() const (function) of class echofuse::Run is not documented", done.stderr)

    def test_api_manual_refuses_an_undocumented_python_name(self):
        tree = self.copy()
        module = tree / "recon/python/echofuse/runs/axis.py"
        module.write_text(module.read_text().replace("    @property\n    def values", "    hidden: int = 0\n\n    def secret(self) -> None:\n        pass\n\n    @property\n    def values"))
        # Only one class is included, so that the manual is built quickly.
        (tree / "recon/python/api/index.rst").write_text("echofuse\n========\n\n.. autoclass:: echofuse.Axis\n")
        done = self.manual(tree)
        self.assertEqual(done.returncode, 1)
        self.assertIn("echofuse.Axis.secret has no docstring", done.stderr)
        self.assertIn("echofuse.Axis.hidden has no docstring", done.stderr)


main(ApiPages)
