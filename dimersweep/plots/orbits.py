"""Draw orbits over parameters: paths, trends with exponents, least periods, ends of impacts, planar drift, walks."""

from typing import Unpack

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from dimersweep.cubes.cube import names
from dimersweep.cubes.findings import circle_through, edges_of, exponents, minimum, runs_of, stick_ratio
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import DI_ENDS, M_DRIFT, M_NOT_RUN
from dimersweep.plots.checking import check_cube
from dimersweep.plots.style import Look, face, framed, ink, label, log_scale, mark, parameter_shown, row_colors, spread

# colours of the ends of a double impact
END_COLORS = {
    "none": "#ffffff",
    "sp_sp": "#0072b2",
    "sp_sk": "#e69f00",
    "sk_sp": "#dd99cc",
    "sk_sk": "#009e73",
}
LEFT_OUT_COLOR = "#505050"  # colour of points with mu_s below mu, which are not run
TRENDS = {"radius": r"$\bar R$ [m]", "period": r"$\bar T$ [s]", "zeta": r"$\zeta$ [rad]"}
CENTRES = {"centre_velocity_x": ("o", "along $x$"), "centre_velocity_y": ("s", "along $y$")}
CURVES = 5  # most values of the other axis of a trend that are drawn


def _drifting(cube: xr.Dataset, quantity: str) -> xr.DataArray:
    """Return a quantity of a cube where it drifts, NaN elsewhere."""
    return cube[quantity].where(cube["mode"] == M_DRIFT)


def paths(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw paths of the centre of mass with their circles' centres moved to one point, as in the paper's Fig. 13.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with paths over one axis.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"xdot0": [1.0, 1.5], "beta0": [0.2, 0.24, 0.28, 0.32]}
    >>> cube = search(grid, over="beta0", ask="first", periods=60, progress=False,
    ...               orbit_periods=60, paths={"periods": 60, "per_period": 4})
    >>> plots.paths(cube).savefig("paths.png")
    """
    check_cube("paths", cube)
    (name,) = (str(dim) for dim in cube["mode"].dims)
    per_period = round(1 / float(cube["cycle"][1] - cube["cycle"][0]))
    board, (whole, teeth) = framed(look, cube, (10, 5.2), "Paths of the centre of mass\n", ncols=2)
    curves = zip(cube[name].values, cube["x"].values, cube["y"].values, row_colors(cube.sizes[name]), strict=True)
    for value, x, y, color in curves:
        if not np.isfinite(x).all():
            continue
        a, b, radius = circle_through(x[x.size // 20 :], y[y.size // 20 :])
        text = f"{parameter_shown(name, value)}: $R$ = {radius:.3f} m"
        whole.plot(x - a, y - b, color=color, linewidth=0.8, label=text)
        piece = slice(-4 * per_period - 1, None)  # the last four periods
        cycles = cube["cycle"].values[piece] - cube["cycle"].values[piece][0]
        teeth.plot(cycles, 1e3 * (np.hypot(x - a, y - b)[piece] - radius), color=color, linewidth=1)
    whole.set(aspect="equal", adjustable="datalim", xlabel="$x$ [m]", ylabel="$y$ [m]")
    teeth.set(xlabel="time [forcing periods]", ylabel="distance from the circle [mm]")
    board.legend("lower center", whole.lines, ncols=min(len(whole.lines), 4), fontsize="small")
    return board.done()


def trends(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw radius, period and angle of the orbit over aspect ratio and frequency, as in the paper's Fig. 14 to 16.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with the axes `A_r` and `f`.

    Returns
    -------
    matplotlib.figure.Figure
        Curves with the exponents of R and T in A_r - 1 and f.

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"A_r": [5.5, 6, 6.5], "f": [15, 20], "beta0": [0.2, 0.24, 0.28, 0.32]}
    >>> cube = search(grid, over="beta0", ask="first", periods=60, progress=False)
    >>> plots.trends(cube).savefig("trends.png")
    """
    check_cube("trends", cube)
    board, panels = framed(look, cube, (9, 10), nrows=3, ncols=2, sharex="col", sharey="row")
    for row, quantity in zip(panels, TRENDS, strict=True):
        for axes, (name, other) in zip(row, (("A_r", "f"), ("f", "A_r")), strict=True):
            _trend(axes, cube, quantity, name, other)
        row[0].set_ylabel(TRENDS[quantity])
    for axes in panels[0]:
        axes.legend(
            fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1), borderaxespad=2.2, ncols=3, frameon=False
        )
    return board.done()


