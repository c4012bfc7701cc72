"""Whether the centre of a circle moves as ``orbits.centre_drift`` says: ``centre_drifts.py [--dimers N]``.

Of the base case and of random dimers (``tests/checks/dimers.py``; each second one has unlike ends) the velocity of the centre
is computed, per radian of `tilt` and per unit of `Gamma_x`, and taken from plain runs over a whole turn, from a heading to the
same heading. There are four of them on each plate, which is turned by quarters: the mean of the four is without what the drift
of the spin does to a single turn. Each begins so that its mean spin is about that of the orbit, and is compared at its mean
spin. Printed are how far the runs are off at `holds_to`, at 1e-4 and 3e-4, and in the base case at 1e-3. It ends with 1 if they
are off by 1 %, or at `holds_to` by 5 %; of dimers whose spin changes by more than 5 % in a round on the level plate the latter
is printed only. Dimers are left out that have no stable circle, or for which the first order does not hold to a tilt of twice
3e-4: it may be off by more than 1 % there.
"""

import argparse
import sys
from contextlib import suppress
from functools import partial

import numpy as np

from dimersweep import orbits, simulate
from dimersweep.analysis.orbits.map.ball import ball_fold
from dimersweep.errors import OrbitError
from tests.checks.dimers import random_dimer

SIZES, OFF, OFF_THERE = (1e-4, 3e-4), 0.01, 0.05


def dimer_of(number):
    """Parameters and spin of the base case (0) or of a random dimer."""
    if number == 0:
        return {"spin": 144.0}
    dimer = random_dimer(number)
    unlike = {"r_2": 1.002 * dimer["r"], "mu_2": 0.9 * dimer["mu"]} if number % 2 else {}
    if unlike:
        dimer["r_1"] = dimer.pop("r")
    return dimer | unlike | {"Gamma": 1.15 * ball_fold(dimer["e"])}


def turned(name, size, quarters):
    """A plate that falls or moves along X, turned by quarters."""
    if name == "tilt":
        return {"tilt": size, "azimuth": quarters * np.pi / 2}
    axis = "xy"[quarters % 2]
    return {f"Gamma_{axis}": size, f"phi_{axis}": np.pi * (quarters // 2)}


def spin_of(states):
    """Axial spin at some states [rad/s]."""
    return states["gamma_rate"].values + states["theta_rate"].values * np.sin(states["beta"].values)


def rounds_of(orbit):
    """Forcing periods once round."""
    return orbit.period * orbit.parameters["f"]


def last_turn(orbit, rounds, plate):
    """Velocity of the centre over the last turn of a run from an orbit, and its mean spin; NaN if it makes none."""
    start = orbit.run(1).states(0.0)
    states = simulate(start=start, periods=int(1.3 * rounds) + 50, rtol=1e-10, **plate).section()
    turn = np.sign(orbit.precession_rate) * states["theta"].values
    if (np.diff(turn) <= 0).any() or turn[-1] < 2 * np.pi:
        return np.nan, np.nan
    began = partial(np.interp, turn[-1] - 2 * np.pi, turn)
    x, y, time = (states[name].values for name in ("x", "y", "time"))
    velocity = (x[-1] - began(x) + 1j * (y[-1] - began(y))) / (time[-1] - began(time))
    return velocity, orbit.spin * spin_of(states)[turn >= turn[-1] - 2 * np.pi].mean() / spin_of(start)


def off(orbit, name, size):
    """How far the mean of the runs is off the first order, as a share; NaN if one makes no turn."""
    ratios, rounds = [], rounds_of(orbit)
    level = last_turn(orbit, rounds, {})[1]
    for quarters in range(4):
        lead = level - last_turn(orbit, rounds, turned(name, size / 4, quarters))[1]
        begun = orbits.find(spin=orbit.spin + 4 * lead, guess=orbit) if np.isfinite(lead) else orbit
        velocity, spin = last_turn(begun, rounds, turned(name, size, quarters))
        if np.isnan(spin):
            return np.nan
        told = orbits.centre_drift(spin=spin, guess=orbit, **turned(name, size, quarters))
        ratios.append(velocity / complex(told.centre_velocity_x, told.centre_velocity_y))
    return abs(np.mean(ratios) - 1)


def judged(number, orbit, told):
    """Print what a dimer does on a plate of each kind; whether the runs agree."""
    agrees, rounds = True, rounds_of(orbit)
    lost = orbit.spin_drift * rounds / orbit.spin
    for name, drift in told.items():
        sizes = [*SIZES, *([1e-3] if number == 0 else [])]
        by, there = [off(orbit, name, size) for size in sizes], off(orbit, name, drift.holds_to)
        agrees &= all(each < OFF for each in by) and (there < OFF_THERE or abs(lost) > OFF_THERE)
        print(
            f"{number:3} {orbit.spin:7.2f} {orbit.radius:6.2f} {rounds:6.0f} {lost:8.1e} {name:7} {drift.per_unit:8.4f} "
            f"{np.degrees(drift.direction):8.2f} {drift.holds_to:8.1e} {drift.spin_drift / 1e-6:8.1e} {there:7.2%} "
            f"{' '.join(f'{each:.3%}' for each in by)}",
            flush=True,
        )
    return agrees


def main():
    """Compare dimers; 1 if one is off."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dimers", type=int, default=10, help="random ones, beside the base case")
    given = parser.parse_args()
    wrong, number, done = 0, -1, -1
    print(
        "dimer, spin, R, periods a round, change of the spin in a round; plate, m/s per unit, degrees, holds_to, spin drift"
    )
    print(f"per unit squared; off at holds_to, and at {SIZES} (base case: and 1e-3)")
    while done < given.dimers:
        number += 1
        with suppress(OrbitError):
            orbit = orbits.find(**dimer_of(number))
            told = {name: orbits.centre_drift(guess=orbit, **{name: 1e-3}) for name in ("tilt", "Gamma_x")}
            if orbit.stable and told["tilt"].holds_to >= 2 * SIZES[-1]:
                wrong, done = wrong + (not judged(number, orbit, told)), done + 1
    print(f"{done} random dimers of {number} and the base case: {wrong} off")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
