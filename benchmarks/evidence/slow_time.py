"""Whether runs say of random dimers what the slow flow says: ``slow_time.py [--dimers N] [--first K] [--most PERIODS]``.

Of each dimer (as in `borders_random.py`; every second has unlike ends) the sustained spins are found, at 1.15 times the ball's
fold. From 3 % below and above each of them two runs begin. Over six of its slow times, if one is at most `--most` forcing
periods, they come to it within 1e-4, or leave it where it repels; else they are as long as a tenth of `--most`, and the change
of the spin is compared. Where the spin is held at an end of the family, runs from 0.5 % to both sides stay as near. With
``--later`` a motion is followed for so many periods by `later` and by a run. With ``--attractors`` so many starts of each are
parted by `attractors(slow=True)`, and by runs of 400,000 periods: those of one attractor have come nearer to its spin, or are
all of its mode. It ends with 1 if a run says otherwise.

``--planes`` counts, of so many dimers with alike ends, how the drift D begins beside a plane where D over the spin changes its
sign over mu: with k > 0, k < 0 or k = 0 in D = s (a + k log s - b s^2 + c s^4), by a fit at five spins.
"""

import argparse
import sys
from contextlib import suppress
from itertools import pairwise

import numpy as np

from dimersweep import attractors, names, orbits, simulate
from dimersweep.analysis.orbits.map.ball import ball_fold
from dimersweep.errors import OrbitError
from tests.checks.dimers import random_dimer

BASIN = {"e": 0.7, "Gamma": 1.05, "f": 18, "A_r": 7, "r_1": 0.005, "r_2": 0.0051}  # unlike ends: three slow fates
RANGES, SETTLED, LONG = {"beta0": (-1.2, 1.2), "xdot0": (-2, 2), "phi0": (0, 6.28)}, 300, 400_000
SMALL, FACTORS = np.array([0.25, 1.0, 2.0, 4.0, 8.0]), (0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.3, 3.0)
NO_LOG = 1e-12  # k that is none
SLOW_TIMES, ASIDE, ALIKE, CHANGE_ALIKE, HELD, AT_REST = 6, 0.03, 1e-4, 0.01, 0.005, 1e-3


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
    with suppress(OrbitError):  # such as for a motion that jumps to and fro beside an orbit
        return orbits.find(guess=run, periods=run.mode_period).spin
    return np.nan


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
    slow, attracts, kind = float(row["slow_periods"]), bool(row["attracts"]), names(row["kind"]).item()
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
    right = (
        abs(later.spin - there) < ALIKE * max(abs(there), AT_REST)
        if np.isfinite(there)
        else later.mode in ("", run.mode)
    )
    return f"{later.spin:.6f} {later.mode} for {cost:.0f} periods, the run {there:.6f} {run.mode}", bool(right)


def parted(dimer, starts):
    """For each attractor of a dimer what its starts have come to by runs, and whether they agree."""
    found = attractors(RANGES, dimer, starts=starts, seed=1, periods=SETTLED, slow=True, progress=False)
    for number in found["attractor"].values:
        row, ends, right = found.sel(attractor=number), [], True
        fate, low, high = names(row["fate"]).item(), float(row["spin_low"]), float(row["spin_high"])
        for k in np.flatnonzero(found["basin"].values == number):
            start = dimer | {name: float(found[name][k]) for name in RANGES}
            first, last = (simulate(**start, periods=periods, record=False) for periods in (SETTLED, LONG))
            before, after = (one.orbit.spin if one.orbit else np.nan for one in (first, last))
            away = [max(abs(low) - abs(spin), abs(spin) - abs(high), 0.0) for spin in (before, after)]
            moves = away[1] <= max(away[0], ALIKE * abs(low))
            kept = fate if np.isnan(low) else names(row["mode"]).item()  # of those that are no drift
            right &= bool(moves) if np.isfinite(low + after) else last.mode == kept
            ends.append(f"{before:.4g} to {after:.4g}" if np.isfinite(after) else last.mode)
        yield f"{fate} {low:.5g} to {high:.5g} of {len(ends)}: {', '.join(sorted(set(ends)))}", right


