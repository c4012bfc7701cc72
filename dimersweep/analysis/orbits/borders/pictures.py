"""Pictures of borders, branches and families of orbits."""

import json
from collections.abc import Collection, Sequence
from typing import Any, Unpack

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.interpolate import PchipInterpolator

from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS, STABLE_FROM, STABLE_TO
from dimersweep.cubes.cube import names
from dimersweep.cubes.findings import edges_of
from dimersweep.errors import ParameterError
from dimersweep.plots.style import MODE_COLORS, Board, Look, board, fixed_of, ink, log_scale, mark, parameter_shown
from dimersweep.symbols import BASE, PARAMETERS, conditions

# line styles of the lines of one border, in the order of the values of the other axes
STYLES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
REGION_COLOR, STABLE_COLOR = MODE_COLORS["drift"], MODE_COLORS["flutter"]
# opacity of the region of drift of a map under curves, and of the stretch over which an orbit is stable
REGION_SHADE, STABLE_SHADE = 0.22, 0.15
PALE = 0.35  # opacity of curves of orbits that are unstable on both sides
SMOOTH = 12  # parts into which a drawn branch is divided between two of its points
MARKERS = {kind.name: kind.marker for kind in BORDER_KINDS.values()}
SPIN_LABEL = "axial spin [rad/s]"
PANELS = {"radius": "radius [m]", "period": "period [s]", "zeta": r"$\zeta$ [rad]"}


def draw_borders(table: xr.Dataset, over: xr.Dataset | None = None, **look: Unpack[Look]) -> Figure:
    """Draw a dataset of borders.

    Parameters
    ----------
    table : xarray.Dataset
        Curves, branches or families: of a file of borders, or from `border`, `border_curve`, `follow`, `family`.
    over : xarray.Dataset, optional
        Map of regions, which is drawn under the curves. It must have the axes of the curves.
    **look : see `dimersweep.plots.Look`

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ParameterError
        If the dataset has no borders, or the map has other axes than the curves.
    """
    # in files of former versions these two are words already, which `names` leaves alone
    told = names(table[[name for name in ("kind", "special") if name in table.variables]])
    table = table.assign({name: told[name].variable for name in ("kind", "special") if name in told.variables})
    if "kind" in table.attrs:
        table = table.expand_dims("border").assign_coords(kind=("border", [table.attrs["kind"]]))
    if "kind" in table.variables and "parameter" in table.attrs:
        return curves(table, over, look)
    if over is not None:
        raise ParameterError("over: only curves are drawn over a map")
    if "special" in table:
        return branches(table, look)
    if "spin" in table.dims:
        return families(table, look)
    raise ParameterError("the dataset has neither curves nor branches nor families of orbits")


def curves(table: xr.Dataset, over: xr.Dataset | None, look: Look) -> Figure:
    """Draw borders along the last axis, one line style for each value of the other axes.

    The closed forms of the ball are thin lines. The stretch between both ends of stability is shaded. Bifurcations of
    orbits that are unstable on both sides are pale.
    """
    table = table.swap_dims(border="kind")
    y = table.attrs["parameter"]
    *others, x = [str(dim) for dim in table[y].dims if dim != "kind"]
    x = table.attrs.get("other", x)
    place, axes = _framed(look, table, (8, 6), [x, y])
    handles: list[Any] = [] if over is None else [_map_under(axes, over, x, y)]
    flat = table.stack(line=others) if others else table.expand_dims("line")
    ends = [STABLE_FROM.name, STABLE_TO.name]
    if set(ends) <= set(table["kind"].values):
        handles.append(_stable_shaded(axes, flat, x, y))
        flat = flat.drop_sel(kind=ends)
    lines = [(flat.isel(line=k), STYLES[k % len(STYLES)]) for k in range(flat.sizes["line"])]
    closed: list[Line2D] = []
    for kind in flat["kind"].values.tolist():
        color = BORDER_KINDS[kind].color
        for line, style in lines:
            row, how = line.sel(kind=kind), {"color": color, "linestyle": style, "linewidth": 1.4}
            taken = row[y]
            if BORDER_KINDS[kind].rows:  # a bifurcation: pale where no stable orbit loses its stability
                axes.plot(row[x], row[y], **how, alpha=PALE)
                taken = row[y].where(row["loses_stability"] == 1)
            axes.plot(row[x], taken, **how)
        ball = lines[0][0].sel(kind=kind)["ball"] if "ball" in flat else np.array(np.nan)
        if np.isfinite(ball).any():
            closed = axes.plot(ball[x], ball, color=ink(), linewidth=0.7, label="ball, closed form")
        if np.isfinite(flat.sel(kind=kind)[y]).any():
            handles.append(Line2D([], [], color=color, label=kind))
    for line, style in lines if others else ():
        words = ", ".join(parameter_shown(name, float(line[name])) for name in others)
        handles.append(Line2D([], [], color="gray", linestyle=style, label=words))
    handles += closed
    mark(axes.xaxis, x)
    mark(axes.yaxis, y)
    place.legend("lower center", handles, fontsize="small", ncols=4)
    return place.done()


