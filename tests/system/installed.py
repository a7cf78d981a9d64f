#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests an installation made with `cmake --install`, with a hidden build folder if permitted (root, unshare). Also tests that
external programs can use the installed library."""
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

import numpy as np

from case import SharedCase, bin_dir, call, source
import echofuse
import fixtures

build = bin_dir.parent
# Environment of a user, without the settings of the tests.
OWN = {name: value for name, value in os.environ.items() if name not in ("ECHOFUSE_BIN", "ECHOFUSE_LOCKS", "XDG_CONFIG_HOME")}


def run(*words, **how):
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=60, **how)
    assert done.returncode == 0, f"{words}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


def installed(folder, *options):
    """Installs the files in a staging folder and then moves them, as is done for a package. Returns the new folder."""
    run("cmake", "--install", build, "--prefix", folder / "opt", *options, env=OWN | {"DESTDIR": str(folder / "stage")})
    return pathlib.Path(shutil.move(f"{folder}/stage{folder}/opt", folder))


class Installed(SharedCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.prefix = installed(cls.dir)

    def files(self):
        return [path for path in self.prefix.rglob("*") if path.is_file()]

    def test_build_folder_is_not_named_in_installed_files(self):
        if "ECHOFUSE_SANITIZE:STRING=\n" not in (build / "CMakeCache.txt").read_text():
            self.skipTest("sanitizers store the names of sources")
        names = {str(build).encode(), str(source).encode(), b"/stage/"}
        for path in self.files():
            content = path.read_bytes()
            for name in names:
                self.assertNotIn(name, content, path)

    def test_installed_programs_simulate_and_record(self):
        """Runs the installed programs. If permitted, an empty folder is mounted over the build folder."""
        script = f"""set -e
            {f"mount -t tmpfs none {build}" if hide else ":"}
            cd {self.dir}
            echofuse-sim lab --scene person --hold 0.2 --window 0.2 --laser-rate-hz 2e7 --set signal_photons=5e4 -- \\
              echofuse-acquire run --config lab/lab.toml --count 3 --out live -q || [ $? = 5 ]
            echofuse-acquire info --json live >info.json
            echofuse-sim dataset --people 20 --letters 20 --out scenes.sqlite -q --set twin=default --set laboratories=40
            echofuse-recon train scenes.sqlite --model mean --out mean.h5 -q
            echofuse-report page --run scenes.sqlite --model mean.h5 --live live.sqlite
            mkdir -p home/.config/echofuse
            sed s/XXXXXXXX/R0052A03/ {self.prefix}/share/echofuse/lab.toml >home/.config/echofuse/lab.toml
            HOME=$PWD/home echofuse-acquire config check
            echofuse-sim lab --dir other --radar-cfg xwr68xx_44mm.cfg -- true
            echofuse-bridge-timetagger --help"""
        words = ["unshare", "--mount", "sh", "-c", script] if hide else ["sh", "-c", script]
        said = run(*words, cwd=self.dir, env=OWN | {"PATH": f"{self.prefix}/bin:{os.environ['PATH']}"})
        self.assertIn("home/.config/echofuse/lab.toml: ok", said)
        self.assertIn("--conditional-filter", said)
        self.assertIn('"records": 3', (self.dir / "info.json").read_text())
        self.assertEqual((self.dir / "other/radar.cfg").read_bytes(), (source / "config/radar/xwr68xx_44mm.cfg").read_bytes())
        self.assertIn("<title>echofuse</title>", (self.dir / "page/report.html").read_text())

    def test_installed_python_package_can_be_imported(self):
        module, = self.prefix.glob("lib/python3*/dist-packages/echofuse")
        said = run("/usr/bin/python3", "-c", "import echofuse; print(echofuse.__file__)", cwd=self.dir,
                   env=OWN | {"PYTHONPATH": module.parent, "PYTHONDONTWRITEBYTECODE": "1"})
        self.assertEqual(said.strip(), str(module / "__init__.py"))

    def test_manuals_contain_no_dead_links(self):
        texts = list((self.prefix / "share/doc/echofuse").rglob("*.md"))
        self.assertGreater(len(texts), 7)
        for text in texts:
            for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text.read_text()):
                self.assertTrue("://" in link or (text.parent / link).exists(), f"{text}: {link}")

    def test_systemd_units_start_the_installed_programs(self):
        unit = (self.prefix / "lib/systemd/system/echofuse-acquire.service").read_text()
        self.assertIn(f"\nExecStart={self.prefix}/bin/echofuse-acquire run ", unit)
        unit = (self.prefix / "lib/systemd/user/echofuse-bridge@.service").read_text()
        self.assertIn(f"\nExecStart={self.prefix}/bin/echofuse-bridge-%i $OPTIONS\n", unit)
        for line in ("NoNewPrivileges=yes", "PrivateTmp=yes", "ProtectSystem=strict", "WorkingDirectory=%C/echofuse"):
            self.assertIn(f"\n{line}\n", unit)

    def test_manual_pages_are_installed(self):
        pages = {path.name for path in (self.prefix / "share/man/man1").iterdir()}
        for name in ("acquire", "acquire-run", "acquire-config-show", "recon-train", "bench-stability", "report", "view", "sim-lab", "export",
                     "bridge-timetagger"):
            self.assertIn(f"echofuse-{name}.1", pages)
        run_page = (self.prefix / "share/man/man1/echofuse-acquire-run.1").read_text().replace("\\-", "-")
        for text in (".SH NAME\nechofuse-acquire-run - record a run, with one fused record per time slot",
                     ".TP\n\\fB--out\\fR \\fIRUN\\fR\nrun file to create", ".SH EXIT STATUS\n0 ok, 1 failed, 2 usage",
                     ".SH EXAMPLES\n.nf\nechofuse-acquire run --out monday"):
            self.assertIn(text, run_page)

    def test_shell_completion_offers_commands_options_and_files(self):
        def offered(*words):
            script = f""". {self.prefix}/share/bash-completion/completions/{words[0]}
                COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)); _echofuse; printf '%s\\n' "${{COMPREPLY[@]}}" """
            return run("bash", "-c", script, "bash", *words, cwd=self.prefix / "lib",
                       env=OWN | {"PATH": f"{self.prefix}/bin:{os.environ['PATH']}"}).splitlines()

        a = f"{self.new_folder(self.enterContext)}/"
        ends = "csv", "safetensors", "sqlite", "toml"
        for name in (*(f"a.{end}" for end in ends), "a.sqlite-lock", "a.sqlite-wal", "b$(touch made).sqlite", "c d.sqlite"):
            pathlib.Path(a + name).touch()
        for words, *expected in (
                ("acquire im", "import"), ("acquire config s", "show", "systemd", "sysusers.d"), ("bench stab", "stability"),
                ("sim lab --scene re", "reflector"), ("recon train x --split ", "blocked", "random"),
                ("sim lab --lase", "--laser-rate-hz"), ("bench stability --qu", "--quick", "--quiet"),
                ("view --mod", "--model"), ("report page --comp", "--compare"),
                (f"acquire info {a}a", f"{a}a.sqlite"), (f"recon train --from {a}a", f"{a}a.safetensors"),
                (f"recon evaluate {a}a", f"{a}a.safetensors", f"{a}a.sqlite"),
                (f"acquire info {a}b", f"{a}b$(touch made).sqlite"), (f"acquire info {a}c", f"{a}c d.sqlite"),
                (f"acquire run --config {a}a", *(f"{a}a.{end}" for end in ends)),
                ("acquire annotate x (lamp ", *offered("echofuse-acquire", "annotate", ""))):
            self.assertEqual(offered(*f"echofuse-{words}".split(" ")), expected, words)
        self.assertFalse((self.prefix / "lib/made").exists())


examples = source / "recon/examples"
STRICT = "g++", "-std=c++20", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"
HEADERS = {"error.hpp", "run.hpp", "record.hpp", "model.hpp", "predict.hpp", "version.hpp"}


# Reads counts and powers from alternating lines, and prints the outcomes of predict().
JUDGE = """
#include <echofuse/predict.hpp>
#include <iostream>
#include <sstream>
std::vector<float> numbers(const std::string& line) {
  std::istringstream words(line);
  std::vector<float> out;
  for (std::string word; words >> word;) out.push_back(std::stof(word));
  return out;
}
int main(int, char** argv) {
  const echofuse::Model model(argv[1]);
  for (std::string counts, power; std::getline(std::cin, counts) && std::getline(std::cin, power);) try {
      const std::string fault = predict(model, numbers(counts), numbers(power)).fault;
      std::cout << (fault.empty() ? "map" : fault) << std::endl;
    } catch (const std::exception&) {
      std::cout << "refused" << std::endl;
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
        cls.prefix = installed(cls.dir, "--component", "dev")
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
            call(self.dir, *STRICT, examples / f"{name}.cpp", *flags, "-o", name)
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

        table = [(counts, power), (counts, None), (None, power), (counts + 0.5, power),
                 *((changed(counts, value), power) for value in (-50, np.nan, np.inf, 1e30)),
                 *((counts, changed(power, value)) for value in (np.inf, -1)), (counts[1:], power), (counts, power[1:]),
                 (counts * 0, power), (counts * 0 + 5, power), (counts * 0 + 5, None), (counts, power * 0 + 1),
                 (counts * 0, power * 0), (changed(counts * 0 + 5, 6), power)]
        lines = ["" if array is None else " ".join(map(str, array)) for row in table for array in row]
        by_cpp = run(self.dir / "judge", self.dir / "m.safetensors", input="\n".join([*lines, ""])).splitlines()

        def judged(spd, radar):
            given = {name: array[None] for name, array in (("spd", spd), ("radar", radar)) if array is not None}
            try:
                return model.predict(**given).faults.get(0, "map")
            except ValueError:
                return "refused"

        self.assertEqual([judged(*row) for row in table], by_cpp)
        self.assertEqual((by_cpp.count("map"), by_cpp.count("refused")), (7, 6))

    def test_public_headers_compile_alone_without_other_libraries(self):
        include = self.prefix / "include"
        self.assertEqual({path.name for path in (include / "echofuse").iterdir()}, HEADERS)
        for header in HEADERS:
            unit = self.dir / f"{header}.cpp"
            unit.write_text(f"#include <echofuse/{header}>\n")
            words = *STRICT, f"-I{include}", unit
            call(self.dir, *words, "-fsyntax-only")
            others = [name for name in call(self.dir, *words, "-M").split()
                      if not name.startswith((str(include), str(self.dir), "/usr/include/c++", "/usr/lib/gcc")) and any(
                          word in name.lower() for word in ("boost", "asio", "eigen", "sqlite", "opencv"))]
            self.assertEqual(others, [], header)


hide = subprocess.run(["unshare", "--mount", "true"], capture_output=True).returncode == 0
unittest.main(argv=sys.argv[:1] + sys.argv[2:])
