"""The figures of `imperfect.py`: the curvature of unlike balls, and the tilts at which a walk turns back."""

from collections.abc import Callable
from functools import partial
from math import pi, sqrt
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from walks import RADIUS, Response, border_of, first_climb, turned, turns_back

from dimersweep import simulate
from dimersweep.plots.style import ROW_COLORS


def draw_curvature(folder: Path, ratios: np.ndarray, found: np.ndarray, closed: np.ndarray) -> None:
    """Curvature over the ratio of the radii, and how far the closed form is off."""
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(ratios, found, color=ROW_COLORS[0], label="computed")
    left.plot(ratios, closed, ":", color="black", label="closed form")
    left.axhline(0, color="gray", linewidth=0.6)
    left.set(xlabel="$r_2/r_1$", ylabel="curvature of the path, $1/R$ [1/m]")
    top = left.secondary_xaxis("top", functions=(lambda q: 1e6 * RADIUS * (q - 1), lambda d: 1 + d / (1e6 * RADIUS)))
    top.set_xlabel("$r_2 - r_1$ [µm]")
    turns = left.secondary_yaxis("right")
    radii = (-3, -5, -10, 10, 5, 3, 2, 1.5, 1.25)  # [m], negative where it turns the other way
    turns.set_yticks([1 / R for R in radii], labels=[f"{abs(R):g}" for R in radii])
    turns.set_ylabel("$R$ [m]")
    left.legend()
    right.plot(ratios, 1e3 * (closed - found), color=ROW_COLORS[0])
    right.set(xlabel="$r_2/r_1$", ylabel="closed form less computed [1/km]")
    figure.savefig(folder / "imperfect_curvature.png", dpi=150)


def draw_critical(folder: Path, answer: Response, bend: float, speed: float) -> None:
    """Tracks around the first critical tilt, and the tilts at which the first three ways up turn back, over the start."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for color, slope in zip(ROW_COLORS, (0.0, 1e-3, 5e-3, 5.8e-3, 20e-3), strict=False):
        track = simulate(tilt=slope, periods=2400).section()
        left.plot(track["x"], track["y"], color=color, linewidth=0.9, label=f"{1e3 * slope:g} mrad")
    left.plot(0, 0, "o", color="black", markersize=4)
    left.set_aspect("equal", adjustable="datalim")
    left.set(xlabel="$x$, downhill [m]", ylabel="$y$ [m]", title="160 s of the base case")
    left.legend(fontsize=8)
    fine, coarse = np.linspace(-pi / 2, 3 * pi / 2, 49)[:-1], np.linspace(-pi / 2, pi, 4)
    for number, color in zip((1, 2, 3), ROW_COLORS, strict=False):
        slow = partial(turned, answer=answer, bend=bend, speed=speed)
        right.plot(np.degrees(fine), borders(slow, number, fine), color=color, linewidth=1, label=f"way up {number}")
        right.plot(np.degrees(coarse), borders(turns_back, number, coarse), "o", color=color, markersize=4)
    right.set(xlabel="azimuth of the slope [deg]; the walk starts along $x$", ylabel="tilt [mrad]", ylim=(0, 12))
    right.set_title("turns back (dots: runs; lines: in two variables)")
    right.legend(fontsize=8)
    figure.savefig(folder / "imperfect_tilt.png", dpi=150)


def borders(fails: Callable[..., bool], number: int, azimuths: np.ndarray) -> list[float]:
    """The tilts from which on a walk turns back on a way up, at each azimuth [mrad]."""
    climbs = [(number - 1 + first_climb(azimuth), azimuth) for azimuth in azimuths]
    found = [border_of(partial(fails, climb=climb, azimuth=azimuth), 2e-3, 0.05) for climb, azimuth in climbs]
    return [1e3 * sqrt(low * high) for low, high in found]
