#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that scripts/manual builds all pages, with links and anchors that exist, and documents every public name."""
import html
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import unittest
import urllib.parse

import numpy as np

from case import Case, SharedCase, bin_dir, source
import echofuse
import fixtures

missing = [name for name in ("doxygen", "sphinx-build") if shutil.which(name) is None]
missing += [name for name in ("myst_parser",) if importlib.util.find_spec(name) is None]
if missing:
    print(f"skipped: {' and '.join(missing)} not installed (./scripts/setup --tests)")
    sys.exit(77)


def broken_links(folder):
    """Returns the links to files and names that do not exist, and the number of links to names."""
    pages = {path: path.read_text(encoding="utf-8") for path in folder.rglob("*.html") if "api" not in path.parts}
    names = {path: set(re.findall(r'\b(?:id|name)="([^"]+)"', page)) for path, page in pages.items()}
    broken, named = [], 0
    for path, page in pages.items():
        for link in map(html.unescape, re.findall(r'\b(?:href|src)="([^"]+)"', page)):
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            named += bool(parts.fragment)
            if not target.exists() or parts.fragment and parts.fragment not in names.get(target, {parts.fragment}):
                broken.append(f"{path.relative_to(folder)}: {link}")
    return broken, named


class ApiPages(Case):
    def manual(self, tree):
        return subprocess.run([tree / "scripts/manual", "--api", self.dir / "out"], capture_output=True, text=True, timeout=240)

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

    def test_api_manual_refuses_an_undocumented_name(self):
        names = "scripts/manual", "recon/include", "recon/examples", "recon/python"
        for file, before, secret, faults in (
                ("recon/include/echofuse/run.hpp", "class Run {\n public:\n", "  int secret() const;\n",
                 ["Member secret() const (function) of class echofuse::Run is not documented"]),
                ("recon/python/echofuse/runs/axis.py", "\n    @property\n    def values",
                 "\n    hidden: int = 0\n\n    def secret(self) -> None:\n        pass\n",
                 ["echofuse.Axis.secret has no docstring", "echofuse.Axis.hidden has no docstring"])):
            tree = self.dir / file.split("/")[1]
            for name in names:
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                (shutil.copytree if (source / name).is_dir() else shutil.copy)(source / name, tree / name)
            # Only one class is included, so that the manual is built quickly.
            (tree / "recon/python/api/index.rst").write_text("echofuse\n========\n\n.. autoclass:: echofuse.Axis\n")
            text = (tree / file).read_text()
            self.assertEqual(text.count(before), 1)
            (tree / file).write_text(text.replace(before, before + secret if file.endswith("hpp") else secret + before))
            done = self.manual(tree)
            self.assertEqual((done.returncode, [fault for fault in faults if fault not in done.stderr]), (1, []), done.stderr)


class Manual(SharedCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.out = cls.dir.resolve() / "out"
        cls.done = subprocess.run([source / "scripts/manual", "--bin", bin_dir, cls.out], capture_output=True, text=True, timeout=240)

    def test_manual_builds_without_warnings(self):
        self.assertEqual((self.done.returncode, self.done.stdout + self.done.stderr), (0, ""))

    def test_links_and_anchors_of_all_pages_exist(self):
        broken, named = broken_links(self.out)
        self.assertEqual(broken, [])
        self.assertGreater(named, 300)

    def test_search_index_contains_settings_verdicts_and_commands(self):
        text = (self.out / "searchindex.js").read_text(encoding="utf-8")
        index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
        for word, page in (("lossy_shar", "reference/settings"), ("satur", "acquire/verdicts"), ("countdown", "reference/programs/echofuse-acquire-run")):
            found = index["terms"].get(word, [])
            self.assertIn(page, [index["docnames"][number] for number in (found if isinstance(found, list) else [found])])
        self.assertIn("reference/programs/echofuse-acquire-calibrate", index["docnames"])


unittest.main(argv=sys.argv[:1] + sys.argv[2:])
