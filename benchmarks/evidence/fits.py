"""Whether fits find what made the data: ``python benchmarks/evidence/fits.py --sets 200``.

Orbits with drawn parameters, and tracks of circles and cycloids, are measured with drawn errors and fitted. Prints how many
of the true values lie within one and two standard deviations, where 68.3 and 95.4 % should, and how the misfits are
distributed.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product, repeat

import numpy as np
from scipy.stats import binomtest, kstest

from dimersweep import fits, orbits

FIXED = {"mu": 0.3, "mu_s": 0.6}
FREE = {"e": (0.56, 0.74), "A_r": (5.2, 6.8), "spin": (80.0, 150.0)}
DRAWN = {"e": (0.62, 0.68), "A_r": (5.7, 6.3), "spin": (100.0, 130.0)}
ERRORS = {"radius": 0.04, "zeta": 0.002, "impact_phase": 0.003, "speed": 0.004}
TRACK_ERROR, TRACK_POINTS = 0.02, 150  # of a coordinate [m], and how many of them
SHOULD = {1: 0.6827, 2: 0.9545}  # of a normal distribution, by its standard deviations


def of_orbit(seed):
    """Errors of the fitted values in their standard deviations, the probability of the misfit, and the cost."""
    rng = np.random.default_rng([27, seed])
    true = {name: float(rng.uniform(*ends)) for name, ends in DRAWN.items()}
    orbit = orbits.find(**FIXED, **true)
    measured = {name: (getattr(orbit, name) + rng.normal(0, error), error) for name, error in ERRORS.items()}
    fit = fits.fit(measured, FREE, **FIXED)
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


def tell(title, names, apart):
    """Print which share of the true values lies within one and two standard deviations."""
    print(title)
    for name, column in [*zip(names, apart.T, strict=True), ("all", apart.ravel())]:
        shares = []
        for times, should in SHOULD.items():
            inside = np.count_nonzero(np.abs(column) <= times)
            words = f"{times} sd: {100 * inside / column.size:5.1f} %"
            if name != "all":  # those of one set are not independent
                low, high = binomtest(inside, column.size).proportion_ci(0.95, "wilson")
                words += f" ({100 * low:.1f} to {100 * high:.1f})"
            shares.append(f"{words}, should be {100 * should:.1f}")
        lost = np.count_nonzero(~np.isfinite(column))
        mean = column[np.isfinite(column)].mean()
        print(
            f"  {name:>12}   {';   '.join(shares)};   mean {mean:+.2f} sd{f';   {lost} without an error' if lost else ''}"
        )


def tell_tracks(pool, numbers):
    """Print the shares of circles and cycloids."""
    for moving, known in product((False, True), (True, False)):
        apart = np.array(list(pool.map(of_track, numbers, repeat(moving), repeat(known), chunksize=20)))
        kind = f"{'cycloids' if moving else 'circles'}, error of a coordinate {'known' if known else 'estimated'}"
        tell(f"{len(numbers)} tracks: {kind}", ("radius", "period", "x", "y", "v_x", "v_y")[: apart.shape[1]], apart)


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
    parser.add_argument("--only", choices=("tracks", "orbits"), help="the other ones are left out")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.sets)
    with ProcessPoolExecutor(options.workers) as pool:
        if options.only != "orbits":
            tell_tracks(pool, numbers)
        if options.only != "tracks":
            tell_orbits(pool, numbers)


if __name__ == "__main__":
    main()
