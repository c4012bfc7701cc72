"""Run time against error, the engine beside its peers: ``python benchmarks/peers/pareto.py [--small]``.

Every program runs the same scenes at a series of accuracies; a point is the median processor time of rounds that go through
all points in turn, and three errors against the engine at its tightest: of the states of a short run, of the times of its
double impacts, and of the orbit long after. An error is the median over a few starts next to each other: a single run may be
lucky. heyoka is named and left out where it is not installed (``pip install '.[peers]'``). Prints the points and the
engine's advantage at equal error, and draws the figure (`report`).
"""

import argparse
import signal
import sys
import time
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
from programs import Engine, Oracle, Springs
from report import draw, tell

from dimersweep.parameters import Parameters
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
ROUNDS = 3  # timings of a point
SHORTEST = 0.02  # what is timed at once takes at least so long [s]
CAP = 12.0  # a run may take so long [s], and so may the errors of a point: a slow program is examined from fewer starts
BURST = 0.05  # double impacts closer than this are one, in forcing periods
FINEST, FINER, TIGHTEST = 1e-13, 3e-13, 1e-14  # of the reference, and of engine and heyoka that judge it
# class and settings, from the coarsest
PROGRAMS = {
    "engine": (Engine, [10.0**-k for k in range(2, 13)]),
    "oracle": (Oracle, [10.0**-k for k in (4, 6, 8)]),
    "springs": (Springs, [(10.0**power, steps) for power in (6, 8, 10, 12) for steps in (10, 20)]),
}


def programs():
    """Return the programs that are at hand; say so where heyoka is not."""
    if find_spec("heyoka") is None:
        print("heyoka: left out, it is not installed (pip install '.[peers]')")
        return PROGRAMS
    from taylor import Heyoka

    return PROGRAMS | {"heyoka": (Heyoka, [10.0**-k for k in range(3, 15)])}


def orbit_of(states, T, h):
    """Return radius, period and angle of the orbit over the period between two states.

    In a period the centre of mass moves along a chord of its circle while the heading turns by the angle of that chord; the
    angle of the orbit is that between the mean heading and the chord.
    """
    theta, beta = states[:, 3], states[:, 4]
    axis = np.column_stack([-np.sin(theta), np.cos(theta)])
    chord = np.diff(states[:, :2] + h * np.cos(beta)[:, None] * axis, axis=0)[0]
    turn, middle = theta[1] - theta[0], theta.mean()
    along, across = chord @ [-np.sin(middle), np.cos(middle)], chord @ [np.cos(middle), np.sin(middle)]
    radius = np.hypot(*chord) / (2.0 * np.sin(0.5 * abs(turn)))
    return np.array([radius, 2.0 * np.pi * T / abs(turn), np.arctan2(abs(across), along)])


def look(attempt, scene, periods, orbit):
    """Return what a program says of a scene: states at the samples, the first double impact of each burst, the orbit."""
    T = 1.0 / scene["f"]
    states, doubles = attempt.follow(T * np.arange(1, SAMPLES * periods + 1) / SAMPLES)
    doubles, around = doubles[np.diff(doubles, prepend=-np.inf) > BURST * T], None
    if orbit:
        strobes, _ = attempt.follow(T * np.array([ORBIT_PERIODS - 1, ORBIT_PERIODS]))
        around = orbit_of(strobes, T, scene["r"] * (scene["A_r"] - 1.0))
    return states, doubles, around


def errors(seen, truth, T):
    """Return the errors of states, double impacts and orbit; nan: nothing to compare, inf: another number of impacts."""
    apart = seen[0] - truth[0]
    apart[:, [3, 5]] = (apart[:, [3, 5]] + np.pi) % (2.0 * np.pi) - np.pi
    double = orbit = np.nan
    if len(truth[1]) != len(seen[1]):
        double = np.inf
    elif len(truth[1]) > 0:
        double = np.abs(seen[1] - truth[1]).max() / T
    if seen[2] is not None:
        orbit = np.abs(seen[2] / truth[2] - 1.0).max()
    return [np.abs(apart / SCALE).max(), double, orbit]


