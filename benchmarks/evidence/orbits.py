"""What orbits as objects cost, and the fold by another program: ``python benchmarks/evidence/orbits.py``.

For the base case at an axial spin of 100 rad/s it prints

* the cost, in forcing periods of the map, of an orbit, a warm point of a branch, of a border, of a family, and the time;
* the fold beside that of pycont-lite driving the same map, where it is installed.
"""

from dataclasses import replace
from time import process_time

import numpy as np

from dimersweep import orbits, simulate
from dimersweep.analysis.orbits.map.lost import OrbitLost
from dimersweep.analysis.orbits.map.solution import defect

SPIN = 100.0
FOLDS = {0.5: 1.04771531, 0.6: 0.78725965, 0.7: 0.55603099}  # Gamma over e


def timed(action):
    """What an action gives, and how long it took on the processor [s]."""
    start = process_time()
    result = action()
    return result, process_time() - start


def costs():
    """Forcing periods of the map, and seconds, that orbits, branches, borders and families take."""
    run = simulate(periods=300)
    orbit = orbits.find(guess=run)
    print(f"an orbit from a run: {orbit.cost:.0f} periods; from nothing: {orbits.find(spin=SPIN).cost:.0f}")
    branch = orbits.follow(orbits.find(spin=SPIN), "Gamma", to=0.7)
    plain = (branch["special"].values[1:] == 0) & (branch["special"].values[:-1] == 0)
    cost = np.diff(branch["cost"].values)[plain]
    print(f"a warm point of a branch: median {np.median(cost):.0f}, most {cost.max():.0f} periods")
    spans = {"fold": (0.4, 0.8, 1000), "flip": (0.6, 0.7, 200)}
    for kind in ("fold", "flip", "lift_off", "double_impact", "chatter", "hop"):
        e = np.linspace(*spans.get(kind, (0.5, 0.7, 41)))
        found, seconds = timed(lambda kind=kind, e=e: orbits.border(kind, "Gamma", over={"e": e}, spin=SPIN))
        cost = np.sort(found["cost"].values)[:-3]  # without the first ones
        print(
            f"a warm point of a {kind} curve: median {np.nanmedian(cost):.0f}, most {np.nanmax(cost):.0f} periods;"
            f" {e.size} points: {found.attrs['cost']:.0f} periods with the meetings, {seconds:.1f} s,"
            f" {int(np.isnan(found['Gamma']).sum())} failed"
        )
    family, seconds = timed(lambda: orbits.family(spin=(50.0, 250.0), points=200))
    print(f"a family of 200 spins: {float(family.attrs['cost']) / 200:.1f} periods a spin, {seconds:.2f} s")


def peer():
    """The fold by pycont-lite, a matrix-free continuation library, from the same map: the least Gamma of its branch."""
    try:
        import pycont
    except ImportError:
        print("pycont-lite is not installed: pip install pycont-lite")
        return
    settings = {"rdiff": 1e-5, "tolerance": 1e-10, "initial_directions": "decrease_p", "analyze_stability": False}
    for e, known in FOLDS.items():
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
            return defect(own, u, own.passage(u), SPIN)
        except OrbitLost:
            return np.full(u.size, 1e3)

    return closes


if __name__ == "__main__":
    costs()
    peer()
