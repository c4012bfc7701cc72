"""Pictures of cubes and of single runs; plain matplotlib figures, drawn without a display."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from dimersweep.errors import ParameterError
from dimersweep.kernel.layout import M_DRIFT, MODES
from dimersweep.store import check_writable
from dimersweep.symbols import PARAMETERS

if TYPE_CHECKING:
    from dimersweep.run import Run

# after Okabe and Ito: told apart by color-blind readers too
MODE_COLORS = {
    "not_run": "#ffffff",
    "failed": "#000000",
    "rest": "#999999",
    "drift": "#0072b2",
    "jump": "#e69f00",
    "flutter": "#009e73",
    "period_n": "#cc79a7",
    "aperiodic": "#d55e00",
    "unresolved": "#f0e442",
}
ROW_COLORS = ("#1f4fd8", "#d62728", "#000000", "#009e73", "#cc79a7", "#e69f00")  # the paper's three first
_TEX = {
    "e": "e",
    "Gamma": r"\Gamma",
    "f": "f",
    "A_r": "A_r",
    "mu": r"\mu",
    "mu_s": r"\mu_s",
    "beta0": r"\beta(0)",
    "xdot0": r"\dot{x}_1(0)",
    "phi0": r"\phi_0",
    "r": "r",
    "rho_b": r"\rho_b",
    "rho_r": r"\rho_r",
    "D_r": "D_r",
    "g": "g",
    "e_1": "e_1",
    "e_2": "e_2",
}
PICTURES = (".png", ".pdf", ".svg")


def _units(name: str) -> str:
    return PARAMETERS[name].units.replace("m s-1", "m/s").replace("1", "")


def _given(name: str, value: float) -> str:
    """A parameter and its value, such as f = 15 Hz."""
    return f"${_TEX[name]}$ = {value:.4g} {_units(name)}".rstrip()


def label(name: str) -> str:
    """Axis label of a parameter: its symbol and unit."""
    units = _units(name)
    return f"${_TEX[name]}$" + (f" [{units}]" if units else "")


def _edges(values: np.ndarray, lowest: float = -np.inf, highest: float = np.inf) -> np.ndarray:
    """Edges of the cells that the points of an axis stand for, shape (n + 1,): half way to the neighbours."""
    if values.size == 1:
        return values[0] + np.array([-0.5, 0.5])
    inner = (values[1:] + values[:-1]) / 2
    first, last = 2 * values[0] - inner[0], 2 * values[-1] - inner[-1]
    return np.clip(np.concatenate([[first], inner, [last]]), lowest, highest)


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
    edges = _edges(drift["beta0"].values, 0.0, np.pi / 2)
    padded = np.pad(drift.values, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    return [edges[np.column_stack([np.flatnonzero(row == 1), np.flatnonzero(row == -1)])] for row in steps]


def drift_lengths(cube: xr.Dataset) -> xr.DataArray:
    """Total length of the drift intervals of each row of `cube` [rad], along its other axis."""
    rows = _drift_rows(cube).isel(beta0=0, drop=True)
    lengths = np.array([np.diff(intervals).sum() for intervals in drift_intervals(cube)])
    return rows.copy(data=lengths).rename("drift_length").assign_attrs(units="rad")


def _title(cube: xr.Dataset) -> str:
    """The fixed parameters of the paper's captions, in one line."""
    shown = [name for name in ("xdot0", "A_r", "e", "Gamma", "f", "mu", "mu_s", "beta0") if name in cube.coords]
    fixed = [name for name in shown if cube[name].ndim == 0]
    return ", ".join(_given(name, cube[name].item()) for name in fixed)


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
    axes.set_yticks(range(lengths.size), [_given(str(name), value) for value in lengths[name].values])
    axes.set_ylim(-0.6, lengths.size - 0.4)
    axes.grid(axis="x", alpha=0.3)
    _dip_axis(axes)
    axes.set_title(f"Initial dip angles that lead to drift\n{_title(cube)}", fontsize=10)
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
    y_edges = _edges(mode[y_name].values) if y_name else np.array([0.0, 1.0])
    colors = np.array([tuple(int(c[k : k + 2], 16) / 255 for k in (1, 3, 5)) for c in MODE_COLORS.values()])
    axes.pcolormesh(_edges(mode[x_name].values), y_edges, colors[np.atleast_2d(mode.values)])
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
    axes.set_title(_title(cube), fontsize=10)
    return figure


