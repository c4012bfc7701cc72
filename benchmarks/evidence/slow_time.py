"""Whether runs say of random dimers what the slow flow says: ``slow_time.py [--dimers N] [--first K] [--most PERIODS]``.

Of each dimer (as in `borders_random.py`; every second has unlike ends) the sustained spins are found, at 1.15 times the ball's
fold. From 3 % below and above each of them two runs begin. Over six of its slow times, if one is at most `--most` forcing
periods, they come to it within 1e-4, or leave it where it repels; else they are as long as a tenth of `--most`, and the change
of the spin is compared. Where the spin is held at an end of the family, runs from 0.5 % to both sides stay as near. With
``--later`` a motion is followed for so many periods by `later` and by a run. It ends with 1 if a run says otherwise.
"""

import argparse
import sys

import numpy as np

from dimersweep import orbits
from dimersweep.errors import OrbitError
from dimersweep.orbits.kinds import ball_fold
from tests.checks.dimers import random_dimer

SLOW_TIMES, ASIDE, ALIKE, CHANGE_ALIKE, HELD = 6, 0.03, 1e-4, 0.01, 0.005


def dimer_of(seed):
    """Parameters of a random dimer, and the spin of its drift; every second has unlike ends."""
    dimer = random_dimer(seed)
    if seed % 2:
        share = np.random.default_rng(seed).uniform(-1, 1, 2)
        dimer |= {"r_2": dimer["r"] * (1 + 0.03 * share[0]), "mu_2": dimer["mu"] * (1 + 0.1 * share[1])}
        dimer["mu_s_2"] = dimer["mu_s"] / dimer["mu"] * dimer["mu_2"]
    return dimer.pop("spin"), dimer | {"Gamma": 1.15 * ball_fold(dimer["e"])}


def spin_of(run):
    """The spin that a run has come to, of motions that are no drift if it is recorded; NaN where it does not repeat."""
    if run.orbit or not (run.mode_period and run.record_cut == ""):
        return run.orbit.spin if run.orbit else np.nan
    return orbits.find(guess=run, periods=run.mode_period).spin


def beside(spin, share, begin, dimer):
    """The orbits at both sides of a spin, as far as there are any."""
    found, guess = [], orbits.find(spin=begin, **dimer)
    for to in ((1 - share) * spin, (1 + share) * spin):
        try:
            found.append(orbits.find(spin=to, guess=guess))
        except OrbitError:
            continue
    return found


def judged(spin, row, begins, most):
    """What two runs from both sides of a sustained spin do, in words, and whether it is as told."""
    slow, attracts, kind = float(row["slow_periods"]), bool(row["attracts"]), str(row["kind"].values)
    if kind == "spin" and float(row["spin_error"]) > ALIKE * spin:
        return f"known within {float(row['spin_error']):.1e} only", True
    told, right = [], bool(begins)
    for orbit in begins:
        if kind == "end":
            off = spin_of(orbit.run(max(1, int(most / 10)), record=False)) / spin - 1
            right &= not abs(off) > 1.5 * HELD  # a motion that does not repeat has no such number
            told.append(f"stays within {off:.1e}")
        elif slow <= most:
            off = spin_of(orbit.run(int(SLOW_TIMES * slow if attracts else slow), record=False)) / spin - 1
            right &= abs(off) < ALIKE if attracts else abs(off) > abs(orbit.spin / spin - 1)
            told.append(f"comes to {off:.1e} of it")
        else:
            periods = int(most / 10)
            change = spin_of(orbit.run(periods)) - orbit.spin
            off = change / (orbits.later(orbit, periods=periods).spin - orbit.spin) - 1
            right &= abs(off) < CHANGE_ALIKE
            told.append(f"changes {1 + off:.5f} of what is told")
    return ", ".join(told), bool(right)


def followed(begin, dimer, periods):
    """What `later` and a run say of a motion after some periods, and whether they agree."""
    orbit = orbits.find(spin=begin, **dimer)
    cost = orbit.fixed.map.recorder.periods
    later = orbits.later(orbit, periods=periods)
    cost, run = orbit.fixed.map.recorder.periods - cost, orbit.run(periods, record=False)
    there = spin_of(run)
    right = abs(later.spin / there - 1) < ALIKE if np.isfinite(there) else later.mode in ("", run.mode)
    return f"{later.spin:.6f} {later.mode} for {cost:.0f} periods, the run {there:.6f} {run.mode}", bool(right)


def main():
    """Judge all dimers; how many are not as told."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dimers", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="number of the first dimer")
    parser.add_argument("--most", type=float, default=1e5, help="slow time up to which runs go on to the spin")
    parser.add_argument("--later", type=int, default=0, help="forcing periods of `later`, in place of sustained spins")
    given, wrong = parser.parse_args(), 0
    for seed in range(given.first, given.first + given.dimers):
        begin, dimer = dimer_of(seed)
        try:
            if given.later:
                told, right = followed(begin, dimer, given.later)
                wrong += not right
                print(f"{seed:3} {told}{'' if right else ' NOT AS TOLD'}", flush=True)
                continue
            found = orbits.sustained(guess=orbits.find(spin=begin, **dimer))
        except OrbitError as reason:
            print(f"{seed:3} {reason}", flush=True)
            continue
        for k in np.flatnonzero((found["spin"] > 1e-3) & (found["kind"] != "cycle")):
            row, spin = found.isel(sustained=int(k)), float(found["spin"][k])
            share = HELD if row["kind"] == "end" else ASIDE
            told, right = judged(spin, row, beside(spin, share, begin, dimer), given.most)
            wrong += not right
            said = f"{seed:3} {row['kind'].values} {spin:.6g}, slow {float(row['slow_periods']):.3g}: {told}"
            print(f"{said}{'' if right else ' NOT AS TOLD'}", flush=True)
        cycles = found.isel(sustained=np.flatnonzero(found["kind"] == "cycle"))
        for low, high in zip(cycles["spin_low"].values, cycles["spin_high"].values, strict=True):
            print(f"{seed:3} to and fro from {low:.6g} to {high:.6g}", flush=True)
    print(f"{given.dimers} dimers: {wrong} not as told")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
