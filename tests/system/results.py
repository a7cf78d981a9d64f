#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Compares the results in the manuals and pictures with recon/results/*.csv, from which they are made."""
import hashlib
import importlib.machinery
import importlib.util
import pathlib
import re
import sys
import unittest

root = pathlib.Path(__file__).resolve().parents[2]
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


unittest.main(argv=sys.argv[:1])
