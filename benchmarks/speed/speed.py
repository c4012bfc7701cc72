"""Speed of the engine as a whole: ``python benchmarks/speed/speed.py``.

Forcing periods a second in the drift of the base case, what a period costs over rtol in several scenes with the exponent of
its growth, the time to import, to compile and to start from the cache, the time of the sweep of Fig. 7, and what an observer
adds to a sweep. The verbs are timed one by one by ``compare.py``.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dimersweep import observer, simulate, sweep
from dimersweep.cubes.cube import blank
from dimersweep.kernel.batch import run_many
from dimersweep.parameters import Parameters
from dimersweep.studies import declared as declaration

ROOT = Path(__file__).resolve().parents[2]
SCENES: dict[str, dict[str, float]] = {  # what is not named is the paper's base case
    "drift": {},
    "spiral": {"mu": 0.05, "mu_s": 0.1},
    "dies": {"Gamma": 0.5},
    "jump": {"e": 0.54, "Gamma": 1.28, "f": 16.07, "A_r": 4.78, "beta0": 0.13},
    "flutter": {"e": 0.49, "Gamma": 1.42, "f": 16.53, "A_r": 7.31, "beta0": 0.55},
    "driven strongly": {"Gamma": 2.0},
    "frictionless": {"mu": 0.0, "mu_s": 0.0},
    "planar": {"xdot0": 0.0},
}
RTOLS = 10.0 ** -np.arange(3.0, 13.0)
STEEPEST = -1 / 6  # exponent of rtol with which the cost of a period may grow at most
IMPORT = "import time; begun = time.perf_counter(); import dimersweep; print(time.perf_counter() - begun)"
FIRST_RUN = (
    "import time; from dimersweep import simulate; begun = time.perf_counter(); "
    "simulate(periods=1, record=False); print(time.perf_counter() - begun)"
)


class Spent(NamedTuple):
    """Seconds that a fresh process has printed, and that it took as a whole."""

    told: float
    whole: float


def fresh(code: str, cache: Path, tree: Path = ROOT) -> Spent:
    """Run `code`, which prints seconds, in a new process with its compiled code in `cache` and the package of `tree`."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(tree)}
    begun = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return Spent(float(done.stdout), time.perf_counter() - begun)


def start_times(repeats: int) -> dict[str, Spent]:
    """Median times of an import, of a first run that compiles (once) and of one from the cache."""
    with tempfile.TemporaryDirectory() as folder:
        cold = fresh(FIRST_RUN, Path(folder))
        found = {"first run, nothing cached": cold}
        for name, code in (("first run, from the cache", FIRST_RUN), ("import dimersweep", IMPORT)):
            told, whole = np.median([fresh(code, Path(folder)) for _ in range(repeats)], axis=0)
            found[name] = Spent(float(told), float(whole))
    return found


def period_cost(scene: dict[str, float], rtol: float, periods: int, repeats: int) -> float:
    """Median time on the processor of a forcing period of a scene, early stop left out [s]."""
    row = Parameters(**scene).row()[None]
    out, codes = blank(1)
    taken = []
    for _ in range(repeats):
        begun = time.thread_time()
        run_many(row, periods, rtol, False, out, codes)
        taken.append((time.thread_time() - begun) / periods)
    return float(np.median(taken))


def growth(rtols: Sequence[float] | np.ndarray, costs: Sequence[float] | np.ndarray) -> float:
    """Exponent of rtol in what a period costs, by a straight line through the logarithms."""
    return float(np.polyfit(np.log(rtols), np.log(costs), 1)[0])


def print_costs(names: list[str], periods: int, repeats: int) -> None:
    """Print what a period costs over rtol, with the exponent and whether it keeps to its bound."""
    print("us a forcing period, over rtol")
    print(f"{'':18s}" + "".join(f"{rtol:>9.0e}" for rtol in RTOLS) + "  exponent")
    for name in names:
        costs = [period_cost(SCENES[name], rtol, periods, repeats) for rtol in RTOLS]
        power = growth(RTOLS, costs)
        kept = "" if power >= STEEPEST else f"  STEEPER than {STEEPEST:.3f}"
        print(f"{name:18s}" + "".join(f"{1e6 * cost:9.1f}" for cost in costs) + f"  {power:8.3f}{kept}", flush=True)


