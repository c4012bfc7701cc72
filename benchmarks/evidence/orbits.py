"""What orbits as objects give, and what they cost: borders, branches, families.

``python benchmarks/evidence/orbits.py`` prints, for the base case at an axial spin of 100 rad/s:

* folds and flips over e, beside the closed forms of a ball, and the fold of a long light rod, where they are exact;
* the cost, in forcing periods of the map, of an orbit, a warm point of a branch, of a border, of a family, and the time;
* `later` beside plain runs (of 20,000 periods; with ``--long`` of 60,000 and 100,000 for two aspect ratios);
* multipliers beside those of `stability`; the fold beside that of pycont-lite driving the same map, where it is installed;
* with ``--warm`` the cost of points of borders, over e in the base case and over the grid of ``sweeps/borders/atlas.toml``:
  of all begun from a neighbour, of those of the same word, and of these where an end stays on the plate for a part of the
  period.
"""

import argparse
from dataclasses import replace
from time import process_time
from unittest.mock import patch

import numpy as np

from dimersweep import orbits, simulate, stability
from dimersweep.orbits import border_grid
from dimersweep.orbits.ball import ball_flip, ball_fold
from dimersweep.orbits.curve import Curve
from dimersweep.orbits.newton import defect
from dimersweep.orbits.poincare import OrbitLost

SPIN = 100.0
KNOWN = {
    "fold": {0.5: 1.04771531, 0.6: 0.78725965, 0.7: 0.55603099},
    "flip": {0.5: 1.468736, 0.6: 1.264428, 0.7: 1.115556},
}


def timed(action):
    """What an action gives, and how long it took on the processor [s]."""
    start = process_time()
    result = action()
    return result, process_time() - start


def borders():
    """Folds and flips, beside what was measured before and the closed forms."""
    for kind, ball in (("fold", ball_fold), ("flip", ball_flip)):
        known = KNOWN[kind]
        found = orbits.border(kind, "Gamma", over={"e": list(known)}, spin=SPIN)
        for e, Gamma in zip(found["e"].values, found["Gamma"].values, strict=True):
            off = f"known {known[e]:.8f}, off {Gamma - known[e]:+.1e}"
            print(f"{kind} at e = {e:.1f}: Gamma = {Gamma:.8f} ({off}; ball {ball(e):.8f})")
    print("fold of a rod without mass, less that of a ball:")
    for A_r in (10.0, 100.0, 1000.0, 10_000.0):
        found = orbits.border("fold", "Gamma", over={"e": list(KNOWN["fold"])}, spin=1e-3, A_r=A_r, rho_r=0.0)
        away = found["Gamma"].values - [ball_fold(e) for e in found["e"].values]
        print(f"  A_r = {A_r:7.0f}: " + ", ".join(f"{value:+.1e}" for value in away))


def costs():
    """Forcing periods of the map, and seconds, that orbits, branches, borders and families take."""
    run = simulate(periods=300)
    orbit = orbits.find(guess=run)
    print(f"an orbit from a run: {orbit.cost:.0f} periods; from nothing: {orbits.find(spin=SPIN).cost:.0f}")
    branch = orbits.follow(orbits.find(spin=SPIN), "Gamma", to=0.7)
    plain = (branch["special"].values[1:] == "") & (branch["special"].values[:-1] == "")
    cost = np.diff(branch["cost"].values)[plain]
    print(f"a warm point of a branch: median {np.median(cost):.0f}, most {cost.max():.0f} periods")
    for kind in ("fold", "flip"):
        e = np.linspace(0.4, 0.8, 1000) if kind == "fold" else np.linspace(0.6, 0.7, 200)
        found, seconds = timed(lambda kind=kind, e=e: orbits.border(kind, "Gamma", over={"e": e}, spin=SPIN))
        cost = np.sort(found["cost"].values)[:-3]  # without the first ones
        print(
            f"a warm point of a {kind} curve: median {np.nanmedian(cost):.0f}, most {np.nanmax(cost):.0f} periods;"
            f" {e.size} points: {found.attrs['cost']:.0f} periods with the meetings, {seconds:.1f} s,"
            f" {int(np.isnan(found['Gamma']).sum())} failed"
        )
    for kind in ("fold", "flip", "lift_off", "double_impact", "chatter", "hop"):
        e = np.linspace(0.5, 0.7, 41)
        (before, _, cost), seconds = timed(lambda kind=kind, e=e: watched(kind, {"e": e}))
        warm = cost[before != ""]
        print(
            f"a warm point of a {kind} curve, e from 0.5 to 0.7: median {np.median(warm):.0f}, most {warm.max():.0f} periods;"
            f" {cost.size} of {e.size} points, {seconds:.1f} s"
        )
    family, seconds = timed(lambda: orbits.family(spin=(50.0, 250.0), points=200))
    print(f"a family of 200 spins: {float(family.attrs['cost']) / 200:.1f} periods a spin, {seconds:.2f} s")


