#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Compares names and defaults in the manuals with the programs. Each public name must have one meaning in C++, Python, JSON,
CSV and netCDF: the table of names in acquire/GLOSSARY.md must contain every name that at least two of these interfaces use."""
import inspect
import json
import pathlib
import re

import case
from case import bin_dir, source
import echofuse
import fixtures

texts = {path.relative_to(source): path.read_text(encoding="utf-8")
         for path in [source / "README.md", *(path for room in ("acquire", "drivers", "recon", "sim") for path in (source / room).rglob("*.md"))]}
sections = ("run", "tdc", "radar", "depth", "signal", "alert")
files = (".npy", ".toml", ".txt", ".dat", ".times", ".cpp", ".hpp")


def manual(name):
    return texts[pathlib.Path(name)]


def spans(text):
    return re.findall(r"`([^`]+)`", re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S))


def first_column(text):
    """Returns the names in the first column of the tables of a text."""
    return [name for cell in re.findall(r"^\| ((?:`[^`]+`(?:, )?)+) \|", text, re.M) for name in re.findall(r"`([^`]+)`", cell)]


def settings_of(text):
    """Returns the settings `section.key` or `key` in a listing of the programs, with their defaults."""
    found, section = {}, ""
    for line in text.splitlines():
        if header := re.fullmatch(r"\[(\w+)\](?: +#.*)?", line):
            section = header[1] + "."
        elif setting := re.match(r"(\w+) = (.*?)(?:  # .*)?$", line):
            found[section + setting[1]] = setting[2].strip('"')
    return found


INTERFACES = ("C++", "Python", "JSON", "CSV", "netCDF")
# Columns of a sensor are called e.g. spd_verdict; the table contains verdict.
OF_SENSOR = re.compile("^(spd|radar|depth)_(?=(verdict|figures|used|lost|valid|quality|offset_m)$)")


def of_cpp():
    headers = "".join(path.read_text(encoding="utf-8") for path in (source / "recon/include/echofuse").glob("*.hpp"))
    members = re.findall(r"^  [\w:<>,* ]+? (\w+)(?: = [^;]*)?;\s*///<|^  /// .*\n  [\w:<>, ]+ (\w+)(?: = [^;]*)?;", headers, re.M)
    parameters = " ".join(re.findall(r"\[\[nodiscard\]\] DepthMap predict\((.*?)\)", headers, re.S))
    return {name for pair in members for name in pair} | set(re.findall(r"\[\[nodiscard\]\][^;]*?(\w+)\(", headers)) | set(re.findall(r"(\w+)(?:,|$)", parameters))


def of_python(run, maps):
    scores = echofuse.metrics.__all__
    parameters = [name for function in (echofuse.write_run, echofuse.Model.predict) for name in inspect.signature(function).parameters]
    objects = (run, run[0], run.axes["spd"], maps, echofuse.metrics.Scene(maps.depth_m[0], 1))
    return {*scores, *parameters, *run.info, *run.quality(), *(name for one in objects for name in dir(one) if name[0] != "_")}


def of_json():
    def keys(shape):
        inner = shape.values() if isinstance(shape, dict) else shape if isinstance(shape, list) else []
        return {name.rstrip("?") for name in shape if isinstance(shape, dict)}.union(*map(keys, inner))
    documented = json.loads((source / "config/schema.json").read_text(encoding="utf-8"))
    return keys({name: shape for name, shape in documented.items() if name != "how to read"}) - set(documented)


class Facts(case.SharedCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        (cls.dir / "lab.toml").write_text('[tdc]\naddress = "bridge:tcp://127.0.0.1:41110"\n')
        cls.call("echofuse-sim", "dataset", "-q", "--out", "zones.sqlite", "--records", "40", "--set", "spd_zones=3", "--set", "radar_antennas=8")
        cls.call("echofuse-recon", "train", "-q", "zones.sqlite", "--model", "mean", "--out", "mean.safetensors")
        cls.run_of_python = echofuse.open(cls.dir / "zones.sqlite")
        cls.acquire = settings_of(cls.call("echofuse-acquire", "config", "show", "--config", "lab.toml"))
        cls.sim = settings_of(cls.call("echofuse-sim", "config"))
        cls.train = settings_of(cls.call("echofuse-recon", "train", "--settings"))

    @classmethod
    def call(cls, *words):
        return case.call(cls.dir, *words)

    def test_settings_in_the_manuals_exist(self):
        named = 0
        for path, text in texts.items():
            for span in spans(text):
                for section, key in re.findall(rf"(?<![\w./-])({'|'.join(sections)})\.(\w+)", span):
                    if span.endswith(files) or section == "run" and (hasattr(self.run_of_python, key) or key == "entry"):
                        continue
                    named += 1
                    self.assertIn(f"{section}.{key}", self.acquire, f"{path}: {span}")
                for key in re.findall(r"^(\w+) = ", span):
                    self.assertIn(key, {*self.sim, *self.train, *(name.partition(".")[2] for name in self.acquire), "run", "on_doubt", "key"}, f"{path}: {span}")
        self.assertGreater(named, 50)

    def test_defaults_in_the_manuals_are_those_of_the_programs(self):
        stated = 0
        for path, text in texts.items():
            for name, default in re.findall(r"`([\w.]+)` \((?:[^()]*; )?default:? (-?[\d.]+|`[^`]+`)", text):
                known = {**self.sim, **self.train, **self.acquire}
                if name in known:
                    stated += 1
                    self.assertEqual(float(known[name]), float(default.strip("`").rstrip(".")), f"{path}: {name}")
        self.assertGreater(stated, 1)

    def test_lab_toml_lists_all_limits(self):
        limits = lambda settings: {name for name in settings if name.startswith(("signal", "alert"))}
        self.assertEqual(limits(settings_of((source / "config/lab.toml").read_text(encoding="utf-8"))), limits(self.acquire))

    def test_run_file_page_lists_all_tables_and_columns(self):
        page = manual("acquire/RUN_FILE.md").partition("### Tables and columns")[2].partition("\n## ")[0]
        tables = {name for name, in fixtures.query(self.dir / "zones.sqlite", "SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite%'")}
        self.assertEqual(set(re.findall(r"^\| `(\w+)`", page, re.M)), tables)
        columns = [row[1] for row in fixtures.query(self.dir / "zones.sqlite", "PRAGMA table_info(record)")]
        rows = "\n".join(re.findall(r"^\| `record`.*", page, re.M))
        names = re.findall(r"`([\w.]+)`", rows)
        for column in columns:
            short = re.sub(r"^(spd|radar|depth)_", "", column)
            pattern = any(re.fullmatch(name.replace("...", ".+"), column) for name in names if "..." in name)
            if column != "label" and not re.fullmatch(r"radar_(rx|tx|pm|dig)\d?_c", column):
                self.assertTrue(column in names or short in names or pattern, column)
        ends = {re.sub(r"^(spd|radar|depth)_", "", column) for column in columns}
        extra = {"record", "power", "binned_power", "power_with_noise", "radar_", "spd_", "depth_"}
        self.assertEqual([name for name in names if "..." not in name and name not in {*columns, *ends, *extra} and "_" in name], [])

    def test_columns_of_records_csv_are_explained(self):
        self.call("echofuse-recon", "reconstruct", "-q", "mean.safetensors", "zones.sqlite", "--out", "maps")
        header = (self.dir / "maps/records.csv").read_text().splitlines()[0].split(",")
        explained = spans(manual("recon/README.md")) + spans(manual("recon/WHEN_IT_FAILS.md"))
        self.assertEqual([name for name in header if name not in ("record", "status") and name not in explained], [])

    def test_tables_of_metrics_formats_and_models_are_complete(self):
        metrics = json.loads(self.call("echofuse-recon", "evaluate", "mean.safetensors", "zones.sqlite", "--json"))["metrics"]
        formats = re.search(r"--format TEXT:\{([\w,]+)\}", self.call("echofuse-recon", "reconstruct", "--help"))[1].split(",")
        train_help = " ".join(self.call("echofuse-recon", "train", "--help").split())
        kinds = re.search(r"kind of model, one of: (.*?) paper", train_help)[1]
        for page, heading, names in (("README", "Metrics", metrics), ("README", "Depth map files", formats),
                                     ("MODELS", "Model types", re.findall(r"([a-z-]+)(?:\[[^]]*\])*,", kinds))):
            listed = first_column(manual(f"recon/{page}.md").partition(f"\n## {heading}")[2].partition("\n## ")[0])
            self.assertEqual(sorted(listed), sorted(names), heading)

    def test_table_of_exit_codes_is_complete(self):
        stated = set(re.findall(r"^\| (\d+) \|", manual("acquire/SERVICE.md").partition("## Exit codes")[2], re.M))
        printed = set()
        for words in (("acquire", "run"), ("acquire", "import"), ("recon", "train"), ("recon", "reconstruct"), ("sim", "dataset"), ("view",)):
            text = self.call(f"echofuse-{words[0]}", *words[1:], "--help").partition("\nexit codes:")[2]
            printed |= set(re.findall(r"(?:^|, )\s*(\d+) [a-z]", text))
        self.assertEqual(stated, printed)

    def test_example_of_doctor_has_the_lines_of_the_program(self):
        done = self.lab(bin_dir / "echofuse-acquire", "doctor", "--config", self.dir / "lab/lab.toml", options=("--window", "0.5"))
        self.assertIn(done.returncode, range(7), done.stderr)
        example = manual("acquire/README.md").partition("Output of `doctor`")[2].partition("```")[2].partition("```")[0]
        checks = re.compile(r"^(?:ok|warning|failed) +(\w+(?: \w+)?)  ", re.M)
        self.assertGreater(len(checks.findall(example)), 10)
        expected, printed = checks.findall(example), checks.findall(done.stdout)
        if done.starved and expected != printed:  # a device of the laboratory may have been too late
            self.assertLessEqual(set(printed), set(expected), done.stdout)
            case.waiting.not_checked(f"lines of doctor ({sorted(set(expected) - set(printed))})", done.starved)
        else:
            self.assertEqual(expected, printed, done.stdout)

    def test_each_public_name_is_in_the_glossary_with_its_interfaces(self):
        self.call("echofuse-sim", "dataset", "-q", "--people", "60", "--letters", "0", "--out", "a.sqlite")
        self.call("echofuse-recon", "train", "-q", "a.sqlite", "--model", "mean-shape", "--out", "m")
        self.call("echofuse-recon", "reconstruct", "-q", "m", "a.sqlite", "--rows", "0,1", "--out", "named")
        self.call("echofuse-recon", "evaluate", "-q", "m", "a.sqlite", "--per-record", "scores.csv")
        run, model = echofuse.open(self.dir / "a"), echofuse.load_model(self.dir / "m")
        data = run[:2].to_xarray()
        tables = [(self.dir / name).read_text().splitlines()[0] for name in ("named/records.csv", "scores.csv")]
        scores = (source / "recon/metrics/metrics.hpp").read_text().partition("metric_names = {")[2].partition("}")[0]
        used = (of_cpp(), of_python(run, model.predict(run[:2])), of_json() | set(re.findall('"(.*?)"', scores)),
                {name for line in tables for name in line.split(",")}, {*data.variables, *data.attrs})
        used = [{OF_SENSOR.sub("", name) for name in names} for names in used]
        found = {name: [place for place, names in zip(INTERFACES, used) if name in names] for name in set.union(*used)}
        glossary = manual("acquire/GLOSSARY.md").partition("## Names of values")[2]
        listed = {row[0]: row[1].split(", ") for row in re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", glossary, re.M)}
        shared = {name: places for name, places in found.items() if len(places) > 1}
        self.maxDiff = None
        self.assertEqual({name: listed[name] for name in sorted(listed)}, {name: shared[name] for name in sorted(shared)})


case.main(Facts)
