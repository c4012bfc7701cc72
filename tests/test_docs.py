"""The pages in docs/ say what is so: files, links, keys and attributes that they name are there, and their examples run."""

import inspect
import json
import pydoc
import re
import subprocess
import sys
import tomllib
from dataclasses import fields
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

import pytest
import yaml
from dask.system import CPU_COUNT
from pydantic import BaseModel
from sybil import Sybil
from sybil.document import PythonDocStringDocument
from sybil.evaluators.doctest import NUMBER
from sybil.parsers.myst import PythonCodeBlockParser, SkipParser
from sybil.parsers.rest import DocTestParser

import dimersweep
from dimersweep import refine, search, sweep
from dimersweep.analysis.borders.border_files import Borders
from dimersweep.cubes.cube import FLAGS
from dimersweep.parameters import ParameterKeywords, Parameters
from dimersweep.studies.declared import Declaration, read_declaration
from dimersweep.symbols import BASE, HIGHER, PARAMETERS, STAND_INS, Picture, value_shown
from dimersweep.work.options import Options, make_options
from tests.checks.public import keywords

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").glob("*.md"), *ROOT.glob("*.md")])


def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


def test_every_file_that_the_page_of_the_model_names_is_there():
    named = set(re.findall(r"`([a-z_]+(?:/[a-z_]+)*\.py)`", text_of("docs/model.md")))
    assert len(named) > 15
    kernel = ROOT / "dimersweep" / "kernel"
    assert not [name for name in named if not (kernel / name).exists()]


@pytest.mark.parametrize("number", [*range(1, 9), "A.1", "A.2", "A.3", "A.4", "A.5", "A.6"])
def test_the_page_of_the_model_maps_every_numbered_equation(number):
    page = text_of("docs/model.md")
    table = page[page.index("## Map from the paper to the code") :]
    assert f"({number})" in table


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_within_the_repository_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if "://" not in target and not target.startswith("mailto:"):
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_programs_and_presets_that_a_page_names_are_there(page):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"\b(?:benchmarks|docs|sweeps|tests|notebooks)/[\w/-]+\.(?:py|toml|ipynb|json)\b", text):
        assert "/NAME" in name or (ROOT / name).exists(), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_extras_that_a_page_names_are_there(page):
    text = page.read_text(encoding="utf-8")
    for verb in re.findall(r"\./go (\w+)", text):
        assert re.search(rf"^{verb}\)$", text_of("go"), re.MULTILINE), verb
    for extra in re.findall(r"\.\[(\w+)\]'", text):
        assert extra in tomllib.loads(text_of("pyproject.toml"))["project"]["optional-dependencies"], extra


def test_the_page_on_installing_has_every_extra():
    extras = tomllib.loads(text_of("pyproject.toml"))["project"]["optional-dependencies"]
    assert set(re.findall(r"\.\[(\w+)\]'", text_of("docs/install.md"))) == set(extras)


def test_the_citation_is_of_this_version_and_of_the_paper():
    citation = yaml.safe_load(text_of("CITATION.cff"))
    assert citation["version"] == dimersweep.__version__
    (paper,) = citation["references"]
    assert paper["title"] in text_of("README.md")
    assert all(author["family-names"] in text_of("README.md") for author in paper["authors"])


# --- examples ---------------------------------------------------------------------------------------------------------
def examples_of(path, parsers, **more):
    """The examples of a file, with the namespace that they share."""
    document = Sybil(parsers=parsers, **more).parse(path)
    document.namespace |= {"__name__": "__main__", "find_spec": find_spec}
    return list(document.examples()), document.namespace


# blocks that fit for seconds: `fits.fit` and `fits.Likelihood` have shorter examples
OF_RELEASE = ('"A_r": (5.8, 6.2)}', "emcee.EnsembleSampler", "LocalCluster(n_workers=2")
WITH_PYTHON = [page for page in PAGES if "```python" in page.read_text(encoding="utf-8")]


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_pictures")
@pytest.mark.parametrize("times", [1, pytest.param(2, marks=pytest.mark.release)])
@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.name)
def test_each_block_of_a_page_runs_by_itself(page, times, tmp_path, monkeypatch):
    """And before a release once more in the folder that it has been run in, if it has left anything there."""
    for again in range(times):
        examples, names = examples_of(page, [PythonCodeBlockParser(), SkipParser()])
        shared = dict(names)
        assert examples
        for number, example in enumerate(examples):
            names.clear()
            names |= shared
            folder = tmp_path / str(number)
            folder.mkdir(exist_ok=bool(again))
            monkeypatch.chdir(folder)
            left_out = times == 1 and any(words in str(example.parsed) for words in OF_RELEASE)
            if not left_out and (not again or any(folder.iterdir())):
                example.evaluate()


