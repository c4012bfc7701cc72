"""The energy budget of a run as a picture: what the plate gives in each contact state, and what takes it."""

import numpy as np
from matplotlib.axes import Axes

from dimersweep.cubes.seen_run import SeenRun
from dimersweep.symbols import WORKS

TERMS = {  # how each term is drawn: its words and its colour, dark at p1 and light at p2
    "plate_1": ("from the plate, $p_1$", "#1b7837"),
    "plate_2": ("from the plate, $p_2$", "#7fbf7b"),
    "plate_along": ("from the plate along itself", "#e69f00"),
    "restitution_1": ("restitution, $p_1$", "#2166ac"),
    "restitution_2": ("restitution, $p_2$", "#92c5de"),
    "slip_1": ("slip, $p_1$", "#b2182b"),
    "slip_2": ("slip, $p_2$", "#f4a582"),
}
SMALLEST = 1e-6  # of the greatest work: where the axis begins to be linear, and below which a contact state has no row


def energy_budget(axes: Axes, run: SeenRun, periods: int = 12) -> None:
    """Works in each contact state, per forcing period, over the last ones of a run; one bar a term, on a symmetric log axis.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    run : Run
        Recorded.
    periods : int
        Forcing periods to take the mean of, at most those of the run.

    Raises
    ------
    ParameterError
        If nothing was recorded.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from dimersweep import plots, simulate
    >>> figure = Figure()
    >>> plots.energy_budget(figure.subplots(), simulate(periods=60))
    """
    budget, f = run.energy("event"), run.parameters["f"]
    count = min(periods, run.n_periods)
    late = budget.isel(part=np.flatnonzero(budget["time"].values >= (run.n_periods - count) / f * (1 - 1e-12)))
    names = [name for name in WORKS if name in TERMS]
    kinds = list(dict.fromkeys(late["kind"].values.tolist()))
    sums = np.array([[late[name].values[late["kind"].values == kind].sum() for name in names] for kind in kinds])
    sums *= 1e6 / count
    greatest = np.abs(sums).max(initial=0.0)
    axes.set_xlabel("work on the dimer, per forcing period [µJ]")
    if not greatest:
        axes.set_yticks([])
        axes.set_title("no work is done", fontsize=9)
        return
    shown = np.abs(sums).max(1) > SMALLEST * greatest
    sums, kinds = sums[shown], [kind for kind, keep in zip(kinds, shown, strict=True) if keep]
    sums, kinds = np.vstack([sums, sums.sum(0)]), [*kinds, "all"]
    used = np.flatnonzero(np.abs(sums).max(0) > 0)
    height = 0.8 / len(used)
    for k, term in enumerate(used):
        label, color = TERMS[names[term]]
        axes.barh(np.arange(len(kinds)) + (k + 0.5) * height - 0.4, sums[:, term], height, color=color, label=label)
    axes.set_xscale("symlog", linthresh=SMALLEST * 10 ** np.ceil(np.log10(greatest)))
    axes.axvline(0.0, color="black", lw=0.8)
    axes.set_yticks(np.arange(len(kinds)), kinds)
    axes.set_ylim(len(kinds) - 0.5, -0.5)
    for row in np.arange(len(kinds) - 1):
        axes.axhline(row + 0.5, color="0.85", lw=0.6)
    ticks = 10.0 ** (np.ceil(np.log10(greatest)) + np.arange(-5, 1, 2))
    axes.set_xticks(np.concatenate([-ticks[::-1], [0.0], ticks]))
    axes.minorticks_off()
