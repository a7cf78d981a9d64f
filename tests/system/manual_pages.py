#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that scripts/manual builds all pages without warnings, that links and anchors of the pages exist, and that the
search index contains the pages."""
import html.parser
import importlib.util
import json
import shutil
import subprocess
import sys
import urllib.parse

from case import SharedCase, bin_dir, main, source

missing = [name for name in ("doxygen", "sphinx-build") if shutil.which(name) is None]
missing += [name for name in ("myst_parser",) if importlib.util.find_spec(name) is None]
if missing:
    print(f"skipped: {' and '.join(missing)} not installed (./scripts/setup --tests)")
    sys.exit(77)


class Page(html.parser.HTMLParser):
    """Collects the links and the names of an HTML page."""

    def __init__(self, path):
        super().__init__()
        self.links, self.names = [], set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.names |= {given[key] for key in ("id", "name") if given.get(key)}
        self.links += [given[key] for key in ("href", "src") if given.get(key)]


def broken_links(folder):
    """Returns the links to files and names that do not exist, and the number of links to names."""
    pages = {path: Page(path) for path in folder.rglob("*.html") if "api" not in path.parts}
    broken, named = [], 0
    for path, page in pages.items():
        for link in page.links:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            named += bool(parts.fragment)
            if not target.exists() or parts.fragment and target in pages and parts.fragment not in pages[target].names:
                broken.append(f"{path.relative_to(folder)}: {link}")
    return broken, named


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

    def test_a_removed_page_and_a_removed_heading_are_found(self):
        copy = self.out.parent / "copy"
        shutil.copytree(self.out, copy)
        (copy / "sim/index.html").unlink()
        verdicts = copy / "acquire/verdicts.html"
        verdicts.write_text(verdicts.read_text(encoding="utf-8").replace('id="verdicts"', ""), encoding="utf-8")
        broken = broken_links(copy)[0]
        self.assertTrue(any(link.endswith("sim/index.html") for link in broken))
        self.assertTrue(any(link.endswith("verdicts.html#verdicts") for link in broken))

    def test_search_index_contains_settings_verdicts_and_commands(self):
        text = (self.out / "searchindex.js").read_text(encoding="utf-8")
        index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
        for word, page in (("lossy_shar", "reference/settings"), ("satur", "acquire/verdicts"), ("countdown", "reference/programs/echofuse-acquire-run")):
            found = index["terms"].get(word, [])
            self.assertIn(page, [index["docnames"][number] for number in (found if isinstance(found, list) else [found])])
        self.assertIn("reference/programs/echofuse-acquire-calibrate", index["docnames"])


main(Manual)
