"""The engine without the analysis: its commands, a sweep with its picture, and the explorer."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import dimersweep
from dimersweep import extensions
from dimersweep.symbols import PICTURE_KINDS

PACKAGE = Path(dimersweep.__file__).parent
DOORS = ("orbits.py", "fits.py")  # public names of rooms of the analysis

PROGRAM = """
import dimersweep
from dimersweep import cli, plots
from dimersweep.errors import ParameterError
from dimersweep.exploring.page import LivePage

SWEEP = '''
[sweep]
title = "small"
output = "small.nc"
periods = 20
[grid]
Gamma = [0.8, 0.9]
beta0 = [0.2, 0.3]
'''


def run(*words):
    cli.app(list(words), standalone_mode=False)


def refused(call):
    try:
        call()
    except ParameterError as error:
        print("refused:", error)
    else:
        raise AssertionError("was not refused")


open("small.toml", "w").write(SWEEP)
run("presets")
run("simulate", "--periods", "5", "--save", "run.nc", "--plot", "run.png")
run("lyapunov", "--Gamma", "3", "--before", "50", "--periods", "20")
run("power", "--before", "5", "--periods", "5")
run("plan", "small.toml")
run("run", "small.toml", "--out", "small.nc")
run("status", "small.nc")
run("plot", "small.nc", "--quantity", "radius")
run("run", "small.toml", "--part", "1/2", "--out", "parts.nc")
run("run", "small.toml", "--part", "2/2", "--out", "parts.nc")
run("merge", "parts.part-1-of-2.nc", "parts.part-2-of-2.nc", "--out", "parts.nc")
run("warm")
cube = dimersweep.open_cube("small.nc")
assert cube.dimersweep.run(Gamma=0.9, beta0=0.2).status == "ok"
page = LivePage(cube)
assert page.map.part({})["modes"] and "dimersweep explore" in page.html()
assert page.run({"Gamma": "0.9"})["place"]["Gamma"] == "0.9"
for call in (
    lambda: dimersweep.sweep({"Gamma": [0.9]}, periods=5, sustained=True),
    lambda: cube[["radius"]].dimersweep.plot(),
    lambda: plots.circles(cube),
):
    refused(call)
"""


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    """A folder with the package as it is without `dimersweep.analysis`."""
    folder = tmp_path_factory.mktemp("engine")
    shutil.copytree(PACKAGE, folder / "dimersweep")
    shutil.rmtree(folder / "dimersweep/analysis")
    for door in DOORS:
        (folder / "dimersweep" / door).unlink()
    shutil.copytree(PACKAGE.parent / "sweeps", folder / "sweeps")
    return folder


def python(engine, folder, *words):
    how = {"cwd": folder, "env": {"PYTHONPATH": str(engine), "PATH": "", "HOME": str(Path.home())}}
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False, **how)


def test_the_engine_runs_without_the_analysis(engine, tmp_path):
    ran = python(engine, tmp_path, "-c", PROGRAM)
    assert ran.returncode == 0, ran.stderr
    refusals = [line for line in ran.stdout.splitlines() if line.startswith("refused")]
    assert refusals == [
        f"refused: {name}: needs dimersweep.analysis, which is not installed"
        for name in ("sustained", "plot", "circles")
    ]
    made = {path.name for path in tmp_path.iterdir()}
    assert {"run.nc", "run.png", "small.nc", "small.png", "small-radius.png", "parts.nc"} <= made


def test_the_command_line_has_the_commands_of_the_engine_alone(engine, tmp_path):
    ran = python(engine, tmp_path, "-m", "dimersweep", "--help")
    assert ran.returncode == 0, ran.stderr
    words = {line.split()[1] for line in ran.stdout.splitlines() if line.startswith("│ ") and len(line.split()) > 1}
    assert {"simulate", "run", "explore", "power"} <= words
    assert not {*extensions.COMMANDS} & words


def test_what_the_analysis_adds_is_there():
    places = {**extensions.COMMANDS, **extensions.CUBE_PICTURES, **extensions.TABLE_PICTURES, **extensions.MAPS}
    for name, place in (places | extensions.OBSERVERS).items():
        assert callable(extensions.load(place, name)), place
    assert {*extensions.load(extensions.COMMAND_EXAMPLES, "commands")} == {*extensions.COMMANDS}
    assert "circles" in PICTURE_KINDS
