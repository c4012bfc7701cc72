"""Whether the borders of random dimers are where they are said to be: ``borders_random.py [--dimers N] [--first K]``.

Of each dimer (r 2 to 10 mm, A_r 4.5 to 9, f 12 to 50 Hz, mu 0.08 to 0.5, mu_s up to 2 mu, e 0.5 to 0.78, spin 0.16/r to 0.64/r)
the fold and both ends of the drift's stability are computed, and crossed by `find` at 1 % to either side: on the inner side
there is a stable orbit, and beyond an unstable one, or none, or another motion; where a row says that no stable orbit loses its
stability there, this is not so. Where no stable orbit is found, none of some drawn starts comes to a drift. Printed are the
forcing periods of the map that each border took. It ends with 1 if a border is not as told.
"""

import argparse
import sys

import numpy as np

from dimersweep import names, orbits
from dimersweep.errors import OrbitError
from tests.checks.dimers import STARTS, crossed, drifts, random_dimer

OUTWARD = {"fold": -1, "stable_from": -1, "stable_to": 1}


def judged(kind, dimer):
    """Where a border of a dimer is, the kind of border there, the periods it took, and whether it is as told."""
    e = dimer["e"]
    rest = {name: value for name, value in dimer.items() if name != "e"}
    try:
        found = orbits.border(kind, "Gamma", over={"e": [e]}, **rest).isel(e=0)
    except OrbitError as reason:
        count = drifts(dimer)
        return f"{reason}; {count} of {STARTS} drawn starts drift", "", np.nan, count == 0
    Gamma, by = float(found["Gamma"]), names(found["ends_by"]).item() if "ends_by" in found else kind
    inner, outer = crossed(dimer, Gamma, OUTWARD[kind])
    lost = inner == "stable" and outer != "stable"
    told = f"{Gamma:.6f} {'' if found['loses_stability'] else '(no stable orbit ends there) '}({inner} inside, {outer} beyond)"
    return told, by, float(found["cost"]), lost == bool(found["loses_stability"])


def main():
    """Judge the borders of all dimers; how many are not as told."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dimers", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first dimer")
    given = parser.parse_args()
    wrong, costs, kinds = 0, {kind: [] for kind in OUTWARD}, []
    for seed in range(given.first, given.first + given.dimers):
        for kind in OUTWARD:
            told, by, cost, right = judged(kind, random_dimer(seed))
            wrong += not right
            costs[kind].append(cost)
            kinds += [by] if kind == "stable_to" else []
            print(f"{seed:4} {kind:9} {by:13} {told}, {cost:.0f} periods{'' if right else ' NOT AS TOLD'}", flush=True)
    for kind, cost in costs.items():
        print(f"{kind}: median {np.nanmedian(cost):.0f}, most {np.nanmax(cost):.0f} forcing periods")
    ends = ", ".join(f"{kinds.count(kind)} by {kind or 'nothing found'}" for kind in sorted(set(kinds)))
    print(f"{given.dimers} dimers: {ends}; {wrong} borders not as told")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