def _portrait(axes: Axes, states: xr.Dataset, angle: str, symbol: str) -> None:
    """One phase portrait: solid while no end is closed, dashed in contact."""
    closed = (states["gap_1"] <= 0) | (states["gap_2"] <= 0)
    for part, style in ((~closed, "-"), (closed, "--")):
        axes.plot(states[angle].where(part), states[f"{angle}_rate"].where(part), style, color="black", linewidth=1)
    axes.set_xlabel(f"${symbol}$ [rad]")
    axes.set_ylabel(f"$\\dot{{{symbol}}}$ [rad/s]")


def _heights(axes: Axes, states: xr.Dataset, f: float) -> None:
    """Plate, p1 and p2 against time in forcing periods."""
    cycles = states["time"].values * f
    plate = states["plate"]
    axes.plot(cycles, 1e3 * (plate + states["gap_2"]), color="black", linewidth=1, label="$p_2$")
    axes.plot(cycles, 1e3 * (plate + states["gap_1"]), color="#d62728", linewidth=2.5, label="$p_1$")
    axes.plot(cycles, 1e3 * plate, "--", color="#0072b2", linewidth=1, label="plate")
    axes.set_xlabel("time [forcing periods]")
    axes.set_ylabel("height [mm]")
    axes.legend(fontsize=8, loc="upper right", ncols=3)


def _orbit(axes: Axes, states: xr.Dataset) -> None:
    axes.plot(states["x"], states["y"], color="#d62728", linewidth=1)
    axes.plot(states["x"][:1], states["y"][:1], "o", color="black", markersize=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("$x$ [m]")
    axes.set_ylabel("$y$ [m]")
    axes.legend(handles=[Line2D([], [], marker="o", color="black", linestyle="", label="start")], fontsize=8)


def run_figure(run: "Run", periods: int = 4) -> Figure:
    """One run: normal displacements, orbit of the centre of mass, and the phase portraits of its last cycle.

    Parameters
    ----------
    run : Run
        Recorded.
    periods : int
        Forcing periods shown of the normal displacements, counted from the end.

    Returns
    -------
    matplotlib.figure.Figure
    """
    f = run.parameters["f"]
    end = run.n_periods / f

    def last(cycles: int) -> xr.Dataset:
        return run.states(np.linspace(max(0.0, end - cycles / f), end, 800 * cycles))

    figure = Figure(figsize=(11, 6.5), layout="constrained")
    panels = figure.subplot_mosaic([["heights", "heights", "orbit"], ["beta", "theta", "spin"]])
    _heights(panels["heights"], last(periods), f)
    _orbit(panels["orbit"], run.states(np.linspace(0.0, end, min(20 * run.n_periods, 20_000) + 1)))
    cycle = last(max(1, run.mode_period))
    for angle, symbol in (("beta", r"\beta"), ("theta", r"\theta"), ("spin", r"\gamma")):
        _portrait(panels[angle], cycle, angle, symbol)
    titles = ("normal displacements", "centre of mass", "dip (dashed: in contact)", "precession", "spin")
    for letter, title, axes in zip("abcde", titles, panels.values(), strict=True):
        axes.set_title(f"({letter}) {title}", loc="left", fontsize=10)
    shown = ("e", "Gamma", "f", "A_r", "mu", "mu_s", "beta0", "xdot0")
    words = ", ".join(_given(name, run.parameters[name]) for name in shown)
    figure.suptitle(f"{run.mode} after {run.n_periods} periods: {words}", fontsize=10)
    return figure


def check_picture(path: str | os.PathLike[str], *, force: bool = False, name: str = "out") -> Path:
    """Refuse a picture file that could not be written, before any work is done.

    Raises
    ------
    ParameterError
        If its ending is none of `PICTURES`.
    StoreError
        As for a cube.
    """
    if Path(path).suffix not in PICTURES:
        raise ParameterError(f"{name} = {path}: a picture must end in {', '.join(PICTURES)}")
    return check_writable(path, force=force, name=name)


KINDS = {"segments": segments, "mode_map": mode_map}


def draw(cube: xr.Dataset) -> Figure:
    """The figure that `cube` was declared for, a mode map if none was."""
    return KINDS[cube.attrs.get("plot", "mode_map")](cube)
