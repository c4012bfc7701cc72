"""Dimers drawn at random, and whether their drift is stable on one side of a border and not on the other."""

import numpy as np

from dimersweep import orbits, sweep
from dimersweep.analysis.orbits.map.ball import ball_flip, ball_fold
from dimersweep.analysis.orbits.map.passage import far_ends
from dimersweep.errors import OrbitError

ASIDE = 0.01  # share of the parameter by which a border is crossed
STARTS = 400  # of which none may drift where no stable orbit is found
MOST_ASIDE = 8  # such shares within which a stable orbit is looked for


def random_dimer(seed):
    """Parameters of one random dimer, with the axial spin of its drift [rad/s] and without Gamma."""
    rng = np.random.default_rng([27, seed])
    r, mu = float(rng.uniform(2e-3, 10e-3)), float(rng.uniform(0.08, 0.5))
    return {
        "r": r,
        "A_r": float(rng.uniform(4.5, 9)),
        "f": float(rng.uniform(12, 50)),
        "mu": mu,
        "mu_s": mu * float(rng.uniform(1, 2)),
        "e": float(rng.uniform(0.5, 0.78)),
        "spin": float(rng.uniform(0.16, 0.64)) / r,
    }


def drifts(dimer):
    """How many of `STARTS` drawn starts between the ball's fold and flip come to a drift, with about the spin of the dimer."""
    rng, e, r = np.random.default_rng(0), dimer["e"], dimer["r"]
    starts = {
        "Gamma": rng.uniform(ball_fold(e), ball_flip(e), STARTS),
        "beta0": rng.uniform(0.02, 1.2, STARTS),
        "phi0": rng.uniform(0.0, 2 * np.pi, STARTS),
    }
    model = {name: value for name, value in dimer.items() if name != "spin"} | {"xdot0": 1.4 * r * dimer["spin"]}
    return int(sweep(points=starts, fixed=model, periods=200, progress=False).dimersweep.drifts().sum())


def stability_at(dimer, Gamma, guess=None):
    """Whether a dimer has a stable orbit on which an end is far from the plate at a time, an unstable one, or none."""
    try:
        orbit = orbits.find(Gamma=Gamma, guess=guess, **dimer)
    except OrbitError:
        return "none"
    if far_ends(orbit.sequence) == 0 or not np.isfinite(orbit.radius):
        return "another motion"
    return "stable" if orbit.stable else "unstable"


def stable_before(dimer, Gamma, outward):
    """What there is a hundredth of Gamma before a border: found by itself, or from a stable orbit further inside."""
    near = Gamma * (1 - outward * ASIDE)
    told = stability_at(dimer, near)
    for k in range(2, MOST_ASIDE):
        far = Gamma * (1 - k * outward * ASIDE)
        if told == "stable":
            break
        if stability_at(dimer, far) == "stable":
            return stability_at(dimer, near, orbits.find(Gamma=far, **dimer))
    return told


def crossed(dimer, Gamma, outward):
    """What there is at a hundredth of Gamma on the inner side of a border and on the outer one, by `stability_at`."""
    return stable_before(dimer, Gamma, outward), stability_at(dimer, Gamma * (1 + outward * ASIDE))
