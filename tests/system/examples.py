#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that the Python examples run and that README.md links to every example."""
import importlib.util

import case
from case import source

examples = source / "recon/examples"


class Examples(case.Case):
    def test_each_example_has_30_to_60_lines_and_a_link_in_the_readme(self):
        front = (source / "README.md").read_text(encoding="utf-8")
        for path in [*examples.rglob("*.*pp"), *examples.glob("*.py"), *(source / "drivers/examples").glob("*.cpp")]:
            self.assertIn(f"]({path.relative_to(source)})", front)
            self.assertTrue(30 <= len(path.read_text(encoding="utf-8").splitlines()) <= 60, path)

    def test_plot_example_reads_and_plots_a_run(self):
        if importlib.util.find_spec("matplotlib") is None:
            self.skipTest("python3-matplotlib is not installed")
        self.call("echofuse-sim", "dataset", "-q", "--people", 4, "--letters", 0, "--out", "a.sqlite")
        self.assertIn("4 records", self.call("/usr/bin/python3", examples / "read_and_plot.py", "a", 3, "a.svg"))
        picture = (self.dir / "a.svg").read_text()
        for text in "spd, ps", "counts", "radar, m", "power", "record 3", "mean over the run", r"$\mathdefault{10^{2}}$":
            self.assertIn(f"<!-- {text} -->", picture)

    def test_open_metrics_example_converts_the_events_of_a_run(self):
        self.call("echofuse-sim", "lab", "--dir", "lab", "--window", "0.5", "--scene", "reflector", "--",
                  "sh", "-c", f"""echofuse-acquire run -q --json --config lab/lab.toml --out live --count 4 |
                      /usr/bin/python3 {examples}/open_metrics.py metrics.prom""", ok=(0, 5))
        lines = (self.dir / "metrics.prom").read_text().splitlines()
        self.assertIn("echofuse_records 4", lines)
        self.assertIn("echofuse_slot_seconds 0.5", lines)
        self.assertTrue({"echofuse_exit_code 0", "echofuse_exit_code 5"} & set(lines), lines)
        self.assertEqual(lines[-1], "# EOF")

    def test_closed_loop_example_labels_a_live_run(self):
        self.call("echofuse-sim", "lab", "--dir", "lab", "--window", "0.5", "--scene", "reflector", "--laser-rate-hz", "2e7", "--set", "signal_photons=5e4",
                  "--", "sh", "-c", f"""echofuse-acquire run -q --config lab/lab.toml --out live --count 8 &
                      until [ -e live.sqlite ]; do sleep 0.05; done
                      /usr/bin/python3 {examples}/closed_loop.py live >marked; wait $!""", ok=(0, 5))
        marked = (self.dir / "marked").read_text().splitlines()
        self.assertIn("record 0: near", marked)
        labels = self.call("/usr/bin/python3", "-c", "import echofuse; print(*echofuse.open('live').labels)").split()
        self.assertEqual((labels[-1], "near" in labels), ("near", True))


case.main(Examples)