def _trend(axes: Axes, cube: xr.Dataset, quantity: str, name: str, other: str) -> None:
    """Draw a quantity over an axis, in one curve for some values of the other axis.

    A power law is stated in the title with its exponent, and drawn as a dashed line.
    """
    shift, base = (1.0, "A_r - 1") if name == "A_r" else (0.0, "f")
    x, values, chosen = cube[name].values - shift, _drifting(cube, quantity), spread(cube.sizes[other], CURVES)
    for color, k in zip(row_colors(chosen.size), chosen, strict=True):
        curve = values.isel({other: k}).transpose(name).values
        axes.plot(x, curve, "o-", color=color, markersize=3, label=parameter_shown(other, cube[other].values[k]))
    if quantity == "zeta":
        axes.axhline(np.pi / 2, color=ink(), linewidth=0.8, linestyle=":")
        axes.set_xlabel(f"${base}$" + (" [Hz]" if name == "f" else ""))
        return
    if not np.isfinite(values).any():
        axes.set_title("nothing drifts", fontsize="small")
        return
    log_scale(axes)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 2.5, 3, 4, 5, 6)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    try:
        law = exponents(cube, quantity)[name]
    except (KeyError, ParameterError):  # one value of this axis, or too few points that drift
        axes.set_title("no exponent: too few points drift", fontsize="small")
        return
    shown = f"({base})" if name == "A_r" else base
    text = f"${shown}^{{{law.exponent:.3f} \\pm {law.error:.3f}}}$, local {law.least:.2f} to {law.greatest:.2f}"
    axes.set_title(text, fontsize="small")
    level = 0.8 * np.nanmin(values.values)
    axes.plot(x, level * (x / x[0]) ** law.exponent, "--", color="#888888", linewidth=1)


