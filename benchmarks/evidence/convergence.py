"""Error and time of a run against the accuracy asked for: ``python benchmarks/evidence/convergence.py``.

Sixteen scenes over four forcing periods, each compared with the engine at a far tighter setting, in the scales of the
state. Prints a table and draws both over rtol.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dimersweep import simulate
from dimersweep.plots.style import log_scale
from tests.checks.scenes import difference, engine_states

HERE = Path(__file__).resolve().parent
FIGURE = HERE.parents[1] / "docs" / "figures" / "convergence.png"
FINEST = 1e-13


def seconds(scene, periods, rtol, repeats):
    """Shortest time of a run without a record."""
    taken = []
    for _ in range(repeats):
        begun = time.perf_counter()
        simulate(**scene, periods=periods, rtol=rtol, record=False)
        taken.append(time.perf_counter() - begun)
    return min(taken)


def measure(rtols, repeats):
    """Errors and times, shape (scenes, accuracies)."""
    setup = json.loads((HERE / "scenes.json").read_text())
    periods = setup["periods"]
    errors, times = [], []
    for scene in setup["scenes"]:
        at = np.arange(1, setup["samples_per_period"] * periods + 1) / setup["samples_per_period"] / scene["f"]
        finest, _ = engine_states(scene, at, FINEST)
        errors.append([difference(engine_states(scene, at, rtol)[0], finest) for rtol in rtols])
        times.append([seconds(scene, periods, rtol, repeats) for rtol in rtols])
    return np.array(errors), np.array(times)


def draw(rtols, errors, times, path):
    """Both over the accuracy asked for: each scene as a thin line, the median as a thick one."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots(1, 2)
    for ax, values in zip(axes, (errors, 1e3 * times), strict=True):
        ax.loglog(rtols, values.T, color="#0072b2", alpha=0.35, lw=0.8)
        ax.loglog(rtols, np.median(values, axis=0), "o-", color="#0072b2", label="median")
        ax.set_xlabel("rtol")
        ax.grid(alpha=0.3)
        ax.invert_xaxis()
    axes[0].loglog(rtols, rtols, "--", color="#555555", lw=1, label="error = rtol")
    axes[0].set_ylabel("largest error of the state, in its scales")
    axes[0].legend()
    axes[1].set_ylabel("time of a run of four periods [ms]")
    log_scale(axes[1])
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=200)


def main():
    """Print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tightest", type=int, default=11, help="exponent of the tightest rtol")
    parser.add_argument("--repeats", type=int, default=5, help="timings of each run, of which the shortest counts")
    parser.add_argument("--figure", type=Path, default=FIGURE, help="where the figure goes")
    options = parser.parse_args()
    rtols = 10.0 ** -np.arange(4, options.tightest + 1)
    errors, times = measure(rtols, options.repeats)
    median = np.median(errors, axis=0)
    print("rtol    median error  worst error (scene)  median ms")
    for k, rtol in enumerate(rtols):
        worst = int(np.argmax(errors[:, k]))
        print(
            f"{rtol:.0e}   {median[k]:11.1e}  {errors[worst, k]:11.1e} ({worst:2d})  {1e3 * np.median(times[:, k]):12.3f}"
        )
    fall = np.polyfit(np.log10(rtols), np.log10(median), 1)[0]
    print(
        f"median error falls {'at every step' if (np.diff(median) < 0).all() else 'NOT at every step'}, as rtol^{fall:.2f}"
    )
    draw(rtols, errors, times, options.figure)
    print(options.figure)


if __name__ == "__main__":
    main()
