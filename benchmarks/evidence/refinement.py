"""Check a refined map against every run of its grid.

``python benchmarks/evidence/refinement.py CUBE [--points N]`` takes the region of N points of a map that was made, spread at
random (or of all of them, with ``--points all``), and finds it again by all runs of the searched axis.

``python benchmarks/evidence/refinement.py SWEEP.toml --halvings e=1 Gamma=4 --out grid.nc`` makes the declared map with these
halvings in place of its own, sweeps the whole of that fine grid, all values of the searched axis at each point, and compares
every cell. With ``--out`` the sweep is kept, and goes on after a stop. ``--periods`` gives both the same shorter runs.

Both end with 1 if a point differs or the map takes a tenth of the grid's runs or more. Told as well is the share of the runs
of a grid that stops at each point with the first run of the mode asked for: that is all that the question needs.
"""

import argparse
import json
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

import dimersweep
from dimersweep.cubes.cube import names
from dimersweep.kernel.model.layout import CODES, MODES
from dimersweep.parameters import fill_rows
from dimersweep.studies.declaration import read_declaration
from dimersweep.studies.refine import refine
from dimersweep.work.tiles import RunSettings, run_all_patiently

SHARE = 0.1  # of the grid's runs that a map may take


def regions_of(modes, asked):
    """Regions, words, from the modes, codes, of all runs of the searched axis, which is the last one of `modes`."""
    one = np.where((modes == modes[..., :1]).all(axis=-1), np.array(MODES)[modes[..., 0]], "mixed")
    return np.where((modes == MODES.index(asked)).any(axis=-1), asked, one)


def runs_to_first(modes, asked):
    """Runs that a grid takes if it stops at each point with the first of mode `asked`; `modes` as in `regions_of`."""
    hits = modes == MODES.index(asked)
    return int(np.where(hits.any(axis=-1), hits.argmax(axis=-1) + 1, modes.shape[-1]).sum())


def modes_at(cube, told, place):
    """Modes, codes, of every run of the searched axis at one point."""
    values = np.array(told["search"]["values"])
    here = {str(dim): cube[dim].values[k] for dim, k in zip(cube["mode"].dims, place, strict=True)}
    rows = fill_rows(told["fixed"] | here | {told["search"]["axis"]: values}, values.size)
    longest = told.get("max_periods", told["periods"])
    _, codes = run_all_patiently(rows, RunSettings(told["periods"], longest, told["rtol"]))
    return codes[:, CODES.index("mode")]


def lumped(regions, between):
    """Regions that are not to be told apart as one."""
    return np.where(np.isin(regions, between), regions, "")


def compare(cube, places, modes, seconds):
    """Whether the regions of `cube` at `places` are those of all runs there, and it took less than `SHARE` of the grid's runs.

    Parameters
    ----------
    cube : xarray.Dataset
        The map.
    places : ndarray, shape (n, n_axes), int
    modes : ndarray, shape (n, n_values), int
        Of every run of the searched axis at each of them, codes.
    seconds : float
        Time these took.
    """
    told = json.loads(cube.attrs["configuration"])
    asked, between = told["search"]["mode"], told["refine"]["between"]
    mapped, brute = names(cube["region"]).values[tuple(places.T)], regions_of(modes, asked)
    wrong = lumped(mapped, between) != lumped(brute, between)
    print(f"{(~wrong).sum()} of {wrong.size} points agree ({seconds:.0f} s)")
    for place, region, other in zip(places[wrong].tolist(), mapped[wrong], brute[wrong], strict=True):
        print(f"differs at {place}: map {region}, all runs {other}")
    runs, whole = int(cube["n_runs"].sum()), cube["mode"].size * modes.shape[-1]
    first = whole * runs_to_first(modes, asked) / modes.size
    about = "" if len(places) == cube["mode"].size else "about "
    print(f"the map took {runs} runs, the whole grid takes {whole}: {100 * runs / whole:.2f} %")
    print(f"stopped at the first {asked} of each point, the grid takes {about}{first:.0f}: {100 * runs / first:.2f} %")
    return not wrong.any() and runs < SHARE * whole


def sample(cube, points, seed):
    """Compare `points` random points, or all."""
    told, shape, start = json.loads(cube.attrs["configuration"]), cube["mode"].shape, perf_counter()
    size = cube["mode"].size
    chosen = (
        np.arange(size) if points == "all" else np.random.default_rng(seed).choice(size, int(points), replace=False)
    )
    places = np.stack(np.unravel_index(chosen, shape), axis=1)
    return compare(cube, places, np.array([modes_at(cube, told, place) for place in places]), perf_counter() - start)


def whole(path, halvings, how, out):
    """Make a declared map with other halvings, and compare every cell with the sweep of all runs."""
    declared = read_declaration(path)
    how |= {"rtol": declared.sweep.rtol}
    if how["periods"] is None:
        how |= {"periods": declared.sweep.periods, "max_periods": declared.sweep.max_periods}
    asked = declared.search.model_dump(exclude={"orbit_periods"})
    start = perf_counter()
    between = declared.refine.between
    cube = refine(declared.grid, declared.fixed, halvings=halvings, between=between, **asked, **how)
    axes = {str(dim): cube[dim].values for dim in cube["mode"].dims}
    spacing = ", ".join(f"{name} by {np.diff(values).min():.4g}" for name, values in axes.items())
    shape = " x ".join(str(values.size) for values in axes.values())
    print(f"map of {shape} points, {spacing}: {perf_counter() - start:.0f} s", flush=True)
    start = perf_counter()
    grid = axes | {asked["over"]: declared.grid[asked["over"]]}
    modes = dimersweep.sweep(grid, declared.fixed, out=out, **how)["mode"].values
    places = np.argwhere(np.ones(cube["mode"].shape, dtype=bool))
    return compare(cube, places, modes.reshape(len(places), -1), perf_counter() - start)


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
    parser.add_argument("--periods", type=int, help="in place of the declared ones and of max_periods")
    parser.add_argument("--out", type=Path, help="cube of the whole grid, kept")
    parser.add_argument("--workers", type=int)
    given = parser.parse_args()
    if given.halvings:
        how = {"periods": given.periods, "workers": given.workers}
        good = whole(given.source, dict(given.halvings), how, given.out)
    else:
        good = sample(dimersweep.open_cube(given.source), given.points, given.seed)
    sys.exit(not good)


if __name__ == "__main__":
    main()
