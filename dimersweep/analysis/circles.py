"""Draw the circles that attract dimers, and the times in which they do."""

from typing import Any, Unpack

import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dimersweep.cubes.findings import edges_of
from dimersweep.errors import ParameterError
from dimersweep.plots.checking import check_cube
from dimersweep.plots.style import MODE_COLORS, Look, fixed_of, framed, label, log_scale, mark

# width and height of a panel [pt]: points are drawn as cells of this size over their number, so that they fill it
PANEL = np.array([200.0, 228.0])
NO_CIRCLE = {"in a plane": "0.8", "no spin that attracts": "0.55"}  # greys of points without a circle


def circles(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the circle that attracts each dimer, and the time of the approach (to 1/2.718), over the axes of a cube.

    Grey points have no such circle: the walk ends in a plane, or no spin attracts.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube of a `sweep` with `sustained`, over a grid or points, in which one or two parameters vary.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ParameterError
        If the cube has no sustained spins, or more than two parameters vary.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> fixed = {"A_r": 5, "f": 22, "e": 0.65, "mu": 0.1, "mu_s": 0.15}
    >>> cube = sweep({"Gamma": [0.6, 0.9]}, fixed, periods=200, sustained=True, progress=False)
    >>> plots.circles(cube).savefig("circles.png")
    """
    check_cube("circles", cube)
    varied = fixed_of(cube)[1]
    names = [str(name) for name in (*cube["mode"].dims, *cube.coords) if name in varied]
    names = list(dict.fromkeys(names))[::-1]
    if not 1 <= len(names) <= 2:
        raise ParameterError(f"circles: {len(names)} parameters vary; draws 1 to 2 of them")
    at, *columns = (one.values.ravel() for one in xr.broadcast(cube["sustained_spin"], *(cube[name] for name in names)))
    board, panels = framed(look, cube, (9.0, 4.2 if len(names) == 2 else 3.2), ncols=2)
    edges = [edges_of(np.unique(column))[[0, -1]] for column in columns]
    has_circle = np.isfinite(cube["sustained_radius"].values.ravel())
    for axes, quantity in zip(panels, ("sustained_radius", "sustained_time"), strict=True):
        values = cube[quantity].values.ravel()
        text = label(quantity).removeprefix("sustained ")
        if len(names) == 1:
            axes.plot(columns[0][has_circle], values[has_circle], "o-", markersize=4, color=MODE_COLORS["drift"])
            axes.set_ylabel(text)
        else:
            cell = PANEL / [np.unique(column).size for column in columns]
            how: dict[str, Any] = {"s": cell.max() ** 2, "marker": cell * [(-1, -1), (1, -1), (1, 1), (-1, 1)]}
            # an attracting spin without a circle is that of a motion in a plane
            for chosen, color in zip((np.isfinite(at), np.isnan(at)), NO_CIRCLE.values(), strict=True):
                axes.scatter(*(column[chosen & ~has_circle] for column in columns), color=color, **how)
            norm = LogNorm() if quantity == "sustained_time" and np.isfinite(values[has_circle]).any() else None
            drawn = axes.scatter(*(column[has_circle] for column in columns), c=values[has_circle], norm=norm, **how)
            board.figure.colorbar(drawn, ax=axes, label=text)
            mark(axes.yaxis, names[1])
            axes.set(xlim=edges[0], ylim=edges[1])
        mark(axes.xaxis, names[0])
    if len(names) == 1:
        log_scale(panels[1])
    else:
        greys = [Line2D([], [], marker="s", linestyle="", color=color, label=text) for text, color in NO_CIRCLE.items()]
        board.legend("lower center", greys, ncols=2, fontsize="small")
    return board.done()