WITH_DOCTESTS = [
    path for path in sorted((ROOT / "dimersweep").rglob("*.py")) if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.usefixtures("coarse_pictures")
@pytest.mark.parametrize("path", WITH_DOCTESTS, ids=lambda path: str(path.relative_to(ROOT / "dimersweep")))
def test_the_examples_of_docstrings_print_what_they_show(path, empty_folder):
    examples, _ = examples_of(
        path, [DocTestParser(optionflags=NUMBER)], document_types={".py": PythonDocStringDocument}
    )
    assert examples
    for example in examples:
        example.evaluate()


# --- sweep files ------------------------------------------------------------------------------------------------------
def sections(declaration):
    """The sections of a declaration that have keys of their own, and their models."""
    for name, field in declaration.model_fields.items():
        kinds = [field.annotation, *getattr(field.annotation, "__args__", ())]
        yield from ((name, kind) for kind in kinds if inspect.isclass(kind) and issubclass(kind, BaseModel))


def as_written(field):
    """The default of a key as the page has it."""
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    return "none" if default is None else default if isinstance(default, str) else json.dumps(default)


@pytest.mark.parametrize(("page", "declaration"), [("sweepfile", Declaration), ("orbits", Borders)])
def test_the_page_on_a_kind_of_file_has_every_key_with_its_default(page, declaration):
    rows = re.findall(r"^\| `(\w+\.\w+)` \| [^|]+ \| ([^|]+) \|", text_of(f"docs/{page}.md"), re.MULTILINE)
    keys = {
        f"{section}.{key}": as_written(field)
        for section, model in sections(declaration)
        for key, field in model.model_fields.items()
    }
    assert dict(rows) == keys


def test_the_page_on_sweep_files_has_every_kind_of_picture():
    from dimersweep.symbols import PICTURE_KINDS

    rows = re.findall(r"^\| `(\w+)` \|", text_of("docs/sweepfile.md"), re.MULTILINE)
    assert set(rows) == set(PICTURE_KINDS)


def test_the_gallery_has_every_kind_of_picture():
    gallery = text_of("docs/gallery.md")
    for kind in get_args(Picture):
        assert re.search(rf"^##.*`{kind}`$", gallery, re.MULTILINE), kind
    for kind in ("branch", "families", "atlas"):
        assert f'"{kind}-small.toml"' in gallery


def test_the_sweep_files_of_the_page_are_some(tmp_path):
    grid, points = re.findall(r"```toml\n(.*?)```", text_of("docs/sweepfile.md"), re.DOTALL)
    file = tmp_path / "angles.toml"
    file.write_text(grid, encoding="utf-8")
    assert list(read_declaration(file).grid) == ["f", "beta0"]
    file.write_text(points, encoding="utf-8")
    assert read_declaration(file).study().grid.size == 512


def test_no_page_runs_a_command_through_a_terminal():
    """Which IPython reads in pieces that may end within a letter, and that breaks lines at 80 columns."""
    for page in sorted((ROOT / "docs").glob("*.md")):
        for cell in re.findall(r"```\{code-cell\}.*?\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            assert not re.search(r"^!", cell, re.MULTILINE), page


# --- Python -----------------------------------------------------------------------------------------------------------
def test_the_page_on_python_has_every_public_name():
    shown = set(re.findall(r"^   ([\w.]+)$", text_of("docs/api.md"), re.MULTILINE))
    modules = {
        name for name in dimersweep.__all__ if inspect.ismodule(getattr(dimersweep, name))
    }  # their names are there
    assert set(dimersweep.__all__) - modules <= shown
    public = [name for name, value in vars(dimersweep.Run).items() if not name.startswith("_") and value.__doc__]
    assert {f"Run.{name}" for name in public if name not in ("record", *dimersweep.Run.__annotations__)} <= shown


@pytest.mark.parametrize("module", ["dimersweep", "dimersweep.fits", "dimersweep.orbits", "dimersweep.plots"])
def test_every_public_function_and_class_has_an_example(module):
    public = {name: getattr(import_module(module), name) for name in import_module(module).__all__}
    without = [name for name, value in public.items() if callable(value) and ">>> " not in (value.__doc__ or "")]
    assert without == []


def test_the_help_of_a_run_names_each_parameter_of_the_model():
    told = set(re.findall(r"`(\w+)`", dimersweep.simulate.__doc__))
    assert {*PARAMETERS, *STAND_INS} - HIGHER <= told


def test_parameters_tell_units_and_defaults():
    told = " ".join(Parameters.__doc__.split())
    for name in {*BASE} - {"beta0"}:  # which is in degrees
        assert re.search(rf"\b{name}\b", told) and re.search(rf"\b{BASE[name]:.6g}\b", told), name
    assert value_shown("beta0", BASE["beta0"]) == "16\N{DEGREE SIGN}" and '"16 deg" and 1 by default' in told
    assert all(f"[{PARAMETERS[name].units}]" in told for name in PARAMETERS)


def test_keywords_of_parameters_are_all_parameters():
    assert [*ParameterKeywords.__annotations__] == [
        *(name for name in PARAMETERS if name not in HIGHER),
        *STAND_INS,
        *(name for name in PARAMETERS if name in HIGHER),
    ]
    for function in (dimersweep.simulate, Parameters.__init__):
        assert keywords(function) == [*ParameterKeywords.__annotations__]


@pytest.mark.parametrize("name", ["sweep", "bifurcation", "search", "refine", "make"])
def test_what_makes_a_cube_names_its_options(name):
    function = getattr(dimersweep, name)
    shown = {*inspect.signature(function).parameters, *keywords(function)}
    assert {each.name for each in fields(Options)} <= shown
    usual = make_options()
    assert (usual.progress, usual.workers, usual.force, usual.out) == (True, CPU_COUNT, False, None)


def test_a_sweep_tells_each_of_its_options():
    told = re.findall(r"^    (\w+) : ", dimersweep.sweep.__doc__, re.MULTILINE)
    assert {*keywords(dimersweep.sweep), *inspect.signature(dimersweep.sweep).parameters} - {"options"} == {*told}
    assert {*keywords(dimersweep.bifurcation)} < {*told}


PAGES_OF_NAMES = re.findall(r"^   ([\w.]+)$", text_of("docs/api.md"), re.MULTILINE)


def test_every_room_is_reached_after_the_import_of_the_package_alone():
    """Each one first, in a process that has loaded nothing else of the package; and all of them in turn."""
    program = """
import gc, os, sys
from functools import reduce
gc.disable()  # to look through all that was imported takes a tenth of the time
import matplotlib.figure, numba, pydantic, scipy.interpolate, scipy.signal, scipy.stats, xarray  # once for all of them
import dimersweep
assert [name for name in sys.modules if name.startswith("dimersweep.")] == ["dimersweep.faces"]
for names in (*([name] for name in sys.argv[1:]), sys.argv[:0:-1]):
    if (child := os.fork()) == 0:
        code = 1
        try:
            for name in names:
                reduce(getattr, name.split("."), dimersweep)
            code = 0
        finally:
            os._exit(code)
    if os.waitpid(child, 0)[1]:
        print(names)
"""
    first = {name.rpartition(".")[0]: name for name in PAGES_OF_NAMES if "." in name and name[0].islower()}
    assert {"orbits", "plots"} <= first.keys()
    inside = ("cubes.findings.exponents", "errors.PointError", "runs.outcomes.Orbit", "studies.declared.make")
    first |= {name.rpartition(".")[0]: name for name in inside}
    told = {"capture_output": True, "text": True, "cwd": ROOT}
    done = subprocess.run([sys.executable, "-c", program, *first.values()], check=False, **told)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    assert {name.partition(".")[0] for name in first} <= set(dir(dimersweep))
    for room in (dimersweep, dimersweep.cubes, dimersweep.runs, dimersweep.studies):
        with pytest.raises(AttributeError, match=rf"^module '{room.__name__}' has no attribute 'nothing'$"):
            getattr(room, "nothing")  # noqa: B009


@pytest.mark.parametrize("name", PAGES_OF_NAMES)
def test_every_page_of_a_name_has_an_example(name):
    named = pydoc.locate(f"dimersweep.{name}")
    assert named is not None
    assert ">>> " in inspect.getdoc(named)


@pytest.mark.parametrize("name", PAGES_OF_NAMES)
def test_every_page_of_a_name_links_to_its_source(name, monkeypatch):
    pycode = pytest.importorskip("sphinx.pycode")
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    parts = name.split(".")
    first = next(
        (k for k, part in enumerate(parts) if part[0].isupper()), len(parts) - 1
    )  # of a class, or the last one
    module, attribute = ".".join(["dimersweep", *parts[:first]]), ".".join(parts[first:])
    analyzer = pycode.ModuleAnalyzer.for_module(import_module("conf").home_of(None, module, attribute))
    analyzer.find_tags()
    assert attribute in analyzer.tags


# --- cubes ------------------------------------------------------------------------------------------------------------
@pytest.fixture
def tables(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    yield __import__("tables")
    sys.modules.pop("tables")


def test_the_page_on_cubes_explains_every_word_of_every_flag(tables):
    assert {name: list(words) for name, words in tables.WORDS.items()} == {
        name: list(words) for name, words in FLAGS.items()
    }


def test_the_page_on_cubes_shows_every_flag():
    shown = set(re.findall(r'flags\("(\w+)"\)', text_of("docs/cubes.md")))
    assert shown == FLAGS.keys() - {"outcome"}  # whose words are those of mode


def test_the_page_on_cubes_has_every_attribute_and_variable(tables, fake_kernel, empty_folder):
    grid, how = {"e": [0.5, 0.7], "Gamma": [0.8, 1.0], "beta0": [0.2, 0.4]}, {"periods": 10, "progress": False}
    cubes = [
        sweep(grid, **how, certify=True, out="one.nc", attrs={"plot": "segments"}),
        sweep(grid | {"beta0": [0.2, 0.3]}, **how, certify=True, extend="one.nc"),
        search(grid, over="beta0", **how, paths={"periods": 5}),
        refine(grid, over="beta0", halvings={"e": 1}, **how),
    ]
    named = tables.ATTRIBUTES.keys() | tables.SOMETIMES.keys()
    for cube in cubes:
        assert tables.ATTRIBUTES.keys() <= set(cube.attrs) <= named
        for name in map(str, cube.data_vars):
            shown = tables.quantities().data + tables.parameters().data + tables.states().data
            assert f"`{name}`" in shown, name
