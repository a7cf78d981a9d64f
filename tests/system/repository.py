#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Tests the repository's scripts and results: files of the Debian package without building it, the exit status of scripts/test
and its list of skipped tests with a substitute for ctest, and the results in the manuals and pictures, which must be those of
recon/results/*.csv."""
import ast
import hashlib
import importlib.machinery
import importlib.util
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

from case import source as root
from fixtures import executable

debian = root / "scripts/debian"
# dh_compress(1) does not compress files of these types. The option -X of dh_compress excludes further files.
NEVER_COMPRESSED = {".png", ".jpg", ".svg"}


class Package(unittest.TestCase):
    def test_package_lists_recommended_packages_and_architectures(self):
        control = (debian / "control").read_text()
        package = control.partition("\nPackage: echofuse\n")[2].partition("\n\n")[0]
        self.assertIn("\nRecommends: python3-numpy\n", package)
        self.assertEqual(set(re.findall("Architecture: (.*)", control)), {"amd64 arm64", "all"})

    def test_package_does_not_compress_pictures_and_manuals(self):
        left = {f".{end}" for end in re.findall(r"-X\.(\w+)", (debian / "rules").read_text())} | NEVER_COMPRESSED
        self.assertEqual([path.name for path in (root / ".readme").iterdir() if path.suffix not in left], [])
        self.assertIn(".md", left)

    def test_package_removal_stops_the_service(self):
        """The removal script deletes the bytecode of the bridges. It stops the service only when the package is
        removed."""
        for action, stops in (("remove", True), ("upgrade", False), ("deconfigure", False)):
            with tempfile.TemporaryDirectory() as name:
                folder = pathlib.Path(name)
                cache = folder / "usr/lib/x86_64-linux-gnu/echofuse/bridges/__pycache__"
                cache.mkdir(parents=True)
                (folder / "run/systemd/system").mkdir(parents=True)
                executable(folder / "deb-systemd-invoke", f'#!/bin/sh\necho "$@" >> {folder}/asked\n')
                script = (debian / "echofuse.prerm").read_text().replace(" /run/", f" {folder}/run/").replace(
                    " /usr/", f" {folder}/usr/")
                subprocess.run(["sh", "-c", script, "prerm", action], check=True,
                               env=os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"})
                asked = folder / "asked"
                self.assertEqual(asked.read_text() if asked.exists() else "", "stop echofuse-acquire.service\n" if stops else "")
                self.assertEqual(cache.exists(), not stops)


def run(status, output, ci):
    """Runs scripts/test in a temporary folder. A fake ctest prints `output` and exits with `status`."""
    with tempfile.TemporaryDirectory() as folder:
        tree = pathlib.Path(folder)
        (tree / "scripts/dev").mkdir(parents=True)
        shutil.copy(root / "scripts/test", tree / "scripts")
        shutil.copy(root / "scripts/dev/skipped.awk", tree / "scripts/dev")
        executable(tree / "scripts/setup", "#!/bin/sh\n")
        executable(tree / "scripts/build", "#!/bin/sh\n")
        executable(tree / "bin/ctest", f"#!/bin/sh\ncat <<'END'\n{output}\nEND\nexit {status}\n")
        environment = os.environ | {"PATH": f"{tree}/bin:{os.environ['PATH']}", "CI": ci}
        return subprocess.run([tree / "scripts/test"], env=environment, capture_output=True, text=True, timeout=60)


class SuiteScript(unittest.TestCase):
    def test_suite_script_returns_the_exit_status_and_fails_in_ci_if_a_skipped_test_gives_no_reason(self):
        passed = "100% tests passed, 0 tests failed out of 1"
        reason = "skipped: a.test: no reason given\n1 tests skipped, 0 checks not made"
        skipped = f"1/1 Test #1: a.test ....***Skipped\n{passed}"
        for code, output, ci, status, said in ((0, passed, "1", 0, ""), (8, passed, "", 8, ""), (0, skipped, "", 0, reason),
                                               (0, skipped, "1", 1, reason)):
            done = run(code, output, ci)
            self.assertEqual((done.returncode, done.stderr), (status, ""))
            self.assertIn(said, done.stdout)


loader = importlib.machinery.SourceFileLoader("make_tables", str(root / "scripts/make_tables"))
make_tables = importlib.util.module_from_spec(importlib.util.spec_from_loader("make_tables", loader))
sys.dont_write_bytecode = True
loader.exec_module(make_tables)
texts = {name: (root / name).read_text(encoding="utf-8") for name in make_tables.MANUALS}
files = {path.stem: path for path in sorted((root / "recon/results").glob("*.csv"))}
RESULT = r"(?<![\w.-])(?<!p < )\.\d{2,3}(?![\w.])|(?<![\w.-])\d+\.\d(?= ?(?:cm|,| to))"  # for example .610 or 3.1 cm


def numbers(text):
    return {float(number) for number in re.findall(r"(?<![\w.])\d*\.?\d+", text)}


class Results(unittest.TestCase):
    def test_tables_in_the_manuals_are_those_of_the_files(self):
        for name, text in texts.items():
            self.assertTrue(make_tables.written(text) == text, f"{name}: run scripts/make_tables")
        self.assertGreater(sum(text.count("<!-- table ") for text in texts.values()), 30)

    def test_a_changed_digit_in_a_manual_is_found(self):
        changed = re.sub(r"(?<=\| \.)\d(?=\d\d ± )", lambda digit: str((int(digit[0]) + 1) % 10), texts["README.md"], count=1)
        self.assertFalse(changed == texts["README.md"] or make_tables.written(changed) == changed)

    def test_all_tables_of_results_come_from_a_file(self):
        for name, text in texts.items():
            rows = re.findall(r"^\|.*\d ± .*|^\|.*\bIoU\b.*", make_tables.PLACE.sub("", text), re.M)
            self.assertEqual([row for row in rows if "`iou`" not in row], [], name)
        self.assertNotRegex(make_tables.PLACE.sub("", texts["recon/RESULTS.md"]), r"(?m)^\|")

    def test_each_file_states_its_measurement_and_is_used(self):
        used = {name for text in texts.values() for place in make_tables.PLACE.finditer(text) for name in place[2].split(" + ")}
        shown = {path.name: path.read_text() for path in (root / ".readme").glob("*.svg")}
        for name, path in files.items():
            facts = make_tables.read(name)[2]
            self.assertLessEqual({"date", "commit", "machine", "seeds"}, facts.keys(), name)
            self.assertTrue(name in (*used, "figures") or any(f"{name}.csv " in text for text in shown.values()), f"{name}.csv is not used")

    def test_charts_were_drawn_from_the_present_files(self):
        sources = {path.name: re.findall(r"<dc:source>([\w-]+)\.csv (\w+)</dc:source>", path.read_text())
                   for path in (root / ".readme").glob("*.svg")}
        self.assertLessEqual({"pareto.svg", "equal-inputs.svg"}, {name for name, source in sources.items() if source})
        for name, source in sources.items():
            for stem, drawn in source:
                self.assertEqual(hashlib.sha256(files[stem].read_bytes()).hexdigest(), drawn, f"{name}: run scripts/make_pictures")

    def test_figures_in_the_text_occur_in_a_file(self):
        """A section of RESULTS.md may contain figures of its own tables and of figures.csv, also rounded. Other manuals may
        contain those of their tables, or of all tables if they have none."""
        def known(names):
            values = numbers("\n".join(" ".join(row) for name in {*names, "figures"} for row in make_tables.read(name)[1]))
            return values | {round(value, digits) for value in values for digits in (1, 2)}

        checked = 0
        for manual, text in texts.items():
            for section in re.split(r"^(?=## )", text, flags=re.M) if manual == "recon/RESULTS.md" else [text]:
                names = [name for place in make_tables.PLACE.finditer(section) for name in place[2].split(" + ")]
                values = known(names or files)
                prose = re.sub(r"^```.*?^```$|`[^`]*`|^> .*?\n\n", "", make_tables.PLACE.sub("", section), flags=re.M | re.S)
                found = re.findall(RESULT, prose)
                self.assertEqual([one for one in found if float(one) not in values], [], f"{manual}: {section[:40]}")
                checked += len(found)
        self.assertGreater(checked, 100)


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
    help_text = subprocess.run([pathlib.Path(sys.argv[1]) / "echofuse-recon", "train", "--help"], capture_output=True,
                               text=True, check=True, env={"COLUMNS": "1000"}).stdout
    listed = re.search(r"--model TEXT +kind of model, one of: (.*), or auto", help_text)[1]
    return {re.escape(re.match("[a-z-]+", name)[0]) + (r"(-\d+)*" if "[" in name else "") for name in listed.split(", ")}


class Pictures(unittest.TestCase):
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


class Sketches(unittest.TestCase):
    def test_no_text_of_a_sketch_overlaps_a_line(self):
        import chromium
        browser = chromium.start()
        self.addCleanup(browser.quit)
        for name in SKETCHES:
            with self.subTest(name):
                browser.get((pictures / name).as_uri())
                self.assertEqual(browser.execute_script(CROSSED), [])


unittest.main(argv=sys.argv[:1] + sys.argv[2:])