def _stable_shaded(axes: Axes, flat: xr.Dataset, x: str, y: str) -> Patch:
    """Shade the stretch over which an orbit is stable, on each line, and return the legend's handle of the shade."""
    low, high = (flat.sel(kind=kind.name)[y] for kind in (STABLE_FROM, STABLE_TO))
    alpha = STABLE_SHADE / flat.sizes["line"] ** 0.5  # shades of several lines lie upon one another
    for k in range(flat.sizes["line"]):
        axes.fill_between(flat[x], low.isel(line=k), high.isel(line=k), color=STABLE_COLOR, alpha=alpha, linewidth=0)
    return Patch(facecolor=STABLE_COLOR, alpha=alpha, label="a stable orbit, which runs come to")


def _framed(
    look: Look, table: xr.Dataset, size: tuple[float, float], along: Collection[str] = (), **panels: Any
) -> tuple[Board, Any]:
    """Return a board and its panels; the heading has the title of a table and the parameters that its orbits share.

    An orbit has no start: the heading leaves out `beta0` and `xdot0`.
    """
    declared = json.loads(table.attrs.get("configuration", "{}"))
    # several tables put together have the configuration of the first one: the values in the table itself go before
    held, varied = fixed_of(table)
    values = (BASE | declared["fixed"] if declared else table.attrs) | held
    heading = conditions(values, {*declared.get("over", ()), *varied, *along, "beta0", "xdot0"}, tex=True)
    spin = declared.get(table.attrs.get("what"), {}).get("spin", table.attrs.get("spin"))
    heading += f", axial spin = {spin:.4g} rad/s" if isinstance(spin, float) else ""
    return board(look, size, f"{declared.get('borders', {}).get('title', '')}\n{heading}".lstrip(), **panels)


def _map_under(axes: Axes, over: xr.Dataset, x: str, y: str) -> Patch:
    """Draw the region of drift of a map and return its handle for the legend; refuse a map with other axes."""
    region = over["region"] if "region" in over else over["mode"]
    if set(region.dims) != {x, y}:
        raise ParameterError(f"over: the map has the axes {', '.join(map(str, region.dims))}; must have {x} and {y}")
    shown = np.where(names(region).transpose(y, x) == "drift", 1.0, np.nan)
    cells = edges_of(over[x].values), edges_of(over[y].values)
    axes.pcolormesh(*cells, shown, cmap=ListedColormap([REGION_COLOR]), alpha=REGION_SHADE, rasterized=True)
    return Patch(facecolor=REGION_COLOR, alpha=REGION_SHADE, label="drift, in the map")


def branches(table: xr.Dataset, look: Look) -> Figure:
    """Draw radius, period and zeta along branches: stable orbits solid, unstable ones dashed, special points marked."""
    x = str(table.attrs["parameter"])
    place, panels = _framed(look, table, (8, 8), [x], nrows=3, sharex=True)
    groups = [name for name in table.variables if name in PARAMETERS and name != x and table[name].dims == ("point",)]
    colors: dict[Any, str] = {}
    branch = table["branch"].values if "branch" in table else np.zeros(table.sizes["point"])
    for number in np.unique(branch):
        one = table.isel(point=branch == number)
        key = tuple(float(one[name][0]) for name in groups)
        color = colors.setdefault(key, f"C{len(colors)}")
        for axes, name in zip(panels, PANELS, strict=True):
            _one_branch(axes, one, x, name, color)
    _label_panels(panels)
    drawn = {line.get_linestyle() for line in panels[0].lines}
    styles: dict[Any, str] = {"-": "stable", "--": "unstable"}
    handles = [Line2D([], [], color="gray", linestyle=style, label=styles[style]) for style in styles if style in drawn]
    kinds = [kind for kind in MARKERS if (table["special"].values == kind).any()]
    handles += [Line2D([], [], color=ink(), linestyle="", marker=MARKERS[kind], label=kind) for kind in kinds]
    for key, color in colors.items() if groups else ():
        words = ", ".join(parameter_shown(str(name), value) for name, value in zip(groups, key, strict=True))
        handles.append(Line2D([], [], color=color, label=words))
    place.legend("lower center", handles, fontsize="small", ncols=4)
    if x in PARAMETERS:
        mark(panels[-1].xaxis, x)
    else:
        panels[-1].set_xlabel(SPIN_LABEL)
    return place.done()


