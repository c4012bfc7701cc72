"""Pictures of cubes and of single runs; plain matplotlib figures, drawn without a display."""

import xarray as xr
from matplotlib.figure import Figure

from dimersweep.cubes.reading import drift_intervals, drift_lengths
from dimersweep.plots.modes import mode_map, regions, segments
from dimersweep.plots.orbits import impact_ends, least_period, paths, planar, shares, trends
from dimersweep.plots.runs import (
    contact_legend,
    heights,
    impact_rates,
    last_cycle,
    orbit,
    portrait,
    run_figure,
)
from dimersweep.plots.style import MODE_COLORS, check_picture, write_picture

__all__ = [
    "KINDS",
    "MODE_COLORS",
    "check_picture",
    "contact_legend",
    "draw",
    "drift_intervals",
    "drift_lengths",
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
    "regions",
    "run_figure",
    "segments",
    "shares",
    "trends",
    "write_picture",
]

KINDS = {
    "segments": segments,
    "mode_map": mode_map,
    "regions": regions,
    "paths": paths,
    "trends": trends,
    "minimum": least_period,
    "impact_ends": impact_ends,
    "shares": shares,
    "planar": planar,
}


def draw(cube: xr.Dataset) -> Figure:
    """The figure that `cube` was declared for, a mode map if none was."""
    return KINDS[cube.attrs.get("plot", "mode_map")](cube)
