# SPDX-License-Identifier: MIT
"""Tests the wheel and the sdist of the Python package, its public names and its types."""
import os
import pathlib
import pkgutil
import re
import shutil
import subprocess
import sys
import types
import zipfile

import pytest

import echofuse
from fixtures import BIN, outcome, program

SOURCE = pathlib.Path(__file__).resolve().parents[2] / "recon/python"
AWAY = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "ECHOFUSE_BIN", "ECHOFUSE_ACQUIRE")}


def python(*words, at, env=AWAY, python=sys.executable):
    return subprocess.run([python, *map(str, words)], cwd=at, env=env, capture_output=True, text=True, check=False)


def copy_of_the_sources(to):
    return shutil.copytree(SOURCE, to, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build"))


def built(source, kind, to):
    done = python("-c", f"import setuptools.build_meta as b, sys; b.build_{kind}(sys.argv[1])", to, at=source)
    assert done.returncode == 0, done.stderr
    return next(to.glob("*.tar.gz" if kind == "sdist" else "*.whl"))


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """Creates a folder with a run and a virtual environment with the wheel, which is built from the sdist."""
    for module in ("setuptools", "wheel", "venv", "pip"):
        pytest.importorskip(module)
    folder = tmp_path_factory.mktemp("package")
    sdist = built(copy_of_the_sources(folder / "copy"), "sdist", folder)
    shutil.unpack_archive(sdist, folder / "unpacked")
    wheel = built(next((folder / "unpacked").iterdir()), "wheel", folder)
    done = python("-m", "venv", "--without-pip", "--system-site-packages", folder / "venv", at=folder)
    assert done.returncode == 0, done.stderr
    done = python("-m", "pip", "install", "--no-index", "--no-deps", "-q", wheel, at=folder, python=folder / "venv/bin/python")
    assert done.returncode == 0, done.stderr
    program("echofuse-sim", "dataset", "-q", "--out", folder / "monday.sqlite", "--records", 6)
    return folder


def test_wheels_built_from_sources_and_sdist_contain_the_same_files(made, tmp_path):
    direct = built(copy_of_the_sources(tmp_path / "copy"), "wheel", tmp_path)
    names = [set(zipfile.ZipFile(wheel).namelist()) for wheel in (direct, next(made.glob("*.whl")))]
    assert names[0] == names[1]
    assert {"echofuse/py.typed", "echofuse/runs/schema.sql", "echofuse/bench/echofuse-bench-2.toml"} <= names[0]
    assert any(name.endswith("dist-info/LICENSE") for name in names[0])
    assert (SOURCE / "LICENSE").read_bytes() == (SOURCE.parents[1] / "LICENSE").read_bytes()


NO_PROGRAM = "; add the programs to PATH, or set ECHOFUSE_BIN\n"


@pytest.mark.parametrize(("call", "beginning", "end"), [
    ("print('wheel', len(run), run.spd.shape[0], echofuse.__file__.startswith(sys.prefix))", "wheel", " 6 6 True\n"),
    ("echofuse.split(run)", "echofuse-recon", NO_PROGRAM), ("echofuse.record('lab.toml')", "echofuse-acquire", NO_PROGRAM),
    ("echofuse.write_run('own.sqlite', spd=[[1, 2]])", "echofuse-acquire", NO_PROGRAM)])
def test_installed_wheel_reads_a_run_without_programs_and_names_a_missing_program(made, call, beginning, end):
    code = f"import echofuse, sys\nrun = echofuse.open('monday')\ntry:\n    {call}\nexcept RuntimeError as e:\n    print(e)"
    done = python("-c", code, at=made, env=AWAY | {"PATH": ""}, python=made / "venv/bin/python")
    assert beginning in done.stdout and done.stdout.endswith(end) and done.stdout.count("\n") == 1, done.stdout + done.stderr


def test_installed_wheel_writes_a_report_page(made):
    env, program = AWAY | {"ECHOFUSE_BIN": str(BIN)}, made / "venv/bin/echofuse-report"
    done = python("out", "--live", "monday.sqlite", at=made, env=env, python=program)
    assert done.returncode == 0, done.stderr
    page = (made / "out/report.html").read_text(encoding="utf-8")
    assert "monday" in page and "uPlot" in page


def test_names_of_the_package_clash_neither_with_its_modules_nor_with_open():
    names = {}
    exec("from echofuse import *", names)  # noqa: S102
    assert "open" not in names and callable(echofuse.open)
    modules = {module.name for module in pkgutil.iter_modules(echofuse.__path__)}
    assert [name for name in modules & set(dir(echofuse)) if not isinstance(getattr(echofuse, name), types.ModuleType)] == []


def test_import_of_echofuse_loads_no_other_package_than_numpy():
    code = "import numpy, sys; before = {*sys.modules}; import echofuse; print(*{*sys.modules} - before)"
    loaded = python("-c", code, at=SOURCE, env=AWAY | {"PYTHONPATH": str(SOURCE)}).stdout.split()
    packages = {name.partition(".")[0] for name in loaded} - sys.stdlib_module_names
    assert packages - {"numpy"} == {"echofuse"}


@pytest.mark.parametrize("words, count", [("export", 5), ("report", 10), ("bench", 2), ("bench pareto", 11),
                                          ("bench stability", 16), ("bench run", 15), ("bench letters", 2)])
def test_help_describes_every_option(words, count):
    name, *command = words.split()
    said = outcome(f"echofuse-{name}", *command, "--help", env=os.environ | {"COLUMNS": "400"}).stdout
    options = re.findall(r"^ +(-\S.*)", re.sub(r"\n {10,}", "   ", said), re.M)
    assert len(options) == count and all("  " in option for option in options), options


SCRIPT = """
import echofuse

run = echofuse.open("monday")
split = echofuse.split(run)
truth = run.maps(split.test)
some: echofuse.Run = run[run.valid["spd"]]
few: echofuse.Run = run[[1, 2]]
one: echofuse.Record = run[3]
maps: echofuse.Maps = echofuse.load_model("fused.safetensors").predict(few)
first = maps[0]
scene = echofuse.metrics.Scene.of_maps(truth)
iou = echofuse.metrics.iou(maps[1:].depth_m, truth[[0]], scene)
print(truth.shape, some, one.depth.shape, first.shape, iou.mean())
"""


def mypy(*words):
    """Returns the last line of mypy. The mypy cache is in the build folder, so that NumPy is analysed only once."""
    pytest.importorskip("mypy")
    words = ["--config-file", SOURCE / "pyproject.toml", "--cache-dir", BIN.parent / "mypy", *words]
    return python("-m", "mypy", *words, at=SOURCE, env=os.environ).stdout.splitlines()[-1]


def test_mypy_finds_no_type_error_in_the_package_or_a_user_script(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    assert mypy("echofuse", script).startswith("Success")
    script.write_text(SCRIPT + "maps[0].index\n")
    assert mypy(script).startswith("Found 1 error in 1 file")
