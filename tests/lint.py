#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""House rules that a script can check: one SPDX line a file, files of at most 400 lines, layout by
clang-format 14 where it is installed, options and commands of --help in the README."""
import pathlib
import re
import shutil
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parent.parent
faults = []


def tracked():
    for folder in ("drivers", "acquire", "recon", "sim", "config", "scripts", "tests"):
        for path in sorted((root / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                yield path


sources = []
for path in tracked():
    name = path.relative_to(root)
    code = path.suffix in (".cpp", ".hpp", ".py", ".sh") or path.name == "CMakeLists.txt" or (
        path.parent.name == "scripts" and not path.suffix)
    if not code:
        continue
    lines = path.read_text(encoding="utf-8").splitlines()
    if not any("SPDX-License-Identifier: MIT" in line for line in lines[:2]):
        faults.append(f"{name}: no SPDX line in the first two")
    if len(lines) > 400:
        faults.append(f"{name}: {len(lines)} lines; at most 400")
    if path.suffix in (".cpp", ".hpp"):
        sources.append(str(path))

formatter = shutil.which("clang-format-14")
if formatter:
    run = subprocess.run([formatter, "--dry-run", "-Werror", "--ferror-limit=1", *sources], capture_output=True,
                         text=True)
    faults += [line for line in run.stderr.splitlines() if "error:" in line]

if len(sys.argv) > 1:  # the folder of the built programs
    readme = (root / "README.md").read_text(encoding="utf-8")

    def check_help(words, inherited=()):
        help_text = subprocess.run([pathlib.Path(sys.argv[1]) / words[0], *words[1:], "--help"], capture_output=True,
                                   text=True).stdout
        head, *commands = help_text.split("Subcommands:")
        options = re.findall(r"^  (-\w,)?(--[\w-]+)", head, re.M)
        told_of_all = ("--help", "--version", "--quiet")
        options = [(short.strip(","), name) for short, name in options if name not in told_of_all]
        for command in re.findall(r"^  ([a-z]+) ", commands[0], re.M) if commands else ():
            check_help([*words, command], [*inherited, *options])
        if commands:
            return
        row = " ".join(re.findall(rf"^\| `{' '.join(words)}\b.*", readme, re.M))
        if not row:
            faults.append(f"README.md: no row of `{' '.join(words)}`")
        for short, name in [*inherited, *options] if row else ():
            if not any(re.search(rf"(?<![\w-]){o}(?![\w-])", row) for o in (short, name) if o):
                faults.append(f"README.md: no word of {name} in the row of `{' '.join(words)}`")

    for program in ("echofuse-acquire", "echofuse-recon", "echofuse-sim"):
        check_help([program])

# udev takes a rule that it does not understand for none, and only the journal says so.
udev_keys = {"ACTION": "==", "SUBSYSTEM": "==", "ATTR": "==", "ATTRS": "==", "ENV": "== =", "GROUP": "=", "MODE": "=",
             "TAG": "+=", "GOTO": "=", "LABEL": "="}
rules = (root / "config/70-echofuse.rules").read_text(encoding="utf-8")
for number, line in enumerate(rules.splitlines(), 1):
    for item in [] if line.startswith("#") or not line else line.split(", "):
        token = re.fullmatch(r'([A-Z]+)(\{\w+\})?(==|=|\+=)"([^"]+)"', item)
        if not token or token[3] not in udev_keys.get(token[1], "").split():
            faults.append(f"config/70-echofuse.rules:{number}: not a udev rule: {item}")
    if re.match('SUBSYSTEM=="(tty|video4linux)"', line) and ("GROUP=" in line or 'TAG+="uaccess"' not in line):
        faults.append(f"config/70-echofuse.rules:{number}: its group is the system's; expected uaccess alone")
if set(re.findall(r'GOTO="(\w+)"', rules)) != set(re.findall(r'LABEL="(\w+)"', rules)):
    faults.append("config/70-echofuse.rules: GOTO and LABEL differ")

print("\n".join(faults) or f"{len(sources)} sources keep the house rules")
sys.exit(bool(faults))
