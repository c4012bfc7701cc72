"""Borders as curves in the plane of two parameters, by pseudo-arclength, so that they may turn round in either.

The unknowns are those of a point of the border (the orbit, for a bifurcation its eigenvector, the first parameter) and the
second parameter: one more than there are equations. A step goes along the tangent and back to the curve on the plane across it
(Keller; Kuznetsov, doi 10.1007/978-3-031-22007-4, section 10.2).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import brentq

from dimersweep.errors import OrbitError, ParameterError
from dimersweep.inputs import check_count, check_rtol, number
from dimersweep.orbits.bifurcation_curve import BifurcationCurve
from dimersweep.orbits.branch import Axis, Mark, Point, in_own_section, with_mark
from dimersweep.orbits.curve import FollowedCurve, Found, add_stability, crossings
from dimersweep.orbits.finding import RTOL, checked, checked_spin
from dimersweep.orbits.kinds import BORDER_KINDS
from dimersweep.orbits.kinds.changes import change_of
from dimersweep.orbits.kinds.flip import FLIP
from dimersweep.orbits.kinds.kind import Bifurcation, Change
from dimersweep.orbits.labelling import dataset
from dimersweep.orbits.newton import TOLERANCE, defect, newton, system
from dimersweep.orbits.on_border import BorderEquations, OnBorder
from dimersweep.orbits.orbit import PeriodicOrbit, orbit_of
from dimersweep.orbits.poincare import OrbitLost, ReturnMap
from dimersweep.orbits.specials import MOST_CHANGES
from dimersweep.orbits.word import word_of
from dimersweep.orbits.word_curve import WordCurve, crept
from dimersweep.parameters import check_effect, check_name
from dimersweep.symbols import PARAMETERS

FIRST_ARC, LARGEST_ARC, SMALLEST_ARC, ARC_GROWTH = 0.02, 0.2, 1e-6, 1.5  # of a curve, in its unknowns
SHORT_ARC = 1e-3  # step from which on a kink is not avoided any more
# how well a meeting or a turn, and a change of word is known, as a share of a step
MEETING_LOCATED, WORD_LOCATED = 1e-9, 1e-7
# part of a test function at both ends of a step, below which it is zero between, and does not leap over zero
LEAP = 1e-3
SAME_WAY = 0.7  # product of the tangents of two points, and step over the way between them, below which it is too long
DOUBLED_FOLD = "flip-doubled_fold"  # where the orbit of twice the period has its fold on the flip itself


class Place(NamedTuple):
    """A point of a border in the plane of two parameters.

    Attributes
    ----------
    found : Found
        With the orbit, and what equations begin with.
    x : ndarray, shape (n + 1,)
        All unknowns; the second parameter over its scale is the last one, the first one that before.
    tangent : ndarray, shape (n + 1,)
        Of length one.
    tests : dict of str to float
        Functions that change their sign where the curve meets another border.
    """

    found: Found
    x: np.ndarray
    tangent: np.ndarray
    tests: dict[str, float]


class PlaneEquations(ABC):
    """The equations of a border in all unknowns, near a point of it.

    Parameters
    ----------
    curve : FollowedCurve
        Of the first parameter.
    other : Axis
        The second one.
    found : Found
    """

    def __init__(self, curve: FollowedCurve, other: Axis, found: Found) -> None:
        self.curve, self.other, self.found = curve, other, found

    @property
    def here(self) -> np.ndarray:
        """The unknowns at the point."""
        y = self.found.begin.y(self.curve.axis)
        return np.append(y, self.found.orbit.parameters[self.other.name] / self.other.scale)

    @abstractmethod
    def value(self, x: np.ndarray) -> tuple[np.ndarray, Any]:
        """How far the equations fail to hold, and what a point is made of."""

    @abstractmethod
    def derivative(self, x: np.ndarray) -> np.ndarray:
        """Of all equations, shape (n, n + 1)."""

    @abstractmethod
    def made(self, x: np.ndarray, extra: Any) -> Found:
        """The point of the border with these unknowns."""

    @abstractmethod
    def tests(self, found: Found) -> dict[str, float]:
        """Functions that change their sign where the curve meets another border, by the names of both."""

    def map_at(self, x: np.ndarray) -> ReturnMap:
        """The map at the second parameter."""
        return self.other.map_at(self.found.begin.map, x[-1] * self.other.scale)


class OfBifurcation(PlaneEquations):
    """The equations of a fold, a flip or a torus."""

    curve: BifurcationCurve

    def _system(self, x: np.ndarray) -> BorderEquations:
        return BorderEquations(self.curve.kind, self.curve.axis, self.map_at(x), self.found.begin.normal)  # type: ignore[arg-type]

    def value(self, x: np.ndarray) -> tuple[np.ndarray, Any]:
        return self._system(x).residual(x[:-1])

    def derivative(self, x: np.ndarray) -> np.ndarray:
        step = self.found.begin.map.step * np.append(np.zeros(x.size - 1), 1.0)
        ahead, back = self.value(x + step)[0], self.value(x - step)[0]
        return np.column_stack([self._system(x).derivative(x[:-1]), (ahead - back) / (2 * step[-1])])

    def made(self, x: np.ndarray, extra: Any) -> Found:
        near: OnBorder = self.found.begin
        return self.curve.at(OnBorder(extra, x[:-1], near.normal, None, 0.0))

    def tests(self, found: Found) -> dict[str, float]:
        tests = crossings(self.curve.kind, found.orbit)
        return tests | ({DOUBLED_FOLD: found.doubling} if self.curve.kind is FLIP else {})


class OfChange(PlaneEquations):
    """The equations of a change of word at which a mark of the orbit is zero."""

    curve: WordCurve

    def __init__(self, curve: WordCurve, other: Axis, found: Found) -> None:
        super().__init__(curve, other, found)
        zero = curve.kind.zero
        mark = None if zero is None or found.sides is None else zero(found.sides)
        if mark is None or found.begin.grazes:
            raise OrbitLost("the border has no equation there")
        self.mark: Mark = mark

    def value(self, x: np.ndarray) -> tuple[np.ndarray, Any]:
        m = self.curve.axis.map_at(self.map_at(x), x[-2] * self.curve.axis.scale)
        image = m.image(x[:-2])
        return np.append(defect(m, x[:-2], image, self.curve.spin), self.mark(m, image)), (m, image)

    def derivative(self, x: np.ndarray) -> np.ndarray:
        steps = self.found.begin.map.step * np.eye(x.size)
        return np.array([(self.value(x + d)[0] - self.value(x - d)[0]) / (2 * d.max()) for d in steps]).T

    def made(self, x: np.ndarray, extra: Any) -> Found:
        (m, image), near, axis = extra, self.found.begin, self.curve.axis
        fixed = near.fixed._replace(map=m, z=x[:-2], image=image, residual=0.0)
        at: Point = near._replace(fixed=fixed, value=float(x[-2] * axis.scale), mark_slope=None)
        at = with_mark(axis, at, self.mark)
        return Found(orbit_of(at.fixed), crept(axis, at, self.mark), in_own_section(axis, at), self.found.sides)

    def tests(self, found: Found) -> dict[str, float]:
        fixed = found.begin.fixed
        fold = float(np.linalg.det(system(fixed.map, fixed.matrix, fixed.gradient)))
        return {f"{self.curve.kind.name}-fold": fold, f"{self.curve.kind.name}-flip": FLIP.test(found.begin)}


def border_curve(
    kind: str,
    parameter: str,
    other: str,
    *,
    span: tuple[float | str, float | str],
    spin: float | None = None,
    start: PeriodicOrbit | None = None,
    points: int = 200,
    rtol: float = RTOL,
    **fixed: float,
) -> xr.Dataset:
    """A border as a curve in the plane of two parameters, which may turn round in either.

    Parameters
    ----------
    kind : str
        fold, flip, torus or hop.
    parameter, other : str
        The two parameters.
    span : tuple of float or str
        Values of `other` at which the curve ends. It is begun halfway, and followed to both sides.
    spin : float, optional
        Axial spin [rad s-1], as in `border`.
    start : PeriodicOrbit, optional
        From which the first point is looked for.
    points : int
        Points to either side at most, special ones aside.
    rtol : float
        Accuracy of the map [1].
    **fixed : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along `point`, from one end of the curve to the other: both parameters, the attributes of the border's
        `PeriodicOrbit`, `loses_stability` and `doubling` as in `border`, and `meets`: the two borders that meet in a row
        (hop-fold), or "turn" with the parameter in which the curve turns round there, each located to 1e-6 or better. At
        flip-doubled_fold the fold of the orbit of twice the period ends on the flip (generalised flip). The attribute `ends`
        says why the curve ends on either side, `cost` how many forcing periods of the map it took.

    Raises
    ------
    ParameterError
        For an unknown kind or parameter, or a value that is not allowed.
    OrbitError
        If no point of the border is found.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> fold = orbits.border_curve("fold", "Gamma", "e", span=(0.59, 0.61), spin=100.0)
    >>> bool((fold["Gamma"].diff("point") * fold["e"].diff("point") < 0).all())
    True
    """
    low, high, given, border = _judged(kind, parameter, other, span, fixed)
    spin, points = checked_spin(spin, given), check_count("points", points)
    made = BifurcationCurve if isinstance(border, Bifurcation) else WordCurve
    curve = made(border, parameter, given, spin, check_rtol(rtol))
    try:
        first = curve.point({}, [], start)
        axis = Axis(other, max(abs(low), abs(high)), spin)
        equations = _equations(curve, axis, first)
        begin = _placed(equations, first, equations.here, None)
    except OrbitLost as reason:
        raise OrbitError(f"no curve of a {kind} is begun at {other} = {given[other]:.6g}: {reason}") from reason
    rows, ends = [(begin, "")], []
    for sense in (-1.0, 1.0):
        side, end = _to_end(curve, axis, begin._replace(tangent=sense * begin.tangent), (low, high), points)
        rows = [*side[::-1], *rows] if sense < 0 else [*rows, *side]
        ends.append(end)
    return _table(curve, other, rows, ends)


def _judged(
    kind: str, parameter: str, other: str, span: tuple[float | str, float | str], fixed: dict[str, float]
) -> tuple[float, float, dict[str, float], Bifurcation | Change]:
    """The span, all parameters halfway, and the kind.

    Raises
    ------
    ParameterError
        For what is not allowed.
    """
    allowed = [name for name, one in BORDER_KINDS.items() if isinstance(one, Bifurcation) or getattr(one, "zero", None)]
    if kind not in allowed:
        raise ParameterError(f"kind = {kind!r}: has no curve (allowed: {', '.join(allowed)})")
    for name in (parameter, other):
        check_name(name)
    if parameter == other or {parameter, other} & fixed.keys():
        raise ParameterError(f"{other if other in fixed or parameter == other else parameter}: is given twice")
    try:
        low, high = (number("span", value, PARAMETERS[other].units) for value in span)
    except (TypeError, ValueError):
        raise ParameterError(f"span = {span!r}: must be the least and the greatest value of {other}") from None
    if not low < high:
        raise ParameterError(f"span = ({low:g}, {high:g}): the first must be below the second")
    check_effect({parameter, other, *fixed})
    for value in (low, high):
        checked(fixed | {other: value})
    border = BORDER_KINDS[kind]
    assert isinstance(border, Bifurcation | Change)
    return low, high, checked(fixed | {other: 0.5 * (low + high)}), border


def _equations(curve: FollowedCurve, other: Axis, found: Found) -> PlaneEquations:
    if isinstance(curve, BifurcationCurve):
        return OfBifurcation(curve, other, found)
    assert isinstance(curve, WordCurve)
    return OfChange(curve, other, found)


def _placed(equations: PlaneEquations, found: Found, x: np.ndarray, along: np.ndarray | None) -> Place:
    """A point with its tangent, in the sense of `along`, of all unknowns or the last ones (without: of a growing parameter)."""
    tangent = np.linalg.svd(equations.derivative(x))[2][-1]
    sense = tangent[-1] if along is None else tangent[-along.size :] @ along
    return Place(found, x, tangent if sense >= 0 else -tangent, equations.tests(found))


def _to_end(
    curve: FollowedCurve, other: Axis, place: Place, span: tuple[float, float], points: int
) -> tuple[list[tuple[Place, str]], str]:
    """The points of a curve from one on, each with what is special there, and why it ends."""
    rows: list[tuple[Place, str]] = []
    step = FIRST_ARC
    for _ in range(points):
        equations = _equations(curve, other, place.found)
        while True:
            try:
                nxt, edge = _stepped(equations, place, step, span)
                if edge or step < SHORT_ARC or not _at_kink(nxt.found):
                    break
                step *= 0.7
            except OrbitLost as reason:
                step *= 0.5
                if step < SMALLEST_ARC:
                    return rows, f"lost: {reason}"
        rows += _special(equations, place, nxt)
        if edge:
            return [*rows, (nxt, "")], f"{other.name} = {edge:g} is reached"
        try:  # in the section that suits the next step
            own = _equations(curve, other, nxt.found)
            same = own.found.begin.map.phase == equations.found.begin.map.phase and own.here.size == nxt.x.size
            place = _placed(own, nxt.found, own.here, nxt.tangent if same else nxt.tangent[-2:])
        except OrbitLost as reason:
            return [*rows, (nxt, "")], f"lost: {reason}"
        rows.append((place, ""))
        step = min(ARC_GROWTH * step, LARGEST_ARC)
    return rows, f"{points} points were asked for"


def _at_kink(found: Found) -> bool:
    """Whether contacts change so near a point that its derivatives are of two maps; the name of a hop counts for nothing."""
    fixed = found.orbit.fixed
    steps = 2 * fixed.map.step * np.eye(fixed.z.size)
    words = (word_of(fixed.map.image(fixed.z + d).passage) for d in (0.0, *steps, *-steps))
    return len({word.split(" far")[0] for word in words}) > 1


def _stepped(
    equations: PlaneEquations, place: Place, step: float, span: tuple[float, float]
) -> tuple[Place, float | None]:
    """The point a step further, or the one at an end of the span that lies before it, and that end."""
    nxt = _on_plane(equations, place, place.x + step * place.tangent, place.tangent)
    if np.linalg.norm(nxt.x - place.x) > step / SAME_WAY or place.tangent @ nxt.tangent < SAME_WAY:
        raise OrbitLost("the curve turns too sharply")
    for edge in span:
        a, b = (at.x[-1] - edge / equations.other.scale for at in (place, nxt))
        if a * b < 0:
            x = place.x + a / (a - b) * (nxt.x - place.x)
            return _on_plane(equations, place, x, np.append(np.zeros(x.size - 1), 1.0)), edge
    return nxt, None


def _on_plane(equations: PlaneEquations, place: Place, x: np.ndarray, normal: np.ndarray) -> Place:
    """The point of the curve on the plane through `x` across `normal`, in the section of a point nearby.

    Raises
    ------
    OrbitLost
        If there is none nearby.
    """

    def value(at: np.ndarray) -> tuple[np.ndarray, Any]:
        fails, extra = equations.value(at)
        return np.append(fails, normal @ (at - x)), extra

    def derivative(at: np.ndarray) -> np.ndarray:
        return np.vstack([equations.derivative(at), normal])

    root = newton(value, x, derivative, TOLERANCE * equations.curve.rtol)
    return _placed(equations, equations.made(root.y, root.extra), root.y, place.tangent)


def _special(equations: PlaneEquations, a: Place, b: Place) -> list[tuple[Place, str]]:
    """Where the curve meets other borders, or turns round, between two of its points, in their order."""
    signs: dict[str, Callable[[Place], float]] = {name: lambda place, name=name: place.tests[name] for name in a.tests}  # type: ignore[misc]
    names = (equations.curve.parameter, equations.other.name)
    signs |= {f"turn {name}": lambda place, k=k: place.tangent[k] for k, name in zip((-2, -1), names, strict=True)}  # type: ignore[misc]
    way = b.x - a.x
    normal = way / np.linalg.norm(way)
    reached = {0.0: a, 1.0: b}

    def at(share: float) -> Place:
        if share not in reached:
            reached[share] = _on_plane(equations, a, a.x + share * way, normal)
        return reached[share]

    found = []
    for name, test in signs.items():
        if test(a) * test(b) < 0:
            try:
                share = brentq(lambda share, test=test: test(at(share)), 0.0, 1.0, xtol=MEETING_LOCATED)
                if abs(test(at(share))) < LEAP * max(abs(test(a)), abs(test(b))):
                    found.append((share, (at(share), name)))
            except OrbitLost:
                continue
    words = a.found.orbit.word, b.found.orbit.word
    if isinstance(equations.curve.kind, Bifurcation):
        with suppress(OrbitLost):
            word, share = words[0], 0.0
            while word != words[1] and len(found) < MOST_CHANGES:
                share, beyond = _halved(lambda share: at(share).found.orbit.word, word, share)
                after = at(beyond).found.orbit.word
                found.append((share, (at(share), f"{equations.curve.kind.name}-{change_of(word, after).name}")))
                word, share = after, beyond
    return [row for _, row in sorted(found, key=lambda one: one[0])]


def _halved(read: Callable[[float], str], word: str, low: float) -> tuple[float, float]:
    """The last share of a step with a word, from one on that has it, and the first that has another one."""
    high = 1.0
    while high - low > WORD_LOCATED:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if read(middle) == word else (low, middle)
    return low, high


def _table(curve: FollowedCurve, other: str, rows: list[tuple[Place, str]], ends: list[str]) -> xr.Dataset:
    table = dataset([place.found.orbit for place, _ in rows], "point")
    columns = {
        curve.parameter: [place.found.value for place, _ in rows],
        other: [place.found.orbit.parameters[other] for place, _ in rows],
    }
    for name, values in columns.items():
        table[name] = ("point", np.array(values), PARAMETERS[name].attributes())
    add_stability(table, "point", curve.kind, [place.found for place, _ in rows])
    meets = np.array([special for _, special in rows], dtype=object).astype(str)
    table["meets"] = (
        "point",
        meets,
        {"long_name": "the two borders that meet there, or the parameter in which the curve turns"},
    )
    table.attrs |= {"kind": curve.kind.name, "parameter": curve.parameter, "other": other, "ends": ends}
    table.attrs |= {"spin": curve.spin, "cost": curve.tape.periods}
    return table.set_coords(list(columns))