def least_period(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw period and angle of the orbit over the initial velocity (the paper's Fig. 17), and mark the first minimum.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with the axes `A_r` and `xdot0`.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"A_r": [6], "xdot0": [1.0, 1.5, 2.0], "beta0": [0.2, 0.24, 0.28, 0.32]}
    >>> cube = search(grid, over="beta0", ask="first", periods=60, progress=False)
    >>> plots.least_period(cube).savefig("period.png")
    """
    check_cube("minimum", cube)
    board, (left, right) = framed(look, cube, (10, 4.4), ncols=2)
    speeds = cube["xdot0"].values
    for color, A_r in zip(row_colors(cube.sizes["A_r"]), cube["A_r"].values, strict=True):
        one = cube.sel(A_r=A_r)
        period, zeta = (_drifting(one, name).values for name in ("period", "zeta"))
        low = minimum(speeds, period)
        text = low.words("s", "m/s")
        name = parameter_shown("A_r", A_r) + ("" if low.located else f": {text}")
        left.plot(speeds, period, "o-", color=color, markersize=2.5, linewidth=1, label=name)
        right.plot(speeds, zeta, "o-", color=color, markersize=2.5, linewidth=1)
        if low.located:
            left.plot([low.at], [low.value], "v", color=color, markersize=8, label=text)
            right.axvline(low.at, color=color, linewidth=0.8, linestyle=":")
    log_scale(left)
    left.set(xlabel=label("xdot0"), ylabel=TRENDS["period"])
    board.legend("lower center", left.lines, fontsize="small", ncols=2)
    right.axhline(np.pi / 2, color=ink(), linewidth=0.8, linestyle=":")
    right.set(xlabel=label("xdot0"), ylabel=TRENDS["zeta"], ylim=(np.pi / 2 - 0.01, np.pi / 2 + 0.12))
    return board.done()


def impact_ends(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the ends of the double impacts of a drift over mu and mu_s, in one map for each aspect ratio.

    A dashed line shows mu = mubar (`stick_ratio`).

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with the axes `A_r`, `mu` and `mu_s`.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"A_r": [6], "mu": [0.1, 0.2], "mu_s": [0.3, 0.4], "beta0": [0.2, 0.24, 0.28, 0.32]}
    >>> cube = search(grid, over="beta0", ask="first", periods=60, progress=False)
    >>> plots.impact_ends(cube).savefig("ends.png")
    """
    check_cube("impact_ends", cube)
    body = {name: cube[name].item() for name in ("r", "rho_b", "rho_r", "D_r")}
    colors = ListedColormap([*END_COLORS.values(), LEFT_OUT_COLOR])
    x, y = edges_of(cube["mu"].values), edges_of(cube["mu_s"].values)
    shown = cube["di_end"].where(cube["mode"] != M_NOT_RUN, len(END_COLORS))
    heading = "How the double impact ends; dashed: $\\mu = \\bar\\mu$\n"
    n = cube.sizes["A_r"]
    board, panels = framed(look, cube, (3.1 * n + 0.6, 4.6), heading, ncols=n, sharey=True, squeeze=False)
    for axes, A_r in zip(panels[0], cube["A_r"].values, strict=True):
        ends = shown.sel(A_r=A_r).transpose("mu_s", "mu")
        axes.pcolormesh(x, y, ends.values, cmap=colors, vmin=-0.5, vmax=len(END_COLORS) + 0.5)
        line = stick_ratio(float(A_r), **body)
        axes.axvline(line, color=ink(), linestyle="--", linewidth=1)
        axes.set_title(f"{parameter_shown('A_r', A_r)}, $\\bar\\mu$ = {line:.3f}", fontsize="medium")
        axes.set(xlabel=label("mu"), ylabel=label("mu_s"))
        axes.label_outer()
    found = sorted(set(np.unique(names(cube["di_end"]))), key=DI_ENDS.index)
    handles = [face(END_COLORS[end], "no drift found" if end == "none" else end) for end in found]
    handles.append(face(LEFT_OUT_COLOR, "$\\mu_s < \\mu$: not run"))
    board.legend("lower center", handles, ncols=len(handles), fontsize="small")
    return board.done()


def shares(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the share of the searched values that lead to drift over one axis, in a curve for each value of the other.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of ``search(..., ask="fraction")`` over two axes; the last axis runs to the right.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"Gamma": [0.8, 0.9], "A_r": [5.5, 6], "beta0": [0.2, 0.24, 0.28, 0.32]}
    >>> cube = search(grid, over="beta0", ask="fraction", periods=60, progress=False)
    >>> plots.shares(cube).savefig("shares.png")
    """
    check_cube("shares", cube)
    other, name = (str(dim) for dim in cube["mode"].dims)
    board, axes = framed(look, cube, (7.5, 4.4))
    share = runs_of(cube, "drift") / cube["n_runs"]
    for color, value in zip(row_colors(cube.sizes[other]), cube[other].values, strict=True):
        axes.plot(
            cube[name],
            100 * share.sel({other: value}),
            "o-",
            color=color,
            markersize=3,
            label=parameter_shown(other, value),
        )
    mark(axes.xaxis, name)
    axes.set(ylabel="initial dip angles that drift [%]", ylim=(0, None))
    board.legend("right center", axes.lines, fontsize="small")
    return board.done()


def planar(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the velocity of drifts along the axis of the dimer over one parameter, in a colour for each impact end.

    The velocity is positive from the end that is down to the other end [mm/s].

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with paths over one axis.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"A_r": [5, 6], "beta0": [0.2, 0.24, 0.28, 0.32]}
    >>> cube = search(grid, over="beta0", ask="first", periods=60, progress=False,
    ...               orbit_periods=60, paths={"periods": 60, "per_period": 1})
    >>> plots.planar(cube).savefig("planar.png")
    """
    check_cube("planar", cube)
    (name,) = (str(dim) for dim in cube["mode"].dims)
    board, axes = framed(look, cube, (7.5, 4.4))
    ends, velocity = names(cube["di_end"]).values, 1e3 * cube["axial_velocity"].values
    for end, color in END_COLORS.items():
        here = (ends == end) & np.isfinite(velocity)
        if here.any():
            axes.plot(
                cube[name].values[here],
                velocity[here],
                "o",
                color=ink() if end == "none" else color,
                markersize=4,
                label=end,
            )
    board.legend("right center", [*axes.lines], title="double impact ends")
    axes.axhline(0.0, color=ink(), linewidth=0.8)
    axes.grid(alpha=0.3)
    mark(axes.xaxis, name)
    axes.set_ylabel("drift velocity [mm/s]")
    return board.done()


def walks(cube: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw tracks of the centre of mass from their starts, and beside them their drift or curvature.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube with paths over one axis.

    Returns
    -------
    matplotlib.figure.Figure
        Beside the tracks, on plates where the centres of the circles move: their velocities, and a word for each track
        without a whole turn. On other plates: the curvature 1/R of each path, positive where the heading decreases.

    Examples
    --------
    >>> from dimersweep import plots, search
    >>> grid = {"tilt": [0.0, 1e-3], "beta0": [0.28]}
    >>> cube = search(grid, over="beta0", ask="first", periods=700, progress=False,
    ...               orbit_periods=700, paths={"periods": 700, "per_period": 1})
    >>> plots.walks(cube).savefig("walks.png")
    """
    check_cube("walks", cube)
    (name,) = (str(dim) for dim in cube["mode"].dims)
    board, (left, right) = framed(look, cube, (11, 4.6), "Tracks of the centre of mass\n", ncols=2)
    words, colors = names(cube["track"]).values, row_colors(cube.sizes[name])
    for k, value in enumerate(cube[name].values):
        text = f"{parameter_shown(name, value)}: {words[k]}"
        left.plot(cube["x"].values[k], cube["y"].values[k], color=colors[k], linewidth=0.8, label=text)
    board.legend("right center", left.lines, fontsize="small")
    left.plot(0, 0, "o", color=ink(), markersize=3)
    left.set(aspect="equal", adjustable="datalim", xlabel="$x$ [m]", ylabel="$y$ [m]")
    if any(np.nanmax(np.abs(cube[which].values), initial=0.0) > 0 for which in CENTRES):
        _velocities(right, cube, name, words)
    else:
        right.plot(cube[name], -cube["precession_rate"] / cube["speed"], "o-", color=colors[0], markersize=4)
        right.set_ylabel("curvature $1/R$ [1/m]")
    right.axhline(0, color="gray", linewidth=0.6, zorder=0)
    mark(right.xaxis, name)
    right.locator_params(axis="x", nbins=5)
    return board.done()


def _velocities(axes: Axes, cube: xr.Dataset, name: str, words: np.ndarray) -> None:
    """Draw the velocities of the circles' centres over an axis; a track without a velocity is marked by its word."""
    for color, (which, (marker, text)) in zip(row_colors(2), CENTRES.items(), strict=True):
        axes.plot(cube[name], 1e3 * cube[which], f"{marker}-", color=color, markersize=4, linewidth=1, label=text)
    # words stand on the side of zero where the curve of x is not
    below = np.nansum(cube["centre_velocity_x"].values) < 0
    for value, velocity, word in zip(cube[name].values, cube["centre_velocity_x"].values, words, strict=True):
        if np.isnan(velocity):
            side = "top" if below else "bottom"
            axes.text(value, 0, f" {word} ", ha="center", va=side, rotation=90, fontsize="small", in_layout=False)
    reach = 0.03 * float(np.ptp(cube[name].values))
    axes.set_xlim(cube[name].values.min() - reach, cube[name].values.max() + reach)
    axes.set_ylabel("velocity of the circle's centre [mm/s]")
    axes.legend(fontsize="small", loc="best")
