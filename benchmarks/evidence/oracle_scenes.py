"""Compare the engine with the slow oracle on random scenes: ``python benchmarks/evidence/oracle_scenes.py --scenes 30``.

For each scene: the largest difference of the states over three forcing periods, in the scales of the state, of the engine
at three accuracies to the oracle at 1e-10, and of the oracle at 1e-9 to itself at 1e-10.
"""

import argparse
import time

import numpy as np

from tests import oracle
from tests.checks.random_scenes import whole_scene
from tests.checks.scenes import (
    difference,
    engine_states,
    general_scene,
    random_scene,
    sample_times,
    sawtooth_scene,
    started_scene,
    wider_scene,
)

RTOLS = (1e-8, 1e-10, 1e-12)
LEAST_REST = 1e-8  # m/s; hops of p2 that are slower are lost in the digits of its gap
DRAWN = {
    "random": random_scene,
    "wider": wider_scene,
    "general": general_scene,
    "started": started_scene,
    "sawtooth": sawtooth_scene,
    "whole": whole_scene,
}


def compare(scene):
    """One row of the table."""
    times = sample_times(scene)
    begun = time.perf_counter()
    fine, coarse = (oracle.simulate(scene, times, rtol=rtol, v_rest=max(rtol, LEAST_REST)) for rtol in (1e-10, 1e-9))
    took = time.perf_counter() - begun
    expected = fine["samples"][:, 1:]
    runs = [engine_states(scene, times, rtol) for rtol in RTOLS]
    errors = [difference(states, expected) for states, _ in runs]
    double = runs[1][1]
    n = min(len(double), len(fine["t_double"]), 6)
    late = max(np.abs(double[:n] - fine["t_double"][:n]), default=0.0)
    spread = difference(coarse["samples"][:, 1:], expected)
    return [*errors, spread, late, len(double), len(fine["t_double"]), took]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=30, help="number of random scenes")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--drawn", choices=DRAWN, default="whole", help="what the scenes have: whole, all of the model")
    options = parser.parse_args()
    heads = [f"{rtol:.0e}" for rtol in RTOLS] + ["oracle", "DI late"]
    print("scene " + " ".join(f"{head:>8}" for head in heads) + "  DIs  s  parameters")
    worst = np.zeros(len(RTOLS))
    for seed in range(options.first, options.first + options.scenes):
        scene = DRAWN[options.drawn](seed)
        try:
            row = compare(scene)
        except (RuntimeError, AssertionError, ValueError) as error:
            print(f"{seed:5d} {type(error).__name__}: {error}  {scene}", flush=True)
            continue
        worst = np.maximum(worst, row[: len(RTOLS)])
        numbers = " ".join(f"{value:8.1e}" for value in row[:5])
        text = " ".join(f"{name}={value:.4g}" for name, value in scene.items())
        print(f"{seed:5d} {numbers} {row[5]:3d}/{row[6]:<3d} {row[7]:4.0f}  {text}", flush=True)
    print("worst " + " ".join(f"{value:8.1e}" for value in worst))


if __name__ == "__main__":
    main()
