"""Does the early stop change a verdict, and what does it cost: ``python benchmarks/evidence/early_stop.py --points 20000``.

Random points near the paper's domain run twice, with the early stop and to the last period. Printed are every point whose
modes differ, and why: the run beyond its stop is compared with its family of orbits at its own spin (``later_course.py``).
The exit status is 1 if one leaves its family where that has no border. Then the periods that the others made, and how far
their numbers are from those of the full runs; how long runs that die go on once both ends are down for good, and what they
cost over the same run up to that event; and how long a drift goes on after it has settled, by its own count and by how far
apart its later strobes are, which are followed beyond the stop. 20,000 points take some eight minutes on two quiet cores.
With ``--results`` the verdicts are kept in a file; where it exists they
are judged again, and nothing is run.
"""

import argparse
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import perf_counter, thread_time
from typing import NamedTuple

import numpy as np
from later_course import UNEXPLAINED, Sampled, Why, why

from dimersweep import simulate
from dimersweep.cubes.cube import blank
from dimersweep.kernel.batch import N_START, ask_for, run_many, run_rows
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.contact_code import digits_of
from dimersweep.kernel.model.layout import (
    CODES,
    M_DRIFT,
    M_REST,
    MODES,
    OUT,
    SLIP,
    STICK,
)
from dimersweep.kernel.record import EVENT, new_record, rows_of, was_full
from dimersweep.kernel.verdict.settling import KEPT, PATIENCE, SETTLED
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
SETTLED_AFTER = OUT.index("settled_after")
WITHIN = 1e-3  # what is promised of the numbers of a stopped run
ABSOLUTE = ("longest_hop_1", "longest_hop_2", "zeta", "impact_phase")
HOPS, ORBIT = ABSOLUTE[:2], (*ABSOLUTE, "radius", "period", "speed", "precession_rate", "spin_rate")
CHUNK = 50
DEATH_COST, DRIFT_WAIT = 1.2, 30  # what a death may cost over the time to it; periods a settled drift may go on
BEYOND = 30  # periods by which a drift is followed further than its stop, to see where it ends
TIMINGS = 9
TIMED_FOR = 2e-3  # least time of one timing [s]: a run is repeated as often as that takes


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


class Recorder:
    """One run to its early stop, recorded, as often as asked, wholly or up to its death.

    Attributes
    ----------
    rows : int
        Events before the one with which both ends are down for good.
    death, end : float
        Time of that event, and of the stop, in forcing periods.
    """

    def __init__(self, row: np.ndarray, periods: int, rtol: float) -> None:
        self._row, self._ask, self._record = row, ask_for(periods, rtol, settle=True), new_record(1000)
        self._seconds(len(self._record.events), 1)
        while was_full(self._record):
            self._record = new_record(4 * len(self._record.events))
            self._seconds(len(self._record.events), 1)
        events, _ = rows_of(self._record)
        ends = digits_of(events[:, EVENT.index("contact_after")])
        closed = np.all((np.array(ends) >= STICK) & (np.array(ends) <= SLIP), axis=0)
        self.rows = int(np.flatnonzero(~closed)[-1]) + 1
        times = events[:, EVENT.index("period")] + events[:, EVENT.index("phase")] / (2 * np.pi)
        self.death, self.end = times[self.rows], times[-1]

    def _seconds(self, rows: int, repeats: int) -> float:
        """Time on the processor of the run to its stop, or until it would write one more event than `rows` [s]."""
        many, results = np.tile(self._row, (repeats, 1)), blank(repeats)
        record, space = self._record._replace(events=self._record.events[:rows]), new_workspace()
        begun = thread_time()
        run_rows(many, np.zeros((0, N_START)), self._ask, 0, *results, space, record)
        return (thread_time() - begun) / repeats

    def cost(self) -> tuple[float, float]:
        """Time of the run over that to its death, the median of pairs taken in turn, and the time to its death [s]."""
        repeats = 1 + int(TIMED_FOR / self._seconds(self.rows, 1))
        pairs = [
            [self._seconds(rows, repeats) for rows in (len(self._record.events), self.rows)] for _ in range(TIMINGS)
        ]
        whole, part = np.array(pairs).T
        return float(np.median(whole / part)), float(np.median(part))


