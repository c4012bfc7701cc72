"""Pictures of modes over axes: intervals of the dip angle, maps of modes and regions."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dimersweep.errors import ParameterError
from dimersweep.kernel.layout import M_DRIFT, MODES
from dimersweep.plots.style import MODE_COLORS, ROW_COLORS, edges_of, given, label, title


def _plain(cube: xr.Dataset, most: int, kind: str) -> xr.DataArray:
    """The modes of `cube` without the axes of one value, of at most `most` dimensions."""
    mode = cube["mode"].squeeze()
    if not 1 <= mode.ndim <= most:
        raise ParameterError(f"{kind}: has axes {', '.join(map(str, mode.dims)) or 'none'}; draws 1 to {most} of them")
    return mode


def _drift_rows(cube: xr.Dataset) -> xr.DataArray:
    """Where `cube` drifts, shape (rows, beta0)."""
    mode = _plain(cube, 2, "segments")
    if "beta0" not in mode.dims:
        raise ParameterError(f"segments: has axes {', '.join(map(str, mode.dims))}; needs beta0 among them")
    rows = mode if mode.ndim == 2 else mode.expand_dims("f")
    return (rows == M_DRIFT).transpose(..., "beta0")


def drift_intervals(cube: xr.Dataset) -> list[np.ndarray]:
    """Intervals of the initial dip angle that lead to drift, for each row of `cube`.

    Parameters
    ----------
    cube : xarray.Dataset
        With the axis `beta0` and at most one more; each point stands for the angles half way to its neighbours.

    Returns
    -------
    list of ndarray, shape (n_intervals, 2)
        Start and end of each interval [rad].
    """
    drift = _drift_rows(cube)
    edges = edges_of(drift["beta0"].values, 0.0, np.pi / 2)
    padded = np.pad(drift.values, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    return [edges[np.column_stack([np.flatnonzero(row == 1), np.flatnonzero(row == -1)])] for row in steps]


def drift_lengths(cube: xr.Dataset) -> xr.DataArray:
    """Total length of the drift intervals of each row of `cube` [rad], along its other axis."""
    rows = _drift_rows(cube).isel(beta0=0, drop=True)
    lengths = np.array([np.diff(intervals).sum() for intervals in drift_intervals(cube)])
    return rows.copy(data=lengths).rename("drift_length").assign_attrs(units="rad")


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
    """
    lengths = drift_lengths(cube)
    (name,) = lengths.dims
    figure = Figure(figsize=(8, 1.4 + 0.55 * lengths.size), layout="constrained")
    axes = figure.add_subplot()
    for row, (intervals, length) in enumerate(zip(drift_intervals(cube), lengths.values, strict=True)):
        color = ROW_COLORS[row % len(ROW_COLORS)]
        axes.hlines(np.full(len(intervals), row), intervals[:, 0], intervals[:, 1], colors=color, linewidth=7)
        axes.annotate(
            f"{length:.3f} rad", (1.01, row), xycoords=("axes fraction", "data"), va="center", color=color, fontsize=9
        )
    axes.set_yticks(range(lengths.size), [given(str(name), value) for value in lengths[name].values])
    axes.set_ylim(-0.6, lengths.size - 0.4)
    axes.grid(axis="x", alpha=0.3)
    _dip_axis(axes)
    axes.set_title(f"Initial dip angles that lead to drift\n{title(cube)}", fontsize=10)
    return figure


def _dip_axis(axes: Axes) -> None:
    """The dip angle from 0 to pi/2 in radians below, in degrees above."""
    axes.set_xlim(0, np.pi / 2)
    axes.set_xticks(np.pi / 16 * np.arange(0, 9, 2), ["0", "π/8", "π/4", "3π/8", "π/2"])
    axes.set_xlabel(label("beta0"))
    degrees = axes.secondary_xaxis("top", functions=(np.rad2deg, np.deg2rad))
    degrees.set_xticks(range(0, 91, 15))
    degrees.set_xlabel("degrees")


def mode_map(cube: xr.Dataset) -> Figure:
    """The mode of motion over one or two axes.

    Parameters
    ----------
    cube : xarray.Dataset
        With one or two axes of more than one value; the last one runs to the right.

    Returns
    -------
    matplotlib.figure.Figure
        With a legend of the modes that occur and their shares.
    """
    mode = _plain(cube, 2, "mode_map")
    x_name, y_name = str(mode.dims[-1]), str(mode.dims[0]) if mode.ndim == 2 else ""
    figure = Figure(figsize=(7.5, 4.8 if y_name else 2.2), layout="constrained")
    axes = figure.add_subplot()
    y_edges = edges_of(mode[y_name].values) if y_name else np.array([0.0, 1.0])
    colors = np.array([tuple(int(c[k : k + 2], 16) / 255 for k in (1, 3, 5)) for c in MODE_COLORS.values()])
    axes.pcolormesh(edges_of(mode[x_name].values), y_edges, colors[np.atleast_2d(mode.values)])
    axes.set_xlabel(label(x_name))
    if y_name:
        axes.set_ylabel(label(y_name))
    else:
        axes.set_yticks([])
    shares = np.bincount(mode.values.ravel(), minlength=len(MODES)) / mode.size
    handles = [
        Patch(facecolor=MODE_COLORS[name], edgecolor="black", linewidth=0.5, label=f"{name} ({100 * share:.1f} %)")
        for name, share in zip(MODES, shares, strict=True)
        if share > 0
    ]
    figure.legend(handles=handles, loc="outside right upper", fontsize=9)
    axes.set_title(title(cube), fontsize=10)
    return figure
