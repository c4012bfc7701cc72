"""Draw the labelled sketch of the dimer: ``python docs/make_sketch.py`` writes docs/figures/dimer.svg and dimer.png."""

from math import atan2, cos, degrees, pi, sin
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Rectangle

from dimersweep.plots import DPI

FOLDER = Path(__file__).parent / "figures"
BALL_1, BALL_2, ROD, PLATE = "#c8473f", "#3b6fb6", "#c9c9c9", "#e9e4d8"
R, LENGTH, BETA, THETA = 0.5, 5.0, 0.42, 0.55  # drawn in units of a ball's diameter
HALF_ROD = 0.2


def arrow(
    ax: Axes, start: tuple[float, float], stop: tuple[float, float], style: str = "-|>", color: str = "k"
) -> None:
    """An arrow from one point to another."""
    ax.add_patch(
        FancyArrowPatch(start, stop, arrowstyle=style, color=color, mutation_scale=11, shrinkA=0, shrinkB=0, lw=1)
    )


def rod(ax: Axes, start: tuple[float, float], angle: float, length: float) -> None:
    """The rod between two ball centres."""
    corner = (start[0] + HALF_ROD * sin(angle), start[1] - HALF_ROD * cos(angle))
    ax.add_patch(Rectangle(corner, length, 2 * HALF_ROD, angle=degrees(angle), fc=ROD, ec="k", lw=0.8))


def side(ax: Axes) -> None:
    """Seen along the lateral direction: dip angle, gaps, the moving plate."""
    one = (0.0, R + 0.35)
    two = (one[0] + LENGTH * cos(BETA), one[1] + LENGTH * sin(BETA))
    ax.add_patch(Rectangle((-1.6, -0.45), 8.6, 0.45, fc=PLATE, ec="k", lw=0.8))
    rod(ax, one, BETA, LENGTH)
    for centre, color, name in ((one, BALL_1, "$B_1$"), (two, BALL_2, "$B_2$")):
        ax.add_patch(Circle(centre, R, fc=color, ec="k", lw=0.8))
        ax.text(*centre, name, ha="center", va="center", color="w")
    for k, (x, y) in ((1, one), (2, two)):
        ax.plot(x, y - R, "ko", ms=3.5)
        ax.text(x - 0.12, y - R - 0.02, f"$p_{k}$", ha="right", va="top" if k == 2 else "center")
        arrow(ax, (x + 0.25, 0.0), (x + 0.25, y - R), "<|-|>")
        ax.text(x + 0.37, 0.5 * (y - R), rf"$\delta_{k}$", va="center")
    ax.plot([one[0], one[0] + 2.6], [one[1], one[1]], "k:", lw=0.8)
    ax.add_patch(Arc(one, 3.2, 3.2, theta1=0, theta2=degrees(BETA), lw=1))
    ax.text(one[0] + 1.2, one[1] + 0.17, r"$\beta$")
    middle = (0.5 * (one[0] + two[0]), 0.5 * (one[1] + two[1]))
    ax.plot(*middle, "k+", ms=8)
    ax.text(middle[0] - 0.35, middle[1] - 0.66, "centre of mass")
    offset = (-1.0 * sin(BETA), 1.0 * cos(BETA))
    arrow(ax, (one[0] + offset[0], one[1] + offset[1]), (two[0] + offset[0], two[1] + offset[1]), "<|-|>")
    ax.text(middle[0] + 1.35 * offset[0], middle[1] + 1.35 * offset[1], "$l$", ha="center")
    spin = (one[0] + 0.72 * LENGTH * cos(BETA), one[1] + 0.72 * LENGTH * sin(BETA))
    ax.add_patch(Arc(spin, 0.35, 1.1, angle=degrees(BETA), theta1=-150, theta2=140, lw=1))
    ax.text(spin[0] + 0.25, spin[1] - 0.75, r"$\gamma$ (spin)")
    arrow(ax, (-1.2, -0.45), (-1.2, 0.75), "<|-|>")
    ax.text(-1.35, 0.85, r"$z_p(t)$", ha="center", va="bottom")
    arrow(ax, (6.6, 2.6), (6.6, 1.5))
    ax.text(6.75, 2.0, "$g$")
    ax.set_title("from the side", fontsize=10)
    ax.set_xlim(-2.0, 7.2)
    ax.set_ylim(-0.7, 4.1)


def top(ax: Axes) -> None:
    """Seen from above: precession angle, heading and lateral direction, velocity and zeta."""
    angle = pi / 2 + THETA  # the axis points along +Y at theta = 0
    axis = (cos(angle), sin(angle))
    one = (0.0, 0.0)
    length = LENGTH * cos(BETA)
    two = (length * axis[0], length * axis[1])
    rod(ax, one, angle, length)
    for centre, color, name in ((one, BALL_1, "$B_1$"), (two, BALL_2, "$B_2$")):
        ax.add_patch(Circle(centre, R, fc=color, ec="k", lw=0.8))
        ax.text(*centre, name, ha="center", va="center", color="w")
    arrow(ax, (2.6, -0.9), (3.7, -0.9))
    arrow(ax, (2.6, -0.9), (2.6, 0.2))
    ax.text(3.75, -0.9, "$X$", va="center")
    ax.text(2.6, 0.28, "$Y$", ha="center")
    ax.plot([0, 0], [0, 3.2], "k:", lw=0.8)
    ax.add_patch(Arc(one, 4.6, 4.6, theta1=90, theta2=degrees(angle), lw=1))
    ax.text(2.45 * cos(pi / 2 + 0.5 * THETA), 2.45 * sin(pi / 2 + 0.5 * THETA), r"$\theta$", ha="center")
    lateral = (axis[1], -axis[0])
    middle = (0.5 * two[0], 0.5 * two[1])
    far = (two[0] + 1.6 * axis[0], two[1] + 1.6 * axis[1])
    arrow(ax, (two[0] + 0.5 * axis[0], two[1] + 0.5 * axis[1]), far)
    ax.text(far[0] - 0.1, far[1] + 0.1, "heading $a$", ha="center", va="bottom")
    aside = (1.5 * lateral[0], 1.5 * lateral[1])
    arrow(ax, (0.5 * lateral[0], 0.5 * lateral[1]), aside)
    ax.text(aside[0] + 0.1, aside[1], "lateral $b$", va="center")
    turn = angle - 1.62
    velocity = (middle[0] + 2.3 * cos(turn), middle[1] + 2.3 * sin(turn))
    ax.plot(*middle, "k+", ms=8)
    arrow(ax, middle, velocity, color="black")
    ax.text(velocity[0] + 0.1, velocity[1], "velocity", color="black", va="center")
    ax.add_patch(Arc(middle, 1.7, 1.7, theta1=degrees(turn), theta2=degrees(atan2(axis[1], axis[0])), lw=1))
    half = 0.5 * (turn + angle)
    ax.text(middle[0] + 1.05 * cos(half), middle[1] + 1.05 * sin(half), r"$\zeta$", ha="center", va="center")
    ax.set_title("from above", fontsize=10)
    ax.set_xlim(-4.6, 4.4)
    ax.set_ylim(-1.5, 6.5)


def main() -> None:
    """Both views side by side."""
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1))
    for ax, draw in ((left, side), (right, top)):
        draw(ax)
        ax.set_aspect("equal")
        ax.axis("off")
    figure.savefig(FOLDER / "dimer.svg")
    figure.savefig(FOLDER / "dimer.png", dpi=DPI)


if __name__ == "__main__":
    main()
