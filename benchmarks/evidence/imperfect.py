"""What unlike balls and other plates do to the walk: ``python benchmarks/evidence/imperfect.py``, some minutes.

It writes `imperfect.md` beside it, which `docs/imperfect.md` takes its numbers from, and the figures imperfect_*.png of
that page. ``--only NAME ...`` prints some of the parts and writes nothing: curvature, tolerances, tilt, critical, sideways,
paper. ``--oracle TILT`` asks the slow program in tests/oracle what one tilt does to the walk of the base case, in half
an hour.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import atan, cos, degrees, log, pi, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
from imperfect_figures import draw_critical, draw_curvature
from scipy.optimize import brentq
from walks import (
    RADIUS,
    STOPPED,
    ask_oracle,
    border_of,
    caught,
    closed_curvature,
    comes_to_rest,
    curvature_of,
    curvatures,
    first_climb,
    largest_step,
    locked,
    memory,
    ratio_of,
    response,
    rolled,
    scan,
    turned,
    turns_back,
)

from dimersweep import Run, orbits, simulate, sweep
from dimersweep.parameters import Parameters, dimer_from

LISTING = Path(__file__).with_suffix(".md")
FIGURES = Path(__file__).resolve().parents[2] / "docs" / "figures"
INTENSITIES = (0.82, 0.9, 1.1)  # of the plate, within R_1
RATIOS = np.linspace(0.97, 1.03, 61)  # of the radii, r_2/r_1
STARTS = {
    "downhill": 0.0,
    "at its lowest place": pi / 2,
    "uphill": pi,
    "at its highest place": -pi / 2,
}  # azimuth [rad]
STEEP = np.geomspace(0.13, 0.22, 106)  # tilts half a per cent apart [rad]
STEPPING = (0.05, 0.08, 0.09, 0.1, 0.12)  # Gamma_x
PAPER_RADIUS = 2.4  # at A_r = 5, 15 Hz [m]
GRID = [(float(A_r), float(f)) for A_r in np.linspace(5, 7, 5) for f in np.linspace(15, 35, 5)]
SMALL_TILT, SMALL_SHAKING = 2e-4, 1e-3  # at which a response is linear [rad], [1]


# --- the parts of the listing -----------------------------------------------------------------------------------------
def table(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> Iterator[str]:
    """Lines of a table in Markdown."""
    yield "| " + " | ".join(heads) + " |"
    yield "|" + "---|" * len(heads)
    for row in rows:
        yield "| " + " | ".join(map(str, row)) + " |"
    yield ""


def curvature(figures: Path | None) -> Iterator[str]:
    """Balls of unlike radius: the curvature, computed and in closed form; where the walk is straight."""
    rows = []
    for Gamma in INTENSITIES:
        found, closed = curvatures(RATIOS, Gamma=Gamma)
        level = curvature_of(orbits.find(Gamma=Gamma))
        off, span = np.abs(closed - found).max(), np.ptp(found)
        straight = np.interp(0.0, found, RATIOS)
        length = dimer_from(Parameters().given()).l
        rows.append(
            [
                f"{Gamma:g}",
                f"{1 / level:.3f}",
                f"{1 / found[0]:.3f}",
                f"{1 / found[-1]:.3f}",
                f"{off:.1e}",
                f"{off / span:.2%}",
                f"{straight:.5f}",
                f"{1 - length * level:.5f}",
            ]
        )
        if Gamma == Parameters().Gamma and figures is not None:
            draw_curvature(figures, RATIOS, found, closed)
    yield "### Radius\n"
    yield from table(
        [
            "Gamma",
            "R [m], alike",
            "r_2/r_1 = 0.97",
            "1.03",
            "closed form off by, at most [1/m]",
            "of the range",
            "straight at r_2/r_1",
            "closed form 1 - l/R",
        ],
        rows,
    )


class Change(NamedTuple):
    """A parameter of one end, or of the plate, whose effect is asked for."""

    name: str
    value: float  # of the base case
    least: float
    greatest: float  # that are tried
    step: float  # of a difference, in the value; where that is zero, by itself
    besides: dict[str, float]


CHANGES = (
    Change("r_2", RADIUS, 0.5 * RADIUS, 1.5 * RADIUS, 1e-3, {"r_1": RADIUS}),
    Change("rho_b_2", 7850.0, 785.0, 23550.0, 0.01, {}),
    Change("e_1", 0.6, 0.0, 0.99, 0.01, {}),
    Change("e_2", 0.6, 0.3, 0.99, 0.01, {}),
    Change("mu_1", 0.2, 0.01, 0.4, 0.01, {}),
    Change("mu_2", 0.2, 0.01, 0.4, 0.01, {}),
    Change("k_ratio", 1.0, 0.1, 10.0, 0.01, {}),
    Change("Gamma_2", 0.0, 0.0, 0.5, 1e-3, {"phi_2": 0.0}),
    Change("Gamma_2", 0.0, 0.0, 0.5, 1e-3, {"phi_2": pi / 2}),
)


def answer(change: Change, Gamma: float) -> tuple[float, float]:
    """Relative change of R, and change of zeta [rad], per relative change of a parameter (of Gamma_2: per its value)."""
    low, high = (change.value * (1 + side * change.step) + (change.value == 0) * side * change.step for side in (-1, 1))
    if change.value == 0:
        low = 0.0
    made = [orbit_of(change, Gamma, value) for value in (low, high)]
    apart = (high - low) / (change.value or 1.0)
    return log(made[1].radius / made[0].radius) / apart, (made[1].zeta - made[0].zeta) / apart


def orbit_of(change: Change, Gamma: float, value: float) -> orbits.PeriodicOrbit:
    """The orbit at a value of the parameter, at the spin of a start of alike balls."""
    return orbits.find(spin=rolled({}), Gamma=Gamma, **{change.name: value}, **change.besides)


def bounds(change: Change, Gamma: float) -> list[str]:
    """How far the parameter may go until the drift of alike balls is unstable, and by what; or how far it was followed."""
    begin = orbit_of(change, Gamma, change.value)
    told = []
    for far in (change.least, change.greatest):
        if far == change.value:
            told.append("")
            continue
        branch = orbits.follow(begin, change.name, to=far)
        lost = np.flatnonzero(np.isin(branch["special"].values, ("fold", "flip", "torus")))
        at = float(branch[change.name].values[lost[0] if lost.size else -1])
        word = str(branch["special"].values[lost[0]]) if lost.size else "and on"
        told.append(f"{at:.3g} ({word})")
    return told


def allowed(change: Change, share: float) -> str:
    """What changes R by 1 %, from the relative change of R per that of the parameter."""
    most = abs(0.01 / share)
    if most > 1:
        return "any"
    if change.name == "r_2":
        return f"{1e6 * RADIUS * most:.2f} um"
    return f"{most:.4f}" if change.value == 0 else f"{most:.1%}"


def tolerances(figures: Path | None) -> Iterator[str]:
    """What differences of the ends, and a second harmonic, do to radius, direction and the drift itself."""
    rows = []
    for change in CHANGES:
        shown = f"`{change.name}`" + (
            f", phi_2 = {degrees(change.besides['phi_2']):g} deg" if change.value == 0 else ""
        )
        for Gamma in INTENSITIES:
            share, zeta_moved = answer(change, Gamma)
            rows.append([shown, f"{Gamma:g}", f"{share:+.2g}", allowed(change, share), f"{10 * zeta_moved:+.2f}"])
            rows[-1] += bounds(change, Gamma)
    yield "### One end\n"
    heads = ["parameter", "Gamma", "d ln R/d ln X", "for 1 % of R", "zeta per 1 % [mrad]", "drift from", "to"]
    yield from table(heads, rows)
    least = [(pi - Gamma) / (pi + Gamma) for Gamma in INTENSITIES]
    words = ", ".join(f"{e:.4f} at {Gamma:g}" for e, Gamma in zip(least, INTENSITIES, strict=True))
    yield f"The least e of a ball that bounces once a period, (pi - Gamma)/(pi + Gamma): {words}.\n"


def walk_of(Gamma: float = 0.9, **plate: float) -> Run:
    """A run of some turns on a plate, recorded."""
    return simulate(Gamma=Gamma, periods=2400, **plate)


def tilt(figures: Path | None) -> Iterator[str]:
    """The velocity of the circle's centre on a tilted plate, across R_1, beside the closed form."""
    rows = []
    for Gamma in INTENSITIES:
        run = walk_of(Gamma, tilt=SMALL_TILT)
        given, g = run.parameters, run.parameters["g"]
        orbit = orbits.find(Gamma=Gamma)
        answer = response(given)
        closed = -0.5 * orbit.radius * answer.turn * g
        one = 0.01 * 2 / (answer.turn * g * orbit.period)
        lives = orbit.speed**2 / (answer.gain * answer.turn * orbit.radius * (g * 1e-3) ** 2)
        rows.append(
            [
                f"{Gamma:g}",
                f"{run.centre_velocity_x / SMALL_TILT:.2f}",
                f"{closed:.2f}",
                f"{degrees(np.arctan2(run.centre_velocity_y, -run.centre_velocity_x)):+.1f}",
                f"{1000.0 * one:.3f}",
                f"{lives:.0f}",
            ]
        )
    yield "### Tilt\n"
    yield from table(
        [
            "Gamma",
            "velocity of the centre downhill, per tilt [m/s]",
            "closed form -(R/2) g turn",
            "off uphill [deg]",
            "tilt at which it moves by 1 % of R in a turn [mrad]",
            "life of the walk at 1 mrad [s]",
        ],
        rows,
    )


