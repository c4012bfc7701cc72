"""What the page on other programs shows is what they print: its blocks are run from there, where a program is installed."""

import ast
import re
import shutil
import subprocess
from contextlib import chdir, redirect_stdout
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

PAGE = Path(__file__).parents[1] / "docs" / "other-programs.md"
SHARES, RADII = (0.204545, 0.25, 0.295455), (4.247393, 8.082660, 13.015139)
NUMBER = r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w.]*[A-Za-z])"


class Recipe(NamedTuple):
    """A block of the page with what it shows, and the heading that it stands under."""

    program: str
    language: str
    code: str
    shown: str


def recipes():
    """All of the page, in order."""
    found = []
    for section in re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE):
        blocks = re.findall(r"^```(\w+)\n(.*?)^```(?:\n\n```text\n(.*?)^```)?", section, re.DOTALL | re.MULTILINE)
        found += [Recipe(section.splitlines()[0], *block) for block in blocks]
    return found


MAKING, *RECIPES = recipes()
RUN = {"bash": ("bash", "-c"), "octave": ("octave-cli", "--norc", "-q", "--eval"), "r": ("Rscript", "--vanilla", "-e")}


@cache
def lacking(recipe):
    """What it takes that is not installed here."""
    if recipe.language == "py":
        bodies = ast.walk(ast.parse(recipe.code))
        names = [
            each.names[0].name if isinstance(each, ast.Import) else each.module
            for each in bodies
            if isinstance(each, ast.Import | ast.ImportFrom)
        ]
        if "iris" in names and find_spec("xxhash") and int(version("xxhash").split(".")[0]) > 3:
            return ["xxhash<4, which iris needs"]
        return [name for name in names if not find_spec(name.split(".")[0])]
    if recipe.language == "bash":
        commands = re.findall(r"(?:^|\| |&& )(\w+)", recipe.code, re.MULTILINE)
        return [name for name in commands if not shutil.which(name)]
    if not shutil.which(RUN[recipe.language][0]):
        return [recipe.program]
    needed = re.findall(r"library\(\w+\)|pkg load \w+", recipe.code)
    return [line for line in needed if run(recipe.language, line, None).returncode]


def run(language, code, folder):
    """Run code in a folder: Python in this process, another language by its program."""
    if language not in RUN:
        with chdir(folder), redirect_stdout(StringIO()) as printed:
            exec(compile(code, str(PAGE), "exec"), {})
        return subprocess.CompletedProcess(code, 0, printed.getvalue(), "")
    return subprocess.run([*RUN[language], code], check=False, cwd=folder, capture_output=True, text=True, timeout=100)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The folder with the files of the page, and what is printed when they are made."""
    folder = tmp_path_factory.mktemp("files")
    made = run(MAKING.language, MAKING.code, folder)
    assert made.returncode == 0, made.stderr
    return folder, made.stdout


def agree(shown, printed):
    """Whether two texts have the same words, and the same numbers to five digits."""
    assert re.sub(NUMBER, "#", shown).split() == re.sub(NUMBER, "#", printed).split()
    numbers = [np.array(re.findall(NUMBER, text), float) for text in (shown, printed)]
    np.testing.assert_allclose(*numbers, rtol=1e-5)


def test_the_files_are_made_as_shown(files):
    agree(MAKING.shown, files[1])
    cube = xr.open_dataset(files[0] / "cube.nc")
    np.testing.assert_allclose((cube["mode"] == 3).mean("beta0"), SHARES, rtol=1e-5)
    np.testing.assert_allclose(cube["radius"].mean("beta0"), RADII, rtol=1e-6)


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda each: f"{each.program}-{RECIPES.index(each)}")
def test_a_recipe_prints_what_is_shown(recipe, files):
    if missing := lacking(recipe):
        pytest.skip(f"another program is not installed: {', '.join(missing)}")
    done = run(recipe.language, recipe.code, files[0])
    assert done.returncode == 0, done.stderr
    agree(recipe.shown, done.stdout)


@pytest.mark.parametrize("program", sorted({each.program for each in RECIPES}))
def test_each_program_gives_the_same_answer(program):
    shown = " ".join(each.shown for each in RECIPES if each.program == program)
    numbers = np.array(re.findall(NUMBER, shown), float)
    for wanted in RADII:
        assert np.isclose(numbers, wanted, rtol=1e-4).any() or np.isclose(numbers, 100 * wanted, rtol=1e-4).any()


def test_ncview_opens_the_cube(files):
    if not (shutil.which("ncview") and shutil.which("xvfb-run")):
        pytest.skip("another program is not installed: ncview, or xvfb-run for its window")
    done = run("bash", "xvfb-run -a timeout 2 ncview cube.nc", files[0])
    assert done.returncode == 124, done.stderr  # it was still there
    assert "unknown" not in done.stdout + done.stderr
