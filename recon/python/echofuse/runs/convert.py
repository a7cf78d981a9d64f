# SPDX-License-Identifier: MIT
"""Converts run files of format 3 (echofuse 0.2 and 0.3) to the current format.

    python3 -m echofuse.runs.convert OLD NEW

The run must be closed. Range profiles in TI's logarithmic codes become linear power, and verdicts
become a word of `echofuse-acquire verdicts` and its figures. The numbers of lost tags stay as they
are; numbers of lost blocks are not in the old format and become 0."""
from __future__ import annotations

import argparse
import json
import pathlib
import sqlite3
import sys
from contextlib import closing
from importlib import resources
from typing import Any

import numpy as np

from .run import SENSORS
from .run_files import APPLICATION_ID, FORMAT_VERSION, SCHEMA, connect, is_closed, printable
from .staged import staged

__all__ = ["convert", "main"]

# word of a verdict by the beginning of its text in format 3
OLD_TEXTS = {"tags cover only ": "covers only part", "histograms cover only ": "covers only part",
             "frames of ": "other axis", "axis differs ": "other axis",
             "frames without a range profile": "no range profile",
             "no start tags on ": "no start tags", "in overflow for ": "in overflow",
             "dropped: ": "not stored", "cannot be stored": "not stored", "frozen": "stands still"}


def word_and_figures(verdict: str) -> tuple[str, str]:
    """Splits a verdict of format 3."""
    table = json.loads(resources.files(__package__).joinpath("verdicts.json").read_text("utf-8"))
    word, _, figures = verdict.partition(": ")
    if word in {row["word"] for row in table["verdicts"]}:
        return word, figures
    return next((new for begin, new in OLD_TEXTS.items() if verdict.startswith(begin)),
                "other"), verdict


def linear(codes: bytes, antennas: int) -> bytes:
    """Converts 256 * log2(magnitude), summed over the virtual antennas and divided by the next
    power of two, to linear power."""
    step = 2 / 256 * (1 << (antennas - 1).bit_length()) / antennas
    power = np.exp2(np.frombuffer(codes, "<f4").astype(float) * step)
    return bytes(power.astype("<f4"))


def row_of(table: str, values: dict[str, Any], axis: dict[str, Any] | None) -> dict[str, Any]:
    """Converts one row. `axis` is the range axis of a radar with logarithmic codes."""
    if table == "axis" and axis and values["name"] == axis["name"]:
        return values | {"quantity": "power_with_noise", "scale": 1.0}
    if table != "record":
        return values
    for sensor in SENSORS:
        word, figures = word_and_figures(values[f"{sensor}_verdict"] or "missing")
        values |= {f"{sensor}_verdict": word, f"{sensor}_figures": figures}
    if axis and values["radar"] is not None:
        values["radar"] = linear(values["radar"], int(axis["scale"]))
    return values | {"clicks_per_pulse": values["clicks_a_pulse"], "spd_lost_blocks": 0}


def convert(old: pathlib.Path, new: pathlib.Path) -> None:
    """Writes a copy of a run of format 3 in the current format. Raises ValueError if `old` is not a
    closed run of format 3, and FileExistsError if `new` exists."""
    with closing(sqlite3.connect(f"{old.resolve().as_uri()}?mode=ro", uri=True)) as source:
        source.row_factory = sqlite3.Row
        identity, version = (source.execute(f"PRAGMA {name}").fetchone()[0]
                             for name in ("application_id", "user_version"))
        if (identity, version) != (APPLICATION_ID, 3) or not is_closed(old):
            raise ValueError(f"{old}: expected a closed run of format 3")
        tables = {name for (name,) in source.execute("SELECT name FROM sqlite_schema")}
        codes = source.execute("SELECT * FROM axis WHERE quantity = 'log2_q8'").fetchone()
        axis = dict(codes) if codes else None
        with staged(new) as path:
            with closing(sqlite3.connect(path)) as target, target:
                for table in SCHEMA.keys() & tables:
                    target.execute(SCHEMA[table])
                    names = [row[1] for row in target.execute(f"PRAGMA table_info({table})")]
                    rows = (row_of(table, dict(row), axis)
                            for row in source.execute(f"SELECT * FROM {table} ORDER BY rowid"))
                    target.executemany(
                        f"INSERT INTO {table} VALUES ({', '.join('?' * len(names))})",
                        ([row[name] for name in names] for row in rows))
                target.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                target.execute(f"PRAGMA user_version = {FORMAT_VERSION}")
            connect(path).close()  # checks the tables as readers do


def main() -> None:
    parser = argparse.ArgumentParser(prog="python3 -m echofuse.runs.convert",
                                     description=str(__doc__).split("\n")[0])
    parser.add_argument("old", type=pathlib.Path, help="run of format 3")
    parser.add_argument("new", type=pathlib.Path, help="run to write; must not exist")
    words = parser.parse_args()
    try:
        convert(words.old, words.new)
    except (ValueError, OSError, KeyError, sqlite3.Error) as error:
        sys.exit(f"echofuse.runs.convert: {printable(str(error))}")


if __name__ == "__main__":
    main()
