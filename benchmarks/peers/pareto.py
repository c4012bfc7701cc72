"""Run time against error, the engine beside its peers: ``python benchmarks/peers/pareto.py [--small] [--only METHOD ...]``.

Every method runs the same scenes at a series of accuracies, one after the other, in rounds; each point is the median time
of the rounds, in seconds of processor time, and three errors against the engine at its tightest: of the states of a short
run, of the times of its double impacts, and of the orbit long after. An error is the median over a few starts next to each
other: a single run may be lucky. Peers that are not installed are named and left out (``pip install 'dimersweep[peers]'``).
Writes a NetCDF file and the figure, prints the points and the engine's advantage at equal error (`pareto_report`).
"""

import argparse
import signal
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from pareto_report import ERRORS, draw, tell

from dimersweep.parameters import Parameters
from dimersweep.storage import provenance
from tests.checks.scenes import SCALE

ROOT = Path(__file__).resolve().parents[2]
SCENES = {
    "drift": {},
    "spiral": {"mu": 0.05, "mu_s": 0.1},
    "dead run": {
        "e": 0.368, "Gamma": 0.959, "f": 15.75, "A_r": 7.99, "mu": 0.392, "mu_s": 0.448, "beta0": 0.3083, "xdot0": 1.786,
    },
    "jump": {
        "e": 0.408, "Gamma": 1.155, "f": 26.65, "A_r": 4.62, "mu": 0.067, "mu_s": 0.111, "beta0": 0.4354, "xdot0": 0.653,
    },
    "strong forcing": {"Gamma": 2.0},
    "no friction": {"mu": 0.0, "mu_s": 0.0},
}  # fmt: skip
ORBITS = ("drift", "spiral")  # scenes that come to drift
PERIODS, ORBIT_PERIODS, SAMPLES = 4, 100, 2  # of a short run, of one to the orbit; samples per period
SHIFTS = (0.0, 3e-3, -3e-3, 7e-3, -7e-3)  # of the dip angle at the start, relative
SHORTEST = 0.02  # what is timed at once takes at least so long [s]
PATIENCE = 1.0  # a point is not timed again once its timings have taken so long [s]
BURST = 0.05  # double impacts closer than this are one, in forcing periods
FINEST, FINER = 1e-13, 3e-13


class Method(NamedTuple):
    """A program to compare: where it is, what it needs, and its settings, from the coarsest.

    Its class takes the scene's parameters (names as in `dimersweep.simulate`) and one setting of its accuracy, and has

        follow(times)   states (n, 12) at ascending times, columns as in the reference runs, and the times of double impacts
        run(end)        the same run to one time with nothing kept: what is timed
        copies          how many runs of the scene `run` makes at once
    """

    module: str
    cls: str
    needs: str | None
    settings: Callable[[], list]
    few: int  # settings of a small run


def _powers(first, last, step=1):
    return [10.0**-k for k in range(first, last + 1, step)]


def _springs():
    from springs import Spring

    return [Spring(10.0**power, steps) for power in (6, 8, 10, 12, 14) for steps in (10, 20)]


METHODS = {
    "engine": Method("own", "Engine", None, lambda: _powers(3, 12), 2),
    "oracle": Method("own", "Oracle", None, lambda: _powers(4, 8, 2), 1),
    "heyoka": Method("taylor", "Heyoka", "heyoka", lambda: _powers(3, 14), 2),
    "springs": Method("springs", "Springs", None, _springs, 1),
}


class Truth(NamedTuple):
    """What the reference says of a scene: states at the samples, double impacts, orbit (None if there is none)."""

    states: np.ndarray
    doubles: np.ndarray
    orbit: np.ndarray | None


def label(setting):
    """A setting as text."""
    return f"{setting:.0e}" if isinstance(setting, float) else str(setting)