def later(long):
    """`later` beside plain runs from the same start."""
    lengths, rtol = (60_000, 100_000) if long else (20_000,), 1e-10
    for A_r in (6.0, 6.5) if long else (6.0,):
        family = orbits.family(spin=(80.0, 150.0), points=60, A_r=A_r)
        start = simulate(A_r=A_r, periods=500, record=False, rtol=rtol).orbit if A_r == 6.0 else None
        beta0 = 4 * np.pi / 45
        if start is None:
            beta0 = next(
                b
                for b in np.linspace(0.1, 0.6, 40)
                if simulate(A_r=A_r, beta0=b, periods=100, record=False).mode == "drift"
            )
            start = simulate(A_r=A_r, beta0=beta0, periods=500, record=False, rtol=rtol).orbit
        for n in lengths:
            run, seconds = timed(
                lambda A_r=A_r, b=beta0, n=n: simulate(A_r=A_r, beta0=b, periods=n, record=False, rtol=rtol).orbit
            )
            told, quick = timed(lambda n=n, s=start, f=family: orbits.later(f, spin=s.spin_rate, periods=n - 500))
            pairs = {"radius": run.radius, "period": run.period, "zeta": run.zeta, "spin": run.spin_rate}
            off = ", ".join(f"{name} {getattr(told, name) / value - 1:+.1e}" for name, value in pairs.items())
            print(f"A_r = {A_r}, {n} periods: {off}; run {seconds:.1f} s, later {1e3 * quick:.0f} ms")


def multipliers():
    """Those of an orbit beside those of a run that has settled on it."""
    run = simulate(periods=600, rtol=1e-12, phi0=1.5 * np.pi, beta0=0.05 + 0.05)
    for beta0 in np.linspace(0.05, 1.0, 20):
        run = simulate(periods=600, rtol=1e-12, phi0=1.5 * np.pi, beta0=beta0)
        if run.mode == "drift":
            break
    theirs = stability.multipliers(run).values
    orbit = orbits.find(guess=run)
    ours = np.append(orbit.multipliers, orbit.slow_multiplier)
    gap = np.abs(np.sort(np.abs(theirs)) - np.sort(np.abs(ours))).max()
    print(f"multipliers of a run at 600 periods and of its orbit differ by {gap:.1e} at most")


def peer():
    """The fold by pycont-lite, a matrix-free continuation library, from the same map: the least Gamma of its branch."""
    try:
        import pycont
    except ImportError:
        print("pycont-lite is not installed: pip install pycont-lite")
        return
    settings = {"rdiff": 1e-5, "tolerance": 1e-10, "initial_directions": "decrease_p", "analyze_stability": False}
    for e, known in KNOWN["fold"].items():
        begin = known + 5e-5
        orbit = orbits.find(spin=SPIN, e=e, Gamma=begin)
        closes = closing(orbit.fixed.map)
        result = pycont.arclengthContinuation(closes, orbit.fixed.z, begin, 1e-5, 4e-3, 4e-3, 30, settings, verbosity=0)
        p = np.concatenate([branch.p_path for branch in result.branches])
        points = np.concatenate([branch.u_path for branch in result.branches])
        closed = [np.abs(closes(point, value)).max() < 1e-9 for point, value in zip(points, p, strict=True)]
        near = np.array(closed) & (p < known + 6e-5)  # its own guess of the fold is only near
        u = points[:, 0]
        fit = np.polynomial.Polynomial.fit(u[near], p[near], 4)
        turns = fit.deriv().roots()
        turns = turns[np.abs(turns.imag) < 1e-9].real
        fold = min(fit(turns[(turns > u[near].min()) & (turns < u[near].max())]))
        own = float(orbits.border("fold", "Gamma", over={"e": [e]}, spin=SPIN)["Gamma"][0])
        print(f"fold at e = {e}: pycont-lite {fold:.8f}, here {own:.8f}, apart {fold - own:+.1e}")


def closing(m):
    """How far a point fails to close at a value of Gamma, as pycont-lite asks for it."""

    def closes(u, p):
        try:
            own = replace(m, parameters=m.parameters | {"Gamma": float(p)})
            return defect(own, u, own.image(u), SPIN)
        except OrbitLost:
            return np.full(u.size, 1e3)

    return closes


def watched(kind, axes):
    """Of each point of a border the word, that of the neighbour it began from, and the cost."""
    points, point = [], Curve.point

    def noted(self, values, near, *rest):
        found = point(self, values, near, *rest)
        points.append((near[0].orbit.word if near else "", found.orbit.word, found.cost))
        return found

    with patch.object(Curve, "point", noted), patch.object(border_grid, "_meetings", lambda *_: []):
        orbits.border(kind, "Gamma", over=axes, spin=SPIN)
    return tuple(np.array(column) for column in zip(*points, strict=True))


def warm():
    """The cost of points of borders, of the base case and over the grid of the atlas, by what they begin with."""
    base = {"e": np.linspace(0.4, 0.8, 81)}
    grid = {"A_r": [4.0, 5.0, 6.0, 7.0, 8.0], "e": np.linspace(0.35, 0.8, 46)}
    every = ("fold", "flip", "chatter", "double_impact", "lift_off", "hop")
    for name, axes, kinds in (("base case", base, every), ("atlas", grid, ("fold", "flip", "hop"))):
        for kind in kinds:
            before, word, cost = watched(kind, axes)
            same, touches = before == word, np.char.find(word, "SC") >= 0
            print(f"{kind}, {name}:")
            for told, which in (
                ("begun from a neighbour", before != ""),
                ("of the same word", same),
                ("with an end on the plate", same & touches),
            ):
                dear = np.sort(cost[which & (cost > 120)])
                print(
                    f"  {told}: {which.sum()} points, median {np.median(cost[which]):.0f}, {dear.size} above 120: {dear}"
                )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--long", action="store_true", help="runs of 60,000 and 100,000 periods, two aspect ratios")
    parser.add_argument("--warm", action="store_true", help="the cost of points of borders, by what they begin with")
    given = parser.parse_args()
    borders()
    costs()
    later(given.long)
    multipliers()
    peer()
    if given.warm:
        warm()