def _label_panels(panels: Sequence[Axes]) -> None:
    """Label the first panels with the quantities of `PANELS`, and draw a grid in all panels."""
    for axes, label in zip(panels, PANELS.values(), strict=False):
        axes.set_ylabel(label)
    for axes in panels:
        axes.grid(alpha=0.3)


def _one_branch(axes: Axes, one: xr.Dataset, x: str, name: str, color: str) -> None:
    """Draw one quantity along one branch, with markers at its special points."""
    places, values, stable = one[x].values, one[name].values, one["stable"].values.astype(bool)
    at, line, drawn = _smoothed(places, values)
    # a special point belongs to both sides of a border: a stretch beside it is as stable as its other end
    bound = np.isin(one["special"].values, list(MARKERS))
    ends = np.stack([np.where(bound[:-1], stable[1:], stable[:-1]), np.where(bound[1:], stable[:-1], stable[1:])])
    solid = np.logical_and(*ends)
    for part in np.split(np.arange(solid.size), np.flatnonzero(np.diff(solid)) + 1) if solid.size else ():
        here = (part[0] <= at) & (at <= part[-1] + 1)
        axes.plot(line[here], drawn[here], color=color, linestyle="-" if solid[part[0]] else "--", lw=1.3)
    for kind, marker in MARKERS.items():
        at = one["special"].values == kind
        axes.plot(one[x].values[at], values[at], linestyle="", marker=marker, color=ink(), markersize=5)


def _smoothed(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Interpolate a smooth curve through points, whose coordinates have extrema at these points only.

    Return the places on it, as fractions of the number of a point, and the two coordinates there.
    """
    steps = np.hypot(np.diff(x) / (np.ptp(x) or 1.0), np.diff(y) / (np.ptp(y) or 1.0))
    # two points at the same place are set apart by 1e-9 of the picture: the interpolation needs ascending lengths
    length = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-9))])
    if x.size < 3 or not np.isfinite(length[-1]):
        return np.arange(x.size), x, y
    at = np.linspace(0, x.size - 1, (x.size - 1) * SMOOTH + 1)
    along = np.interp(at, np.arange(x.size), length)
    return at, PchipInterpolator(length, x)(along), PchipInterpolator(length, y)(along)


def families(table: xr.Dataset, look: Look) -> Figure:
    """Draw radius, period, zeta and relative loss of spin of orbits over the spin, with the least period marked."""
    place, panels = _framed(look, table, (9, 7), nrows=2, ncols=2, sharex=True)
    panels = panels.ravel()
    table = table if "over" in table.dims else table.expand_dims("over")
    given_by = [str(name) for name, each in table.coords.items() if name in PARAMETERS and each.ndim]
    spin = table["spin"].values
    for k in range(table.sizes["over"]):
        row = table.isel(over=k)
        words = ", ".join(parameter_shown(name, float(row[name])) for name in given_by)
        for axes, name in zip(panels, PANELS, strict=False):
            axes.plot(spin, row[name], color=f"C{k}", label=words)
        known = np.flatnonzero(np.isfinite(row["period"].values))
        least = known[np.argmin(row["period"].values[known])] if known.size else 0
        if known.size and known[0] < least < known[-1]:
            panels[1].plot(spin[least], row["period"][least], "o", color=f"C{k}")
        panels[3].plot(spin, np.abs(row["spin_drift"]) / spin, color=f"C{k}")
    _label_panels(panels)
    log_scale(panels[1])
    log_scale(panels[3])
    panels[2].set_xlabel(SPIN_LABEL)
    panels[3].set(xlabel=SPIN_LABEL, ylabel="share of the spin lost in a period")
    place.legend("lower center", panels[0].lines if given_by else [], fontsize="small", ncols=4)
    return place.done()
