"""Draw maps over the axes of a cube, of modes in their colours or of any quantity; further axes make panels."""

from math import ceil
from typing import Any, Unpack

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dimersweep.cubes.findings import edges_of, is_geometric, over_axes
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import MODES
from dimersweep.plots.checking import check_cube
from dimersweep.plots.style import (
    DIRECTION_MARKERS,
    MODE_COLORS,
    MODE_LABELS,
    Board,
    Look,
    face,
    fixed_of,
    framed,
    label,
    mark,
    mode_colors,
    parameter_shown,
    percent,
    row_colors,
    spread,
    widened,
)

MOST_PANELS = 12


def colors_of(modes: np.ndarray) -> np.ndarray:
    """Return the colours of modes, which are given by their codes; shape (..., 3)."""
    return np.array([to_rgb(color) for color in mode_colors().values()])[modes]


def mode_map(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the mode of motion over one or two axes, in panels over further axes.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with axes of more than one value. The last axis runs to the right, the one before it upward.

    Returns
    -------
    matplotlib.figure.Figure
        Map with a legend of the modes that occur and their shares.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> cube = sweep({"Gamma": [0.8, 0.9], "beta0": [0.2, 0.28, 0.36]}, periods=60, progress=False)
    >>> plots.mode_map(cube).savefig("modes.png")
    """
    check_cube("mode_map", cube)
    return _map(cube, "mode", look)


def mode_handles(mode: xr.DataArray) -> list[Patch]:
    """Return the handles of a legend of the modes that occur, with their shares."""
    shares = np.bincount(mode.values.ravel(), minlength=len(MODES)) / mode.size
    return [
        face(mode_colors()[name], f"{MODE_LABELS[name]} ({percent(share)})")
        for name, share in zip(MODES, shares, strict=True)
        if share > 0
    ]


def quantity_map(cube: xr.Dataset, quantity: str, **look: Unpack[Look]) -> Figure:
    """Draw a quantity over the axes of a cube: curves over one axis, a map over two, in panels over further axes.

    Parameters
    ----------
    cube : xarray.Dataset
    quantity : str
        A variable of the cube such as radius; points where it has no meaning stay empty.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ParameterError
        If `quantity` is no variable over the axes of the cube.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> cube = sweep({"Gamma": [0.8, 0.9], "beta0": [0.2, 0.28, 0.36]}, periods=60, progress=False)
    >>> plots.quantity_map(cube, "zeta").savefig("zeta.png")
    """
    over_axes(cube, quantity)
    check_cube("mode_map", cube)
    return _map(cube, quantity, look)


def _map(cube: xr.Dataset, quantity: str, look: Look) -> Figure:
    """Draw a map of modes in their colours, or of a quantity of `cube`, in the way that its axes allow."""
    if "point" in cube["mode"].dims:
        return point_map(cube, quantity, look)
    values = cube[quantity].squeeze()
    if "direction" in values.dims:  # first, so that each direction has its panels
        values = values.transpose("direction", ...)
    if quantity != "mode" and values.dims[:-1] == ("direction",):
        return _curves_by_direction(cube, values, quantity, look)
    board, parts = _panels(cube, values, look)
    how = _shades(values.values)
    for axes, part in parts:
        if quantity == "mode":
            drawn = _mesh(axes, part, colors_of(np.atleast_2d(part.values)))
        elif part.ndim > 1:
            drawn = _mesh(axes, part, part.values, **how)
        else:
            axes.plot(part[part.dims[0]], part, "o-", markersize=3, linewidth=1, color=MODE_COLORS["drift"])
            axes.set_ylabel(label(quantity, own=values.attrs))
    if quantity == "mode" or values.ndim > 1:
        _explain(board, values, drawn, " (code)" if "flag_meanings" in cube[quantity].attrs else "")
    return board.done()


def _shades(values: np.ndarray) -> dict[str, Any]:
    """Return the settings of matplotlib for colours from the least finite value to the greatest."""
    finite = values[np.isfinite(values)]
    vmin, vmax = widened(finite.min(), finite.max()) if finite.size else (None, None)
    return {"cmap": "viridis", "vmin": vmin, "vmax": vmax}


def _explain(board: Board, values: xr.DataArray, drawn: Any, more: str = "") -> None:
    """Add a legend of the modes to a figure, or a colour bar of the quantity `values`.

    `more` is added to the label of the bar.
    """
    if values.name == "mode":
        board.legend("right center", mode_handles(values), fontsize="small")
    else:
        board.figure.colorbar(drawn, ax=board.axes, label=label(str(values.name), own=values.attrs) + more)


def _curves_by_direction(cube: xr.Dataset, values: xr.DataArray, quantity: str, look: Look) -> Figure:
    """Draw a quantity over one axis, once for each direction in which the state was carried.

    The curve going down is thinner and lies on top, so that both are seen where they are equal.
    """
    name = str(values.dims[-1])
    board, axes = framed(look, cube, (7.5, 3.2))
    for curve in values:
        k = int(curve["direction"])
        how = {
            "marker": DIRECTION_MARKERS[k],
            "markersize": (7, 4)[k],
            "linewidth": (3, 1)[k],
            "color": row_colors(2)[k],
        }
        axes.plot(curve[name], curve, label=parameter_shown("direction", k), **how)
    _scale(axes, values.isel(direction=0))
    mark(axes.xaxis, name)
    axes.set_ylabel(label(quantity, own=values.attrs))
    board.legend("right center", axes.lines, fontsize="small")
    return board.done()


def point_map(cube: xr.Dataset, quantity: str, look: Look) -> Figure:
    """Draw points that are no grid: a panel for each pair of varied parameters, coloured by mode or a quantity.

    Of more than `MOST_PANELS` pairs the first are drawn.
    """
    differing = fixed_of(cube)[1]
    varied = [str(name) for name in cube.coords if name in differing]
    pairs = [(varied[i], varied[j]) for j in range(len(varied)) for i in range(j)][:MOST_PANELS]
    if not varied:
        raise ParameterError("mode_map: all points have the same parameters; needs one that varies")
    pairs = pairs or [(varied[0], varied[0])]
    columns = min(3, len(pairs))
    rows = ceil(len(pairs) / columns)
    size = 1.6 + 3.4 * columns, 0.8 + 3.0 * rows
    board, panels = framed(look, cube, size, nrows=rows, ncols=columns, squeeze=False)
    values = cube[quantity]
    how = {"c": colors_of(values.values)} if quantity == "mode" else {"c": values.values} | _shades(values.values)
    for axes, (x, y) in zip(panels.flat, pairs, strict=False):
        dots = axes.scatter(cube[x], cube[y], s=9, **how)
        mark(axes.xaxis, x)
        mark(axes.yaxis, y)
    for axes in panels.flat[len(pairs) :]:
        axes.set_axis_off()
    _explain(board, values, dots)
    return board.done()


def _panels(cube: xr.Dataset, values: xr.DataArray, look: Look) -> tuple[Board, list[tuple[Axes, xr.DataArray]]]:
    """Return a board with a panel for each combination of the leading axes of `values`, and the values in each panel.

    Of more than `MOST_PANELS` combinations some are drawn, evenly spread.
    """
    leading = [str(name) for name in values.dims[:-2]]
    places = list(np.ndindex(*(values.sizes[name] for name in leading)))
    heading = f"{MOST_PANELS} of {len(places)} maps; " if len(places) > MOST_PANELS else ""
    places = [places[k] for k in spread(len(places), MOST_PANELS)]
    columns = len(places) if len(places) <= 3 else min(4, ceil(len(places) ** 0.5))
    rows = ceil(len(places) / columns)
    size = (7.5, 2.6 if values.ndim == 1 else 4.8) if len(places) == 1 else (1.8 + 2.9 * columns, 1.0 + 2.5 * rows)
    board, grid = framed(look, cube, size, heading, nrows=rows, ncols=columns, sharex=True, sharey=True, squeeze=False)
    _scale(grid[0, 0], values)  # all panels share the axes of the first
    for axes in grid.flat[len(places) :]:
        axes.set_axis_off()
    parts = [values.isel(dict(zip(leading, place, strict=True))) for place in places]
    for number, (axes, part) in enumerate(zip(grid.flat, parts, strict=False)):
        axes.set_title(", ".join(parameter_shown(name, part[name].item()) for name in leading), fontsize="small")
        if number >= len(places) - columns:
            mark(axes.xaxis, str(part.dims[-1]))
            axes.tick_params(labelbottom=True)
        if part.ndim == 2 and axes.get_subplotspec().is_first_col():
            mark(axes.yaxis, str(part.dims[0]))
    return board, list(zip(grid.flat, parts, strict=False))


def _mesh(axes: Axes, part: xr.DataArray, colors: np.ndarray, **how: Any) -> Any:
    """Draw the cells around the points of a panel, each in its colour."""
    x = part[part.dims[-1]].values
    y_edges = edges_of(part[part.dims[0]].values) if part.ndim == 2 else np.array([0.0, 1.0])
    mesh = axes.pcolormesh(edges_of(x), y_edges, colors, **how)
    if part.ndim == 1:
        axes.set_yticks([])
    return mesh


def _scale(axes: Axes, values: xr.DataArray) -> None:
    """Make an axis logarithmic if its values are in a fixed ratio: x for the last dimension, y for the one before."""
    if is_geometric(values[values.dims[-1]].values):
        axes.set_xscale("log")
    if values.ndim > 1 and is_geometric(values[values.dims[-2]].values):
        axes.set_yscale("log")
