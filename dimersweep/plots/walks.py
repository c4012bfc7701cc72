"""Pictures of walks that may close or not: their tracks, and how fast the circles' centres move, or how much they bend."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dimersweep.cubes.cube import names
from dimersweep.plots.judging import judge_cube
from dimersweep.plots.style import framed, given, mark, row_colors

CENTRES = {"centre_velocity_x": ("o", "along $x$"), "centre_velocity_y": ("s", "along $y$")}


def walks(cube: xr.Dataset) -> Figure:
    """Tracks of the centre of mass from their starts; beside them the velocities of the circles' centres, or the curvatures.

    Parameters
    ----------
    cube : xarray.Dataset
        With paths over one axis.

    Returns
    -------
    matplotlib.figure.Figure
        On plates where the centres move: their velocities, and a word for each track that has no whole turn. On others: the
        curvature 1/R of each path, positive where the heading falls.

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"tilt": [0.0, 1e-3, 2e-3], "beta0": [0.28]}
    >>> cube = search(grid, over="beta0", ask="first", periods=700, progress=False,
    ...               orbit_periods=700, paths={"periods": 700, "per_period": 1})
    >>> plots.walks(cube).savefig("walks.png")
    """
    judge_cube("walks", cube)
    (name,) = (str(dim) for dim in cube["mode"].dims)
    figure, (left, right) = framed(cube, (11, 4.6), "Tracks of the centre of mass\n", ncols=2)
    words, colors = names(cube["track"]).values, row_colors(cube.sizes[name])
    for k, value in enumerate(cube[name].values):
        text = f"{given(name, value)}: {words[k]}"
        left.plot(cube["x"].values[k], cube["y"].values[k], color=colors[k], linewidth=0.8, label=text)
    left.plot(0, 0, "o", color="black", markersize=3)
    left.set(aspect="equal", adjustable="datalim", xlabel="$x$ [m]", ylabel="$y$ [m]")
    if any(np.nanmax(np.abs(cube[which].values), initial=0.0) > 0 for which in CENTRES):
        _velocities(right, cube, name, words)
    else:
        right.plot(cube[name], -cube["precession_rate"] / cube["speed"], "o-", color=colors[0], markersize=4)
        right.set_ylabel("curvature $1/R$ [1/m]")
    right.axhline(0, color="gray", linewidth=0.6, zorder=0)
    mark(right.xaxis, name)
    right.locator_params(axis="x", nbins=5)
    figure.legend(*left.get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    return figure


def _velocities(axes: Axes, cube: xr.Dataset, name: str, words: np.ndarray) -> None:
    """The velocities of the circles' centres over an axis, and the words of the tracks that have none."""
    for color, (which, (marker, text)) in zip(row_colors(2), CENTRES.items(), strict=True):
        axes.plot(cube[name], 1e3 * cube[which], f"{marker}-", color=color, markersize=4, linewidth=1, label=text)
    below = np.nansum(cube["centre_velocity_x"].values) < 0  # the curve, so that there is room
    for value, velocity, word in zip(cube[name].values, cube["centre_velocity_x"].values, words, strict=True):
        if np.isnan(velocity):
            side = "top" if below else "bottom"
            axes.text(value, 0, f" {word} ", ha="center", va=side, rotation=90, fontsize=8, in_layout=False)
    reach = 0.03 * float(np.ptp(cube[name].values))
    axes.set_xlim(cube[name].values.min() - reach, cube[name].values.max() + reach)
    axes.set_ylabel("velocity of the circle's centre [mm/s]")
    axes.legend(fontsize=8, loc="best")
