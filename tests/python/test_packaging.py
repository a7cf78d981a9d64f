# SPDX-License-Identifier: MIT
"""Tests the wheel and the sdist of the Python package, its public names and its types."""
import os
import pathlib
import pkgutil
import shutil
import subprocess
import sys
import types
import zipfile

import pytest

import echofuse
from fixtures import BIN, program

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
    """Creates a folder with a run and a virtual environment in which the wheel is installed. The wheel is built from the
    sdist."""
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


def test_installed_wheel_reads_a_run_without_the_echofuse_programs(made):
    code = ("import echofuse; run = echofuse.open('monday.sqlite'); "
            "print(echofuse.__file__, len(run), run.spd.shape[0])")
    done = python("-c", code, at=made, env=AWAY | {"PATH": ""}, python=made / "venv/bin/python")
    assert done.returncode == 0, done.stderr
    file, *counts = done.stdout.split()
    assert pathlib.Path(file).is_relative_to(made / "venv") and counts == ["6", "6"]


@pytest.mark.parametrize(("call", "name"), [
    ("echofuse.split(echofuse.open('monday.sqlite'))", "echofuse-recon"),
    ("echofuse.record('lab.toml')", "echofuse-acquire"),
    ("echofuse.write_run('own.sqlite', spd=[[1, 2]])", "echofuse-acquire")])
def test_error_names_the_missing_echofuse_program(made, call, name):
    code = f"import echofuse\ntry:\n    {call}\nexcept RuntimeError as error:\n    print(error)"
    done = python("-c", code, at=made, env=AWAY | {"PATH": ""}, python=made / "venv/bin/python")
    assert done.returncode == 0, done.stderr
    assert name in done.stdout and done.stdout.endswith("; add the programs to PATH, or set ECHOFUSE_BIN\n")
    assert len(done.stdout.splitlines()) == 1


def test_installed_wheel_writes_a_report_page(made):
    done = subprocess.run([made / "venv/bin/echofuse-report", "out", "--live", "monday.sqlite"], cwd=made,
                          env=AWAY | {"ECHOFUSE_BIN": str(BIN)}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    page = (made / "out/report.html").read_text(encoding="utf-8")
    assert "monday" in page and "uPlot" in page


def test_star_import_does_not_replace_the_built_in_function_open():
    names = {}
    exec("from echofuse import *", names)  # noqa: S102
    assert "open" not in names and callable(echofuse.open)


def test_public_names_of_the_package_do_not_clash_with_its_modules():
    modules = {module.name for module in pkgutil.iter_modules(echofuse.__path__)}
    assert [name for name in modules & set(dir(echofuse)) if not isinstance(getattr(echofuse, name), types.ModuleType)] == []


def test_import_of_echofuse_loads_no_other_package_than_numpy():
    code = "import numpy, sys; before = {*sys.modules}; import echofuse; print(*{*sys.modules} - before)"
    loaded = python("-c", code, at=SOURCE, env=AWAY | {"PYTHONPATH": str(SOURCE)}).stdout.split()
    packages = {name.partition(".")[0] for name in loaded} - sys.stdlib_module_names
    assert packages - {"numpy"} == {"echofuse"}


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
    """Returns the output lines of mypy. The mypy cache is in the build folder, so that NumPy is analysed only once."""
    pytest.importorskip("mypy")
    return subprocess.run([sys.executable, "-m", "mypy", "--config-file", SOURCE / "pyproject.toml", "--cache-dir", BIN.parent / "mypy", *words],
                          cwd=SOURCE, capture_output=True, text=True, check=False).stdout.splitlines()


def test_mypy_finds_no_type_error_in_the_package_or_a_user_script(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    assert mypy("echofuse", script)[-1].startswith("Success")
    script.write_text(SCRIPT + "maps[0].index\n")
    assert mypy(script)[-1].startswith("Found 1 error in 1 file")
