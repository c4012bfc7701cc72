"""What becomes of a motion after its run has stopped: it is followed along its family of orbits, at the spin the run has.

The full run is compared with its family in each period of the motion. Of the run only the spin is taken; the point of
the slow manifold at that spin (`dimersweep.orbits.manifold`) is found from the one before. Both are seen in the section
of the orbit, which lies away from its events, so a strobe in the middle of a hop disturbs nothing. So a border is foretold
in the spin, to within its change in one period of the motion, and no time is foretold.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dimersweep import simulate
from dimersweep.kernel.model.layout import ROW_PHI0
from dimersweep.kernel.verdict.settling import KEPT, PATIENCE
from dimersweep.orbits.finding import repeats_after
from dimersweep.orbits.following import traced
from dimersweep.orbits.guesses import of_run
from dimersweep.orbits.kinds.fold import FOLD
from dimersweep.orbits.kinds.kind import COMPLEX
from dimersweep.orbits.manifold import MANIFOLD_REACH, has_fast_part, multipliers_of, slow_direction
from dimersweep.orbits.newton import TOLERANCE, Fixed, defect, fixed_at, newton, solve, system
from dimersweep.orbits.orbit import orbit_of
from dimersweep.orbits.passage import TURN, Passage
from dimersweep.orbits.poincare import Image, OrbitLost, ReturnMap, Tape
from dimersweep.orbits.word import word_of

KEEPS, FORETOLD, UNEXPLAINED = "keeps to its family", "foretold", "passes a border later"
SHORTER = "shorter period"
NOTHING, SLOW = "Newton's method finds none beyond", "its fast part is no faster than its spin"
ON = KEPT  # distance from the family, in units of the section, up to which a run is on it
MAP_RTOL, STEP = 1e-12, 1e-6  # of the map, and of its derivatives by differences
NEAR = 0.1  # how far the point of a settled run fails to close at most
NARROWED = 1e-3  # of the spin's change in one period: how well the end of a family is known
AHEAD = (1.0, 2.0, 4.0, 8.0)  # of the spin's change in one period: how far beyond the end the map is looked at
FOLLOWED = 60  # points of the branch of fixed points on which a fold is looked for


class Seen(NamedTuple):
    """A run beside its family: after so many periods, its spin [rad/s], how far apart they are, the largest multiplier."""

    after: int
    spin: float
    apart: float
    multiplier: complex
    word: str


class Border(NamedTuple):
    """A border that a family meets: what it is, and between which spins [rad/s]."""

    kind: str
    spins: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.spins
        return (
            f"{self.kind} at spin {low:.6g} to {high:.6g} rad/s"
            if low != high
            else f"{self.kind} at spin {low:.7g} rad/s"
        )


class Sampled:
    """A recorded run, seen in the sections of orbits."""

    def __init__(self, point: dict[str, float], periods: int, rtol: float) -> None:
        self.point, self.periods, self.rtol = point, periods, rtol
        record = simulate(**point, periods=periods, rtol=rtol).record("followed")
        self.passage, self.phi0 = Passage(record.events, record.segments), record.row[ROW_PHI0]

    def at(self, m: ReturnMap, after: int) -> np.ndarray:
        """The run's point in the section of a map, the first one after so many periods.

        Raises
        ------
        OrbitLost
            If its contact is another one there.
        """
        own = ReturnMap(m.parameters, self.phi0, m.modes, m.periods, self.rtol, m.tape)
        state, modes = own.sampled(self.passage, TURN * after + (m.phase - self.phi0) % TURN)
        if (modes != m.modes).any():
            raise OrbitLost("the contact at the section is another one")
        return m.section.point(state)[m.free]

    def start(self, after: int, period: int) -> Fixed:
        """The point of the slow manifold that the run is near after so many periods.

        Raises
        ------
        OrbitLost
            If there is none.
        """
        begun = simulate(**self.point, periods=after, rtol=self.rtol)
        m, z = of_run(begun, begun.parameters, period, MAP_RTOL, Tape())
        if distance(m.image(z).point, z, m) > NEAR:
            raise OrbitLost("the run does not come back to where it was")
        near = at_point(m, z)
        return on_manifold(near)

    def passage_near(self, at: Fixed, after: int) -> tuple[float, int]:
        """How far the run is from a point of the manifold at the nearest of the next periods of its motion, and when."""
        tried = []
        for k in range(after, after + at.map.periods):
            try:
                tried.append((distance(at.z, self.at(at.map, k), at.map), k))
            except OrbitLost:
                continue
        return min(tried, default=(np.inf, after))


def at_point(m: ReturnMap, z: np.ndarray) -> Fixed:
    """A point with its derivatives, by differences so short that they seldom reach across a border."""
    m.step = STEP
    return fixed_at(m, z)


def distance(a: np.ndarray, b: np.ndarray, m: ReturnMap) -> float:
    """Of two points of a section, the spin aside."""
    return float(np.delete(np.abs(b - a), m.slow).max())


def led_to(at: Fixed, spin: float) -> np.ndarray:
    """Where the manifold leads at a spin nearby."""
    return at.z + slow_direction(at)[0] * (spin - at.image.spin) / at.map.unit


def next_on_manifold(at: Fixed, spin: float) -> Fixed:
    """The point of the slow manifold at a spin nearby.

    Raises
    ------
    OrbitLost
        If there is none, or one aside of where the manifold leads.
    """
    return on_manifold(at._replace(z=led_to(at, spin), image=at.image._replace(spin=spin)))


def on_manifold(near: Fixed) -> Fixed:
    """The point of the slow manifold near a point at its spin, to first order in the pace, from one period of the motion.

    Raises
    ------
    OrbitLost
        If there is none, or its fast part is not fast.
    """
    if not has_fast_part(near):
        raise OrbitLost("the fast part is no faster than the spin")
    m, others = near.map, np.arange(near.z.size) != near.map.slow
    values, vectors = np.linalg.eig(near.matrix)
    v = vectors[:, int(np.argmin(np.abs(values - 1)))].real
    lean = v / v[m.slow]

    def value(z: np.ndarray) -> tuple[np.ndarray, Image]:
        image = m.image(z)
        r = defect(m, z, image, near.image.spin)
        r[others] -= (image.point - z)[m.slow] * lean[others]
        return r, image

    def derivative(matrix: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        A = system(m, matrix, gradient)
        A[others] -= np.outer(lean[others], (matrix - np.eye(len(matrix)))[m.slow])
        return A

    known = derivative(near.matrix, near.gradient)
    root = newton(value, near.z, lambda z: derivative(*m.jacobian(z)), TOLERANCE * m.rtol, known)
    if np.abs(root.y - near.z).max() > MANIFOLD_REACH:
        raise OrbitLost("there is no orbit near where the family leads")
    return fixed_at(m, root.y, root.extra, float(np.abs(root.value).max()))


def in_own_section(at: Fixed) -> Fixed:
    """A point of the manifold in a section away from its events."""
    return at.map.in_own_section(at, at.image.passage, at_point)


def multiplier_of(at: Fixed) -> complex:
    """The largest multiplier of the fast part."""
    return complex(multipliers_of(at)[0][0])


def stability_lost(before: complex, after: complex) -> str | None:
    """What a motion has passed that is stable at first and unstable then, by its largest multiplier."""
    if abs(before) > 1.0 or abs(after) <= 1.0:
        return None
    if abs(after.imag) > COMPLEX:
        return "torus"
    return "fold" if after.real > 0 else "flip"


def border_ahead(at: Fixed, periods: int) -> Border | None:
    """The first border that a family meets by itself, at its own pace, in so many forcing periods."""
    word = word_of(at.image.passage)
    for _ in range(0, periods, at.map.periods):
        spins = at.image.spin, at.image.spin + slow_direction(at)[1]
        try:
            there = next_on_manifold(at, spins[1])
        except OrbitLost:
            return end_of(at, spins[1])
        if word_of(there.image.passage) != word:
            return Border(f"word ({word} to {word_of(there.image.passage)})", spins)
        lost = stability_lost(multiplier_of(at), multiplier_of(there))
        if lost:
            return Border(lost, spins)
        at = in_own_section(there)
    return None


def end_of(begin: Fixed, spin: float) -> Border:
    """Where a family ends that has no point at a spin ahead, by halving, and what the map does there."""
    at, low, high = begin, begin.image.spin, spin
    least = NARROWED * abs(high - low)
    while abs(high - low) > least:
        middle = 0.5 * (low + high)
        try:
            at, low = next_on_manifold(at, middle), middle
        except OrbitLost:
            high = middle
    ahead = [beyond(one, low + by * (spin - begin.image.spin)) for by in AHEAD for one in (at, begin)]
    told = next((what for what in ahead if what), NOTHING if has_fast_part(at) else SLOW)
    return Border(f"end of the family ({told})", (low, high))


def fold_behind(begin: Fixed, spin: float) -> Border | None:
    """The fold of the fixed points themselves between a point of a family and a spin, which a run that creeps passes late."""
    try:
        fixed = solve(begin.map, begin.z, begin.image.spin)
    except OrbitLost:
        return None
    for entry in traced(orbit_of(fixed), "spin", spin, FOLLOWED, words=False).entries:
        if entry.kind is FOLD:
            return Border("fold", (entry.value, entry.value))
    return None


def beyond(at: Fixed, spin: float) -> str:
    """What the motion does otherwise at the point to which a family leads where it has none; empty if nothing."""
    try:
        passage = at.map.image(led_to(at, spin)).passage
    except OrbitLost as reason:
        return str(reason)
    word, new = word_of(at.image.passage), word_of(passage)
    if new != word:
        return f"beyond it the word changes from {word} to {new}"
    before, after = (len(one.events) for one in (at.image.passage, passage))
    return f"{before} events in its period, {after} beyond" if before != after else ""


class Stretch(NamedTuple):
    """A run beside its family, period by period of the motion, and the first and last point of the family."""

    seen: list[Seen]
    first: Fixed
    last: Fixed
    left: int | None  # where the family does not go on: after so many periods

    def stability_lost(self) -> Border | None:
        """Where the family lost its stability last, if it has none at its end."""
        if abs(self.seen[-1].multiplier) <= 1.0:
            return None
        for b, a in pairwise(reversed(self.seen)):
            kind = stability_lost(a.multiplier, b.multiplier)
            if kind:
                return Border(f"{kind} passed after {a.after} periods", (a.spin, b.spin))
        return None


def stretch(run: Sampled, at: Fixed, after: int) -> Stretch:
    """Follow a run along its family, from a point of the manifold near it, as far as both go.

    The manifold is known to first order in the pace. Where the fast part is not much faster than the spin, a motion lags
    further behind, by what the map adds to the points found: this is added up and taken into account.
    """
    seen: list[Seen] = []
    first, behind = at, np.zeros(at.z.size)
    _, k = run.passage_near(at, after)
    while k + 2 * at.map.periods < run.periods:
        m = at.map
        try:
            z = run.at(m, k)
            there = next_on_manifold(at, m.image(z).spin)
        except OrbitLost:
            return Stretch(seen, first, at, k)
        if seen:
            behind = at.matrix @ behind + at.image.point - there.z
            behind[m.slow] = 0.0
        apart = distance(there.z, z - behind, m)
        seen.append(Seen(k, there.image.spin, apart, multiplier_of(there), word_of(there.image.passage)))
        at = in_own_section(there)
        k += m.periods
        if at is not there:  # the new section may lie in another one of the periods of the motion
            behind = np.zeros(at.z.size)
            _, k = run.passage_near(at, k)
    return Stretch(seen, first, at, None)


def stretches(run: Sampled, period: int, stop: int) -> list[Stretch]:
    """The families that a run goes through, from when it has settled, PATIENCE before its stop, until it has none."""
    found: list[Stretch] = []
    k, until = max(1, stop - PATIENCE), stop
    while k <= until and k + 3 * period < run.periods:
        try:
            one = stretch(run, run.start(k, period), k)
        except OrbitLost:
            one = None
        if one is None or not one.seen:
            k += period
            continue
        found.append(one)
        if one.left is None:
            break
        k, until = one.left + period, max(stop, one.left + PATIENCE)
    return found


class Why(NamedTuple):
    """Why a verdict differs from the one with the early stop: the kind (docs/stopping.md has them), and what shows it."""

    kind: str
    shown: str


def why(run: Sampled, period: int, stop: int) -> Why:
    """What becomes of a motion after the stop that its period led to.

    Where no orbit of that period explains it, one of a shorter period does, if the motion comes near it too slowly.
    """
    told = course(run, period, period, stop)
    for shorter in (q for q in range(period - 1, 0, -1) if period % q == 0 and told.kind == UNEXPLAINED):
        one = course(run, shorter, period, stop)
        if one.kind != UNEXPLAINED:
            kind = SHORTER if one.kind == KEEPS else one.kind
            return Why(kind, f"with its shorter period {shorter}, {one.shown}")
    return told


def course(run: Sampled, orbit: int, period: int, stop: int) -> Why:
    """What becomes of a motion after the stop, beside orbits of one period."""
    families = stretches(run, orbit, stop)
    at_stop = [n for n, one in enumerate(families) if one.seen[-1].after >= stop - period]
    if not at_stop:
        return Why(UNEXPLAINED, "no orbit is found near the run at its stop")
    one, later = families[at_stop[0]], families[at_stop[0] + 1 :]
    (first, *_), last = [seen for seen in one.seen if seen.after >= stop - period], one.seen[-1]
    furthest = max(seen.apart for seen in one.seen if seen.after >= first.after)
    on = (
        f"{first.apart:.1e} from its family after {first.after} periods, {last.apart:.1e} after {last.after}, "
        f"{furthest:.1e} at most"
    )
    if first.apart > ON or last.apart > ON:
        return Why(UNEXPLAINED, on)
    if one.left is None:
        shorter = repeats_after(one.last)
        return Why(SHORTER, f"{on}; it repeats after {shorter}") if shorter < orbit else Why(KEEPS, on)
    borders = borders_of(one, 2 * period)
    if not borders:
        return Why(UNEXPLAINED, f"{on}; then it leaves it, and the family goes on")
    then = f"; on a family again after {later[-1].seen[0].after}" if later and later[-1].left is None else ""
    return Why(FORETOLD, f"{on}; {', '.join(str(border) for border in borders)}{then}")


def borders_of(one: Stretch, periods: int) -> list[Border]:
    """Why a run leaves its family: what that has passed, and what lies ahead within so many periods."""
    found = [one.stability_lost(), border_ahead(one.last, periods)]
    if found[0] is None and found[1] is not None and (NOTHING in found[1].kind or SLOW in found[1].kind):
        found[0] = fold_behind(one.first, one.last.image.spin)
    return [border for border in found if border is not None]
