"""Check a refined map against every run of its grid: ``python benchmarks/refinement.py CUBE [--points N]``.

The region of N points of the map, spread at random over those that were computed and those that were not (or of all of
them, with ``--points all``), is found again by all runs of the searched axis.
"""

import argparse
import json
from time import perf_counter

import numpy as np

import dimersweep
from dimersweep.cube import blank, names
from dimersweep.kernel.engine import run_many
from dimersweep.kernel.layout import CODES, MODES
from dimersweep.parameters import fill_rows


def region_of(cube, told, place):
    """Region of one point by every run of the searched axis."""
    values = np.array(told["search"]["values"])
    here = {str(dim): cube[dim].values[k] for dim, k in zip(cube["mode"].dims, place, strict=True)}
    rows = fill_rows(told["fixed"] | here | {told["search"]["axis"]: values}, values.size)
    out, codes = blank(values.size)
    run_many(rows, told["periods"], told["rtol"], True, out, codes)
    modes = codes[:, CODES.index("mode")]
    asked = MODES.index(told["search"]["mode"])
    if (modes == asked).any():
        return MODES[asked]
    return MODES[modes[0]] if (modes == modes[0]).all() else "mixed"


def main() -> None:
    """Print how many points agree, and how many runs the map and the whole grid take."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cube")
    parser.add_argument("--points", default="60")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    cube = dimersweep.open_cube(given.cube)
    told = json.loads(cube.attrs["configuration"])
    between = told["refine"]["between"]
    size = cube["mode"].size
    points = np.arange(size)
    if given.points != "all":
        points = np.random.default_rng(given.seed).choice(size, int(given.points), replace=False)
    regions = names(cube["region"]).values
    wrong, start = [], perf_counter()
    for point in points:
        place = np.unravel_index(point, regions.shape)
        brute = region_of(cube, told, place)
        if (brute if brute in between else "") != (regions[place] if regions[place] in between else ""):
            wrong.append((place, regions[place], brute))
    whole = size * len(told["search"]["values"])
    runs = int(cube["n_runs"].sum())
    print(f"{points.size - len(wrong)} of {points.size} points agree ({perf_counter() - start:.0f} s)")
    print(f"the map took {runs} runs, the whole grid takes {whole}: {100 * runs / whole:.2f} %")
    for place, region, brute in wrong:
        print(f"differs at {place}: map {region}, all runs {brute}")


if __name__ == "__main__":
    main()
