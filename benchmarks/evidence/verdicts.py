"""How far the verdicts of Fig. 7 depend on rtol: ``python benchmarks/evidence/verdicts.py [--step DEGREES]``.

Prints the total drift length for each frequency at rtol 1e-6, 1e-8 (the default) and 1e-10, and the share of starts whose
mode differs from that at 1e-10.
"""

import argparse

import numpy as np

from dimersweep import sweep
from dimersweep.cubes.reading import drift_lengths
from dimersweep.kernel.model.layout import M_DRIFT

RTOLS = (1e-6, 1e-8, 1e-10)


def main() -> None:
    """Sweep Fig. 7 three times and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--step", type=float, default=0.1)
    step = parser.parse_args().step
    grid = {"f": [15, 20, 25], "beta0": {"start": step, "stop": 90 - step, "step": step, "unit": "deg"}}
    cubes = [sweep(grid, periods=400, rtol=rtol, progress=False) for rtol in RTOLS]
    best = cubes[-1]["mode"].values
    for rtol, cube in zip(RTOLS, cubes, strict=True):
        mode = cube["mode"].values
        told = ", ".join(f"{length:.4f}" for length in drift_lengths(cube).values)
        changed, drifts = np.count_nonzero(mode != best), np.count_nonzero((mode == M_DRIFT) != (best == M_DRIFT))
        print(
            f"rtol {rtol:.0e}: drift from {told} rad at 15, 20, 25 Hz; "
            f"{changed} of {mode.size} modes ({100 * changed / mode.size:.2f} %) and "
            f"{drifts} drifts differ from those at {RTOLS[-1]:.0e}"
        )


if __name__ == "__main__":
    main()
