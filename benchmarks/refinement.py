"""Check a refined map against every run of its grid.

``python benchmarks/refinement.py CUBE [--points N]`` takes the region of N points of a map that was made, spread at random
(or of all of them, with ``--points all``), and finds it again by all runs of the searched axis.

``python benchmarks/refinement.py SWEEP.toml --halvings Gamma=2`` makes the declared map with these halvings in place of its
own, sweeps the whole of that fine grid, all values of the searched axis at each point, and compares every cell.
"""

import argparse
import json
from pathlib import Path
from time import perf_counter

import numpy as np

import dimersweep
from dimersweep.cube import blank, names
from dimersweep.declaration import read_declaration
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.layout import CODES, MODES
from dimersweep.parameters import fill_rows
from dimersweep.refining import refine


def regions_of(modes, asked):
    """Regions, words, from the modes, codes, of all runs of the searched axis, which is the last one of `modes`."""
    one = np.where((modes == modes[..., :1]).all(axis=-1), np.array(MODES)[modes[..., 0]], "mixed")
    return np.where((modes == MODES.index(asked)).any(axis=-1), asked, one)


def region_at(cube, told, place):
    """Region of one point by every run of the searched axis."""
    values = np.array(told["search"]["values"])
    here = {str(dim): cube[dim].values[k] for dim, k in zip(cube["mode"].dims, place, strict=True)}
    rows = fill_rows(told["fixed"] | here | {told["search"]["axis"]: values}, values.size)
    out, codes = blank(values.size)
    run_many(rows, told["periods"], told["rtol"], True, out, codes)
    return str(regions_of(codes[:, CODES.index("mode")], told["search"]["mode"]))


def lumped(regions, between):
    """Regions that are not to be told apart as one."""
    return np.where(np.isin(regions, between), regions, "")


def tell(cube, places, brute, seconds):
    """Print how many of `places` have in `cube` the region of `brute`, and how many runs the map and the grid take."""
    told = json.loads(cube.attrs["configuration"])
    mapped = names(cube["region"]).values[tuple(places.T)]
    wrong = lumped(mapped, told["refine"]["between"]) != lumped(brute, told["refine"]["between"])
    print(f"{(~wrong).sum()} of {wrong.size} points agree ({seconds:.0f} s)")
    runs, whole = int(cube["n_runs"].sum()), cube["mode"].size * len(told["search"]["values"])
    print(f"the map took {runs} runs, the whole grid takes {whole}: {100 * runs / whole:.2f} %")
    for place, region, other in zip(places[wrong].tolist(), mapped[wrong], brute[wrong], strict=True):
        print(f"differs at {place}: map {region}, all runs {other}")


def sample(cube, points, seed):
    """Compare `points` random points, or all."""
    told, shape, start = json.loads(cube.attrs["configuration"]), cube["mode"].shape, perf_counter()
    size = cube["mode"].size
    chosen = (
        np.arange(size) if points == "all" else np.random.default_rng(seed).choice(size, int(points), replace=False)
    )
    places = np.stack(np.unravel_index(chosen, shape), axis=1)
    brute = np.array([region_at(cube, told, place) for place in places])
    tell(cube, places, brute, perf_counter() - start)


def whole(path, halvings, workers):
    """Make a declared map with other halvings, and compare every cell with the sweep of all runs."""
    declared = read_declaration(path)
    how = {"periods": declared.sweep.periods, "rtol": declared.sweep.rtol, "workers": workers}
    asked = declared.search.model_dump(exclude={"orbit_periods"})
    start = perf_counter()
    between = declared.refine.between
    cube = refine(declared.grid, declared.fixed, halvings=halvings, between=between, **asked, **how)
    axes = {str(dim): cube[dim].values for dim in cube["mode"].dims}
    spacing = ", ".join(f"{name} by {np.diff(values).min():.4g}" for name, values in axes.items())
    print(f"map of {' x '.join(str(values.size) for values in axes.values())} points, {spacing}: {_since(start)}")
    start = perf_counter()
    grid = axes | {asked["over"]: declared.grid[asked["over"]]}
    modes = dimersweep.sweep(grid, declared.fixed, **how)["mode"].values
    places = np.argwhere(np.ones(cube["mode"].shape, dtype=bool))
    tell(cube, places, regions_of(modes, asked["mode"]).ravel(), perf_counter() - start)


def _since(start):
    return f"{perf_counter() - start:.0f} s"


def _halving(text):
    name, count = text.split("=")
    return name, int(count)


def main() -> None:
    """Print how many points agree, and how many runs the map and the whole grid take."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", type=Path, metavar="CUBE|SWEEP.toml")
    parser.add_argument("--points", default="60")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--halvings", type=_halving, nargs="+", metavar="AXIS=COUNT")
    parser.add_argument("--workers", type=int)
    given = parser.parse_args()
    if given.halvings:
        whole(given.source, dict(given.halvings), given.workers)
    else:
        sample(dimersweep.open_cube(given.source), given.points, given.seed)


if __name__ == "__main__":
    main()
