"""Points of a branch of orbits in one parameter or the spin, with their equations and derivatives.

The unknowns of a point are y = (section point, parameter over its scale). Two points that follow one another are in the
same section, so that points between them are found on planes across the line from one to the other.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.optimize import brentq

from dimersweep.analysis.orbits.continuation.steps import SAME_WAY
from dimersweep.analysis.orbits.map.lost import OrbitLost, all_found, attempt, first_found, require, singular_lost
from dimersweep.analysis.orbits.map.manifold import lag
from dimersweep.analysis.orbits.map.passage import TURN, Passage
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.map.solution import (
    NEWTON_STEPS,
    Axis,
    Mark,
    Orbits,
    Solution,
    defect,
    fixed_at,
    newton,
    system,
    target,
)
from dimersweep.kernel.model.layout import D1, FREE, N1
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES

# entry of the parameter in a tangent (of length 1) below which the branch is near a fold: two points may then have one
# value of the parameter, which does not tell them apart
NEAR_TURN = 0.05

TURN_KNOWN = 1e-7  # accuracy of the time at which an end turns [rad]: the gap does not change there to first order
GAP_SAMPLES = 64  # samples of the gap of an end in the air, in a forcing period


def least_gap(m: ReturnMap, passage: Passage) -> float:
    """Return the least gap at which an end turns in the air, in units of the section; inf if no end does."""
    lengths, segments = np.diff(passage.times), passage.segments
    least = np.inf
    for end in (0, 1):
        free = (segments[:-1, SEGMENT_MODES + end] == FREE) & (segments[:-1, SEGMENT_HOP_TIME] == 0)
        for k in np.flatnonzero(free & (lengths > TURN / GAP_SAMPLES)).tolist():

            def of_end(phases: np.ndarray, k: int = k, end: int = end) -> tuple[np.ndarray, np.ndarray]:
                states, _ = m.states(passage, phases, k)
                return states[:, D1 + end], states[:, N1 + end]

            phases = np.linspace(passage.times[k], passage.times[k + 1], int(GAP_SAMPLES * lengths[k] / TURN) + 2)
            rates = of_end(phases)[1]
            for j in np.flatnonzero((rates[:-1] < 0) & (rates[1:] >= 0)):
                try:
                    turns = brentq(lambda at: of_end(np.array([at]))[1][0], phases[j], phases[j + 1], xtol=TURN_KNOWN)
                except ValueError as error:  # computed anew, a rate near zero may have the other sign by rounding
                    raise OrbitLost(f"no time is found at which an end turns ({error})") from error
                least = min(least, float(of_end(np.array([turns]))[0][0] / m.section.units[0]))
    return least


class Branch(Orbits):
    """The problem of orbits along an axis, as `continuation.steps` asks for it."""

    __slots__ = ()

    def on_plane(self, at: Solution, y: np.ndarray, normal: np.ndarray) -> Solution:
        """Find the point of the branch on the plane through `y` across `normal`, with its own derivatives."""
        return with_derivatives(lent(at, y, normal))

    def judge(self, a: Solution, b: Solution, step: float) -> None:
        """Require that the branch turns little over a step and, if the spin is free, does not turn back at a kink."""
        require(a.tangent @ b.tangent >= SAME_WAY, "the branch turns too sharply")
        if self.axis.spin is None:
            back = _side(a) != _side(b) and a.passage.spin * b.passage.spin > 0
            far = np.linalg.norm(b.y - a.y) > step / SAME_WAY
            require(not back and not far, "the branch turns back at a kink")

    def settled(self, at: Solution, simplest: bool) -> Solution:
        """Return a point in another section if that suits it better, as `ReturnMap.in_own_section` decides.

        The point stays in its own section where no orbit is found in another one, and where an end grazes.
        """
        if grazes(at):
            return at
        return at.map.in_own_section(at, at.passage, partial(_moved, at), simplest)

    def elsewhere(self, at: Solution) -> Iterator[Solution]:
        """Yield a point in the section of each smooth phase of its motion in which Newton's method finds it."""
        return all_found(partial(_moved, at, *place) for place in at.map.sections(at.passage))


