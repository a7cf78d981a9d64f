#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests the pictures in .readme/.

`tests/pictures.py texts_are_current BIN_DIR` checks that charts contain only strings from the current scripts and model
names from the current programs. It also checks that page.png and page.webp contain only headings and buttons of the
current page. `tests/pictures.py texts_do_not_overlap_lines` checks that the labels in a sketch do not overlap lines."""
import ast
import pathlib
import re
import subprocess
import sys
import unittest

root = pathlib.Path(__file__).resolve().parent.parent
pictures = root / ".readme"
FROZEN = ("bound.svg", "fidelity.svg")
SKETCHES = ("setup.svg", "wiring.svg", "boards.svg")


def patterns_of(source):
    """Returns regular expressions that match the string literals and f-strings of a Python source file."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) < 100:
            found.add(re.escape(node.value.strip(", ")))
        elif isinstance(node, ast.JoinedStr):
            parts = [re.escape(p.value) if isinstance(p, ast.Constant) else ".+" for p in node.values]
            if re.search("[a-z]", "".join(p for p in parts if p != ".+")):
                found.add("".join(parts))
    return found


def models():
    """Returns regular expressions that match the models listed by `echofuse-recon train --help`. For example,
    "mlp[-N]" becomes mlp(-\\d+)*."""
    help_text = subprocess.run([pathlib.Path(sys.argv[2]) / "echofuse-recon", "train", "--help"], capture_output=True,
                               text=True, check=True, env={"COLUMNS": "1000"}).stdout
    listed = re.search(r"--model TEXT +kind of model, one of: (.*), or auto", help_text)[1]
    return {re.escape(re.match("[a-z-]+", name)[0]) + (r"(-\d+)*" if "[" in name else "") for name in listed.split(", ")}


class Names(unittest.TestCase):
    def test_charts_contain_only_texts_of_the_current_scripts_and_programs(self):
        sources = [root / "scripts/make_pictures", *(root / "recon/python/echofuse").rglob("*.py")]
        known = set().union(models(), *(patterns_of(path.read_text()) for path in sources))
        known |= set(map(re.escape, re.findall(r"^\| [`*]+([^`*]+)", (root / "recon/RESULTS.md").read_text(), re.M)))
        known |= {r"[-−]?[\d.,  ]+°?", r"\$\\mathdefault\{.*\}\$", r"(letter|object):\w+", "two_people"}  # labels of the simulator
        known = re.compile("|".join(f"(?:{one})" for one in known))
        for path in sorted(pictures.glob("*.svg")):
            if path.name in (*FROZEN, *SKETCHES):
                continue
            texts = set(re.findall("<!-- (.*?) -->", path.read_text()))
            unknown = [text for text in texts if not known.fullmatch(text)
                       and not all(known.fullmatch(part) for part in text.split(", "))]
            with self.subTest(path.name):
                self.assertGreater(len(texts), 3)
                self.assertEqual(unknown, [], "older than the names it shows: scripts/make_pictures")

    def test_page_pictures_contain_only_texts_of_the_current_page(self):
        page = "".join(path.read_text() for pattern in ("*.html", "*.js") for path in (root / "recon/web").glob(pattern))
        for name in ("page.png", "page.webp"):
            shown = re.search(rb"names: ([^<\x00]*);", (pictures / name).read_bytes())
            self.assertTrue(shown, f"{name} does not state its names: scripts/make_pictures --only page")
            names = shown[1].decode().split(", ")
            self.assertGreater(len(names), 5, name)
            self.assertEqual([one for one in names if one not in page], [], f"{name}: older than the names it shows")

    def test_every_picture_is_used_in_a_manual(self):
        texts = "".join(path.read_text() for path in root.glob("**/*.md") if "build" not in path.parts)
        self.assertEqual([p.name for p in pictures.iterdir() if f".readme/{p.name}" not in texts], [])


CROSSED = """const out = [], box = t => t.getBoundingClientRect();
const texts = [...document.querySelectorAll('text')].map(t => [t.textContent, box(t)]);
for (const line of document.querySelectorAll('line, path, circle, ellipse, polyline')) {
  if (getComputedStyle(line).stroke === 'none') continue;
  const at = line.getScreenCTM(), length = line.getTotalLength();
  for (let s = 0; s <= length; s += 1) {
    const p = line.getPointAtLength(s).matrixTransform(at);
    const hit = texts.find(([, b]) => p.x > b.left + 1 && p.x < b.right - 1 && p.y > b.top + 2 && p.y < b.bottom - 3);
    if (hit) { out.push(hit[0] + ' across ' + line.outerHTML); break; }
  }
}
return out;"""


class Lines(unittest.TestCase):
    def test_no_text_of_a_sketch_overlaps_a_line(self):
        import chromium
        browser = chromium.start()
        self.addCleanup(browser.quit)
        for name in SKETCHES:
            with self.subTest(name):
                browser.get((pictures / name).as_uri())
                self.assertEqual(browser.execute_script(CROSSED), [])


unittest.main(argv=[sys.argv[0], {"texts_are_current": "Names", "texts_do_not_overlap_lines": "Lines"}[sys.argv[1]]])
