"""Errors of the engine's limits against the engine, with fitted orders: ``python benchmarks/evidence/limits.py``.

Stiff springs against its impacts and against whole runs, over the stiffness; Moreau's time stepping against its
sustained contact, over the step. Prints the tables and draws the figure.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dimersweep.plots.style import ROW_COLORS
from tests.limits.cases import IMPACTS, STRETCHES, impact_errors, order, run_errors, stretch_errors

FIGURE = Path(__file__).resolve().parents[2] / "docs" / "figures" / "limits.png"
MARKERS = "osD^vP<X"
IMPACT_STEPS, RUN_STEPS = 2000, 240  # time steps a contact time
FIT = 5  # hardest springs, or shortest steps, that the order is fitted to


def impacts(stiffnesses):
    """Errors of the springs in units of the approach speed, by the name of the impact."""
    return {name: impact_errors(impact, stiffnesses, IMPACT_STEPS) for name, impact in IMPACTS.items()}


def runs(stiffnesses):
    """Errors of the springs over the base case: states in their scales, time of the first double impact in periods."""
    errors = run_errors({}, np.array([1.0, 1.5]) / 15, stiffnesses, RUN_STEPS)
    return dict(
        zip(("state after 1 period", "state after 1.5 periods", "time of the double impact"), errors.T, strict=True)
    )


def stretches(steps):
    """Errors of Moreau's time stepping in the scales of the state, by the name of the stretch."""
    return {name: stretch_errors(stretch, steps) for name, stretch in STRETCHES.items()}


def show(title, over, x, errors):
    """Print one table."""
    print(f"\n{title}\n{over:>34} " + " ".join(f"{value:8.1e}" for value in x) + "   order")
    for name, row in errors.items():
        fitted = order(x[-FIT:], row[-FIT:])
        print(f"{name:>34} " + " ".join(f"{value:8.1e}" for value in row) + f"  {fitted:6.2f}")


def draw(ax, x, errors, slope, label):
    """Errors over x as lines of points, and the slope that they must have."""
    for k, (name, row) in enumerate(errors.items()):
        ax.loglog(x, row, marker=MARKERS[k % 8], ms=4, lw=1, color=ROW_COLORS[k % 6], label=name)
    least = min(row[-1] for row in errors.values())
    ax.loglog(x, 0.5 * least * (x / x[-1]) ** slope, "--", color="#555555", lw=1, label=label)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.16))


def main():
    """Print the tables, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hardest", type=float, default=11.5, help="exponent of the stiffest springs, N/m^1.5")
    parser.add_argument("--halvings", type=int, default=8, help="of Moreau's first time step of 4e-4 s")
    parser.add_argument("--figure", type=Path, default=FIGURE, help="where the figure goes")
    options = parser.parse_args()
    stiffnesses = 10.0 ** np.arange(7, options.hardest + 0.25, 0.5)
    steps = 4e-4 / 2.0 ** np.arange(options.halvings + 1)
    figure = Figure(figsize=(13, 5.2), layout="constrained")
    panels = (
        ("springs against impacts", "k [N/m^1.5]", stiffnesses, impacts(stiffnesses), -0.4, "order 2/5"),
        ("springs against whole runs", "k [N/m^1.5]", stiffnesses, runs(stiffnesses), -0.4, "order 2/5"),
        ("time steps against sustained contact", "time step [s]", steps, stretches(steps), 1.0, "order 1"),
    )
    units = (
        "error of the velocities [approach speed]",
        "error [scales of the state, forcing periods]",
        "error [scales of the state]",
    )
    for ax, (title, over, x, errors, slope, label), unit in zip(figure.subplots(1, 3), panels, units, strict=True):
        show(title, over, x, errors)
        draw(ax, x, errors, slope, label)
        ax.set(title=title, xlabel=over.replace("k [N/m^1.5]", r"stiffness $k$ [N/m$^{3/2}$]"), ylabel=unit)
    options.figure.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.figure, dpi=200)
    print(f"\n{options.figure}")


if __name__ == "__main__":
    main()
