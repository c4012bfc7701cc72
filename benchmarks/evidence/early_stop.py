"""Does the early stop change a verdict, and what does it cost: ``python benchmarks/evidence/early_stop.py --points 20000``.

Random points near the paper's domain run twice, with the early stop and to the last period. Printed are every point whose
modes differ, and why: the run beyond its stop is compared with its family of orbits at its own spin (``later_course.py``).
The exit status is 1 if one leaves its family where that has no border. Then the periods that the others made, and how far
their numbers are from those of the full runs. 20,000 points take some minutes on two quiet cores.
"""

import argparse
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from typing import NamedTuple

import numpy as np
from later_course import UNEXPLAINED, why

from dimersweep.cubes.cube import blank
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.model.layout import (
    CODES,
    M_DRIFT,
    MODES,
    OUT,
)
from dimersweep.parameters import fill_rows
from dimersweep.symbols import BASE

RANGES = {  # mu_s is given over mu
    "e": (0.4, 0.9),
    "Gamma": (0.4, 1.6),
    "f": (10.0, 35.0),
    "A_r": (3.0, 8.0),
    "mu": (0.05, 0.4),
    "mu_s": (1.0, 2.0),
    "beta0": (0.02, 1.5),
    "xdot0": (0.0, 3.0),
}
MODE, PERIOD, TAKEN = CODES.index("mode"), CODES.index("mode_period"), CODES.index("n_periods")
WITHIN = 1e-3  # what is promised of the numbers of a stopped run
ABSOLUTE = ("longest_hop_1", "longest_hop_2", "zeta", "impact_phase")
HOPS, ORBIT = ABSOLUTE[:2], (*ABSOLUTE, "radius", "period", "speed", "precession_rate", "spin_rate")
CHUNK = 50


class Runs(NamedTuple):
    """Outcomes of all points, in the order of ``layout.OUT`` and ``layout.CODES``, and the time they took [s]."""

    out: np.ndarray
    codes: np.ndarray
    seconds: float


def random_points(n: int, seed: int) -> dict[str, np.ndarray]:
    """Columns of parameters, shape (n,)."""
    rng = np.random.default_rng(seed)
    columns = {name: rng.uniform(*ends, n) for name, ends in RANGES.items()}
    columns["mu_s"] *= columns["mu"]
    return columns


def run_all(rows: np.ndarray, periods: int, rtol: float, settle: bool, workers: int) -> Runs:
    """Verdicts of all rows on several threads."""
    out, codes = blank(len(rows))

    def run(start: int) -> None:
        part = slice(start, start + CHUNK)
        run_many(rows[part], periods, rtol, settle, out[part], codes[part])

    begun = perf_counter()
    with ThreadPoolExecutor(workers) as threads:
        list(threads.map(run, range(0, len(rows), CHUNK)))
    return Runs(out, codes, perf_counter() - begun)


def told(columns: dict[str, np.ndarray], k: int) -> dict[str, float]:
    """Parameters of one point."""
    return {name: float(values[k]) for name, values in columns.items()}


def print_exceptions(
    columns: dict[str, np.ndarray], stopped: Runs, full: Runs, given: argparse.Namespace
) -> Counter[str]:
    """List every point whose modes differ, with the kind of exception and what shows it; how many there are of each."""
    differ, kinds = np.flatnonzero(stopped.codes[:, MODE] != full.codes[:, MODE]), Counter[str]()
    for k in differ:
        early, late, point = stopped.codes[k], full.codes[k], told(columns, k)
        kind, shown = why(point, int(early[PERIOD]), int(early[TAKEN]), given.periods, given.rtol)
        kinds[kind] += 1
        print(
            f"  {kind}: {MODES[early[MODE]]} of period {early[PERIOD]} after {early[TAKEN]} periods, at the end "
            f"{MODES[late[MODE]]} of period {late[PERIOD]}: {shown}\n    {point}"
        )
    of_kinds = f" ({', '.join(f'{kind}: {n}' for kind, n in kinds.most_common())})" if kinds else ""
    print(f"{differ.size} of {given.points} modes differ{of_kinds}")
    return kinds


def print_numbers(stopped: Runs, full: Runs) -> None:
    """Periods that are run, by mode, and how far the numbers of stopped runs are from those of the full ones."""
    same = stopped.codes[:, MODE] == full.codes[:, MODE]
    for mode in np.unique(full.codes[same, MODE]):
        which = same & (full.codes[:, MODE] == mode)
        made, asked = stopped.codes[which, TAKEN].sum(), full.codes[which, TAKEN].sum()
        print(f"{which.sum()} {MODES[mode]}: {made} of {asked} periods; largest difference: ", end="")
        numbers = ORBIT if mode == M_DRIFT else HOPS
        print(", ".join(apart(name, stopped.out[which], full.out[which]) for name in numbers))


def apart(name: str, early: np.ndarray, late: np.ndarray) -> str:
    """Largest difference of a number, relative or absolute, and how many are beyond what is promised."""
    a, b = early[:, OUT.index(name)], late[:, OUT.index(name)]
    difference = np.abs(a - b) if name in ABSOLUTE else np.abs(a / b - 1.0)
    return f"{name} {np.nanmax(difference):.1e} ({np.count_nonzero(difference > WITHIN)} above {WITHIN})"


def main(arguments: list[str] | None = None) -> Counter[str]:
    """Print what was found; how many verdicts differ, by kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=20000)
    parser.add_argument("--periods", type=int, default=400)
    parser.add_argument("--rtol", type=float, default=1e-8)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    columns = random_points(given.points, given.seed)
    rows = fill_rows(BASE | columns, given.points)
    stopped, full = (run_all(rows, given.periods, given.rtol, settle, given.workers) for settle in (True, False))
    counts = np.bincount(full.codes[:, MODE], minlength=len(MODES))
    print(f"{given.points} points, {given.periods} periods, rtol {given.rtol:.0e}, full runs: ", end="")
    print(", ".join(f"{n} {name}" for name, n in zip(MODES, counts, strict=True) if n))
    print(f"with the early stop {stopped.seconds:.1f} s, without {full.seconds:.1f} s")
    print_numbers(stopped, full)
    return print_exceptions(columns, stopped, full, given)


if __name__ == "__main__":
    sys.exit(1 if main()[UNEXPLAINED] else 0)
