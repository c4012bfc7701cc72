"""Pictures of cubes and of single runs; plain matplotlib figures, drawn without a display."""

import xarray as xr
from matplotlib.figure import Figure

from dimersweep.plots.modes import drift_intervals, drift_lengths, mode_map, segments
from dimersweep.plots.runs import (
    contact_legend,
    heights,
    impact_rates,
    last_cycle,
    orbit,
    portrait,
    run_figure,
)
from dimersweep.plots.style import MODE_COLORS, check_picture

__all__ = [
    "KINDS",
    "MODE_COLORS",
    "check_picture",
    "contact_legend",
    "draw",
    "drift_intervals",
    "drift_lengths",
    "heights",
    "impact_rates",
    "last_cycle",
    "mode_map",
    "orbit",
    "portrait",
    "run_figure",
    "segments",
]

KINDS = {"segments": segments, "mode_map": mode_map}


def draw(cube: xr.Dataset) -> Figure:
    """The figure that `cube` was declared for, a mode map if none was."""
    return KINDS[cube.attrs.get("plot", "mode_map")](cube)