def critical(figures: Path | None) -> Iterator[str]:
    """The tilts at which the walk stops closing, at which it comes to rest, and at which it is lost."""
    spin, g = rolled({}), Parameters().g
    orbit, answer = orbits.find(), response(Parameters().given())
    bend, speed = curvature_of(orbit), RADIUS * spin
    yield "### Critical tilts of the base case\n"
    rows = []
    for start, azimuth in STARTS.items():
        for climb in range(first_climb(azimuth), first_climb(azimuth) + 3):
            fails = partial(turns_back, climb=climb, azimuth=azimuth)
            low, high = border_of(fails, 2e-3, 0.05)
            slow = partial(turned, climb=climb, azimuth=azimuth, answer=answer, bend=bend, speed=speed)
            closed = sqrt(np.prod(border_of(slow, 1e-3, 0.1)))
            number = climb + 1 - first_climb(azimuth)
            rows.append([start, number, *sides(fails, low, high), f"{1e3 * closed:.3f}"])
    yield "The walk turns back on its way up:\n"
    yield from table(
        ["the walk starts", "way up", "tilt [mrad]", "same at rtol 1e-10", "in two variables [mrad]"], rows
    )
    rows = []
    for periods in (2400, 6000):
        for start, azimuth in STARTS.items():
            fails = partial(comes_to_rest, periods=periods, azimuth=azimuth)
            low, high = border_of(fails, 1e-3, 0.05)
            time = periods / Parameters().f
            closed = 2 * log(1 / STOPPED) / (answer.turn * g * time)
            rows.append([f"{time:g} s", start, *sides(fails, low, high), f"{1e3 * closed:.2f}"])
    yield f"The walk is slower than {STOPPED:.0%} of its first speed from then on:\n"
    yield from table(
        ["after", "the walk starts", "tilt [mrad]", "same at rtol 1e-10", "2 ln 100/(turn g t) [mrad]"], rows
    )
    rows = []
    begun: dict[str, dict[str, float]] = {"walking " + start: {"azimuth": azimuth} for start, azimuth in STARTS.items()}
    begun["at rest, p2 downhill"] = {"azimuth": pi / 2, "xdot0": 0.0}
    for start, how in begun.items():
        (held, gone), again = (scan(caught(STEEP, rtol=rtol, **how), STEEP) for rtol in (1e-8, 1e-10))
        rows.append([start, *(f"{1e3 * tilt:.1f}" for tilt in (held, gone, *again))])
    yield "It comes to rest in a drift, or goes off downhill:\n"
    heads = [
        "start",
        "drifts at all tilts up to [mrad]",
        "at none from [mrad]",
        "the first at rtol 1e-10",
        "the second",
    ]
    yield from table(heads, rows)
    yield f"The angle of friction, arctan mu, is {1e3 * atan(Parameters().mu):.1f} mrad.\n"
    if figures is not None:
        draw_critical(figures, answer, bend, speed)


