"""What compiling the kernel takes, and what each part of the fast path saves: ``python benchmarks/speed/compile_time.py``.

Each way compiles the kernel from nothing in a process of its own, from a copy of the package in which one part is taken out.
The rounds are taken in turn, and times are those on a processor: other programs change them little.
"""

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
from compare import checked_out, environment_of

ROOT = Path(__file__).resolve().parents[2]
FIRST_RUN = "import dimersweep; dimersweep.simulate(periods=1, record=False)"


def replaced(old: str, new: str) -> Callable[[str], str]:
    """An edit of a text that occurs once.

    Raises
    ------
    ValueError
        When the edit is made and the text is not there, or is there more often.
    """

    def edit(source: str) -> str:
        if source.count(old) != 1:
            raise ValueError(f"{old!r} occurs {source.count(old)} times, not once")
        return source.replace(old, new)

    return edit


class Way(NamedTuple):
    """A way to compile: an edit of a module of the compiler's, and settings of the environment."""

    module: str = ""
    edit: Callable[[str], str] = str
    environment: tuple[tuple[str, str], ...] = ()


WAYS = {
    "fast": Way(environment=(("DIMERSWEEP_COMPILER", "fast"),)),
    "plain": Way(environment=(("DIMERSWEEP_COMPILER", "plain"),)),
    "parts made machine code one by one": Way(
        "compiling", replaced('"pipeline_class": _PartCompiler', '"pipeline_class": KernelCompiler')
    ),
    "constants typed as literals": Way(
        "jit",
        replaced("    if typed is None:", "    if True:"),
    ),
    "all passes of Numba": Way(
        "compiling",
        replaced(
            "        passes.finalize()\n",
            "        from numba.core.compiler import DefaultPassBuilder\n"
            "        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)\n"
            "        ours = [(_KernelLowering if one is NativeLowering else one, text) for one, text in passes.passes]\n"
            "        passes.passes = ours\n"
            "        passes._finalized = False\n"
            "        passes.finalize()\n",
        ),
    ),
    "passes with checks and events": Way("compiling", replaced("    def _runPass(", "    def unused(")),
    "lifetimes of variables": Way("compiling", replaced("    _KernelSSA,\n", "    ReconstructSSA,\n")),
    "a pass manager for each declaration": Way("linking", replaced("    def _optimize_functions(", "    def unused(")),
    "elements lowered by Numba": Way("compiling", replaced("    _KernelLowering,\n", "    NativeLowering,\n")),
    "every operation typed anew": Way("compiling", replaced("    _Function.get_call_type = _type_once\n", "")),
    "garbage looked for": Way("compiling", replaced("    gc.disable()", "    pass")),
    "sizes asked anew": Way("compiling", replaced("        context.get_abi_sizeof = ", "        unused = ")),
    "reference counts": Way("compiling", replaced('"_nrt": False, ', "")),
    "wrapper for C": Way("compiling", replaced(', "no_cfunc_wrapper": True}', "}")),
}


def make_copy(way: Way, folder: Path) -> Path:
    """A copy of the package in `folder`, edited; the folder."""
    shutil.copytree(ROOT / "dimersweep", folder / "dimersweep", ignore=shutil.ignore_patterns("__pycache__"))
    if way.module:
        (path,) = (folder / "dimersweep" / "kernel").rglob(f"{way.module}.py")
        path.write_text(way.edit(path.read_text()))
    return folder


def compile_seconds(way: Way, tree: Path) -> float:
    """Time on a processor of a first run with nothing cached [s]."""
    with tempfile.TemporaryDirectory() as cache:
        environment = environment_of(tree, Path(cache)) | dict(way.environment)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", FIRST_RUN], env=environment, cwd=tree, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3, help="compilations each way")
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS), metavar="WAY")
    parser.add_argument("--against", metavar="REVISION", help="compile the kernel of this revision, too, and first")
    given = parser.parse_args(arguments)
    ways = {name: WAYS[name] for name in given.ways}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        trees = {name: make_copy(way, folder / str(k)) for k, (name, way) in enumerate(ways.items())}
        if given.against:
            ways = {given.against: Way()} | ways
            trees = {given.against: stack.enter_context(checked_out(given.against, folder / "against"))} | trees
        taken = np.zeros((given.rounds, len(trees)))
        for turn in range(given.rounds):
            for k, (way, tree) in enumerate(trees.items()):
                taken[turn, k] = compile_seconds(ways[way], tree)
                print(f"round {turn + 1}: {way:40s} {taken[turn, k]:6.1f}", flush=True)
    print(f"\n{'':40s} user CPU [s], median (least, most)   over the first")
    for way, times in zip(ways, taken.T, strict=True):
        over = np.median(times / taken[:, 0])
        print(f"{way:40s} {np.median(times):7.1f}  ({times.min():.1f}, {times.max():.1f}) {over:18.2f}")


if __name__ == "__main__":
    main()
