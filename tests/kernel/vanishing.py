"""What becomes of a small program where the fast way fails: ``python vanishing.py gone`` or ``midway`` prints lines of JSON.

Each fault is tried in a process of its own, a fork of this one, which has imported Numba and nothing of what takes its parts.
"""

import ast
import json
import os
import sys
import tempfile
import warnings
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numba
import numpy as np

COMPILER = Path(find_spec("dimersweep").submodule_search_locations[0], "kernel", "compiler")


class Without:
    """A module that lacks one name."""

    def __init__(self, whole, name):
        self.__dict__ |= {"_whole": whole, "_gone": name}

    def __getattr__(self, name):
        if name == self._gone:
            raise AttributeError(f"{self._whole!r} has no attribute {name!r}")
        return getattr(self._whole, name)


def parts():
    """Each private part of Numba that the fast way takes: its module, and its name there."""
    tree = ast.parse((COMPILER / "linking.py").read_text())
    taken = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module.startswith("numba.")]
    return sorted((node.module, each.name) for node in taken for each in node.names)


def hide(module, name):
    """Have the fast way find no `name` in a module; Numba itself keeps what it has."""
    sys.modules[module] = Without(import_module(module), name)


FAILING = (  # what is made to raise while a kernel is compiled
    "linking.KernelCompiler.define_pipelines",
    "linking.PartCompiler.compile_extra",
    "linking._Part._optimize_functions",
    "linking._Kernel._optimize_final_module",
    "linking._Kernel.finalize",
)


def fail(place):
    """Have something of the fast way raise from now on."""
    module, owner, name = place.split(".")

    def broken(*_):
        raise AttributeError("made to fail")

    setattr(getattr(import_module(f"dimersweep.kernel.compiler.{module}"), owner), name, broken)


def refusal(function, given):
    """The kind of error that a call ends with."""
    try:
        function(*given)
    except Exception as error:
        return type(error).__name__


def outcome(hidden=None, failing=None, wrong=False):
    """What the program gives with a part hidden or made to fail midway, how it was compiled, and what was told."""
    if hidden:
        hide(*hidden)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        from dimersweep.kernel.compiler import cache, pipelines, versions
        from tests.kernel import tiny

        found = {"before": versions.code_version(pipelines.pipeline()), "values": [tiny.simple(9.0)]}
        if failing:
            fail(failing)
        if wrong:
            found["refused"] = list(
                map(refusal, (tiny.wrong, tiny.simple, tiny.root, tiny.leaf), ([4.0], ["x"], [], [4.0]))
            )
        found["values"] += [tiny.root(np.array([4.0, 0.0])), tiny.simple(9.0)]
    code = {file.name: file.stat().st_ino for file in cache.files(versions.code_version(pipelines.pipeline()), "[rs]*")}
    lines = [str(each.message) for each in told if each.category is RuntimeWarning]
    return found | {
        "way": pipelines.pipeline(),
        "after": versions.code_version(pipelines.pipeline()),
        "told": lines,
        "code": code,
    }


def in_fork(folder, environment=(), **asked):
    """Print what `outcome` returns in a fork of this process, whose compiled code is kept in a folder."""
    child = os.fork()
    if child == 0:
        os.environ.update({"NUMBA_CACHE_DIR": folder}, **dict(environment))
        try:
            found = outcome(**asked)
        except BaseException as error:
            found = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(asked | dict(environment) | found), flush=True)
        os._exit(0)
    os.waitpid(child, 0)


def main(kind):
    """Print what becomes of the program where each part is gone, or where the fast way fails midway and in a later process."""
    numba.njit(lambda x: x[0] + 1.0)(np.ones(2))  # so that the forks need not begin with it
    with tempfile.TemporaryDirectory() as folder:
        if kind == "gone":
            for n, place in enumerate([None, *parts()]):
                in_fork(f"{folder}/{n}", hidden=place)
            return
        for place in FAILING:
            in_fork(f"{folder}/{place}", failing=place)
            in_fork(f"{folder}/{place}")
        in_fork(f"{folder}/asked", {"DIMERSWEEP_COMPILER": "fast"}, failing=FAILING[0])
        in_fork(f"{folder}/asked", {"DIMERSWEEP_COMPILER": "fast"}, hidden=("numba.core.compiler", "CompilerBase"))
        in_fork(f"{folder}/asked", {"DIMERSWEEP_COMPILER": "plain"})
        in_fork(f"{folder}/wrong", wrong=True)


if __name__ == "__main__":
    main(sys.argv[1])
