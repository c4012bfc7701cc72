"""How far the states of two revisions are apart: ``python benchmarks/speed/same_states.py REV_A REV_B [--runs 300]``.

For changes of the kernel that may change last digits, where ``same_bits.py`` says no more than that they do. Random scenes of a
laboratory are run for a few forcing periods, short enough that no difference grows much; the states at the end are compared
in their scales. The modes of Fig. 7, every tenth of a degree, are compared as well. The exit status is 1 if a status or a mode
differs, or a state by more than ten times `rtol`. A folder may stand for a revision.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

PERIODS = 4
ALLOWED = 10.0  # difference of a state, over rtol
SEED = 7


def scenes(n: int) -> list[dict[str, float]]:
    """Parameters of random scenes, as far from the base case as a laboratory would go."""
    rng = np.random.default_rng(SEED)
    made = []
    for _ in range(n):
        mu = rng.uniform(0.02, 0.6)
        scene = {
            "e": rng.uniform(0.2, 0.9),
            "Gamma": rng.uniform(0.5, 2.5),
            "mu": mu,
            "mu_s": mu * rng.uniform(1.0, 2.0),
        }
        start = {"beta0": rng.uniform(0.02, 1.5), "xdot0": rng.uniform(0.0, 3.0)}
        made.append(scene | start | {"f": rng.uniform(15.0, 35.0), "A_r": rng.uniform(3.0, 8.0)})
    return made


def scale_of(name: str) -> float:
    """Scale of a state: 1 cm, 0.1 m/s, 1 rad, 1 rad/s, and 100 rad/s for the spin."""
    if name.startswith(("gap", "x", "y", "z")):
        return 0.1 if name.endswith("_rate") else 0.01
    return 100.0 if name == "gamma_rate" else 1.0


def answer(n: int, rtol: float) -> list[tuple[str, dict[str, float]]]:
    """Status and last state of each scene, by the package that is imported; whole turns of an angle do not count."""
    from dimersweep import simulate

    found = []
    for scene in scenes(n):
        run: Any = simulate(**scene, periods=PERIODS, rtol=rtol, stop_when_settled=False)
        states = run.states(np.array([PERIODS / scene["f"] * (1 - 1e-9)]))
        skipped = ("phase", "contact_state", "plate")
        names = [name for name in states.data_vars if name not in skipped and not name.startswith("strobe")]
        found.append((str(run.status), {name: float(states[name][0]) for name in names}))
    return found


def fig7(**how: Any) -> Any:
    """The cube of the base case for three frequencies and 899 dip angles (Fig. 7)."""
    from dimersweep import sweep

    grid = {"f": [15, 20, 25], "beta0": {"start": 0.1, "stop": 89.9, "num": 899, "unit": "deg"}}
    return sweep(grid, periods=400, progress=False, **how)


def modes() -> list[int]:
    """Modes of Fig. 7."""
    return fig7()["mode"].values.ravel().tolist()


def answers_of(revision: str, n: int, rtol: float) -> tuple[list[tuple[str, dict[str, float]]], np.ndarray]:
    """Answers and modes of a revision, in a process of its own."""
    from compare import (
        checked_out,
        environment_of,
    )  # not in that process: of an old revision this could not be imported

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with checked_out(revision, folder / "tree") as tree:
            command = [sys.executable, __file__, "--answer", str(n), str(rtol)]
            environment = environment_of(tree, folder / "cache")
            done = subprocess.run(command, env=environment, cwd=folder, check=True, stdout=subprocess.PIPE, text=True)
    answers, found = json.loads(done.stdout)
    return [(status, state) for status, state in answers], np.array(found)


def apart(one: dict[str, float], other: dict[str, float]) -> float:
    """Largest difference of what both states hold, in its scale."""
    both = [name for name in one if name in other and np.isfinite(one[name])]
    return max((abs(one[name] - other[name]) / scale_of(name) for name in both), default=0.0)


def main(arguments: list[str] | None = None) -> int:
    """Print how far the states are apart."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("revisions", nargs="*", metavar="REV")
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--rtol", type=float, default=1e-8)
    parser.add_argument("--answer", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.answer:
        print(json.dumps([answer(int(given.answer[0]), float(given.answer[1])), modes()]))
        return 0
    if len(given.revisions) != 2:
        parser.error("two revisions are compared")
    (one, modes_one), (other, modes_other) = (answers_of(each, given.runs, given.rtol) for each in given.revisions)
    statuses = sum(a != b for (a, _), (b, _) in zip(one, other, strict=True))
    far = np.array([apart(a, b) for (_, a), (_, b) in zip(one, other, strict=True)])
    print(
        f"{given.runs} runs of {PERIODS} periods at rtol {given.rtol:.0e}: {statuses} statuses differ; states are apart by "
        f"{np.median(far):.1e} (median), {np.quantile(far, 0.99):.1e} (99 %), {far.max():.1e} (largest, run {far.argmax()})"
    )
    differ = int((modes_one != modes_other).sum())
    print(f"Fig. 7: {differ} of {modes_one.size} modes differ")
    return int(statuses > 0 or differ > 0 or not far.max() <= ALLOWED * given.rtol)


if __name__ == "__main__":
    sys.exit(main())
