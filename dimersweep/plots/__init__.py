"""Draw cubes and single runs as plain matplotlib figures, without a display."""

from typing import Any, Unpack

import xarray as xr
from matplotlib.figure import Figure

from dimersweep.cubes.findings import drift_intervals, drift_lengths
from dimersweep.errors import ParameterError
from dimersweep.extensions import CUBE_PICTURES, load
from dimersweep.plots.checking import check_cube
from dimersweep.plots.maps import mode_map, quantity_map
from dimersweep.plots.modes import bifurcation, regions, segments
from dimersweep.plots.orbits import impact_ends, least_period, paths, planar, shares, trends, walks
from dimersweep.plots.runs import (
    contact_legend,
    energy_budget,
    heights,
    impact_rates,
    last_cycle,
    orbit,
    portrait,
    run_figure,
)
from dimersweep.plots.style import DPI, MODE_COLORS, Look, check_picture, write_picture

__all__ = [
    "DPI",
    "FIGURES",
    "MODE_COLORS",
    "Look",
    "attractors",
    "bifurcation",
    "check_picture",
    "circles",
    "contact_legend",
    "draw",
    "drift_intervals",
    "drift_lengths",
    "energy_budget",
    "heights",
    "impact_ends",
    "impact_rates",
    "last_cycle",
    "least_period",
    "mode_map",
    "orbit",
    "paths",
    "planar",
    "portrait",
    "quantity_map",
    "regions",
    "run_figure",
    "segments",
    "shares",
    "trends",
    "walks",
    "write_picture",
]

FIGURES = {
    "segments": segments,
    "mode_map": mode_map,
    "regions": regions,
    "paths": paths,
    "walks": walks,
    "trends": trends,
    "minimum": least_period,
    "impact_ends": impact_ends,
    "shares": shares,
    "planar": planar,
    "bifurcation": bifurcation,
}


def __getattr__(name: str) -> Any:
    if name not in CUBE_PICTURES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return load(CUBE_PICTURES[name], name)


def draw(cube: xr.Dataset, kind: str | None = None, *, quantity: str | None = None, **look: Unpack[Look]) -> Figure:
    """Draw `cube` as a picture of a kind, or as a map of a quantity; `look` as in `Look`.

    By default the picture is of the kind that the cube was declared for, else a map of modes.

    Raises
    ------
    ParameterError
        If the cube cannot be drawn so.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> cube = sweep({"Gamma": [0.8, 0.9], "beta0": [0.2, 0.28, 0.36]}, periods=60, progress=False)
    >>> plots.draw(cube, quantity="radius").savefig("radius.png")
    """
    if quantity is not None:
        if kind not in (None, "mode_map"):
            raise ParameterError(f"quantity = {quantity!r}: goes with a map, not with kind = {kind!r}")
        return quantity_map(cube, quantity, **look)
    kind = kind or cube.attrs.get("plot", "mode_map")
    check_cube(kind, cube)
    drawn = FIGURES[kind] if kind in FIGURES else load(CUBE_PICTURES[kind], kind)
    return drawn(cube, **look)