def grazes(at: Solution) -> bool:
    """Return True if an end just misses the plate."""
    return at.problem.mark is least_gap


def _side(at: Solution) -> float:
    """Return a sign, 1.0 or -1.0, that stays the same along a branch in one section, through folds and kinks.

    A change of the sign shows that the tangent has lost the sense of the branch.
    """
    return float(np.linalg.slogdet(np.vstack([at.derivative(), at.tangent]))[0])


def slope_of(
    axis: Axis, m: ReturnMap, z: np.ndarray, share: float, sense: float = 0.0, mark: Mark | None = None
) -> np.ndarray:
    """Return the derivative of `defect` by the parameter over its scale, as a quotient of differences, shape (n,).

    With a mark, the derivative of the mark is appended: shape (n + 1,).

    Parameters
    ----------
    axis : Axis
        Parameter of the branch. For the spin, the derivative is exact, and that of a mark is zero.
    m : ReturnMap
    z : ndarray, shape (n,)
        Solution of the section.
    share : float
        Value of the parameter over its scale.
    sense : float
        Side, 1 or -1, to which the difference is taken; 0 for a central difference or, where it fails, one to either
        side.
    mark : callable, optional
        Function of an orbit whose zero is sought along the branch, see `Mark`.
    """
    if axis.name == "spin":
        slope = np.zeros(z.size if mark is None else z.size + 1)
        slope[m.slow] = -axis.scale / m.unit
        return slope

    def at(by: float) -> np.ndarray:
        there = axis.map_at(m, share + by)
        passage = there.passage(z)
        fails = defect(there, z, passage, axis.spin)
        return fails if mark is None else np.append(fails, mark(there, passage))

    def between(ahead: float, back: float) -> np.ndarray:
        return (at(ahead) - at(back)) / (ahead - back)

    # a central difference is not to be had at a bound of the parameter: then one to either side is tried
    ways = [(sense * m.one_sided, 0.0)] if sense else [(m.step, -m.step), (m.step, 0.0), (0.0, -m.step)]
    return first_found(partial(between, *way) for way in ways)


@singular_lost()
def point_of(
    axis: Axis, fixed: Solution, value: float, along: np.ndarray | float = 1.0, slope: np.ndarray | None = None
) -> Solution:
    """Return a fixed point as the point of a branch, with its tangent in the sense of `along`: `Solution.towards`."""
    if slope is None:
        slope = slope_of(axis, fixed.map, fixed.z, value / axis.scale)
    point = fixed._replace(problem=Branch(fixed.map, axis), value=value, slope=slope)
    return point._replace(tangent=np.linalg.svd(point.derivative())[2][-1]).towards(along)


def with_derivatives(point: Solution, senses: np.ndarray | None = None, mark: Mark | None = None) -> Solution:
    """Return a point with its derivatives and its tangent computed anew, and with the derivative of a mark.

    With `senses`, shape (n + 1,), the differences are taken to one side only, 1 or -1 for each entry of y.
    """
    axis, m, n = point.axis, point.map, point.z.size
    rows = m.differences(point.z, None if senses is None else senses[:-1], mark)
    slope = slope_of(axis, m, point.z, point.value / axis.scale, 0.0 if senses is None else senses[-1], mark)
    again = point_of(axis, point._replace(rows=rows[: n + 1]), point.value, point.tangent, slope[:n])
    return again._replace(problem=again.problem._replace(mark=mark), rows=rows, slope=slope)


def lent(near: Solution, y: np.ndarray, normal: np.ndarray, most: int = NEWTON_STEPS) -> Solution:
    """Find the point of a branch on the plane through `y` across `normal`, with the derivatives of `near`.

    Its tangent is that of `near`, too. Newton's method may compute `most` new derivatives on its way.
    """
    axis = near.axis

    def derivative(there: np.ndarray) -> np.ndarray:
        own = axis.map_at(near.map, there[-1])
        A = system(own, *own.jacobian(there[:-1]), axis.spin is None)
        return np.vstack([np.column_stack([A, slope_of(axis, own, there[:-1], there[-1])]), normal])

    equations = Equations(near, lambda there, *_: normal @ (there - y))
    return equations.solved(y, derivative if most else None, np.vstack([near.derivative(), normal]), most)[0]


