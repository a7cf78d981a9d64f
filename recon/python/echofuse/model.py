# SPDX-License-Identifier: MIT
"""Maps of a model, made by the program: so scaling, alignment, calibration and fallback are those of the command."""
from __future__ import annotations

import csv
import os
import pathlib
import shutil
import subprocess
import tempfile
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import run as runs

PARTIAL = 5  # exit code: some records were left out


@dataclass(frozen=True)
class Maps:
    depth_m: NDArray[np.float32]  # [n, N, N]
    index: NDArray[np.int64]  # of the records that have a map
    depth_x: NDArray[np.float64]  # tangents of the pixel centres
    depth_y: NDArray[np.float64]
    calibrated: bool  # whether the model states how far off its maps are
    records: list[dict[str, str]]  # of every record: status, interval and more (recon/README.md, Maps)


class Model:
    def __init__(self, path: str | pathlib.Path, program: str | None = None) -> None:
        self.path = pathlib.Path(path)
        if not self.path.is_file():
            raise FileNotFoundError(f"{path}: no such model")
        self._program = program or shutil.which("echofuse-recon")
        if self._program is None:
            raise FileNotFoundError("echofuse-recon is not in PATH")

    def predict(self, run: runs.Run | str | pathlib.Path, *, output: str = "own", range_bias: str = "warn",
                threads: int = 0) -> Maps:
        """Raises RuntimeError with the program's words if it refuses the run."""
        path = run.path if isinstance(run, runs.Run) else runs.open(run).path
        with tempfile.TemporaryDirectory(prefix="echofuse-") as folder:
            made = subprocess.run(
                [self._program, "reconstruct", os.fspath(self.path), os.fspath(path), "--out", folder, "--format", "npz",
                 "--output", output, "--range-bias", range_bias, "--threads", str(threads), "--quiet"],
                capture_output=True, text=True, check=False)
            if made.returncode not in (0, PARTIAL):
                raise RuntimeError(made.stderr.strip() or f"{self._program}: exit code {made.returncode}")
            with np.load(os.path.join(folder, "maps.npz")) as arrays:
                values = {name: arrays[name] for name in ("depth_m", "index", "depth_x", "depth_y")}
                calibrated = bool(arrays["calibrated"][0])
            table = pathlib.Path(folder, "records.csv").read_text(encoding="utf-8").splitlines()
        return Maps(**values, calibrated=calibrated, records=list(csv.DictReader(table)))


def load_model(path: str | pathlib.Path, program: str | None = None) -> Model:
    """`program`: echofuse-recon, if it is not in PATH."""
    return Model(path, program)
