# SPDX-License-Identifier: MIT
"""Calls of the programs below this package."""
from __future__ import annotations

import os
import pathlib
import subprocess
import sys


EXIT_CODES = "exit codes:  0 ok, 1 failed, 2 usage, "  # and those of the program


class BenchError(RuntimeError):
    """Last line that a program or a method said when it failed, and the exit code."""

    code = 1

    def __init__(self, text: str, code: int | None = None) -> None:
        super().__init__(text)
        self.code = code or self.code


class UsageError(BenchError):
    """A wrong word of the command line: no measurement can be made with it."""

    code = 2


def path_of(program: str) -> str:
    """Path of a program: in $ECHOFUSE_BIN, else beside this program, else of PATH."""
    own, folder = (pathlib.Path(sys.argv[0]).absolute().with_name(program),
                   os.environ.get("ECHOFUSE_BIN"))
    return os.path.join(folder, program) if folder else str(own) if own.exists() else program


def not_started(path: str, reason: str) -> UsageError:
    """Returns the error that names a missing program and the ways to provide it."""
    return UsageError(f"{path}: {reason}; put the programs into PATH, or set ECHOFUSE_BIN")


def call(program: str, *words: object,
         ok: tuple[int, ...] = (0,)) -> subprocess.CompletedProcess[str]:
    """Runs one of the programs. Raises BenchError with its last line and exit code; UsageError
    unless that is 1, so that no row says of a method what is another's fault."""
    path = path_of(program)
    try:
        done = subprocess.run([path, *map(str, words)], capture_output=True, text=True, check=False,
                              errors="replace")
    except OSError as error:
        raise not_started(path, error.strerror) from None
    if done.returncode not in ok:
        kind = BenchError if done.returncode == 1 else UsageError
        said = [line for line in done.stderr.splitlines() if line.strip()
                and line != "Run with --help for more information."]
        last = (said or [f"exit code {done.returncode}"])[-1].removeprefix(f"{program}: ")
        raise kind(last, done.returncode if done.returncode > 0 else 1)
    return done