def strobes(point: dict[str, float], periods: int, rtol: float) -> np.ndarray:
    """Gaps and gap rates at the ends of the forcing periods, and the spin, in units of g and omega, shape (periods, 5)."""
    states = simulate(**point, periods=periods, rtol=rtol).states(np.arange(1, periods + 1) / point["f"])
    speed = BASE["g"] / (2.0 * np.pi * point["f"])
    gaps = [states[name].values * BASE["g"] / speed**2 for name in ("gap_1", "gap_2")]
    spin = states["spin_rate"].values + states["theta_rate"].values * np.sin(states["beta"].values)
    rates = [states[name].values / speed for name in ("gap_1_rate", "gap_2_rate")]
    return np.column_stack([*gaps, *rates, BASE["r"] * spin / speed])


def changes(strobe: np.ndarray, p: int) -> np.ndarray:
    """Largest change of each strobe over p periods, infinite for the first ones."""
    return np.append(np.full(p, np.inf), np.abs(strobe[p:, :4] - strobe[:-p, :4]).max(axis=1))


def residuals(strobe: np.ndarray, p: int) -> np.ndarray:
    """How far each strobe is from one that repeats over p periods while its spin creeps, infinite for the first ones."""
    change, fast = changes(strobe, p), np.full(len(strobe), np.inf)
    fast[2 * p :] = PATIENCE * np.abs(strobe[2 * p :] - 2.0 * strobe[p:-p] + strobe[: -2 * p])[:, :4].max(axis=1)
    spun = np.append(np.zeros(p), np.abs(strobe[p:, 4] - strobe[:-p, 4]))
    return np.where((change <= SETTLED) | (change > spun), change, np.minimum(change, fast))


def settling_of(point: dict[str, float], periods: int, rtol: float) -> int:
    """Forcing periods after which all strobes of a run lie within the line of settling of each other."""
    back = strobes(point, periods, rtol)[::-1, :4]
    spread = (np.maximum.accumulate(back) - np.minimum.accumulate(back)).max(axis=1)[::-1]
    return int(np.flatnonzero(np.append(1.0, spread) > SETTLED)[-1]) + 1


def reason(point: dict[str, float], early: np.ndarray, late: np.ndarray, given: argparse.Namespace) -> Why:
    """Why the verdict of a run differs from the one with the early stop."""
    period, stop = int(early[PERIOD]), int(early[TAKEN])
    if period == 0:
        return Why("no period", "the stopped run has no period: rest that was not, or a failure")
    told = why(Sampled(point, given.periods, given.rtol), period, stop)
    left = residuals(strobes(point, given.periods, given.rtol), period)[stop:]
    lost = np.flatnonzero(left > KEPT)
    when = f"change by {left[lost[0]]:.1e} after {stop + lost[0] + 1}" if lost.size else "repeat to the end"
    return told._replace(shown=f"{told.shown}; its strobes {when}")