def sides(fails: Callable[..., bool], low: float, high: float) -> tuple[str, str]:
    """The border as printed, and whether the two sides are as they are with a hundredth of the error, too."""
    again = [fails(tilt, rtol=1e-10) for tilt in (low, high)]
    return f"{1e3 * sqrt(low * high):.3f} ± {500 * (high - low):.3f}", "yes" if again == [False, True] else "no"


def sideways(figures: Path | None) -> Iterator[str]:
    """The velocity of the circle's centre on a plate that moves sideways; where the heading locks."""
    rows = []
    phases = np.linspace(0, 2 * pi, 9)[:-1]
    for Gamma in INTENSITIES:
        plate = {"Gamma": Gamma, "Gamma_x": SMALL_SHAKING}
        cube = sweep({"phi_x": phases}, fixed=plate, periods=1400, progress=False)
        found = cube["centre_velocity_x"].values / SMALL_SHAKING
        wave = 2 * np.mean(found * np.exp(-1j * phases))
        orbit, answer = orbits.find(Gamma=Gamma), response(Parameters().given())
        given = orbit.parameters
        shaking = answer.swing * given["g"] / (2 * pi * given["f"])
        closed = -0.5 * orbit.radius * shaking
        allowed = 0.01 * orbit.radius / (abs(wave) * orbit.period)
        none = 90 - 360 * orbit.impact_phase
        phase = degrees(np.angle(-wave))
        lock = curvature_of(orbit) * orbit.speed / (shaking * cos(2 * pi * orbit.impact_phase))
        rows.append(
            [
                f"{Gamma:g}",
                f"{abs(wave):.3f}",
                f"{-closed:.3f}",
                f"{90 - phase:.1f}",
                f"{none:.1f}",
                f"{10000.0 * allowed:.2f}e-4",
                f"{lock:.3f}",
            ]
        )
    yield "### Sideways shaking\n"
    yield from table(
        [
            "Gamma",
            "velocity of the centre per Gamma_x, at the worst phase [m/s]",
            "closed form",
            "phi_x of none [deg]",
            "closed form 90 - phase of the impact [deg]",
            "Gamma_x at which it moves by 1 % of R in a turn",
            "Gamma_x at which the heading locks, closed form (phi_x = 0)",
        ],
        rows,
    )
    low, high = border_of(locked, 0.15, 0.25)
    same = [locked(value, rtol=1e-10) for value in (low, high)] == [False, True]
    yield f"The heading of the base case locks at Gamma_x = {low:.4f} to {high:.4f}"
    yield f"({'the same' if same else 'not the same'} at rtol 1e-10).\n"
    steps = {Gamma_x: largest_step(Gamma_x) for Gamma_x in STEPPING}
    words = ", ".join(f"{step:.2%} at {Gamma_x:g}" for Gamma_x, step in steps.items())
    yield f"The dip angle at the starts of the periods changes from one to the next by at most: {words}."
    apart = memory(STEPPING[-1], 2 * pi * np.arange(0.44, 0.57, 0.01))
    yield f"Two states, before the step and after it, begun at one heading, differ after 24 periods by at most {apart:.2%}.\n"


