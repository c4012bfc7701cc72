"""Pictures of where the modes lie: intervals of the dip angle, and regions of a search."""

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dimersweep.cubes.cube import names
from dimersweep.cubes.reading import dip_range, drift_intervals, drift_lengths, edges_of
from dimersweep.kernel.model.layout import MODES
from dimersweep.plots.judging import judge_cube
from dimersweep.plots.maps import COLORS
from dimersweep.plots.style import ROW_COLORS, face, framed, given, mark
from dimersweep.symbols import symbol


def segments(cube: xr.Dataset) -> Figure:
    """The initial dip angles that lead to drift, as in the paper's Fig. 7: one row for each value of the other axis.

    Parameters
    ----------
    cube : xarray.Dataset
        With the axis `beta0` and at most one more.

    Returns
    -------
    matplotlib.figure.Figure
        With the total length of each row at its right end.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> cube = sweep({"Gamma": [0.8, 0.9], "beta0": [0.2, 0.28, 0.36]}, periods=60, progress=False)
    >>> plots.segments(cube).savefig("intervals.png")
    """
    judge_cube("segments", cube)
    lengths = drift_lengths(cube)
    (name,) = lengths.dims
    figure, axes = framed(cube, (8, 1.4 + 0.55 * lengths.size), "Initial dip angles that lead to drift\n")
    for row, (intervals, length) in enumerate(zip(drift_intervals(cube), lengths.values, strict=True)):
        color = ROW_COLORS[row % len(ROW_COLORS)]
        axes.hlines(np.full(len(intervals), row), intervals[:, 0], intervals[:, 1], colors=color, linewidth=7)
        axes.annotate(
            f"{length:.3f} rad", (1.01, row), xycoords=("axes fraction", "data"), va="center", color=color, fontsize=9
        )
    axes.set_yticks(range(lengths.size), [given(str(name), value) for value in lengths[name].values])
    axes.set_ylim(-0.6, lengths.size - 0.4)
    axes.grid(axis="x", alpha=0.3)
    _dip_axis(axes, *dip_range(cube["beta0"].values))
    return figure


def _dip_axis(axes: Axes, low: float, high: float) -> None:
    """The dip angle, up to a right angle on one side or on both, in radians below, in degrees above."""
    axes.set_xlim(low, high)
    sides = (sign for sign, end in ((-1, low), (1, high)) if end)
    eighths = {0.0: "0"} | {
        sign * k * np.pi / 8: ("-" if sign < 0 else "") + words
        for sign in sides
        for k, words in enumerate(("π/8", "π/4", "3π/8", "π/2"), start=1)
    }
    axes.set_xticks(list(eighths), list(eighths.values()))
    axes.set_xlabel(f"{symbol('beta0', tex=True)} [rad]")
    degrees = axes.secondary_xaxis("top", functions=(np.rad2deg, np.deg2rad))
    degrees.set_xticks(range(round(np.rad2deg(low)), round(np.rad2deg(high)) + 1, 15))
    degrees.set_xlabel("degrees")


def regions(cube: xr.Dataset) -> Figure:
    """Where some start drifts, where every start rests, and which mode is most frequent elsewhere, as in the paper's Fig. 8.

    Parameters
    ----------
    cube : xarray.Dataset
        Of `search` or `refine` for drift, with two axes; the first one runs to the right.

    Returns
    -------
    matplotlib.figure.Figure
        Drift hatched with lines, rest with slashes, and their borders.

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"e": [0.5, 0.6], "Gamma": [0.6, 0.9, 1.2], "beta0": [0.2, 0.24, 0.28, 0.32]}
    >>> cube = search(grid, over="beta0", ask="first", periods=60, progress=False)
    >>> plots.regions(cube).savefig("regions.png")
    """
    judge_cube("regions", cube)
    mode = cube["mode"].squeeze()
    x_name, y_name = map(str, mode.dims)
    x, y = mode[x_name].values, mode[y_name].values
    figure, axes = framed(cube, (8, 5.6))
    region = names(cube["region"]).squeeze().values
    pale = 0.6 * COLORS + 0.4
    shown = np.where((region == "drift")[..., None], 1.0, pale[mode.values])
    axes.pcolormesh(edges_of(x), edges_of(y), shown.transpose(1, 0, 2))
    corners = [np.repeat(edges_of(values), 2)[1:-1] for values in (x, y)]
    handles = []
    for name, hatch, color, meaning in (
        ("drift", "|||", "#d62728", "$R_1$: some start drifts"),
        ("rest", "///", "#1f4fd8", "$R_2$: every start comes to rest"),
    ):
        inside = (region == name).T.astype(float)
        if inside.min() < inside.max():
            cells = np.repeat(np.repeat(inside, 2, axis=0), 2, axis=1)  # borders run along the cells that are drawn
            with rc_context({"hatch.color": color, "hatch.linewidth": 0.6}):
                axes.contourf(*corners, cells, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            axes.contour(*corners, cells, levels=[0.5], colors=color, linewidths=1.4)
        handles.append(face("white", meaning, edgecolor=color, hatch=hatch, linewidth=None))
    left = ~np.isin(region, ("drift", "rest"))
    for code in np.unique(mode.values[left]):
        handles.append(face(pale[code], f"mostly {MODES[code]}"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=9)
    axes.set(xlim=corners[0][[0, -1]], ylim=corners[1][[0, -1]])
    mark(axes.xaxis, x_name)
    mark(axes.yaxis, y_name)
    return figure