class Equations:
    """The equations of a point near another one: `defect` is zero, and so is one more function, `last`.

    The arguments of `last` are y, the map and the image.
    """

    def __init__(self, near: Solution, last: Callable[[np.ndarray, ReturnMap, Passage], float]) -> None:
        self.axis, self.near, self.last = near.axis, near, last

    def value(self, there: np.ndarray) -> tuple[np.ndarray, tuple[ReturnMap, Passage]]:
        """Return the values of the functions to be zero, shape (n + 1,), and the map and image they come from."""
        own = self.axis.map_at(self.near.map, there[-1])
        passage = own.passage(there[:-1])
        fails = defect(own, there[:-1], passage, self.axis.spin_at(there[-1] * self.axis.scale))
        return np.array([*fails, self.last(there, own, passage)]), (own, passage)

    def derivative(self, there: np.ndarray, step: float | None = None) -> np.ndarray:
        """Return the derivative of `value` by y, shape (n + 1, n + 1), by central differences."""
        step = self.near.map.step if step is None else step
        steps = step * np.eye(there.size)
        return np.array([(self.value(there + d)[0] - self.value(there - d)[0]) / (2 * step) for d in steps]).T

    def solved(
        self,
        y: np.ndarray,
        derivative: Callable[[np.ndarray], np.ndarray] | None = None,
        known: np.ndarray | None = None,
        most: int = NEWTON_STEPS,
    ) -> tuple[Solution, np.ndarray | None]:
        """Find the point near `y` at which the equations hold, and return it with the last derivative used.

        The point has the derivatives and the tangent of `near`. `derivative`, `known` and `most` are those of `newton`.
        """
        free = self.axis.spin is None
        y, extra, left, latest = newton(self.value, y, derivative, target(self.near.map, free), known, most)
        return self.point(y, extra, float(np.abs(left[:-1]).max())), latest

    def point(self, y: np.ndarray, extra: tuple[ReturnMap, Passage], residual: float = 0.0) -> Solution:
        """Return the point at a solution `y`, from the map and image that `value` returned there."""
        own, passage = extra
        value = float(y[-1] * self.axis.scale)
        near = self.near.unmarked().on_map(own)
        return near._replace(z=y[:-1], value=value, passage=passage, residual=residual)


def _moved(point: Solution, moved: ReturnMap, z: np.ndarray) -> Solution:
    """Find the point of a branch in another section, where its motion passes `z`."""
    axis = point.axis
    fixed = fixed_at(moved, z)
    # the motion of a fixed point in one section drifts slowly in another, so it lies beside the fixed point there
    fixed = fixed._replace(z=z - lag(fixed))
    slope = slope_of(axis, moved, z, point.value / axis.scale)
    near = fixed._replace(problem=Branch(moved, axis), value=point.value, slope=slope, tangent=np.zeros(z.size + 1))
    # the point keeps its value of the parameter, but near a fold, where another point of the branch has that value, too
    turns = abs(point.tangent[-1]) < NEAR_TURN
    normal = np.linalg.svd(near.derivative())[2][-1] if turns else np.eye(z.size + 1)[-1]
    return near.on_plane(near.y, normal).towards(_ahead(point, moved, z))


def _ahead(point: Solution, moved: ReturnMap, z: np.ndarray) -> np.ndarray:
    """Return the sense of a branch in another section, shape (n + 1,), for `Solution.towards`.

    It is the way from the motion of the point, which passes `z` there, to a motion a little ahead.
    """
    m = point.map
    phases = (moved.phase - m.phase) % TURN + TURN * np.arange(m.periods)

    def way() -> np.ndarray:
        later = point.y + m.step * point.tangent
        own = point.axis.map_at(m, later[-1])
        passage = own.passage(later[:-1])
        places = [own.moved_to(passage, phase) for phase in phases]
        same = [there for map_, there in places if map_.free.size == z.size]
        return (min(same, key=lambda there: float(np.abs(there - z).max()), default=z) - z) / m.step

    found = attempt(way)
    return np.append(np.zeros(z.size) if found is None else found, point.tangent[-1])
