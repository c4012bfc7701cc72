"""Draw the shares of attractors: as bars at one set of parameters, as stacked areas over a parameter."""

from typing import Unpack

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from dimersweep.cubes.cube import names
from dimersweep.errors import ParameterError
from dimersweep.plots.style import Look, framed, ink, mark, mode_colors

MOST_NAMED = 18  # attractors that the legend has room for
ONE_LINE = 0.01  # distance within which borders of a kind are drawn as one line, over the length of the axis
ONE_LABEL = 0.03  # distance within which borders share a label, over the length of the axis
FLAT_LABELS = 3  # labels that have room side by side; more are written upright
# of all attractors of a mode but the first; after the last one twice as dense
HATCHES = ("//", "..", "xx", "\\\\", "oo")


def looks_of(data: xr.Dataset) -> list[tuple[str, str]]:
    """Return the colour of each attractor, by its mode, and the hatch that tells attractors of one mode apart."""
    modes, colors = modes_of(data), mode_colors()
    before = [modes[:k].count(mode) for k, mode in enumerate(modes)]
    return [
        (colors[mode or "not_run"], HATCHES[n % len(HATCHES) - 1] * -(-n // len(HATCHES)))
        for mode, n in zip(modes, before, strict=True)
    ]


def modes_of(data: xr.Dataset) -> list[str]:
    """Return the mode of each attractor, at the first value of the parameter where it is met."""
    modes = names(data[["mode"]])["mode"].values.reshape(-1, data.sizes["attractor"])  # flags; older files have words
    return [next((str(mode) for mode in column if mode not in ("", "not_run")), "") for column in modes.T]


def labels_of(data: xr.Dataset) -> list[str]:
    """Return a label for each attractor: its number, its mode, and its period."""
    periods = data["periods"].values.reshape(-1, data.sizes["attractor"]).max(axis=0)
    return [
        f"{number}: {mode.replace('period_n', 'other')}" + (f", period {n}" if n else "")
        for number, mode, n in zip(data["attractor"].values, modes_of(data), periods, strict=True)
    ]


def _borders(data: xr.Dataset, near: float) -> list[tuple[float, str]]:
    """Return the borders of the changes with their kinds; borders of one kind within `near` of each other count once."""
    kept: list[tuple[float, str]] = []
    if "border_kind" not in data:  # in a file, where nothing changes: a column without entries is not written
        return kept
    kinds = names(data[["border_kind"]])["border_kind"].values.tolist()
    for border, kind in sorted(zip(data["border"].values.tolist(), kinds, strict=True)):
        if np.isfinite(border) and not any(kind == other and border - at < near for at, other in kept):
            kept.append((border, kind))
    return kept


def _border_labels(borders: list[tuple[float, str]], near: float) -> list[tuple[float, str]]:
    """Return places and texts of labels, one for all borders within `near` of the first of them."""
    groups: list[tuple[float, dict[str, None]]] = []
    for border, kind in borders:
        if not groups or border - groups[-1][0] > near:
            groups.append((border, {}))
        groups[-1][1][kind] = None
    return [(at, ", ".join(kinds)) for at, kinds in groups]


def attractors(data: xr.Dataset, **look: Unpack[Look]) -> Figure:
    """Draw the shares of attractors with their intervals: bars, or stacked areas over a parameter.

    In a stack the bar at the upper edge of an area is the interval of its own share. A dashed line is a border of an
    orbit that appears or goes, with its kind. Borders that lie close together share a label.

    Parameters
    ----------
    data : xarray.Dataset
        Result of `dimersweep.attractors`.
    **look
        Looks of the picture, see `Look`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ParameterError
        If the data have no shares.

    Examples
    --------
    >>> from dimersweep import attractors, plots
    >>> found = attractors({"beta0": ("1 deg", "89 deg")}, starts=40, periods=200, progress=False)
    >>> plots.attractors(found).savefig("attractors.png")
    """
    if not isinstance(data, xr.Dataset) or "share_low" not in data:
        raise ParameterError(f"data: is a {type(data).__name__} without shares; give what attractors() returns")
    data = data.squeeze([dim for dim in data["share"].dims if dim != "attractor" and data.sizes[dim] == 1])
    axis = next((str(dim) for dim in data["share"].dims if dim != "attractor"), "")
    data = data.sortby(axis) if axis else data
    board, axes = framed(look, data.drop_dims("start"), (7.5, 4.4), f"Shares of {data.sizes['start']} starts\n")
    axes.set_ylabel("share of the starts [%]")
    below, above = (100 * abs(data[f"share_{end}"] - data["share"]).values for end in ("low", "high"))
    share, labels = 100 * data["share"].values, labels_of(data)
    colors, hatches = map(list, zip(*looks_of(data), strict=True))
    if not axis:
        (met,) = np.nonzero(share)
        places, errors = range(met.size), (below[met], above[met])
        bars = {"color": [colors[k] for k in met], "hatch": [hatches[k] for k in met], "ecolor": ink()}
        axes.bar(places, share[met], yerr=errors, capsize=3, **bars)
        axes.set_xticks(places, [labels[k] for k in met], rotation=30, ha="right", rotation_mode="anchor")
        return board.done()
    values, tops = data[axis].values, np.cumsum(share, axis=1)
    areas = axes.stackplot(values, share.T, colors=colors, labels=labels, hatch=hatches)
    width = values[-1] - values[0]
    near = ONE_LINE * width
    for k in range(share.shape[1]):
        here = share[:, k] > 0
        error = (below[here, k], above[here, k])
        # error bars of different areas are shifted, so that they do not hide each other
        shifted = values[here] + 0.6 * near * (k - 0.5 * (share.shape[1] - 1))
        axes.errorbar(shifted, tops[here, k], yerr=error, fmt="none", ecolor=ink(), elinewidth=0.9, capsize=2)
    borders = _borders(data, near)
    for border, _ in borders:
        axes.axvline(border, color=ink(), linestyle="--", linewidth=1)
    labelled = _border_labels(borders, ONE_LABEL * width)
    how = {"transform": axes.get_xaxis_transform(), "rotation": 90 if len(labelled) > FLAT_LABELS else 0}
    for at, kinds in labelled:
        axes.text(at, 1.01, kinds, ha="center", va="bottom", fontsize="small", **how)
    mark(axes.xaxis, axis)
    axes.set(xlim=(values[0] - 2 * near, values[-1] + 2 * near), ylim=(0, 100))
    hidden = len(labels) - MOST_NAMED
    more = {"title": f"and {hidden} more", "title_fontsize": "small"} if hidden > 0 else {}
    board.legend("right center", areas[:MOST_NAMED], fontsize="small", reverse=True, **more)
    return board.done(above=50 if how["rotation"] else 18)  # room for the labels [pt]
