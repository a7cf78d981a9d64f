#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that each public name has one meaning in C++, Python, JSON, CSV and netCDF. The table of names in
acquire/GLOSSARY.md must contain every name that at least two of these interfaces use."""
import inspect
import json
import re

from case import Case, call, main, source
import echofuse

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


class Names(Case):
    def test_each_public_name_is_in_the_glossary_with_its_interfaces(self):
        call(self.dir, "echofuse-sim", "dataset", "-q", "--people", "60", "--letters", "0", "--out", "a.sqlite")
        call(self.dir, "echofuse-recon", "train", "-q", "a.sqlite", "--model", "mean-shape", "--out", "m")
        call(self.dir, "echofuse-recon", "reconstruct", "-q", "m", "a.sqlite", "--rows", "0,1", "--out", "maps")
        call(self.dir, "echofuse-recon", "evaluate", "-q", "m", "a.sqlite", "--per-record", "scores.csv")
        run, model = echofuse.open(self.dir / "a"), echofuse.load_model(self.dir / "m")
        data = run[:2].to_xarray()
        tables = [(self.dir / name).read_text().splitlines()[0] for name in ("maps/records.csv", "scores.csv")]
        scores = (source / "recon/metrics/metrics.hpp").read_text().partition("metric_names = {")[2].partition("}")[0]
        used = (of_cpp(), of_python(run, model.predict(run[:2])), of_json() | set(re.findall('"(.*?)"', scores)),
                {name for line in tables for name in line.split(",")}, {*data.variables, *data.attrs})
        used = [{OF_SENSOR.sub("", name) for name in names} for names in used]
        found = {name: [place for place, names in zip(INTERFACES, used) if name in names] for name in set.union(*used)}
        glossary = (source / "acquire/GLOSSARY.md").read_text(encoding="utf-8").partition("## Names of values")[2]
        listed = {row[0]: row[1].split(", ") for row in re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", glossary, re.M)}
        shared = {name: places for name, places in found.items() if len(places) > 1}
        self.maxDiff = None
        self.assertEqual({name: listed[name] for name in sorted(listed)}, {name: shared[name] for name in sorted(shared)})


main(Names)
