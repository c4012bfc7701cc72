"""Compare the speed of two revisions in one run: ``python benchmarks/speed/compare.py REV_A REV_B [--verbs ...]``.

Both are checked out into a folder of their own and compiled once. Then pairs of fresh processes, one of each revision, time
every verb in turn on the same inputs, and a forcing period of each scene of ``speed.py`` without early stop. Printed are the
medians, the median over the pairs of B's time over A's, and an interval for it by the signs of the pairs, which needs no
assumption on the noise: together, the intervals of all verbs and scenes hold the truth with 95 %. A folder may stand for a
revision. The loops of the verbs are those of each revision, or these where it has none.

``--verbs find follow border family sustained later attractors fit`` times what is built on the engine instead, by the processor
time of a call each (``analysis_worker.py``): a call takes up to seconds, and they are asked for by name only.

``--compile ROUNDS`` times what each takes to compile its kernel from nothing, in turn, on a processor: other programs change
that little. The plain way of compiling is timed where ``DIMERSWEEP_COMPILER=plain`` is set.
"""

import argparse
import json
import os
import pickle
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from analysis_worker import ASKED
from scipy.stats import binom
from speed import SCENES
from verbs_loops import VERBS, Harvest

from dimersweep.kernel.model.layout import ROW

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
FIRST_RUN = "import dimersweep; dimersweep.simulate(periods=1, record=False)"
DOUBT = 0.05  # chance that any of the intervals misses the truth
SECONDS = 0.01  # length of one timing
TURNS = 4  # of A and B with each verb in a pair of processes
NAMES = [*VERBS, *(f"scene: {name}" for name in SCENES)]
# prints the order of the parameters in a row of the kernel, wherever the revision has it
TELL_ROW = """
import json
try:
    from dimersweep.kernel.model.layout import ROW
except ImportError:
    from dimersweep.kernel.layout import ROW
print(json.dumps(ROW))
"""


class Ratio(NamedTuple):
    """B's time over A's: the median of the pairs, and the interval for it."""

    median: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """What is shown of B."""
        if self.high < 1.0:
            return "faster"
        return "slower" if self.low > 1.0 else "no difference shown"


def sign_interval(ratios: Sequence[float] | np.ndarray, doubt: float) -> Ratio:
    """Median of paired ratios, and its interval by order statistics (each pair is above the median by a fair coin).

    Raises
    ------
    SystemExit
        If there are too few for so little doubt.
    """
    ordered = np.sort(ratios)
    n = ordered.size
    outside = np.count_nonzero(2.0 * binom.cdf(np.arange(n // 2), n, 0.5) <= doubt) - 1  # pairs left out on each side
    if outside < 0:
        raise SystemExit(f"--pairs {n}: too few; must be at least {int(np.ceil(1 - np.log2(doubt)))}")
    return Ratio(float(np.median(ordered)), float(ordered[outside]), float(ordered[n - 1 - outside]))


def git(*arguments: str) -> str:
    """What a git command of this repository prints."""
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr.strip())
    return done.stdout.strip()


@contextmanager
def checked_out(revision: str, folder: Path) -> Iterator[Path]:
    """A work tree of a revision in `folder`, gone at the end; a folder in place of a revision stands for itself."""
    if Path(revision).is_dir():
        yield Path(revision).resolve()
        return
    git("worktree", "add", "--detach", str(folder), revision)
    try:
        yield folder
    finally:
        git("worktree", "remove", "--force", str(folder))


def environment_of(tree: Path, cache: Path) -> dict[str, str]:
    """The environment of a process that imports the package of a tree."""
    return os.environ | {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(cache)}


class Worker:
    """A process that runs a script with the package of one tree, and answers each line of JSON by another one."""

    def __init__(self, script: Path, argument: str, tree: Path, cache: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(script), argument],
            env=environment_of(tree, cache),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, question: Any) -> Any:
        """The answer to a question.

        Raises
        ------
        SystemExit
            If the process has died of it.
        """
        assert self.process.stdin and self.process.stdout
        print(json.dumps(question), file=self.process.stdin, flush=True)
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"{' '.join(map(str, self.process.args))}: the process has died")
        return json.loads(line)

    def close(self) -> None:
        """End the process."""
        self.process.communicate()


def on_one_core(workers: Iterable[Worker]) -> None:
    """Have processes that take turns run on the same core, where the system can: two cores may differ in pace for a while."""
    if hasattr(os, "sched_setaffinity"):
        core = min(os.sched_getaffinity(0))
        for worker in workers:
            os.sched_setaffinity(worker.process.pid, {core})


def script_of(tree: Path) -> Path:
    """The script that times the verbs of a tree: its own, or this one."""
    own = [tree / "benchmarks" / room / "verbs_worker.py" for room in ("speed", "")]
    return next((script for script in own if script.exists()), HERE / "verbs_worker.py")


def inputs_for(found: Harvest, tree: Path, cache: Path, folder: Path) -> Path:
    """A file with the inputs of the verbs, their parameter rows cut to those that the revision of a tree knows."""
    command = [sys.executable, "-c", TELL_ROW]
    # in the tree's own folder: that of this process would come before PYTHONPATH
    told = subprocess.run(
        command, env=environment_of(tree, cache), cwd=tree, check=True, capture_output=True, text=True
    )
    # where a revision knows one value for both ends, the inputs have alike ends
    columns = [ROW.index(name if name in ROW else f"{name}_1") for name in json.loads(told.stdout)]
    cut = copy(found)
    for kinds in ("rough", "smooth"):
        every = getattr(found, kinds).items()
        setattr(cut, kinds, {kind: inputs._replace(rows=inputs.rows[:, columns].copy()) for kind, inputs in every})
    file = folder / f"{cache.name}_inputs"
    file.write_bytes(pickle.dumps(cut))
    return file


