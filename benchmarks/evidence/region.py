"""The region of drift as a map of runs, beside its borders as curves.

``python benchmarks/evidence/region.py [--num 12]`` asks at each point of a grid in the e-Gamma plane whether any start drifts,
and compares with the fold and the flip at the spin that the run has come to. Told are the points that drift outside the
curves, by how much, and of the points inside that no start drifts at, why: the orbit is stable there, but the line from which
a ball counts as flying has been passed (its word says so), or it drifts from the orbit itself and the starts miss its basin.
"""

import argparse
from time import perf_counter

import numpy as np

import dimersweep
from dimersweep import orbits
from dimersweep.errors import OrbitError
from dimersweep.orbits.curve import ball_flip, ball_fold

BETAS = {"start": 1.5, "stop": 88.5, "step": 1.5, "unit": "deg"}
SPIN = 140.0  # about what xdot0 = 1 m/s rolls up to


def main(num):
    """Compare map and curves on a grid of num values of either axis."""
    e = np.linspace(0.45, 0.75, num)
    Gamma = np.linspace(0.5, 1.5, num)
    start = perf_counter()
    cube = dimersweep.search(
        {"e": e, "Gamma": Gamma, "beta0": BETAS}, over="beta0", ask="first", mode="drift", periods=400, progress=False
    )
    print(f"map: {cube['n_runs'].sum().item()} runs, {perf_counter() - start:.1f} s")
    start = perf_counter()
    fold, flip = (orbits.border(kind, "Gamma", over={"e": e}, spin=SPIN) for kind in ("fold", "flip"))
    print(f"curves: {fold.attrs['cost'] + flip.attrs['cost']:.0f} periods, {perf_counter() - start:.1f} s")
    drifts = np.isfinite(cube["radius"].transpose("e", "Gamma").values)
    reasons: dict[str, int] = {}
    worst = 0.0
    for i, j in np.ndindex(num, num):
        low, high = float(fold["Gamma"][i]), float(flip["Gamma"][i])
        low, high = (ball_fold(e[i]) if np.isnan(low) else low), (ball_flip(e[i]) if np.isnan(high) else high)
        outside = max(low - Gamma[j], Gamma[j] - high)
        if drifts[i, j]:
            worst = max(worst, outside)
        elif outside < 0:
            reason = why_none(e[i], Gamma[j])
            reasons[reason] = reasons.get(reason, 0) + 1
    print(f"{drifts.sum()} of {drifts.size} points drift; the one furthest outside the curves by {max(0.0, worst):.1e}")
    for reason, count in reasons.items():
        print(f"inside the curves without drift: {count} points: {reason}")


def why_none(e, Gamma):
    """Why no start drifts at a point between the fold and the flip."""
    try:
        orbit = orbits.find(spin=SPIN, e=float(e), Gamma=float(Gamma))
    except OrbitError as error:
        return f"no orbit found ({error})"
    if not orbit.stable:
        return "the orbit found is unstable"
    if "far.1" in orbit.word:
        return "the orbit is stable, and its hop longer than half a period, which counts as flying"
    return f"the orbit is stable, and a run from it becomes {orbit.run(100).mode}: the starts miss its basin"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num", type=int, default=12, help="values of either axis")
    main(parser.parse_args().num)
