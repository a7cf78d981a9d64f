# SPDX-License-Identifier: MIT
"""Calls the C++ programs of echofuse."""
from __future__ import annotations

import argparse
import os
import pathlib
import subprocess
import sys

__all__ = ["EXIT_CODES", "ProgramError", "UsageError", "call", "not_started", "path_of", "positive"]


EXIT_CODES = "exit codes:  0 ok, 1 failed, 2 usage, "  # each program appends its own codes


def positive(text: str) -> int:
    """Parses an option as an integer above 0. Raises argparse.ArgumentTypeError otherwise."""
    if text.isdecimal() and int(text) > 0:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text}: expected an integer above 0")


class ProgramError(RuntimeError):
    """Error of a program or a method, with its message and exit code."""

    code = 1

    def __init__(self, text: str, code: int | None = None) -> None:
        super().__init__(text)
        self.code = code or self.code


class UsageError(ProgramError):
    """Error in the command line."""

    code = 2


def path_of(program: str) -> str:
    """Returns the path of a program. Searches $ECHOFUSE_BIN, the folder of the running program, and
    PATH."""
    own, folder = (pathlib.Path(sys.argv[0]).absolute().with_name(program),
                   os.environ.get("ECHOFUSE_BIN"))
    return os.path.join(folder, program) if folder else str(own) if own.exists() else program


def not_started(path: str, reason: str) -> UsageError:
    """Returns the error for a program that cannot be started."""
    return UsageError(f"{path}: {reason}; add the programs to PATH, or set ECHOFUSE_BIN")


def call(program: str, *words: object,
         ok: tuple[int, ...] = (0,)) -> subprocess.CompletedProcess[str]:
    """Runs a program and returns its output. Raises an error with the last line printed by the
    program: ProgramError for exit code 1, and UsageError for all other nonzero exit codes, because
    these are not caused by the method."""
    path = program if os.sep in program else path_of(program)
    try:
        done = subprocess.run([path, *map(str, words)], capture_output=True, text=True, check=False,
                              errors="replace")
    except OSError as error:
        raise not_started(path, error.strerror) from None
    if done.returncode not in ok:
        kind = ProgramError if done.returncode == 1 else UsageError
        lines = [line for line in done.stderr.splitlines() if line.strip()
                 and line != "Run with --help for more information."]
        last = (lines or [f"exit code {done.returncode}"])[-1]
        raise kind(last.removeprefix(f"{os.path.basename(path)}: "),
                   done.returncode if done.returncode > 0 else 1)
    return done
