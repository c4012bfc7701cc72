"""How well the energy budgets of random scenes close: ``python benchmarks/evidence/energy.py 1000 --periods 100``.

Each scene is a run over so many forcing periods. Its budget sets the change of the energy in the room, from the states, beside
the works of all forces, which ride along with it. The closure of a scene is the largest sum of what is left so far, over the
greatest term. A fourth of the scenes each: alike ends; unlike ends and other exponents of contact; plates that are tilted and
move along themselves; and special ones (no friction, no loss, a hold of its own in lasting contact, a second harmonic).
What fails, takes longer than `PATIENCE` or has too many events is left out, and told.
"""

import argparse
import time
from math import pi

import numpy as np

from dimersweep import simulate

KINDS = ("alike", "unlike", "sideways", "special")
CLOSES = 1e-9
MOST_EVENTS = 2000  # in a forcing period; a run with more is left out
PATIENCE = 30.0  # time for a run [s]; one that takes longer is left out


def scene(seed, number):
    """Parameters of a random scene, and its kind."""
    rng = np.random.default_rng((seed, number))
    mu = rng.uniform(0.0, 0.8)
    given = {
        "e": rng.uniform(0.1, 0.95),
        "Gamma": rng.uniform(0.3, 4.0),
        "f": rng.uniform(10.0, 60.0),
        "A_r": rng.uniform(3.0, 10.0),
        "mu": mu,
        "mu_s": mu * rng.uniform(1.0, 2.5),
        "beta0": rng.uniform(0.0, 1.2),
        "xdot0": rng.uniform(0.0, 2.0),
        "phi0": rng.uniform(0.0, 2 * pi),
    }
    kind = KINDS[number % len(KINDS)]
    if kind == "unlike":
        given |= {"r_1": rng.uniform(0.003, 0.007), "r_2": rng.uniform(0.003, 0.007), "e_1": rng.uniform(0.1, 0.95)}
        given |= {"mu_1": rng.uniform(0.0, mu), "eta": float(rng.choice([1.0, 1.2, 1.5]))}
    elif kind == "sideways":
        given |= {
            "tilt": rng.uniform(0.0, 0.2),
            "azimuth": rng.uniform(0.0, 2 * pi),
            "theta0": rng.uniform(0.0, 2 * pi),
        }
        given |= {"Gamma_x": rng.uniform(0.0, 0.5), "phi_x": rng.uniform(0.0, 2 * pi), "Gamma_y": rng.uniform(0.0, 0.5)}
    elif kind == "special":
        smooth = {"mu": 0.0, "mu_s": 0.0}
        given |= ({"mu_h": mu}, {"Gamma_2": 0.3, "phi_2": 0.4}, smooth, smooth | {"e": 1.0})[number // len(KINDS) % 4]
    return given, kind


def budget(given, periods, rtol):
    """A run and its budget, or the run alone where it is left out: it failed, took too long or has too many events."""
    run = simulate(**given, periods=periods, rtol=rtol, record=False, max_seconds=PATIENCE)
    if run.status != "ok" or run.n_events > MOST_EVENTS * periods:
        return run, None
    run = simulate(**given, periods=periods, rtol=rtol)
    return run, run.energy()


def survey(numbers, seed, periods, rtol):
    """Print the worst closures and their quantiles for each kind of scene; returns the worst of all."""
    found, left_out, begun = [], [], time.perf_counter()
    for number in numbers:
        given, kind = scene(seed, number)
        run, made = budget(given, periods, rtol)
        if made is None:
            left_out.append((number, kind, run.status, run.n_events))
        else:
            found.append((made.closure, number, kind, run.mode))
    took = time.perf_counter() - begun
    print(f"{len(found)} scenes over {periods} periods at rtol = {rtol:g}, in {took:.0f} s")
    for kind in (*KINDS, "all"):
        closures = [closure for closure, _, of, _ in found if kind in (of, "all")]
        if closures:
            quantiles = " ".join(f"{value:.1e}" for value in np.quantile(closures, [0.5, 0.9, 0.99, 1.0]))
            above = sum(not closure <= CLOSES for closure in closures)
            print(f"  {kind:8s} {len(closures):5d}: half, 90 %, 99 %, worst: {quantiles}; above {CLOSES:g}: {above}")
    for closure, number, kind, mode in sorted(found, reverse=True)[:5]:
        print(f"  scene {number} ({kind}, {mode}): {closure:.2e}")
    for number, kind, status, events in left_out:
        print(f"  left out: scene {number} ({kind}, {status}, {events} events)")
    print(flush=True)
    return max((closure for closure, *_ in found), default=0.0)


def main():
    """Make the budgets at each accuracy; the finest one has to close."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=int, nargs="?", default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--periods", type=int, default=100)
    parser.add_argument("--rtol", type=float, nargs="+", default=[1e-8, 1e-10, 1e-12])
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    numbers = range(asked.first, asked.first + asked.scenes)
    worst = {rtol: survey(numbers, asked.seed, asked.periods, rtol) for rtol in asked.rtol}
    if not worst[min(worst)] <= CLOSES:
        raise SystemExit(f"a budget does not close to {CLOSES:g} at rtol = {min(worst):g}")


if __name__ == "__main__":
    main()