def available(names):
    """Classes of the methods at hand, by name; says which are not."""
    found = {}
    for name in names:
        method = METHODS[name]
        try:
            found[name] = getattr(import_module(method.module), method.cls)
        except ModuleNotFoundError as missing:
            if missing.name != method.needs:
                raise
            print(f"{name}: left out, {method.needs} is not installed (pip install 'dimersweep[peers]')")
    return found


def first_of_bursts(doubles, T):
    """Times of those double impacts that follow none within a burst."""
    doubles = np.asarray(doubles, dtype=float)
    return doubles[np.diff(doubles, prepend=-np.inf) > BURST * T]


def orbit_of(states, T, h):
    """Radius, period and angle of the orbit over the period between two states, shape (3,).

    In a period the centre of mass moves along a chord of its circle while the heading turns by the angle of that chord; the
    angle of the orbit is that between the mean heading and the chord.
    """
    theta, beta = states[:, 3], states[:, 4]
    axis = np.column_stack([-np.sin(theta), np.cos(theta)])
    chord = np.diff(states[:, :2] + h * np.cos(beta)[:, None] * axis, axis=0)[0]
    turn, middle = theta[1] - theta[0], theta.mean()
    along = chord @ [-np.sin(middle), np.cos(middle)]
    across = chord @ [np.cos(middle), np.sin(middle)]
    radius = np.hypot(*chord) / (2.0 * np.sin(0.5 * abs(turn)))
    return np.array([radius, 2.0 * np.pi * T / abs(turn), np.arctan2(abs(across), along)])


def look(attempt, scene, periods, orbit):
    """What a method says of a scene."""
    T = 1.0 / scene["f"]
    states, doubles = attempt.follow(T * np.arange(1, SAMPLES * periods + 1) / SAMPLES)
    around = None
    if orbit:
        strobes, _ = attempt.follow(T * np.array([ORBIT_PERIODS - 1, ORBIT_PERIODS]))
        around = orbit_of(strobes, T, scene["r"] * (scene["A_r"] - 1.0))
    return Truth(states, first_of_bursts(doubles, T), around)


def errors(seen, truth, T):
    """The three errors; nan where there is nothing to compare, inf where double impacts differ in number."""
    apart = seen.states - truth.states
    apart[:, [3, 5]] = (apart[:, [3, 5]] + np.pi) % (2.0 * np.pi) - np.pi
    double = orbit = np.nan
    if len(truth.doubles) != len(seen.doubles):
        double = np.inf
    elif len(truth.doubles) > 0:
        double = np.abs(seen.doubles - truth.doubles).max() / T
    if seen.orbit is not None:
        orbit = np.abs(seen.orbit / truth.orbit - 1.0).max()
    return np.array([np.abs(apart / SCALE).max(), double, orbit])


@contextmanager
def no_longer_than(limit):
    """Raise a RuntimeError in what takes more processor time."""

    def stop(*_):
        raise RuntimeError(f"more than {limit:.0f} s")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def seconds(attempt, end, at_least=0.0):
    """Processor time of one run."""
    runs, taken = 0, 0.0
    while taken < at_least or runs == 0:
        begun = time.process_time()
        attempt.run(end)
        taken += time.process_time() - begun
        runs += attempt.copies
    return taken / runs


def compare(attempt, scene, truth, periods, orbit):
    """The three errors of a program from one start; inf where it fails."""
    try:
        return errors(look(attempt, scene, periods, orbit), truth, 1.0 / scene["f"])
    except RuntimeError:
        return np.full(3, np.inf)


def starts_of(scene, count=None):
    """The scene from a few starts next to each other."""
    return [scene | {"beta0": scene["beta0"] * (1.0 + shift)} for shift in SHIFTS[:count]]