def compare(program, setting, starts, truths, periods, orbit):
    """Return the errors of a program from each start, shape (starts, 3); inf where it fails."""
    found = []
    for start, truth in zip(starts, truths, strict=False):
        try:
            with no_longer_than(CAP):
                found.append(errors(look(program(start, setting), start, periods, orbit), truth, 1.0 / start["f"]))
        except RuntimeError:
            found.append([np.inf] * 3)
    return np.array(found)


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


def seconds(attempt, end, at_least=SHORTEST):
    """Return the processor time of one run."""
    runs, taken = 0, 0.0
    while taken < at_least or runs == 0:
        begun = time.process_time()
        attempt.run(end)
        taken += time.process_time() - begun
        runs += attempt.copies
    return taken / runs


def measure(scenes, found, periods, orbits, count, rounds):
    """Return a row for each point, and the doubts about the reference, shape (3,), of each scene."""
    rows, attempts, doubts = [], [], {}
    for name in scenes:
        scene = Parameters(**SCENES[name]).given()
        starts, orbit = [scene | {"beta0": scene["beta0"] * (1.0 + shift)} for shift in SHIFTS[:count]], name in orbits
        truths = [look(Engine(start, FINEST), start, periods, orbit) for start in starts]
        judges = [(Engine, FINER), *((found[program][0], TIGHTEST) for program in found if program == "heyoka")]
        doubts[name] = np.max(
            [np.median(compare(*judge, starts, truths, periods, orbit), axis=0) for judge in judges], axis=0
        )
        for program, (make, settings) in found.items():
            for setting in settings:
                attempt, end = make(scene, setting), periods / scene["f"]
                try:
                    with no_longer_than(CAP):
                        attempt.run(end)  # what is compiled is compiled here
                        taken = seconds(attempt, end, 0.0)
                except RuntimeError as failure:
                    print(f"{name}: {program} at {setting} gave up: {failure or type(failure).__name__}")
                    continue
                most = max(1, int(CAP / max(taken, SHORTEST)))
                far = orbit and taken * count * ORBIT_PERIODS / periods < CAP
                error = compare(make, setting, starts[:most], truths, periods, far)
                middle, least, largest = (f(error, axis=0) for f in (np.median, np.min, np.max))
                rows.append(
                    {"scene": name, "program": program, "setting": str(setting), "starts": len(error), "seconds": taken}
                    | dict(zip(("state", "double", "orbit"), middle, strict=True))
                    | {"state_least": least[0], "state_most": largest[0]}
                )
                attempts.append((attempt, end))
        print(f"{name}: compared", file=sys.stderr, flush=True)
    points = pd.DataFrame(rows)
    slow = (points["seconds"] > 1.0).to_numpy()
    taken = [
        [row.seconds if slow[k] else seconds(*attempts[k]) for k, row in enumerate(points.itertuples())]
        for _ in range(rounds)
    ]
    periods_taken = np.array(taken) / periods
    points["seconds"] = np.median(periods_taken, axis=0)
    points["seconds_low"], points["seconds_high"] = periods_taken.min(axis=0), periods_taken.max(axis=0)
    return points, doubts


def main():
    """Measure, tell and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="one period, few settings, scenes and starts, no orbits")
    parser.add_argument(
        "--figure", type=Path, help="where the figure goes (default: docs/figures/pareto.png if not small)"
    )
    given = parser.parse_args()
    found, scenes, small = programs(), list(SCENES), given.small
    if small:
        found = {
            name: (make, settings[: 2 if name in ("engine", "heyoka") else 1])
            for name, (make, settings) in found.items()
        }
        scenes = ["drift", "no friction"]
    points, doubts = measure(scenes, found, *((1, (), 2, 1) if small else (PERIODS, ORBITS, len(SHIFTS), ROUNDS)))
    tell(points, doubts)
    figure = given.figure or (None if small else ROOT / "docs" / "figures" / "pareto.png")
    if figure:
        draw(points, doubts, figure)
        print(f"\n{figure}")


if __name__ == "__main__":
    main()
