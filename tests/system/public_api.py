#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that external programs can use the installed library. The examples are built in a clean folder with CMake and
pkg-config. Their output is compared with the output of the programs."""
import json
import os
import re
import shutil
import subprocess

import numpy as np

from case import SharedCase, bin_dir, call, main, source
import echofuse
import fixtures

examples = source / "recon/examples"
HEADERS = {"error.hpp", "run.hpp", "record.hpp", "model.hpp", "predict.hpp", "version.hpp"}


# Reads counts and powers, separated by "|", from each line, and prints the outcome of predict().
JUDGE = """
#include <echofuse/predict.hpp>
#include <iostream>
#include <sstream>
int main(int, char** argv) {
  const echofuse::Model model(argv[1]);
  for (std::string line; std::getline(std::cin, line);) {
    std::vector<float> arrays[2];
    std::istringstream parts(line);
    for (std::vector<float>& array : arrays) {
      std::string part;
      std::getline(parts, part, '|');
      std::istringstream words(part);
      for (std::string word; words >> word;) array.push_back(std::stof(word));
    }
    try {
      const std::string fault = predict(model, arrays[0], arrays[1]).fault;
      std::cout << (fault.empty() ? "map" : fault) << std::endl;
    } catch (const std::exception&) {
      std::cout << "refused" << std::endl;
    }
  }
}
"""


PLUGIN = """
#include <echofuse/predict.hpp>
extern "C" double body_x(const char* model, const char* run, int record) {
  try {
    const auto map = echofuse::predict(echofuse::Model(model), echofuse::Run(run).read(record));
    return map.body ? map.body->x_m : 0;
  } catch (const echofuse::Exception&) {
    return -1;
  }
}
"""


class PublicApi(SharedCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.prefix = cls.dir / "opt"
        # The files are installed in a staging folder and then moved, as is done for a package.
        call(cls.dir, "cmake", "--install", bin_dir.parent, "--component", "dev", "--prefix", cls.prefix, DESTDIR=str(cls.dir / "stage"))
        shutil.move(str(cls.dir / "stage") + str(cls.prefix), cls.dir)
        call(cls.dir, "echofuse-sim", "dataset", "-q", "--people", 80, "--letters", 0, "--out", "scenes.sqlite")
        call(cls.dir, "echofuse-recon", "train", "-q", "scenes.sqlite", "--model", "mean-shape", "--out", "m.safetensors")

    def flags(self):
        package, = self.prefix.rglob("echofuse.pc")
        flags = call(self.dir, "pkg-config", "--cflags", "--libs", "echofuse", PKG_CONFIG_PATH=str(package.parent)).split()
        return [*flags, f"-Wl,-rpath,{package.parent.parent}"]

    def exported(self, library):
        """Returns the names that a shared library exports, in C++ notation."""
        table = call(self.dir, "nm", "-D", "-C", "--defined-only", library)
        return {line.split(maxsplit=2)[2].split("@")[0] for line in table.splitlines() if " A " not in line}

    def test_library_exports_exactly_the_listed_names(self):
        library, = self.prefix.rglob("libechofuse.so")
        package, = (source / "scripts/debian").glob("libechofuse*.symbols")
        listed = package.read_text()
        self.assertEqual(self.exported(library), set(re.findall('"(.*)@', listed)))
        self.assertEqual(os.readlink(library), listed.split()[0])
        self.assertIn(f"Library soname: [{listed.split()[0]}]", call(self.dir, "readelf", "-d", library))

    def test_plugin_exports_at_most_20_names_of_the_library(self):
        (self.dir / "plugin.cpp").write_text(PLUGIN)
        call(self.dir, "g++", "-std=c++20", "-shared", "-fPIC", "plugin.cpp", *self.flags(), "-o", "plugin.so")
        names = {name for name in self.exported(self.dir / "plugin.so") if "echofuse" in name}
        self.assertLessEqual(len(names), 20, names)

    def test_cpp17_program_is_refused_with_the_reason(self):
        (self.dir / "old.cpp").write_text("#include <echofuse/predict.hpp>\n")
        done = subprocess.run(["g++", "-std=c++17", "-fsyntax-only", "old.cpp", *self.flags()], cwd=self.dir, capture_output=True, text=True)
        self.assertRegex(done.stderr.partition("error:")[2], "^ #error .echofuse requires C\\+\\+20; compile with -std=c\\+\\+20.")

    def test_verdict_codes_are_those_of_the_programs(self):
        codes = re.search(r"enum class VerdictCode .*?};", (examples.parent / "include/echofuse/record.hpp").read_text(), re.S)[0]
        rows = json.loads(call(self.dir, "echofuse-acquire", "verdicts", "--json"))["verdicts"]
        self.assertEqual(re.findall("///< `(.*)`", codes), [row["word"] for row in rows if row["word"] != "other"])

    def test_cmake_example_predicts_the_same_map_as_reconstruct(self):
        project = self.dir / "predict"
        shutil.copytree(examples / "predict", project)
        self.assertLessEqual(len((project / "predict.cpp").read_text().splitlines()), 40)
        call(project, "cmake", "-B", "build", f"-DCMAKE_PREFIX_PATH={self.prefix}")
        call(project, "cmake", "--build", "build")
        *rows, last = call(self.dir, project / "build/predict", "m.safetensors", "scenes", 7).splitlines()
        call(self.dir, "echofuse-recon", "reconstruct", "-q", "m.safetensors", "scenes.sqlite", "--rows", 7, "--format", "foreground", "--out", "maps")
        depth = np.nan_to_num(np.load(self.dir / "maps/thresholded.npy"))[0]
        self.assertEqual(rows, ["".join(str(int(z) % 10) if z > 0 else "." for z in row) for row in depth])
        self.assertRegex(last, r"^body at x = -?\d\.\d\d m, z = \d\.\d\d m, 90 % interval of x \+- \d\.\d\d m$")

    def test_pkg_config_examples_read_and_follow_runs(self):
        flags = self.flags()
        for name in ("read_run", "follow_run"):
            call(self.dir, "g++", "-std=c++20", "-Wall", "-Wextra", "-Wconversion", "-Werror", examples / f"{name}.cpp", *flags, "-o", self.dir / name)
        said = call(self.dir, self.dir / "read_run", "scenes").splitlines()
        self.assertRegex(said[0], r"^scenes: complete, 80 records of \d+ s$")
        self.assertEqual(len(said), 81)
        self.assertRegex(said[1], r"^record 0 person: \d{3,} clicks, histogram peak at \d\.\d\d m$")
        said = call(self.dir, self.dir / "follow_run", "m.safetensors", "scenes").splitlines()
        self.assertEqual(len(said), 80)
        self.assertRegex(said[0], r"^record 0: depth at the centre \d\.\d\d m, body at x = -?\d\.\d\d m, z = \d\.\d\d m")
        fixtures.changed(self.dir / "scenes.sqlite", self.dir / "damaged.sqlite", "histogram of one byte in record ?1", 3)
        skipped = call(self.dir, self.dir / "follow_run", "m.safetensors", "damaged").splitlines()
        self.assertRegex(skipped[3], "^record 3: no map: .*spd")
        self.assertEqual([*skipped[:3], *skipped[4:]], [*said[:3], *said[4:]])

    def test_predict_judges_the_same_arrays_alike_in_cpp_and_python(self):
        (self.dir / "judge.cpp").write_text(JUDGE)
        call(self.dir, "g++", "-std=c++20", self.dir / "judge.cpp", *self.flags(), "-o", self.dir / "judge")
        model, whole = echofuse.load_model(self.dir / "m.safetensors"), echofuse.open(self.dir / "scenes")
        counts, power = whole.photons()[0], whole.power()[0]

        def changed(array, value, at=3):
            return np.where(np.arange(len(array)) == at, value, array)

        table = [(counts, power), (counts, None), (None, power), (counts + 0.5, power), (changed(counts, -50), power), (changed(counts, np.nan), power),
                 (changed(counts, np.inf), power), (counts[1:], power), (counts, power[1:]), (counts, changed(power, np.inf)), (counts, changed(power, -1)),
                 (counts * 0, power), (counts * 0 + 5, power), (counts * 0 + 5, None), (counts, power * 0 + 1), (counts * 0, power * 0),
                 (changed(counts * 0 + 5, 6), power), (changed(counts, 1e30), power)]
        lines = ["|".join("" if array is None else " ".join(map(str, array)) for array in row) for row in table]
        by_cpp = subprocess.run([self.dir / "judge", self.dir / "m.safetensors"], input="\n".join(lines), capture_output=True, text=True,
                                check=True).stdout.splitlines()
        by_python = []
        for row in table:
            try:
                faults = model.predict(**{name: array[None] for name, array in zip(("spd", "radar"), row) if array is not None}).faults
                by_python.append(faults.get(0, "map"))
            except ValueError:
                by_python.append("refused")
        self.assertEqual(by_python, by_cpp)
        self.assertEqual((by_cpp.count("map"), by_cpp.count("refused")), (7, 6))

    def test_public_headers_compile_alone_without_other_libraries(self):
        include = self.prefix / "include"
        self.assertEqual({path.name for path in (include / "echofuse").iterdir()}, HEADERS)
        for header in HEADERS:
            unit = self.dir / f"{header}.cpp"
            unit.write_text(f"#include <echofuse/{header}>\n")
            words = ("g++", "-std=c++20", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", f"-I{include}", unit)
            call(self.dir, *words, "-fsyntax-only")
            others = [name for name in call(self.dir, *words, "-M").split()
                      if not name.startswith((str(include), str(self.dir), "/usr/include/c++", "/usr/lib/gcc")) and any(
                          word in name.lower() for word in ("boost", "asio", "eigen", "sqlite", "opencv"))]
            self.assertEqual(others, [], header)


main(PublicApi)