def paper(figures: Path | None) -> Iterator[str]:
    """Statements of the paper that differ here: what difference of the balls' radii would make them so."""
    yield "### The paper's statements\n"
    short = orbits.find(A_r=5.0)
    need = ratio_of(1 / PAPER_RADIUS, curvature_of(short), A_r=5.0)
    made = orbits.find(A_r=5.0, r_1=RADIUS, r_2=RADIUS * need, spin=rolled({"A_r": 5.0}))
    apart = 1e6 * RADIUS * (need - 1)
    yield f"R = {PAPER_RADIUS} m at A_r = 5, f = 15 Hz, not {short.radius:.3f} m: r_2 - r_1 = {apart:+.1f} um,"
    yield f"with which R = {made.radius:.3f} m.\n"
    alike = [orbits.find(A_r=A_r, f=f) for A_r, f in GRID]
    squared = brentq(lambda apart: exponents_of(alike, apart)[1] - 2, 0.0, 3e-6)
    by_aspect, _ = exponents_of(alike, squared)
    yield f"R as f^2: r_2 - r_1 = {1e6 * squared:+.2f} um, with which R is as (A_r - 1)^{by_aspect:.2f}.\n"
    rows = []
    for apart in (-1e-5, -1e-6, 0.0, 1e-6, 2e-6, 5e-6, 1e-5):  # [m]
        bent = bent_by(alike, apart)
        if (bent > 0).all():
            shown = [f"{power:.2f}" for power in exponents_of(alike, apart)]
        else:
            shown = ["turns the other way", f"at {(bent <= 0).sum()} of {bent.size}"]
        rows.append([f"{1e6 * apart:+g}", *shown, f"{1 / bent[0]:.3f}", f"{1 / bent[-1]:.1f}"])
    heads = ["r_2 - r_1 [um]", "R as (A_r - 1) to the power", "as f to the power", "R at A_r = 5, 15 Hz [m]"]
    yield from table([*heads, "R at A_r = 7, 35 Hz [m]"], rows)
    changed = sum(
        orbits.find(A_r=A_r, f=f, r_1=RADIUS, r_2=RADIUS + apart, spin=one.spin).di_end != one.di_end
        for one, (A_r, f) in zip(alike, GRID, strict=True)
        for apart in (-1e-5, 1e-5)
    )
    yield f"With 10 um more or less the double impact ends otherwise at {changed} of {2 * len(GRID)} points."


