#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests an installation made with `cmake --install`. Tests the simulated laboratory, a live run, a data set, the
bridges, the manual pages and the shell completion. If permitted (root, unshare), the build folder is hidden from the
installed programs."""
import os
import pathlib
import re
import shutil
import subprocess
import tempfile

from case import SharedCase, bin_dir, main, source

build = bin_dir.parent
# Environment of a user, without the settings of the tests.
OWN = {name: value for name, value in os.environ.items() if name not in ("ECHOFUSE_LOCKS", "XDG_CONFIG_HOME")}


def run(*words, **how):
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=60, **how)
    assert done.returncode == 0, f"{words}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


class Installed(SharedCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # The files are installed in a staging folder and then moved, as is done for a package.
        run("cmake", "--install", build, "--prefix", cls.dir / "opt", env=OWN | {"DESTDIR": str(cls.dir / "stage")})
        shutil.move(str(cls.dir / "stage") + str(cls.dir / "opt"), cls.dir)
        cls.prefix = cls.dir / "opt"

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
            echofuse-bridge-timetagger --help"""
        words = ["unshare", "--mount", "sh", "-c", script] if hide else ["sh", "-c", script]
        said = run(*words, cwd=self.dir, env=OWN | {"PATH": f"{self.prefix}/bin:{os.environ['PATH']}"})
        self.assertIn("home/.config/echofuse/lab.toml: ok", said)
        self.assertIn("--conditional-filter", said)
        self.assertIn('"records": 3', (self.dir / "info.json").read_text())
        self.assertTrue((self.dir / "mean.h5").stat().st_size > 0)
        self.assertIn("<title>echofuse</title>", (self.dir / "page/report.html").read_text())

    def test_installed_radar_configuration_is_found_by_its_file_name(self):
        run(f"{self.prefix}/bin/echofuse-sim", "lab", "--radar-cfg", "xwr68xx_44mm.cfg", "--", "true", cwd=self.dir)
        self.assertEqual((self.dir / "lab/radar.cfg").read_bytes(), (source / "config/radar/xwr68xx_44mm.cfg").read_bytes())

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
        run_page = (self.prefix / "share/man/man1/echofuse-acquire-run.1").read_text()
        self.assertIn(".SH NAME\nechofuse\\-acquire\\-run \\- record a run, with one fused record per time slot", run_page)
        self.assertIn(".TP\n\\fB\\-\\-out\\fR \\fIRUN\\fR\nrun file to create", run_page)
        self.assertIn(".SH EXAMPLES\n.nf\nechofuse\\-acquire run \\-\\-out monday", run_page)
        self.assertIn(".SH EXIT STATUS\n0 ok, 1 failed, 2 usage", run_page)

    def test_shell_completion_offers_commands_options_and_files(self):
        def offered(*words):
            script = f""". {self.prefix}/share/bash-completion/completions/{words[0]}
                COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)); _echofuse; echo "${{COMPREPLY[@]}}" """
            return run("bash", "-c", script, "bash", *words, cwd=self.prefix / "lib",
                       env=OWN | {"PATH": f"{self.prefix}/bin:{os.environ['PATH']}"}).split()
        self.assertEqual(offered("echofuse-acquire", "im"), ["import"])
        self.assertEqual(offered("echofuse-acquire", "config", "s"), ["show", "systemd", "sysusers.d"])
        self.assertEqual(offered("echofuse-sim", "lab", "--scene", "re"), ["reflector"])
        self.assertEqual(offered("echofuse-recon", "train", "x", "--split", ""), ["blocked", "random"])
        with tempfile.TemporaryDirectory() as folder:
            for name in ("a.sqlite", "a.sqlite-lock", "a.sqlite-wal", "a.safetensors", "a.toml", "a.csv"):
                (pathlib.Path(folder) / name).touch()
            a = f"{folder}/a"
            self.assertEqual(offered("echofuse-acquire", "info", a), [f"{a}.sqlite"])
            self.assertEqual(offered("echofuse-recon", "train", "--from", a), [f"{a}.safetensors"])
            self.assertEqual(offered("echofuse-recon", "evaluate", a), [f"{a}.safetensors", f"{a}.sqlite"])
            for name in ("b$(touch made).sqlite", "c d.sqlite"):
                (pathlib.Path(folder) / name).touch()
            self.assertEqual(" ".join(offered("echofuse-acquire", "info", f"{folder}/b")), f"{folder}/b$(touch made).sqlite")
            self.assertEqual(" ".join(offered("echofuse-acquire", "info", f"{folder}/c")), f"{folder}/c d.sqlite")
            self.assertFalse((self.prefix / "lib/made").exists())
            self.assertEqual(offered("echofuse-acquire", "annotate", "x", "(lamp", ""), offered("echofuse-acquire", "annotate", ""))
            self.assertEqual(offered("echofuse-acquire", "run", "--config", a),
                             [f"{a}.{end}" for end in ("csv", "safetensors", "sqlite", "toml")])
        self.assertEqual(offered("echofuse-sim", "lab", "--lase"), ["--laser-rate-hz"])
        self.assertEqual(offered("echofuse-bench", "stab"), ["stability"])
        self.assertEqual(offered("echofuse-bench", "stability", "--qu"), ["--quick", "--quiet"])
        self.assertEqual(offered("echofuse-view", "--mod"), ["--model"])
        self.assertEqual(offered("echofuse-report", "page", "--comp"), ["--compare"])


hide = subprocess.run(["unshare", "--mount", "true"], capture_output=True).returncode == 0


main(Installed)