def both(rows: np.ndarray, given: argparse.Namespace) -> list[Runs]:
    """Verdicts of all rows with the early stop and without, from the file of results where there is one."""
    if given.results and given.results.exists():
        kept = np.load(given.results)
        if not np.array_equal(kept["rows"], rows) or (kept["periods"], kept["rtol"]) != (given.periods, given.rtol):
            sys.exit(f"{given.results} holds the results of other points, periods or rtol")
        return [Runs(kept[f"out_{n}"], kept[f"codes_{n}"], float(kept[f"seconds_{n}"])) for n in range(2)]
    runs = [run_all(rows, given.periods, given.rtol, settle, given.workers) for settle in (True, False)]
    if given.results:
        kept = {f"{name}_{n}": value for n, one in enumerate(runs) for name, value in one._asdict().items()}
        np.savez(given.results, rows=rows, periods=given.periods, rtol=given.rtol, **kept)
    return runs


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
        why = reason(point, early, late, given)
        kinds[why.kind] += 1
        print(
            f"  {why.kind}: {MODES[early[MODE]]} of period {early[PERIOD]} after {early[TAKEN]} periods, at the end "
            f"{MODES[late[MODE]]} of period {late[PERIOD]}: {why.shown}\n    {point}"
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


def print_deaths(columns: dict[str, np.ndarray], rows: np.ndarray, dead: np.ndarray, given: argparse.Namespace) -> None:
    """When runs that die stop, and what they cost over the same runs up to their death.

    The first of them are timed.
    """
    runs = [Recorder(rows[k], given.periods, given.rtol) for k in dead]
    wait = np.array([run.end - run.death for run in runs])
    how = f"{np.median(wait):.2f} periods after both ends are down for good (median), {wait.max():.2f} at most"
    print(f"{dead.size} runs that die stop {how}")
    ratio, least = np.array([run.cost() for run in runs[: given.timed]]).T
    print(
        f"time of {ratio.size} of them over that to the death: {ratio @ least / least.sum():.3f} in all; each: median "
        f"{np.median(ratio):.3f}, 95 % below {np.quantile(ratio, 0.95):.3f}, worst {ratio.max():.3f}; "
        f"{np.count_nonzero(ratio > DEATH_COST)} above {DEATH_COST}"
    )
    for k in np.argsort(ratio)[::-1]:
        if ratio[k] > DEATH_COST:
            print(
                f"  {ratio[k]:.2f}, {1e6 * least[k]:.0f} us to the death after {runs[k].death:.2f} periods, stopped "
                f"{wait[k]:.2f} later: {told(columns, dead[k])}"
            )


def print_drifts(columns: dict[str, np.ndarray], chosen: np.ndarray, stopped: Runs, given: argparse.Namespace) -> None:
    """How long drifts go on after they have settled."""
    taken = stopped.codes[chosen, TAKEN]
    own = taken - stopped.out[chosen, SETTLED_AFTER]
    seen = taken - [
        settling_of(told(columns, k), int(n) + BEYOND, given.rtol) for k, n in zip(chosen, taken, strict=True)
    ]
    for name, wait in (("their own count", own), ("how far apart all later strobes are", seen)):
        print(
            f"{chosen.size} drifts stop after settling, by {name}: median {np.median(wait):.0f} periods, longest "
            f"{wait.max():.0f}; {np.count_nonzero(wait > DRIFT_WAIT)} above {DRIFT_WAIT}"
        )


def main(arguments: list[str] | None = None) -> Counter[str]:
    """Print what was found; how many verdicts differ, by kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=20000)
    parser.add_argument("--periods", type=int, default=400)
    parser.add_argument("--rtol", type=float, default=1e-8)
    parser.add_argument(
        "--timed", type=int, default=300, help="runs that die, and that drift, timed and followed one by one"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--results", type=Path, help=".npz file of the verdicts: written, or read where it exists")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    columns = random_points(given.points, given.seed)
    rows = fill_rows(BASE | columns, given.points)
    stopped, full = both(rows, given)
    counts = np.bincount(full.codes[:, MODE], minlength=len(MODES))
    print(f"{given.points} points, {given.periods} periods, rtol {given.rtol:.0e}, full runs: ", end="")
    print(", ".join(f"{n} {name}" for name, n in zip(MODES, counts, strict=True) if n))
    print(f"with the early stop {stopped.seconds:.1f} s, without {full.seconds:.1f} s")
    print_numbers(stopped, full)
    kinds = print_exceptions(columns, stopped, full, given)
    dead, drifting = (np.flatnonzero(stopped.codes[:, MODE] == mode) for mode in (M_REST, M_DRIFT))
    if dead.size:
        print_deaths(columns, rows, dead, given)
    if drifting.size:
        print_drifts(columns, drifting[: given.timed], stopped, given)
    return kinds


if __name__ == "__main__":
    sys.exit(1 if main()[UNEXPLAINED] else 0)
