#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests files of the Debian package without building the package. Tests the package relations, the compression and the
removal script. scripts/check_fresh --package tests built packages."""
import os
import pathlib
import re
import subprocess
import tempfile
import unittest

root = pathlib.Path(__file__).resolve().parents[2]
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
            with self.subTest(action), tempfile.TemporaryDirectory() as name:
                folder = pathlib.Path(name)
                cache = folder / "usr/lib/x86_64-linux-gnu/echofuse/bridges/__pycache__"
                cache.mkdir(parents=True)
                (folder / "run/systemd/system").mkdir(parents=True)
                invoke = folder / "deb-systemd-invoke"
                invoke.write_text(f'#!/bin/sh\necho "$@" >> {folder}/asked\n')
                invoke.chmod(0o755)
                script = (debian / "echofuse.prerm").read_text().replace(" /run/", f" {folder}/run/").replace(
                    " /usr/", f" {folder}/usr/")
                subprocess.run(["sh", "-c", script, "prerm", action], check=True,
                               env=os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"})
                asked = folder / "asked"
                self.assertEqual(asked.read_text() if asked.exists() else "", "stop echofuse-acquire.service\n" if stops else "")
                self.assertEqual(cache.exists(), not stops)


unittest.main()
