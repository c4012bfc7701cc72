"""Whether fits find what made the data: ``python benchmarks/evidence/fits.py --sets 200``.

Orbits with drawn parameters, tracks of circles and cycloids, and tracks of runs are measured with drawn errors and fitted.
Prints how many of the true values lie within one and two standard deviations, where 68.3 and 95.4 % should, and how the
misfits are distributed.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product, repeat

import numpy as np
from scipy.stats import binomtest, kstest

from dimersweep import fits, orbits, simulate

FIXED = {"mu": 0.3, "mu_s": 0.6}
FREE = {"e": (0.56, 0.74), "A_r": (5.2, 6.8), "spin": (80.0, 150.0)}
DRAWN = {"e": (0.62, 0.68), "A_r": (5.7, 6.3), "spin": (100.0, 130.0)}
ERRORS = {"radius": 0.04, "zeta": 0.002, "impact_phase": 0.003, "speed": 0.004}
TRACK_ERROR, TRACK_POINTS = 0.02, 150  # of a coordinate [m], and how many of them
RUNS = {"e": (0.57, 0.67), "mu": (0.15, 0.4)}  # drawn evenly
MU_S = 0.5  # of runs whose mu is free
BEFORE = 300  # forcing periods of a run before its track begins
SHOULD = {1: 0.6827, 2: 0.9545}  # of a normal distribution, by its standard deviations


def of_orbit(seed):
    """Errors of the fitted values in their standard deviations, the probability of the misfit, and the cost."""
    rng = np.random.default_rng([27, seed])
    true = {name: float(rng.uniform(*ends)) for name, ends in DRAWN.items()}
    orbit = orbits.find(**FIXED, **true)
    measured = {name: (getattr(orbit, name) + rng.normal(0, error), error) for name, error in ERRORS.items()}
    fit = fits.fit(measured, FREE, progress=False, **FIXED)
    return [(fit.values[name] - true[name]) / fit.errors[name] for name in FREE], fit.probability, fit.cost


def of_track(seed, moving, known):
    """The same of radius, period and the centre, for a circle or a cycloid; the error of a coordinate is known or not."""
    rng = np.random.default_rng([28, seed])
    radius, period, phase, turns = rng.uniform(2, 6), rng.uniform(20, 60), rng.uniform(0, 6), rng.uniform(0.7, 3)
    centre, velocity = rng.normal(size=2), rng.normal(0, 0.02, size=2) * moving
    t = np.linspace(0, turns * period, TRACK_POINTS)
    angle = phase + rng.choice([-1, 1]) * 2 * np.pi * t / period
    x = centre[0] + velocity[0] * t + radius * np.cos(angle) + rng.normal(0, TRACK_ERROR, t.size)
    y = centre[1] + velocity[1] * t + radius * np.sin(angle) + rng.normal(0, TRACK_ERROR, t.size)
    track = (fits.cycloid if moving else fits.circle)(t, x, y, TRACK_ERROR if known else None)
    middle = centre + velocity * t.mean()
    true = dict(zip(track.values, [radius, period, *middle, *velocity], strict=False))
    return [(track.values[name] - true[name]) / track.errors[name] for name in true]


def drawn_run(rng, mu_s=None):
    """A recorded run that drifts, its parameters, and the times of the camera: at any phases of the plate, of any sense."""
    while True:
        spin, mu = float(np.exp(rng.uniform(np.log(10), np.log(300)))), float(rng.uniform(*RUNS["mu"]))
        given = {"e": float(rng.uniform(*RUNS["e"])), "mu": mu, "mu_s": mu_s or 2 * mu, "A_r": rng.uniform(5.5, 6.5)}
        start = {"xdot0": 1.4 * 5e-3 * spin * rng.choice([-1, 1]), "beta0": 4 * np.pi / 45 * rng.choice([-1, 1])}
        begun = simulate(**given, **start, periods=BEFORE, record=False)
        if begun.mode == "drift" and np.isfinite(begun.orbit.period):
            f = begun.parameters["f"]
            length = int(rng.uniform(0.3, 1.5) * begun.orbit.period * f)
            run = simulate(**given, **start, periods=BEFORE + length)
            return run, given, np.sort(rng.uniform(BEFORE, run.n_periods, int(rng.uniform(80, 300)))) / f


def of_run(seed, strobed=False, too_many=False):
    """Errors in their standard deviations of e and the spin that a track of a run gives, and of the radius of its path.

    Half of the tracks have a known error of a coordinate. If `strobed` the times are whole forcing periods. With `too_many`
    free parameters mu is a third one, which two measured values do not determine, in place of the radius. The ranges are those
    that e and mu are drawn from. Errors are 0.5, 1.5 or 2.5, within the share of one deviation, of two, or of none.
    """
    rng = np.random.default_rng([36, seed])
    run, given, t = drawn_run(rng, MU_S if too_many else None)
    f = run.parameters["f"]
    t = np.unique(np.round(t * f)) / f if strobed else t
    error = float(np.exp(rng.uniform(np.log(1e-3), np.log(2e-2))))
    x, y = (run.states(t)[name].values + rng.normal(0, error, t.size) for name in "xy")
    track = fits.circle(t, x, y, error if rng.uniform() < 0.5 else None)
    halfway = f * (t[0] + t[-1]) / 2
    middle = simulate(**run.parameters, periods=round(halfway), record=False).orbit
    since = halfway - (
        round(halfway) - 1 + middle.impact_phase
    )  # forcing periods since the impact the spin is told after
    e, spin = given["e"], abs(middle.spin + middle.spin_drift * since)
    free = {**(RUNS if too_many else {"e": (e - 0.045, e + 0.055)}), "spin": (0.75 * spin, 1.3 * spin)}
    fixed = {name: value for name, value in given.items() if name not in free}
    fit = fits.fit(track, free, progress=False, **fixed)
    off = {name: fit.values[name] - (given | {"spin": spin})[name] for name in free}
    if too_many:  # no normal distribution: whether each share that is told holds them; an error of inf tells none
        told = [[abs(off[name]) <= fit.within(share)[name] for share in SHOULD.values()] for name in free]
        apart = [np.copysign(2.5 - sum(row), off[name]) for name, row in zip(free, told, strict=True)]
        return np.where(np.isinf(list(fit.errors.values())), np.nan, apart), fit.probability, fit.cost
    more = track.of(fit.orbit)[0] - fit.orbit.path_radius  # because the times are some, and the rate drifts slowly
    radius = (track.values["path_radius"] - more - middle.path_radius) / track.errors["path_radius"]
    return [*(off[name] / fit.errors[name] for name in free), radius], fit.probability, fit.cost


def tell(title, names, apart):
    """Print which share of the true values lies within one and two standard deviations."""
    print(title)
    for name, every in [*zip(names, apart.T, strict=True), ("all", apart.ravel())]:
        column = every[np.isfinite(every)]
        shares, lost = [], every.size - column.size
        for times, should in SHOULD.items():
            inside = np.count_nonzero(np.abs(column) <= times)
            words = f"{times} sd: {100 * inside / column.size:5.1f} %"
            if name != "all":  # those of one set are not independent
                low, high = binomtest(inside, column.size).proportion_ci(0.95, "wilson")
                words += f" ({100 * low:.1f} to {100 * high:.1f})"
            shares.append(f"{words}, should be {100 * should:.1f}")
        mean = column.mean()
        print(
            f"  {name:>12}   {';   '.join(shares)};   mean {mean:+.2f} sd{f';   {lost} without an error' if lost else ''}"
        )


def tell_tracks(pool, numbers):
    """Print the shares of circles and cycloids."""
    for moving, known in product((False, True), (True, False)):
        apart = np.array(list(pool.map(of_track, numbers, repeat(moving), repeat(known), chunksize=20)))
        kind = f"{'cycloids' if moving else 'circles'}, error of a coordinate {'known' if known else 'estimated'}"
        tell(f"{len(numbers)} tracks: {kind}", ("radius", "period", "x", "y", "v_x", "v_y")[: apart.shape[1]], apart)


def tell_runs(pool, numbers):
    """Print the shares of tracks of runs."""
    for strobed in (False, True):
        tell_run(pool, numbers, strobed, False)


def tell_open(pool, numbers):
    """Print the shares of tracks of runs with a free parameter too many."""
    tell_run(pool, numbers, False, True)


def tell_run(pool, numbers, strobed, too_many):
    """Print the shares of one kind of tracks of runs."""
    apart, probabilities, _ = (
        np.array(column) for column in zip(*pool.map(of_run, numbers, repeat(strobed), repeat(too_many)), strict=True)
    )
    refused = np.count_nonzero(probabilities < 0.0027)
    times = "whole forcing periods" if strobed else "irregular times"
    names = ("e", "mu", "spin") if too_many else ("e", "spin", "path_radius")
    tell(f"{len(numbers)} tracks of runs, {times}; called impossible: {refused}", names, apart)


def tell_orbits(pool, numbers):
    """Print the shares of orbits, how the misfits are distributed, and the cost."""
    orbits.find()  # the processes find it compiled
    began = time.perf_counter()
    apart, probabilities, costs = (np.array(column) for column in zip(*pool.map(of_orbit, numbers), strict=True))
    tell(f"{len(numbers)} orbits: {', '.join(FREE)} from {', '.join(ERRORS)}", FREE, apart)
    even, refused = kstest(probabilities, "uniform").pvalue, np.count_nonzero(probabilities < 0.0027)
    print(f"  misfits: chi-square with a Kolmogorov-Smirnov probability of {even:.2f}; called impossible: {refused}")
    print(
        f"  cost: {np.median(costs):,.0f} forcing periods a fit in the median; {time.perf_counter() - began:.0f} s in all"
    )


def main():
    """Print the shares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=200, help="number of synthetic sets of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--only", choices=("tracks", "runs", "open", "orbits"), help="the other ones are left out")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.sets)
    with ProcessPoolExecutor(options.workers) as pool:
        for kind, tell_kind in (
            ("tracks", tell_tracks),
            ("runs", tell_runs),
            ("open", tell_open),
            ("orbits", tell_orbits),
        ):
            if options.only in (None, kind):
                tell_kind(pool, numbers)


if __name__ == "__main__":
    main()
