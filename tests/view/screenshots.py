#!/usr/bin/python3
# SPDX-License-Identifier: MIT
"""Saves screenshots of the page in each of its states, for a review by eye. Called as `tests/view/screenshots.py BIN_DIR
DIR [STATE...]`; the states are the names of the tests below, without `test_`. Each screenshot is taken at 1400 x 900 and
390 x 844, in the light and the dark theme."""
import base64
import pathlib
import resource
import subprocess
import sys
import unittest

import page
from live import bin_dir

FAULTS = (("tdc", "drop = 0.6"), ("tdc", "unplug"), ("tdc", "gain = 0.02"), ("tdc", "gain = 10"), ("radar", "drop = 0.6"),
          ("radar", "unplug"), ("radar", "freeze"), ("depth", "drop = 0.6"), ("depth", "stall"), ("depth", "freeze"))


class Screenshots(page.Page):
    def take(self, name):
        for width, height in (1400, 900), (390, 844):
            for theme in "light", "dark":
                self.size(width, height, theme, {"name": "prefers-reduced-motion", "value": "reduce"})
                self.browser.save_screenshot(str(pathlib.Path(sys.argv[2]) / f"{name}-{width}-{theme}.png"))

    def open(self, *options, **how):
        daemon = self.record("--set", "run.label=person", *options, **how)
        self.browser.get(self.view())
        self.wait("records", lambda: self.js("return window.framesSeen") > 9)
        return daemon

    def end(self, status):
        self.wait(status, lambda: self.text("status").startswith(status))
        self.wait("thumbnails", lambda: self.js("return document.querySelectorAll('#sheet button').length") > 0)

    def test_live(self):
        self.open()
        self.take("live")
        for key, name in ("Home", "held"), ("f", "held_large_type"), ("End", "large_type"):
            self.key(key)
            self.take(name)

    def test_faults(self):
        for device, fault in FAULTS:
            kind, equals, amount = fault.partition(" = ")
            faults, amounts = self.dir / "faults.toml", f"amount{equals}{amount}\n" * bool(amount)
            faults.write_text(f'[[fault]]\ndevice = "{device}"\nkind = "{kind}"\nat_s = 2\nfor_s = 1000\n{amounts}')
            self.close_lab()
            self.open_again("--faults", faults)
            self.run = self.dir / f"{device}_{kind}{amount}.sqlite"
            daemon = self.open()
            sensor = {"tdc": "spd"}.get(device, device)
            self.wait(f"{kind} of {device}", lambda: self.lamp(sensor) != "ok")
            self.take(f"{device}_{kind}{amount}")
            daemon.terminate()
            daemon.wait(20)

    def test_settings(self):
        for name, setting in ("without_camera", "depth.address="), ("disk_low", "alert.disk_free_gb=1e6"):
            self.run = self.dir / f"{name}.sqlite"
            daemon = self.open("--set", setting)
            self.take(name)
            daemon.terminate()
            daemon.wait(20)

    def test_disk_full(self):
        self.open(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20)))
        self.end("stopped: disk full")
        self.take("disk_full")

    def test_ends(self):
        """Also saves the page of the complete run as a file, and prints it."""
        self.open("--count", "20").wait(60)
        self.end("complete")
        self.take("ended_well")
        saved = pathlib.Path(sys.argv[2]).resolve() / "saved.html"
        subprocess.run([bin_dir / "echofuse-view", "--save", saved, self.run], check=True, stdout=subprocess.DEVNULL)
        self.browser.get(saved.as_uri())
        self.wait("record", lambda: self.js("return window.framesSeen") > 0)
        self.take("saved")
        self.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        saved.with_suffix(".pdf").write_bytes(base64.b64decode(self.browser.print_page()))

    def test_crash(self):
        daemon = self.open()
        self.close_lab()
        self.wait("no data", lambda: self.text("status").startswith("NO DATA"))
        self.take("no_data")
        daemon.kill()
        daemon.wait()
        self.end("crashed")
        self.take("ended_badly")
        self.processes[-1].kill()
        self.wait("no viewer", lambda: self.text("status").startswith("no connection"))
        self.take("no_viewer")

    def test_list(self):
        for name, label in ("monday", "person"), ("tuesday", "empty"):
            self.run = self.dir / f"{name}.sqlite"
            self.record("--count", "8", "--set", f"run.label={label}").wait(60)
        self.run = self.dir
        self.browser.get(self.view())
        self.wait("list", lambda: self.js("return document.querySelectorAll('.run .status').length") == 2)
        self.take("list")


if __name__ == "__main__":
    pathlib.Path(sys.argv[2]).mkdir(exist_ok=True)
    unittest.main(argv=[sys.argv[0], *(f"Screenshots.{name}" for name in vars(Screenshots)
                                    if name.startswith("test_") and name[5:] in (sys.argv[3:] or name))])
