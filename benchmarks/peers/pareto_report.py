"""A file of `pareto.py` in words and as its figure: ``python benchmarks/peers/pareto_report.py FILE [--figure PNG]``."""

import argparse
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from dimersweep.plots.style import MODE_COLORS

ERRORS = {
    "state_error": ("largest error of the states of a short run, in units of their scales", "1"),
    "double_error": ("largest error of the times of double impacts, in forcing periods", "1"),
    "orbit_error": ("largest relative error of radius, period and angle of the orbit", "1"),
}
SURE = 100.0  # how much larger than the doubt about the reference an error must be to count
COLORS = {
    "engine": MODE_COLORS["drift"],
    "heyoka": MODE_COLORS["aperiodic"],
    "oracle": MODE_COLORS["flutter"],
    "springs": MODE_COLORS["period_n"],
}
MARKERS = {"engine": "o", "heyoka": "s", "oracle": "^", "springs": "D"}
TITLES = {"springs": "Hertz springs", "oracle": "scipy oracle"}


def front(error, seconds_taken):
    """The points that none beats in both time and error, from the largest error to the smallest; two arrays."""
    order = np.lexsort((error, seconds_taken))
    kept, best = [], np.inf
    for k in order:
        if error[k] < best:
            kept.append(k)
            best = error[k]
    return error[kept], seconds_taken[kept]


def time_at(level, error, seconds_taken):
    """Time to an error of at most `level`, between the points of the front log-linear; nan if it is not reached."""
    good = np.isfinite(error) & np.isfinite(seconds_taken)
    if not good.any() or error[good].min() > level:
        return np.nan
    error, seconds_taken = front(np.maximum(error[good], 1e-17), seconds_taken[good])
    return float(np.exp(np.interp(-np.log(level), -np.log(error), np.log(seconds_taken))))


def advantages(points, quantity):
    """How many times as long a method takes as the engine to the same error: rows (scene, method, level, ratio).

    At the decades of the error that both reach and at which the reference is sure.
    """
    rows = []
    for scene in points["scene"].values:
        here = points.sel(scene=scene)
        doubt = float(here[f"{quantity}_doubt"])
        for method in points["program"].values:
            if method == "engine":
                continue
            for level in 10.0 ** -np.arange(1, 13):
                if not level >= SURE * doubt:
                    continue
                both = [
                    time_at(level, here[quantity].sel(program=name).values, here["time"].sel(program=name).values)
                    for name in (method, "engine")
                ]
                if np.isfinite(both).all():
                    rows.append((str(scene), str(method), float(level), both[0] / both[1]))
    return rows


def tell(points):
    """Print the points, then the ratios at equal error and the least of them."""
    for scene in points["scene"].values:
        here = points.sel(scene=scene)
        doubts = ", ".join(f"{name} {float(here[f'{name}_doubt']):.0e}" for name in ERRORS)
        print(f"\n{scene}: doubt about the reference: {doubts}")
        print(
            "method   setting             us/period  (quartiles)         state  (least-most)            double      orbit"
        )
        for method in points["program"].values:
            for k in range(points.sizes["setting"]):
                p = here.sel(program=method).isel(setting=k)
                if np.isfinite(p["time"]):
                    low, middle, high = (1e6 * float(p[name]) for name in ("time_low", "time", "time_high"))
                    state, double, orbit = (float(p[name]) for name in ERRORS)
                    spread = f"({float(p['state_error_least']):.0e}-{float(p['state_error_most']):.0e})"
                    print(
                        f"{method:8s} {p['knob'].item():18s} {middle:10.4g}  ({low:.4g}-{high:.4g})".ljust(57)
                        + f"{state:10.1e}  {spread:18s}{double:10.1e} {orbit:10.1e}"
                    )
    for quantity, (text, _) in ERRORS.items():
        rows = advantages(points, quantity)
        if not rows:
            continue
        print(f"\ntimes the engine's time at equal error: {text}")
        levels = sorted({row[2] for row in rows}, reverse=True)
        print(f"{'':26s}" + "".join(f"{level:9.0e}" for level in levels))
        ratios = {row[:3]: row[3] for row in rows}
        for scene, method in dict.fromkeys(row[:2] for row in rows):
            found = [ratios.get((scene, method, level)) for level in levels]
            print(f"{scene:16s} {method:9s}" + "".join(f"{ratio:9.3g}" if ratio else " " * 9 for ratio in found))
    print()
    rows = [(*row, name) for name in ERRORS for row in advantages(points, name)]
    for method in dict.fromkeys(row[1] for row in rows):
        scene, _, level, ratio, name = min((row for row in rows if row[1] == method), key=lambda row: row[3])
        print(f"least advantage over {TITLES.get(method, method)}: {ratio:.3g} times ({scene}, {name} {level:.0e})")


def draw(points, path):
    """Time over error of the states, one panel a scene, with the front of each method."""
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    panels = figure.subplots(2, -(-points.sizes["scene"] // 2), sharex=True, sharey=True, squeeze=False).ravel()
    for ax, scene in zip(panels, points["scene"].values, strict=False):
        here = points.sel(scene=scene)
        for method in map(str, points["program"].values):
            values = here.sel(program=method)
            error, middle = np.maximum(values["state_error"].values, 1e-14), values["time"].values
            good = np.isfinite(error) & np.isfinite(middle)
            if not good.any():
                continue
            color = COLORS[method]
            spread = np.abs(np.array([values["time_low"].values, values["time_high"].values]) - middle)[:, good]
            least, most = values["state_error_least"].values[good], values["state_error_most"].values[good]
            apart = np.array([error[good] - least, np.minimum(most, 1e3) - error[good]])
            ax.errorbar(
                error[good],
                middle[good],
                spread,
                np.maximum(apart, 0.0),
                fmt=MARKERS[method],
                ms=4,
                color=color,
                elinewidth=0.6,
                label=TITLES.get(method, method),
            )
            ax.plot(*front(error[good], middle[good]), color=color, lw=1, zorder=1)
        ax.axvspan(1e-15, min(100.0, SURE * float(here["state_error_doubt"])), color="#999999", alpha=0.2, lw=0)
        ax.set(xscale="log", yscale="log", title=scene, xlim=(100, 1e-14))
        ax.grid(alpha=0.3)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=6, fontsize=8)
    for ax in panels[-(-points.sizes["scene"] // 2) :]:
        ax.set_xlabel("error of the states, in their scales")
    for ax in panels[:: -(-points.sizes["scene"] // 2)]:
        ax.set_ylabel("processor time per forcing period [s]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=200)


def main():
    """Tell, and draw if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("points", type=Path, help="file of pareto.py")
    parser.add_argument("--figure", type=Path, help="where the figure goes (default: none)")
    given = parser.parse_args()
    points = xr.load_dataset(given.points)
    tell(points)
    if given.figure:
        draw(points, given.figure)


if __name__ == "__main__":
    main()
