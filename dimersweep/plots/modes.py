"""Draw where the modes lie: intervals of the dip angle, regions of a search, and strobes over one axis."""

from collections.abc import Iterable
from typing import Any, Unpack

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dimersweep.cubes.cube import names
from dimersweep.cubes.findings import dip_range, drift_intervals, drift_lengths, edges_of, is_geometric
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import MODES
from dimersweep.plots.checking import check_cube
from dimersweep.plots.maps import colors_of
from dimersweep.plots.style import MODE_LABELS, Look, face, framed, ink, mark, mode_colors, parameter_shown, row_colors
from dimersweep.symbols import symbol

# rows of the picture, by quantity: label, and factor to the unit that is shown
STROBES = {
    "gap_1": ("gap of $p_1$ [mm]", 1e3),
    "gap_2": ("gap of $p_2$ [mm]", 1e3),
    "theta_rate": (r"$\dot\theta$ [rad/s]", 1.0),
}


def segments(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the initial dip angles that lead to drift (the paper's Fig. 7), in one row for each value of the other axis.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with the axis `beta0` and at most one more.

    Returns
    -------
    matplotlib.figure.Figure
        Intervals with their total length at the right end of each row.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> cube = sweep({"Gamma": [0.8, 0.9], "beta0": [0.2, 0.28, 0.36]}, periods=60, progress=False)
    >>> plots.segments(cube).savefig("intervals.png")
    """
    check_cube("segments", cube)
    lengths = drift_lengths(cube)
    (name,) = lengths.dims
    board, axes = framed(look, cube, (8, 1.4 + 0.55 * lengths.size), "Initial dip angles that lead to drift\n")
    rows = zip(drift_intervals(cube), lengths.values, row_colors(lengths.size), strict=True)
    for row, (intervals, length, color) in enumerate(rows):
        axes.hlines(np.full(len(intervals), row), intervals[:, 0], intervals[:, 1], colors=color, linewidth=7)
        axes.annotate(
            f"{length:.3f} rad",
            (1.01, row),
            xycoords=("axes fraction", "data"),
            va="center",
            color=color,
            fontsize="small",
        )
    if "confidence" in cube:  # only a certified sweep has it
        unsure = ~names(cube["confidence"]).isin(["certain", "not_run"]).transpose(name, "beta0")
        which, place = np.nonzero(unsure.values)
        (shown,) = axes.plot(
            cube["beta0"].values[place], which, "|", color=ink(), label="mode unsure, or another one near"
        )
        board.legend("lower center", [shown] if which.size else [], fontsize="small")
    axes.set_yticks(range(lengths.size), [parameter_shown(str(name), value) for value in lengths[name].values])
    axes.set_ylim(-0.6, lengths.size - 0.4)
    axes.grid(axis="x", alpha=0.3)
    _dip_axis(axes, *dip_range(cube["beta0"].values))
    return board.done()


def _dip_axis(axes: Axes, low: float, high: float) -> None:
    """Set the axis of the dip angle, up to a right angle on one side or on both: radians below, degrees above."""
    words = ("0", "π/8", "π/4", "3π/8", "π/2")
    eighths = range(round(8 * low / np.pi), round(8 * high / np.pi) + 1)
    axes.set_xticks([k * np.pi / 8 for k in eighths], ["-" * (k < 0) + words[abs(k)] for k in eighths])
    axes.set(xlim=(low, high), xlabel=f"{symbol('beta0', tex=True)} [rad]")
    degrees = axes.secondary_xaxis("top", functions=(np.rad2deg, np.deg2rad))
    degrees.set_xticks(range(round(np.rad2deg(low)), round(np.rad2deg(high)) + 1, 15))
    degrees.set_xlabel("degrees")


def regions(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the regions of a search, as in the paper's Fig. 8.

    In one some start drifts, in the other every start comes to rest; elsewhere the most frequent mode is shown.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `search` or `refine` for drift, with two axes; the first axis runs to the right.

    Returns
    -------
    matplotlib.figure.Figure
        Map with drift hatched with lines, rest with slashes, and their borders.

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"e": [0.5, 0.6], "Gamma": [0.6, 0.9, 1.2], "beta0": [0.2, 0.24, 0.28, 0.32]}
    >>> cube = search(grid, over="beta0", ask="first", periods=60, progress=False)
    >>> plots.regions(cube).savefig("regions.png")
    """
    check_cube("regions", cube)
    mode = cube["mode"].squeeze()
    x_name, y_name = map(str, mode.dims)
    x, y = mode[x_name].values, mode[y_name].values
    board, axes = framed(look, cube, (8, 5.6))
    region = names(cube["region"]).squeeze().values
    left, shown = ~np.isin(region, ("drift", "rest")), colors_of(mode.values)
    # paler under the hatching of rest, white under that of drift
    shown[region == "rest"] = 0.6 * shown[region == "rest"] + 0.4
    shown[region == "drift"] = 1.0
    axes.pcolormesh(edges_of(x), edges_of(y), shown.transpose(1, 0, 2))
    corners = [np.repeat(edges_of(values), 2)[1:-1] for values in (x, y)]
    handles = []
    for name, hatch, color, meaning in (
        ("drift", "|||", "#d62728", "$R_1$: some start drifts"),
        ("rest", "///", "#1f4fd8", "$R_2$: every start comes to rest"),
    ):
        inside = (region == name).T.astype(float)
        if inside.min() < inside.max():
            # each value at both edges of its cell, so that borders run along the cells that are drawn
            cells = np.repeat(np.repeat(inside, 2, axis=0), 2, axis=1)
            with rc_context({"hatch.color": color, "hatch.linewidth": 0.6}):
                axes.contourf(*corners, cells, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            axes.contour(*corners, cells, levels=[0.5], colors=color, linewidths=1.4)
        handles.append(face("white", meaning, edgecolor=color, hatch=hatch, linewidth=None))
    handles += [face(colors_of(code), f"mostly {MODES[code]}") for code in np.unique(mode.values[left])]
    board.legend("lower center", handles, ncols=4, fontsize="small")
    axes.set(xlim=corners[0][[0, -1]], ylim=corners[1][[0, -1]])
    mark(axes.xaxis, x_name)
    mark(axes.yaxis, y_name)
    return board.done()


def bifurcation(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the states at the starts of forcing periods over one axis.

    Each period is a point in the colour of the mode.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with strobes over one axis of more than one value, see `dimersweep.bifurcation`. If the state was carried
        up and down that axis, each direction has its panels.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> from dimersweep import bifurcation, plots
    >>> cube = bifurcation({"Gamma": [0.9, 1.2, 1.5]}, periods=60, strobes=8, progress=False)
    >>> plots.bifurcation(cube).savefig("diagram.png")
    """
    check_cube("bifurcation", cube)
    mode = cube["mode"].squeeze()
    axes = [str(dim) for dim in mode.dims if dim != "direction"]
    if len(axes) != 1:
        present = ", ".join(map(str, mode.dims))
        raise ParameterError(f"bifurcation: has axes {present}; needs one: select values of others")
    (name,) = axes
    directions = (
        [cube.isel(direction=k) for k in range(cube.sizes["direction"])] if "direction" in mode.dims else [cube]
    )
    size, shared = (2.6 + 3.8 * len(directions), 7.0), {"sharex": True, "sharey": "row", "squeeze": False}
    heading = "At the start of each forcing period\n"
    board, rows = framed(look, cube, size, heading, nrows=len(STROBES), ncols=len(directions), **shared)
    for panels, direction in zip(rows.T, directions, strict=True):
        _strobes(panels, direction, name)
        mark(panels[-1].xaxis, name)
        if "direction" in mode.dims:
            panels[0].set_title(parameter_shown("direction", direction["direction"].item()), fontsize="medium")
    for panel, (label, _) in zip(rows[:, 0], STROBES.values(), strict=True):
        panel.set_ylabel(label)
    dot: dict[str, Any] = {"marker": "o", "linestyle": ""}
    found = [MODES[code] for code in np.unique(mode.values)]
    handles = [Line2D([], [], color=mode_colors()[word], label=MODE_LABELS[word], **dot) for word in found]
    board.legend("lower center", handles, ncols=2 * len(directions))
    return board.done()


def _strobes(panels: Iterable[Axes], cube: xr.Dataset, name: str) -> None:
    """Draw the strobes over the axis `name`, one quantity in each panel."""
    mode = cube["mode"].squeeze()
    for axes, (quantity, (_, factor)) in zip(panels, STROBES.items(), strict=True):
        values = factor * cube[f"strobe_{quantity}"].squeeze().transpose(name, "strobe").values
        for code in np.unique(mode.values):
            here = mode.values == code
            places = np.repeat(mode[name].values[here], values.shape[1])
            axes.plot(places, values[here].ravel(), ".", color=colors_of(code), markersize=4, markeredgewidth=0)
        if is_geometric(mode[name].values):
            axes.set_xscale("log")