def bent_by(alike: list[orbits.PeriodicOrbit], apart: float) -> np.ndarray:
    """Curvatures of the paths over the grid where the radii differ by so much, in closed form [1/m]."""
    return np.array(
        [
            closed_curvature(curvature_of(one), 1 + apart / RADIUS, A_r=A_r, f=f)
            for one, (A_r, f) in zip(alike, GRID, strict=True)
        ]
    )


def exponents_of(alike: list[orbits.PeriodicOrbit], apart: float) -> tuple[float, float]:
    """The powers of A_r - 1 and of f that R goes with over the grid, fitted over both at once."""
    design = np.array([[1.0, log(A_r - 1), log(f)] for A_r, f in GRID])
    _, by_aspect, by_rate = np.linalg.lstsq(design, -np.log(bent_by(alike, apart)))[0]
    return float(by_aspect), float(by_rate)


PARTS = {part.__name__: part for part in (curvature, tolerances, tilt, critical, sideways, paper)}


def main() -> None:
    """Write the listing and the figures, or print some parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(PARTS), help="parts to print; nothing is written")
    parser.add_argument("--oracle", type=float, metavar="TILT", help="ask the slow program about a tilt [rad]")
    parser.add_argument("--azimuth", type=float, default=0.0, help="of that tilt [rad]")
    options = parser.parse_args()
    if options.oracle is not None:
        print(ask_oracle(options.oracle, options.azimuth))
    elif options.only:
        for name in options.only:
            for line in PARTS[name](None):
                print(line, flush=True)
    else:
        FIGURES.mkdir(exist_ok=True)
        lines = [line for part in PARTS.values() for line in part(FIGURES)]
        LISTING.write_text("\n".join(["Written by `python benchmarks/evidence/imperfect.py`.\n", *lines]))


if __name__ == "__main__":
    main()
