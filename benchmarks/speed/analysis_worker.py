"""Times the analysis around the engine on demand, for ``compare.py``: a name goes in, the seconds of a call come out.

What is asked takes nothing but public names, so it serves revisions of any layout. Seconds are those of processors, of all
threads; imports, and what is made once in a process, are left out.
"""

import json
import sys
import warnings
from dataclasses import replace
from functools import cache
from time import process_time

import numpy as np

from dimersweep import attractors, fits, orbits, simulate

RANGES = {"beta0": ("1 deg", "89 deg"), "xdot0": (0.2, 2.0), "phi0": ("0 deg", "360 deg")}


@cache
def orbit():
    """The orbit that drifts for long."""
    return orbits.find(spin=110.0)


@cache
def track():
    """The track of the example in docs/fits.md."""
    run = simulate(e=0.66, mu=0.3, mu_s=0.6, periods=900)
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(20, 60, 600))
    states = run.states(t)
    return fits.circle(t, *(states[name].values + rng.normal(0, 0.01, t.size) for name in ("x", "y")))


ASKED = {
    "find": lambda: orbits.find(Gamma=0.9, spin=100.0),
    "follow": lambda: orbits.follow(orbits.find(Gamma=0.9, spin=100.0), "Gamma", to=1.25),
    "border": lambda: orbits.border("fold", "Gamma", over={"e": [0.5, 0.55, 0.6, 0.65, 0.7]}, spin=100.0),
    "family": lambda: orbits.family(spin=(90.0, 120.0), points=20),
    "sustained": lambda: orbits.sustained(A_r=5, f=22, e=0.65, mu=0.1, mu_s=0.15, Gamma=0.9),
    # another orbit each time: what is followed from one is kept
    "later": lambda: orbits.later(replace(orbit()), periods=10_000),
    "attractors": lambda: attractors(RANGES, {"e": 0.8, "Gamma": 1.0}, starts=30, seed=1, periods=300, progress=False),
    "fit": lambda: fits.fit(track(), {"e": (0.58, 0.75), "spin": (100, 160)}, mu=0.3, mu_s=0.6),
}
QUICK = 0.1  # a call that takes less [s] is made several times


def seconds_of(name):
    """Least time of a call [s]."""
    taken = []
    while not taken or sum(taken) < QUICK:
        begun = process_time()
        ASKED[name]()
        taken.append(process_time() - begun)
    return min(taken)


def answer_all(lines, tell):
    """Answer each line with a name by the time of a call after the first."""
    begun = set()
    for line in lines:
        name = json.loads(line)
        if name not in begun:
            ASKED[name]()
            begun.add(name)
        tell(json.dumps(seconds_of(name)))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    answer_all(sys.stdin, lambda text: print(text, flush=True))
