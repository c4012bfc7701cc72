"""Tell what `pareto` measured, in words and as its figure."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dimersweep.plots.style import MODE_COLORS

ERRORS = {
    "state": "largest error of the states of a short run, in units of their scales",
    "double": "largest error of the times of double impacts, in forcing periods",
    "orbit": "largest relative error of radius, period and angle of the orbit",
}
SURE = 100.0  # how much larger than the doubt about the reference an error must be to count
LEVELS = 10.0 ** -np.arange(1, 13)
STYLES = {  # colour, marker, title
    "engine": (MODE_COLORS["drift"], "o", "engine"),
    "oracle": (MODE_COLORS["flutter"], "^", "scipy oracle"),
    "springs": (MODE_COLORS["period_n"], "D", "Hertz springs"),
    "heyoka": (MODE_COLORS["aperiodic"], "s", "heyoka"),
}


def front(error, seconds):
    """Return the points that none beats in both time and error, from the largest error to the smallest; two arrays."""
    kept, best = [], np.inf
    for k in np.lexsort((error, seconds)):
        if error[k] < best:
            kept.append(k)
            best = error[k]
    return error[kept], seconds[kept]


def time_at(level, error, seconds):
    """Return the time to an error of at most `level`, between the points of the front log-linear; nan if it is not reached."""
    good = np.isfinite(error) & np.isfinite(seconds)
    if not good.any() or error[good].min() > level:
        return np.nan
    error, seconds = front(np.maximum(error[good], 1e-17), seconds[good])
    return float(np.exp(np.interp(-np.log(level), -np.log(error), np.log(seconds))))


def advantages(points, doubts, quantity):
    """Return how many times the engine's time the others take to the same error: rows (scene, program), columns decades.

    At the decades of the error that both reach and at which the reference is sure.
    """
    times = {
        key: [time_at(level, here[quantity].to_numpy(), here["seconds"].to_numpy()) for level in LEVELS]
        for key, here in points.groupby(["scene", "program"], sort=False)
    }
    table = pd.DataFrame(
        {key: np.divide(row, times[key[0], "engine"]) for key, row in times.items() if key[1] != "engine"}, LEVELS
    ).T
    for scene, doubt in doubts.items():
        table.loc[scene, SURE * doubt[list(ERRORS).index(quantity)] > LEVELS] = np.nan
    return table.dropna(how="all").dropna(axis=1, how="all")


def tell(points, doubts):
    """Print the points, then the ratios at equal error and the least of them."""
    shown = points.assign(us_per_period=1e6 * points["seconds"]).drop(
        columns=["seconds", "seconds_low", "seconds_high"]
    )
    print(shown.to_string(index=False, float_format="{:.3g}".format))
    for scene, doubt in doubts.items():
        print(
            f"{scene}: doubt about the reference: "
            + ", ".join(f"{q} {d:.0e}" for q, d in zip(ERRORS, doubt, strict=True))
        )
    tables = {}
    for quantity, text in ERRORS.items():
        table = advantages(points, doubts, quantity)
        if len(table):
            tables[quantity] = table.stack()
            print(f"\ntimes the engine's time at equal error: {text}")
            head = [f"{level:.0e}" for level in table.columns]
            print(table.to_string(header=head, na_rep="", float_format="{:.3g}".format, sparsify=False))
    every = pd.concat(tables)
    print()
    for program, values in every.groupby(level=2):
        quantity, scene, _, level = values.idxmin()
        print(f"least advantage over {STYLES[program][2]}: {values.min():.3g} times ({scene}, {quantity} {level:.0e})")


def draw(points, doubts, path):
    """Draw time over error of the states, one panel a scene, with the front of each program."""
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    panels = figure.subplots(2, -(-len(doubts) // 2), sharex=True, sharey=True, squeeze=False)
    for ax, (scene, doubt) in zip(panels.ravel(), doubts.items(), strict=False):
        good = points[(points["scene"] == scene) & np.isfinite(points["state"])]
        for program, here in good.groupby("program", sort=False):
            color, marker, title = STYLES[program]
            error, middle = np.maximum(here["state"].to_numpy(), 1e-14), here["seconds"].to_numpy()
            spread = middle - here["seconds_low"], here["seconds_high"] - middle
            apart = np.maximum(error - here["state_least"], 0.0), np.minimum(here["state_most"], 1e3) - error
            bars = {"fmt": marker, "ms": 4, "color": color, "elinewidth": 0.6, "label": title}
            ax.errorbar(error, middle, spread, np.maximum(apart, 0.0), **bars)
            ax.plot(*front(error, middle), color=color, lw=1, zorder=1)
        ax.axvspan(1e-15, min(100.0, SURE * doubt[0]), color="#999999", alpha=0.2, lw=0)
        ax.set(xscale="log", yscale="log", title=scene, xlim=(100, 1e-14))
        ax.grid(alpha=0.3)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6, fontsize=8)
    for ax in panels[-1]:
        ax.set_xlabel("error of the states, in their scales")
    for ax in panels[:, 0]:
        ax.set_ylabel("processor time per forcing period [s]")
    figure.savefig(path, dpi=200)
