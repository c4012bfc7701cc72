"""Bifurcation diagrams: the strobes of each point over one axis, coloured by mode."""

from collections.abc import Iterable

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dimersweep.cubes.reading import is_geometric
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import MODES
from dimersweep.plots.judging import judge_cube
from dimersweep.plots.style import MODE_COLORS, MODE_LABELS, framed, given, mark

SHOWN = {  # rows of the picture: what they are, and the factor to the unit that is shown
    "gap_1": ("gap of $p_1$ [mm]", 1e3),
    "gap_2": ("gap of $p_2$ [mm]", 1e3),
    "theta_rate": (r"$\dot\theta$ [rad/s]", 1.0),
}


def bifurcation(cube: xr.Dataset) -> Figure:
    """The states at the starts of forcing periods over one axis: a point for each period, in the colour of the mode.

    Parameters
    ----------
    cube : xarray.Dataset
        With strobes over one axis of more than one value, see `dimersweep.bifurcation`. Where the state was carried up and
        down that axis, each way has its panels.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> from dimersweep import bifurcation, plots
    >>> cube = bifurcation({"Gamma": [0.9, 1.2, 1.5]}, periods=60, strobes=8, progress=False)
    >>> plots.bifurcation(cube).savefig("diagram.png")
    """
    judge_cube("bifurcation", cube)
    mode = cube["mode"].squeeze()
    ways = [cube.isel(direction=k) for k in range(cube.sizes["direction"])] if "direction" in mode.dims else [cube]
    if mode.ndim != 1 + ("direction" in mode.dims):
        raise ParameterError(
            f"bifurcation: has axes {', '.join(map(str, mode.dims))}; needs one: select values of others"
        )
    name = str(next(dim for dim in mode.dims if dim != "direction"))
    size, shared = (2.6 + 3.8 * len(ways), 7.0), {"sharex": True, "sharey": "row", "squeeze": False}
    heading = "At the start of each forcing period\n"
    figure, rows = framed(cube, size, heading, nrows=len(SHOWN), ncols=len(ways), **shared)
    for panels, way in zip(rows.T, ways, strict=True):
        _draw(panels, way, name)
        mark(panels[-1].xaxis, name)
        if "direction" in mode.dims:
            panels[0].set_title(given("direction", way["direction"].item()), fontsize=10)
    for axes, (label, _) in zip(rows[:, 0], SHOWN.values(), strict=True):
        axes.set_ylabel(label)
    found = [MODES[code] for code in np.unique(mode.values)]
    handles = [
        Line2D([], [], color=MODE_COLORS[word], marker="o", linestyle="", label=MODE_LABELS[word]) for word in found
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))
    return figure


def _draw(panels: Iterable[Axes], cube: xr.Dataset, name: str) -> None:
    """Draw the strobes over the axis `name`, a quantity in each panel."""
    mode = cube["mode"].squeeze()
    for axes, (quantity, (_, factor)) in zip(panels, SHOWN.items(), strict=True):
        values = factor * cube[f"strobe_{quantity}"].squeeze().transpose(name, "strobe").values
        for code in np.unique(mode.values):
            here = mode.values == code
            places = np.repeat(mode[name].values[here], values.shape[1])
            color = MODE_COLORS[MODES[code]]
            axes.plot(places, values[here].ravel(), ".", color=color, markersize=4, markeredgewidth=0)
        if is_geometric(mode[name].values):
            axes.set_xscale("log")
