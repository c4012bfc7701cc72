"""The region of drift as a map of runs, beside its borders as curves.

``python benchmarks/evidence/region.py [--num 12]`` asks at each point of a grid in the e-Gamma plane whether any start drifts,
and compares with the fold and the flip of the fast part **at the spin that the run itself has come to**: no drift may lie more
than 1e-3 outside them. Of each point inside at which no start drifts the reason is named:

* the orbit is there and stable, and its run is told by another name, since a hop of p1 lasts longer than half a period (the
  run's own `longest_hop_1` shows it);
* it drifts from the orbit itself: the starts miss its basin, whose edge between the orbit and the starts is shown;
* there is no stable orbit of period 1 at any spin that a start leads to.

The last line says whether all this holds; the exit status is 1 if it does not.
"""

import argparse
import sys
from itertools import pairwise
from time import perf_counter

import numpy as np

import dimersweep
from dimersweep import orbits
from dimersweep.errors import OrbitError, ParameterError
from dimersweep.orbits.ball import ball_flip, ball_fold

BETAS = {"start": 1.5, "stop": 88.5, "step": 1.5, "unit": "deg"}
SPIN = 140.0  # about what xdot0 = 1 m/s rolls up to
OUTSIDE = 1e-3  # in Gamma, from which a drift lies outside
NEAR = 0.1  # in Gamma, from a curve at SPIN within which the run's own spin is taken
MORE = {"xdot0": (0.5, 1.5, 2.0), "phi0": (1.6, 3.1, 4.7)}  # further starts at points without a drift
FLYING = 0.5  # forcing periods


def borders_at(e, spin):
    """Fold and flip in Gamma at a spin; those of the ball where a curve is not found there."""
    found = []
    for kind, ball in (("fold", ball_fold), ("flip", ball_flip)):
        try:
            found.append(float(orbits.border(kind, "Gamma", over={"e": [e]}, spin=spin)["Gamma"][0]))
        except OrbitError:
            found.append(ball(e))
    return found


def outside(e, Gamma, spin, curves):
    """How far a drift lies outside the curves [in Gamma]: at its own spin where it is near them."""
    low, high = curves
    away = max(low - Gamma, Gamma - high)
    if away > -NEAR:
        low, high = borders_at(e, spin)
        away = max(low - Gamma, Gamma - high)
    return away


def why_none(e, Gamma):
    """Why no start drifts at a point between the fold and the flip, and whether that is a reason."""
    fixed = {"e": float(e), "Gamma": float(Gamma)}
    for name, values in MORE.items():
        for value in values:
            for beta0 in np.radians(np.arange(1.5, 90, 3.0)):
                run = dimersweep.simulate(
                    **fixed, beta0=beta0, periods=400, record=False, stop_when_settled=True, **{name: value}
                )
                if run.mode == "drift":
                    return f"it drifts from beta0 = {beta0:.4f} rad, {name} = {value}", True
    try:
        orbit = orbits.find(spin=SPIN, **fixed)
    except OrbitError as error:
        return f"no orbit found ({error})", False
    if not orbit.stable:
        return f"the orbit is unstable (multiplier {np.abs(orbit.multipliers).max():.3f})", False
    run = orbit.run(100)
    if run.longest_hop_1 > FLYING and run.mode == "period_n" and run.mode_period == 1:
        return f"the orbit is stable; it is named {run.mode}, as p1 hops for {run.longest_hop_1:.3f} periods", True
    if run.mode != "drift":
        return f"the orbit is stable, and a run from it becomes {run.mode}", False
    return f"a run from the orbit drifts; the starts miss its basin: {edge_of(fixed)}", True


def edge_of(fixed):
    """The edge of a basin among the starts that come nearest, in words."""
    modes = {}
    for beta0 in np.radians(np.arange(1.5, 90, 1.5)):
        modes[beta0] = dimersweep.simulate(**fixed, beta0=beta0, periods=400, record=False).mode
    starts = list(modes)
    pairs = [(a, b) for a, b in pairwise(starts) if modes[a] != modes[b]]
    for pair in pairs:
        try:
            edge = orbits.edge("beta0", pair, within=1e-6, **fixed)
        except ParameterError:
            continue
        if edge.partner:
            return f"its edge is near beta0 = {edge.value:.6f} rad ({' | '.join(edge.fates)}), by the unstable partner"
    return f"no edge among the starts is its own ({len(pairs)} edges tried)"


def main(num):
    """Compare map and curves on a grid of num values of either axis; whether they agree."""
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
    spins = cube["spin_rate"].transpose("e", "Gamma").values
    drifts, worst, unnamed, inside = np.isfinite(cube["radius"].transpose("e", "Gamma").values), -np.inf, 0, 0
    for i, j in np.ndindex(num, num):
        low, high = float(fold["Gamma"][i]), float(flip["Gamma"][i])
        curves = (ball_fold(e[i]) if np.isnan(low) else low), (ball_flip(e[i]) if np.isnan(high) else high)
        if drifts[i, j]:
            worst = max(worst, outside(float(e[i]), float(Gamma[j]), float(spins[i, j]), curves))
        elif curves[0] < Gamma[j] < curves[1]:
            told, named = why_none(e[i], Gamma[j])
            inside, unnamed = inside + 1, unnamed + (not named)
            print(f"inside without a drift: e = {e[i]:.4f}, Gamma = {Gamma[j]:.4f}: {told}", flush=True)
    agree = worst <= OUTSIDE and unnamed == 0
    print(f"{drifts.sum()} of {drifts.size} points drift, the one furthest outside by {worst:+.1e} (negative: inside)")
    print(
        f"{'holds' if agree else 'FAILS'}: no drift at any grid point more than {OUTSIDE:.0e} outside fold and flip, and each "
        f"point inside drifts from some start or is named with the reason ({inside} named, {unnamed} of them without a reason)"
    )
    return agree


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num", type=int, default=12, help="values of either axis")
    sys.exit(0 if main(parser.parse_args().num) else 1)