def question(name: str) -> tuple[str, Any]:
    """The script that times what has a name, none for the verbs of a tree, and what it is asked."""
    if name in ASKED:
        return "analysis_worker.py", name
    scene = name.removeprefix("scene: ")
    return ("scenes_worker.py", [SCENES[scene], SECONDS]) if scene != name else ("", [name, SECONDS])


def timed_pair(
    trees: Sequence[Path], caches: Sequence[Path], inputs: Sequence[Path], names: Sequence[str]
) -> np.ndarray:
    """Median times of each verb or scene in one pair of processes, shape (names, 2) [s]; NaN where a tree has it not."""
    each = list(zip(trees, caches, inputs, strict=True))
    scripts = {script for script, _ in map(question, names)}
    workers = {
        script: [
            Worker(HERE / script, "", tree, cache) if script else Worker(script_of(tree), str(found), tree, cache)
            for tree, cache, found in each
        ]
        for script in scripts
    }
    every = [worker for pair in workers.values() for worker in pair]
    on_one_core(every)
    taken = np.empty((len(names), 2))
    for k, name in enumerate(names):
        script, asked = question(name)
        rows = np.full((1 if name in ASKED else TURNS, 2), np.nan)
        for turn, row in enumerate(rows):
            for which in (0, 1) if turn % 2 == 0 else (1, 0):
                row[which] = workers[script][which].ask(asked)
        taken[k] = np.median(rows, axis=0)
    for worker in every:
        worker.close()
    return taken


def compare(revisions: Sequence[str], names: Sequence[str], pairs: int) -> np.ndarray:
    """Median times of each verb or scene in each pair of processes, shape (pairs, names, 2) [s]."""
    sign_interval(np.ones(pairs), DOUBT / len(names))  # too few pairs are refused before the work
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        caches = [folder / "cache_a", folder / "cache_b"]
        with checked_out(revisions[0], folder / "a") as a, checked_out(revisions[1], folder / "b") as b:
            found = Harvest(random=8, periods=6)
            inputs = [inputs_for(found, tree, cache, folder) for tree, cache in zip((a, b), caches, strict=True)]
            timed_pair((a, b), caches, inputs, names)  # compiles
            return np.array([timed_pair((a, b), caches, inputs, names) for _ in range(pairs)])


def table(times: np.ndarray, verbs: Sequence[str]) -> Iterator[str]:
    """Lines that tell what came out."""
    yield f"{'verb':30s} {'A [us]':>10s} {'B [us]':>10s} {'B / A':>7s}  interval        B is"
    for k, verb in enumerate(verbs):
        a, b = 1e6 * np.median(times[:, k], axis=0)
        if np.isnan(times[:, k]).any():
            yield f"{verb:30s} not in both"
            continue
        ratio = sign_interval(times[:, k, 1] / times[:, k, 0], DOUBT / len(verbs))
        yield f"{verb:30s} {a:10.3f} {b:10.3f} {ratio.median:7.3f}  {ratio.low:.3f}..{ratio.high:.3f}  {ratio.verdict}"
    yield f"{'median of all':52s} {np.nanmedian(np.median(times[:, :, 1] / times[:, :, 0], axis=0)):7.3f}"


def compile_seconds(tree: Path) -> float:
    """Time on a processor of a first run with nothing cached [s]."""
    with tempfile.TemporaryDirectory() as cache:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", FIRST_RUN], env=environment_of(tree, Path(cache)), cwd=tree, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime


def compiling(revisions: Sequence[str], rounds: int) -> np.ndarray:
    """Times of compiling both revisions in turn, shape (rounds, 2) [s]."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with checked_out(revisions[0], folder / "a") as a, checked_out(revisions[1], folder / "b") as b:
            return np.array([[compile_seconds(tree) for tree in (a, b)] for _ in range(rounds)])


def compile_table(taken: np.ndarray) -> Iterator[str]:
    """Lines that tell the times of compiling, shape (rounds, 2)."""
    for name, times in zip("AB", taken.T, strict=True):
        yield f"{name}: {np.median(times):.1f} s ({times.min():.1f} to {times.max():.1f})"
    yield f"B / A: {np.median(taken[:, 1] / taken[:, 0]):.2f}"


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("revisions", nargs=2, metavar="REV")
    parser.add_argument("--verbs", nargs="+", choices=[*NAMES, *ASKED], default=NAMES, metavar="VERB")
    parser.add_argument("--pairs", type=int, default=12, help="pairs of processes")
    parser.add_argument("--compile", type=int, metavar="ROUNDS", help="time compiling instead, so many times")
    given = parser.parse_args(arguments)
    if given.compile:
        print(*compile_table(compiling(given.revisions, given.compile)), sep="\n")
        return
    for line in table(compare(given.revisions, given.verbs, given.pairs), given.verbs):
        print(line)


if __name__ == "__main__":
    main()
