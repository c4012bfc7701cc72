"""What compiling the kernel takes in each of some revisions: ``python benchmarks/speed/compile_time.py REV [REV ...]``.

Each compiles its kernel from nothing in a process of its own. The rounds are taken in turn, and times are those on a processor:
other programs change them little. A folder may stand for a revision. The plain way of compiling is timed where
``DIMERSWEEP_COMPILER=plain`` is set.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from compare import checked_out, environment_of

FIRST_RUN = "import dimersweep; dimersweep.simulate(periods=1, record=False)"


def compile_seconds(tree: Path) -> float:
    """Time on a processor of a first run with nothing cached [s]."""
    with tempfile.TemporaryDirectory() as cache:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", FIRST_RUN], env=environment_of(tree, Path(cache)), cwd=tree, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime


def table(names: Sequence[str], taken: np.ndarray) -> Iterator[str]:
    """Lines that tell the times of each revision, shape (rounds, revisions), and their ratios to those of the first one."""
    yield f"{'':40s} user CPU [s], median (least, most)   over the first"
    for name, times in zip(names, taken.T, strict=True):
        over = np.median(times / taken[:, 0])
        yield f"{name:40s} {np.median(times):7.1f}  ({times.min():.1f}, {times.max():.1f}) {over:18.2f}"


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("revisions", nargs="+", metavar="REV")
    parser.add_argument("--rounds", type=int, default=3, help="compilations of each")
    given = parser.parse_args(arguments)
    taken = np.zeros((given.rounds, len(given.revisions)))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        trees = [stack.enter_context(checked_out(name, folder / str(k))) for k, name in enumerate(given.revisions)]
        for turn, k in np.ndindex(taken.shape):
            taken[turn, k] = compile_seconds(trees[k])
            print(f"round {turn + 1}: {given.revisions[k]:40s} {taken[turn, k]:6.1f}", flush=True)
    print(*table(given.revisions, taken), sep="\n")


if __name__ == "__main__":
    main()