def fig07_time(workers: int) -> tuple[float, int]:
    """Seconds of the sweep of Fig. 7 as it is declared, and its number of points."""
    plan = declaration.read_declaration(ROOT / "sweeps" / "fig07.toml")
    settings = plan.sweep
    begun = time.perf_counter()
    cube = sweep(
        plan.grid,
        plan.fixed,
        periods=settings.periods,
        rtol=settings.rtol,
        workers=workers,
        progress=False,
    )
    return time.perf_counter() - begun, cube["mode"].size


@observer(events={"units": "1", "long_name": "events of the run"})
def bare(run):
    """An observer that looks at nothing that was recorded."""
    return {"events": run.n_events}


@observer(events={"units": "1", "long_name": "events of the run"})
def sampled(run):
    """One that takes 128 states."""
    run.states(run.duration - np.arange(min(128, 16 * run.n_periods)) / 16 / run.parameters["f"])
    return {"events": run.n_events}


@observer(stop_when_settled=True, events={"units": "1", "long_name": "events of the run"})
def stopped(run):
    """An observer that is content with the run as far as it was made."""
    return {"events": run.n_events}


OBSERVERS = {"looks at no state": bare, "takes 128 states": sampled, "content with a stopped run": stopped}


def observer_ratios(repeats: int, periods: int, *, settle: bool) -> dict[str, np.ndarray]:
    """Times of a sweep with each observer over those of the same sweep without one, in turn, on one thread."""
    grid = {"Gamma": np.linspace(0.7, 1.3, 12), "beta0": np.linspace(0.1, 1.0, 10)}
    how = {"periods": periods, "stop_when_settled": settle, "workers": 1, "progress": False}

    def timed(observe=None) -> float:
        begun = time.process_time()
        sweep(grid, observe=observe, **how)
        return time.process_time() - begun

    for each in (None, *OBSERVERS.values()):
        timed(each)  # compiles
    rounds = [(timed(), [timed(each) for each in OBSERVERS.values()]) for _ in range(repeats)]
    return {name: np.array([times[k] / plain for plain, times in rounds]) for k, name in enumerate(OBSERVERS)}


def print_observers(repeats: int) -> None:
    """Print what observers cost, of runs that stop when they have settled and of runs of one length."""
    print("time of a sweep with an observer over that without: median (least to greatest)")
    for settle, periods in ((True, 400), (False, 400)):
        kind = "stop when settled" if settle else f"{periods} periods each"
        for name, ratios in observer_ratios(repeats, periods, settle=settle).items():
            low, middle, high = np.quantile(ratios, (0, 0.5, 1))
            print(f"{kind:20s} {name:30s} {middle:5.2f} ({low:.2f} to {high:.2f})", flush=True)


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=7, help="timings of each thing")
    parser.add_argument("--periods", type=int, default=2000, help="length of the base drift")
    parser.add_argument("--workers", type=int, default=2, help="threads of the sweep")
    parser.add_argument("--scenes", nargs="*", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--skip-start", action="store_true", help="leave out the import and the compilation")
    parser.add_argument("--skip-sweep", action="store_true", help="leave out the sweep")
    parser.add_argument("--observers", action="store_true", help="what observers cost, alone")
    given = parser.parse_args(arguments)
    simulate(periods=1, record=False)
    if given.observers:
        print_observers(given.repeats)
        return
    print("rtol    forcing periods/s of the base drift")
    for rtol in RTOLS:
        print(f"{rtol:.0e}   {1 / period_cost({}, rtol, given.periods, given.repeats):8.0f}")
    print()
    print_costs(given.scenes, max(1, given.periods // 20), given.repeats)
    if not given.skip_start:
        print()
        for name, spent in start_times(given.repeats).items():
            print(f"{name:26s} {spent.told:6.2f} s ({spent.whole:.2f} s the whole process)")
    if not given.skip_sweep:
        taken, points = fig07_time(given.workers)
        print(f"\nsweeps/fig07.toml: {points} points in {taken:.1f} s on {given.workers} workers")


if __name__ == "__main__":
    main()