def references(found, scenes, periods, orbits, count):
    """The truth about every scene, and the doubt about it: how far off a looser engine and the peer on heyoka are.

    Returns
    -------
    truths : dict of str to list of Truth
        One for every start.
    doubts : ndarray, shape (scenes, 3)
    """
    others = [(found["engine"], FINER)]
    if "heyoka" in found:
        others.append((found["heyoka"], METHODS["heyoka"].settings()[-1]))
    truths, doubts = {}, []
    for name, scene in scenes.items():
        orbit, starts = name in orbits, starts_of(scene, count)
        truths[name] = [look(found["engine"](start, FINEST), start, periods, orbit) for start in starts]
        cases = list(zip(starts, truths[name], strict=True))
        seen = [
            [compare(program(start, setting), start, truth, periods, orbit) for start, truth in cases]
            for program, setting in others
        ]
        doubts.append(np.median(seen, axis=1).max(axis=0))
    return truths, np.array(doubts)


def warm_seconds(attempt, end, cap):
    """Processor time of a run in which nothing is left to compile.

    Raises
    ------
    RuntimeError
        If a run takes longer than `cap` seconds, or fails.
    """
    for _ in range(2):
        with no_longer_than(cap):
            taken = seconds(attempt, end)
        if taken < SHORTEST:
            break
    return taken


class Point(NamedTuple):
    """One program at one setting in one scene: errors at every start looked at, and what a run of its took [s]."""

    attempt: object
    error: np.ndarray
    taken: float


def examine(program, setting, scene, truths, periods, orbit, cap):
    """The errors of a program from start to start, until `cap` seconds are spent; at least from the first one.

    Raises
    ------
    RuntimeError
        If one of its first runs takes longer than that, or the program fails in it.
    """
    T, found, starts = 1.0 / scene["f"], [], starts_of(scene, len(truths))
    timed = program(starts[0], setting)
    taken = warm_seconds(timed, periods * T, cap)
    orbit = orbit and taken * len(truths) * ORBIT_PERIODS / periods < cap
    begun = time.process_time()
    for start, truth in zip(starts, truths, strict=True):
        attempt = program(start, setting) if found else timed
        with no_longer_than(cap):
            found.append(compare(attempt, start, truth, periods, orbit))
        if time.process_time() - begun > cap:
            break
    return Point(timed, np.array(found), taken)


def measure(found, scenes, settings, periods, orbits, rounds, cap, count):
    """Errors and times of every method, setting and scene.

    Returns
    -------
    error : ndarray, shape (scenes, methods, settings, starts, 3)
    taken : ndarray, shape (scenes, methods, settings, rounds)
        Processor time of a short run [s].
    doubt : ndarray, shape (scenes, 3)
    """
    truths, doubts = references(found, scenes, periods, orbits, count)
    shape = len(scenes), len(settings), max(len(values) for values in settings.values())
    error, taken = np.full((*shape, count, 3), np.nan), np.full((*shape, rounds), np.nan)
    points = {}
    for i, (name, scene) in enumerate(scenes.items()):
        for j, (method, values) in enumerate(settings.items()):
            for k, setting in enumerate(values):
                try:
                    point = examine(found[method], setting, scene, truths[name], periods, name in orbits, cap)
                except RuntimeError as failure:
                    print(f"{name}: {method} at {label(setting)} gave up: {failure}")
                    continue
                points[i, j, k] = point.attempt, periods / scene["f"]
                error[i, j, k, : len(point.error)] = point.error
                if point.taken > PATIENCE:
                    taken[i, j, k, 0] = point.taken
            print(f"{name}: {method} compared", file=sys.stderr, flush=True)
    for turn in range(rounds):
        for place, (attempt, end) in points.items():
            if np.nansum(taken[place]) < PATIENCE:
                taken[(*place, turn)] = seconds(attempt, end, SHORTEST)
        print(f"round {turn + 1} of {rounds} timed", file=sys.stderr, flush=True)
    return error, taken, doubts


