"""Whether the period of a drift ever doubles to an unstable orbit: ``doublings.py [--name A_r] [--values 5 6]``.

For each value of a parameter the flip is followed over e, and the least and the greatest coefficient of its normal form are
printed, with the rows in which it is zero: there the fold of the doubled orbit would end on the flip (generalised flip).
Coefficients are not known where contacts change at the flip itself. It ends with 1 if one is negative or zero.
"""

import argparse
import sys

import numpy as np

from dimersweep import orbits
from dimersweep.errors import OrbitError
from dimersweep.orbits.bifurcation_curve import DOUBLED_FOLD


def main():
    """Follow the flips; how many of the curves have a coefficient that is not positive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--name", default="A_r", help="parameter")
    parser.add_argument("--values", type=float, nargs="+", default=[5, 6, 7, 8], help="its values")
    parser.add_argument("--e", type=float, nargs=2, default=[0.45, 0.79], help="ends of e")
    given = parser.parse_args()
    turned = 0
    for value in given.values:
        try:
            flip = orbits.border_curve("flip", "Gamma", "e", span=tuple(given.e), spin=100.0, **{given.name: value})
        except OrbitError as reason:
            print(f"{given.name} = {value:g}: {reason}", flush=True)
            continue
        known = flip["doubling"].values[np.isfinite(flip["doubling"].values)]
        e, met = flip["e"].values, int((flip["meets"].values == DOUBLED_FOLD).sum())
        turned += bool(met or known.min() <= 0)
        print(
            f"{given.name} = {value:g}, e from {e.min():.3f} to {e.max():.3f}: coefficient {known.min():.3f} to "
            f"{known.max():.3f} at {known.size} of {e.size} points, zero in {met}; {flip.attrs['cost']:,.0f} forcing periods",
            flush=True,
        )
    return int(turned > 0)


if __name__ == "__main__":
    sys.exit(main())
