"""Draw a fit."""

from typing import Unpack

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from dimersweep.analysis.fits.measured import MEASURABLE
from dimersweep.analysis.fits.valley import Valley
from dimersweep.plots.style import Look, board, ink, with_units
from dimersweep.symbols import PARAMETERS, symbol, units_shown

# standard deviations that are drawn, with their colours: opaque, as the parts of a valley overlap
DEVIATIONS = {2: "#c7dded", 1: "#9dc3de"}
CORNERS = 181  # corners of an ellipse, every 2 degrees
# factor on the variance along a valley: a part is uniform over a step, so its variance is step**2 / 12, and its ellipse
# then reaches the next point
OVERLAP = 12.0
TO_NEIGHBOUR = 8  # ellipses from a point of a valley to its neighbour: this close they have a smooth edge together
# distance within which points are neighbours, over that to the nearest one: it is 2 where parts of a valley meet
NEIGHBOURS = 2.5


def draw_fit(
    values: dict[str, float],
    covariance: np.ndarray,
    ranges: dict[str, tuple[float, float]],
    valley: Valley | None = None,
    **look: Unpack[Look],
) -> Figure:
    """Draw the regions of one and two standard deviations of each pair of free parameters; of a single one its density.

    With a valley each parameter has a panel with its density and its profile, too, and the axes are as long as the
    valley.

    Parameters
    ----------
    values : dict
        Fitted values of the free parameters.
    covariance : ndarray, shape (n, n)
        Covariance of the values.
    ranges : dict
        Least and greatest value of each free parameter.
    valley : Valley, optional
        Points that cover all values that give the data.
    **look
        Looks of the picture, see `dimersweep.plots.Look`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    names, centre = list(values), np.array(list(values.values()))
    ends = np.array(list(ranges.values()))
    parts: tuple[np.ndarray, ...] = (centre[None], np.zeros(1), covariance[None], np.zeros_like(covariance[None]))
    if valley is not None:
        parts = _finer(valley.values, valley.rises, valley.across, OVERLAP * valley.along)
        beyond = max(DEVIATIONS) * np.sqrt(np.diagonal(valley.across + valley.along, axis1=1, axis2=2))
        reach = [(valley.values - beyond).min(axis=0), (valley.values + beyond).max(axis=0)]
        ends = np.clip(np.transpose(reach), *ends.T[:, :, None])
    own = int(valley is not None or len(names) == 1)  # panels of each parameter alone
    n = len(names) - 1 + own
    place, panels = board(look, (1.2 + 3.0 * n, 0.8 + 2.6 * n), nrows=n, ncols=n, squeeze=False)
    for row, k in np.ndindex(n, n):
        axes: Axes = panels[row, k]
        axes.set_visible(k <= row)
        if k == (other := row + 1 - own):
            _draw_single(axes, k, float(centre[k]), float(covariance[k, k]), valley, ends[k])
        elif k <= row:
            _regions(axes, [k, other], *parts)
            axes.plot(*centre[[k, other]], "+", color=ink(), label="fit", clip_on=False)
            axes.set(ylim=ends[other], ylabel=_label(names[other]) if k == 0 else "")
        axes.set(xlim=ends[k], xlabel=_label(names[k]) if row == n - 1 else "")
        axes.tick_params(labelbottom=row == n - 1, labelleft=k in (0, other))
        axes.grid(alpha=0.3)
    shown = panels[-1, 0].get_legend_handles_labels()[0] if n >= own + 1 or not own else []
    place.legend("lower center", shown, fontsize="small", ncols=3)
    return place.done()


def _finer(centres: np.ndarray, *others: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the points of a valley, shape (p, n), and arrays over them, with points between neighbours added."""
    apart = np.linalg.norm((centres[:, None] - centres) / np.ptp(centres, axis=0), axis=2)
    nearest = np.partition(apart, 1, axis=1)[:, 1]
    a, b = np.nonzero(np.triu(apart <= NEIGHBOURS * np.maximum.outer(nearest, nearest), 1))
    shares = np.linspace(0, 1, TO_NEIGHBOUR, endpoint=False)[1:]

    def between(each: np.ndarray) -> np.ndarray:
        return np.concatenate([each, *((1 - share) * each[a] + share * each[b] for share in shares)])

    return tuple(map(between, (centres, *others)))


def _regions(
    axes: Axes, pair: list[int], centres: np.ndarray, rises: np.ndarray, across: np.ndarray, along: np.ndarray
) -> None:
    """Fill the regions of one and two standard deviations of the two parameters `pair`, by ellipses about points.

    `centres`, shape (p, n), are the points of a valley, or the fit alone, and `rises` their misfits above the least
    one. `across` and `along`, shape (p, n, n), are covariances (`Valley`). An ellipse is as wide across the valley as
    its misfit leaves, and as long along the valley as the way to the next points.
    """
    angle = np.linspace(0, 2 * np.pi, CORNERS)
    for times, shade in DEVIATIONS.items():
        left = times**2 - rises
        forms = (left[:, None, None] * across + along)[:, pair][:, :, pair]
        drawn = (left > 0) & np.isfinite(forms).all(axis=(1, 2))
        # a size is 0, but for rounding, if a parameter is known exactly
        sizes, directions = np.linalg.eigh(forms[drawn])
        roots = directions * np.sqrt(np.maximum(sizes, 0.0))[:, None]
        corners = centres[drawn][:, None, pair] + np.column_stack([np.cos(angle), np.sin(angle)]) @ roots.mT
        if drawn.any():  # in one piece: to add ellipses one by one takes longer than all else
            label = f"{times} standard deviation{'s' if times > 1 else ''}"
            ellipses = PolyCollection(corners, color=shade, lw=2 if len(centres) > 1 else 0, label=label)
            axes.add_collection(ellipses, autolim=False)


def _draw_single(axes: Axes, k: int, value: float, variance: float, valley: Valley | None, ends: np.ndarray) -> None:
    """Draw the density of one parameter, or its profile in a valley, with its error."""
    at = np.linspace(float(ends[0]), float(ends[1]), 401)
    if valley is not None:
        order = np.argsort(valley.values[:, k])
        axes.plot(valley.values[order, k], np.exp(-0.5 * valley.rises[order]), ".-")
        axes.set(ylim=(0, 1.1), ylabel="profile of the likelihood")
    else:
        axes.set_ylabel("probability density, over its greatest")
    if 0 < variance < np.inf:
        if valley is None:
            axes.plot(at, np.exp(-((at - value) ** 2) / (2 * variance)))
        for times in DEVIATIONS if valley is None else (1,):
            axes.axvspan(value - times * variance**0.5, value + times * variance**0.5, color="C0", alpha=0.2, lw=0)


def _label(name: str) -> str:
    """Return the label of an axis: the symbol of a parameter with its unit."""
    if name == "spin":
        return with_units(name, units_shown(MEASURABLE[name].units))
    return with_units(symbol(name, tex=True), units_shown(PARAMETERS[name].units))
