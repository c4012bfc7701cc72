"""Who may import whom, where import-linter does not look: the tests, and the programs that measure; and names used twice."""

import ast
import subprocess
import sys
import threading
import tomllib
from functools import cache
from pathlib import Path

import pytest

import dimersweep
from dimersweep.cubes.grid import Grid
from dimersweep.studies.study import Study

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("speed", "evidence", "peers")
PROGRAMS = {path.stem: room for room in ROOMS for path in (ROOT / "benchmarks" / room).rglob("*.py")}


def imported(path):
    """Full names of the modules that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def files(folder):
    found = sorted((ROOT / folder).rglob("*.py"))
    assert found
    return found


@pytest.mark.parametrize("path", files("tests"), ids=lambda path: str(path.relative_to(ROOT)))
def test_tests_import_nothing_from_the_benchmarks(path):
    assert not [name for name in imported(path) if name.split(".")[0] in {"benchmarks", *PROGRAMS}]


@pytest.mark.parametrize("room", ROOMS)
def test_a_program_imports_its_room_and_what_it_shares_with_the_tests(room):
    for path in files(f"benchmarks/{room}"):
        for name in imported(path):
            first, *rest = name.split(".")
            assert PROGRAMS.get(first, room) == room, f"{path}: {name}"
            if first == "tests":
                assert rest[0] in {"checks", "oracle", "limits"}, f"{path}: {name}"


@cache
def defined(path):
    """Constants and classes that a module defines."""
    return {*definitions(path)}


def definitions(path):
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef):
            yield node.name
        for target in [*getattr(node, "targets", ()), getattr(node, "target", None)]:
            names = [name.id for name in ast.walk(target) if isinstance(name, ast.Name)] if target else []
            yield from (name for name in names if name.isupper() and len(name) > 1)


@pytest.mark.parametrize(
    "room", ["analysis", "cli", "cubes", "exploring", "plots", "runs", "storage", "studies", "work"]
)
def test_a_constant_or_a_class_of_a_room_has_no_namesake_in_another_module(room):
    own = {path: defined(path) for path in files(f"dimersweep/{room}")}
    others = {path: defined(path) for path in files("dimersweep")}
    assert not [
        (name, str(path.relative_to(ROOT)), str(other.relative_to(ROOT)))
        for path, names in own.items()
        for other in others.keys() - {path}
        for name in sorted(names & others[other])
    ]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a checkout")
def test_all_that_is_kept_here_is_shipped_in_the_source_distribution():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    builds = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["sdist"]
    always = {"pyproject.toml", ".gitignore"}  # hatchling's own choice
    assert {name.split("/")[0] for name in listed} == {*builds["include"], *always}
    # a folder that a link shows twice is packed once, unless it is asked for by name
    links = [ROOT / name for name in listed if (ROOT / name).is_symlink()]
    assert {str(link.resolve().relative_to(ROOT)) for link in links} == set(builds["force-include"])


def test_the_grid_of_a_sweep_makes_few_stays(fake_kernel, monkeypatch, tmp_path):
    """A stay is what calls of one file, one after the other, are given the grid or read it off the study; its own are none."""
    axes, stays = {"Gamma": [0.6]}, []

    def note(code):
        path = Path(code.co_filename)
        if ROOT / "dimersweep" in path.parents and not code.co_qualname.startswith("Grid.") and [path] != stays[-1:]:
            stays.append(path)

    def called(frame, event, _):
        names = frame.f_code.co_varnames[: frame.f_code.co_argcount + frame.f_code.co_kwonlyargcount]
        given = [frame.f_locals.get(name) for name in names] if event == "call" else []
        if any(each is axes or isinstance(each, Grid) for each in given):
            note(frame.f_code)

    def read(study, name):
        if name == "grid":
            note(sys._getframe(1).f_code)
        return object.__getattribute__(study, name)

    monkeypatch.setattr(Study, "__getattribute__", read)
    for profile in (threading.setprofile, sys.setprofile):
        profile(called)
    try:
        dimersweep.sweep(axes, periods=5, progress=False, workers=1, out=tmp_path / "cube.nc")
    finally:
        for profile in (threading.setprofile, sys.setprofile):
            profile(None)
    assert 4 < len(stays) <= 12 and len(set(stays)) <= 9, stays