def as_dataset(scenes, settings, error, taken, doubt, periods, wall):
    """All that was measured, labelled."""
    dims = ("scene", "program", "setting")
    labels = np.full(taken.shape[1:3], "", dtype=object)
    for j, values in enumerate(settings.values()):
        labels[j, : len(values)] = [label(value) for value in values]
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # points that were given up
        low, middle, high = np.nanquantile(taken, [0.25, 0.5, 0.75], axis=-1) / periods
        least, median, most = np.nanmin(error, axis=3), np.nanmedian(error, axis=3), np.nanmax(error, axis=3)
    times = {
        "time": (middle, "median processor time per forcing period"),
        "time_low": (low, "first quartile of the processor time per forcing period"),
        "time_high": (high, "third quartile of the processor time per forcing period"),
    }
    data = {name: (dims, values, {"units": "s", "long_name": text}) for name, (values, text) in times.items()}
    for q, (name, (text, units)) in enumerate(ERRORS.items()):
        told = {"units": units, "long_name": text}
        data[name] = (dims, median[..., q], told)
        data[f"{name}_least"] = (dims, least[..., q], told | {"long_name": f"the same from the best start: {text}"})
        data[f"{name}_most"] = (dims, most[..., q], told | {"long_name": f"the same from the worst start: {text}"})
        data[f"{name}_doubt"] = ("scene", doubt[:, q], told | {"long_name": f"doubt about the reference: {text}"})
    data["starts"] = (dims, np.isfinite(error[..., 0]).sum(axis=-1), {"units": "1", "long_name": "number of starts"})
    data["timings"] = (dims, np.isfinite(taken).sum(axis=-1), {"units": "1", "long_name": "number of timings"})
    data["knob"] = (
        dims[1:],
        labels.astype(str),
        {"long_name": "setting: rtol, tolerance, stiffness and step"},
    )
    configuration = {"scenes": scenes, "periods": periods, "rounds": taken.shape[-1]}
    attributes = provenance.attributes(configuration, "Run time against error, the engine beside its peers", wall)
    return xr.Dataset(data, {"scene": list(scenes), "program": list(settings)}, attributes)


def benchmark(names, scenes, *, small, rounds, cap):
    """Measure the methods that are at hand; the engine is always one of them."""
    begun = time.perf_counter()
    found = available(dict.fromkeys(["engine", *names]))
    settings = {name: METHODS[name].settings() for name in found}
    if small:
        settings = {name: values[: METHODS[name].few] for name, values in settings.items()}
    periods, orbits, count = (1, (), 2) if small else (PERIODS, ORBITS, len(SHIFTS))
    full = {name: Parameters(**SCENES[name]).given() for name in scenes}
    measured = measure(found, full, settings, periods, orbits, rounds, cap, count)
    return as_dataset(full, settings, *measured, periods, time.perf_counter() - begun)


def main():
    """Measure, keep, tell and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="one period, few settings, scenes and starts, no orbits")
    parser.add_argument("--only", nargs="+", choices=METHODS, default=list(METHODS), help="methods beside the engine")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, help="scenes (default: all, or two with --small)")
    parser.add_argument("--rounds", type=int, default=5, help="timings of each point")
    parser.add_argument("--cap", type=float, default=12.0, help="seconds that the errors of one point may take")
    parser.add_argument("--out", type=Path, default=Path("pareto.nc"), help="where the results go")
    parser.add_argument(
        "--figure", type=Path, help="where the figure goes (default: docs/figures/pareto.png if not small)"
    )
    given = parser.parse_args()
    scenes = given.scenes or (["drift", "no friction"] if given.small else list(SCENES))
    points = benchmark(given.only, scenes, small=given.small, rounds=given.rounds, cap=given.cap)
    points.to_netcdf(given.out)
    tell(points)
    figure = given.figure or (
        given.out.with_suffix(".png") if given.small else ROOT / "docs" / "figures" / "pareto.png"
    )
    draw(points, figure)
    print(f"\n{given.out}, {figure}")


if __name__ == "__main__":
    main()
