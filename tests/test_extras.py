"""Each extra brings all that its feature imports: nobody has the others."""

import ast
import functools
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.utils import canonicalize_name

from tests.checks import alone

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "dimersweep"
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
FEATURES = {  # modules that import more than the package itself needs, and the extra that their error message names
    "plots/movie.py": "movie",
    "storage/formats/zarr.py": "zarr",
}
EXECUTED = [
    page for page in sorted((ROOT / "docs").glob("*.md")) if "```{code-cell}" in page.read_text(encoding="utf-8")
]


HOMES = functools.cache(packages_distributions)  # names of packages by modules, which all their files tell


def imported(source):
    """First parts of the names of all modules that a source imports, wherever."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (each.name.split(".")[0] for each in node.names)
        if isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.split(".")[0]


def lacking(sources, extra):
    """The modules that sources import, and that are not there with this extra alone."""
    there = set(alone.closure(extra)) | {"dimersweep"}
    names = {name for source in sources for name in imported(source)} - set(sys.stdlib_module_names) - {"dimersweep"}
    return {name for name in names if not {canonicalize_name(home) for home in HOMES().get(name, ())} & there}


def test_the_package_imports_what_it_asks_for():
    others = [path for path in PACKAGE.rglob("*.py") if path.relative_to(PACKAGE).as_posix() not in FEATURES]
    assert len(others) > 150
    assert lacking((path.read_text() for path in others), alone.BASE) == set()


@pytest.mark.parametrize("module", FEATURES)
def test_a_feature_imports_what_its_extra_asks_for(module):
    source, extra = (PACKAGE / module).read_text(), FEATURES[module]
    assert lacking([source], extra) == set()
    assert lacking([source], alone.BASE) != set()


def test_pages_import_what_the_extra_for_them_asks_for():
    cells = [
        cell for page in EXECUTED for cell in re.findall(r"```{code-cell}.*?\n(.*?)```", page.read_text(), re.DOTALL)
    ]
    programs = [path.read_text() for path in (ROOT / "docs").glob("*.py")]
    cells = [re.sub(r"\A---\n.*?^---\n", "", cell, flags=re.DOTALL | re.MULTILINE) for cell in cells]  # how it is shown
    sources = [re.sub(r"^[:%!].*$", "", cell, flags=re.MULTILINE) for cell in cells if "%%" not in cell]
    assert len(sources) > 50
    beside = {path.stem for path in (ROOT / "docs").glob("*.py")}
    assert lacking(sources + programs, "docs") <= beside | {"jupytext"}  # of make_notebooks.py, which builds no page


def test_every_extra_has_a_trial():
    assert set(alone.SMOKES) == EXTRAS - {"dev"} | {alone.BASE}


def test_what_is_not_asked_for_is_not_there(tmp_path):
    """Of an environment made of links: Zarr writes, and the other extras are lacking."""
    python = alone.make(tmp_path / "alone", "zarr")
    program = (
        "import zarr, xarray, dimersweep; from importlib.util import find_spec; "
        "print([name for name in ('imageio_ffmpeg', 'SALib', 'emcee', 'sphinx', 'pytest') if find_spec(name)])"
    )
    done = subprocess.run([python, "-c", program], cwd=tmp_path, env={}, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
