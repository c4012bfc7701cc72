"""The picture of a fit."""

from typing import Any, Unpack

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dimersweep.fits.measured import MEASURABLE
from dimersweep.plots.style import Look, board, ink, with_units
from dimersweep.symbols import PARAMETERS, symbol, units_shown

DEVIATIONS = (2, 1)
CORNERS = 181  # of a drawn ellipse


def draw_fit(
    values: dict[str, float], covariance: np.ndarray, ranges: dict[str, tuple[float, float]], **look: Unpack[Look]
) -> Figure:
    """Regions of one and two standard deviations of each pair of free parameters; of one alone, its density.

    Parameters
    ----------
    values : dict
    covariance : ndarray, shape (n, n)
    ranges : dict
        Of the free parameters.
    **look : see `dimersweep.plots.Look`

    Returns
    -------
    matplotlib.figure.Figure
    """
    names = list(values)
    n = max(1, len(names) - 1)
    shared: Any = {"squeeze": False, "sharex": "col", "sharey": "row" if len(names) > 1 else "none"}
    place, panels = board(look, (1.2 + 3.0 * n, 0.8 + 2.6 * n), nrows=n, ncols=n, **shared)
    if len(names) == 1:
        _density(panels[0, 0], names[0], values[names[0]], float(covariance[0, 0]), ranges[names[0]])
        return place.done()
    for row, column in np.ndindex(n, n):
        axes: Axes = panels[row, column]
        axes.set_visible(column <= row)
        if column <= row:
            pair = [column, row + 1]
            _ellipses(axes, [names[k] for k in pair], values, covariance[np.ix_(pair, pair)], ranges)
    for k in range(n):
        panels[-1, k].set_xlabel(_label(names[k]))
        panels[k, 0].set_ylabel(_label(names[k + 1]))
    place.legend("lower center", panels[0, 0].get_legend_handles_labels()[0], fontsize=8, ncols=3)
    return place.done()


def _ellipses(
    axes: Axes,
    pair: list[str],
    values: dict[str, float],
    covariance: np.ndarray,
    ranges: dict[str, tuple[float, float]],
) -> None:
    angle = np.linspace(0, 2 * np.pi, CORNERS)
    centre = np.array([values[name] for name in pair])
    if np.isfinite(covariance).all():
        sizes, directions = np.linalg.eigh(covariance)  # one of a pair may be known exactly
        root = directions * np.sqrt(np.maximum(sizes, 0.0))
        for times in DEVIATIONS:
            x, y = centre[:, None] + times * root @ np.array([np.cos(angle), np.sin(angle)])
            axes.fill(x, y, color="C0", alpha=0.25, lw=0, label=f"{times} standard deviation{'s' if times > 1 else ''}")
    else:
        for k in (0, 1):
            error = float(np.sqrt(covariance[k, k]))
            for times in DEVIATIONS if np.isfinite(error) else ():
                draw = axes.axhspan if k else axes.axvspan
                draw(centre[k] - times * error, centre[k] + times * error, color="C0", alpha=0.25, lw=0)
    axes.plot(*centre, "+", color=ink(), label="fit", clip_on=False)
    axes.set(xlim=ranges[pair[0]], ylim=ranges[pair[1]])
    axes.grid(alpha=0.3)


def _density(axes: Axes, name: str, value: float, variance: float, ends: tuple[float, float]) -> None:
    at = np.linspace(*ends, 401)
    if 0 < variance < np.inf:
        axes.plot(at, np.exp(-((at - value) ** 2) / (2 * variance)))
        for times in DEVIATIONS:
            axes.axvspan(value - times * variance**0.5, value + times * variance**0.5, color="C0", alpha=0.2, lw=0)
    axes.set(xlim=ends, xlabel=_label(name), ylabel="probability density, over its greatest")
    axes.grid(alpha=0.3)


def _label(name: str) -> str:
    if name == "spin":
        return with_units(name, units_shown(MEASURABLE[name].units))
    return with_units(symbol(name, tex=True), units_shown(PARAMETERS[name].units))
