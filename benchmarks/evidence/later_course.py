"""What becomes of a motion after its run has stopped: the run is compared with its family of orbits, at the spin that it has.

A run whose fast part has settled is on the slow manifold of its family (`dimersweep.orbits.manifold`), at a point that its
spin tells. Both are seen in the section of the orbit, which lies away from its events, so a strobe in the middle of a hop
disturbs nothing. Where the run leaves its family, the branch of its orbit in the spin must have a border nearby.
"""

from collections.abc import Iterable
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from dimersweep import simulate
from dimersweep.kernel.verdict.settling import KEPT, SETTLED_PERIODS
from dimersweep.orbits.families import Seen, seen_at
from dimersweep.orbits.finding import repeats_after
from dimersweep.orbits.following import Trace, traced
from dimersweep.orbits.guesses import of_run
from dimersweep.orbits.manifold import creep_near, creep_of, slow_direction
from dimersweep.orbits.orbit import orbit_of
from dimersweep.orbits.passage import TURN
from dimersweep.orbits.poincare import OrbitLost, Tape

KEEPS, FORETOLD, UNEXPLAINED = "keeps to its family", "foretold", "passes a border later"
SHORTER = "shorter period"
ON = KEPT  # distance from the family, in units of the section, up to which a run is on it
MAP_RTOL = 1e-12
POINTS = 100  # of a branch


class Why(NamedTuple):
    """Why a verdict differs from the one with the early stop: the kind (docs/stopping.md has them), and what shows it."""

    kind: str
    shown: str


class Beside(NamedTuple):
    """A run after so many periods beside the motion of its family at its spin, and how far apart they are."""

    after: int
    seen: Seen
    apart: float

    def __str__(self) -> str:
        return f"{self.apart:.1e} from its family after {self.after} periods"


def why(point: dict[str, float], period: int, stop: int, periods: int, rtol: float) -> Why:
    """What becomes of a motion after the stop of its run that gave its period.

    Where no orbit of that period explains it, one of a shorter period does, if the motion comes near it too slowly.
    """
    if period == 0:
        return Why(UNEXPLAINED, "the stopped run has no period: rest that was not, or a failure")
    told = course(point, period, stop, periods, rtol)
    for shorter in (q for q in range(period - 1, 0, -1) if period % q == 0 and told.kind == UNEXPLAINED):
        one = course(point, shorter, stop, periods, rtol)
        if one.kind != UNEXPLAINED:
            return Why(SHORTER if one.kind == KEEPS else one.kind, f"with its shorter period {shorter}, {one.shown}")
    return told


def course(point: dict[str, float], period: int, stop: int, periods: int, rtol: float) -> Why:
    """What becomes of a motion, beside orbits of one period: from when it has settled, `SETTLED_PERIODS` before its stop."""
    first = beside(point, range(max(1, stop - SETTLED_PERIODS), stop + 1), period, rtol)
    if first is None:
        return Why(UNEXPLAINED, "no orbit is found near the run at its stop")
    last, at_end = first, (periods, periods - 1)
    for places in (*((k, k - 1) for k in range(first.after + SETTLED_PERIODS, periods, SETTLED_PERIODS)), at_end):
        one = beside(point, places, period, rtol)
        if one is None or one.seen.orbit.word != first.seen.orbit.word:
            break
        last = one
    end = last if last.after in at_end else beside(point, at_end, period, rtol)
    if end is not None and (end is last or leads_to(followed(first, end.seen.orbit.spin, words=False), end)):
        shorter, shown = repeats_after(end.seen.at), f"{first}, {end}"
        return Why(SHORTER, f"{shown}; it repeats after {shorter}") if shorter < period else Why(KEEPS, shown)
    orbit, shown = last.seen.orbit, f"{first}, {last}"
    borders = borders_of(followed(first, orbit.spin + 2 * SETTLED_PERIODS * orbit.spin_drift))
    if not borders:
        return Why(UNEXPLAINED, f"{shown}; then it leaves it, and the family goes on")
    return Why(FORETOLD, f"{shown}; {', '.join(borders)}")


def beside(point: dict[str, float], places: Iterable[int], period: int, rtol: float) -> Beside | None:
    """A run beside its family, after the first of some numbers of periods at which it is on it; None if it never is."""
    for after in places:
        run = simulate(**point, periods=after, rtol=rtol)
        with suppress(OrbitLost):
            m, z = of_run(run, run.parameters, period, MAP_RTOL, Tape())
            creep = creep_near(m, z, m.image(z).spin, *m.jacobian(z))
            apart = float(np.delete(np.abs(creep.z - z), m.slow).max())
            if apart <= ON:
                return Beside(after, seen_at(m, creep), apart)
    return None


def borders_of(branch: Trace) -> list[str]:
    """The special points of a branch, and its end if it does not reach what was asked for."""
    found = [f"{entry.kind.name} at spin {entry.value:.7g} rad/s" for entry in branch.entries if entry.kind]
    end = (
        [] if branch.end.startswith("to:") else [f"its end at spin {branch.entries[-1].value:.7g} rad/s ({branch.end})"]
    )
    return found + end


def followed(first: Beside, spin: float, words: bool = True) -> Trace:
    """The branch of the orbit beside a run, to a spin [rad/s]."""
    return traced(orbit_of(first.seen.at), "spin", spin, POINTS, words=words)


def leads_to(branch: Trace, run: Beside) -> bool:
    """Whether a branch has no border, and ends at the motion beside a run: in its section, along the family aside."""
    orbit, there = branch.entries[-1].orbit, run.seen.at.map
    creep, own, along = creep_of(orbit.fixed), orbit.fixed.map, slow_direction(run.seen.at)[0]
    for turn in range(0 if borders_of(branch) else own.periods):  # in one of the forcing periods of the motion
        moved, z = own.moved_to(creep.image.passage, there.phase - own.phase + turn * TURN)
        if (moved.modes == there.modes).all():
            apart = z - run.seen.at.z
            if np.abs(apart - along * apart[there.slow] / along[there.slow]).max() <= ON:
                return True
    return False