def beginning(dimer, mu):
    """D / s at 1 rad/s of a dimer at a mu, the k of the fit, and the symbols of its motion."""
    given = dimer | {"mu": mu, "mu_s": max(dimer["mu_s"], 1.1 * mu)}
    found = [orbits.find(spin=spin, **given) for spin in SMALL]
    if not all(one.stable for one in found):
        raise OrbitError("unstable")
    powers = np.array([np.ones(len(SMALL)), np.log(SMALL), SMALL**2, SMALL**4]).T
    grown = [one.spin_drift / one.spin for one in found]
    return grown[1], np.linalg.lstsq(powers, np.array(grown), rcond=None)[0][1], found[1].sequence


def count_planes(first, dimers):
    """Print how D begins where it changes its sign at 1 rad/s; no row where no motion is found, or its symbols change."""
    counted = dict.fromkeys(("k > 0", "k < 0", "k = 0"), 0)
    for seed in range(first, first + 2 * dimers, 2):
        _, dimer = dimer_of(seed)
        told = []
        for factor in FACTORS:
            try:
                told.append((factor, *beginning(dimer, factor * dimer["mu"])))
            except OrbitError:
                continue
        for (low, falls, k_low, symbols), (high, grows, k_high, others) in pairwise(told):
            if falls * grows < 0 and symbols == others:
                k = 0.5 * (k_low + k_high)
                kind = "k = 0" if abs(k) < NO_LOG else "k > 0" if k > 0 else "k < 0"
                counted[kind] += 1
                print(f"{seed:3} mu {low} to {high} of its own: k = {k:.1e}, {symbols}", flush=True)
    print(f"{dimers} dimers: {', '.join(f'{n} with {kind}' for kind, n in counted.items())}")


def main():
    """Judge all dimers; how many are not as told."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dimers", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="number of the first dimer")
    parser.add_argument("--most", type=float, default=1e5, help="slow time up to which runs go on to the spin")
    parser.add_argument("--later", type=int, default=0, help="forcing periods of `later`, in place of sustained spins")
    parser.add_argument("--attractors", type=int, default=0, help="starts of each, in place of sustained spins")
    parser.add_argument("--planes", type=int, default=0, help="dimers of which the drift beside a plane is looked at")
    given, wrong = parser.parse_args(), 0
    if given.planes:
        count_planes(given.first, given.planes)
        return 0
    if given.attractors:
        for seed in range(given.first - 1, given.first + given.dimers):
            dimer = BASIN if seed < 0 else dimer_of(seed)[1]
            for told, right in parted(dimer, given.attractors):
                wrong += not right
                print(f"{seed:3} {told}{'' if right else ' NOT AS TOLD'}", flush=True)
        print(f"{wrong} not as told")
        return int(wrong > 0)
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
        for k in np.flatnonzero((found["spin"] > AT_REST) & (names(found["kind"]) != "cycle")):
            row, spin = found.isel(sustained=int(k)), float(found["spin"][k])
            share = HELD if names(row["kind"]) == "end" else ASIDE
            told, right = judged(spin, row, beside(spin, share, begin, dimer), given.most)
            wrong += not right
            said = f"{seed:3} {names(row['kind']).item()} {spin:.6g}, slow {float(row['slow_periods']):.3g}: {told}"
            print(f"{said}{'' if right else ' NOT AS TOLD'}", flush=True)
        cycles = found.isel(sustained=np.flatnonzero(names(found["kind"]) == "cycle"))
        for low, high in zip(cycles["spin_low"].values, cycles["spin_high"].values, strict=True):
            print(f"{seed:3} to and fro from {low:.6g} to {high:.6g}", flush=True)
    print(f"{given.dimers} dimers: {wrong} not as told")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
